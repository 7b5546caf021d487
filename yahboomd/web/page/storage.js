// Settings of this browser, and what a tab keeps over a reload. It may refuse: then they last as long as the page.

export const ofTab = () => sessionStorage;
const ofBrowser = () => localStorage;

/** What was kept; null if nothing was. */
export function kept(key, where = ofBrowser) {
  try {
    return where().getItem(key);
  } catch {
    return null;
  }
}

/** Keep it for the next page. */
export function keep(key, value, where = ofBrowser) {
  try {
    where().setItem(key, value);
  } catch {
    // The next page starts as usual.
  }
}
