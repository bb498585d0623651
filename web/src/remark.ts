// What a person says about the well on the card: a remark with tags, its exclusion from statistics, and whether it is skipped or measured
// again. A held run does this itself. Of a run that has ended, the well becomes the plan of a new run.

import { noteWell, redoWell, Refused, skipWell } from "./api.ts";
import { setText, show } from "./dom.ts";
import { keepPerson, person } from "./person.ts";
import type { NoteOnWell, RunStatus, WellStatus } from "./status.ts";

/** Tags as a reader types them: `twin, oedema`. Pure. */
export function typedTags(text: string): string[] {
  const tags = text.split(/[,;]/).map((tag) => tag.trim());
  return [...new Set(tags.filter((tag) => tag !== ""))];
}

/** What can be asked for about a well. Pure. */
export function choices(
  run: RunStatus | null,
  well: WellStatus | null,
  isHeld: boolean,
): { skip: boolean; redo: boolean } {
  const isOpen = run !== null && run.outcome === null;
  const has = well !== null && well.outcome !== null;
  return { skip: isOpen && isHeld && well !== null && !has, redo: has && (isHeld || !isOpen) };
}

/** What is typed about a well. */
interface Typed {
  comment: string;
  tags: string;
  excluded: boolean;
}

const typedOf = (note: WellStatus["note"]): Typed => ({
  comment: note?.comment ?? "",
  tags: note?.tags.join(", ") ?? "",
  excluded: note?.excluded ?? false,
});

const isSame = (a: Typed, b: Typed) =>
  a.comment.trim() === b.comment.trim() &&
  a.excluded === b.excluded &&
  typedTags(a.tags).join() === typedTags(b.tags).join();

export class Remark {
  readonly #panel: HTMLDetailsElement;
  readonly #by: HTMLInputElement;
  readonly #comment: HTMLInputElement;
  readonly #tags: HTMLInputElement;
  readonly #excluded: HTMLInputElement;
  readonly #skip: HTMLButtonElement;
  readonly #redo: HTMLButtonElement;
  readonly #words: HTMLElement;
  readonly #planAgain: (run: string, well: string) => Promise<void>;
  readonly #said: (run: string) => void;
  #run: RunStatus | null = null;
  #well: WellStatus | null = null;
  /** The well that the fields are about, the time of its remark, and what the fields were filled with. */
  #of = "";
  #time: string | undefined;
  #filled: Typed = typedOf(null);
  /** What was typed about other wells and not saved. */
  readonly #unsaved = new Map<string, Typed>();

  /** `planAgain` makes a new run of one well of a run that has ended. `said` hears that a remark about a well of a run is kept. */
  constructor(
    find: <T extends Element = HTMLElement>(id: string) => T,
    planAgain: (run: string, well: string) => Promise<void>,
    said: (run: string) => void,
  ) {
    this.#panel = find("remark");
    this.#by = find("remark-by");
    this.#comment = find("remark-comment");
    this.#tags = find("remark-tags");
    this.#excluded = find("remark-excluded");
    this.#skip = find("skip-well");
    this.#redo = find("redo-well");
    this.#words = find("remark-words");
    this.#planAgain = planAgain;
    this.#said = said;
    find<HTMLFormElement>("remark-form").addEventListener("submit", (event) => {
      event.preventDefault();
      void this.#ask((run, well) => this.#keep(run, well), "The remark is kept");
    });
    const says = () => ({ by: this.#by.value.trim(), reason: this.#comment.value.trim() });
    this.#skip.addEventListener("click", () => {
      void this.#ask((run, well) => skipWell(run, well, says()), "The well is skipped");
    });
    this.#redo.addEventListener("click", () => {
      if (this.#run?.outcome !== null) void this.#ask(this.#planAgain, "The new run is planned above");
      else
        void this.#ask((run, well) => redoWell(run, well, says()), "The well is measured again when the run goes on");
    });
  }

  update(run: RunStatus | null, well: WellStatus | null, isHeld: boolean): void {
    show(this.#panel, run !== null && well !== null);
    this.#run = run;
    this.#well = well;
    const { skip, redo } = choices(run, well, isHeld);
    show(this.#skip, skip);
    show(this.#redo, redo);
    const note = well?.note ?? null;
    const of = `${run?.id} ${well?.well}`;
    if (of === this.#of && note?.time === this.#time) return;
    const [typed, stored] = [this.#typed(), typedOf(note)];
    const isUnsaved = !isSame(typed, this.#filled) && !isSame(typed, stored);
    this.#time = note?.time;
    if (of === this.#of) {
      this.#filled = stored;
      if (!isUnsaved) return this.#fill(stored);
      // The remark of another person must not take away what is typed here.
      const other = note === null ? "The remark was removed meanwhile" : `${note.by} has saved a remark meanwhile`;
      setText(this.#words, `${other}: ${stored.comment || "without words"}. What is typed here is not saved yet.`);
      return;
    }
    // What is typed about one well must not be said of another one, and comes back with its own.
    if (isUnsaved) this.#unsaved.set(this.#of, typed);
    this.#of = of;
    this.#filled = stored;
    const kept = this.#unsaved.get(of);
    this.#unsaved.delete(of);
    this.#by.value = person();
    this.#fill(kept ?? stored);
    setText(this.#words, kept === undefined ? "" : "What is typed here is not saved yet.");
  }

  #typed(): Typed {
    return { comment: this.#comment.value, tags: this.#tags.value, excluded: this.#excluded.checked };
  }

  #fill({ comment, tags, excluded }: Typed): void {
    this.#comment.value = comment;
    this.#tags.value = tags;
    this.#excluded.checked = excluded;
  }

  #note(): NoteOnWell {
    return {
      by: this.#by.value.trim(),
      excluded: this.#excluded.checked,
      comment: this.#comment.value.trim(),
      tags: typedTags(this.#tags.value),
    };
  }

  async #keep(run: string, well: string): Promise<void> {
    const [typed, of] = [this.#typed(), this.#of];
    await noteWell(run, well, this.#note());
    // The status of a stored run does not bring it.
    if (this.#of === of) this.#filled = typed;
    const kept = this.#unsaved.get(of);
    if (kept !== undefined && isSame(kept, typed)) this.#unsaved.delete(of);
    this.#said(run);
  }

  async #ask(send: (run: string, well: string) => Promise<void>, done: string): Promise<void> {
    const [run, well] = [this.#run?.id, this.#well?.well];
    if (run === undefined || well === undefined) return;
    keepPerson(this.#by.value);
    const of = this.#of;
    try {
      await send(run, well);
      if (this.#of === of) setText(this.#words, `${done}.`);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      const names: Record<string, string> = { "/by": "your name", "/comment": "the reason", "/reason": "the reason" };
      const mistakes = error.mistakes.map((m) => `${names[m.pointer ?? ""] ?? m.pointer}: ${m.detail}`).join("; ");
      setText(this.#words, `Nothing was changed: ${mistakes || error.message}.`);
    }
  }
}
