// The lines on top of every view: state, why the robot stands, who drives, battery, network.

import { charge } from "./battery.js";
import { duration, write } from "./dom.js";
import { delayOf, weakness } from "./obstacles.js";

const STATES = {
  driving: "driving", standing: "standing", stopping: "stopping", estopped: "emergency stop",
  fault: "fault", waiting: "waiting",
};
const MOVES = "cmd_vel/moves";
const OLD_MS = 3000; // Two statuses come in a second.
const SILENT_MS = 1000; // A weak network is silent for shorter times now and then.

const at = (id) => document.getElementById(id);

export function watchHeader(connection, live) {
  const fit = whole(at("why"), at("more"));
  const show = () => {
    const hello = live.newest("hello");
    if (hello) {
      write(at("robot"), hello.robot || "yahboomd");
      document.title = hello.robot || "yahboomd";
    }
    const found = summary(connection, live);
    at("state").dataset.state = found.state;
    write(at("state"), found.words);
    write(at("why"), found.why);
    write(at("driver"), who(live));
    // Old figures would look like new ones.
    const { text, isLow } = found.state === "offline" ? { text: "", isLow: false } : charge(live);
    write(at("battery"), text);
    at("battery").classList.toggle("low", isLow);
    const delay = delayOf(live);
    write(at("delay"), delay && found.state !== "offline" ? `${Math.round(delay)} ms` : "");
    fit();
  };
  for (const type of ["link", "problem", "hello", "control", "daemon", "status", "battery", "delay"]) live.on(type, show);
  setInterval(show, 1000);
  show();
}

function summary(connection, live) {
  const link = live.newest("link");
  const problem = live.newest("problem");
  if (problem) return { state: "offline", words: "no access", why: problem.text };
  if (!connection.isOpen) {
    const attempt = connection.attempts > 1 ? ` Attempt ${connection.attempts}.` : "";
    const why = link?.reason || "Connecting to the robot's computer.";
    return { state: "offline", words: "not connected", why: `${why}${attempt}` };
  }
  const daemon = live.newest("daemon");
  if (daemon && !daemon.alive) return { state: "offline", words: "no daemon", why: "Is yahboomd running on the robot? Details are in Health." };
  if (connection.beatAge > SILENT_MS && connection.beatAge < Infinity)
    return { state: "offline", words: "silent", why: "Nothing comes from the robot, or the network is too weak." };
  const status = live.sample("status");
  if (!status) return { state: "offline", words: "connecting", why: "Waiting for the robot's first status." };
  if (live.age("status") > OLD_MS)
    return { state: "offline", words: "silent", why: `The last status is ${duration(live.age("status"))} old. It was: ${status.why}` };
  if (status.wheels === "unknown") return { state: "fault", words: "may turn", why: plain(status.why) };
  if (["standing", "stopping", "driving"].includes(status.state) && weakness(live))
    return { state: "waiting", words: "slow network", why: "The network is too slow to drive." };
  const why = plain(named(status.why, live), live.newest("hello")?.role);
  return { state: status.state, words: STATES[status.state] ?? status.state, why };
}

// That nobody drives is no reason to read; every other sentence stays as the daemon has it.
const ENDED = /(?:[^.`]* ended with a zero command(?: \d+(?:\.\d+)? [a-z]+ ago)?|No source commands motion|The page commands zero and keeps control)\./.source;
const NOBODY = new RegExp(`^${ENDED}|${ENDED}$`, "g");
const RELEASE = / ?To drive again: `[^`]*`\.?/g; // The button below does the same.

/** The daemon's words for a phone. */
export function plain(why, role) {
  const rest = why.replace(NOBODY, "");
  const words = role === "driver" ? rest.replace(RELEASE, "") : rest;
  return words.replace(/`([^`]*)`/g, "“$1”").trim() || "Ready.";
}

/** Which page, by its name; "" before that is known. */
function pageInControl(live) {
  const control = live.newest("control");
  if (!control) return "";
  return control.mine ? "This page" : control.page_driver === null ? "No page" : control.name;
}

/** Which page it is that drives. */
function named(why, live) {
  const isKnown = (live.newest("control")?.page_driver ?? null) !== null;
  return isKnown ? why.replace(/^The page drives\b/, `${pageInControl(live)} drives`) : why;
}

function who(live) {
  const page = pageInControl(live);
  if (!page) return "";
  const driver = live.sample("status")?.driver;
  if (!driver || driver === live.newest("hello")?.source) return `${page} has control.`;
  return driver === MOVES ? `${page} has control; a move drives.` : `${driver} drives.`;
}

/** A reason that is longer than its lines is read whole by a button; nothing moves for it. Returns what looks whether it fits. */
function whole(why, more) {
  const header = why.parentElement;
  const fit = () => {
    if (header.classList.contains("whole")) return;
    more.hidden = why.scrollHeight <= why.clientHeight + 1 && why.scrollWidth <= why.clientWidth + 1;
  };
  const show = (isWhole) => {
    header.classList.toggle("whole", isWhole);
    more.setAttribute("aria-expanded", isWhole);
    write(more, isWhole ? "Less" : "More");
    fit();
  };
  more.addEventListener("click", () => show(!header.classList.contains("whole")));
  document.addEventListener("pointerdown", ({ target }) => target !== more && !why.contains(target) && show(false), { capture: true });
  addEventListener("hashchange", () => show(false));
  addEventListener("resize", fit);
  return fit;
}
