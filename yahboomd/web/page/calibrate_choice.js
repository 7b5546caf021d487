// The choice of a calibration and its numbers. The server has the same names, and its own bounds.

import { el } from "./dom.js";

const SPEEDS = [
  { name: "speed", label: "Speed, m/s", value: 0.2, min: 0.02, max: 1, step: 0.01 },
  { name: "turn-speed", label: "Turning, rad/s", value: 0.8, min: 0.1, max: 3, step: 0.1 },
];
const METHODS = [
  {
    verb: "tape",
    title: "Tape",
    words: "The size of the wheels, and the track. You need a tape measure and 2 m of floor; it takes ten minutes.",
    fields: [
      { name: "straight", label: "Straight run, m", value: 2, min: 0.2, max: 20, step: 0.1 },
      { name: "turns", label: "Turns each way", value: 5, min: 1, max: 50, step: 1 },
    ],
    more: [{ name: "sideways", label: "To each side, m (mecanum wheels)", value: 1, min: 0.2, max: 5, step: 0.1 }, ...SPEEDS],
  },
  {
    verb: "squares",
    title: "Squares",
    words: "The ratio of the wheels too, so that a straight is one. You need a tape measure and 3 m by 3 m; it takes half an hour.",
    fields: [
      { name: "side", label: "Side, m", value: 2, min: 0.2, max: 10, step: 0.1 },
      { name: "count", label: "Squares each way", value: 5, min: 1, max: 50, step: 1 },
      { name: "straight", label: "Straight run, m", value: 5, min: 0.2, max: 20, step: 0.1 },
    ],
    more: SPEEDS,
  },
  {
    verb: "imu",
    title: "Gyro",
    words: "How the inertial sensor is mounted, for boards that have one. You turn the robot by hand; it takes two minutes, and writes nothing.",
    fields: [{ name: "turns", label: "Turns to the left", value: 5, min: 1, max: 50, step: 1 }],
  },
  {
    title: "Sensor",
    words: "Against the poses of SLAM or motion capture, without a tape. Their recording is on a computer and not on a phone, so this is done in a terminal there, with the files of a recording that you make here:",
    command: "yahboomd calibrate poses run-001 SENSOR_BAG --frames map laser",
    fields: [],
  },
];
const FLAGS = [
  { name: "by-hand", label: "I push the robot myself" },
  { name: "dry-run", label: "Only show the result" },
];

export class Choice {
  #method = METHODS[0];
  #inputs = new Map();
  #flags = new Map();

  /** @param onStart Called with the method, and the chosen values by name. */
  constructor(onStart) {
    this.methods = METHODS.map((method) => el("button", { type: "button", onclick: () => this.#choose(method) }, method.title));
    this.words = el("p");
    this.command = el("code", {});
    this.fields = el("div", { class: "fields" });
    this.start = el("button", { type: "submit", class: "primary" }, "Begin");
    this.element = el(
      "form",
      { class: "card choice", onsubmit: (event) => this.#submit(event, onStart) },
      el("h2", {}, "Find the true size of the robot"),
      el("div", { class: "tools", role: "group", "aria-label": "Method" }, ...this.methods),
      this.words,
      this.command,
      this.fields,
      this.start,
    );
    this.#choose(METHODS[0]);
  }

  #choose(method) {
    this.#method = method;
    METHODS.forEach((each, at) => this.methods[at].setAttribute("aria-pressed", each === method));
    this.words.textContent = method.words;
    this.command.textContent = method.command ?? "";
    this.command.hidden = !method.command;
    this.start.hidden = Boolean(method.command);
    this.#inputs = new Map();
    this.#flags = new Map();
    const field = ({ name, label, value, ...bounds }) => {
      const input = el("input", { type: "number", inputmode: "decimal", required: true, name, value, ...bounds });
      this.#inputs.set(name, input);
      return el("label", {}, `${label} `, input);
    };
    this.fields.replaceChildren(...method.fields.map(field));
    if (!method.more) return;
    // Buttons: the space bar, which a checkbox needs, is the emergency stop.
    const flags = FLAGS.map(({ name, label }) => {
      const button = el("button", { type: "button", "aria-pressed": "false", onclick: () => button.setAttribute("aria-pressed", button.ariaPressed !== "true") }, label);
      this.#flags.set(name, button);
      return button;
    });
    this.fields.append(el("details", {}, el("summary", {}, "More"), el("div", { class: "fields" }, ...method.more.map(field), ...flags)));
  }

  #submit(event, onStart) {
    event.preventDefault();
    const choices = {};
    for (const [name, input] of this.#inputs) choices[name] = input.valueAsNumber;
    for (const [name, button] of this.#flags) choices[name] = button.ariaPressed === "true";
    onStart(this.#method.verb, choices);
  }
}
