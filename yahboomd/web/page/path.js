// The path of the robot: bounded, in pieces where the pose was set or jumped.

const JUMP_M = 0.5; // A larger step between two consecutive poses is a pose that was set.

export class Path {
  #last = null;

  /** @param capacity The most points; beyond it every second point is dropped. */
  constructor(capacity = 10_000) {
    this.capacity = capacity;
    this.clear();
  }

  clear() {
    this.x = new Float64Array(this.capacity);
    this.y = new Float64Array(this.capacity);
    this.starts = new Uint8Array(this.capacity); // 1: a new piece begins here.
    this.length = 0;
    this.spacing = 0.005;
    this.version = (this.version ?? 0) + 1; // Changes when earlier points are removed.
    this.#last = null;
  }

  /** The next pose begins a new piece: the way to it was not seen. */
  interrupt() {
    this.#last = null;
  }

  /** As a text, in millimetres; `read` understands it. */
  write() {
    const whole = (list) => Array.from(list.subarray(0, this.length), (metres) => Math.round(metres * 1000));
    return JSON.stringify({ spacing: this.spacing, x: whole(this.x), y: whole(this.y), starts: [...this.starts.subarray(0, this.length)] });
  }

  /** Begin with the path of a text. One that is none leaves the path as it is. */
  read(text) {
    try {
      const { spacing, x, y, starts } = JSON.parse(text);
      const fits = (list) => list.length === x.length && list.length <= this.capacity && list.every(Number.isFinite);
      if (!(spacing > 0) || ![x, y, starts].every(fits)) return;
      this.clear();
      this.x.set(x.map((mm) => mm / 1000));
      this.y.set(y.map((mm) => mm / 1000));
      this.starts.set(starts);
      this.length = x.length;
      this.spacing = spacing;
    } catch {
      // Of another version, or nothing was kept.
    }
  }

  add(x, y) {
    const way = this.#last ? Math.hypot(x - this.#last.x, y - this.#last.y) : Infinity;
    if (way < this.spacing) return;
    if (this.length === this.capacity) this.#thin();
    this.x[this.length] = x;
    this.y[this.length] = y;
    this.starts[this.length] = way > Math.max(JUMP_M, this.spacing * 4) ? 1 : 0;
    this.length += 1;
    this.#last = { x, y };
  }

  #thin() {
    let kept = 0;
    let starts = 0;
    for (let from = 0; from < this.length; from += 1) {
      starts |= this.starts[from];
      if (from % 2 && !this.starts[from]) continue;
      this.x[kept] = this.x[from];
      this.y[kept] = this.y[from];
      this.starts[kept] = starts;
      starts = 0;
      kept += 1;
    }
    // Single points only: drop the older half.
    if (kept === this.length) {
      kept >>= 1;
      for (const list of [this.x, this.y, this.starts]) list.copyWithin(0, this.length - kept, this.length);
    }
    this.length = kept;
    this.spacing *= 2;
    this.version += 1;
  }

  /** Draw it: `toX` and `toY` map metres to pixels; points closer than a pixel are left out. */
  trace(context, toX, toY) {
    context.beginPath();
    let atX = NaN;
    let atY = NaN;
    for (let index = 0; index < this.length; index += 1) {
      const x = toX(this.x[index]);
      const y = toY(this.y[index]);
      if (this.starts[index]) context.moveTo(x, y);
      else if (Math.abs(x - atX) + Math.abs(y - atY) < 1 && index < this.length - 1) continue;
      else context.lineTo(x, y);
      atX = x;
      atY = y;
    }
  }

  /** The bounding box, `[left, bottom, right, top]`; null if it is empty. */
  bounds() {
    if (!this.length) return null;
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (let index = 0; index < this.length; index += 1) {
      box[0] = Math.min(box[0], this.x[index]);
      box[1] = Math.min(box[1], this.y[index]);
      box[2] = Math.max(box[2], this.x[index]);
      box[3] = Math.max(box[3], this.y[index]);
    }
    return box;
  }
}
