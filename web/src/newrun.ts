// A new run: plate map, method, barcode, operator, a drawing of the plate, and a list of everything that is checked before anything moves.
//
//   file ──check──> mistakes by line, or the contents of the plate ──preflight──> failed conditions ──start──> the run
//                                                                  └──> the queue, also during a run

import { checkPlateMap, fetchMethods, isJson, preflight, queuePlate, Refused, startRun } from "./api.ts";
import { CellEdit } from "./celledit.ts";
import { ColumnsView, mappingWords } from "./columns.ts";
import { bringIntoView, element, setText, show } from "./dom.ts";
import { save } from "./downloads.ts";
import { capitalised, counted, words } from "./format.ts";
import { canStart } from "./plain.ts";
import { keepPerson, person } from "./person.ts";
import { PlanPlate } from "./planplate.ts";
import type { Check, MappedColumn, MethodOffer, Mistake, PlannedWell, PlateMap, RunPlan, Status } from "./status.ts";
import { templateOf } from "./template.ts";
import { formatFor } from "./wells.ts";

export class NewRun {
  readonly #panel: HTMLDetailsElement;
  readonly #form: HTMLFormElement;
  readonly #file: HTMLInputElement;
  readonly #method: HTMLSelectElement;
  readonly #methodWords: HTMLElement;
  readonly #barcode: HTMLInputElement;
  readonly #barcodeWords: HTMLElement;
  readonly #operator: HTMLInputElement;
  readonly #id: HTMLInputElement;
  readonly #holds: HTMLElement;
  readonly #missing: HTMLElement;
  readonly #words: HTMLElement;
  readonly #list: HTMLElement;
  readonly #preflight: HTMLButtonElement;
  readonly #start: HTMLButtonElement;
  readonly #toQueue: HTMLButtonElement;
  readonly #leave: HTMLButtonElement;
  readonly #format: HTMLSelectElement;
  readonly #doubt: HTMLElement;
  readonly #doubtWords: HTMLElement;
  readonly #sure: HTMLElement;
  readonly #plate: PlanPlate;
  readonly #cell: CellEdit;
  readonly #columns: ColumnsView;
  readonly #columnsButton: HTMLButtonElement;
  #methods: readonly MethodOffer[] = [];
  #methodsOf: string | null = null;
  /** The start of the daemon that the newest status is from. */
  #boot = "";
  /** The method of the plan in the form, which the list may not have yet. */
  #wanted: string | null = null;
  #map: PlateMap | null = null;
  /** The plate that the operator chose, by its number of wells. Without a choice the map names its plate. */
  #chosen: number | null = null;
  /** What the operator says that the columns of the file are. Without it the headings say so. */
  #mapping: MappedColumn[] | null = null;
  /** Number of checks of a map that were begun. Only the newest counts. */
  #checks = 0;
  #startable = false;
  /** Whether the form was opened for a queued plate: it is then shown during a run too. */
  #isForQueue = false;
  /** The plan of the queued plate that is changed: what the form does not show stays as it is. */
  #changed: RunPlan | null = null;
  /** The run of the queued plate that is changed. */
  #changes: string | null = null;
  /** Why the instrument would not accept a run now. */
  #notReady: string | null = null;
  #busy = false;
  /** Condition of the instrument that the messages are about. */
  #condition = "";
  /** Why the newest start was refused, while the panel shows it. */
  #refused: string | null = null;
  readonly #tell: (words: string) => void;

  /** `tell` shows outside of the panel why no run was started: another run hides the panel. */
  constructor(find: <T extends Element = HTMLElement>(id: string) => T, tell: (words: string) => void) {
    this.#tell = tell;
    const panel = find<HTMLDetailsElement>("new-run");
    // Folded where it would be a screen long.
    panel.open = !matchMedia("(max-width: 900px)").matches;
    this.#panel = panel;
    this.#form = find("new-run-form");
    this.#file = find("plate-map");
    this.#method = find("method");
    this.#methodWords = find("method-words");
    this.#barcode = find("barcode");
    this.#barcodeWords = find("barcode-words");
    this.#operator = find("operator");
    this.#id = find("run-id");
    this.#holds = find("plate-holds");
    this.#missing = find("new-run-missing");
    this.#words = find("new-run-words");
    this.#list = find("new-run-list");
    this.#preflight = find("preflight");
    this.#start = find("start");
    this.#toQueue = find("to-queue");
    this.#leave = find("leave-queued");
    this.#format = find("plate-format");
    this.#doubt = find("plate-doubt");
    this.#doubtWords = find("plate-doubt-words");
    this.#sure = find("plate-doubt-sure");
    this.#sure.addEventListener("click", () => this.#confirm());
    this.#plate = new PlanPlate({ box: find("plan"), table: find("plan-plate"), legend: find("plan-legend") });
    this.#cell = new CellEdit(
      find,
      () => this.#map?.plate_map ?? [],
      (wells) => this.#correct(wells),
    );
    this.#columns = new ColumnsView(find, (columns) => {
      this.#mapping = columns;
      void this.#check();
    });
    this.#columnsButton = find("columns-open");
    this.#columnsButton.addEventListener("click", () => {
      const file = this.#file.files?.[0];
      if (file) void this.#columns.open(file, false);
    });
    this.#format.addEventListener("change", () => {
      this.#chosen = this.#wells();
      void this.#check();
    });
    find("template").addEventListener("click", () => {
      const wells = Number(this.#format.value) || 96;
      save(new Blob([templateOf(wells)], { type: "text/csv" }), `plate-map-${wells}.csv`);
    });
    this.#operator.value = person();
    this.#file.addEventListener("change", () => {
      this.#mapping = null;
      this.#columns.close();
      void this.#check();
    });
    this.#method.addEventListener("change", () => {
      this.#wanted = null;
      this.#explain();
    });
    this.#form.addEventListener("input", () => {
      // Messages about another plan do not apply to this one. Mistakes in the file come with its check.
      if (this.#map !== null) this.#clear();
      this.#enable();
    });
    this.#preflight.addEventListener("click", () => void this.#look());
    this.#toQueue.addEventListener("click", () => void this.#enqueue());
    this.#leave.addEventListener("click", () => {
      this.#empty();
      this.#clear();
      this.#enable();
    });
    this.#form.addEventListener("submit", (event) => {
      event.preventDefault();
      // The key Enter in a form that was opened for the queue does not begin a run.
      void (this.#canBegin() && !this.#isForQueue ? this.#begin() : this.#enqueue());
    });
  }

  /** Opens the form for a plate that is queued. */
  forQueue(): void {
    this.#isForQueue = true;
    this.#open();
  }

  /** Opens the form with the plan of a queued plate. */
  change(run: string, plan: RunPlan): void {
    this.#isForQueue = true;
    this.#changes = run;
    this.#changed = plan;
    this.#fill(plan, `Queued for run ${run}`);
    this.#operator.value = plan.operator;
    this.#id.value = run;
    this.#enable();
  }

  /** Plans a run of these wells, which the operator starts. `of`: the run that they are from. */
  offer(plan: RunPlan, of: string): void {
    this.#changes = null;
    this.#fill(plan, `Of run ${of}`);
  }

  #open(): void {
    show(this.#panel, true);
    this.#panel.open = true;
    this.#readMethods();
    this.#enable();
    bringIntoView(this.#panel);
  }

  #fill(plan: RunPlan, whose: string): void {
    this.#checks += 1;
    this.#clear();
    const { plate_map, plate_format = null, metadata = {} } = plan;
    this.#map = { plate_map, plate_format, metadata, notes: [], confirm: null };
    this.#chosen = plate_format;
    this.#format.value = String(plate_format ?? "");
    this.#file.value = "";
    this.#mapping = null;
    this.#columns.close();
    show(this.#columnsButton, false);
    this.#file.required = false;
    this.#barcode.value = plan.plate_barcode;
    this.#operator.value = person() || plan.operator;
    this.#id.value = "";
    this.#wanted = plan.method;
    // Without an option of this name none is chosen, and the form asks for a method.
    this.#method.value = plan.method;
    this.#explain();
    setText(this.#holds, `${whose}: ${contents(plate_map)}`);
    show(this.#holds, true);
    this.#draw();
    this.#open();
  }

  update(status: Status): void {
    this.#startable = canStart(status);
    this.#notReady = status.ready ? null : (status.not_ready_reason ?? "no reason given");
    const refused = this.#refused;
    const condition = `${status.state} ${this.#startable}`;
    // Messages about an earlier condition do not apply to this one. Mistakes in the file come with its check.
    if (condition !== this.#condition && this.#map !== null) this.#clear();
    this.#condition = condition;
    if (!this.#startable && refused !== null) this.#refuse(refused);
    this.#boot = status.boot_id;
    const isShown = this.#startable || this.#isForQueue;
    show(this.#panel, isShown);
    if (isShown) this.#readMethods();
    this.#enable();
  }

  #readMethods(): void {
    if (this.#methodsOf !== this.#boot) void this.#loadMethods(this.#boot);
  }

  async #loadMethods(boot: string): Promise<void> {
    this.#methodsOf = boot;
    try {
      this.#methods = await fetchMethods();
    } catch (error) {
      // The next status repeats this.
      this.#methodsOf = null;
      this.#say(`The methods could not be read: ${reason(error)}.`);
      return;
    }
    const chosen = this.#wanted ?? this.#method.value;
    this.#method.replaceChildren(
      ...this.#methods.map((m) => {
        const option = element("option", "", m.name);
        option.value = m.name;
        option.selected = m.name === chosen;
        return option;
      }),
    );
    if (this.#wanted !== null) this.#method.value = chosen;
    this.#explain();
    this.#enable();
  }

  #explain(): void {
    const m = this.#methods.find((m) => m.name === this.#method.value);
    setText(this.#methodWords, m ? `${m.asd} views, ${m.order.replaceAll("_", " ")}, voxels of ${m.voxel_um} µm.` : "");
  }

  #enable(): void {
    const missing = this.#whatIsMissing();
    const planned = !this.#busy && missing.length === 0;
    this.#toQueue.disabled = !planned;
    setText(this.#toQueue, this.#changes === null ? "Add to the queue" : "Change it in the queue");
    show(this.#leave, this.#changes !== null);
    this.#id.readOnly = this.#changes !== null;
    show(this.#start, this.#canBegin());
    this.#start.disabled = !planned || this.#notReady !== null;
    this.#preflight.disabled = !planned || !this.#startable;
    const words = [];
    if (missing.length > 0) words.push(`Still needed: ${missing.join(", ")}.`);
    if (this.#notReady !== null && this.#canBegin())
      words.push(`No run can start yet: ${this.#notReady.replace(/\.$/, "")}.`);
    setText(this.#missing, words.join(" "));
    show(this.#missing, words.length > 0 && !this.#busy);
  }

  /** Whether the form can begin a run at once. */
  #canBegin(): boolean {
    return this.#startable && this.#changes === null;
  }

  #whatIsMissing(): string[] {
    const missing = [];
    if (this.#map === null) missing.push(this.#file.value === "" ? "a plate map" : "a plate map without mistakes");
    if (this.#map?.confirm != null) missing.push("the plate's size");
    const misread = this.#barcode.validity.patternMismatch;
    show(this.#barcodeWords, misread);
    if (!this.#barcode.checkValidity()) missing.push(misread ? "another barcode" : "the plate's barcode");
    if (!this.#method.checkValidity()) missing.push("a method");
    if (this.#operator.value.trim() === "") missing.push("your name");
    if (!this.#id.checkValidity()) missing.push("a run name of letters, digits, dots, _ and - alone");
    return missing;
  }

  /** The plate that is shown as chosen, by its number of wells. */
  #wells(): number | null {
    return this.#format.value === "" ? null : Number(this.#format.value);
  }

  /** Has the map checked, on the plate that was chosen. */
  async #check(): Promise<void> {
    const file = this.#file.files?.[0];
    const check = (this.#checks += 1);
    this.#map = null;
    this.#file.required = true;
    show(this.#holds, false);
    this.#draw();
    this.#clear();
    show(this.#columnsButton, file !== undefined && !isJson(file));
    if (!file) return this.#enable();
    await this.#work(async () => {
      const map = await checkPlateMap(file, this.#chosen, this.#mapping);
      // Another file or plate was chosen while this one was read.
      if (this.#checks !== check) return;
      this.#map = map;
      this.#format.value = String(map.plate_format ?? "");
      setText(this.#holds, `${contents(map.plate_map)} ${mappingWords(this.#mapping ?? [])}`.trim());
      show(this.#holds, true);
      this.#draw();
      this.#list.replaceChildren(
        listOf(
          "Notes on the plate map",
          map.notes.map((n) => element("li", "quiet", n)),
        ),
      );
    }, `${file.name} cannot be used`);
    // A table of another program may be read once somebody has said what its columns are.
    if (this.#checks === check && this.#map === null && this.#mapping === null && !isJson(file))
      await this.#columns.open(file, true);
  }

  async #look(): Promise<void> {
    const plan = this.#plan();
    if (!plan) return;
    this.#clear();
    await this.#work(async () => {
      const checks = await preflight(plan);
      const failed = checks.filter((c) => !c.passed);
      const blocking = failed.filter((c) => c.blocks).length;
      this.#say(
        failed.length === 0
          ? `Preflight passed: all ${counted(checks.length, "check")}. The run can start.`
          : `Preflight: ${failed.length} of ${counted(checks.length, "check")} failed. ${blocking === 0 ? "The run can start all the same." : "The run would not start."}`,
      );
      const groups: [string, Check[]][] = [
        ["What prevents the start", failed.filter((c) => c.blocks)],
        ["What does not prevent it", failed.filter((c) => !c.blocks)],
        ["What is right", checks.filter((c) => c.passed)],
      ];
      this.#list.replaceChildren(...groups.map(([heading, found]) => listOf(heading, found.map(checked))));
    }, "The preflight was not done");
  }

  async #begin(): Promise<void> {
    const plan = this.#plan();
    if (!plan) return;
    keepPerson(plan.operator);
    const id = this.#id.value.trim() || freshName(plan.plate_barcode);
    this.#clear();
    const job = async () => {
      if (!(await startRun(id, plan))) {
        this.#refuse(`Run ${id} exists already; nothing was started. Choose another run name, or leave it empty.`);
        return;
      }
      this.#empty();
      this.#isForQueue = false;
    };
    await this.#work(job, "The run was not started", (words) => this.#refuse(words));
  }

  async #enqueue(): Promise<void> {
    const plan = this.#plan();
    if (!plan) return;
    if (this.#changes === null) keepPerson(plan.operator);
    const id = this.#changes ?? (this.#id.value.trim() || freshName(plan.plate_barcode));
    this.#clear();
    await this.#work(async () => {
      await queuePlate(id, plan);
      const done = this.#changes === null ? "is queued" : "is changed in the queue";
      this.#empty();
      this.#say(`Plate ${plan.plate_barcode} ${done}, for run ${id}.`);
    }, "The queue was not changed");
  }

  /** Empties the form for the next plate. */
  #empty(): void {
    this.#checks += 1;
    this.#file.value = "";
    this.#barcode.value = "";
    this.#id.value = "";
    this.#map = null;
    this.#mapping = null;
    this.#columns.close();
    show(this.#columnsButton, false);
    this.#changes = null;
    this.#file.required = true;
    show(this.#holds, false);
    this.#format.value = "";
    this.#chosen = null;
    this.#draw();
  }

  #plan(): RunPlan | null {
    if (this.#map === null || !this.#form.reportValidity()) return null;
    const kept = this.#changes === null ? null : this.#changed;
    // A version belongs to its method.
    const { method_version: version = null, ...others } = kept ?? {};
    const pinned = kept?.method === this.#method.value && version !== null ? { method_version: version } : {};
    return {
      ...others,
      ...pinned,
      plate_barcode: this.#barcode.value.trim(),
      method: this.#method.value,
      operator: this.#operator.value.trim(),
      ...(this.#map.plate_format === null ? {} : { plate_format: this.#map.plate_format }),
      plate_map: this.#map.plate_map,
      metadata: this.#map.metadata,
    };
  }

  /** Runs one request at a time. A refusal lists every mistake. */
  async #work(job: () => Promise<void>, refused: string, say = (words: string) => this.#say(words)): Promise<void> {
    this.#busy = true;
    this.#enable();
    try {
      await job();
    } catch (error) {
      const mistakes = error instanceof Refused ? error.mistakes : [];
      // The detail would only repeat the list.
      const other = error instanceof Refused ? error.run : null;
      if (other !== null) say(`${refused}. Another run is under way: ${other}.`);
      else say(`${refused}: ${mistakes.length > 0 ? counted(mistakes.length, "mistake") : reason(error)}.`);
      const planned = this.#map?.plate_map ?? [];
      this.#list.replaceChildren(
        listOf(
          "Mistakes",
          mistakes.map((m) => mistake(m, planned)),
        ),
      );
    } finally {
      this.#busy = false;
      this.#enable();
    }
  }

  /** Takes a plate map with one well corrected. The daemon checks it with the plan. */
  #correct(wells: PlannedWell[]): void {
    if (this.#map === null) return;
    const isAsLarge = plateSize(wells) === plateSize(this.#map.plate_map);
    this.#map = { ...this.#map, plate_map: wells, confirm: isAsLarge ? this.#map.confirm : null };
    this.#clear();
    setText(this.#holds, `${contents(wells)} Corrected on this page; the file is as it was.`);
    this.#draw();
    this.#enable();
  }

  /** The plate is as large as the one well makes it: it is chosen. */
  #confirm(): void {
    if (this.#map === null) return;
    const plate_format = plateSize(this.#map.plate_map);
    this.#map = { ...this.#map, plate_format, confirm: null };
    this.#chosen = plate_format;
    this.#format.value = String(plate_format);
    this.#draw();
    this.#enable();
    this.#format.focus();
  }

  #draw(): void {
    this.#cell.close();
    const confirm = this.#map?.confirm ?? null;
    show(this.#doubt, confirm !== null);
    if (confirm !== null) {
      setText(this.#doubtWords, `${capitalised(confirm)}.`);
      setText(this.#sure, `It has ${plateSize(this.#map!.plate_map)} wells`);
    }
    this.#plate.update(this.#map?.plate_map ?? [], this.#wells());
  }

  #refuse(words: string): void {
    this.#refused = this.#startable ? words : null;
    if (this.#startable) this.#say(words);
    else this.#tell(words);
  }

  #clear(): void {
    this.#refused = null;
    show(this.#words, false);
    this.#list.replaceChildren();
  }

  #say(words: string): void {
    setText(this.#words, words);
    show(this.#words, true);
  }
}

function reason(error: unknown): string {
  return error instanceof Refused ? error.message : String(error);
}

/** A list with its heading; nothing without entries. */
function listOf(heading: string, entries: HTMLElement[]): Node {
  if (entries.length === 0) return document.createDocumentFragment();
  const list = element("ul", "mistakes", ...entries);
  list.setAttribute("aria-label", heading);
  return element("div", "", element("h3", "", heading), list);
}

/** What a check looks at, by its code. */
const CHECKED: Record<string, string> = {
  rotation: "Rotation axis",
  camera: "Camera",
  outputs: "Outputs of the controller",
  light: "Light",
  faults: "Faults",
  plate: "Plate",
  capillary: "Capillary",
  calibration: "Calibration",
  disk: "Disk",
  disk_budget: "Disk budget",
  references: "Reference larvae",
};

function mistake(m: Mistake, planned: readonly PlannedWell[]): HTMLElement {
  // In the plan that the page made of a map, a well has a place in a list.
  const [, index] = /^\/plate_map\/(\d+)\b/.exec(m.pointer ?? "") ?? [];
  const well = index === undefined ? undefined : planned[Number(index)]?.well;
  const pointer = well === undefined ? (m.pointer ?? "") : `Well ${well}`;
  const place = m.line ? `Line ${m.line}${m.column ? `, ${m.column}` : ""}` : pointer;
  return element("li", "mistake", element("b", "", place ? `${place}: ` : ""), m.detail);
}

function checked(check: Check): HTMLElement {
  const item = element("li", check.passed ? "check" : "check check-failed");
  item.dataset["code"] = check.code;
  const name = CHECKED[check.code] ?? capitalised(words(check.code));
  item.append(element("b", "", `${check.passed ? "✓" : check.blocks ? "✕" : "!"} ${name}: `), check.detail);
  if (!check.passed && check.what_to_do) {
    item.append(element("span", "check-advice", element("b", "", "What to do: "), capitalised(check.what_to_do)));
  }
  return item;
}

/** `96 wells: 40 larvae of 3 dpf, 50 of 5 dpf, 6 beads`. Pure. */
export function contents(wells: readonly PlannedWell[]): string {
  const beads = wells.filter((w) => w.specimen === "bead").length;
  const ages = new Map<number | null, number>();
  for (const w of wells) if (w.specimen !== "bead") ages.set(w.dpf ?? null, (ages.get(w.dpf ?? null) ?? 0) + 1);
  const sorted = [...ages].sort(([a], [b]) => (a ?? Infinity) - (b ?? Infinity));
  const parts = sorted.map(
    ([age, n]) => `${n} ${n === 1 ? "larva" : "larvae"} ${age === null ? "of unknown age" : `of ${age} dpf`}`,
  );
  if (beads > 0) parts.push(counted(beads, "bead"));
  return `${counted(wells.length, "well")}: ${parts.join(", ")}.`;
}

/** Number of wells of the smallest usual plate that has these. */
function plateSize(wells: readonly PlannedWell[]): number {
  const { rows, columns } = formatFor(wells.map(({ well }) => well));
  return rows * columns;
}

/** The name of a run from the plate's name and the time, UTC: `P-001-20260305T093000`. */
function freshName(barcode: string): string {
  const time = new Date().toISOString().replace(/[-:]|\.\d+Z/g, "");
  return `${barcode.slice(0, 40)}-${time}`;
}
