// Setting the pose: numbers, or a touch on the map and a drag along the heading.

import { el, write } from "./dom.js";

export class SetPose {
  /**
   * @param connection Asks the robot.
   * @param pose Returns the newest pose, or null.
   * @param onChange Called when the drawing on the map has to change.
   */
  constructor(connection, pose, onChange) {
    this.connection = connection;
    this.pose = pose;
    this.onChange = onChange;
    this.isOpen = false;
    this.wanted = null;
    this.opener = el("button", { type: "button", "aria-expanded": "false", onclick: () => this.#toggle() }, "Set pose");
    this.inputs = Object.fromEntries(
      ["x", "y", "heading"].map((name) => [name, el("input", { type: "number", step: "any", inputmode: "decimal", name, required: true, oninput: () => this.#read() })]),
    );
    const units = { x: "x, m", y: "y, m", heading: "heading, °" };
    this.answer = el("p", { role: "status" });
    this.form = el(
      "form",
      { class: "setpose", hidden: true, novalidate: true, onsubmit: (event) => this.#submit(event) },
      ...Object.entries(this.inputs).map(([name, input]) => el("label", {}, `${units[name]} `, input)),
      el("button", { type: "submit", class: "primary" }, "Set"),
      el("button", { type: "button", onclick: () => this.#fill({ x: 0, y: 0, theta: 0 }) }, "Zero"),
      this.answer,
    );
    this.hint = el("p", { class: "hint", hidden: true }, "Touch the robot's place, and drag to where it faces.");
  }

  /** A finger came down there. */
  point([x, y]) {
    this.#fill({ x, y, theta: this.wanted?.theta ?? 0 });
  }

  /** It was dragged to there. */
  turn([x, y]) {
    if (!this.wanted) return;
    const theta = Math.atan2(y - this.wanted.y, x - this.wanted.x);
    if (Math.hypot(y - this.wanted.y, x - this.wanted.x) > 0.02) this.#fill({ ...this.wanted, theta });
  }

  close() {
    if (this.isOpen) this.#toggle();
  }

  #toggle() {
    this.isOpen = !this.isOpen;
    this.form.hidden = this.hint.hidden = !this.isOpen;
    this.form.parentElement.classList.toggle("posing", this.isOpen);
    this.opener.setAttribute("aria-expanded", this.isOpen);
    write(this.answer, "");
    if (this.isOpen) this.#fill(this.pose() ?? { x: 0, y: 0, theta: 0 });
    else {
      this.wanted = null;
      if (this.form.contains(document.activeElement)) this.opener.focus();
      this.onChange();
    }
  }

  #fill({ x, y, theta }) {
    const around = Math.atan2(Math.sin(theta), Math.cos(theta));
    this.wanted = { x, y, theta: around };
    this.inputs.x.value = x.toFixed(2);
    this.inputs.y.value = y.toFixed(2);
    this.inputs.heading.value = ((around * 180) / Math.PI).toFixed(0);
    this.onChange();
  }

  #read() {
    const [x, y, heading] = ["x", "y", "heading"].map((name) => this.inputs[name].valueAsNumber);
    const isWhole = [x, y, heading].every(Number.isFinite);
    if (isWhole) this.wanted = { x, y, theta: (heading * Math.PI) / 180 };
    this.onChange();
    return isWhole;
  }

  async #submit(event) {
    event.preventDefault();
    if (!this.#read()) {
      write(this.answer, "Three numbers are needed.");
      return;
    }
    const answer = await this.connection.request("set_pose", this.wanted);
    write(this.answer, answer.text);
  }
}
