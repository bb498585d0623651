// The results of a run as a table for spreadsheets: one line per well, with the plate map's entries and the measured values. The names of
// the columns contain the units, and every line shows whether it is simulated.

import { fetchRun } from "./api.ts";
import type { PlannedWell, RunDetail, RunPlan, WellStatus } from "./status.ts";

/** Columns from the plate map, then those from the result. */
const COLUMNS = [
  ...[
    "specimen",
    "dpf",
    "compound",
    "concentration",
    "concentration_unit",
    "strain",
    "treatment",
    "control",
    "replicate",
  ],
  ...["outcome", "reason", "flags", "estimator", "volume_um3", "volume_sd_um3", "area_um2", "area_sd_um2"],
  ...["diameter_um", "signal_per_nl", "views", "views_planned"],
] as const satisfies readonly (keyof PlannedWell | keyof WellStatus)[];

/** The parts of a run that the table needs. */
type Tabled = Pick<RunDetail, "id" | "mode" | "plate_barcode" | "method" | "results"> & {
  plan: Pick<RunPlan, "plate_map">;
};

/** CSV according to RFC 4180. Pure. */
export function tableOf(run: Tabled): string {
  const planned = new Map(run.plan.plate_map.map((well) => [well.well, well]));
  const head = { run: run.id, mode: run.mode, plate_barcode: run.plate_barcode, method: run.method };
  const lines = run.results.map((result) => {
    const all: Record<string, unknown> = { ...planned.get(result.well), ...result };
    return [...Object.values(head), result.well, ...COLUMNS.map((name) => all[name])];
  });
  return [[...Object.keys(head), "well", ...COLUMNS], ...lines]
    .map((line) => `${line.map(cell).join(",")}\r\n`)
    .join("");
}

function cell(value: unknown): string {
  const text = harmless(Array.isArray(value) ? value.join(" ") : String(value ?? ""));
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** Marks text that a spreadsheet would take for a formula as text. Numbers are not changed. */
function harmless(text: string): string {
  return /^[=+\-@\t\r]/.test(text) && Number.isNaN(Number(text)) ? `'${text}` : text;
}

/** Offers the table as a download, in a file named after the run. */
export async function saveTable(run: string): Promise<void> {
  // With the byte order mark by which spreadsheets recognise UTF-8.
  save(new Blob(["\ufeff", tableOf(await fetchRun(run))], { type: "text/csv" }), `${run}.csv`);
}

/** Offers a file as a download. */
export function save(file: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
