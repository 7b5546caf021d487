// What a person sets for this browser: side of the joystick, full screen; and what the browser gives: screen, gamepad.

import { awakeWords } from "./awake.js";
import { el, write } from "./dom.js";
import { padSide } from "./pad_side.js";

const TLS = "This page came without TLS, and browsers give these only with it: the page on phones in yahboomd's manual tells how.";

/** The button that opens the panel, and the panel, which covers the joystick: nobody drives by thumb behind it. */
export function settings(gamepad, onOpen) {
  const screenText = el("dd");
  const padText = el("dd");
  const full = el("button", { type: "button", class: "full", onclick: toggleFull });
  const fullText = el("p", { class: "note", hidden: Boolean(document.fullscreenEnabled) }, "This browser shows no page in full screen. Added to the home screen, it is.");
  full.hidden = !document.fullscreenEnabled;
  const panel = el(
    "div",
    { class: "settings", hidden: true },
    padSide(),
    full,
    fullText,
    el("dl", {}, el("dt", {}, "Screen"), screenText, el("dt", {}, "Gamepad"), padText),
    el("p", { class: "note", hidden: isSecureContext }, TLS),
  );
  const opener = el("button", { type: "button", class: "gear", "aria-label": "Settings", title: "Settings", "aria-expanded": "false", onclick: toggle }, "\u2699\ufe0e");

  function toggle() {
    onOpen();
    panel.hidden = !panel.hidden;
    opener.setAttribute("aria-expanded", !panel.hidden);
    show();
  }

  function show() {
    if (panel.hidden) return;
    write(full, document.fullscreenElement ? "Leave full screen" : "Full screen");
    write(screenText, awakeWords());
    write(padText, gamepad.words());
  }

  document.addEventListener("fullscreenchange", show);
  return { opener, panel, show };
}

function toggleFull() {
  if (document.fullscreenElement) document.exitFullscreen();
  else document.documentElement.requestFullscreen({ navigationUI: "hide" }).catch(() => {}); // The browser says why.
}
