// What the browser remembers for the page: choices and the operator's name for good, the token and an unconfirmed stop until the tab is closed.
// A browser that gives no storage, as some do for pages of another network, remembers until the page is left. Nothing here throws.

export type For = "good" | "the tab";

const ofThisPage = new Map<string, string>();

const storage = (long: For): Storage => (long === "good" ? localStorage : sessionStorage);

/** What was remembered under a key; null if nothing was. */
export function remembered(key: string, long: For = "good"): string | null {
  try {
    return storage(long).getItem(key);
  } catch {
    return ofThisPage.get(key) ?? null;
  }
}

/** Remembers a value under a key. Null forgets it. */
export function remember(key: string, value: string | null, long: For = "good"): void {
  try {
    if (value === null) storage(long).removeItem(key);
    else storage(long).setItem(key, value);
  } catch {
    if (value === null) ofThisPage.delete(key);
    else ofThisPage.set(key, value);
  }
}
