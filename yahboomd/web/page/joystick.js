// The joystick: one pointer, captured, becomes a point of the unit disc. A second one ends it.

import { el } from "./dom.js";

const DEAD = 0.08; // Share of the radius: a resting thumb does not drive.
const BESIDE = "header, nav, footer, .drive > *"; // Their texts change while the pad is held.
const SHIFT = 1; // Pixels of rounding by the layout.

export class Joystick {
  #pointer = null;
  #box = null; // The pad's place, measured when it was pressed.

  /**
   * @param onPress Called with x (right), y (up) of the unit disc; returns whether the thumb counts.
   * @param onMove The same while it is held.
   * @param onLoss Called with why it is lost; "" when it was lifted.
   */
  constructor(onPress, onMove, onLoss) {
    this.onPress = onPress;
    this.onMove = onMove;
    this.onLoss = onLoss;
    this.knob = el("div", { class: "knob" });
    this.element = el(
      "div",
      { class: "pad", role: "application", tabindex: "0", "aria-label": "Joystick. Keys: arrows or W A S D drive while held." },
      el("div", { class: "cross", "aria-hidden": "true" }),
      this.knob,
    );
    const pad = this.element;
    pad.addEventListener("pointerdown", (event) => this.#press(event));
    pad.addEventListener("pointermove", (event) => event.pointerId === this.#pointer && this.onMove(...this.#place(event)));
    pad.addEventListener("pointerup", (event) => this.#end(event, ""));
    pad.addEventListener("pointercancel", (event) => this.#end(event, "The touch was interrupted."));
    pad.addEventListener("lostpointercapture", (event) => this.#end(event, "The touch was interrupted."));
    pad.addEventListener("contextmenu", (event) => event.preventDefault());
    // When a second finger comes down anywhere, none of them counts.
    document.addEventListener("pointerdown", (event) => this.#second(event), { capture: true });
  }

  /** Show the velocity, from -1 to 1 right and up; also that of the keys. */
  show(x, y) {
    this.knob.style.setProperty("--x", x.toFixed(3));
    this.knob.style.setProperty("--y", (-y).toFixed(3));
  }

  /** Whether the pad has moved since it was pressed: the thumb now means another velocity. */
  get hasMoved() {
    if (this.#pointer === null) return false;
    const now = this.element.getBoundingClientRect();
    return ["left", "top", "width", "height"].some((side) => Math.abs(now[side] - this.#box[side]) > SHIFT);
  }

  /** The thumb does not count any more until it is lifted and put down again. */
  drop() {
    const pointer = this.#pointer;
    this.#pointer = null;
    if (pointer !== null && this.element.hasPointerCapture(pointer)) this.element.releasePointerCapture(pointer);
    this.element.classList.remove("held");
    this.#pin(false);
    this.show(0, 0);
  }

  /** While it is held nothing beside it changes its height: a longer text must not move the pad. */
  #pin(isHeld) {
    const all = [...document.querySelectorAll(BESIDE)];
    const heights = all.map((each) => (isHeld ? `${each.getBoundingClientRect().height}px` : ""));
    all.forEach((each, index) => (each.style.height = heights[index]));
  }

  #press(event) {
    // A finger that is not the first has another one beside it.
    if (this.#pointer !== null || !event.isPrimary || event.button !== 0) return;
    this.#pin(true);
    this.#box = this.element.getBoundingClientRect();
    if (!this.onPress(...this.#place(event))) {
      this.#pin(false);
      return;
    }
    this.#pointer = event.pointerId;
    this.element.setPointerCapture(event.pointerId);
    this.element.classList.add("held");
  }

  #second(event) {
    if (this.#pointer === null || event.pointerId === this.#pointer) return;
    this.drop();
    this.onLoss("A second finger touched the screen.");
  }

  #end(event, why) {
    if (event.pointerId !== this.#pointer) return;
    this.drop();
    this.onLoss(why);
  }

  #place(event) {
    const box = this.#box;
    const radius = box.width / 2;
    const x = (event.clientX - box.left - radius) / radius;
    const y = (box.top + box.height / 2 - event.clientY) / radius;
    const length = Math.hypot(x, y);
    const reach = Math.min(1, Math.max(0, (length - DEAD) / (1 - DEAD)));
    const scale = length > 0 ? reach / length : 0;
    const place = [x * scale, y * scale];
    this.show(...place);
    return place;
  }
}
