// Why this page may not drive now, in plain words. Those that stay fit two lines of a phone on its side, at twice the text.

import { duration } from "./dom.js";

const KNOWN = ["driving", "standing", "stopping", "estopped", "fault", "waiting"];

/** Why not, or "". Reasons that a person can change come last. */
export function obstacle(connection, live) {
  const hello = live.newest("hello");
  if (!connection.isOpen || !hello) return "No connection to the robot's computer.";
  const lapse = lapseOf(live);
  if (connection.beatAge > lapse)
    return `Nothing came from the robot for ${duration(connection.beatAge)}: the network is too weak.`;
  const slow = weakness(live);
  if (slow) return slow;
  if (hello.role !== "driver") return "This phone may watch and stop, not drive.";
  // The header has the daemon's own words.
  if (live.newest("daemon")?.alive === false) return "No yahboomd answers. The page waits for it.";
  const status = live.fresh("status")?.sample;
  if (!status) return "The robot's state is not known now: see above.";
  if (status.wheels === "unknown") return "The wheels may still turn.";
  if (status.state === "estopped") return "Release the stop to drive.";
  if (status.state === "fault") return "Clear the fault to drive.";
  if (!KNOWN.includes(status.state)) return "State unknown to this page: see above.";
  if (hello.barred) return hello.barred;
  if (status.state === "waiting") return "The robot waits: see above.";
  const control = live.newest("control");
  return control?.mine || control?.page_driver === null ? "" : `${control?.name ?? "Another page"} has control of the robot.`;
}

const lapseOf = (live) => live.newest("hello")?.lapse_ms ?? 300;

/** Whether the network is too slow to drive, in words; "" if it is not. */
export function weakness(live) {
  const [delay, lapse] = [delayOf(live), lapseOf(live)];
  return delay > lapse ? `The network is too slow to drive: ${Math.round(delay)} ms, ${lapse} ms at most.` : "";
}

/** The newest round-trip delay, in ms; 0 if none is known. */
export function delayOf(live) {
  return live.fresh("delay")?.age_ms ?? 0;
}
