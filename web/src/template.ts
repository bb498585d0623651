// An empty plate map to fill in: every well of a plate in the order of its rows.

import { PLATES, wellName } from "./wells.ts";

/** The columns that carved reads. docs/plate-map.md explains them. */
const COLUMNS = [
  ...["well", "specimen", "dpf", "compound", "concentration", "concentration_unit", "strain", "treatment", "control"],
  "replicate",
];

/** CSV with a line per well, in which only the wells and the specimen are filled in. Pure. */
export function templateOf(wells: number): string {
  const { rows, columns } = PLATES.get(wells) ?? PLATES.get(96)!;
  const lines = Array.from({ length: rows * columns }, (_, i) => {
    const well = wellName(Math.floor(i / columns), i % columns);
    return COLUMNS.map((name) => (name === "well" ? well : name === "specimen" ? "larva" : "")).join(",");
  });
  return [COLUMNS.join(","), ...lines].map((line) => `${line}\r\n`).join("");
}
