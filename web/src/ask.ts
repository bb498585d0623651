// A dialog with one question before an irreversible action. A second question replaces the first.
//
// The dialog is not modal for the browser, because a modal dialog makes the emergency stop inert. Everything else is made inert here.

import { setText, show } from "./dom.ts";

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
  readonly #shade: HTMLElement;
  readonly #parts: Record<"title" | "words" | "no" | "yes", HTMLElement>;
  #answered: ((yes: boolean) => void) | null = null;

  constructor(find: <T extends Element = HTMLElement>(id: string) => T) {
    this.#dialog = find("ask");
    this.#shade = find("ask-shade");
    this.#parts = { title: find("ask-title"), words: find("ask-words"), no: find("ask-no"), yes: find("ask-yes") };
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.dismiss();
    });
    this.#dialog.addEventListener("close", () => {
      this.#block(false);
      const yes = this.#dialog.returnValue === "yes";
      this.#dialog.returnValue = "";
      this.#answered?.(yes);
      this.#answered = null;
    });
  }

  ask(question: Question): Promise<boolean> {
    this.reword(question);
    this.#parts.yes.className = question.ends ? "button button-alarm" : "button button-go";
    this.#block(true);
    this.#dialog.show();
    return new Promise((resolve) => (this.#answered = resolve));
  }

  /** What the question says has changed while it stands. */
  reword(question: Question): void {
    for (const part of ["title", "words", "no", "yes"] as const) setText(this.#parts[part], question[part]);
  }

  /** Blocks what is beside the question, except for the header with the emergency stop. */
  #block(isAsked: boolean): void {
    show(this.#shade, isAsked);
    for (const part of document.querySelectorAll("body > main, body > form")) part.toggleAttribute("inert", isAsked);
  }

  /** The subject of the question is over: closes the dialog, so that an answer does not apply to the next question. */
  dismiss(): void {
    if (this.#dialog.open) this.#dialog.close();
  }
}
