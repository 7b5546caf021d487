// All robots: what each of the list does, those that need somebody first, and a stop for all of them.

import { duration, el, write } from "./dom.js";

const AGAIN_MS = 2000;
const SOON_MS = 300; // While a stop is under way.
const GIVE_UP_MS = 4000;
const OLD_S = 5; // Robots are asked every two seconds.

export function create({ connection, onStop }) {
  const button = el("button", { type: "button", class: "danger", onclick: stop }, "Stop all robots");
  const answer = el("div", { role: "status" });
  const summary = el("p", { class: "note" });
  const list = el("ul");
  let wanted = false; // Pressed, and no answer of the server came yet.
  let shown = false;
  let clock = 0;

  async function ask(path, method) {
    try {
      const reply = await fetch(path, { method, signal: AbortSignal.timeout(GIVE_UP_MS) });
      if (reply.status === 401) connection.checkSession();
      return reply.ok ? await reply.json() : null;
    } catch {
      return null;
    }
  }

  async function stop() {
    for (const letGo of onStop) letGo();
    wanted = true;
    write(button, "Stopping all\u2026");
    while (wanted) {
      const found = await ask("/fleet/stop", "POST");
      if (found) {
        wanted = false;
        show(found);
      } else {
        answer.replaceChildren(el("p", { class: "error" }, "The server does not answer: nobody is stopped from here. It is asked again. Switch the motors' supply off."));
        await new Promise((done) => setTimeout(done, SOON_MS));
      }
    }
    look();
  }

  async function look() {
    clearTimeout(clock);
    const found = await ask("/fleet", "GET");
    if (found) show(found);
    else write(summary, "There is no connection to this page's server.");
    clearTimeout(clock);
    if (shown) clock = setTimeout(look, found?.stopping ? SOON_MS : AGAIN_MS);
  }

  function show(found) {
    write(summary, found.summary);
    if (!wanted) write(button, found.stopping ? "Stop all again" : "Stop all robots");
    const words = JSON.stringify(found.stop);
    if (words !== answer.dataset.shown) {
      answer.dataset.shown = words;
      answer.replaceChildren(...found.stop.map((line) => el("p", {}, line)));
    }
    list.replaceChildren(...found.robots.map(row));
  }

  function row(robot) {
    const since = robot.state_s === null || !robot.can_drive && robot.needs.match(/answer|reach|lost/) ? "" : ` ${duration(robot.state_s * 1000)}`;
    const state = robot.state === null ? "never seen" : `${robot.state}${since}`;
    const facts = [
      robot.driver, robot.volts === null ? "" : `${robot.volts.toFixed(1)} V`, robot.version,
      { true: "calibrated", false: "not calibrated" }[robot.calibrated],
      robot.seen_s === null || robot.seen_s < OLD_S ? "" : `seen ${duration(robot.seen_s * 1000)} ago`,
    ];
    const name = robot.page ? el("a", { href: robot.page }, robot.robot) : robot.robot;
    return el(
      "li",
      { class: "card", "data-needs": robot.needs || null },
      el("div", { class: "line" }, el("b", {}, name), el("span", { class: "chip", "data-state": robot.needs.startsWith("battery") ? "waiting" : (robot.state ?? "") }, robot.needs || state)),
      el("p", { class: "note" }, [robot.needs ? state : "", ...facts].filter(Boolean).join(" \u00b7 ")),
      el("p", {}, robot.needs ? robot.why : "", robot.claimed ? " (Nothing proves that name.)" : ""),
    );
  }

  const element = el("section", { class: "fleet" }, el("div", { class: "card" }, el("h2", {}, "All robots"), button, answer, summary), list);
  return {
    element,
    show: () => {
      shown = true;
      look();
    },
    hide: () => {
      shown = false;
      clearTimeout(clock);
    },
  };
}
