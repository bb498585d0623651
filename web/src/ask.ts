// A dialog with one question before an irreversible action. A second question replaces the first.

import { setText } from "./dom.ts";

export interface Question {
  title: string;
  words: string;
  no: string;
  yes: string;
  /** Whether the action ends something. */
  ends: boolean;
}

export class Asker {
  readonly #dialog: HTMLDialogElement;
  readonly #parts: Record<"title" | "words" | "no" | "yes", HTMLElement>;
  #answered: ((yes: boolean) => void) | null = null;

  constructor(find: <T extends Element = HTMLElement>(id: string) => T) {
    this.#dialog = find("ask");
    this.#parts = { title: find("ask-title"), words: find("ask-words"), no: find("ask-no"), yes: find("ask-yes") };
    this.#dialog.addEventListener("close", () => {
      const yes = this.#dialog.returnValue === "yes";
      this.#dialog.returnValue = "";
      this.#answered?.(yes);
      this.#answered = null;
    });
  }

  ask(question: Question): Promise<boolean> {
    for (const part of ["title", "words", "no", "yes"] as const) setText(this.#parts[part], question[part]);
    this.#parts.yes.className = question.ends ? "button button-alarm" : "button button-go";
    this.#dialog.showModal();
    return new Promise((resolve) => (this.#answered = resolve));
  }

  /** The subject of the question is over: closes the dialog, so that an answer does not apply to the next question. */
  dismiss(): void {
    if (this.#dialog.open) this.#dialog.close();
  }
}
