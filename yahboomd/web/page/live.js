// The newest message of each type, when it arrived, and those that listen.

// How long a message is the present: two statuses come in a second, a board that is slow to answer is asked for its voltage
// every two minutes, and all else comes many times a second.
const FRESH_MS = { status: 3000, battery: 150_000, delay: 2500 };
const SAMPLED_MS = 1000;

export class Live {
  #listeners = new Map();
  #newest = new Map();

  /** Call back for each message of a type. */
  on(type, listener) {
    if (!this.#listeners.has(type)) this.#listeners.set(type, new Set());
    this.#listeners.get(type).add(listener);
  }

  /** Keep a message, and pass it on. */
  emit(type, message) {
    this.#newest.set(type, { message, at: performance.now() });
    for (const listener of this.#listeners.get(type) ?? []) listener(message);
  }

  /** Forget a message that is no longer true. */
  drop(type) {
    this.#newest.delete(type);
  }

  /** The newest message of a type; undefined before the first. */
  newest(type) {
    return this.#newest.get(type)?.message;
  }

  /** The newest sample of a kind; undefined before the first. */
  sample(type) {
    return this.newest(type)?.sample;
  }

  /** The newest message of a type while it is the present, else undefined. Every view asks this, and draws a figure or a dash. */
  fresh(type) {
    const isYoung = this.age(type) <= (FRESH_MS[type] ?? SAMPLED_MS);
    const isHeard = this.newest("link")?.open && this.newest("daemon")?.alive !== false && this.age("status") <= FRESH_MS.status;
    return isYoung && (isHeard || type === "delay") ? this.newest(type) : undefined;
  }

  /** Milliseconds since the newest message of a type arrived; Infinity before the first. */
  age(type) {
    const found = this.#newest.get(type);
    return found ? performance.now() - found.at : Infinity;
  }
}
