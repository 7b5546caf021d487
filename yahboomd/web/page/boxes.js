// Black boxes: the last minute before the robot stopped, in words and as files.

import { amount, el, fixed, stamp, WIDE, write } from "./dom.js";

const REASONS = {
  estop: "Emergency stop", runaway: "A wheel ran away", fault: "A fault", disconnected: "The board was lost",
  crash: "A fault of yahboomd itself", killed: "The daemon was killed", asked: "Saved on demand",
};
const KINDS = { running: "The last minute, in memory", left: "The daemon was killed" };
const KNOWN_MS = 2100; // The server shows a list again that is younger than two seconds.

export function create({ live, connection }) {
  const save = el("button", { type: "button", onclick: () => saveNow() }, "Save the last minute now");
  const words = el("p", { role: "status" });
  const state = el("p", { class: "note" }); // Apart: a list that is read again takes no answer away.
  const list = el("ul", { class: "files" });
  const story = el("div", { class: "story", tabindex: "0", hidden: true }); // Of the box that was opened last.
  let shown = "";
  let opened = "";
  let newest;
  let soon;

  async function saveNow() {
    save.disabled = true;
    write(words, "A moment\u2026");
    const answer = await connection.tool("save_box");
    save.disabled = false;
    await read();
    write(words, answer.text);
  }

  async function read() {
    save.hidden = live.newest("hello")?.role !== "driver";
    try {
      const answer = await fetch("/boxes");
      if (answer.status === 503) readSoon(); // Others ask, too.
      if (!answer.ok) return write(state, await answer.text());
      const { boxes, problem } = await answer.json();
      // A box in memory changes all the time: compare names and kinds only.
      const rows = JSON.stringify(boxes.map(({ name, kind }) => [name, kind]));
      if (rows !== shown) list.replaceChildren(...boxes.map(row));
      shown = rows;
      place();
      write(state, problem || (boxes.length ? "" : "There is none yet: nothing has stopped the robot for a reason."));
    } catch {
      // The next box asks again.
    }
  }

  function row({ name, kind, reason, at_s, bytes }) {
    const why = el("button", { type: "button", "data-box": name, onclick: () => explain(name) }, "Why did it stop?");
    const file = el("a", { href: `/boxes/${name}`, download: "" }, "Download", el("small", {}, ` ${amount(bytes)}`));
    return el(
      "li",
      { class: "card" },
      el("div", { class: "line" }, el("b", {}, REASONS[reason] ?? KINDS[kind] ?? reason), el("span", { class: "fact" }, kind === "running" ? "" : stamp(at_s))),
      el("div", { class: "links" }, why, ...(kind === "saved" ? [file] : [])),
    );
  }

  /** Beside the list where there is room, else below its box. */
  function place() {
    const buttons = [...list.querySelectorAll("[data-box]")];
    for (const each of buttons) each.setAttribute("aria-expanded", each.dataset.box === opened);
    const box = buttons.find((each) => each.dataset.box === opened)?.closest("li");
    story.hidden = !box;
    story.classList.toggle("card", WIDE.matches);
    const home = (!WIDE.matches && box) || element;
    if (story.parentNode !== home) home.append(story);
  }

  async function explain(name) {
    opened = opened === name ? "" : name;
    const words = el("p", {}, "A moment\u2026");
    story.replaceChildren(words);
    place();
    if (!opened) return;
    try {
      let answer;
      while ((answer = await fetch(`/boxes/${name}/words`)).status === 503) {
        write(words, await answer.text());
        await new Promise((done) => setTimeout(done, KNOWN_MS));
      }
      const found = answer.ok ? await answer.json() : { why: await answer.text(), lines: [] };
      const lines = found.lines.map((each) => el("tr", { class: each.what }, el("th", { scope: "row" }, `${fixed(each.before_s, 2)} s`), el("td", {}, each.words)));
      if (words.parentNode !== story) return; // Another box was opened.
      const table = el("table", {}, el("caption", {}, "Events, in seconds before it was saved"), el("tbody", {}, ...lines));
      story.replaceChildren(el("p", { class: "question" }, found.why), ...(lines.length ? [table] : []));
    } catch {
      write(words, "There is no connection to the robot.");
    }
  }

  function readSoon() {
    clearTimeout(soon);
    soon = setTimeout(() => element.hidden || read(), KNOWN_MS);
  }

  live.on("status", ({ sample }) => {
    // A second after the robot stopped, or a minute after the box before: its daemon says when.
    if (sample.command.blackbox_last !== newest) readSoon();
    newest = sample.command.blackbox_last;
  });
  live.on("hello", () => element.hidden || read());
  WIDE.addEventListener("change", place);
  const element = el(
    "section",
    { class: "boxes" },
    el("div", { class: "card" }, el("h2", {}, "Why did it stop?"), el("p", { class: "note" }, "The last minute of the robot is kept, and saved when something stops it: an emergency stop, a fault, a lost board."), save, words, state),
    list,
  );
  const show = () => {
    read();
    readSoon(); // One may have been saved just now.
  };
  return { element, show, hide: () => {} };
}
