// What is done at the instrument between runs, with real clicks on the real daemon: the live picture, the report of a run, and the runs of a
// compound.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import { shoot } from "../support/browser.ts";
import { RUN_MS } from "../support/daemon.ts";
import { larva, opened, plan, until } from "../support/opened.ts";

test("a live picture at rest gives way to a run, and comes back after it", { timeout: 2 * RUN_MS }, async (t) => {
  const { daemon, page, complaints } = await opened(t, 5);
  const live = page.getByLabel("Live picture");
  // One picture after the other, as long as it is wanted.
  await live.check();
  await until(page, "frame-whose", /^live picture, no run$/);
  const source = () => page.locator("#frame-image").getAttribute("src");
  const first = await source();
  await page.waitForFunction((first) => document.querySelector("#frame-image")?.getAttribute("src") !== first, first);
  assert.ok((await page.locator("#frame-image").evaluate((image: HTMLImageElement) => image.naturalWidth)) > 300);
  await shoot(page, "atrest-picture");

  // The start of a run does not wait for pictures, and is not refused for them.
  const body = JSON.stringify(
    plan([{ ...larva("A01"), compound: "Valproic acid", concentration: 1, concentration_unit: "mM" }]),
  );
  const headers = { "Content-Type": "application/json" };
  const started = await fetch(`${daemon.url}/v1/runs/vpa`, { method: "PUT", headers, body });
  assert.equal(started.status, 201, await started.text());
  await live.waitFor({ state: "hidden" });
  const during = await fetch(`${daemon.url}/v1/live/picture`, { method: "POST" });
  assert.equal(during.status, 409, "not during a run");
  await daemon.follow((s) => s.run?.outcome != null);

  // It comes back after the run, and ends when a well is looked at.
  await live.check();
  await until(page, "frame-whose", /^live picture, no run$/);
  await page.locator('#plate [data-well="A01"]').click();
  await until(page, "frame-whose", /^view 1 of/);
  assert.equal(await live.isChecked(), false);
  // A page that nobody can see takes no pictures.
  await live.check();
  await until(page, "frame-whose", /^live picture, no run$/);
  await page.evaluate(() => {
    Object.defineProperty(document, "hidden", { value: true, configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
  });
  assert.equal(await live.isChecked(), false);

  const saved = page.waitForEvent("download");
  await page.getByRole("button", { name: "Save report (HTML)" }).click();
  const report = await readFile(await (await saved).path(), "utf8");
  assert.match(report, /^<!DOCTYPE html>[\s\S]*Valproic acid/i);
  assert.equal((await saved).suggestedFilename(), "vpa-report.html");
  const shapes = page.waitForEvent("download");
  await page.getByRole("button", { name: "Save shapes (CSV)" }).click();
  assert.equal((await shapes).suggestedFilename(), "vpa-shape.csv");
  assert.match(await readFile(await (await shapes).path(), "utf8"), /A01/);
  const groups = page.waitForEvent("download");
  await page.getByRole("button", { name: "Save groups (CSV)" }).click();
  assert.equal((await groups).suggestedFilename(), "vpa-groups.csv");
  assert.match(await readFile(await (await groups).path(), "utf8"), /^\ufeffquantity,[\s\S]*Valproic acid/);

  await page.getByText("All runs").click();
  await until(page, "runs-words", /^1 of 1 runs\.$/);
  for (const [part, words] of [
    ["ethanol", /^0 of 0 runs\.$/],
    ["valpro", /^1 of 1 runs\.$/],
  ] as const) {
    await page.getByLabel("Compound", { exact: true }).and(page.locator("#runs-compound")).fill(part);
    await page.locator("#runs-compound").press("Enter");
    await until(page, "runs-words", words);
  }
  await shoot(page, "atrest-runs");

  // A browser gets the status compressed.
  const zipped = await page.evaluate(async () => {
    const response = await fetch("/v1/status", { cache: "no-store" });
    return [response.headers.get("content-encoding"), typeof (await response.json()).revision];
  });
  assert.deepEqual(zipped, ["gzip", "number"]);
  // The picture that the run ended is refused.
  assert.deepEqual(
    complaints.filter((complaint) => !/503/.test(complaint)),
    [],
  );
});
