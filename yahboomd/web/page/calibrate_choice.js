// The choice of a calibration, and of its numbers: those that the server names, which are the command's options.

import { el } from "./dom.js";

const METHODS = [
  {
    verb: "tape",
    title: "Tape",
    words: "The size of the wheels, and the track. You need a tape measure and 2 m of floor; it takes ten minutes.",
  },
  {
    verb: "squares",
    title: "Squares",
    words: "The ratio of the wheels too, so that a straight is one. You need a tape measure and 3 m by 3 m; it takes half an hour.",
  },
  {
    verb: "imu",
    title: "Gyro",
    words: "How the inertial sensor is mounted, for boards that have one. You turn the robot by hand; it takes two minutes, and writes nothing.",
  },
];

export class Choice {
  #method = METHODS[0];
  #forms = {}; // The fields of each method, as JSON Schema.
  #inputs = new Map();
  #switches = new Map();

  /** @param onStart Called with the method, and the chosen values by name. */
  constructor(onStart) {
    this.methods = METHODS.map((method) => el("button", { type: "button", onclick: () => this.#choose(method) }, method.title));
    this.words = el("p");
    this.fields = el("div", { class: "fields" });
    this.wrong = el("p", { class: "error", role: "alert" });
    this.start = el("button", { type: "submit", class: "primary" }, "Begin");
    this.element = el(
      "form",
      { class: "card choice", novalidate: true, onsubmit: (event) => this.#submit(event, onStart) },
      el("h2", {}, "Find the true size of the robot"),
      el("div", { class: "tools", role: "group", "aria-label": "Method" }, ...this.methods),
      this.words,
      this.fields,
      this.wrong,
      this.start,
    );
    this.#choose(METHODS[0]);
  }

  /** Offer these fields, by method. */
  offer(forms) {
    if (JSON.stringify(forms) === JSON.stringify(this.#forms)) return; // What was typed stays.
    this.#forms = forms;
    this.#choose(this.#method);
  }

  #choose(method) {
    this.#method = method;
    this.wrong.textContent = "";
    METHODS.forEach((each, at) => this.methods[at].setAttribute("aria-pressed", each === method));
    this.words.textContent = method.words;
    this.#inputs = new Map();
    this.#switches = new Map();
    const fields = Object.entries(this.#forms[method.verb] ?? {}).map(([name, field]) => [this.#field(name, field), field.more]);
    this.fields.replaceChildren(...fields.filter(([, more]) => !more).map(([each]) => each));
    const more = fields.filter(([, more]) => more).map(([each]) => each);
    if (more.length) this.fields.append(el("details", {}, el("summary", {}, "More"), el("div", { class: "fields" }, ...more)));
  }

  #field(name, { type, description, minimum: min, maximum: max, default: value }) {
    const label = description[0].toUpperCase() + description.slice(1);
    if (type === "boolean") {
      // A button: the space bar, which a checkbox needs, is the emergency stop.
      const button = el("button", { type: "button", "aria-pressed": String(value), onclick: () => button.setAttribute("aria-pressed", button.ariaPressed !== "true") }, label);
      this.#switches.set(name, button);
      return button;
    }
    const step = type === "integer" ? 1 : min < 0.1 ? 0.01 : 0.1;
    const input = el("input", { type: "number", inputmode: "decimal", required: true, name, value, min, max, step });
    this.#inputs.set(name, input);
    return el("label", {}, `${label} `, input);
  }

  #submit(event, onStart) {
    event.preventDefault();
    const choices = {};
    const bad = [...this.#inputs.values()].find(({ validity }) => validity.valueMissing || validity.badInput || validity.rangeUnderflow || validity.rangeOverflow);
    this.wrong.textContent = bad ? `${bad.parentElement.firstChild.textContent.trim()}: a number from ${bad.min} to ${bad.max} is needed.` : "";
    if (bad) {
      bad.closest("details")?.setAttribute("open", "");
      bad.focus();
      return;
    }
    for (const [name, input] of this.#inputs) choices[name] = input.valueAsNumber;
    for (const [name, button] of this.#switches) choices[name] = button.ariaPressed === "true";
    onStart(this.#method.verb, choices);
  }
}
