// Drawings of what to do and what to measure, seen from above: the robot looks to the right, its left is up.

const SVG = "http://www.w3.org/2000/svg";

/** The robot, with the middle of its axle at x, y, turned counter-clockwise by degrees. */
const robot = (x, y, { turned = 0, before = false } = {}) =>
  `<g transform="translate(${x} ${y}) rotate(${-turned})"${before ? ' class="before"' : ""}>` +
  '<path class="body" d="M-15-12h26q8 0 8 12t-8 12h-26z"/><path d="M-6-16h12M-6 16h12" stroke-width="5"/><path d="M9-5l6 5-6 5z" fill="currentColor"/></g>';
const mark = (x, y) => `<path class="mark" d="M${x - 5} ${y}h10M${x} ${y - 5}v10"/>`;
/** A way, with its arrow at the end. */
const way = (path) => `<path class="way" d="${path}" marker-end="url(#tip)"/>`;
/** What to measure, with an arrow at each end, and its letter. */
const measure = (path, x, y, unit) => `<path class="measure" d="${path}" marker-start="url(#tip)" marker-end="url(#tip)"/><text x="${x}" y="${y}">${unit}</text>`;
const angled = (path, x, y) => `<path class="measure" d="${path}" marker-end="url(#tip)"/><text x="${x}" y="${y}">\u00b0</text>`;
const line = (path) => `<path class="line" d="${path}"/>`;
const edge = '<path d="M40 84h160" stroke-width="4"/>';
const around = { left: "M150 56A30 30 0 1 0 146 76", right: "M150 64A30 30 0 1 1 146 44" };
const squares = { left: "M60 96H196V24H60V70", right: "M60 24H196V96H60V50" };
/** The nose beside the line on which it is to be, and the angle from there. */
const angle = {
  left: () => ["60 20 156 90", line("M100 82h104M100 82l83-48") + robot(100, 82, { turned: 30 }) + angled("M174 82A74 74 0 0 0 164 45", 180, 68)],
  right: () => ["60 10 156 90", line("M100 38h104M100 38l83 48") + robot(100, 38, { turned: -30 }) + angled("M174 38A74 74 0 0 1 164 75", 180, 64)],
};
const start = { left: 96, right: 24 };

// By the run, or by it and the question's name: the part of the plane that is seen, a drawing, and what to measure.
const PICTURES = {
  straight: () => ["16 34 208 52", line("M36 60h176") + robot(36, 60) + way("M62 60h132")],
  "straight length": () => [
    "16 24 208 88",
    robot(40, 46, { before: true }) + robot(196, 46) + mark(40, 46) + mark(196, 46) + measure("M42 84h152", 111, 106, "m"),
    "From mark to mark, each under the middle of the axle.",
  ],
  "straight left": () => [
    "16 20 224 86",
    robot(40, 84, { before: true }) + line("M40 84h170") + robot(160, 44) + mark(160, 44) + measure("M190 81V47", 198, 70, "mm"),
    "From the line of its start to the middle of the axle.",
  ],
  turn: (to) => ["60 20 120 80", line("M120 60h56") + robot(120, 60) + way(around[to])],
  "turn side": () => [
    "84 20 80 80",
    robot(120, 60) + way("M150 56A30 30 0 0 0 120 30") + way("M150 64A30 30 0 0 1 120 90") + '<text x="146" y="36">1</text><text x="146" y="96">2</text>',
    "1 is to the left, 2 to the right.",
  ],
  "turn beyond": (to) => [...angle[to](), "From the mark to its nose."],
  sideways: (to) => ["60 2 120 116", line("M120 10v100") + robot(120, start[to]) + way(to === "left" ? "M120 72V18" : "M120 48v54")],
  "sideways length": (to) => [
    "40 4 160 112",
    robot(104, start[to], { before: true }) + robot(104, 120 - start[to]) + mark(104, 24) + mark(104, 96) + measure("M142 27v66", 152, 65, "m"),
    "From mark to mark, each under the middle of the axle.",
  ],
  square: (to) => ["30 6 180 108", robot(60, start[to]) + way(squares[to])],
  "square ahead": () => [
    "56 24 140 92",
    mark(80, 82) + line("M80 82h104") + robot(150, 48, { turned: 10 }) + line("M150 48v34") + measure("M83 94h64", 102, 112, "mm"),
    "Forward from the mark to the middle of the axle.",
  ],
  "square left": () => [
    "56 20 164 82",
    mark(80, 88) + line("M80 88h120") + robot(140, 44, { turned: 10 }) + measure("M180 85V47", 188, 71, "mm"),
    "From the line of its start to the middle of the axle.",
  ],
  heading: () => [...angle.left(), "From where it looked at its start to its nose."],
  rest: () => ["36 40 168 50", edge + robot(120, 64)],
  turned: () => ["36 10 168 96", edge + robot(120, 64) + way("M150 46A36 36 0 1 0 146 88")],
};

/** The figure for a question of the server; an empty text if it needs none. */
export function picture({ name, run = "" }) {
  const [shape, to] = run.split(" ");
  const draw = PICTURES[`${shape} ${name}`] ?? PICTURES[name] ?? (["move", "moved"].includes(name) && PICTURES[shape]);
  if (!draw) return "";
  const [box, drawn, words] = draw(to);
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", box);
  // The question tells the same in words.
  svg.setAttribute("aria-hidden", "true");
  svg.innerHTML = `<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="5" markerHeight="5" orient="auto-start-reverse"><path class="tip" d="M0 0l8 4-8 4z"/></marker></defs>${drawn}`;
  const figure = document.createElement("figure");
  figure.className = "picture";
  figure.append(svg);
  if (words) {
    const caption = document.createElement("figcaption");
    caption.textContent = words;
    figure.append(caption);
  }
  return figure;
}
