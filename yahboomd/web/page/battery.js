// The battery in words: percent if the robot's configuration has a curve, else volts.

import { DASH, fixed } from "./dom.js";

const LOW = { low: " low", empty: " empty" };

/** `{ text, isLow }`; a dash while it is not known. */
export function charge(live) {
  const volts = live.fresh("battery")?.sample.volts;
  const { battery: level, volts_at_rest: atRest } = live.sample("status")?.board ?? {};
  if (volts === undefined) return { text: DASH, isLow: false };
  const curve = live.newest("hello")?.battery_curve ?? [];
  const amount = curve.length ? `${Math.round(100 * share(atRest ?? volts, curve))} %` : `${fixed(volts, 1)} V`;
  return { text: `${amount}${LOW[level] ?? ""}`, isLow: level in LOW };
}

/** The charge, from 0 to 1, on straight lines between points `[volts, charge]` that rise. */
function share(volts, curve) {
  const above = curve.findIndex(([each]) => each > volts);
  if (above <= 0) return curve[above === 0 ? 0 : curve.length - 1][1];
  const [[low, from], [high, to]] = curve.slice(above - 1, above + 1);
  return from + ((to - from) * (volts - low)) / (high - low);
}
