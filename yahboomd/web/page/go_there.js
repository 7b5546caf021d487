// Going to a place of the map, or turning to look at it: while a finger, a mouse button or Enter is held.

import { Deadman } from "./deadman.js";
import { buzz, el, fixed, write } from "./dom.js";
import { HoldButton } from "./hold_button.js";
import { obstacle } from "./obstacles.js";

const HOLD_MS = 250; // A shorter touch marks the place, and drives nowhere.
const SHIFT = 10; // Pixels: a finger that moves further in that time moves the map.
const NONE = { state: "none" };

export class GoThere {
  #pointer = null; // On the map; it holds, or will after a moment.
  #from = [0, 0];
  #timer = 0;
  #turn = false;
  #isNew = true; // The place is new: the end of an earlier move is not shown for it.

  /** @param onChange Called when the drawing on the map has to change. */
  constructor({ live, connection, onStop }, onChange) {
    this.live = live;
    this.connection = connection;
    this.onChange = onChange;
    this.isOpen = false;
    this.place = null; // In metres.
    // The deadman of the joystick, with a held place instead of velocities.
    this.deadman = new Deadman(
      { drive: (wanted) => (wanted.held ? connection.go(this.#wanted()) : connection.drive(wanted)) },
      live,
      "go",
      () => (this.place ? this.#barred() : "Touch a place of the map first."),
      (why) => this.#ended(why),
    );
    const button = (label, turn) => new HoldButton(() => this.#begin(turn), (why) => this.deadman.letGo(why), label);
    this.buttons = [button("Go there", false), button("Turn to here", true)];
    this.opener = el("button", { type: "button", "aria-expanded": "false", onclick: () => this.#toggle() }, "Go to");
    this.words = el("p", { role: "status" });
    this.bar = el("progress", { max: 1, value: 0, "aria-label": "How much of the way is done" });
    this.panel = el("div", { class: "go", hidden: true }, this.words, this.bar, el("div", { class: "line" }, ...this.buttons.map((each) => each.element)));
    onStop.add(() => this.letGo());
    document.addEventListener("pointerdown", (event) => event.pointerId !== this.#pointer && this.#second(), { capture: true });
    live.on("move", ({ state }) => {
      if (state === "ended" && this.deadman.held) this.letGo();
      this.#show();
      onChange();
    });
    for (const type of ["hello", "control", "daemon", "status", "link", "delay"]) live.on(type, () => this.#show());
  }

  /** The place to draw: of this page, or of the move that another one holds. */
  get drawn() {
    const move = this.live.newest("move") ?? NONE;
    if (["begins", "running"].includes(move.state)) return { x: move.x, y: move.y, driven: true };
    return this.isOpen && this.place ? { ...this.place, driven: false } : null;
  }

  /** Stop the held motion. */
  letGo(why = "") {
    this.#forget();
    this.deadman.letGo(why);
  }

  close() {
    if (this.isOpen) this.#toggle();
  }

  /** A place was chosen, in metres. */
  mark([x, y]) {
    if (this.deadman.held) return;
    this.place = { x, y };
    this.#isNew = true;
    this.deadman.forget();
    this.#show();
    this.onChange();
  }

  /** The first finger, or the mouse, came down on the map, at pixels and at metres. */
  press(event, pixels, metres) {
    if (!event.isPrimary || event.button !== 0 || this.deadman.held) return;
    this.mark(metres);
    this.#pointer = event.pointerId;
    this.#from = pixels;
    this.#timer = setTimeout(() => this.#begin(false) || this.#forget(), HOLD_MS);
  }

  /** Whether a pointer that moves holds the place; else it moves the map. */
  keeps(event, [x, y]) {
    if (event.pointerId !== this.#pointer) return false;
    if (this.deadman.held || Math.hypot(x - this.#from[0], y - this.#from[1]) <= SHIFT) return true;
    this.#forget();
    return false;
  }

  /** A pointer was lifted, or interrupted. */
  release(event, why) {
    if (event.pointerId === this.#pointer) this.letGo(why);
  }

  #second() {
    if (this.#pointer !== null) this.letGo("A second finger touched the screen.");
  }

  #forget() {
    clearTimeout(this.#timer);
    this.#pointer = null;
  }

  #begin(turn) {
    if (this.deadman.held) return false;
    this.#turn = turn;
    if (this.live.newest("control")?.page_driver === null) this.connection.controlIfFree();
    const counts = this.deadman.hold({ held: true });
    this.#isNew = !counts;
    this.#show();
    return counts;
  }

  #ended(why) {
    this.#forget();
    for (const each of this.buttons) each.drop();
    if (why) buzz(120);
    this.#show();
  }

  /** The speed limit of the drive view counts here, too. */
  #wanted() {
    const limits = this.live.newest("hello")?.limits ?? { vx: 0.1, wz: 0.5 };
    const share = Number(document.getElementById("limit").value) / 100;
    return { ...this.place, turn: this.#turn, speed_m_s: limits.vx * share, turn_rad_s: limits.wz * share };
  }

  #barred() {
    return obstacle(this.connection, this.live) || this.live.newest("hello")?.no_moves || "";
  }

  #toggle() {
    this.letGo();
    this.isOpen = !this.isOpen;
    this.panel.hidden = !this.isOpen;
    this.panel.parentElement.classList.toggle("going", this.isOpen);
    this.opener.setAttribute("aria-expanded", this.isOpen);
    this.place = null;
    this.#isNew = true;
    this.deadman.forget();
    this.#show();
    this.onChange();
  }

  #show() {
    if (!this.isOpen) return;
    const move = this.live.newest("move") ?? NONE;
    this.bar.value = move.state === "none" ? 0 : (move.done ?? 0);
    this.panel.classList.toggle("held", this.deadman.held);
    write(this.words, this.#text(move));
    // Without the service they would do nothing.
    this.bar.hidden = this.panel.lastChild.hidden = Boolean(this.live.newest("hello")?.no_moves);
  }

  #text(move) {
    const barred = this.#barred();
    if (this.deadman.held) return move.state === "running" ? `${left(move)} Let go to stop.` : "It begins. Let go to stop.";
    const { lost } = this.deadman;
    if (lost) return lost === barred || !barred ? lost : `${lost} ${barred}`;
    if (barred) return barred;
    if (move.state === "running") return left(move);
    if (move.state === "ended" && !this.#isNew) return move.message;
    return "Hold a place: the robot goes there until you let go. A short touch marks it.";
  }
}

/** The rest of a move, in words. */
function left({ left_m: metres, left_rad: radians, left_s: seconds }) {
  const turn = Math.abs((radians * 180) / Math.PI);
  const parts = [metres >= 0.005 && `${fixed(metres, 2)} m`, turn >= 0.5 && `${fixed(turn, 0)}°`].filter(Boolean);
  return `${[...parts, `${fixed(seconds, 1)} s`].join(", ")} left.`;
}
