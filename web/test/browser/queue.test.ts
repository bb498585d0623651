// The queue of plates, with real clicks on the real daemon: plates are queued, ordered, removed, put back and changed; a wrong barcode begins
// nothing; the right one begins the run; and a daemon that is killed has the queue again.

import assert from "node:assert/strict";
import { test } from "node:test";
import type { Page } from "playwright-core";
import type { Status } from "../../src/status.ts";
import { shoot } from "../support/browser.ts";
import { RUN_MS } from "../support/daemon.ts";
import { opened, until } from "../support/opened.ts";

/** Queues a plate of two wells by the form, with its file. */
async function add(page: Page, barcode: string, run: string): Promise<void> {
  await page.getByRole("button", { name: "Add a plate" }).click();
  const buffer = Buffer.from("well,specimen,dpf\nA01,larva,3\nA02,larva,3\n");
  await page.getByLabel("Plate map").setInputFiles({ name: "map.csv", mimeType: "text/csv", buffer });
  await until(page, "plate-holds", /^2 wells: 2 larvae of 3 dpf\.$/);
  await page.getByLabel("Plate barcode").fill(barcode);
  await page.getByLabel("Operator").fill("Kim");
  await page.getByLabel("Run name").fill(run);
  await page.getByRole("button", { name: "Add to the queue" }).click();
  await until(page, "new-run-words", new RegExp(`^Plate ${barcode} is queued, for run ${run}\\.$`));
}

const runs = (status: Status) => status.queue.map((plate) => plate.run).join(" ");

test("plates wait in a queue and begin by their barcodes alone", { timeout: 3 * RUN_MS }, async (t) => {
  const { daemon, page, complaints } = await opened(t, 5);
  await page.getByText("Queue of plates").click();
  await add(page, "N-1", "night-1");
  await add(page, "N-2", "night-2");
  await add(page, "N-3", "night-3");
  await until(page, "queue-heading", /^Queue of plates: 3 plates, next N-1$/);
  await shoot(page, "queue");
  // A barcode waits once.
  await page.getByRole("button", { name: "Add a plate" }).click();
  await page
    .getByLabel("Plate map")
    .setInputFiles({ name: "map.csv", mimeType: "text/csv", buffer: Buffer.from("well\nA01\n") });
  await page.getByLabel("Plate barcode").fill("N-2");
  await page.getByLabel("Run name").fill("night-9");
  await page.getByRole("button", { name: "Add to the queue" }).click();
  await until(page, "new-run-words", /^The queue was not changed: plate N-2 is queued already, for run night-2\./);

  await page.getByRole("button", { name: "Move N-3 up" }).click();
  await daemon.follow((s) => runs(s) === "night-1 night-3 night-2");
  await page.getByRole("button", { name: "Remove N-3" }).click();
  await until(page, "queue-words", /^Plate N-3 is out of the queue\.$/);
  assert.equal(runs(await daemon.status()), "night-1 night-2");
  await page.getByRole("button", { name: "Put it back" }).click();
  await daemon.follow((s) => runs(s) === "night-1 night-3 night-2");
  await page.getByRole("button", { name: "Change N-3" }).click();
  await until(page, "plate-holds", /^Queued for run night-3: 2 wells: 2 larvae of 3 dpf\.$/);
  await page.locator('#plan-plate [data-planned="A02"]').click();
  await page.getByLabel("Leave this well out of the run").check();
  await page.getByRole("button", { name: "Use it" }).click();
  await page.getByLabel("Operator").fill("Lee");
  await page.getByRole("button", { name: "Change it in the queue" }).click();
  await until(page, "new-run-words", /^Plate N-3 is changed in the queue, for run night-3\.$/);
  const changed = (await daemon.status()).queue[1]!;
  assert.deepEqual([changed.operator, changed.wells, changed.plate_barcode], ["Lee", 1, "N-3"]);

  // Another plate than the next one is in its place.
  await page.getByLabel("Barcode of the plate in its place").fill("N-2");
  await page.getByRole("button", { name: "Begin this plate" }).click();
  await until(
    page,
    "queue-words",
    /^Nothing was changed: plate N-1 is next in the queue, and plate N-2 was reported\./,
  );
  await shoot(page, "queue-wrong");
  const still = await daemon.status();
  assert.deepEqual([still.run, runs(still)], [null, "night-1 night-3 night-2"]);
  await page.getByLabel("Barcode of the plate in its place").fill("N-1");
  await page.getByRole("button", { name: "Begin this plate" }).click();
  await until(page, "queue-words", /^Plate N-1 has begun as run night-1\.$/);
  await daemon.follow((s) => s.run?.id === "night-1" && runs(s) === "night-3 night-2");
  // Also while a run is under way.
  await add(page, "N-4", "night-4");
  await until(page, "queue-heading", /^Queue of plates: 3 plates, next N-3$/);
  await shoot(page, "queue-during-a-run");

  await daemon.crash();
  await daemon.again();
  const back = await daemon.follow((s) => s.not_ready_reason !== "starting");
  assert.equal(runs(back), "night-3 night-2 night-4");
  assert.equal(back.run?.id, "night-1");
  await daemon.follow((s) => s.run?.id === "night-1" && s.run.outcome !== null);
  // As a loader says it.
  const wrong = await fetch(`${daemon.url}/v1/plate/next`, {
    method: "PUT",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ barcode: "N-4" }),
  });
  assert.deepEqual([wrong.status, ((await wrong.json()) as { code: string }).code], [409, "other_plate_next"]);
  await daemon.send("PUT", "/v1/plate/next", { barcode: "N-3" });
  const next = await daemon.follow((s) => s.run?.id === "night-3" && s.run.outcome !== null);
  assert.deepEqual(
    next.run!.results.map((w) => w.well),
    ["A01"],
  );
  await until(page, "queue-heading", /^Queue of plates: 2 plates, next N-2$/);
  assert.deepEqual(complaints, []);
});
