// The name of the person at the page, kept in this browser. Events of a run name who asked for something.

const OPERATOR = "carved.operator";

/** The name, or an empty text if nobody gave one. */
export function person(): string {
  return localStorage.getItem(OPERATOR) ?? "";
}

export function keepPerson(name: string): void {
  localStorage.setItem(OPERATOR, name.trim());
}

/** The name as the query of a command; empty without one. */
export function byPerson(): string {
  const name = person();
  return name === "" ? "" : `?by=${encodeURIComponent(name)}`;
}
