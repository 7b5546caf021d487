// The drive view: joystick, keys, speed limit, control, and why the robot is not driven.

import { Deadman } from "./deadman.js";
import { el, fixed, write } from "./dom.js";
import { Joystick } from "./joystick.js";
import { Keyboard } from "./keyboard.js";
import { obstacle } from "./obstacles.js";
import { padSide } from "./pad_side.js";
import { keep, kept } from "./storage.js";

const LIMIT = "speed limit"; // Its key in the storage of the browser.
const AGAIN = " Lift your thumb and touch again.";

export const drive = { id: "drive", title: "Drive", create };

function create(app) {
  const { live, connection } = app;
  let isShown = false;
  let byKeys = false;
  let lost = ""; // Why the last motion ended, unless the person let go.

  const share = () => Number(slider.value) / 100;
  const limits = () => live.newest("hello")?.limits ?? { vx: 0, vy: 0, wz: 0 };
  const sideways = () => limits().vy > 0;

  /** The velocity of a place of the joystick: right and up; left is sideways motion by keys. */
  const velocity = (right, up, left = 0) => {
    const most = limits();
    const slides = sideways() && slide.checked && !byKeys;
    return {
      vx: up * most.vx * share(),
      vy: (slides ? -right : left) * most.vy * share(),
      wz: slides ? 0 : -right * most.wz * share(),
    };
  };

  const barred = () => (joystick.hasMoved ? "The page moved under your thumb." : obstacle(connection, live));
  const deadman = new Deadman(connection, barred, (why) => {
    joystick.drop();
    keyboard.drop();
    lost = why;
    if (why && navigator.userActivation?.hasBeenActive) navigator.vibrate?.(120);
    show();
  });
  const press = (right, up, left = 0) => {
    lost = "";
    if (!deadman.held && live.newest("control")?.page_driver === null) connection.controlIfFree();
    if (deadman.held) deadman.move(velocity(right, up, left));
    else deadman.hold(velocity(right, up, left));
    show();
    return deadman.held;
  };
  const joystick = new Joystick(
    (right, up) => {
      byKeys = false;
      return !deadman.held && press(right, up);
    },
    (right, up) => deadman.move(velocity(right, up)),
    (why) => deadman.letGo(why),
  );
  const keyboard = new Keyboard(
    () => isShown && (byKeys || !deadman.held),
    (right, up, left) => {
      byKeys = true;
      const counts = press(right, up, left);
      if (counts) joystick.show(right, up);
      return counts;
    },
    () => deadman.letGo(),
  );
  app.onStop.add(() => deadman.letGo());

  const slide = el("input", { type: "checkbox", id: "slide" });
  const slideRow = el("label", { class: "slide", for: "slide", hidden: true }, slide, " Slide sideways instead of turning");
  const slider = el("input", { type: "range", id: "limit", min: "10", max: "100", step: "5" });
  slider.value = Math.max(10, Math.min(100, Number(kept(LIMIT)) || 40));
  const limitText = el("output", { for: "limit" });
  const words = el("p", { class: "words", role: "status", tabindex: "0" });
  const take = el("button", { type: "button", class: "take", onclick: () => connection.control(!mine()) });
  const speed = el("p", { class: "speed" });
  const mine = () => Boolean(live.newest("control")?.mine);

  slider.addEventListener("input", () => {
    keep(LIMIT, slider.value);
    // A held key still has the velocity of the old limit.
    deadman.letGo("The speed limit was changed.");
    show();
  });

  function show() {
    if (!isShown) return;
    const most = limits();
    const parts = [`${fixed(most.vx * share(), 2)} m/s`, `${fixed(most.wz * share(), 1)} rad/s`];
    write(limitText, live.newest("hello")?.limits ? parts.join(", ") : `${slider.value} %`);
    slideRow.hidden = !sideways();
    const why = deadman.held ? "" : obstacle(connection, live);
    joystick.element.classList.toggle("barred", Boolean(why));
    const driver = live.newest("hello")?.role === "driver" && connection.isOpen;
    const other = live.newest("control")?.page_driver ?? null;
    take.hidden = !driver || other === null;
    take.classList.toggle("primary", !mine());
    write(take, mine() ? "Give back" : "Take control");
    write(words, text(why));
  }

  function text(why) {
    const isEmpty = live.sample("status")?.board.battery === "empty";
    if (deadman.held) return refusal() || `Driving${isEmpty ? " slowly: the battery is empty" : ""}. Let go to stop.`;
    if (lost && why && lost !== why) return `${lost} ${why}`;
    if (lost) return lost + (why ? "" : AGAIN);
    return why || "Ready. Touch the pad to drive.";
  }

  /** The daemon's words on another source that has control while this page drives. */
  function refusal() {
    const driver = live.sample("status")?.driver;
    const own = live.newest("hello")?.source ?? "cmd_vel/web";
    return driver && driver !== own ? `${driver} has priority and drives the robot.` : "";
  }

  live.on("refused", (message) => {
    if (message.what !== "drive") return;
    if (message.why === "late") live.emit("delay", { age_ms: message.age_ms });
    // The page's own words have the figure.
    if (deadman.held) deadman.letGo((message.why === "late" && obstacle(connection, live)) || message.text);
    else show();
  });
  live.on("control", ({ mine: isMine }) => isMine || deadman.letGo("Another page took control."));
  live.on("link", ({ open }) => open || deadman.letGo("The connection to the robot was lost."));
  for (const type of ["hello", "control", "daemon", "status", "link", "delay"]) live.on(type, show);
  live.on("twist", ({ sample }) => {
    if (!isShown) return;
    const across = sideways() ? `, sideways ${fixed(sample.vy, 2)} m/s` : "";
    write(speed, `Forward ${fixed(sample.vx, 2)} m/s${across}, turn ${fixed(sample.wz, 2)} rad/s`);
  });

  const element = el(
    "section",
    { class: "drive" },
    words,
    el("div", { class: "room" }, joystick.element),
    el("div", { class: "line" }, speed, take),
    el("div", { class: "limit" }, el("label", { for: "limit" }, "Speed limit "), limitText, slider, padSide()),
    slideRow,
    el("p", { class: "keys" }, el("kbd", {}, "↑ ↓ ← →"), " or ", el("kbd", {}, "W A S D"), " drive while held. ", el("kbd", {}, "Space"), " is the emergency stop, everywhere."),
  );
  let clock = 0;
  return {
    element,
    show: () => {
      isShown = true;
      clock = setInterval(show, 300);
      show();
    },
    hide: () => {
      isShown = false;
      clearInterval(clock);
      deadman.letGo("Another view was opened.");
    },
  };
}
