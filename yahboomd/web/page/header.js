// The lines on top of every view: state, why the robot stands, who drives, battery, network.

import { charge } from "./battery.js";
import { DASH, duration, write } from "./dom.js";
import { delayOf, weakness } from "./obstacles.js";

const SILENT_MS = 1000; // A weak network is silent for shorter times now and then.
// Nothing to read: nobody drives, who drives stands below, and a button releases.
const UNSAID = ["no_command", "ended", "driving", "release"];
const LESSER = ["lost", "refused"]; // Said if nothing else holds the robot.
// What helps at the robot's computer alone is read in Health.
const SHORT = {
  waiting_for_board: "The motor board is not connected. Details are in Health.",
  board_unfit: "The settings of the motor board do not fit this robot. Details are in Health.",
  unguarded: "Nothing would stop the robot if its program froze. Details are in Health.",
  battery: "The battery is empty: it drives slowly.",
};

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
    write(at("delay"), live.fresh("status") ? `${Math.round(delayOf(live)) || DASH} ms` : "");
  };
  for (const type of ["link", "problem", "hello", "control", "daemon", "status", "battery", "delay"]) live.on(type, show);
  setInterval(show, 1000);
  show();
}

/** The state of the robot as this page knows it, and why. */
export function summary(connection, live) {
  const problem = live.newest("problem");
  if (problem) return { state: "offline", words: "no access", why: problem.text };
  const [words, reason] = silence(connection, live);
  const status = live.sample("status");
  const why = `${wheels(status, live, !reason)}${reason || plain(status, live)}`;
  if (reason) return { state: "offline", words, why };
  if (status.wheels === "unknown") return { state: "unseen", words: "may turn", why };
  if (["standing", "stopping", "driving"].includes(status.state) && weakness(live))
    return { state: "waiting", words: "slow network", why: weakness(live) };
  return { state: status.state, words: status.state === "estopped" ? "emergency stop" : status.state, why };
}

/** Why no state of the robot is known now, in a word and a sentence; empty if it is. */
function silence(connection, live) {
  if (!connection.isOpen) {
    const attempt = connection.attempts > 1 ? ` Attempt ${connection.attempts}.` : "";
    return ["not connected", `${live.newest("link")?.reason || "Connecting to the robot's computer."}${attempt}`];
  }
  if (live.newest("daemon")?.alive === false) return ["no daemon", "Is yahboomd running on the robot? Details are in Health."];
  if (connection.beatAge > SILENT_MS && connection.beatAge < Infinity)
    return ["silent", "Nothing comes from the robot, or the network is too weak."];
  if (!live.sample("status")) return ["connecting", "Waiting for the robot's first status."];
  return live.fresh("status") ? ["", ""] : ["silent", `yahboomd says nothing since ${duration(live.age("status"))}.`];
}

/** What the wheels may do: the first words wherever another sentence could be read as "it stands". */
export function wheels(status, live, isNow) {
  const ago = live.age("status");
  if (status?.wheels === "unknown")
    return `The wheels may still turn: switch the motors' supply off. Not seen for ${duration(ago + (status.stamp_ns - status.wheels_since_ns) / 1e6)}. `;
  if (status?.wheels !== "turning" || (isNow && status.state === "driving")) return "";
  return isNow ? "The wheels still turn. " : `The wheels turned ${duration(ago)} ago: look at the robot. `;
}

/** The daemon's reasons for a phone. */
export function plain({ reasons, why, driver, state }, live) {
  const isSaid = ({ kind }) => kind !== "wheels" && !UNSAID.includes(kind) && !(kind === "zero_command" && driver === live.newest("hello")?.source);
  const said = (reasons ?? [{ kind: "", text: why }]).filter(isSaid);
  const first = said.filter(({ kind }) => !LESSER.includes(kind));
  const words = (first.length ? first : said).map(({ kind, text }) => SHORT[kind] ?? text);
  return words.join(" ").replace(/`([^`]*)`/g, "\u201c$1\u201d") || (state === "standing" ? "Ready." : "");
}

/** Who has control, and who drives. */
function who(live) {
  const control = live.newest("control");
  if (!control || !live.fresh("status")) return DASH;
  const page = control.mine ? "This page" : control.page_driver === null ? "No page" : control.name;
  const { driver, state } = live.sample("status");
  if (!driver || driver === live.newest("hello")?.source) return `${page} ${state === "driving" ? "drives" : "has control"}.`;
  return driver === "cmd_vel/moves" ? `${page} has control; a move drives.` : `${driver} drives.`;
}
