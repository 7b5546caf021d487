// The newest message of each type, when it arrived, and those that listen.

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

  /** Milliseconds since the newest message of a type arrived; Infinity before the first. */
  age(type) {
    const found = this.#newest.get(type);
    return found ? performance.now() - found.at : Infinity;
  }
}
