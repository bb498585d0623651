// The page against the running daemon: the demo plate of four wells from its first view to its last number.
//
// CARVED_BIN names the daemon; without it the one that `cargo test` has left in target/debug is used.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import type { Browser, Locator, Page } from "playwright-core";
import type { WellStatus } from "../../src/status.ts";
import { drawn, openBrowser, openPage, shoot } from "../support/browser.ts";
import { BINARY, Daemon, RUN_MS } from "../support/daemon.ts";

const TIME_SCALE = 20;

let browser: Browser;
let daemon: Daemon;
let page: Page;
let complaints: string[];

before(async () => {
  browser = await openBrowser();
  daemon = await Daemon.start(BINARY, TIME_SCALE);
  ({ page, complaints } = await openPage(browser));
});
after(async () => {
  await browser?.close();
  await daemon?.stop();
});

/** The number as the page must show it, written here on its own. */
const whole = (value: number) => value.toLocaleString("en-US", { maximumFractionDigits: 0 });

async function shown(card: Locator, name: string): Promise<string> {
  return ((await card.locator(`[data-number="${name}"]`).textContent()) ?? "").replaceAll("\u202f", " ");
}

async function compare(well: WellStatus): Promise<void> {
  await page.locator(`button[data-well="${well.well}"]`).click();
  const card = page.locator(`#well-body dl[data-well="${well.well}"]`);
  await card.waitFor();
  assert.equal(await card.locator("[data-outcome]").getAttribute("data-outcome"), well.outcome);
  if (well.reason !== null)
    assert.match((await card.innerText()).toLowerCase(), new RegExp(well.reason.replaceAll("_", " ")));
  const numbers: [string, number | null, string][] = [
    ["volume", well.volume_um3, "µm³"],
    ["area", well.area_um2, "µm²"],
    ["field-volume", well.field_volume_um3, "µm³"],
    ["field-area", well.field_area_um2, "µm²"],
  ];
  for (const [name, value, unit] of numbers) {
    if (value === null) assert.equal(await card.locator(`[data-number="${name}"]`).count(), 0, `${well.well} ${name}`);
    else assert.ok((await shown(card, name)).includes(`${whole(value)} ${unit}`), `${well.well} ${name} is ${value}`);
  }
  const among = [well.reference?.volume, well.reference?.area].flatMap((p) => (p ? [p.words] : []));
  assert.equal(among.length, well.outcome === "succeeded" && well.dpf !== null ? 2 : 0, well.well);
  for (const words of among) assert.ok((await card.innerText()).toLowerCase().includes(words.toLowerCase()), words);
  if (well.diameter_um !== null) assert.equal(await shown(card, "diameter"), `${well.diameter_um.toFixed(1)} µm`);
}

test("the demo plate, as the operator sees it", { timeout: RUN_MS + 60_000 }, async () => {
  await page.goto(daemon.url);
  await page.locator("#link", { hasText: /^Live$/ }).waitFor();
  assert.equal((await page.locator("#stamp").innerText()).trim(), "SIMULATED");

  // The bar of the demo, in which nothing is done twice, never falls back.
  await page.locator("#progress").evaluate((bar: HTMLProgressElement) => {
    const seen: number[] = [];
    new MutationObserver(() => {
      seen.push(bar.value);
      bar.dataset["fellBack"] = String(seen.some((value, i) => i > 0 && value < seen[i - 1]!));
    }).observe(bar, { attributeFilter: ["value"] });
  });
  await page.getByLabel("Rough live volume").check();

  // While it runs: the sentence is the daemon's, volumes come view by view, frame and model are there.
  // A page that opens late waits for the next turn: two more volumes have to come in this one.
  const early = await page.waitForFunction(
    () => {
      const hulls = Number(document.querySelector<SVGElement>("#chart svg")?.dataset["hulls"]);
      return hulls >= 3 && hulls <= 15 ? hulls : null;
    },
    null,
    { timeout: RUN_MS },
  );
  await page.waitForFunction(
    (least) => Number(document.querySelector<SVGElement>("#chart svg")?.dataset["hulls"]) > least,
    Number(await early.jsonValue()) + 2,
    { timeout: RUN_MS },
  );
  assert.ok((await page.locator("#sentence").innerText()).length > 10);
  await page.locator("#frame-image").waitFor();
  await page.locator("#model-caption", { hasText: /after \d+ views?: [\d,]+ × [\d,]+ × [\d,]+/ }).waitFor();
  const picture = await drawn(page.locator("#model-box canvas"));
  assert.ok(picture.share > 0.01 && picture.shades > 20, `a shaded body, not ${JSON.stringify(picture)}`);
  const frame = await drawn(page.locator("#frame-box"));
  assert.ok(frame.share > 0.005 && frame.shades > 20, `a picture, not ${JSON.stringify(frame)}`);
  await shoot(page, "daemon-running");

  const finished = await daemon.follow((s) => s.run !== null && s.run.outcome !== null);
  const run = finished.run!;
  assert.equal(run.outcome, "succeeded", `${JSON.stringify(run)}\n${daemon.log}`);
  await page.locator("#progress-line", { hasText: /finished: 3 measured, 1 skipped/ }).waitFor();
  assert.deepEqual(
    run.results.map((w) => [w.specimen, w.outcome]),
    [
      ["larva", "succeeded"],
      ["larva", "succeeded"],
      ["bead", "succeeded"],
      ["larva", "skipped"],
    ],
  );
  for (const well of run.results) await compare(well);
  assert.notEqual(run.results[2]!.diameter_um, null, "a bead has its diameter");

  // Every curve that the page followed holds one point per view, also of wells that are done.
  await page.locator(`button[data-well="${run.results[1]!.well}"]`).click();
  await page.locator("#chart-caption", { hasText: run.results[1]!.well }).waitFor();
  assert.ok(Number(await page.locator("#chart svg").getAttribute("data-hulls")) >= 20);
  assert.equal(await page.locator("#progress").getAttribute("data-fell-back"), "false");
  await page.locator('#model-box[data-geometries="1"]').waitFor();
  assert.equal(await page.locator("#faults").isVisible(), false);
  await shoot(page, "daemon-finished");

  // A page that is opened afterwards finds the same numbers.
  await page.reload();
  await page.locator("#progress-line", { hasText: /finished/ }).waitFor();
  for (const well of run.results) await compare(well);
  await page.locator(`button[data-well="${run.results[1]!.well}"]`).click();
  await page.locator("#frame-whose", { hasText: /^view 1 of 21$/ }).waitFor();
  await page.locator("#model-caption", { hasText: /as it was measured: [\d,]+ × / }).waitFor();
  await page.getByLabel("Rough live volume").check();
  await page.locator('#chart svg[data-hulls="21"]').waitFor();
  const kept = await drawn(page.locator("#frame-box"));
  assert.ok(kept.share > 0.005 && kept.shades > 20, `a picture, not ${JSON.stringify(kept)}`);
  await shoot(page, "daemon-stored");
  assert.deepEqual(complaints, [], "the page complained");

  assert.equal(await daemon.stop(), 0, "the daemon ends cleanly when asked to");
  await page.locator("#lost", { hasText: /Connection lost/ }).waitFor();
});
