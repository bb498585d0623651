// The well that was finished last, beside the one under way, so that its numbers do not flash by.

import { element } from "./dom.ts";
import { unbroken } from "./format.ts";
import type { RunStatus, WellStatus } from "./status.ts";
import { runKey } from "./stored.ts";
import { doneWords } from "./wells.ts";

export class LastDone {
  readonly #line: HTMLElement;
  readonly #choose: (well: string) => void;
  #run = "";
  #done = new Set<string>();
  #last: string | null = null;
  #drawn = "";

  constructor(line: HTMLElement, choose: (well: string) => void) {
    this.#line = line;
    this.#choose = choose;
  }

  /** `shown` is the well on the card. */
  update(run: RunStatus | null, shown: string | null): void {
    const done = run?.results.filter((well) => well.outcome !== null) ?? [];
    const key = run === null ? "" : runKey(run);
    const isNew = (well: WellStatus) => !this.#done.has(well.well);
    // At first only the order of the plan is known.
    this.#last = key === this.#run ? (done.findLast(isNew)?.well ?? this.#last) : (done.at(-1)?.well ?? null);
    this.#run = key;
    this.#done = new Set(done.map((well) => well.well));
    const last = done.find((well) => well.well === this.#last);
    const isShown = last !== undefined && run?.outcome === null && last.well !== shown;
    this.#line.hidden = !isShown;
    if (!isShown) return;
    const words = unbroken(doneWords(last));
    if (this.#drawn === `${last.well} ${words}`) return;
    this.#drawn = `${last.well} ${words}`;
    const button = element("button", "well-link", last.well);
    button.type = "button";
    button.addEventListener("click", () => this.#choose(last.well));
    this.#line.replaceChildren("Finished last: ", button, ` ${words}.`);
  }
}
