import { Config, Session } from "@eclipse-zenoh/zenoh-ts";
import { WebSocket } from "ws";

globalThis.WebSocket ??= WebSocket as never; // Node has its own from version 22 on, and a browser.

const session = await Session.open(new Config(process.env.ROBOT ?? "ws://127.0.0.1:8080/zenoh"));
await session.declareSubscriber("yahboomd/pose", {
  handler: (sample) => console.log(sample.payload().toString()),
});
for (let count = 0; count < 40; count++) { // 2 s: a command lapses after 0.5 s, so repeat it
  await session.put("cmd_vel", JSON.stringify({ vx: 0.2, wz: 0.5 }));
  await new Promise((done) => setTimeout(done, 50));
}
await session.put("cmd_vel", JSON.stringify({ vx: 0, wz: 0 }));
await session.close();
