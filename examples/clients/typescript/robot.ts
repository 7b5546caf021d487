// A robot behind the remote-api plugin of Zenoh, for Node and for a browser.

import { Config, ConsolidationMode, QueryTarget, Sample, Session } from "@eclipse-zenoh/zenoh-ts";
import { decode, encode, type Messages, type ServiceReply } from "./messages.ts";

const PATIENCE_MS = 5000;

/** No daemon, or no door to it. */
export class Unreachable extends Error {}

export class Robot {
  private stamp = 0n;

  private constructor(private session: Session, readonly address: string, private namespace: string) {}

  static async connect(address: string, namespace = ""): Promise<Robot> {
    if (!(await answers(address)))
      throw new Unreachable(`No gateway answers at ${address}. Is it running, and yahboomd? (yahboomd run)`);
    const session = await Session.open(new Config(address, PATIENCE_MS));
    return new Robot(session, address, namespace);
  }

  private key(name: string): string {
    return this.namespace ? `${this.namespace}/${name}` : name;
  }

  /** The answer to a query: its payload, and the name of its message. */
  private async query(name: string, payload?: string): Promise<[string, string]> {
    // ALL: an e-stop must reach every daemon, even where another client answers that key.
    const options = { payload, target: QueryTarget.ALL, consolidation: ConsolidationMode.NONE };
    for await (const reply of (await this.session.get(this.key(name), options))!) {
      const sample = reply.result();
      if (sample instanceof Sample) return [sample.payload().toString(), sample.encoding().toString().split(";")[1]];
    }
    throw new Unreachable(
      `Nothing behind ${this.address} answers ${this.key(name)}. Is yahboomd running, with this namespace (yahboomd run), ` +
      "and does gateway.json5 allow this key?");
  }

  async call(service: string, request?: object): Promise<ServiceReply> {
    return decode("ServiceReply", (await this.query(service, request && encode(request)))[0]);
  }

  /** The newest sample of a kind, such as `newest("yahboomd/pose", "PoseSample")`. */
  async newest<Name extends keyof Messages>(name: string, message: Name): Promise<Messages[Name]> {
    const [payload, found] = await this.query(name);
    if (found === "ServiceReply") throw new Unreachable(decode("ServiceReply", payload).message);
    return decode(message, payload);
  }

  /** Calls `use` with each sample from now on; what cannot be read is skipped. Returns what ends it. */
  async watch<Name extends keyof Messages>(
    name: string, message: Name, use: (sample: Messages[Name]) => void,
  ): Promise<() => Promise<void>> {
    const handler = (sample: Sample) => {
      let decoded;
      try {
        decoded = decode(message, sample.payload().toString());
      } catch {
        return;
      }
      use(decoded);
    };
    const subscriber = await this.session.declareSubscriber(this.key(name), { handler });
    return () => subscriber.undeclare();
  }

  /** A token that is there until the returned function is called, or this program or page is gone. */
  async declareToken(name: string): Promise<() => Promise<void>> {
    const token = await this.session.liveliness().declareToken(this.key(name));
    return () => token.undeclare();
  }

  /** One velocity command, in m/s and rad/s. It lapses after half a second: repeat it. */
  async send(vx: number, wz: number): Promise<void> {
    // A stamp that is used twice marks a copy, and clocks of browsers tick in milliseconds.
    const now = BigInt(Date.now()) * 1_000_000n;
    this.stamp = now > this.stamp ? now : this.stamp + 1n;
    await this.put("cmd_vel", { vx, wz, stamp_ns: this.stamp, source: "typescript" });
  }

  async put(name: string, message: object): Promise<void> {
    await this.session.put(this.key(name), encode(message));
  }

  async close(): Promise<void> {
    await this.session.close();
  }
}

/** Whether a WebSocket opens. Session.open alone would try for half an hour, and go on after its caller gave up. */
function answers(address: string): Promise<boolean> {
  return new Promise((done) => {
    const probe = new WebSocket(address);
    const end = (opened: boolean) => {
      clearTimeout(late);
      done(opened);
      probe.close();
    };
    const late = setTimeout(() => end(false), PATIENCE_MS);
    probe.onopen = () => end(true);
    probe.onerror = () => end(false);
  });
}
