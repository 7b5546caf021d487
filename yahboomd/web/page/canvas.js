// A canvas that has the sharpness of the screen and the colours of style.css, drawn once a frame at most.

import { el } from "./dom.js";

const dark = matchMedia("(prefers-color-scheme: dark)");

export class Canvas {
  #frame = 0;
  #colors = new Map();

  /** @param draw Called with the context, the width and the height in CSS pixels. */
  constructor(draw, properties) {
    this.draw = draw;
    this.element = el("canvas", properties);
    this.context = this.element.getContext("2d");
    this.width = 0;
    this.height = 0;
    new ResizeObserver(() => this.#resize()).observe(this.element);
    dark.addEventListener("change", () => {
      this.#colors.clear();
      this.redraw();
    });
  }

  /** A colour of style.css, such as "accent". */
  color(name) {
    if (!this.#colors.has(name)) {
      this.#colors.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
    }
    return this.#colors.get(name);
  }

  /** Draw with the next frame. */
  redraw() {
    this.#frame ||= requestAnimationFrame(() => {
      this.#frame = 0;
      if (!this.width || this.element.closest("[hidden]")) return;
      const ratio = this.element.width / this.width;
      this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
      this.context.clearRect(0, 0, this.width, this.height);
      this.draw(this.context, this.width, this.height);
    });
  }

  #resize() {
    const box = this.element.getBoundingClientRect();
    const ratio = Math.min(devicePixelRatio || 1, 3);
    this.width = box.width;
    this.height = box.height;
    this.element.width = Math.round(box.width * ratio);
    this.element.height = Math.round(box.height * ratio);
    this.redraw();
  }
}

/** The step of a scale: 1, 2 or 5 times a power of ten, at least `least`. */
export function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= least * 0.999);
}
