// The connection to the server: beats, messages, requests, and reconnecting for ever.

import { sessionProblem } from "./session.js";

const SILENT_MS = 2000; // The server sends a beat every 50 ms: without one for this time, reconnect.
const BACKLOG_BYTES = 2000; // Commands are dropped while the network is congested: old ones are useless.
const ANSWER_MS = 5000;
const TOOL_MS = 30_000; // Some tools start a command on the server.
const SESSION_ENDED = 4401; // The code with which the server closes a page whose session has ended.

export class Connection {
  #socket = null;
  #beat = null;
  #beatAt = -Infinity;
  #attempts = 0;
  #retry = 0;
  #requests = new Map();
  #nextId = 1;
  #isShut = false;

  /** @param live Receives each message under its type, and "link" when the connection changes. */
  constructor(live) {
    this.live = live;
    setInterval(() => this.#check(), 1000);
    addEventListener("online", () => this.#hurry());
    // A page that is frozen or kept in the browser's cache closes its connection, so that the server sees it leave.
    addEventListener("pagehide", () => this.#leave());
    document.addEventListener("freeze", () => this.#leave());
    addEventListener("pageshow", (event) => event.persisted && this.#hurry());
    document.addEventListener("resume", () => this.#hurry());
    document.addEventListener("visibilitychange", () => document.hidden || this.#hurry());
  }

  get isOpen() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  /** Milliseconds since the newest beat of this connection arrived. */
  get beatAge() {
    return performance.now() - this.#beatAt;
  }

  get attempts() {
    return this.#attempts;
  }

  connect() {
    clearTimeout(this.#retry);
    if (this.#isShut) return;
    this.#retry = 0;
    this.#attempts += 1;
    const socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/ws`);
    this.#socket = socket;
    this.#beat = null;
    this.#beatAt = -Infinity;
    const opened = performance.now();
    socket.onmessage = ({ data }) => socket === this.#socket && [JSON.parse(data)].flat().forEach((part) => this.#receive(part));
    socket.onclose = ({ code, reason }) => socket === this.#socket && this.#lost(reason, code);
    this.openedAt = opened;
    this.live.emit("link", { open: false });
  }

  /** Send a velocity with the newest beat; false if it was not sent. */
  drive({ vx, vy, wz }) {
    if (!this.isOpen || this.#beat === null || this.#socket.bufferedAmount > BACKLOG_BYTES) return false;
    this.#send({ type: "drive", beat: this.#beat, vx, vy, wz });
    return true;
  }

  /** A place of the map is held, or a turn towards it; false if this was not sent. */
  go(place) {
    if (!this.isOpen || this.#beat === null || this.#socket.bufferedAmount > BACKLOG_BYTES) return false;
    this.#send({ type: "go", beat: this.#beat, ...place });
    return true;
  }

  /** The button of a calibration's question is held; false if this was not sent. */
  hold(question) {
    if (!this.isOpen || this.#beat === null || this.#socket.bufferedAmount > BACKLOG_BYTES) return false;
    this.#send({ type: "hold", beat: this.#beat, question });
    return true;
  }

  /** It was let go. */
  letGo() {
    if (!this.isOpen) return false;
    this.#send({ type: "let_go" });
    return true;
  }

  /** Use a tool of the server's; resolves with the answer. */
  tool(what, args = {}) {
    return this.#ask({ type: "tool", do: what, args }, TOOL_MS);
  }

  /** Take over control, or give it back. */
  control(want) {
    if (this.isOpen) this.#send({ type: "control", want });
  }

  /** Take control, unless another page has it. */
  controlIfFree() {
    if (this.isOpen) this.#send({ type: "control", want: true, if_free: true });
  }

  /** Send a request; resolves with the answer, `{ ok, text, data }`. */
  request(what, args = {}) {
    return this.#ask({ type: "request", do: what, ...args });
  }

  /** The e-stop on this connection, beside the one by POST. */
  estop() {
    return this.#ask({ type: "estop" });
  }

  #ask(message, patience = ANSWER_MS) {
    if (!this.isOpen) return Promise.resolve({ ok: false, text: "There is no connection to the robot." });
    const id = this.#nextId++;
    this.#send({ ...message, id });
    return new Promise((resolve) => {
      const give = (answer) => {
        clearTimeout(timer);
        this.#requests.delete(id);
        resolve(answer);
      };
      const timer = setTimeout(() => give({ ok: false, text: "The robot did not answer." }), patience);
      this.#requests.set(id, give);
    });
  }

  #send(message) {
    this.#socket.send(JSON.stringify(message));
  }

  #receive(message) {
    if (message.type === "beat") {
      this.#beat = message.beat;
      this.#beatAt = performance.now();
      return;
    }
    if (message.type === "hello" && !this.live.newest("link").open) {
      this.#attempts = 0;
      this.live.emit("link", { open: true });
    }
    if (message.type === "answer") this.#requests.get(message.id)?.(message);
    else this.live.emit(message.type, message);
  }

  #check() {
    if (!this.#socket || this.#retry) return;
    const silence = Math.min(this.beatAge, performance.now() - this.openedAt);
    if (silence > SILENT_MS) this.#lost("The robot's computer fell silent.");
    else if (this.isOpen && this.#beat !== null) this.#send({ type: "seen", beat: this.#beat });
  }

  /** Ask whether this page still has a session; without one it shows how to get in, and nothing else. */
  async checkSession(reason = "") {
    const problem = await sessionProblem();
    if (!problem || this.#isShut) return;
    this.#isShut = true;
    clearTimeout(this.#retry);
    this.#leave();
    this.live.emit("problem", { text: reason || problem });
  }

  #lost(reason, code) {
    // Of a connection that the server refused the browser tells no reason.
    if (code === SESSION_ENDED) this.checkSession(reason);
    else if (this.#beat === null) this.checkSession();
    this.#drop();
    for (const give of [...this.#requests.values()]) give({ ok: false, text: "The connection was lost." });
    this.live.emit("link", { open: false, reason });
    clearTimeout(this.#retry);
    this.#retry = setTimeout(() => this.connect(), Math.min(4000, 250 * 2 ** Math.min(this.#attempts, 6)));
  }

  #drop() {
    const socket = this.#socket;
    this.#socket = null;
    this.#beat = null;
    this.#beatAt = -Infinity;
    for (const type of ["control", "delay", "daemon"]) this.live.drop(type);
    socket?.close();
  }

  #leave() {
    this.#drop();
    this.live.emit("link", { open: false });
  }

  #hurry() {
    if (!this.isOpen && this.#socket?.readyState !== WebSocket.CONNECTING) this.connect();
  }
}
