// The emergency stop: visible and in reach at every moment. It is outside of everything that a question makes inert, and its answer is
// beside it, so that neither scrolls away.

import { post, Refused } from "./api.ts";
import { setText, show } from "./dom.ts";
import type { Status } from "./status.ts";

/** Works wherever the focus is. No browser uses it. */
const KEY = "F8";
export class EmergencyStop {
  readonly #answer: HTMLElement;
  #shown: "nothing" | "sending" | "sent" | "failed" = "nothing";
  /** Whether the newest status has the fault of a stop. */
  #isLatched = false;
  /** Whether that fault was seen since the stop came through. */
  #wasLatched = false;

  constructor(button: HTMLButtonElement, answer: HTMLElement) {
    this.#answer = answer;
    button.addEventListener("click", () => void this.#press());
    // Before any other listener. A key that is held down sends one stop.
    const onKey = (event: KeyboardEvent) => {
      if (event.key !== KEY) return;
      event.preventDefault();
      if (!event.repeat) void this.#press();
    };
    window.addEventListener("keydown", onKey, { capture: true });
  }

  /** The answer stays until the fault was shown and acknowledged. A stop that failed stays until the next one. */
  update(status: Status): void {
    this.#isLatched = status.faults.some((fault) => fault.code === "emergency_stop");
    if (this.#shown !== "sent") return;
    this.#wasLatched ||= this.#isLatched;
    if (!this.#wasLatched || this.#isLatched) return;
    this.#shown = "nothing";
    show(this.#answer, false);
  }

  async #press(): Promise<void> {
    this.#say("sending", "Emergency stop: sending ...");
    try {
      await post("/v1/emergency-stop");
      this.#say("sent", "Emergency stop: the motors were stopped.");
    } catch (error) {
      const why = error instanceof Refused ? error.message : String(error);
      this.#say(
        "failed",
        `The emergency stop was not confirmed: ${why}. Use the instrument's own emergency stop, or cut its power.`,
      );
    }
  }

  #say(shown: "sending" | "sent" | "failed", words: string): void {
    this.#shown = shown;
    this.#wasLatched = this.#isLatched;
    setText(this.#answer, words);
    show(this.#answer, true);
  }
}
