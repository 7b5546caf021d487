// The lines on top of every view: state, why the robot stands, who drives, battery, network.

import { charge } from "./battery.js";
import { duration, write } from "./dom.js";
import { delayOf } from "./obstacles.js";

const STATES = {
  driving: "driving", standing: "standing", stopping: "stopping", estopped: "emergency stop",
  fault: "fault", waiting: "waiting",
};
const MOVES = "cmd_vel/moves";
const OLD_MS = 3000; // Two statuses come in a second.

const at = (id) => document.getElementById(id);

export function watchHeader(connection, live) {
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
    const { text, isLow } = charge(live);
    write(at("battery"), text);
    at("battery").classList.toggle("low", isLow);
    const delay = delayOf(live);
    write(at("delay"), delay ? `${Math.round(delay)} ms` : "");
    at("delay").title = "Network, there and back";
    at("battery").title = "Battery, at rest";
  };
  for (const type of ["link", "hello", "control", "daemon", "status", "battery", "delay"]) live.on(type, show);
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
  if (daemon && !daemon.alive) return { state: "offline", words: "no daemon", why: daemon.text };
  const status = live.sample("status");
  if (!status) return { state: "offline", words: "connecting", why: "Waiting for the robot's first status." };
  if (live.age("status") > OLD_MS)
    return { state: "offline", words: "silent", why: `The last status is ${duration(live.age("status"))} old. It was: ${status.why}` };
  const why = plain(named(status.why, live), live.newest("hello")?.role);
  return { state: status.state, words: STATES[status.state] ?? status.state, why };
}

// That nobody drives is no reason to read; every other sentence stays as the daemon has it.
const NOBODY = / ?(?:[^.`]* ended with a zero command(?: \d+(?:\.\d+)? [a-z]+ ago)?|No source commands motion)\.$/;
const RELEASE = / ?To drive again: `[^`]*`\.?/g; // The button below does the same.

/** The daemon's words for a phone. */
export function plain(why, role) {
  const rest = why.replace(NOBODY, "");
  return (role === "driver" ? rest.replace(RELEASE, "") : rest).trim() || "Ready.";
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
