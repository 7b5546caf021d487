// The views, in the order of the navigation. Each is `{ id, title, create(app) }`; `create` returns
// `{ element, show(), hide() }`. Instead of `create`, `load` may return a promise of it: its module is then loaded when the
// view is first opened, as in `load: () => import("./record.js").then((module) => module.create)`.

import { el, WIDE } from "./dom.js";
import { drive } from "./drive.js";
import { health } from "./health.js";
import { map } from "./map.js";
import { wheels } from "./wheels.js";

const camera = { id: "camera", title: "Camera", load: () => import("./camera.js").then((module) => module.create) };
const fleet = { id: "fleet", title: "All robots", load: () => import("./fleet.js").then((module) => module.create) };
const more = { id: "menu", title: "More", create: () => ({ element: el("section", { class: "menu" }), show() {}, hide() {} }) };
const VIEWS = [
  drive, camera, map, wheels, health,
  { id: "calibrate", title: "Calibrate", load: () => import("./calibrate.js").then((module) => module.create) },
  { id: "record", title: "Record", load: () => import("./record.js").then((module) => module.create) },
  { id: "boxes", title: "Black boxes", load: () => import("./boxes.js").then((module) => module.create) },
  { id: "phones", title: "Phones", load: () => import("./phones.js").then((module) => module.create) },
  fleet, more,
];
const BAR = 4; // So many stand beside More at the bottom of a phone.
// As in style.css. On a wide screen the drive view stays beside all others, on a phone on its side beside those that show the robot.
const ASIDE = matchMedia("(max-height: 30.99em) and (min-aspect-ratio: 4/3)");
const ROOM = matchMedia("(min-width: 75em) and (min-height: 31em)"); // The map or the camera stands beside a tool, too.
const TABLET = matchMedia("(min-width: 35em) and (min-height: 31em)");
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
    for (const each of [WIDE, ASIDE, ROOM, TABLET]) each.addEventListener("change", () => this.#open());
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
    this.#open();
  }

  async #open() {
    const there = VIEWS.filter((view) => (view !== camera || this.#hasCamera) && (view !== fleet || this.#hasFleet));
    const rest = there.slice(BAR, -1);
    const asked = there.find(({ id }) => `#${id}` === location.hash) ?? drive;
    const eyes = this.#hasCamera ? camera : map;
    const opened = ((WIDE.matches || ASIDE.matches) && asked === drive) || (WIDE.matches && asked === more) ? eyes : asked;
    const besides = WIDE.matches || (ASIDE.matches && BESIDE.includes(opened)) ? [drive] : [];
    const looks = TABLET.matches && (opened === drive || (!BESIDE.includes(opened) && (ROOM.matches || !WIDE.matches)));
    const wanted = [...besides, opened, ...(looks ? [eyes] : [])];
    for (const [index, link] of this.links.entries()) {
      const view = VIEWS[index];
      link.hidden = !there.includes(view);
      link.classList.toggle("rest", rest.includes(view));
      if (view === opened || (view === more && rest.includes(opened))) link.setAttribute("aria-current", "page");
      else link.removeAttribute("aria-current");
    }
    this.#made.get(more.id).element.replaceChildren(...rest.map(({ id, title }) => el("a", { href: `#${id}`, class: "card" }, title)));
    for (const view of wanted) if (!this.#made.has(view.id)) this.#add(view, await view.load());
    if (this.#isClosed) return;
    for (const [id, made] of this.#made) {
      const show = wanted.some((view) => view.id === id);
      made.element.hidden = !show;
      made.element.classList.toggle("eyes", looks && id === eyes.id);
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
