// The name of the person at the page, kept in this browser. Events of a run name who asked for something.

import { remember, remembered } from "./remembered.ts";
import { show } from "./dom.ts";

const OPERATOR = "carved.operator";
/** Set once the person did not want to give a name. */
const NO_NAME = "carved.operator.none";

/** The name, or an empty text if nobody gave one. */
export function person(): string {
  return remembered(OPERATOR) ?? "";
}

export function keepPerson(name: string): void {
  remember(OPERATOR, name.trim());
}

/** The name as the query of a command; empty without one. */
export function byPerson(): string {
  const name = person();
  return name === "" ? "" : `?by=${encodeURIComponent(name)}`;
}

/** Asks once for the name of a person who has given a command without one. The command does not wait for it. */
export class NameRequest {
  readonly #form: HTMLFormElement;
  readonly #name: HTMLInputElement;
  /** Other fields of the page that want the name. */
  readonly #fields: readonly HTMLInputElement[];

  constructor(find: <T extends Element = HTMLElement>(id: string) => T) {
    this.#form = find("who");
    this.#name = find("who-name");
    this.#fields = [find("operator"), find("remark-by")];
    this.#form.addEventListener("submit", (event) => {
      event.preventDefault();
      const name = this.#name.value.trim();
      if (name === "") return;
      keepPerson(name);
      for (const field of this.#fields) field.value ||= name;
      show(this.#form, false);
    });
    find("who-not").addEventListener("click", () => {
      remember(NO_NAME, "1");
      show(this.#form, false);
    });
  }

  /** A command was given. */
  commanded(): void {
    if (person() === "" && remembered(NO_NAME) === null) show(this.#form, true);
  }
}
