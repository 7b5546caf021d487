// The deadman: the only place that sends velocities. It moves the robot while a thumb or a key is held, and no obstacle
// is known. Whatever ends it sends zero at once, zeros for a second, then nothing: a zero holds control.

const PERIOD_MS = 50;
const SPACING_MS = 20; // A finger moves more often than that; the server accepts 100 messages a second.
const ZEROS_MS = 1000;
const STALLED_MS = 250; // If this page did not run for this time, it no longer holds anything.
const ZERO = { vx: 0, vy: 0, wz: 0 };
const MOST = { vx: [100, "m/s"], vy: [100, "m/s"], wz: [1000, "rad/s"] }; // Larger values, and NaN, are mistakes.

export class Deadman {
  #velocity = null; // While held.
  #zerosUntil = -Infinity;
  #sentAt = -Infinity;
  #tickedAt = 0;
  #timer = 0;
  #lost = "";
  #wasBarred = false;
  #isTouched = false; // A finger is down, whether it counts or not.

  /**
   * @param connection Carries the velocities.
   * @param live Tells of refusals, of another page's control, and of a lost connection.
   * @param what The kind of command that a refusal names.
   * @param obstacle Returns why this page may not drive now, in words; "" if it may.
   * @param onEnd Called with the reason when the robot stops being driven; "" when the person let go.
   */
  constructor(connection, live, what, obstacle, onEnd) {
    this.connection = connection;
    this.obstacle = obstacle;
    this.onLetGo = (why) => {
      this.#lost = why;
      this.#wasBarred = false;
      onEnd(why);
      this.#wasBarred = why !== "" && why === this.obstacle();
    };
    live.on("refused", (message) => {
      if (message.what !== what) return;
      if (message.why === "late") live.emit("delay", { age_ms: message.age_ms });
      // The page's own words have the figure.
      this.letGo((message.why === "late" && this.obstacle()) || message.text);
    });
    live.on("control", ({ mine, name }) => mine || this.letGo(`${name || "Another page"} took control.`));
    live.on("link", ({ open }) => open || this.letGo("The connection to the robot was lost."));
    for (const type of ["pointerdown", "pointerup", "pointercancel"])
      document.addEventListener(type, () => (this.#isTouched = type === "pointerdown"), { capture: true });
    const lose = (why) => () => this.letGo(why);
    document.addEventListener("visibilitychange", () => document.hidden && this.letGo("The page was hidden."));
    document.addEventListener("freeze", lose("The page was hidden."));
    addEventListener("pagehide", lose("The page was left."));
    addEventListener("blur", lose("The page lost the focus."));
    // If the pad moves under a resting finger, the finger's place means another velocity.
    const moved = lose("The screen turned, or its size changed.");
    for (const type of ["resize", "orientationchange"]) addEventListener(type, moved);
    for (const type of ["resize", "scroll"]) globalThis.visualViewport?.addEventListener(type, moved);
    screen.orientation?.addEventListener("change", moved);
    document.addEventListener("fullscreenchange", moved);
  }

  get held() {
    return this.#velocity !== null;
  }

  /** Why the last motion ended; "" if the person let go, or if what was in the way is gone and no finger waits. */
  get lost() {
    if (this.held || (this.#wasBarred && !this.#isTouched && !this.obstacle())) this.forget();
    return this.#lost;
  }

  /** Nothing is to be said of the last motion any more. */
  forget() {
    this.#lost = "";
  }

  /** Begin to drive, at a velocity that `move` changes; false, with the reason passed on, if it may not. */
  hold(velocity) {
    const why = document.hidden ? "The page is hidden." : excess(velocity) || this.obstacle();
    if (why) {
      this.onLetGo(why);
      return false;
    }
    this.#velocity = velocity;
    this.#tickedAt = performance.now();
    if (!this.#timer) this.#timer = setInterval(() => this.#tick(), PERIOD_MS);
    this.#send(velocity);
    // A thumb that lands means zero: its first move is sent at once.
    this.#sentAt = -Infinity;
    return true;
  }

  /** Another velocity, while held. */
  move(velocity) {
    if (!this.held) return;
    this.#velocity = velocity;
    if (performance.now() - this.#sentAt >= SPACING_MS && this.#mayGoOn()) this.#send(velocity);
  }

  /** Stop: at once, for whatever reason. */
  letGo(why = "") {
    if (!this.held) return;
    this.#velocity = null;
    this.#zerosUntil = performance.now() + ZEROS_MS;
    this.#send(ZERO);
    this.onLetGo(why);
  }

  #mayGoOn() {
    const late = performance.now() - this.#tickedAt - PERIOD_MS;
    const why = late > STALLED_MS ? "This page stood still for a moment." : excess(this.#velocity) || this.obstacle();
    if (why) this.letGo(why);
    // Looking for an obstacle may have found that the button is let go.
    return this.held;
  }

  #tick() {
    if (this.held && this.#mayGoOn()) this.#send(this.#velocity);
    else if (!this.held && performance.now() < this.#zerosUntil) this.#send(ZERO);
    else if (!this.held) {
      clearInterval(this.#timer);
      this.#timer = 0;
    }
    this.#tickedAt = performance.now();
  }

  #send(velocity) {
    if (this.connection.drive(velocity)) this.#sentAt = performance.now();
  }
}

/** Why a velocity must be a mistake, or "". It is refused, not limited to the robot's speed. */
function excess(velocity) {
  for (const [axis, [most, unit]] of Object.entries(MOST)) {
    if (axis in velocity && !(Math.abs(velocity[axis]) <= most))
      return `This would be ${velocity[axis]} ${unit}, more than any robot drives: check its [limits]. Nothing was sent.`;
  }
  return "";
}
