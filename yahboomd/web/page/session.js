// Who this page is: the token of a link becomes a cookie that no script can read. A link works once.

const AGAIN_MS = 1000;

const token = () => new URLSearchParams(location.hash.slice(1)).get("token");

// A link that is opened in this tab only changes what is behind the #.
addEventListener("hashchange", () => token() !== null && location.reload());

/**
 * Exchange the token, if the address has one, and ask for the role.
 * Returns `{ role, robot, name }`, or `{ problem }`: why this page gets nothing.
 */
export async function openSession() {
  const given = token();
  // Do this first: the address ends up in screenshots and bookmarks.
  if (given !== null) history.replaceState(null, "", location.pathname);
  const refused = given === null ? "" : await enter(given);
  const answer = await fetch("/session");
  // A link of the history was used, and this phone got its session by it.
  if (answer.ok) return answer.json();
  return { problem: refused || (await answer.json()).text };
}

/** Returns why the link is refused, or "". Without a network it is tried again: it is not used up yet. */
async function enter(given) {
  for (;;) {
    try {
      const headers = { "Content-Type": "application/json" };
      const answer = await fetch("/session", { method: "POST", headers, body: JSON.stringify({ token: given }) });
      return answer.ok ? "" : (await answer.json()).text;
    } catch {
      await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    }
  }
}

/** Why this page has no session any more, or "": also while that is not known. */
export async function sessionProblem() {
  try {
    const answer = await fetch("/session");
    return answer.status === 401 ? (await answer.json()).text : "";
  } catch {
    return "";
  }
}
