// What is in a well and how it was treated, in words. Pure.

import { asEntered, unitWords } from "./format.ts";
import type { WellCondition } from "./status.ts";

/** What is in a well and how it was treated, in a plate map or in a group of wells. */
type Treatment = Partial<WellCondition>;

/** How a well was treated: `DMSO 0.1 %, ABxTL, negative control`. Empty where the plate map names nothing. */
export function treatmentWords(well: Treatment): string {
  const dose =
    well.concentration == null
      ? ""
      : ` ${asEntered(well.concentration)} ${unitWords(well.concentration_unit ?? "")}`.trimEnd();
  return [
    well.compound == null ? "" : `${well.compound}${dose}`,
    well.treatment ?? "",
    well.strain ?? "",
    well.control == null ? "" : `${well.control} control`,
  ]
    .filter((part) => part !== "")
    .join(", ");
}

/** What is in a well and how it was treated: `larva, 3 dpf, DMSO 0.1 %, negative control`. */
export function planWords(well: Treatment): string {
  return [well.specimen ?? "larva", well.dpf == null ? "" : `${well.dpf} dpf`, treatmentWords(well)]
    .filter((part) => part !== "")
    .join(", ");
}
