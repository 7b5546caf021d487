// A gamepad drives while one of its shoulder buttons is held. It is read 50 times a second, and before each velocity is sent.

import { shares } from "./joystick.js";

const PERIOD_MS = 20;
const DEAD = 0.1; // Sticks do not return to their middle.
const HOLDS = [4, 5]; // LB, RB of the standard layout: https://www.w3.org/TR/gamepad/#remapping
const PRESSES = { 1: "stop", 9: "release", 12: "faster", 13: "slower" }; // B, Start, up, down.

export class Gamepad {
  #down = new Map(); // The buttons of each pad when it was last read: one that is down already counts only when pressed again.
  #driving = null; // The number of the pad whose button counts, and that button.
  #timer = 0;

  /**
   * @param onHold Called with right, up and left as shares of the speed while it is held; returns whether it counts.
   * @param onLoss Called with why it is lost; "" when the button was let go.
   * @param onPress Called with "stop", "release", "faster" or "slower".
   */
  constructor(onHold, onLoss, onPress) {
    this.onHold = onHold;
    this.onLoss = onLoss;
    this.onPress = onPress;
    addEventListener("gamepadconnected", () => this.#start());
    addEventListener("gamepaddisconnected", () => this.read());
    if (pads().length) this.#start();
  }

  get held() {
    return this.#driving !== null;
  }

  /** The button does not count any more until it is let go and pressed again. */
  drop() {
    this.#driving = null;
  }

  /** The pad that drives, as it is now; null, and lost at once, if its button was let go, it has gone or is unseen. */
  check() {
    const pad = seen().find(({ index }) => index === this.#driving.index);
    if (pad?.buttons[this.#driving.button]?.pressed) return pad;
    this.#lose(pad ? "" : document.hasFocus() ? "The gamepad is gone." : "The page lost the focus.");
    return null;
  }

  /** Look at all pads. */
  read() {
    const driving = this.held && this.check();
    if (driving && !this.onHold(...sticks(driving))) this.drop();
    const before = this.#down;
    this.#down = new Map(seen().map((pad) => [pad.index, pad.buttons.map((button) => button.pressed)]));
    for (const pad of seen()) this.#press(pad, before.get(pad.index));
  }

  /** What there is, in words. */
  words() {
    if (!navigator.getGamepads) return isSecureContext ? "This browser has none." : "Needs TLS, see below.";
    const [pad] = pads();
    if (!pad) return "None yet. Press a button of it.";
    const name = pad.id.replace(/ *\(.*/, "") || "A gamepad";
    return isKnown(pad) ? `${name}: hold LB or RB, and drive by the left stick.` : `${name} cannot drive: this browser does not know its buttons.`;
  }

  #start() {
    this.#timer ||= setInterval(() => this.read(), PERIOD_MS);
  }

  #press(pad, before) {
    if (!before) return;
    const pressed = (button) => pad.buttons[button]?.pressed && !before[button];
    for (const [button, what] of Object.entries(PRESSES)) if (pressed(button)) this.onPress(what);
    const button = HOLDS.find(pressed);
    if (button === undefined || this.held) return;
    this.#driving = { index: pad.index, button };
    if (!this.onHold(...sticks(pad))) this.drop();
  }

  #lose(why) {
    this.drop();
    this.onLoss(why);
  }
}

function pads() {
  try {
    return [...(navigator.getGamepads?.() ?? [])].filter((pad) => pad?.connected);
  } catch {
    return []; // Refused by the policy of a page around this one.
  }
}

/** Those that may drive: none while another window has the focus. */
function seen() {
  return document.hidden || !document.hasFocus() ? [] : pads().filter(isKnown);
}

function isKnown(pad) {
  return pad.mapping === "standard";
}

/** Right and up of the left stick, and left of the right one. */
function sticks({ axes }) {
  const [right, up] = shares(axes[0], -axes[1], DEAD);
  return [right, up, -shares(axes[2] ?? 0, 0, DEAD)[0]];
}
