// The counters of the status that grew: the total, the growth in the last minute, and the meaning of each.

import { el, write } from "./dom.js";

const MINUTE_NS = 60e9;
const ORDINARY = new Set(
  `attempts readings imu_readings bytes frames lines blank_bytes velocities_sent velocities_replaced stops_sent polls_sent
  requests_sent received accepted took_over limited desaturated events odometry_readings odometry_estimates
  odometry_repeated blackbox_saved stops_said published puts requests stamps_held_back`.split(/\s+/),
); // They grow on a healthy robot.

export class Counters {
  #history = []; // Statuses of the last minute, as maps of "group.name" to number.
  #rows = new Map();
  #meanings = {};
  #isAsked = false;

  constructor() {
    this.grew = el("tbody");
    this.ordinary = el("tbody");
    this.none = el("p", {}, "No counter of trouble has counted anything since the daemon started.");
    const table = (body, caption) =>
      el(
        "table",
        {},
        el("caption", {}, caption),
        el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Counter"), el("th", { scope: "col" }, "Total"), el("th", { scope: "col" }, "Last minute"))),
        body,
      );
    this.trouble = table(this.grew, "Trouble");
    this.element = el(
      "div",
      {},
      this.none,
      this.trouble,
      el("details", {}, el("summary", {}, "Ordinary work"), table(this.ordinary, "These grow on a healthy robot")),
    );
  }

  /** Ask the server once what the counters mean. */
  async describe() {
    if (this.#isAsked) return;
    this.#isAsked = true;
    try {
      const answer = await fetch("/counters");
      if (answer.ok) this.#meanings = await answer.json();
    } catch {
      this.#isAsked = false;
    }
    for (const [name, row] of this.#rows) write(row.meaning, this.#meaning(name));
  }

  receive(status) {
    const values = new Map();
    for (const group of ["link", "command", "bus"])
      for (const [name, value] of Object.entries(status[group] ?? {}))
        if (Number.isInteger(value) && this.#counts(group, name)) values.set(`${group}.${name}`, value);
    // After a restart of the daemon its counters begin at 0.
    const last = this.#history.at(-1)?.values;
    if (last && [...values].some(([name, value]) => value < (last.get(name) ?? 0))) this.#history = [];
    this.#history.push({ stamp: status.stamp_ns, values });
    while (status.stamp_ns - this.#history[0].stamp > MINUTE_NS) this.#history.shift();
  }

  show() {
    const newest = this.#history.at(-1)?.values ?? new Map();
    const oldest = this.#history[0]?.values ?? newest;
    for (const [name, value] of newest) {
      if (!value && !this.#rows.has(name)) continue;
      const row = this.#row(name);
      const grown = value - (oldest.get(name) ?? 0);
      write(row.total, value.toLocaleString());
      write(row.minute, grown ? `+${grown.toLocaleString()}` : "");
      row.element.classList.toggle("grows", grown > 0);
    }
    this.trouble.hidden = !this.grew.childElementCount;
    this.none.hidden = !this.trouble.hidden;
  }

  #counts(group, name) {
    const kind = this.#meanings[group]?.[name]?.kind;
    return kind ? kind === "counter" : !/^(board_tick_ns|neighbours|estop_not_on_file|blackbox_recording|blackbox_saving)$/.test(name);
  }

  #meaning(name) {
    const [group, field] = name.split(".");
    return this.#meanings[group]?.[field]?.meaning ?? "";
  }

  #row(name) {
    if (!this.#rows.has(name)) {
      const [group, field] = name.split(".");
      const meaning = el("small", {}, this.#meaning(name));
      const [total, minute] = [el("td"), el("td")];
      const element = el("tr", {}, el("th", { scope: "row" }, `${field.replaceAll("_", " ")} `, el("span", { class: "group" }, group), meaning), total, minute);
      (ORDINARY.has(field) ? this.ordinary : this.grew).append(element);
      this.#rows.set(name, { element, meaning, total, minute });
    }
    return this.#rows.get(name);
  }
}
