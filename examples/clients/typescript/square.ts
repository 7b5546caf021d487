// Drives a square that is closed on odometry, in a frame that begins where the robot stands.

import type { PoseSample, StatusSample } from "./messages.ts";
import type { Robot } from "./robot.ts";

// Anything else, a state of a later version too, is one in which the robot may not drive.
const DRIVABLE = ["waiting", "standing", "driving", "stopping"];
const PERIOD_MS = 50;
const STALE_MS = 300; // Older than this, a pose says nothing about where the robot is now.
const PATIENCE_MS = 30_000;

/** The robot will not move, or the square was given up; the message says why. */
export class Refused extends Error {}

export class Square {
  x = 0;
  y = 0;
  theta = 0;
  private pose?: PoseSample;
  private arrived = performance.now();
  private why = "";

  private constructor(private robot: Robot, private cancelled: () => boolean) {}

  /** Drive it; `cancelled` is asked before each command. The robot is sent zero however this ends. */
  static async drive(robot: Robot, side: number, cancelled: () => boolean = () => false): Promise<Square> {
    const square = new Square(robot, cancelled);
    square.onStatus(await robot.newest("yahboomd/status", "StatusSample"));
    square.refuse();
    const ends = [
      await robot.watch("yahboomd/pose", "PoseSample", (pose) => square.onPose(pose)),
      await robot.watch("yahboomd/status", "StatusSample", (status) => square.onStatus(status)),
    ];
    try {
      for (const [x, y] of [[side, 0], [side, side], [0, side], [0, 0]]) await square.driveTo(x, y);
      await square.turnTo(0);
    } finally {
      await robot.send(0, 0);
      for (const end of ends) await end();
    }
    return square;
  }

  private onStatus({ state, why }: StatusSample): void {
    this.why = DRIVABLE.includes(state) ? "" : `It is ${state}: ${why}`;
  }

  private refuse(): void {
    if (this.why) throw new Refused(`The robot will not move. ${this.why}`);
  }

  private onPose(pose: PoseSample): void {
    const old = this.pose;
    this.pose = pose;
    this.arrived = performance.now();
    if (!old || pose.seq <= old.seq) return; // The daemon was restarted.
    const [dx, dy, turned] = [pose.x - old.x, pose.y - old.y, pose.theta - old.theta];
    if (Math.hypot(dx, dy) > 0.5 || Math.abs(turned) > 0.5) return; // The pose was set or reset.
    const [cos, sin] = [Math.cos(this.theta - old.theta), Math.sin(this.theta - old.theta)];
    this.x += cos * dx - sin * dy;
    this.y += sin * dx + cos * dy;
    this.theta += turned;
  }

  /** Send one command, or zero where the newest pose is too old; then wait for the period. */
  private async step(vx: number, wz: number): Promise<void> {
    const silent = performance.now() - this.arrived;
    if (this.cancelled()) throw new Refused("The square was cancelled.");
    this.refuse();
    if (silent > PATIENCE_MS) throw new Refused("No pose came for 30 s; the square is given up.");
    const stale = !this.pose || silent > STALE_MS;
    await (stale ? this.robot.send(0, 0) : this.robot.send(vx, wz));
    await new Promise((done) => setTimeout(done, PERIOD_MS));
  }

  private async turnTo(theta: number): Promise<void> {
    for (let error; Math.abs((error = wrap(theta - this.theta))) > 0.02; )
      await this.step(0, Math.sign(error) * Math.min(1.2, 0.15 + 2 * Math.abs(error)));
  }

  private async driveTo(x: number, y: number): Promise<void> {
    await this.turnTo(Math.atan2(y - this.y, x - this.x));
    for (let distance; (distance = Math.hypot(x - this.x, y - this.y)) > 0.01; ) {
      const error = wrap(Math.atan2(y - this.y, x - this.x) - this.theta);
      if (Math.abs(error) > 1) break; // The corner is behind us.
      await this.step(Math.min(0.25, 0.03 + 1.5 * distance), Math.max(-1, Math.min(1, 2 * error)));
    }
  }
}

function wrap(angle: number): number {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}
