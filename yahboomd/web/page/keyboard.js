// Driving by keys, while they are held: arrows or W A S D, and Q E sideways if the base can do it.

const KEYS = {
  ArrowUp: [0, 1, 0], KeyW: [0, 1, 0],
  ArrowDown: [0, -1, 0], KeyS: [0, -1, 0],
  ArrowLeft: [-1, 0, 0], KeyA: [-1, 0, 0],
  ArrowRight: [1, 0, 0], KeyD: [1, 0, 0],
  KeyQ: [0, 0, 1], KeyE: [0, 0, -1],
};

/** Whether an element uses a key itself: letters are typed into some, arrows move others. */
function takes(target, code) {
  if (target.matches?.("input:not([type=range]), textarea, select, [contenteditable]")) return true;
  return code.startsWith("Arrow") && Boolean(target.matches?.("input, [data-arrows]"));
}

export class Keyboard {
  #down = new Set();

  /**
   * @param isOn Whether keys drive now.
   * @param onHold Called with (right, up, left) of -1, 0, 1 when the keys change; returns whether they count.
   * @param onLoss Called when the last one was released.
   */
  constructor(isOn, onHold, onLoss) {
    this.isOn = isOn;
    this.onHold = onHold;
    this.onLoss = onLoss;
    addEventListener("keydown", (event) => this.#press(event));
    addEventListener("keyup", (event) => this.#release(event.code));
    addEventListener("blur", () => this.drop());
    // A menu or a drag takes the keys but not the focus: the release of a key is then never reported.
    for (const type of ["contextmenu", "dragstart"]) addEventListener(type, () => this.held && this.#lose(), { capture: true });
  }

  get held() {
    return this.#down.size > 0;
  }

  /** The keys do not count any more until they are pressed again. */
  drop() {
    this.#down.clear();
  }

  #press(event) {
    // With these the release of another key may never be reported.
    if (event.ctrlKey || event.altKey || event.metaKey) {
      if (this.held) this.#lose();
      return;
    }
    if (!KEYS[event.code] || takes(event.target, event.code) || !this.isOn()) return;
    event.preventDefault();
    if (event.repeat) return;
    this.#down.add(event.code);
    if (!this.onHold(...this.#direction())) this.drop();
  }

  #release(code) {
    if (!this.#down.delete(code)) return;
    if (this.held) this.onHold(...this.#direction());
    else this.onLoss();
  }

  #lose() {
    this.drop();
    this.onLoss();
  }

  #direction() {
    const sum = [0, 0, 0];
    for (const code of this.#down) KEYS[code].forEach((value, axis) => (sum[axis] += value));
    return sum.map((value) => Math.max(-1, Math.min(1, value)));
  }
}
