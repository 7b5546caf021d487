// The map: path, pose with the ellipse of its uncertainty, grid with scale; pan, pinch, follow, go, set the pose, clear.

import { Canvas, niceStep } from "./canvas.js";
import { DASH, duration, el, fixed, write } from "./dom.js";
import { GoThere } from "./go_there.js";
import { Path } from "./path.js";
import { SetPose } from "./set_pose.js";
import { keep, kept, ofTab } from "./storage.js";

const NEAREST = 2000; // Pixels for a metre.
const FARTHEST = 0.5;
const SURE = 2.448; // Standard deviations of a 95 % ellipse in two dimensions.
const PATH = "path"; // Its key in the storage of the tab.

export const map = { id: "map", title: "Map", create };

function create(app) {
  const { live, connection } = app;
  const path = new Path();
  path.read(kept(PATH, ofTab));
  // A phone may end a hidden page without another word.
  const save = () => keep(PATH, path.write(), ofTab);
  addEventListener("pagehide", save);
  document.addEventListener("visibilitychange", () => document.hidden && save());
  const view = { x: 0, y: 0, scale: 150, follow: true };
  let pose = null;
  const pointers = new Map();

  const toX = (x) => canvas.width / 2 + (x - view.x) * view.scale;
  const toY = (y) => canvas.height / 2 - (y - view.y) * view.scale;
  const toMetres = ([px, py]) => [view.x + (px - canvas.width / 2) / view.scale, view.y - (py - canvas.height / 2) / view.scale];

  const canvas = new Canvas(draw, {
    class: "map",
    tabindex: "0",
    role: "img",
    "data-arrows": true,
    "aria-label": "Map of the path. Arrows move it, plus and minus zoom, F follows the robot, 0 shows all of it, Enter marks the middle to go to.",
  });
  const setPose = new SetPose(connection, () => pose, () => canvas.redraw());
  const go = new GoThere(app, () => canvas.redraw());
  go.opener.addEventListener("click", () => setPose.close());
  setPose.opener.addEventListener("click", () => go.close());
  const follow = button("Follow", "Keep the robot in the middle", () => {
    view.follow = !view.follow;
    changed();
  });
  const where = el("p", { class: "where" });
  const tools = el(
    "div",
    { class: "tools" },
    follow,
    button("Show all", "Show all of the path", showAll),
    button("Clear", "Forget the path that is drawn; the robot's pose stays", () => {
      path.clear();
      changed();
    }),
    setPose.opener,
    go.opener,
  );
  const zooms = el("div", { class: "zooms" }, button("+", "Zoom in", () => zoom(1.5)), button("−", "Zoom out", () => zoom(1 / 1.5)));
  const element = el("section", { class: "mapview" }, tools, el("div", { class: "place" }, canvas.element, zooms, setPose.hint), setPose.form, go.panel, where);

  live.on("pose", ({ sample }) => {
    pose = sample;
    path.add(sample.x, sample.y);
    if (element.hidden) return;
    changed();
  });
  // A viewer's would be refused.
  live.on("hello", ({ role }) => (setPose.opener.hidden = go.opener.hidden = role === "viewer"));
  live.on("link", ({ open }) => open && path.interrupt());
  live.on("event", ({ sample }) => /odometry|pose/.test(sample.kind) && path.interrupt());

  function changed() {
    if (pose && view.follow) [view.x, view.y] = [pose.x, pose.y];
    follow.setAttribute("aria-pressed", view.follow);
    canvas.redraw();
    write(where, pose ? live.fresh("pose") ? describe(pose) : `The last pose is ${duration(live.age("pose"))} old. x ${DASH}, y ${DASH}, heading ${DASH}.` : "No pose came yet.");
  }

  function zoom(factor, [px, py] = [canvas.width / 2, canvas.height / 2]) {
    const [x, y] = toMetres([px, py]);
    view.scale = Math.min(NEAREST, Math.max(FARTHEST, view.scale * factor));
    // Keep the place under the fingers.
    const [nowX, nowY] = toMetres([px, py]);
    pan(x - nowX, y - nowY, view.follow);
  }

  function pan(x, y, goesOn = false) {
    view.follow = goesOn;
    view.x += x;
    view.y += y;
    changed();
  }

  function showAll() {
    const box = path.bounds();
    if (!box) return;
    const [left, bottom, right, top] = box;
    view.follow = false;
    view.x = (left + right) / 2;
    view.y = (bottom + top) / 2;
    const room = Math.min(canvas.width / Math.max(0.5, right - left), canvas.height / Math.max(0.5, top - bottom));
    view.scale = Math.min(NEAREST, Math.max(FARTHEST, room * 0.85));
    changed();
  }

  const place = (event) => {
    const box = canvas.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  canvas.element.addEventListener("pointerdown", (event) => {
    canvas.element.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    if (setPose.isOpen && pointers.size === 1) setPose.point(toMetres(place(event)));
    if (go.isOpen && pointers.size === 1) go.press(event, place(event), toMetres(place(event)));
  });
  canvas.element.addEventListener("pointermove", (event) => {
    const from = pointers.get(event.pointerId);
    if (!from) return;
    const to = place(event);
    if (setPose.isOpen && pointers.size === 1) {
      setPose.turn(toMetres(to));
      return;
    }
    if (go.keeps(event, to)) return;
    const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    pointers.set(event.pointerId, to);
    const [a, b] = [toMetres(from), toMetres(to)];
    if (!others.length) pan(a[0] - b[0], a[1] - b[1]);
    else {
      const apart = (at) => Math.hypot(at[0] - others[0][0], at[1] - others[0][1]);
      zoom(apart(to) / Math.max(1, apart(from)), others[0]);
      pan((a[0] - b[0]) / 2, (a[1] - b[1]) / 2, view.follow);
    }
  });
  for (const type of ["pointerup", "pointercancel", "lostpointercapture"])
    canvas.element.addEventListener(type, (event) => {
      pointers.delete(event.pointerId);
      go.release(event, type === "pointerup" ? "" : "The touch was interrupted.");
    });
  // A long press opens no menu.
  canvas.element.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.element.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 400), place(event));
  }, { passive: false });
  canvas.element.addEventListener("keydown", (event) => {
    const step = 60 / view.scale;
    const actions = {
      ArrowLeft: () => pan(-step, 0), ArrowRight: () => pan(step, 0), ArrowUp: () => pan(0, step), ArrowDown: () => pan(0, -step),
      "+": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: showAll, f: () => follow.click(),
      ...(go.isOpen && { Enter: () => go.mark([view.x, view.y]) }),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  });

  function draw(context, width, height) {
    drawGrid(context, width, height);
    context.lineJoin = "round";
    context.lineWidth = 2.5;
    context.strokeStyle = canvas.color("accent");
    path.trace(context, toX, toY);
    if (pose) context.lineTo(toX(pose.x), toY(pose.y));
    context.stroke();
    if (go.drawn) drawPlace(context, go.drawn);
    if (pose) drawPose(context, pose);
    if (setPose.wanted) drawRobot(context, setPose.wanted, canvas.color("warning"));
    drawScale(context, width, height);
  }

  function drawGrid(context, width, height) {
    const step = niceStep(50 / view.scale);
    const [left, top] = toMetres([0, 0]);
    const [right, bottom] = toMetres([width, height]);
    context.lineWidth = 1;
    for (const isAxis of [false, true]) {
      context.strokeStyle = canvas.color(isAxis ? "axis" : "grid");
      context.beginPath();
      for (let n = Math.ceil(left / step); n * step <= right; n += 1)
        if ((n === 0) === isAxis) line(context, toX(n * step), 0, toX(n * step), height);
      for (let n = Math.ceil(bottom / step); n * step <= top; n += 1)
        if ((n === 0) === isAxis) line(context, 0, toY(n * step), width, toY(n * step));
      context.stroke();
    }
  }

  function drawScale(context, width, height) {
    const step = niceStep(60 / view.scale);
    const text = step >= 1 ? `${step} m` : `${Math.round(step * 100)} cm`;
    const y = height - 14;
    context.strokeStyle = context.fillStyle = canvas.color("text");
    context.lineWidth = 2;
    context.beginPath();
    line(context, 14, y, 14 + step * view.scale, y);
    line(context, 14, y - 4, 14, y + 4);
    line(context, 14 + step * view.scale, y - 4, 14 + step * view.scale, y + 4);
    context.stroke();
    context.font = "14px system-ui, sans-serif";
    context.fillText(text, 14, y - 9);
    if (pose && !live.fresh("pose")) {
      context.fillStyle = canvas.color("warning");
      context.fillText("old", toX(pose.x) + 14, toY(pose.y) - 14);
    }
  }

  function drawPose(context, { x, y, theta, covariance: c }) {
    const { major, minor, angle } = ellipse(c[0], c[1], c[4]);
    context.fillStyle = canvas.color("unsure");
    context.strokeStyle = canvas.color("accent");
    context.lineWidth = 1;
    context.beginPath();
    context.ellipse(toX(x), toY(y), major * view.scale, minor * view.scale, -angle, 0, 2 * Math.PI);
    // One beyond the map would only tint all of it.
    if (minor * view.scale < Math.hypot(canvas.width, canvas.height) / 2) context.fill();
    context.stroke();
    drawRobot(context, { x, y, theta }, canvas.color(live.fresh("pose") ? "text" : "axis"));
  }

  function drawPlace(context, { x, y, driven }) {
    context.strokeStyle = context.fillStyle = canvas.color("command");
    context.lineWidth = 2.5;
    if (driven && pose) {
      context.setLineDash([8, 6]);
      context.beginPath();
      line(context, toX(pose.x), toY(pose.y), toX(x), toY(y));
      context.stroke();
      context.setLineDash([]);
    }
    for (const [radius, ink] of [[11, "stroke"], [3.5, "fill"]]) {
      context.beginPath();
      context.arc(toX(x), toY(y), radius, 0, 2 * Math.PI);
      context[ink]();
    }
  }

  function drawRobot(context, { x, y, theta }, color) {
    const size = Math.max(11, 0.11 * view.scale);
    context.save();
    context.translate(toX(x), toY(y));
    context.rotate(-theta);
    context.fillStyle = color;
    context.strokeStyle = canvas.color("card");
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(size, 0);
    context.lineTo(-size * 0.75, size * 0.7);
    context.lineTo(-size * 0.4, 0);
    context.lineTo(-size * 0.75, -size * 0.7);
    context.closePath();
    context.fill();
    context.stroke();
    context.restore();
  }

  let clock = 0;
  const show = () => {
    clock = setInterval(changed, 1000);
    changed();
  };
  const hide = () => {
    clearInterval(clock);
    pointers.clear();
    go.letGo("Another view was opened.");
  };
  return { element, show, hide };
}

function button(text, title, onclick) {
  // Only a sign needs words of its own.
  return el("button", { type: "button", title, "aria-label": text.length === 1 ? title : null, onclick }, text);
}

function line(context, x1, y1, x2, y2) {
  context.moveTo(x1, y1);
  context.lineTo(x2, y2);
}

/** Half axes and direction of the 95 % ellipse of a covariance. */
function ellipse(xx, xy, yy) {
  const middle = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  return {
    major: SURE * Math.sqrt(Math.max(0, middle + spread)),
    minor: SURE * Math.sqrt(Math.max(0, middle - spread)),
    angle: Math.atan2(2 * xy, xx - yy) / 2,
  };
}

function describe({ x, y, theta, covariance }) {
  const degrees = (rad) => (rad * 180) / Math.PI;
  const around = degrees(Math.atan2(Math.sin(theta), Math.cos(theta)));
  const sure = (variance) => fixed(2 * Math.sqrt(Math.max(0, variance)), 2);
  const off = 2 * degrees(Math.sqrt(Math.max(0, covariance[8])));
  const heading = off < 180 ? `${fixed(around, 0)}° ± ${fixed(off, 0)}°` : "unknown";
  return `x ${fixed(x, 2)} ± ${sure(covariance[0])}, y ${fixed(y, 2)} ± ${sure(covariance[4])} m, heading ${heading}.`;
}
