// The emergency stop: visible and in reach at every moment. It is outside of everything that a question makes inert, and its answer is
// beside it, so that neither scrolls away.
//
//   press ──> sending ──confirmed──> sent ──fault acknowledged──> idle
//               │ ^
//      refused, │ │ pause
//      silence  v │
//            unconfirmed ──withdrawn──> idle            (also after the page is loaded again)

import { post, Refused } from "./api.ts";
import { setText, show } from "./dom.ts";
import { byPerson } from "./person.ts";
import { remember, remembered } from "./remembered.ts";
import type { Status } from "./status.ts";

/** Works wherever the focus is. No browser uses it. */
const KEY = "F8";
/** How long one attempt waits for its answer, ms. */
const ATTEMPT_MS = 2000;
/** Pause between two attempts, ms. */
const PAUSE_MS = 500;
/** Where a stop that is not confirmed is kept while the page is loaded again. */
const KEPT = "carved.emergency-stop";
/** Age at which a kept stop is no longer sent, ms: a tab that is restored later must not stop another run. */
const KEPT_MS = 10 * 60_000;

interface Parts {
  button: HTMLButtonElement;
  answer: HTMLElement;
  /** The bar over the full width. */
  bar: HTMLElement;
  words: HTMLElement;
  withdraw: HTMLButtonElement;
}

export class EmergencyStop {
  readonly #parts: Parts;
  #state: "idle" | "sending" | "sent" = "idle";
  /** Counts the presses and withdrawals. The attempts of an older one end. */
  #order = 0;
  /** Whether the newest status has the fault of a stop. */
  #isLatched = false;
  /** Whether that fault was seen since the stop came through. */
  #wasLatched = false;

  constructor(parts: Parts) {
    this.#parts = parts;
    parts.button.addEventListener("click", () => void this.#press(Date.now()));
    parts.withdraw.addEventListener("click", () => this.#withdraw());
    // Before any other listener. A key that is held down sends one stop.
    const onKey = (event: KeyboardEvent) => {
      if (event.key !== KEY) return;
      event.preventDefault();
      if (!event.repeat) void this.#press(Date.now());
    };
    window.addEventListener("keydown", onKey, { capture: true });
    const kept = keptSince();
    if (kept !== null) void this.#press(kept);
  }

  /** The answer stays until the fault was shown and acknowledged. */
  update(status: Status): void {
    this.#isLatched = status.faults.some((fault) => fault.code === "emergency_stop");
    if (this.#state !== "sent") return;
    this.#wasLatched ||= this.#isLatched;
    if (!this.#wasLatched || this.#isLatched) return;
    this.#state = "idle";
    show(this.#parts.answer, false);
  }

  /** Sends the stop until it is confirmed or withdrawn. `since` is the time of the press, ms since 1970. */
  async #press(since: number): Promise<void> {
    const order = (this.#order += 1);
    this.#state = "sending";
    keep(since);
    this.#answer("Emergency stop: sending ...");
    for (;;) {
      const why = await send();
      if (order !== this.#order) return;
      if (why === null) break;
      this.#unconfirmed(since, why);
      await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
      if (order !== this.#order) return;
    }
    keep(null);
    this.#state = "sent";
    this.#wasLatched = this.#isLatched;
    show(this.#parts.bar, false);
    this.#answer("Emergency stop: the motors were stopped.");
  }

  #withdraw(): void {
    this.#order += 1;
    this.#state = "idle";
    keep(null);
    show(this.#parts.bar, false);
    show(this.#parts.answer, false);
  }

  #unconfirmed(since: number, why: string): void {
    show(this.#parts.answer, false);
    const pressed = new Date(since).toLocaleTimeString();
    setText(
      this.#parts.words,
      `The emergency stop of ${pressed} was not confirmed: ${why}. Use the instrument's own emergency stop, or cut its power. The page sends it again until it is confirmed or withdrawn.`,
    );
    show(this.#parts.bar, true);
  }

  #answer(words: string): void {
    setText(this.#parts.answer, words);
    show(this.#parts.answer, true);
  }
}

/** Sends the stop once. Returns why it was not confirmed, or null. */
async function send(): Promise<string | null> {
  try {
    await post(`/v1/emergency-stop${byPerson()}`, ATTEMPT_MS);
    return null;
  } catch (error) {
    return error instanceof Refused ? error.message : String(error);
  }
}

/** Keeps the time of a stop that is not confirmed. */
function keep(since: number | null): void {
  remember(KEPT, since === null ? null : String(since), "the tab");
}

/** The time of a stop that the page before this one could not confirm, ms since 1970. */
function keptSince(): number | null {
  const since = Number(remembered(KEPT, "the tab") ?? "0");
  return Date.now() - since < KEPT_MS ? since : null;
}
