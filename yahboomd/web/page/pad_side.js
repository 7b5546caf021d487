// Under which thumb the pad is while a phone lies on its side; the emergency stop is under the other.

import { el } from "./dom.js";
import { keep, kept } from "./storage.js";

const KEY = "pad side";

/** The button that exchanges the two. */
export function padSide() {
  const button = el("button", { type: "button", class: "swap", onclick: () => put(isLeft() ? "right" : "left") }, "\u21c4");
  const isLeft = () => document.body.dataset.pad === "left";
  const put = (side) => {
    document.body.dataset.pad = side;
    keep(KEY, side);
    const words = `Joystick to the ${isLeft() ? "right" : "left"}`;
    button.setAttribute("aria-label", words);
    button.title = words;
  };
  put(kept(KEY) === "left" ? "left" : "right");
  return button;
}
