// The live picture while no run is under way: focus, dust, loading. It is taken on request, one after the other, and ends with the next run,
// after some minutes, and when nobody can see the page.

import { Refused, takePicture } from "./api.ts";
import { show } from "./dom.ts";
import { canStart } from "./plain.ts";
import type { Status } from "./status.ts";

/** Pause between two pictures, ms. */
const PAUSE_MS = 700;
/** Pictures come for so long, ms: a page that somebody has left open does not switch the light for days. */
const LONGEST_MS = 600_000;

interface Parts {
  label: HTMLElement;
  choice: HTMLInputElement;
}

export class LiveAtRest {
  readonly #parts: Parts;
  readonly #shown: (picture: Blob) => Promise<void>;
  readonly #ended: (why: string | null) => void;
  #runs = false;
  /** When the pictures end by themselves, ms. */
  #until = 0;

  /** `ended` is told why no more pictures come; null if nobody asks for them any more. */
  constructor(parts: Parts, shown: (picture: Blob) => Promise<void>, ended: (why: string | null) => void) {
    this.#parts = parts;
    this.#shown = shown;
    this.#ended = ended;
    parts.choice.addEventListener("change", () => {
      this.#until = performance.now() + LONGEST_MS;
      if (parts.choice.checked) void this.#follow();
    });
    document.addEventListener("visibilitychange", () => {
      if (document.hidden) this.end();
    });
  }

  get isOn(): boolean {
    return this.#parts.choice.checked;
  }

  /** Takes no more pictures. */
  end(): void {
    this.#parts.choice.checked = false;
  }

  /** `isOwn`: the instrument's own run is shown, and not a stored one. */
  update(status: Status, isOwn: boolean): void {
    const may = canStart(status) && isOwn;
    show(this.#parts.label, may);
    if (!may) this.end();
  }

  async #follow(): Promise<void> {
    if (this.#runs) return;
    this.#runs = true;
    let why: string | null = null;
    try {
      while (this.isOn && performance.now() < this.#until) {
        const picture = await takePicture();
        if (this.isOn) await this.#shown(picture);
        await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
      }
    } catch (error) {
      const isLate = error instanceof DOMException;
      if (!(error instanceof Refused) && !isLate) throw error;
      // A run that begins ends the wait for a picture.
      if (this.isOn) why = isLate ? "no picture came in time" : error.message;
    } finally {
      this.#runs = false;
      this.end();
      this.#ended(why);
    }
  }
}
