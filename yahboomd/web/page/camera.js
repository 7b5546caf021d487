// The robot's camera. The page asks for one picture after the other, on a connection of its own, and knows how old each is at
// most: the time since it arrived at the server, and the time from question to answer in which the server did not wait.

import { duration, el, fixed, write } from "./dom.js";
import { delayOf } from "./obstacles.js";

const OLD_MS = 500; // A picture that is older is marked, and never looks live.
const TICK_MS = 100;
const SILENT_MS = 3000; // The server answers each question within a second.
const RETRY_MS = 1000;
const COUNTS_MS = 5000;
const SLOW_MS = 150; // With such a delay of the network commands go first: the next question waits.
const HEAD_BYTES = 8;
const POLICY = 1008;

export function create({ live }) {
  const camera = new Camera(live);
  const element = el("section", { class: "cameraview" });
  // Behind the joystick, unless this view is open.
  const behind = document.querySelector(".drive .room");
  behind.prepend(camera.element);
  return {
    element,
    show: () => element.prepend(camera.element),
    hide: () => behind.prepend(camera.element),
  };
}

class Camera {
  #socket = null;
  #askedAt = 0; // 0 if no question is open.
  #countedAt = -Infinity;
  #retry = 0;
  #pause = 0;
  #clock = 0;
  #isSeen = false;
  #waiting = null; // The newest picture that is not decoded yet.
  #isDecoding = false;
  #age = Infinity; // Of the picture that is shown, at #shownAt.
  #shownAt = 0;
  #problem = "";

  constructor(live) {
    this.live = live;
    this.canvas = el("canvas", { role: "img", "aria-label": "Picture of the robot's camera" });
    this.context = this.canvas.getContext("2d");
    this.veil = el("div", { class: "veil", "aria-hidden": "true" });
    this.ageText = el("p", { class: "camera-age" });
    this.words = el("p", { class: "camera-words", role: "status" });
    this.element = el("div", { class: "camera" }, this.canvas, this.veil, this.ageText, this.words);
    // The mark comes by itself, also while this page's script stands still: each picture sets it back.
    this.mark = this.veil.animate([{ opacity: 0 }, { opacity: 1 }], { delay: OLD_MS, duration: 1, fill: "both" });
    this.#isOld();
    new IntersectionObserver(([...all]) => {
      this.#isSeen = all.at(-1).isIntersecting;
      this.#check();
    }).observe(this.element);
    document.addEventListener("visibilitychange", () => this.#check());
    addEventListener("pagehide", () => this.#close());
    addEventListener("pageshow", () => this.#check());
    document.addEventListener("freeze", () => this.#close());
    document.addEventListener("resume", () => this.#check());
    this.#show();
  }

  /** Milliseconds since the shown picture arrived at the server, at most; Infinity without one. */
  get age() {
    return this.#age + performance.now() - this.#shownAt;
  }

  /** Look while the picture is seen, and only then. */
  #check() {
    const looks = this.#isSeen && !document.hidden;
    if (looks && !this.#clock) {
      this.#clock = setInterval(() => this.#tick(), TICK_MS);
      this.#open();
    } else if (!looks) this.#close();
  }

  #open() {
    clearTimeout(this.#retry);
    const socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/camera`);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    this.#askedAt = performance.now(); // Also bounds the time to connect.
    socket.onopen = () => socket === this.#socket && this.#ask();
    socket.onmessage = ({ data }) => socket === this.#socket && this.#receive(data);
    socket.onclose = ({ code, reason }) => socket === this.#socket && this.#lost(code, reason);
  }

  #ask() {
    if (this.#socket?.readyState !== WebSocket.OPEN) return;
    const now = performance.now();
    const wantsCounts = now - this.#countedAt > COUNTS_MS;
    if (wantsCounts) this.#countedAt = now;
    this.#askedAt = now;
    this.#socket.send(wantsCounts ? "counts" : "");
  }

  #receive(data) {
    const now = performance.now();
    const took = now - this.#askedAt;
    this.#askedAt = 0;
    if (typeof data === "string") {
      const message = JSON.parse(data);
      this.#problem = message.problem;
      this.live.emit("camera", message);
    } else {
      const head = new DataView(data, 0, HEAD_BYTES);
      const onTheWay = Math.max(0, took - head.getUint32(4));
      this.#waiting = { bytes: new Uint8Array(data, HEAD_BYTES), age: head.getUint32(0) + onTheWay, at: now };
      this.#decode();
      if (delayOf(this.live) > SLOW_MS) {
        this.#pause = setTimeout(() => this.#ask(), Math.min(1000, 2 * onTheWay));
        return;
      }
    }
    this.#ask();
  }

  /** Decode the newest picture; while that takes, newer ones replace each other. */
  async #decode() {
    if (this.#isDecoding) return;
    this.#isDecoding = true;
    while (this.#waiting) {
      const { bytes, age, at } = this.#waiting;
      this.#waiting = null;
      try {
        const picture = await createImageBitmap(new Blob([bytes], { type: "image/jpeg" }));
        this.#draw(picture, age, at);
      } catch {
        this.#problem = "The camera sends pictures that this browser cannot show.";
      }
    }
    this.#isDecoding = false;
  }

  #draw(picture, age, at) {
    if (this.canvas.width !== picture.width || this.canvas.height !== picture.height) {
      this.canvas.width = picture.width;
      this.canvas.height = picture.height;
    }
    this.context.drawImage(picture, 0, 0);
    picture.close();
    if (!this.#clock) return; // Nobody looks any more.
    this.#age = age;
    this.#shownAt = at;
    this.#problem = "";
    this.mark.currentTime = this.age;
    this.#show();
  }

  #isOld() {
    this.#age = Infinity;
    this.mark.finish();
  }

  #tick() {
    if (this.#askedAt && performance.now() - this.#askedAt > SILENT_MS) this.#lost(0, "");
    this.#show();
  }

  #show() {
    const { age } = this;
    const isLive = age <= OLD_MS;
    this.element.dataset.live = isLive;
    const old = Number.isFinite(age) ? `Not live: ${duration(age)} old` : "No picture yet";
    write(this.ageText, isLive ? `${fixed(age / 1000, 1)} s` : old);
    write(this.words, isLive ? "" : this.#problem || (age > SILENT_MS ? "The camera sends no picture. It is asked again and again." : ""));
  }

  #lost(code, reason) {
    this.#drop();
    this.#problem = reason || "The connection to the robot's computer was lost.";
    this.#show();
    if (code !== POLICY) this.#retry = setTimeout(() => this.#clock && this.#open(), RETRY_MS);
  }

  #drop() {
    const socket = this.#socket;
    this.#socket = null;
    this.#waiting = null;
    this.#askedAt = 0;
    clearTimeout(this.#pause);
    socket?.close();
  }

  #close() {
    clearInterval(this.#clock);
    clearTimeout(this.#retry);
    this.#clock = 0;
    this.#drop();
    // Whoever looks again sees the last picture marked until a new one comes.
    this.#isOld();
    this.#show();
  }
}
