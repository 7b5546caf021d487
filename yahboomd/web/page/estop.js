// The emergency stop: from every view, by POST and by the connection, again and again until the robot acknowledges it.

import { write } from "./dom.js";

const OFF = "Switch the motors' supply off.";
const AGAIN_MS = 500;
const GIVE_UP_MS = 1500; // The timeout of one request: the next ones are under way by then.

export class Estop {
  #attempts = 0;
  #wanted = false;
  #pressedAt = -Infinity;
  #answer = ""; // Of the robot, to the stop or to the release, until its state changes.
  #state = "";

  constructor(connection, live, onPress) {
    this.connection = connection;
    this.live = live;
    this.onPress = onPress;
    this.bar = document.getElementById("stop");
    this.text = document.getElementById("estop-text");
    this.button = document.getElementById("estop");
    this.releaseButton = document.getElementById("release");
    // A finger engages it as it comes down; Enter and assistive technology click.
    this.button.addEventListener("pointerdown", () => this.engage());
    this.button.addEventListener("click", () => performance.now() - this.#pressedAt > 1000 && this.engage());
    this.releaseButton.addEventListener("click", () => this.#release());
    // Capture: before the key acts on the focused element.
    addEventListener("keydown", (event) => this.#key(event), { capture: true });
    addEventListener("keyup", (event) => event.code === "Space" && !this.#types(event) && event.preventDefault(), { capture: true });
    for (const type of ["status", "hello", "control", "link", "daemon"]) live.on(type, () => this.#show());
    this.#show();
  }

  /** Press it. */
  engage() {
    this.onPress();
    this.#pressedAt = performance.now();
    if (this.#wanted) return;
    this.#wanted = true;
    this.#attempts = 0;
    this.#answer = "";
    this.#try();
  }

  #key(event) {
    if (event.code !== "Space" || this.#types(event)) return;
    event.preventDefault();
    event.stopPropagation();
    if (event.repeat) return;
    this.engage();
    // The next Tab reaches the release.
    this.button.focus({ preventScroll: true });
  }

  #types({ target }) {
    return Boolean(target.matches?.("input:not([type=range]):not([type=checkbox]):not([type=radio]), textarea"));
  }

  #try() {
    if (!this.#wanted || document.body.classList.contains("shut")) return;
    this.#attempts += 1;
    this.#show();
    this.#post();
    this.connection.estop().then((answer) => answer.ok && this.#acknowledged());
    setTimeout(() => this.#try(), AGAIN_MS);
  }

  async #post() {
    try {
      const signal = AbortSignal.timeout(GIVE_UP_MS);
      const answer = await fetch("/estop", { method: "POST", keepalive: true, signal });
      const body = await answer.json();
      if (answer.status === 401) this.connection.checkSession();
      if (answer.ok && body.engaged) this.#acknowledged();
      else if (this.#wanted) this.#answer = body.text ?? "";
    } catch {
      // The next attempt is on its way.
    }
  }

  #acknowledged() {
    if (!this.#wanted) return;
    this.#wanted = false;
    this.#answer = "The robot acknowledged the emergency stop.";
    this.#show();
  }

  async #release() {
    if (performance.now() - this.#pressedAt < 1000) return; // It came up under the finger that stops.
    if (!this.#isMine) return this.connection.control(true);
    this.releaseButton.disabled = true;
    const answer = await this.connection.request("release");
    this.releaseButton.disabled = false;
    if (!answer.ok) this.#answer = answer.text;
    this.#show();
    // Space releases nothing, and Enter must not by accident.
    this.button.focus({ preventScroll: true });
  }

  get #isMine() {
    const control = this.live.newest("control");
    return control?.mine || control?.page_driver === null;
  }

  #show() {
    const state = this.live.fresh("status")?.sample.state ?? "";
    const engaged = state === "estopped";
    const drives = this.live.newest("hello")?.role === "driver";
    if (!this.#wanted && this.#state === "estopped" && !engaged) this.#answer = "";
    this.#state = state;
    this.bar.classList.toggle("wanted", this.#wanted);
    this.bar.classList.toggle("engaged", engaged);
    this.releaseButton.hidden = this.#wanted || !drives || !(engaged || state === "fault");
    write(this.releaseButton, !this.#isMine ? "Take control" : engaged ? "Release the stop" : "Clear the fault");
    write(this.button, this.#wanted ? "Stopping\u2026" : engaged ? "Stop again" : "Emergency stop");
    write(this.text, this.#words(engaged, drives));
  }

  #words(engaged, drives) {
    if (this.#wanted && this.#attempts === 1) return "Asking the robot to stop\u2026";
    // The remedy first: on a small screen the rest scrolls.
    if (this.#wanted) return `${OFF} Not acknowledged yet, attempt ${this.#attempts}. ${this.#answer.replace(OFF, "")}`.trim();
    if (!engaged) return this.#answer;
    const off = this.live.sample("status").wheels === "unknown" ? `${OFF} ` : "";
    return off + this.#answer + (drives ? "" : " A phone that may drive can release it.");
  }
}
