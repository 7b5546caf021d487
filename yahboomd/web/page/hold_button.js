// A button that counts while it is held, by one finger or by Enter. A second finger ends it, as on the joystick.

import { el } from "./dom.js";

export class HoldButton {
  #pointer = null;
  #key = false;

  /**
   * @param onPress Called when it is pressed; returns whether that counts.
   * @param onLoss Called with why it is lost; "" when it was let go.
   */
  constructor(onPress, onLoss, label = "Hold to move") {
    this.onPress = onPress;
    this.onLoss = onLoss;
    this.element = el("button", { type: "button", class: "hold primary" }, label);
    const button = this.element;
    const interrupted = (event) => this.#end(event, "The touch was interrupted.");
    button.addEventListener("pointerdown", (event) => this.#press(event));
    button.addEventListener("pointerup", (event) => this.#end(event, ""));
    button.addEventListener("pointercancel", interrupted);
    button.addEventListener("lostpointercapture", interrupted);
    // When it ends, another button may be under the finger: lifting it clicks nothing.
    for (const type of ["touchstart", "touchend"]) button.addEventListener(type, (event) => event.preventDefault(), { passive: false });
    button.addEventListener("contextmenu", (event) => event.preventDefault());
    button.addEventListener("keydown", (event) => this.#keyDown(event));
    button.addEventListener("keyup", (event) => event.code === "Enter" && this.#keyUp(""));
    button.addEventListener("blur", () => this.#keyUp("The button lost the focus."));
    document.addEventListener("pointerdown", (event) => this.#second(event), { capture: true });
    // With several keys down, a browser may not report the release of one.
    addEventListener("keydown", (event) => event.code !== "Enter" && this.#keyUp("Another key was pressed."), { capture: true });
  }

  /** It does not count any more until it is let go and pressed again. */
  drop() {
    const pointer = this.#pointer;
    this.#pointer = null;
    this.#key = false;
    if (pointer !== null && this.element.hasPointerCapture(pointer)) this.element.releasePointerCapture(pointer);
    this.element.classList.remove("held");
  }

  #press(event) {
    if (this.#pointer !== null || this.#key || !event.isPrimary || event.button !== 0 || !this.onPress()) return;
    this.#pointer = event.pointerId;
    this.element.setPointerCapture(event.pointerId);
    this.element.classList.add("held");
  }

  #second(event) {
    if (this.#key || (this.#pointer !== null && event.pointerId !== this.#pointer)) this.#lose("A second finger touched the screen.");
  }

  #end(event, why) {
    if (event.pointerId === this.#pointer) this.#lose(why);
  }

  #keyDown(event) {
    if (event.code !== "Enter") return;
    // A click does not hold.
    event.preventDefault();
    if (event.repeat || this.#pointer !== null || this.#key || !this.onPress()) return;
    this.#key = true;
    this.element.classList.add("held");
  }

  #keyUp(why) {
    if (this.#key) this.#lose(why);
  }

  #lose(why) {
    this.drop();
    this.onLoss(why);
  }
}
