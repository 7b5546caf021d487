// Chromium for the tests: orders as JSON lines in, `{"value": …}` or `{"error": …}` out for each.
//   node browser.mjs CHROMIUM PLAYWRIGHT PROFILE [CHROMIUM'S ARGUMENTS]
import { createInterface } from "node:readline";
import { pathToFileURL } from "node:url";

const [executablePath, playwright, profile, ...args] = process.argv.slice(2);
const { chromium } = (await import(pathToFileURL(playwright).href)).default;
const context = await chromium.launchPersistentContext(profile, {
  executablePath,
  headless: true,
  viewport: { width: 480, height: 800 },
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--no-proxy-server", ...args],
});
const pages = {};

const orders = {
  async open(name, url) {
    pages[name] = await context.newPage();
    await pages[name].goto(url, { waitUntil: "load", timeout: 60_000 });
  },
  // Playwright makes every page believe that it has the focus.
  async cover(name) {
    const session = await context.newCDPSession(pages[name]);
    await session.send("Emulation.setFocusEmulationEnabled", { enabled: false });
    await (await context.newPage()).bringToFront();
  },
  evaluate: (name, expression) => pages[name].evaluate(expression),
  text: (name, selector) => pages[name].textContent(selector),
  click: (name, selector) => pages[name].click(selector),
  async hold(name, selector) {
    await pages[name].hover(selector);
    await pages[name].mouse.down();
  },
  leave: (name) => pages[name].mouse.move(5, 5),
  release: (name) => pages[name].mouse.up(),
  close: (name) => pages[name].close(),
  async crash(name) {
    const session = await context.newCDPSession(pages[name]);
    session.send("Page.crash").catch(() => {}); // It never answers.
  },
  picture: (name, path) => pages[name].screenshot({ path }),
  frames: (name) => pages[name].frames().map((frame) => frame.url()),
};

for await (const line of createInterface({ input: process.stdin })) {
  const [order, ...values] = JSON.parse(line);
  let answer;
  try {
    answer = { value: (await orders[order](...values)) ?? null };
  } catch (error) {
    answer = { error: String(error) };
  }
  process.stdout.write(`${JSON.stringify(answer)}\n`);
}
await context.close();
