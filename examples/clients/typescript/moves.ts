// Drives a square by moves: `yahboomd moves` closes the loop, and this program stays there.

import type { MoveSample } from "./messages.ts";
import { Unreachable, type Robot } from "./robot.ts";
import { Refused } from "./square.ts";

const BEAT_MS = 100;
const SILENCE_MS = 2000; // Progress comes ten times a second.
const KNOWN_MS = 1000; // A session that was just opened may not know the service.

/** Ask for the square, keep it alive, and return how it ended; `cancelled` is asked before each beat. */
export async function driveMoves(
  robot: Robot, side: number, cancelled: () => boolean, tell: (news: MoveSample) => void,
): Promise<MoveSample> {
  let newest: MoveSample | undefined;
  const unwatch = await robot.watch("yahboomd/moves", "MoveSample", (sample) => (newest = sample));
  // Its token goes with the WebSocket of this program or page: then the moves end.
  const holder = `${Date.now()}-${Math.random().toString(36).slice(2)}`;
  const release = await robot.declareToken(`yahboomd/moves/holder/${holder}`);
  const corner = [{ kind: "straight", distance_m: side }, { kind: "turn", angle_rad: Math.PI / 2 }];
  const request = { moves: [corner, corner, corner, corner].flat(), by: "square", holder };
  let id = "";
  try {
    const reply = await start(robot, request);
    if (!reply.success) throw new Refused(reply.message);
    id = String(reply.data.id);
    // One loop reads and sends: one that stalls sends no beat, and the robot stops.
    for (let heard = performance.now(); performance.now() - heard < SILENCE_MS; ) {
      if (cancelled()) throw new Refused("The moves were cancelled.");
      await robot.put("yahboomd/moves/beat", { id });
      await new Promise((done) => setTimeout(done, BEAT_MS));
      const news = newest as MoveSample | undefined;
      newest = undefined;
      if (news?.id !== id) continue;
      heard = performance.now();
      tell(news);
      if (news.state !== "ended") continue;
      id = "";
      return news;
    }
    throw new Unreachable("`yahboomd moves` is gone: the robot stops by itself.");
  } finally {
    if (id) await robot.call("yahboomd/moves/cancel", { id }).catch(() => {});
    await release();
    await unwatch();
  }
}

async function start(robot: Robot, request: object) {
  for (const begun = performance.now(); ; await new Promise((done) => setTimeout(done, BEAT_MS)))
    try {
      return await robot.call("yahboomd/moves/start", request);
    } catch (error) {
      if (!(error instanceof Unreachable) || performance.now() - begun > KNOWN_MS)
        throw new Unreachable(`${(error as Error).message} Does \`yahboomd moves\` run beside it?`);
    }
}
