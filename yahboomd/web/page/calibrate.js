// Calibration: the questions of the wizard, and a button by which the robot moves while it is held.

import { Choice } from "./calibrate_choice.js";
import { picture } from "./calibrate_pictures.js";
import { Deadman } from "./deadman.js";
import { el, write } from "./dom.js";
import { HoldButton } from "./hold_button.js";
import { obstacle } from "./obstacles.js";

const FREE = { question: null, progress: null, said: [], result: null, refused: "", page: null, verb: "" };

export function create(app) {
  const { live, connection } = app;
  let asked = ""; // The question that is shown.

  const state = () => live.newest("calibration") ?? FREE;
  const mine = () => state().page !== null && state().page === live.newest("hello")?.page;

  // The deadman of the joystick, with holds in place of velocities.
  const deadman = new Deadman(
    { drive: ({ held }) => (held ? connection.hold(asked) : connection.letGo()) },
    live,
    "hold",
    () => obstacle(connection, live),
    (why) => {
      hold.drop();
      if (why) navigator.vibrate?.(120);
      show();
    },
  );
  const hold = new HoldButton(
    () => {
      const counts = !deadman.held && deadman.hold({ held: true });
      show();
      return counts;
    },
    (why) => deadman.letGo(why),
  );
  app.onStop.add((why) => deadman.letGo(why));

  const why = el("p", { class: "error", role: "status" });
  const choice = new Choice(async (verb, choices) => {
    choice.start.disabled = true;
    const answer = await connection.tool("calibrate", { verb, choices });
    choice.start.disabled = false;
    write(why, answer.ok ? "" : answer.text);
  });
  const setup = el("div", { class: "card" }, el("p", {}, "New motors, wheels or plugs? Set the robot up first, on its own computer."));
  const undo = el("button", { type: "button", onclick: () => undoNow() }, "Take the newest calibration back");
  const undoWords = el("p", { role: "status" });
  const undoCard = el("div", { class: "card" }, el("p", {}, "Does it drive worse than before? Then the calibration before the newest one can count again, from the next start of yahboomd."), undo, undoWords);

  async function undoNow() {
    undo.disabled = true;
    write(undoWords, "A moment\u2026");
    write(undoWords, (await connection.tool("undo_calibration")).text);
    undo.disabled = false;
  }

  const text = el("p", { class: "question", "aria-live": "polite" });
  const drawn = el("div", { class: "drawn" });
  const wrong = el("p", { class: "error", role: "alert" });
  const answer = el("div", { class: "answer" });
  const bar = el("progress", { max: 1, value: 0, "aria-label": "How far the movement is" });
  const words = el("p", { class: "words", role: "status" });
  const end = el("button", { type: "button", onclick: () => connection.tool("end_calibration") }, "End the calibration");
  const running = el("div", { class: "card wizard" }, text, drawn, wrong, bar, answer, words, end);

  const said = el("ul", { class: "said" });
  const table = el("pre", { tabindex: "0", role: "region", "aria-label": "Result" });
  const refused = el("p", { class: "error" });
  const written = el("p");
  const outcome = el("div", { class: "card" }, el("h2", {}, "The last calibration"), refused, written, table, said);

  function ask(question) {
    asked = question?.id ?? "";
    write(text, question?.text ?? "A moment\u2026");
    write(wrong, question?.wrong ?? "");
    drawn.replaceChildren(question ? picture(question) : "");
    const send = (value) => connection.tool("answer", { question: question.id, text: value });
    const form = () => {
      const input = el("input", { type: "text", inputmode: question.name === "length" ? "decimal" : "text", autocomplete: "off", id: "answer", maxlength: "20", required: question.name === "length" });
      const turn = el("button", { type: "button", "aria-label": "Change the sign", onclick: () => (input.value = input.value.startsWith("-") ? input.value.slice(1) : `-${input.value}`) }, "\u00b1");
      const signed = question.name === "length" ? [] : [turn];
      const submit = (event) => {
        event.preventDefault();
        if (input.value.trim() || !input.required) send(input.value);
        else write(wrong, "Type what you measured, then continue.");
      };
      // The Enter that moved the robot may still be down.
      const held = (event) => event.key === "Enter" && event.repeat && event.preventDefault();
      return el("form", { novalidate: true, onsubmit: submit, onkeydown: held }, el("label", { for: "answer" }, { m: "metres", mm: "millimetres", deg: "degrees" }[question.unit] ?? ""), input, ...signed, el("button", { type: "submit", class: "primary" }, "Continue"));
    };
    const button = (label) => el("button", { type: "button", class: "primary", onclick: () => send("") }, label);
    const parts = { confirm: () => button("Done"), start: () => button("Begin"), hold: () => hold.element, number: form };
    answer.replaceChildren(...(question && mine() ? [parts[question.kind]?.() ?? button("Continue")] : []));
    // Not the button that moves the robot: Enter may still be down.
    if (question?.kind !== "hold") answer.querySelector("input, button")?.focus({ preventScroll: true });
  }

  function show() {
    if (element.hidden) return;
    const now = state();
    const runs = now.page !== null;
    choice.offer(live.newest("hello")?.calibrations ?? {});
    choice.element.hidden = setup.hidden = undoCard.hidden = runs || live.newest("hello")?.role !== "driver";
    watcher.hidden = live.newest("hello")?.role === "driver";
    running.hidden = !runs;
    end.hidden = !mine();
    // Shown from the beginning, so that nothing shifts under the thumb.
    bar.hidden = now.question?.kind !== "hold";
    words.hidden = bar.hidden && mine();
    bar.value = now.progress ? (now.progress.part - 1 + now.progress.done) / now.progress.parts : 0;
    write(words, running.hidden ? "" : status(now));
    outcome.hidden = runs || !(now.result || now.refused);
    write(refused, now.refused);
    write(table, now.result?.text ?? "");
    table.hidden = !now.result;
    write(written, now.result?.written ? "It is written. It counts from the next start of yahboomd." : "");
    const sentences = now.said.filter((each) => !each.startsWith("Written to"));
    said.replaceChildren(...sentences.map((each) => el("li", {}, each)));
  }

  function status(now) {
    if (!mine()) return "Another page leads this calibration.";
    if (now.question?.kind !== "hold") return "";
    if (deadman.held) return "Let go to stop.";
    const barred = obstacle(connection, live);
    const { lost } = deadman;
    return [lost, barred !== lost && barred].filter(Boolean).join(" ");
  }

  live.on("calibration", (now) => {
    if ((now.question?.id ?? "") !== asked || !now.question) {
      deadman.letGo();
      ask(now.question);
    }
    if (now.page !== null) write(why, "");
    show();
  });
  for (const type of ["hello", "control", "daemon", "status", "link"]) live.on(type, show);

  const watcher = el("p", { class: "card" }, "This phone may watch. A phone that may drive can calibrate.");
  const element = el("section", { class: "calibrate" }, watcher, running, outcome, choice.element, why, undoCard, setup);
  ask(state().question);
  let clock = 0;
  return {
    element,
    show: () => {
      clock = setInterval(show, 300);
      show();
    },
    hide: () => {
      clearInterval(clock);
      deadman.letGo("Another view was opened.");
    },
  };
}
