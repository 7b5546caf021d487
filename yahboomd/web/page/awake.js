// The screen stays on while the robot is driven, and for two minutes after it.

const AFTER_MS = 120_000;

let lock = null; // Or the promise of it.
let timer = 0;
let refusal = "";

/** Keep it on from now. A hidden page loses it: the next drive asks again. */
export function keepAwake() {
  clearTimeout(timer);
  timer = setTimeout(rest, AFTER_MS);
  lock ??= ask();
}

async function ask() {
  try {
    const found = await navigator.wakeLock?.request("screen");
    refusal = "";
    found?.addEventListener("release", () => (lock = null));
    return found;
  } catch {
    lock = null;
    refusal = "The system refuses to keep it on, as it does to save energy.";
  }
}

async function rest() {
  (await lock)?.release();
}

/** What the browser does, in words. */
export function awakeWords() {
  if (navigator.wakeLock) return refusal || "Stays on while you drive, and two minutes longer.";
  return isSecureContext ? "This browser cannot keep it on." : "May go dark: keeping it on needs TLS, see below.";
}
