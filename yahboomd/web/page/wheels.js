// The wheels: commanded and measured speed of each over the last ten seconds.

import { Canvas, niceStep } from "./canvas.js";
import { DASH, el, fixed, write } from "./dom.js";

const WINDOW_NS = 10e9;
const KEPT = 600; // More than ten seconds of samples at 50 Hz.

export const wheels = { id: "wheels", title: "Wheels", create };

function create({ live }) {
  const samples = [];
  let rows = [];
  const list = el("div", { class: "charts" });
  const none = el("p", {}, "No sample of the wheels came yet.");
  const element = el(
    "section",
    { class: "wheels", tabindex: "0" },
    el("p", { class: "legend" }, el("span", { class: "measured" }, "measured"), el("span", { class: "commanded" }, "commanded"), " rim speed in m/s, the last 10 s"),
    none,
    list,
  );

  live.on("wheels", ({ sample }) => {
    const last = samples.at(-1);
    // Another daemon, or another number of wheels: a new chart.
    if (last && (sample.stamp_ns < last.stamp_ns || sample.names.length !== last.names.length)) samples.length = 0;
    samples.push(sample);
    while (samples.length > KEPT || sample.stamp_ns - samples[0].stamp_ns > WINDOW_NS) samples.shift();
    if (!element.hidden) show();
  });

  function show() {
    const newest = samples.at(-1);
    none.hidden = Boolean(newest);
    if (!newest) return;
    if (rows.map((row) => row.name).join() !== newest.names.join()) {
      rows = newest.names.map((name, index) => row(name, index));
      list.replaceChildren(...rows.map(({ element: figure }) => figure));
    }
    const isNow = Boolean(live.fresh("wheels"));
    list.classList.toggle("old", !isNow);
    rows.forEach(({ text, canvas }, index) => {
      const [measured, commanded] = [newest.speed_m_s, newest.command_m_s].map((speeds) => (isNow ? fixed(speeds[index], 2) : DASH));
      write(text, `measured ${measured}, commanded ${commanded} m/s`);
      canvas.redraw();
    });
  }

  function row(name, index) {
    const text = el("span", {});
    const canvas = new Canvas((context, width, height) => draw(canvas, context, width, height, index), {
      class: "chart",
      role: "img",
      "aria-label": `Speed of the wheel ${name} over the last ten seconds`,
    });
    const figure = el("figure", {}, el("figcaption", {}, el("b", {}, name), text), canvas.element);
    return { name, text, canvas, element: figure };
  }

  function draw(canvas, context, width, height, index) {
    const newest = samples.at(-1).stamp_ns;
    // One scale for all wheels, so that they can be compared.
    const most = Math.max(0.05, ...samples.flatMap(({ speed_m_s, command_m_s }) => [...speed_m_s, ...command_m_s].map(Math.abs)));
    const step = niceStep(most / 2);
    const reach = Math.max(step, Math.ceil(most / step) * step) * 1.05;
    const left = 44;
    const toX = (stamp) => left + ((stamp - newest + WINDOW_NS) / WINDOW_NS) * (width - left - 4);
    const toY = (speed) => height / 2 - (speed / reach) * (height / 2 - 4);
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "right";
    context.textBaseline = "middle";
    context.lineWidth = 1;
    for (let n = -Math.round(reach / step); n * step <= reach; n += 1) {
      const speed = n * step;
      if (Math.abs(speed) > reach) continue;
      context.strokeStyle = canvas.color(n === 0 ? "axis" : "grid");
      context.beginPath();
      context.moveTo(left, toY(speed));
      context.lineTo(width, toY(speed));
      context.stroke();
      context.fillStyle = canvas.color("muted");
      context.fillText(fixed(speed, 2), left - 6, Math.min(height - 9, Math.max(9, toY(speed))));
    }
    const lines = [["command_m_s", "command", [6, 4], true], ["speed_m_s", "accent", [], false]];
    for (const [field, color, dash, isStep] of lines) {
      context.strokeStyle = canvas.color(color);
      context.lineWidth = 2;
      context.setLineDash(dash);
      context.beginPath();
      samples.forEach((sample, at) => {
        const y = toY(sample[field][index]);
        if (isStep && at) context.lineTo(toX(sample.stamp_ns), toY(samples[at - 1][field][index]));
        context.lineTo(toX(sample.stamp_ns), y);
      });
      context.stroke();
      context.setLineDash([]);
    }
  }

  let clock = 0;
  return {
    element,
    show: () => {
      clock = setInterval(show, 1000);
      show();
    },
    hide: () => clearInterval(clock),
  };
}
