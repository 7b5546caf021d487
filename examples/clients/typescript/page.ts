// A page that drives the robot while a button is held.

import { driveMoves } from "./moves.ts";
import { Robot } from "./robot.ts";
import { Square } from "./square.ts";

const ADDRESS = `${location.protocol.replace("http", "ws")}//${location.host}/zenoh`;
const NAMESPACE = new URLSearchParams(location.search).get("namespace") ?? "";
const PERIOD_MS = 50;
const STALE_MS = 300; // Without a pose for so long, the page does not show where the robot is.
const LOST_MS = 2000; // Without one for so long, the connection is opened again.

const element = (id: string) => document.getElementById(id)!;
const buttons = document.querySelectorAll<HTMLElement>("#pad button");

let robot: Robot | undefined;
let held: HTMLElement | undefined; // The button that is held.
let pressed = 0; // Since when.
let driving = false; // Whether the newest command was one for motion.
let square = false;
let arrived = 0; // When the newest pose did.

// The deadman. It sends while a button is held, in a page that is seen, and while poses come; else one zero.
// A page that is closed, frozen or cut off sends nothing: then yahboomd stops the robot after half a second.
setInterval(() => {
  const stale = performance.now() - arrived > STALE_MS;
  if (held && !stale && !document.hidden) {
    driving = true;
    send(Number(held.dataset.vx), Number(held.dataset.wz));
  } else if (driving) stop();
}, PERIOD_MS);

function send(vx: number, wz: number): void {
  robot?.send(vx, wz).catch(report);
}

/** Let go of everything. */
function stop(): void {
  held?.classList.remove("held");
  held = undefined;
  driving = square = false;
  send(0, 0);
}

for (const button of buttons) {
  button.addEventListener("pointerdown", (event) => {
    button.setPointerCapture(event.pointerId); // So that the release arrives even outside of the button.
    stop();
    held = button;
    pressed = performance.now();
    button.classList.add("held");
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) button.addEventListener(end, stop);
  button.addEventListener("contextmenu", (event) => event.preventDefault()); // A long touch opens it.
}
document.addEventListener("visibilitychange", () => document.hidden && stop());
window.addEventListener("blur", stop);
window.addEventListener("pagehide", stop);

function report(error: unknown): void {
  element("answer").textContent = error instanceof Error ? error.message : String(error);
}

function onClick(id: string, act: (robot: Robot) => Promise<string>): void {
  element(id).addEventListener("click", async () => {
    try {
      if (!robot) throw new Error("There is no connection.");
      element("answer").textContent = await act(robot);
    } catch (error) {
      report(error);
    }
  });
}

onClick("estop", async (robot) => (await robot.call("yahboomd/estop", { by: "the web page" })).message);
onClick("release", async (robot) => (await robot.call("yahboomd/estop/reset")).message);
onClick("zero", async (robot) => (await robot.call("yahboomd/odometry/set_pose", { x: 0, y: 0, theta: 0 })).message);
onClick("config", async (robot) => {
  const { message, data } = await robot.call("yahboomd/config");
  element("data").textContent = JSON.stringify(data, null, 2);
  return message;
});
onClick("square", async (robot) => {
  stop();
  square = true; // Any press, and a page that is left, cancels it.
  await Square.drive(robot, 0.5, () => !square);
  return "The square is closed.";
});
// No stop() before it: a zero command has precedence, and would end the moves.
onClick("moves", async (robot) => {
  square = true;
  const { reason, message } = await driveMoves(robot, 0.5, () => !square || document.hidden, ({ done }) => {
    element("answer").textContent = `${Math.round(100 * done)} %`;
  });
  return reason === "reached" ? "The square of moves is closed." : message;
});

async function connect(): Promise<void> {
  const opened = await Robot.connect(ADDRESS, NAMESPACE);
  await opened.watch("yahboomd/pose", "PoseSample", ({ x, y, theta }) => {
    arrived = performance.now();
    element("pose").textContent = `x ${x.toFixed(3)} m, y ${y.toFixed(3)} m, θ ${theta.toFixed(3)} rad`;
  });
  await opened.watch("yahboomd/status", "StatusSample", showStatus);
  robot = opened;
  showStatus(await opened.newest("yahboomd/status", "StatusSample"));
}

function showStatus({ state, why }: { state: string; why: string }): void {
  element("status").textContent = why ? `${state}: ${why}` : state;
  if (held && state === "standing" && performance.now() - pressed > 1000)
    report("The robot does not follow. Does gateway.json5 let pages drive? Its last lines decide.");
}

// zenoh-ts does not open a lost connection again, and does not say that it is lost: poses that stay away do.
for (;;) {
  try {
    await connect();
    arrived = performance.now();
    while (performance.now() - arrived < LOST_MS) await new Promise((done) => setTimeout(done, 200));
    report("No poses come; connecting again.");
  } catch (error) {
    report(error);
  }
  element("status").textContent = "not connected";
  await robot?.close().catch(() => {});
  robot = undefined;
  await new Promise((done) => setTimeout(done, 1000));
}
