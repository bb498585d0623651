// One cell of a plate map that was read: its specimen, age, strain and treatment are corrected before the run, or the well is left out. The
// file on the computer stays as it is.

import { setText, show } from "./dom.ts";
import type { PlannedWell } from "./status.ts";

/** What the form says about a well. */
export interface Cell {
  specimen: string;
  dpf: string;
  compound: string;
  concentration: string;
  unit: string;
  strain: string;
  control: string;
  treatment: string;
  replicate: string;
  out: boolean;
}

/** The plate map with one well as the form says; null where a number cannot be read. Pure. */
export function corrected(wells: readonly PlannedWell[], name: string, cell: Cell): PlannedWell[] | null {
  if (cell.out) return wells.filter((well) => well.well !== name);
  // "1,000" may be one or a thousand.
  const ambiguous = /^\s*\d{1,3}(,\d{3})+\s*$/;
  const numbers = [cell.dpf, cell.concentration, cell.replicate].map((text) => {
    if (text.trim() === "") return null;
    return ambiguous.test(text) ? Number.NaN : Number(text.replace(",", "."));
  });
  if (numbers.some((value) => value !== null && !Number.isFinite(value))) return null;
  const [dpf = null, concentration = null, replicate = null] = numbers;
  if (replicate !== null && !(Number.isInteger(replicate) && replicate > 0)) return null;
  return wells.map((well) => {
    if (well.well !== name) return well;
    const changed: PlannedWell = { ...well, specimen: cell.specimen === "bead" ? "bead" : "larva", dpf };
    for (const key of ["compound", "concentration", "concentration_unit", "strain"] as const) delete changed[key];
    for (const key of ["control", "treatment", "replicate"] as const) delete changed[key];
    const [compound, strain, treatment] = [cell.compound, cell.strain, cell.treatment].map((text) => text.trim());
    if (compound) changed.compound = compound;
    if (strain) changed.strain = strain;
    if (cell.control === "negative" || cell.control === "positive") changed.control = cell.control;
    if (treatment) changed.treatment = treatment;
    if (replicate !== null) changed.replicate = replicate;
    if (concentration !== null) changed.concentration = concentration;
    if (concentration !== null && cell.unit !== "")
      changed.concentration_unit = cell.unit as NonNullable<PlannedWell["concentration_unit"]>;
    return changed;
  });
}

export class CellEdit {
  readonly #form: HTMLFormElement;
  readonly #find: <T extends Element = HTMLElement>(id: string) => T;
  readonly #wells: () => readonly PlannedWell[];
  readonly #changed: (wells: PlannedWell[]) => void;
  #well: string | null = null;

  constructor(
    find: <T extends Element = HTMLElement>(id: string) => T,
    wells: () => readonly PlannedWell[],
    changed: (wells: PlannedWell[]) => void,
  ) {
    this.#find = find;
    this.#form = find("cell-form");
    this.#wells = wells;
    this.#changed = changed;
    find("plan-plate").addEventListener("click", (event) => {
      const cell = event.target instanceof Element ? event.target.closest<HTMLElement>("[data-planned]") : null;
      if (cell !== null) this.open(cell.dataset["planned"]!);
    });
    this.#form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.#apply();
    });
    find("cell-cancel").addEventListener("click", () => this.close());
    // What the map says of one compound does not hold of another.
    find("cell-compound").addEventListener("change", () => {
      const cleared = ["control", "treatment", "replicate"].filter((key) => this.#field(key).value !== "");
      for (const key of cleared) this.#field(key).value = "";
      const words = `The compound has changed. Cleared: ${cleared.join(", ")}. Enter them again if they apply to the new compound.`;
      setText(this.#find("cell-words"), cleared.length === 0 ? "" : words);
    });
  }

  open(name: string): void {
    const well = this.#wells().find((well) => well.well === name);
    if (well === undefined) return;
    this.#well = name;
    setText(this.#find("cell-heading"), `Well ${name}`);
    const values = {
      specimen: well.specimen ?? "larva",
      dpf: String(well.dpf ?? ""),
      compound: well.compound ?? "",
      concentration: String(well.concentration ?? ""),
      unit: well.concentration_unit ?? "",
      strain: well.strain ?? "",
      control: well.control ?? "",
      treatment: well.treatment ?? "",
      replicate: String(well.replicate ?? ""),
    };
    for (const [key, value] of Object.entries(values)) this.#field(key).value = value;
    this.#find<HTMLInputElement>("cell-out").checked = false;
    setText(this.#find("cell-words"), "");
    show(this.#form, true);
    this.#field("dpf").focus();
  }

  close(): void {
    this.#well = null;
    show(this.#form, false);
  }

  #field(key: string): HTMLInputElement | HTMLSelectElement {
    return this.#find<HTMLInputElement>(`cell-${key}`);
  }

  #apply(): void {
    if (this.#well === null) return;
    const value = (key: string) => this.#field(key).value;
    const wells = corrected(this.#wells(), this.#well, {
      specimen: value("specimen"),
      dpf: value("dpf"),
      compound: value("compound"),
      concentration: value("concentration"),
      unit: value("unit"),
      strain: value("strain"),
      control: value("control"),
      treatment: value("treatment"),
      replicate: value("replicate"),
      out: this.#find<HTMLInputElement>("cell-out").checked,
    });
    if (wells === null)
      return setText(
        this.#find("cell-words"),
        "Age and concentration are numbers, and a replicate is a whole number from 1.",
      );
    this.#changed(wells);
    this.close();
  }
}
