// Wells of a stored run measured again by another method, beside their first numbers.
//
//   wells, method or its file ──PUT──> the daemon measures in the background ──read every second──> a row per well and method

import { fetchMethods, fetchReplays, measureAgain, Refused } from "./api.ts";
import { element, setText, show } from "./dom.ts";
import { counted, grouped, significant, UM3_PER_NL } from "./format.ts";
import { flagWords } from "./reasons.ts";
import type { ReplayProgress, RunReplays, RunStatus, WellStatus } from "./status.ts";
import { runKey } from "./stored.ts";
import { isBound } from "./wells.ts";

/** Time between two reads while wells are being measured, ms. */
const EVERY_MS = 1000;
/** Value of the choice of a file in place of a method of the configuration. */
const FILE = "";

/** The wells that a reader has typed: `A1, B03-B05` is A01, B03, B04 and B05. A range lies in one row. Pure. */
export function typedWells(text: string): string[] {
  const words = text
    .toUpperCase()
    .split(/[\s,;]+/)
    .filter((w) => w !== "");
  return words.flatMap((word) => {
    const [, row, first, to, last] = /^([A-Z]+)(\d{1,2})(?:[-:]([A-Z]+)(\d{1,2}))?$/.exec(word) ?? [];
    // The daemon refuses the word as it is.
    if (row === undefined || (to !== undefined && (to !== row || Number(last) < Number(first)))) return [word];
    const count = Number(last ?? first) - Number(first) + 1;
    return Array.from({ length: count }, (_, i) => row + String(Number(first) + i).padStart(2, "0"));
  });
}

/** How far it has come: `2 of 5 wells measured by few`. Pure. */
export function progressWords({ name, wells, done, failed, waits }: ReplayProgress): string {
  const failures = failed.map(({ well, reason }) => ` ${well}: ${reason}.`).join("");
  if (done < wells) {
    const end = waits ? ", and waits until the run under way is over." : " …";
    return `${done} of ${counted(wells, "well")} measured by ${name}${end}${failures}`;
  }
  return `${wells - failed.length} of ${counted(wells, "well")} measured by ${name}.${failures}`;
}

/** Difference of a number from the first one: `+1.2 %`. Pure. */
export function difference(first: number | null, again: number | null): string {
  if (first === null || again === null || first === 0) return "–";
  const percent = Number((100 * (again / first - 1)).toFixed(1));
  return `${percent > 0 ? "+" : ""}${grouped(percent, 1)} %`;
}

export class AgainView {
  readonly #panel: HTMLDetailsElement;
  readonly #wells: HTMLInputElement;
  readonly #method: HTMLSelectElement;
  readonly #file: HTMLInputElement;
  readonly #fileLabel: HTMLElement;
  readonly #button: HTMLButtonElement;
  readonly #busy: HTMLElement;
  readonly #words: HTMLElement;
  readonly #table: HTMLElement;
  #run: RunStatus | null = null;
  #found: RunReplays = { progress: null, results: [] };
  /** The run that was read, as it was then. */
  #readOf = "";
  #drawn = "";
  #isBusy = false;
  #isAsking = false;
  #timer: ReturnType<typeof setTimeout> | undefined;

  constructor(find: <T extends Element = HTMLElement>(id: string) => T) {
    this.#panel = find("again");
    this.#wells = find("again-wells");
    this.#method = find("again-method");
    this.#file = find("again-file");
    this.#fileLabel = find("again-file-label");
    this.#button = find("again-start");
    this.#busy = find("again-busy");
    this.#words = find("again-words");
    this.#table = find("again-table");
    this.#panel.addEventListener("toggle", () => this.#open());
    this.#method.addEventListener("change", () => show(this.#fileLabel, this.#method.value === FILE));
    find<HTMLFormElement>("again-form").addEventListener("submit", (event) => {
      event.preventDefault();
      void this.#begin();
    });
  }

  /** A run that has ended can be measured again. `isBusy`: the instrument has a run under way, and the daemon begins nothing. */
  update(run: RunStatus | null, isBusy: boolean): void {
    this.#isBusy = isBusy;
    this.#enable();
    const ended = run !== null && run.outcome !== null ? run : null;
    if (ended === null || this.#run === null || runKey(ended) !== runKey(this.#run)) {
      this.#found = { progress: null, results: [] };
      setText(this.#words, "");
    }
    this.#run = ended;
    show(this.#panel, ended !== null && ended.results.some((w) => w.volume_um3 !== null));
    this.#open();
    this.#draw();
  }

  #open(): void {
    if (!this.#panel.open || this.#run === null) return;
    const now = runKey(this.#run);
    if (now === this.#readOf) return;
    this.#readOf = now;
    void this.#read();
    if (this.#method.options.length === 0) void this.#offer();
  }

  async #offer(): Promise<void> {
    try {
      const offers = await fetchMethods();
      const option = (value: string, words: string) => Object.assign(element("option", "", words), { value });
      this.#method.replaceChildren(...offers.map((m) => option(m.name, m.name)), option(FILE, "of a file …"));
      show(this.#fileLabel, this.#method.value === FILE);
    } catch (error) {
      this.#say("The methods could not be read", error);
    }
  }

  async #read(): Promise<void> {
    const run = this.#run;
    if (run === null) return;
    try {
      this.#take(run, await fetchReplays(run.id));
    } catch (error) {
      this.#readOf = "";
      this.#say("What other methods gave could not be read", error);
    }
  }

  async #begin(): Promise<void> {
    const [run, file] = [this.#run, this.#file.files?.[0]];
    if (run === null) return;
    const isFile = this.#method.value === FILE;
    if (isFile && file === undefined) {
      setText(this.#words, "Choose the file of the method: TOML with the keys of a [methods.NAME] table.");
      return;
    }
    const name = isFile ? file!.name.replace(/\.[^.]*$/, "") : this.#method.value;
    this.#isAsking = true;
    this.#enable();
    try {
      const settings = isFile ? await file!.text() : null;
      this.#take(run, await measureAgain(run.id, name, { wells: typedWells(this.#wells.value), settings }));
    } catch (error) {
      this.#say("Nothing is measured again", error);
    } finally {
      this.#isAsking = false;
      this.#enable();
    }
  }

  #enable(): void {
    this.#button.disabled = this.#isBusy || this.#isAsking;
    show(this.#busy, this.#isBusy);
  }

  #say(what: string, error: unknown): void {
    if (!(error instanceof Refused)) throw error;
    const mistakes = error.mistakes.map((m) => m.detail).join("; ");
    setText(this.#words, `${what}: ${mistakes || error.message}.`);
  }

  #take(run: RunStatus, found: RunReplays): void {
    // Another run was opened meanwhile.
    if (this.#run === null || runKey(this.#run) !== runKey(run)) return;
    this.#found = found;
    const { progress } = found;
    if (progress !== null) setText(this.#words, progressWords(progress));
    clearTimeout(this.#timer);
    if (progress !== null && progress.done < progress.wells)
      this.#timer = setTimeout(() => void this.#read(), EVERY_MS);
    this.#draw();
  }

  #draw(): void {
    const { results } = this.#found;
    const first = new Map(this.#run?.results.map((w) => [w.well, w]));
    const now = JSON.stringify([results, [...first.values()]]);
    if (now === this.#drawn) return;
    this.#drawn = now;
    const wells = [...new Set(results.map((r) => r.result.well))];
    const rows = wells.flatMap((name) => {
      const before = first.get(name);
      const others = results.filter((r) => r.result.well === name);
      return [
        ...(before ? [row(name, `${this.#run!.method}, first`, before, null)] : []),
        ...others.map((r) => row(name, r.name, r.result, before ?? null)),
      ];
    });
    const heads = [
      "Well",
      "Method",
      "Views",
      "Volume, nL",
      "SD, nL",
      "Change",
      "Area, mm²",
      "SD, mm²",
      "Change",
      "Flags",
    ];
    const head = element("tr", "", ...heads.map((text) => Object.assign(element("th", "", text), { scope: "col" })));
    this.#table.replaceChildren(
      ...(rows.length > 0 ? [element("thead", "", head), element("tbody", "", ...rows)] : []),
    );
  }
}

/** A row of numbers; with the well's first numbers, also how far they are from these. */
function row(name: string, method: string, well: WellStatus, first: WellStatus | null): HTMLElement {
  const number = (value: number | null, unit: number, digits: number) =>
    value === null ? "–" : significant(value / unit, digits);
  // An interval around a bound would not contain the true number, nor would a change mean anything.
  const bound = isBound(well);
  const size = (value: number | null, unit: number) =>
    `${bound && value !== null ? "≥ " : ""}${number(value, unit, 4)}`;
  const sd = (value: number | null, unit: number) => number(bound ? null : value, unit, 2);
  const change = (before: number | null, after: number | null) =>
    bound || (first !== null && isBound(first)) ? "–" : difference(before, after);
  const cells = [
    name,
    method,
    well.views === null ? "–" : String(well.views),
    size(well.volume_um3, UM3_PER_NL),
    sd(well.volume_sd_um3, UM3_PER_NL),
    first ? change(first.volume_um3, well.volume_um3) : "",
    size(well.area_um2, 1e6),
    sd(well.area_sd_um2, 1e6),
    first ? change(first.area_um2, well.area_um2) : "",
    well.flags.map(flagWords).join("; "),
  ];
  const made = element("tr", first ? "" : "first", ...cells.map((text) => element("td", "", text)));
  made.dataset["well"] = name;
  made.dataset["method"] = method;
  return made;
}
