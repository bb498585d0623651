// A report of a person that takes effect after a few seconds, in which it can be undone. It takes the place of a question where the same
// report is made hundreds of times a day.

import { setText, show } from "./dom.ts";

/** How long a report can be undone, ms. */
const WAIT_MS = 4000;

export class Undo {
  readonly #bar: HTMLElement;
  readonly #words: HTMLElement;
  #answered: ((yes: boolean) => void) | null = null;

  constructor(find: <T extends Element = HTMLElement>(id: string) => T) {
    this.#bar = find("undo");
    this.#words = find("undo-words");
    find("undo-button").addEventListener("click", () => this.dismiss());
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.dismiss();
    });
  }

  get isOpen(): boolean {
    return this.#answered !== null;
  }

  /** Waits until the time for an undo is over. Returns whether the report stands. */
  async wait(words: string): Promise<boolean> {
    this.dismiss();
    setText(this.#words, `${words}. Reported in ${WAIT_MS / 1000} s.`);
    show(this.#bar, true);
    const stands = await new Promise<boolean>((resolve) => {
      this.#answered = resolve;
      setTimeout(() => {
        if (this.#answered === resolve) resolve(true);
      }, WAIT_MS);
    });
    if (stands) this.#close();
    return stands;
  }

  /** Undoes the report, also where its subject is over. */
  dismiss(): void {
    const answered = this.#answered;
    this.#close();
    answered?.(false);
  }

  #close(): void {
    this.#answered = null;
    show(this.#bar, false);
  }
}
