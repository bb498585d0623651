// Abort, with one question before and plain words after.

import { abortRun, Refused } from "./api.ts";
import { setText, show } from "./dom.ts";
import { canAbort } from "./plain.ts";
import type { Status } from "./status.ts";

export class AbortControl {
  readonly #button: HTMLButtonElement;
  readonly #dialog: HTMLDialogElement;
  readonly #question: HTMLElement;
  readonly #answer: HTMLElement;
  #run: string | null = null;

  constructor(button: HTMLButtonElement, dialog: HTMLDialogElement, question: HTMLElement, answer: HTMLElement) {
    this.#button = button;
    this.#dialog = dialog;
    this.#question = question;
    this.#answer = answer;
    button.addEventListener("click", () => dialog.showModal());
    dialog.addEventListener("close", () => {
      if (dialog.returnValue === "abort") void this.#abort();
      dialog.returnValue = "";
    });
  }

  update(status: Status): void {
    const run = status.run;
    const running = run !== null && run.outcome === null;
    const another = (run?.id ?? null) !== this.#run;
    this.#run = run?.id ?? null;
    if (another) show(this.#answer, false);
    // A question about a run that has ended meanwhile must not be answered for the next one.
    if ((another || !running) && this.#dialog.open) this.#dialog.close();
    show(this.#button, running);
    this.#button.disabled = !canAbort(status);
    setText(this.#button, status.pending.abort || status.state === "Aborting" ? "Aborting…" : "Abort run");
    if (running) setText(this.#question, `Abort run ${run.id}?`);
  }

  async #abort(): Promise<void> {
    const run = this.#run;
    if (run === null) return;
    this.#button.disabled = true;
    try {
      await abortRun(run);
      setText(this.#answer, `Abort of run ${run} was accepted.`);
    } catch (error) {
      this.#button.disabled = false;
      const why = error instanceof Refused ? error.message : String(error);
      setText(
        this.#answer,
        `Abort of run ${run} did not get through: ${why}. Use the instrument's own emergency stop if it must halt now.`,
      );
    }
    show(this.#answer, true);
  }
}
