// The drive view: joystick, keys, speed limit, control, and why the robot is not driven.

import { keepAwake } from "./awake.js";
import { Deadman } from "./deadman.js";
import { buzz, DASH, el, fixed, write } from "./dom.js";
import { Gamepad } from "./gamepad.js";
import { summary } from "./header.js";
import { Joystick } from "./joystick.js";
import { Keyboard } from "./keyboard.js";
import { obstacle } from "./obstacles.js";
import { settings } from "./settings.js";
import { keep, kept } from "./storage.js";

const LIMIT = "speed limit"; // Its key in the storage of the browser.
const PRESETS = { Walk: 20, Normal: 40, Fast: 100 }; // Percent.
const AGAIN = {
  thumb: "Lift your thumb and touch again.",
  keys: "Release the key and press it again.",
  gamepad: "Release the gamepad's button and press it again.",
};

export const drive = { id: "drive", title: "Drive", create };

function create(app) {
  const { live, connection } = app;
  let isShown = false;
  let by = "thumb"; // Or "keys", or "gamepad": what drives, or drove last.

  const share = () => Number(slider.value) / 100;
  const limits = () => live.newest("hello")?.limits ?? { vx: 0, vy: 0, wz: 0 };
  const sideways = () => limits().vy > 0;

  /** The velocity of a place of the stick: right and up; left is sideways motion by keys or a second stick. */
  const velocity = (right, up, left = 0) => {
    const most = limits();
    const slides = sideways() && slide.checked && by === "thumb";
    return {
      vx: up * most.vx * share(),
      vy: (slides ? -right : left) * most.vy * share(),
      wz: slides ? 0 : -right * most.wz * share(),
    };
  };

  const barred = () => {
    // The pad as it is now, not as it was when its timer last ran.
    if (gamepad.held) gamepad.check();
    return joystick.hasMoved ? "The page moved under your thumb." : obstacle(connection, live);
  };
  const deadman = new Deadman(connection, live, "drive", barred, (why) => {
    joystick.drop();
    keyboard.drop();
    gamepad.drop();
    if (why) buzz(120);
    keepAwake();
    show();
  });
  /** Begin by the thumb, keys or the gamepad, unless another of them drives; returns whether it counts. */
  const press = (what, right, up, left = 0) => {
    if (deadman.held) {
      if (by !== what) return false;
      deadman.move(velocity(right, up, left));
    } else {
      by = what;
      if (live.newest("control")?.page_driver === null) connection.controlIfFree();
      if (deadman.hold(velocity(right, up, left))) keepAwake();
      show();
    }
    return deadman.held;
  };
  const joystick = new Joystick(
    () => !deadman.held && press("thumb", 0, 0),
    (right, up) => deadman.move(velocity(right, up)),
    (why) => deadman.letGo(why),
  );
  const shown = (what, right, up, left) => {
    const counts = press(what, right, up, left);
    if (counts) joystick.show(right, up);
    return counts;
  };
  const keyboard = new Keyboard(
    () => isShown && (by === "keys" || !deadman.held),
    (right, up, left) => shown("keys", right, up, left),
    () => deadman.letGo(),
  );
  const gamepad = new Gamepad(
    (right, up, left) => isShown && shown("gamepad", right, up, sideways() ? left : 0),
    (why) => deadman.letGo(why),
    (what) => {
      if (what === "stop") app.estop.engage();
      else if (what === "release") document.querySelector("#release:not([hidden])")?.click();
      // Its velocities follow the limit at once: nothing has to stop for it.
      else setLimit(Number(slider.value) + (what === "faster" ? 10 : -10));
    },
  );
  app.onStop.add(() => {
    if (deadman.held) buzz(120);
    deadman.letGo();
  });

  const slide = el("input", { type: "checkbox", id: "slide" });
  const slideRow = el("label", { class: "slide", for: "slide", hidden: true }, slide, " Slide sideways instead of turning");
  const slider = el("input", { type: "range", id: "limit", min: "10", max: "100", step: "5" });
  slider.value = Math.max(10, Math.min(100, Number(kept(LIMIT)) || PRESETS.Normal));
  const limitText = el("output", { for: "limit" });
  const presets = Object.entries(PRESETS).map(([name, percent]) =>
    el("button", { type: "button", value: percent, onclick: () => { setLimit(percent); changed(); } }, name));
  const limitRow = el("div", { class: "limit" }, el("label", { for: "limit" }, "Speed limit "), limitText, slider, el("div", { class: "presets", role: "group", "aria-label": "Speed limit" }, ...presets));
  const words = el("p", { class: "words", role: "status", tabindex: "0" });
  const take = el("button", { type: "button", class: "take", onclick: () => connection.control(!mine()) });
  const speed = el("p", { class: "speed" });
  const mine = () => Boolean(live.newest("control")?.mine);
  const { opener, panel, show: showSettings } = settings(gamepad, () => deadman.letGo());

  /** In percent. */
  function setLimit(percent) {
    slider.value = percent;
    keep(LIMIT, slider.value);
    show();
  }
  const changed = () => {
    // A held key still has the velocity of the old limit.
    deadman.letGo("The speed limit was changed.");
    setLimit(slider.value);
  };
  slider.addEventListener("input", changed);

  function show() {
    if (!isShown) return;
    const most = limits();
    const parts = [`${fixed(most.vx * share(), 2)} m/s`, `${fixed(most.wz * share(), 1)} rad/s`];
    write(limitText, live.newest("hello")?.limits ? parts.join(",\n") : `${slider.value} %`);
    const isViewer = live.newest("hello")?.role === "viewer";
    limitRow.hidden = isViewer; // It would do nothing.
    slideRow.hidden = isViewer || !sideways();
    joystick.pad.hidden = isViewer;
    const why = deadman.held ? "" : obstacle(connection, live);
    joystick.pad.classList.toggle("barred", Boolean(why));
    for (const each of presets) each.setAttribute("aria-pressed", each.value === slider.value);
    showSettings();
    showSpeed();
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
    // What to do comes first: on a small screen the rest scrolls.
    if (deadman.lost && !why) return `${AGAIN[by]} ${deadman.lost.replace(/ Let go, .*again\.$/, "")}`;
    if (["offline", "waiting"].includes(summary(connection, live).state)) return "Waiting: see above.";
    return why || "Ready. Touch the pad to drive.";
  }

  /** The daemon's words on another source that has control while this page drives. */
  function refusal() {
    const driver = live.fresh("status")?.sample.driver;
    const own = live.newest("hello")?.source ?? "cmd_vel/web";
    return driver && driver !== own ? `${driver} has priority and drives the robot.` : "";
  }

  for (const type of ["hello", "control", "daemon", "status", "link", "delay"]) live.on(type, show);
  function showSpeed() {
    const sample = live.fresh("twist")?.sample;
    const figure = (name) => (sample ? fixed(sample[name], 2) : DASH);
    // A line for each: what changes its length must not move the pad.
    const across = sideways() ? `sideways ${figure("vy")} m/s\n` : "";
    write(speed, `Forward ${figure("vx")} m/s\n${across}turn ${figure("wz")} rad/s`);
  }
  live.on("twist", () => isShown && showSpeed());

  const element = el(
    "section",
    { class: "drive" },
    words,
    el("div", { class: "room" }, joystick.element, panel),
    el("div", { class: "line" }, speed, take, opener),
    limitRow,
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
