// The list of all runs, and the run that the reader has opened from it.
//
//   GET /v1/runs, a page at a time ──> rows that fit the search ──click──> GET /v1/runs/{id} ──> asStatus ──> the page's views
//
// An opened run has the views of a live one. The sentence, the faults and the commands stay those of the instrument. A run that is opened
// while the instrument works on it is shown as the instrument has it, and read again when it has ended.

import { fetchRun, fetchRuns, Refused } from "./api.ts";
import { bringIntoView, element, setText, show } from "./dom.ts";
import { downloadLink } from "./downloads.ts";
import { bytes, counted, day } from "./format.ts";
import { Latest } from "./latest.ts";
import { OUTCOMES } from "./plain.ts";
import type { RunDetail, RunOutcome, RunRow, RunStatus, Status } from "./status.ts";
import { runKey } from "./stored.ts";

/** A stored run in the place of the instrument's own: nothing moves, nothing is asked of anybody. Pure. */
export function asStatus(detail: RunDetail, live: Status): Status {
  const { id, external_id, method, operator, results, wells, started, ended, outcome } = detail;
  return {
    ...live,
    state: "Complete",
    faults: [],
    specimen: null,
    plate: { barcode: detail.plate_barcode, present: false, removable: true, needs: null, take_out: null, bring: null },
    run: {
      ...{ id, external_id, method, operator, results, wells, started, ended, outcome },
      ...{ eta_s: null, goes_on_by_itself: false, held_by_operator: false, hold: null },
    },
  };
}

/** Whether a run was under way when it was read, and the instrument has it. Pure. */
export function isOwn(detail: Pick<RunDetail, "id" | "started" | "outcome">, run: RunStatus | null): boolean {
  return detail.outcome === null && run !== null && runKey(run) === runKey(detail);
}

/** Whether a run may have ended since it was read. Pure. */
export function mayHaveEnded(detail: Pick<RunDetail, "id" | "started" | "outcome">, run: RunStatus | null): boolean {
  return detail.outcome === null && (!isOwn(detail, run) || run?.outcome != null);
}

/** Whether every word of the search is in a run's name, barcode, operator, method, mode, day or outcome. Pure. */
export function fits(run: RunRow, search: string): boolean {
  const text = [run.id, run.plate_barcode, run.operator, run.method, run.mode, day(run.started), outcomeWords(run)]
    .join(" ")
    .toLowerCase();
  return search
    .toLowerCase()
    .split(/\s+/)
    .every((word) => text.includes(word));
}

function outcomeWords(run: Pick<RunRow, "outcome">): string {
  return run.outcome === null ? "under way" : (OUTCOMES[run.outcome as RunOutcome] ?? run.outcome);
}

/** Where copies of a run are, or that none is known. Pure. */
export function copyWords({ copies }: Pick<RunDetail, "copies">): string {
  const [newest, ...older] = copies;
  if (newest === undefined) return "No copy of this run is recorded: `carved archive` makes one and checks it.";
  const more =
    older.length === 0 ? "" : ` ${counted(older.length, "earlier copy").replace(/copys$/, "copies")} as well.`;
  return `Copied to ${newest.destination} on ${day(newest.archived)}: ${counted(newest.files, "file")}, ${bytes(newest.bytes)}, each read again after copying.${more}`;
}

interface Parts {
  panel: HTMLDetailsElement;
  search: HTMLInputElement;
  outcome: HTMLSelectElement;
  mode: HTMLSelectElement;
  compound: HTMLInputElement;
  table: HTMLElement;
  words: HTMLElement;
  more: HTMLButtonElement;
  refresh: HTMLButtonElement;
}

export class RunList {
  readonly #parts: Parts;
  readonly #open: (run: string) => void;
  #runs: RunRow[] = [];
  #next: string | null = null;
  #isLoaded = false;

  constructor(find: <T extends Element = HTMLElement>(id: string) => T, open: (run: string) => void) {
    this.#open = open;
    this.#parts = {
      panel: find("runs"),
      search: find("runs-search"),
      outcome: find("runs-outcome"),
      mode: find("runs-mode"),
      compound: find("runs-compound"),
      table: find("runs-table"),
      words: find("runs-words"),
      more: find("runs-more"),
      refresh: find("runs-refresh"),
    };
    const { panel, search, outcome, mode, compound, more, refresh } = this.#parts;
    panel.addEventListener("toggle", () => {
      if (panel.open && !this.#isLoaded) void this.#load(null);
    });
    search.addEventListener("input", () => this.#draw());
    more.addEventListener("click", () => void this.#load(this.#next));
    for (const choice of [outcome, mode, compound]) choice.addEventListener("change", () => void this.#load(null));
    refresh.addEventListener("click", () => void this.#load(null));
  }

  async #load(after: string | null): Promise<void> {
    const { more, refresh, words, outcome, mode, compound } = this.#parts;
    const filter = { outcome: outcome.value, mode: mode.value, compound: compound.value.trim() };
    more.disabled = refresh.disabled = true;
    try {
      const page = await fetchRuns(after, filter);
      // Another choice was made meanwhile, and its own runs come.
      if (filter.outcome !== outcome.value || filter.mode !== mode.value) return;
      if (filter.compound !== compound.value.trim()) return;
      this.#runs = after === null ? page.runs : [...this.#runs, ...page.runs];
      this.#next = page.next;
      this.#isLoaded = true;
      this.#draw();
    } catch (error) {
      setText(words, `The runs could not be read: ${error instanceof Refused ? error.message : String(error)}.`);
    } finally {
      more.disabled = refresh.disabled = false;
    }
  }

  #draw(): void {
    const { table, words, more, search } = this.#parts;
    const shown = this.#runs.filter((run) => fits(run, search.value));
    const heads = ["Run", "Plate", "Started", "Outcome", "Wells", "Method", "Operator", "Mode"];
    const head = element("tr", "", ...heads.map((name) => element("th", "", name)));
    table.replaceChildren(element("thead", "", head), element("tbody", "", ...shown.map((run) => this.#row(run))));
    const all = this.#next === null ? "" : " More runs are older.";
    setText(words, `${shown.length} of ${this.#runs.length} runs.${all}`);
    show(more, this.#next !== null);
  }

  #row(run: RunRow): HTMLElement {
    const open = element("button", "well-link", run.id);
    open.type = "button";
    open.addEventListener("click", () => this.#open(run.id));
    const { succeeded, flagged, total } = run.wells;
    const cells = [
      run.plate_barcode,
      day(run.started),
      outcomeWords(run),
      `${succeeded + flagged} of ${total} measured`,
      run.method,
      run.operator,
      run.mode,
    ];
    return element("tr", "", element("td", "", open), ...cells.map((text) => element("td", "", text)));
  }
}

interface Heard {
  /** Another run is opened, or none any more. */
  opened: () => void;
  /** The opened run was read again. */
  read: () => void;
}

/** The page's address with this run in it. */
function addressOf(run: RunDetail | null): URL {
  const address = new URL(location.href);
  if (run === null) address.searchParams.delete("run");
  else address.searchParams.set("run", run.id);
  return address;
}

/** The run that the reader has opened from the list. Its name is in the page's address, and the browser's own buttons lead from run to run. */
export class OpenedRun {
  readonly #banner: HTMLElement;
  readonly #words: HTMLElement;
  readonly #copies: HTMLElement;
  readonly #files: HTMLElement;
  readonly #heard: Heard;
  readonly #again = new Latest(() => this.#readAgain());
  #detail: RunDetail | null = null;
  #status: Status | null = null;
  /** Number of times that a run was opened or closed. Only the newest counts. */
  #asked = 0;
  /** The status after which the run was read again. */
  #readAt = "";
  /** Something was said about a well of the run since it was read. */
  #isOld = false;

  constructor(find: <T extends Element = HTMLElement>(id: string) => T, heard: Heard) {
    this.#banner = find("opened");
    this.#words = find("opened-words");
    this.#copies = find("opened-copies");
    this.#files = find("opened-files");
    this.#heard = heard;
    find("opened-close").addEventListener("click", () => this.#close());
    // The browser's own buttons: the address is that of the run already.
    window.addEventListener("popstate", () => this.#openNamed());
    this.#openNamed();
  }

  #openNamed(): void {
    const named = new URL(location.href).searchParams.get("run");
    if (named === (this.#detail?.id ?? null)) return;
    if (named === null) this.#close();
    else void this.open(named);
  }

  #close(): void {
    this.#asked += 1;
    this.#show(null);
  }

  /** The opened run in the place of the instrument's own. Null without one, and while the instrument works on the opened one. */
  instead(status: Status): RunDetail | null {
    return this.#detail === null || isOwn(this.#detail, status.run) ? null : this.#detail;
  }

  /** Reads the opened run again if it was under way and may have ended. */
  follow(status: Status): void {
    this.#status = status;
    void this.#again.ask();
  }

  async #readAgain(): Promise<void> {
    const [detail, status] = [this.#detail, this.#status];
    if (detail === null || status === null) return;
    const now = `${status.boot_id} ${status.revision}`;
    if (!this.#isOld && (!mayHaveEnded(detail, status.run) || now === this.#readAt)) return;
    this.#isOld = false;
    const read = await fetchRun(detail.id);
    this.#readAt = now;
    // Another run was opened meanwhile.
    if (this.#detail?.id !== read.id) return;
    this.#detail = read;
    this.#draw(read);
    this.#heard.read();
  }

  /** Something was said about a well of a run: its record has changed. */
  said(run: string): void {
    if (this.#detail?.id !== run) return;
    this.#isOld = true;
    void this.#again.ask();
  }

  async open(run: string): Promise<void> {
    const asked = (this.#asked += 1);
    try {
      const detail = await fetchRun(run);
      if (asked !== this.#asked) return;
      this.#show(detail);
    } catch (error) {
      if (asked !== this.#asked) return;
      const why = error instanceof Refused ? error.message : String(error);
      // The address of a run that is not there is no place to come back to.
      window.history.replaceState(null, "", addressOf(null));
      this.#show(null);
      setText(this.#words, `Run ${run} could not be opened: ${why}.`);
      setText(this.#copies, "");
      this.#files.replaceChildren();
      show(this.#banner, true);
    }
    bringIntoView(this.#banner);
  }

  #show(detail: RunDetail | null): void {
    this.#detail = detail;
    const address = addressOf(detail);
    if (address.href !== location.href) window.history.pushState(null, "", address);
    if (detail !== null) this.#draw(detail);
    show(this.#banner, detail !== null);
    this.#heard.opened();
  }

  #draw(detail: RunDetail): void {
    const { id, plate_barcode, started, mode, method, operator, software_version: version, outcome, wells } = detail;
    const end =
      outcome === null
        ? ""
        : `The run ${OUTCOMES[outcome]}: ${wells.succeeded + wells.flagged} of ${counted(wells.total, "well")} measured. `;
    setText(
      this.#words,
      `${outcome === null ? "Run under way" : "Stored run"} ${id}: plate ${plate_barcode}, ${day(started)}, ${mode}, ` +
        `method ${method}, operator ${operator}, carved ${version}. ${end}Plate, well, frame, model and tables below are of this run.`,
    );
    const parts = outcome === null ? [] : copyWords(detail).split("`");
    this.#copies.replaceChildren(...parts.map((part, i) => (i % 2 === 1 ? element("code", "", part) : part)));
    const whole = downloadLink(
      `/v1/runs/${encodeURIComponent(id)}/files.tar`,
      `${id}.tar`,
      "All files of the run (tar)",
    );
    // The files of a run under way are still written.
    this.#files.replaceChildren(...(outcome === null ? [] : [whole]));
  }
}
