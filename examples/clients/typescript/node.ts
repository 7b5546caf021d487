// Reads and drives a robot from Node: `npm install && npm run build`, then `node dist/robot.mjs square`.
// The contract of its commands and exit codes is in examples/clients/README.md.

import { readFileSync } from "node:fs";
import { WebSocket } from "ws";
import { decode, encode, type Messages } from "./messages.ts";
import { driveMoves } from "./moves.ts";
import { Robot, Unreachable } from "./robot.ts";
import { Refused, Square } from "./square.ts";

globalThis.WebSocket ??= WebSocket as never; // Node has its own from version 22 on.
console.log = console.warn = () => {}; // zenoh-ts reports there what the errors below say too.

const ROBOT = process.env.ROBOT ?? "ws://127.0.0.1:8080/zenoh";
const NAMESPACE = process.env.NAMESPACE ?? "";
const USAGE = `usage: robot.mjs pose | status | estop | release | set-pose X Y THETA | config
                | square [SIDE] | moves [SIDE] | decode PoseSample|StatusSample|ServiceReply`;

function fail(code: number, words: string): never {
  process.stderr.write(`${words}\n`);
  return process.exit(code);
}

function show(message: object): void {
  process.stdout.write(`${encode(message)}\n`);
}

async function call(robot: Robot, service: string, request?: object): Promise<number> {
  const reply = await robot.call(service, request);
  show(reply);
  return reply.success ? 0 : 1;
}

/** Runs what asks `signalled` to end; returns the exit code of Ctrl-C or SIGTERM if one came. */
async function untilSignal(run: (signalled: () => boolean) => Promise<void>): Promise<number> {
  let signal = 0;
  process.once("SIGINT", () => (signal = 130)).once("SIGTERM", () => (signal = 143));
  try {
    await run(() => signal > 0);
  } catch (error) {
    if (!signal) throw error;
  }
  return signal;
}

const COMMANDS: Record<string, [wanted: RegExp, run: (robot: Robot, ...numbers: number[]) => Promise<number | void>]> = {
  pose: [/^0$/, async (robot) => show(await robot.newest("yahboomd/pose", "PoseSample"))],
  status: [/^0$/, async (robot) => show(await robot.newest("yahboomd/status", "StatusSample"))],
  estop: [/^0$/, (robot) => call(robot, "yahboomd/estop")],
  release: [/^0$/, (robot) => call(robot, "yahboomd/estop/reset")],
  config: [/^0$/, (robot) => call(robot, "yahboomd/config")],
  "set-pose": [/^3$/, (robot, x, y, theta) => call(robot, "yahboomd/odometry/set_pose", { x, y, theta })],
  square: [/^[01]$/, async (robot, side = 1) => {
    return untilSignal(async (signalled) => {
      const { x, y, theta } = await Square.drive(robot, side, signalled);
      show({ x, y, theta });
    });
  }],
  moves: [/^[01]$/, async (robot, side = 1) => {
    return untilSignal(async (signalled) => {
      const end = await driveMoves(robot, side, signalled, ({ done, left_s }) => {
        process.stdout.write(`${Math.round(100 * done)} %, ${left_s.toFixed(1)} s are left\n`);
      });
      show(end);
      if (end.reason !== "reached") throw new Refused(end.message);
    });
  }],
};

async function main(name = "", ...rest: string[]): Promise<number> {
  if (name === "decode" && rest.length === 1 && ["PoseSample", "StatusSample", "ServiceReply"].includes(rest[0])) {
    try {
      show(decode(rest[0] as keyof Messages, readFileSync(0, "utf8")));
    } catch (error) {
      fail(65, `This is no ${rest[0]}: ${(error as Error).message}`);
    }
    return 0;
  }
  const numbers = rest.map(Number);
  const command = Object.hasOwn(COMMANDS, name) ? COMMANDS[name] : undefined;
  if (!command?.[0].test(`${rest.length}`) || !numbers.every(Number.isFinite)) fail(64, USAGE);
  try {
    const robot = await Robot.connect(ROBOT, NAMESPACE);
    const code = await command[1](robot, ...numbers);
    await robot.close();
    return code ?? 0;
  } catch (error) {
    if (error instanceof Unreachable) fail(69, error.message);
    if (error instanceof Refused) fail(75, error.message);
    throw error;
  }
}

process.exit(await main(...process.argv.slice(2)));
