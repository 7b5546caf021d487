// The messages of yahboomd that the programs read, and the check that a payload is one of them.

export interface PoseSample {
  stamp_ns: bigint; // Nanoseconds since 1970 need more digits than a number of JavaScript has.
  seq: number;
  frame_id: string;
  child_frame_id: string;
  x: number;
  y: number;
  theta: number;
  covariance: number[];
}

export interface StatusSample {
  stamp_ns: bigint;
  state: string; // A later version may have others than this one.
  since_ns: bigint;
  why: string;
  driver: string | null;
  driver_since_ns: bigint | null;
  wheels: string | null;
  wheels_since_ns: bigint | null;
}

export interface ServiceReply {
  success: boolean;
  message: string;
  data: Record<string, unknown>;
}

export interface MoveSample {
  id: string;
  state: string;
  done: number;
  left_s: number;
  reason: string;
  message: string;
}

export interface Messages {
  MoveSample: MoveSample;
  PoseSample: PoseSample;
  StatusSample: StatusSample;
  ServiceReply: ServiceReply;
}

type Check = (value: unknown) => boolean;
const text: Check = (value) => typeof value === "string";
const number: Check = (value) => typeof value === "number" || typeof value === "bigint";
const count: Check = (value) => Number.isSafeInteger(value) && (value as number) >= 0;
const stamp: Check = (value) => (typeof value === "bigint" && value >= 0n) || count(value);
const map: Check = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
const optional = (check: Check): Check => (value) => value === undefined || value === null || check(value);

const FIELDS: Record<keyof Messages, Record<string, Check>> = {
  MoveSample: { stamp_ns: stamp, id: text, state: text, done: number, left_s: number, reason: text, message: text },
  PoseSample: {
    stamp_ns: stamp, seq: count, frame_id: text, child_frame_id: text, x: number, y: number, theta: number,
    covariance: (value) => Array.isArray(value) && value.length === 9 && value.every(number),
  },
  StatusSample: {
    stamp_ns: stamp, since_ns: stamp, why: text, driver_since_ns: optional(stamp),
    wheels: optional(text), wheels_since_ns: optional(stamp),
    driver: (value) => value === null || text(value),
    state: text,
  },
  ServiceReply: { success: (value) => typeof value === "boolean", message: text, data: optional(map) },
};
const STAMPS = ["stamp_ns", "since_ns", "driver_since_ns", "wheels_since_ns"];

/** The message in a JSON payload; throws where the payload is not that message. */
export function decode<Name extends keyof Messages>(name: Name, payload: string): Messages[Name] {
  const message = parse(payload);
  if (!map(message)) throw new TypeError("it is not an object");
  for (const [field, check] of Object.entries(FIELDS[name])) {
    if (!check(message[field])) throw new TypeError(`its field ${field} is wrong or missing`);
    if (STAMPS.includes(field) && typeof message[field] === "number") message[field] = BigInt(message[field]);
  }
  return message;
}

const TOKEN = /"(?:[^"\\]|\\.)*"|-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?/g;

/** JSON.parse, with integers of 16 digits and more as BigInt. */
function parse(json: string): any {
  const marked = json.replace(TOKEN, (token) => (/^-?\d{16,}$/.test(token) ? `"\\u0000${token}"` : token));
  return JSON.parse(marked, (_, value) =>
    typeof value === "string" && value.startsWith("\u0000") ? BigInt(value.slice(1)) : value);
}

/** JSON.stringify, with BigInt as integers. */
export function encode(message: unknown): string {
  const marked = JSON.stringify(message, (_, value) => (typeof value === "bigint" ? `\u0000${value}` : value));
  return marked.replace(/"\\u0000(-?\d+)"/g, "$1");
}
