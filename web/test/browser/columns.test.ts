// A table of another program, with real clicks on the real daemon: its columns are proposed, corrected by the operator, and what is taken is
// shown before a run of it is begun. The record keeps what the columns were.

import assert from "node:assert/strict";
import { test } from "node:test";
import { shoot } from "../support/browser.ts";
import { RUN_MS } from "../support/daemon.ts";
import { opened, until } from "../support/opened.ts";

const FOREIGN =
  "Plate layout of 3 March\nPosition;Line;Drug;Dose;Type;Batch\na1;AB;valproate;1,5;test;7\na2;AB;DMSO;;vehicle;8\n";

test("the columns of a foreign table are proposed, corrected and kept", { timeout: 2 * RUN_MS }, async (t) => {
  const { daemon, page, complaints } = await opened(t, 5);
  const buffer = Buffer.from(FOREIGN);
  await page.getByLabel("Plate map").setInputFiles({ name: "layout.csv", mimeType: "text/csv", buffer });
  await until(page, "columns-words", /^layout\.csv: 6 columns, named in line 2, and 2 lines below\./);
  const choice = (heading: string) => page.getByLabel(`What ${heading} is`, { exact: true });
  const proposed = await page
    .locator("#columns-table select[data-column]")
    .evaluateAll((all) => all.map((one) => (one as HTMLSelectElement).value));
  assert.deepEqual(proposed, ["well", "strain", "compound", "concentration", "", ""]);
  // The unit stands nowhere in the file: nothing is guessed.
  await page.getByRole("button", { name: "Read it so" }).click();
  await until(page, "new-run-list", /Line 3, .*the concentration 1\.5 has no unit/);
  await page.getByLabel("Unit of Dose").selectOption("mM");
  await choice("Type").selectOption("treatment");
  await shoot(page, "columns");
  await page.getByRole("button", { name: "Read it so" }).click();
  await until(
    page,
    "plate-holds",
    /^2 wells: 2 larvae of unknown age\. Columns as chosen on this page: Position is the well, Line is the strain, Drug is the compound, Dose is the concentration in mM, Type is the treatment\.$/,
  );
  await page.locator("#plan-legend", { hasText: /valproate.*1\.5 mM/ }).waitFor();
  await shoot(page, "columns-read");
  await page.getByLabel("Plate barcode").fill("P-7");
  await page.getByLabel("Operator").fill("Kim");
  await page.getByLabel("Run name").fill("foreign");
  await page.getByRole("button", { name: "Start", exact: true }).click();
  await daemon.follow((s) => s.run?.id === "foreign");
  const { plan } = (await (await fetch(`${daemon.url}/v1/runs/foreign`)).json()) as {
    plan: { plate_map: object[]; metadata: Record<string, unknown> };
  };
  const own = { specimen: "larva", dpf: null, strain: "AB" };
  assert.deepEqual(plan.plate_map, [
    { ...own, well: "A01", compound: "valproate", concentration: 1.5, concentration_unit: "mM", treatment: "test" },
    { ...own, well: "A02", compound: "DMSO", treatment: "vehicle" },
  ]);
  assert.deepEqual(plan.metadata["columns"], { Batch: { A01: "7", A02: "8" } });
  assert.deepEqual((plan.metadata["column_mapping"] as object[])[3], {
    heading: "Dose",
    column: "concentration",
    unit: "mM",
  });
  assert.equal(await page.locator("#columns").isVisible(), false);
  assert.deepEqual(complaints, []);
});
