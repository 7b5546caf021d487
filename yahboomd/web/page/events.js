// Events in order, the newest first; lost ones are counted at their place.

import { el, timeOf } from "./dom.js";

const KEPT = 200;
const MARKS = { error: "Error", warning: "Warning", info: "Info" };

export class Events {
  #list = el("ol", { class: "events", tabindex: "0", "aria-label": "Events, the newest first" });
  #seen = new Set();

  constructor(live) {
    this.none = el("p", {}, "No event came yet.");
    this.element = el("div", {}, this.none, this.#list);
    // Events from before this page connected, oldest first; sent again after each reconnection.
    live.on("events", ({ samples }) => samples.forEach((sample) => this.#add(sample)));
    live.on("event", ({ sample }) => this.#add(sample));
    live.on("lost", ({ count }) => this.#lost(count));
  }

  show() {
    this.none.hidden = this.#list.childElementCount > 0;
    this.#list.hidden = !this.none.hidden;
  }

  #add(sample) {
    const key = `${sample.stamp_ns} ${sample.kind} ${sample.message}`;
    if (this.#seen.has(key)) return;
    this.#seen.add(key);
    const { severity, kind, message, stamp_ns } = sample;
    this.#put(
      el(
        "li",
        { class: severity },
        el("div", {}, el("time", {}, timeOf(stamp_ns)), el("b", {}, MARKS[severity] ?? severity), el("code", {}, kind)),
        el("p", {}, message),
      ),
      key,
    );
  }

  #lost(count) {
    const words = `Here ${count} message${count > 1 ? "s are" : " is"} missing: this page was too slow for them.`;
    this.#put(el("li", { class: "warning" }, el("p", {}, words)));
  }

  #put(item, key = "") {
    item.dataset.key = key;
    this.#list.prepend(item);
    while (this.#list.childElementCount > KEPT) {
      this.#seen.delete(this.#list.lastChild.dataset.key);
      this.#list.lastChild.remove();
    }
    this.show();
  }
}
