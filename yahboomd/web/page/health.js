// Health: battery, board, network, counters that grow, events in order.

import { charge } from "./battery.js";
import { Counters } from "./counters.js";
import { DASH, duration, el, fixed, write } from "./dom.js";
import { Events } from "./events.js";
import { delayOf } from "./obstacles.js";

const SEEN = { at_rest: "at rest", turning: "turning", unknown: "not seen" };

export const health = { id: "health", title: "Health", create };

function create({ live, connection }) {
  const counters = new Counters();
  const events = new Events(live);
  const facts = new Map();
  const list = el("dl", { class: "facts" });
  let rate = null; // Readings a second.
  let before = null;

  const fact = (name, value) => {
    if (!facts.has(name)) {
      const row = el("div", {}, el("dt", {}, name), el("dd", {}));
      facts.set(name, row);
      list.append(row);
    }
    write(facts.get(name).lastChild, value);
    facts.get(name).hidden = !value;
  };

  live.on("status", ({ sample }) => {
    const { readings } = sample.link;
    if (before && sample.stamp_ns > before.stamp_ns && readings >= before.readings)
      rate = ((readings - before.readings) * 1e9) / (sample.stamp_ns - before.stamp_ns);
    before = { stamp_ns: sample.stamp_ns, readings };
    counters.receive(sample);
    show();
  });
  for (const type of ["battery", "delay", "link", "daemon", "camera"]) live.on(type, show);

  function show() {
    if (element.hidden) return;
    const status = live.fresh("status")?.sample;
    const battery = live.fresh("battery")?.sample;
    const { battery: level, volts_at_rest: atRest } = status?.board ?? {};
    const rest = level ? `, ${level}: ${fixed(atRest, 1)} V at rest` : "";
    const { text } = charge(live);
    const percent = text.includes("%") ? `${text.split(" %")[0]} %, ` : "";
    fact("Battery", battery ? `${percent}${fixed(battery.volts, 2)} V${rest}` : DASH);
    const { board } = status ?? {};
    const since = (name) => (status?.[name] ? duration(Math.max(0, (status.stamp_ns - status[name]) / 1e6)) : DASH);
    fact("State", status ? `${status.why} For ${since("since_ns")}.` : DASH);
    fact("Wheels", status?.wheels ? `${SEEN[status.wheels] ?? status.wheels} for ${since("wheels_since_ns")}` : DASH);
    fact("Board", !status ? DASH : board.port ? [board.dialect, board.version && `firmware ${board.version}`].filter(Boolean).join(", ") : "not connected");
    fact("Port", board?.port ?? DASH);
    fact("Readings", status && rate !== null ? `${fixed(rate, 0)} a second` : DASH);
    fact("Last refused command", status?.command.last_refusal ?? "");
    const delay = delayOf(live);
    fact("Network", connection.isOpen ? (delay ? `${Math.round(delay)} ms there and back` : "connected") : "not connected");
    const hello = live.newest("hello");
    fact("Camera", hello?.camera ? eyes(live.newest("camera")) : "");
    fact("yahboomd", live.newest("daemon")?.alive === false ? live.newest("daemon").text : (hello?.version ?? ""));
    fact("This page", hello ? (hello.role === "driver" ? "may drive" : "may watch and stop") : "");
    counters.show();
    events.show();
  }

  const element = el(
    "section",
    { class: "health" },
    el("div", { class: "card" }, el("h2", {}, "Robot"), list),
    el("div", { class: "card" }, el("h2", {}, "Events"), events.element),
    el("div", { class: "card" }, el("h2", {}, "Counters"), counters.element),
  );
  let clock = 0;
  return {
    element,
    show: () => {
      counters.describe();
      clock = setInterval(show, 1000);
      show();
    },
    hide: () => clearInterval(clock),
  };
}

/** The camera's counts, as far as this page knows them. */
function eyes(message) {
  if (!message) return "not looked at yet";
  const counts = Object.entries(message.counts).map(([name, count]) => `${name.replaceAll("_", " ")} ${count}`);
  return [message.problem, counts.join(", ")].filter(Boolean).join(" ");
}
