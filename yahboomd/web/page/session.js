// Who this page is: the token of the link becomes a cookie that no script can read.

/**
 * Exchange the token, if the address has one, and ask for the role.
 * Returns `{ role, robot }`, or `{ problem }`: why this page gets nothing.
 */
export async function openSession() {
  const token = new URLSearchParams(location.hash.slice(1)).get("token");
  if (token !== null) {
    // Do this first: a token in the address would end up in screenshots and bookmarks.
    history.replaceState(null, "", location.pathname);
    const answer = await fetch("/session", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ token }),
    });
    if (answer.status === 429) return { problem: "Too many attempts. Wait a minute, then open the link again." };
    if (!answer.ok) return { problem: "The robot does not accept this link." };
  }
  const answer = await fetch("/session");
  if (answer.ok) return answer.json();
  return { problem: "This page is opened by its link, or by its QR code." };
}
