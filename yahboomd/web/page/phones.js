// Phones: which may use this page, and the name of this one. Each session ends singly.

import { doubt, duration, el, write } from "./dom.js";

const AGAIN_MS = 3000;

export function create({ live, connection }) {
  let listed = null; // The server's latest answer.
  let problem = "";
  let doubted = ""; // The session to end, until it is confirmed.
  let typed = false; // The name was changed here and is not saved.

  const name = el("input", { id: "phone-name", maxlength: "32", autocomplete: "off", oninput: () => (typed = true) });
  const form = el(
    "form",
    { class: "fields", hidden: true, onsubmit: save },
    el("label", { for: "phone-name" }, "Name of this phone", name),
    el("button", { type: "submit", class: "primary" }, "Save"),
  );
  const words = el("p", { role: "status" });
  const note = el("p", { class: "note" });
  const list = el("ul", { class: "files" });
  const refused = el("p", { class: "note" });

  async function post(path, body = {}) {
    try {
      const headers = { "Content-Type": "application/json" };
      const answer = await fetch(path, { method: "POST", headers, body: JSON.stringify(body) });
      if (answer.status === 401) connection.checkSession();
      return (await answer.json()).text;
    } catch {
      return "There is no connection to the robot.";
    }
  }

  async function save(event) {
    event.preventDefault();
    problem = await post("/session/name", { name: name.value });
    if (!problem) {
      typed = false;
      name.blur();
    }
    read();
  }

  async function end(id) {
    doubted = "";
    problem = await post(`/sessions/${id}/end`);
    read();
  }

  async function read() {
    try {
      const answer = await fetch("/sessions");
      if (answer.ok) {
        listed = await answer.json();
        // Not by their use: a row must not move away under a finger.
        listed.sessions.sort((a, b) => b.mine - a.mine || a.name.localeCompare(b.name));
      } else if (answer.status === 401) connection.checkSession();
    } catch {
      // The next one comes soon.
    }
    show();
  }

  function show() {
    if (element.hidden || !listed) return;
    const { sessions } = listed;
    const mine = sessions.find((each) => each.mine);
    form.hidden = !mine;
    if (mine && !typed && document.activeElement !== name) name.value = mine.name;
    write(words, problem);
    write(note, sessions.length ? `A session ends ${listed.days} days after its last use.` : "This page is served to this machine alone: everybody here may drive, and no phone has a session.");
    write(refused, listed.refused.length ? `Refused since the server began: ${listed.refused.map(([what, count]) => `${what}: ${count}`).join(", ")}.` : "");
    const rows = JSON.stringify([sessions.map((each) => [each, used(each)]), doubted]);
    if (rows !== list.dataset.shown) {
      list.dataset.shown = rows;
      list.replaceChildren(...sessions.map(row));
    }
  }

  /** Ask before a session is ended; "" asks nothing. */
  function ask(id) {
    doubted = id;
    show();
    list.querySelector(".doubt button")?.focus();
  }

  const used = ({ open, idle_s: idle }) => (open ? "open now" : `used ${idle < 172_800 ? duration(idle * 1000) : `${Math.round(idle / 86_400)} days`} ago`);

  function row(each) {
    const may = each.role === "driver" ? "may drive" : "may watch and stop";
    const facts = [each.mine ? "this phone" : "", may, each.control ? "has control" : "", used(each)];
    const button = el("button", { type: "button", "aria-label": `End the session of ${each.name}`, onclick: () => ask(each.id) }, "End\u2026");
    return el(
      "li",
      { class: "card" },
      el("div", { class: "line" }, el("p", {}, el("b", {}, each.name), el("br"), facts.filter(Boolean).join(", ")), ...(doubted === each.id ? [] : [button])),
      ...(doubted === each.id ? [doubt(`${each.mine ? "This phone" : "It"} then needs a new link.`, () => ask(""), "End the session", () => end(each.id))] : []),
    );
  }

  const element = el("section", { class: "phones" }, el("div", { class: "card" }, el("h2", {}, "Phones"), form, words, note, refused), list);
  live.on("control", () => element.hidden || read());
  let clock = 0;
  return {
    element,
    show: () => {
      clock = setInterval(read, AGAIN_MS);
      read();
    },
    hide: () => clearInterval(clock),
  };
}
