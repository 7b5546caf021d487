// Settings of this browser. It may refuse: then they last as long as the page.

/** What was kept; null if nothing was. */
export function kept(key) {
  try {
    return localStorage.getItem(key);
  } catch {
    return null;
  }
}

/** Keep it for the next page. */
export function keep(key, value) {
  try {
    localStorage.setItem(key, value);
  } catch {
    // The next page starts as usual.
  }
}
