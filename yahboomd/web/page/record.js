// Recordings: one runs at a time; stored ones are listed, downloaded and removed.

import { amount, clockTime, doubt, el, stamp, write } from "./dom.js";

const AGAIN_MS = 3000;

export function create({ live, connection }) {
  let listed = null; // The server's latest answer.
  let problem = "";
  let doubted = ""; // The recording to remove, until it is confirmed.

  const driver = () => live.newest("hello")?.role === "driver";
  const now = () => live.newest("recording");

  const toggle = el("button", { type: "button", class: "primary", hidden: true, onclick: () => press() });
  const words = el("p", { role: "status" });
  const room = el("p", { class: "note" });
  const list = el("ul", { class: "files" });

  async function press() {
    toggle.disabled = true;
    const answer = await connection.tool(now()?.name ? "end_recording" : "record");
    toggle.disabled = false;
    problem = answer.ok ? "" : answer.text;
    show();
    read();
  }

  async function remove(name) {
    doubted = "";
    const answer = await connection.tool("delete_recording", { name });
    problem = answer.ok ? "" : answer.text;
    await read();
  }

  async function read() {
    try {
      const answer = await fetch("/recordings");
      if (answer.ok) listed = await answer.json();
    } catch {
      // The next one comes soon.
    }
    show();
  }

  function show() {
    if (element.hidden) return;
    const running = now()?.name ?? null;
    write(toggle, running ? "End the recording" : "Begin to record");
    toggle.hidden = !driver();
    write(words, problem || (running ? `Recording ${running}: ${elapsed()}, ${amount(now().bytes)}.` : now()?.ended ?? ""));
    if (!listed) return;
    const free = listed.free_bytes === null ? "" : `${amount(listed.free_bytes)} of the disk are free.`;
    write(room, `${listed.recordings.length} ${listed.recordings.length === 1 ? "recording" : "recordings"}, ${amount(listed.bytes)} of at most ${amount(listed.most_bytes)}. ${free}`);
    const rows = JSON.stringify([listed.recordings, doubted, driver()]);
    if (rows !== list.dataset.shown) {
      list.dataset.shown = rows;
      list.replaceChildren(...listed.recordings.map(row));
    }
  }

  /** Ask before a recording is removed; "" asks nothing. */
  function ask(name) {
    doubted = name;
    show();
    list.querySelector(".doubt button")?.focus();
  }

  function elapsed() {
    return clockTime((now().for_s ?? 0) + live.age("recording") / 1000);
  }

  function row({ name, running, at_s, bytes, files }) {
    const links = files.map((file) =>
      el("a", { href: `/recordings/${name}/${file.name}`, download: `${name}-${file.name}` }, file.name, el("small", {}, ` ${amount(file.bytes)}`)),
    );
    const mayRemove = driver() && !running;
    return el(
      "li",
      { class: "card" },
      el("div", { class: "line" }, el("b", {}, name), el("span", { class: "fact" }, running ? "recording" : `${stamp(at_s)}, ${amount(bytes)}`)),
      el("div", { class: "links" }, ...links),
      ...(mayRemove ? [doubted === name ? doubt(`Remove ${name} for good?`, () => ask(""), "Remove", () => remove(name)) : el("button", { type: "button", "aria-label": `Remove ${name}`, onclick: () => ask(name) }, "Remove\u2026")] : []),
    );
  }

  const element = el(
    "section",
    { class: "record" },
    el("div", { class: "card" }, el("h2", {}, "Record"), el("p", { class: "note" }, "What the robot does and is commanded, as files for Foxglove, Lichtblick and ROS 2. A recording ends a minute after the last page to drive was closed."), toggle, words, room),
    list,
  );
  live.on("recording", (message) => {
    if (!message.name) read();
    show();
  });
  live.on("hello", show);
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
