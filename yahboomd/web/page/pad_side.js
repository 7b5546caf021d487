// Under which thumb the joystick is; on a phone on its side the emergency stop is under the other.

import { el, WIDE, write } from "./dom.js";
import { keep, kept } from "./storage.js";

const KEY = "pad side";

/** The button that exchanges the two. */
export function padSide() {
  const button = el("button", { type: "button", class: "swap", onclick: () => put(isLeft() ? "right" : "left") });
  const isLeft = () => (document.body.dataset.pad ?? (WIDE.matches ? "left" : "right")) === "left";
  const show = () => write(button, `\u21c4 Joystick to the ${isLeft() ? "right" : "left"}`);
  const put = (side) => {
    document.body.dataset.pad = side;
    keep(KEY, side);
    show();
  };
  if (["left", "right"].includes(kept(KEY))) document.body.dataset.pad = kept(KEY);
  WIDE.addEventListener("change", show);
  show();
  return button;
}
