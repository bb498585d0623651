import assert from "node:assert/strict";
import { test } from "node:test";
import { corrected } from "../../src/celledit.ts";

test("one cell of a plate map is corrected, and every other one stays", () => {
  const wells = [
    { well: "A01", dpf: 3, strain: "ABxTL", compound: "DMSO", concentration: 1, concentration_unit: "%" as const },
    { well: "A02", dpf: 3 },
  ];
  const said = { strain: "ABxTL", control: "", treatment: "", replicate: "" };
  const cell = {
    specimen: "larva",
    dpf: "5",
    compound: " VPA ",
    concentration: "1,5",
    unit: "mM",
    ...said,
    out: false,
  };
  assert.deepEqual(corrected(wells, "A01", cell), [
    {
      well: "A01",
      specimen: "larva",
      dpf: 5,
      strain: "ABxTL",
      compound: "VPA",
      concentration: 1.5,
      concentration_unit: "mM",
    },
    wells[1],
  ]);
  const bare = { ...cell, dpf: "", compound: "", concentration: "", specimen: "bead" };
  assert.deepEqual(corrected(wells, "A01", bare)![0], { well: "A01", specimen: "bead", dpf: null, strain: "ABxTL" });
  assert.deepEqual(corrected(wells, "A02", { ...cell, out: true }), [wells[0]]);
  assert.equal(corrected(wells, "A01", { ...cell, dpf: "old" }), null);
  assert.equal(corrected(wells, "A01", { ...cell, concentration: "1,000" }), null, "one or a thousand");
  const control = [{ ...wells[0]!, control: "negative" as const, treatment: "vehicle", replicate: 2 }];
  const asBefore = { ...cell, control: "negative", treatment: "vehicle", replicate: "2" };
  const other = corrected(control, "A01", asBefore)![0]!;
  assert.deepEqual([other.control, other.treatment, other.replicate], ["negative", "vehicle", 2], "as the form says");
  const bareOne = corrected(control, "A01", cell)![0]!;
  assert.deepEqual([bareOne.control, bareOne.treatment, bareOne.replicate], [undefined, undefined, undefined]);
  const typed = { ...cell, strain: "casper", control: "positive", treatment: "1 h", replicate: "3" };
  const made = corrected(control, "A01", typed)![0]!;
  assert.deepEqual([made.strain, made.control, made.treatment, made.replicate], ["casper", "positive", "1 h", 3]);
  assert.equal("strain" in corrected(control, "A01", { ...cell, strain: " " })![0]!, false);
  for (const replicate of ["0", "1,5", "two"]) assert.equal(corrected(wells, "A01", { ...cell, replicate }), null);
});
