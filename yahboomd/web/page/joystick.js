// The joystick: one pointer, captured, becomes a point of the unit disc. Its middle is where the thumb landed, so that
// landing moves nothing. A second pointer ends it.

import { buzz, el } from "./dom.js";

const DEAD = 0.08; // Share of the travel: a resting thumb does not drive.
const EXPO = 0.5; // 0: speed in proportion to the way; 1: its third power. Small ways are fine, the end is the full speed.
const TRAVEL = 0.69; // Of the ring's radius: there the knob touches the ring from inside.
const FULL = 0.999;
const BESIDE = "header, nav, footer, .drive > *"; // Their texts change while the pad is held.
const SHIFT = 1; // Pixels of rounding by the layout.

/** A stick's place, right and up, as shares of the speed: dead around the middle, fine near it, 1 at the end. */
export function shares(x, y, dead = DEAD) {
  const length = Math.hypot(x, y);
  const scale = length > dead ? Math.min(1, (length - dead) / (1 - dead)) / length : 0;
  return [x * scale, y * scale].map((way) => (1 - EXPO) * way + EXPO * way ** 3);
}

export class Joystick {
  #pointer = null;
  #box = null; // The zone's place, measured when it was pressed.
  #middle = [0, 0]; // Where the thumb landed.
  #travel = 1;
  #atEnd = false;

  /**
   * @param onPress Called when a thumb landed; returns whether it counts.
   * @param onMove Called with x (right), y (up) as shares of the speed, while it is held.
   * @param onLoss Called with why it is lost; "" when it was lifted.
   */
  constructor(onPress, onMove, onLoss) {
    this.onPress = onPress;
    this.onMove = onMove;
    this.onLoss = onLoss;
    this.knob = el("div", { class: "knob" });
    this.pad = el(
      "div",
      { class: "pad", role: "application", tabindex: "0", "aria-label": "Joystick. Keys: arrows or W A S D drive while held." },
      el("div", { class: "cross", "aria-hidden": "true" }),
      this.knob,
    );
    this.element = el("div", { class: "zone" }, this.pad); // The thumb may land anywhere in it.
    const zone = this.element;
    zone.addEventListener("pointerdown", (event) => this.#press(event));
    zone.addEventListener("pointermove", (event) => event.pointerId === this.#pointer && this.onMove(...this.#place(event)));
    zone.addEventListener("pointerup", (event) => this.#end(event, ""));
    zone.addEventListener("pointercancel", (event) => this.#end(event, "The touch was interrupted."));
    zone.addEventListener("lostpointercapture", (event) => this.#end(event, "The touch was interrupted."));
    zone.addEventListener("contextmenu", (event) => event.preventDefault());
    // When a second finger comes down anywhere, none of them counts.
    document.addEventListener("pointerdown", (event) => this.#second(event), { capture: true });
  }

  /** Show the stick's place, from -1 to 1 right and up; also that of the keys and of a gamepad. */
  show(x, y) {
    this.knob.style.setProperty("--x", x.toFixed(3));
    this.knob.style.setProperty("--y", (-y).toFixed(3));
    const isAtEnd = Math.hypot(x, y) > FULL;
    if (isAtEnd && !this.#atEnd) buzz(12);
    this.#atEnd = isAtEnd;
  }

  /** Whether the zone has moved since it was pressed: the thumb now means another velocity. */
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
    this.pad.classList.remove("held");
    this.pad.style.translate = "";
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
    const ring = this.pad.getBoundingClientRect();
    this.#travel = (ring.width / 2) * TRAVEL;
    this.#middle = [event.clientX, event.clientY];
    if (!this.onPress()) {
      this.#pin(false);
      return;
    }
    this.#pointer = event.pointerId;
    this.element.setPointerCapture(event.pointerId);
    this.pad.classList.add("held");
    this.pad.style.translate = `${event.clientX - ring.left - ring.width / 2}px ${event.clientY - ring.top - ring.height / 2}px`;
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
    const x = (event.clientX - this.#middle[0]) / this.#travel;
    const y = (this.#middle[1] - event.clientY) / this.#travel;
    const length = Math.max(1, Math.hypot(x, y));
    this.show(x / length, y / length);
    return shares(x, y);
  }
}
