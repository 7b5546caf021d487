// The views, in the order of the navigation. Each is `{ id, title, create(app) }`; `create` returns
// `{ element, show(), hide() }`. Instead of `create`, `load` may return a promise of it: its module is then loaded when the
// view is first opened, as in `load: () => import("./record.js").then((module) => module.create)`.

import { el } from "./dom.js";
import { drive } from "./drive.js";
import { health } from "./health.js";
import { map } from "./map.js";
import { wheels } from "./wheels.js";

const camera = { id: "camera", title: "Camera", load: () => import("./camera.js").then((module) => module.create) };
const fleet = { id: "fleet", title: "All robots", load: () => import("./fleet.js").then((module) => module.create) };
const VIEWS = [
  drive, camera, map, wheels, health,
  { id: "calibrate", title: "Calibrate", load: () => import("./calibrate.js").then((module) => module.create) },
  { id: "record", title: "Record", load: () => import("./record.js").then((module) => module.create) },
  { id: "boxes", title: "Black boxes", load: () => import("./boxes.js").then((module) => module.create) },
  { id: "phones", title: "Phones", load: () => import("./phones.js").then((module) => module.create) },
  fleet,
];
// As in style.css. On a wide screen the drive view stays beside all others, on a phone on its side beside those that show the robot.
const WIDE = matchMedia("(min-width: 1000px) and (min-height: 501px)");
const ASIDE = matchMedia("(max-height: 500px) and (min-width: 560px)");
const BESIDE = [drive, camera, map, wheels, health];
const SEEN_WHOLE = [drive, camera, map]; // The others scroll, by keys too, where they hold nothing else to focus.

export class Views {
  #made = new Map();
  #shown = new Set();
  #hasCamera = false;
  #hasFleet = false;
  #isClosed = false;

  constructor(app) {
    this.app = app;
    this.main = document.getElementById("main");
    // At once: they follow the robot from the beginning, seen or not.
    for (const view of VIEWS) if (view.create) this.#add(view, view.create);
    this.links = VIEWS.map(({ id, title }) => el("a", { href: `#${id}`, "data-view": id }, title));
    document.getElementById("views").append(...this.links);
    addEventListener("hashchange", () => this.#open());
    app.live.on("hello", (hello) => this.#findCamera(Boolean(hello.camera)));
    app.live.on("hello", (hello) => this.#findFleet(Boolean(hello.fleet)));
    for (const each of [WIDE, ASIDE]) each.addEventListener("change", () => this.#open());
    // Also after the text was enlarged, which is no resize of the window.
    const row = document.getElementById("views");
    const sizes = new ResizeObserver(() => row.querySelector("[aria-current]")?.scrollIntoView({ block: "nearest", inline: "center" }));
    for (const each of [row, ...this.links]) sizes.observe(each);
    this.#open();
  }

  /** A robot without a camera has no view of it. Its picture is behind the joystick from the beginning. */
  async #findCamera(has) {
    if (has === this.#hasCamera) return;
    this.#hasCamera = has;
    document.body.toggleAttribute("data-camera", has);
    if (has && !this.#made.has(camera.id)) this.#add(camera, await camera.load());
    this.#open();
  }

  /** A page without a list of robots has no view of them. */
  #findFleet(has) {
    if (has === this.#hasFleet) return;
    this.#hasFleet = has;
    document.body.toggleAttribute("data-fleet", has);
    this.#open();
  }

  async #open() {
    const there = VIEWS.filter((view) => (view !== camera || this.#hasCamera) && (view !== fleet || this.#hasFleet));
    const asked = there.find(({ id }) => `#${id}` === location.hash) ?? drive;
    const eyes = this.#hasCamera ? camera : map;
    const opened = (WIDE.matches || ASIDE.matches) && asked === drive ? eyes : asked;
    const besides = WIDE.matches || (ASIDE.matches && BESIDE.includes(opened));
    const wanted = besides ? [drive, opened] : [opened];
    for (const link of this.links) {
      const current = link.dataset.view === opened.id;
      if (current) link.setAttribute("aria-current", "page");
      else link.removeAttribute("aria-current");
      if (current) link.scrollIntoView({ block: "nearest", inline: "center" });
    }
    for (const view of wanted) if (!this.#made.has(view.id)) this.#add(view, await view.load());
    if (this.#isClosed) return;
    for (const [id, made] of this.#made) {
      const show = wanted.some((view) => view.id === id);
      made.element.hidden = !show;
      if (show === this.#shown.has(id)) continue;
      if (show) {
        this.#shown.add(id);
        made.show();
      } else {
        this.#shown.delete(id);
        made.hide();
      }
    }
  }

  /** Hide all: this page has no session. */
  close() {
    this.#isClosed = true;
    for (const id of this.#shown) this.#made.get(id).hide();
    this.#shown.clear();
  }

  #add(view, create) {
    if (this.#isClosed || this.#made.has(view.id)) return; // Opened twice while it was loaded.
    const made = create(this.app);
    made.element.id = view.id;
    made.element.setAttribute("aria-label", view.title);
    if (!SEEN_WHOLE.includes(view)) made.element.tabIndex = 0;
    made.element.hidden = true;
    this.main.append(made.element);
    this.#made.set(view.id, made);
  }
}
