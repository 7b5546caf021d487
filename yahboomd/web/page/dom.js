// Elements, numbers and times as people read them.

/**
 * An element: `el("p", { class: "why", id: "x" }, "text", child)`.
 * A property that starts with "on" is a listener.
 */
export function el(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** Set a text only if it differs: a screen reader reads each newly set text aloud. */
export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** A question before what cannot be undone, with what keeps it and what does it. */
export function doubt(words, keep, label, act) {
  const button = (text, onclick, look) => el("button", { type: "button", class: look, onclick }, text);
  return el("p", { class: "doubt" }, el("span", {}, words), button("Keep it", keep), button(label, act, "danger"));
}

/** A number with fixed decimals, and a true minus; never "-0.00". */
export function fixed(value, decimals) {
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? (0).toFixed(decimals) : text.replace("-", "\u2212");
}

/** A screen with room for the drive view beside another, as in style.css. */
export const WIDE = matchMedia("(min-width: 56em) and (min-height: 31em)");

/** In place of a figure that is not known now. */
export const DASH = "\u2013";

/** The time of day of a stamp in Unix nanoseconds. */
export function timeOf(stampNs) {
  return new Date(stampNs / 1e6).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit" });
}

/** A duration in the largest unit that keeps it short: "0.4 s", "12 s", "3 min". */
export function duration(ms) {
  if (ms < 10_000) return `${fixed(ms / 1000, 1)} s`;
  if (ms < 120_000) return `${Math.round(ms / 1000)} s`;
  return `${Math.round(ms / 60_000)} min`;
}

/** A number of bytes: "870 kB", "1.2 GB". */
export function amount(bytes) {
  const [unit, name] = [[1e9, "GB"], [1e6, "MB"], [1e3, "kB"]].find(([each]) => bytes >= each) ?? [1, "bytes"];
  return `${fixed(bytes / unit, unit > 1e3 && bytes < 100 * unit ? 1 : 0)} ${name}`;
}

/** Date and time of day of Unix seconds. */
export function stamp(seconds) {
  return new Date(seconds * 1000).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
}

/** Seconds as on a stopwatch: "4:05". */
export function clockTime(seconds) {
  return `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
}

/** Let a phone be felt, for some milliseconds, if the browser can do it. */
export function buzz(ms) {
  // Before the first touch a browser would only complain.
  if (navigator.userActivation?.hasBeenActive) navigator.vibrate?.(ms);
}
