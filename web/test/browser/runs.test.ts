// Runs of the real daemon from the empty plate map to the download: start, views with the outline of the model, stored runs, events; and
// runs whose axis is lost.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { mkdtemp, readFile, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { promisify } from "node:util";
import type { Browser, Page } from "playwright-core";
import { openBrowser, openPage, shoot } from "../support/browser.ts";
import { BINARY, Daemon, RUN_MS } from "../support/daemon.ts";

let browser: Browser;
let folder: string;

before(async () => {
  browser = await openBrowser();
  folder = await mkdtemp(join(tmpdir(), "carved-runs-"));
});
after(async () => {
  await browser?.close();
  await rm(folder, { recursive: true, force: true });
});

async function opened(
  t: { after: (end: () => Promise<unknown>) => void },
  timeScale: number,
  more: readonly string[] = [],
): Promise<{ daemon: Daemon; page: Page; complaints: string[] }> {
  const daemon = await Daemon.start(BINARY, timeScale, ["--no-demo", ...more]);
  t.after(() => daemon.stop());
  const { page, complaints } = await openPage(browser);
  t.after(() => page.context().close());
  await page.goto(daemon.url);
  await page.locator("#link", { hasText: /^Live$/ }).waitFor();
  return { daemon, page, complaints };
}

const until = (page: Page, id: string, wanted: RegExp) => page.locator(`#${id}`).filter({ hasText: wanted }).waitFor();

/** Share of the model's outline that is within `near` px of the outline of the profile or of a fin, in the view on screen. */
async function fit(page: Page, near: number): Promise<number> {
  return page.evaluate((near) => {
    const pixels = (id: string) => {
      const image = document.querySelector<HTMLImageElement>(id)!;
      const [width, height] = [image.naturalWidth, image.naturalHeight];
      const canvas = new OffscreenCanvas(width, height).getContext("2d")!;
      canvas.drawImage(image, 0, 0);
      const { data } = canvas.getImageData(0, 0, width, height);
      return { width, height, at: [...Array(width * height).keys()].filter((i) => data[4 * i + 3]! > 0) };
    };
    const [model, profile] = [pixels("#model-image"), pixels("#profile-image")];
    const { width, height } = profile;
    if (model.width !== width || model.height !== height) throw new Error("pictures of different sizes");
    const around = new Uint8Array(width * height);
    for (const i of profile.at)
      for (let dv = -near; dv <= near; dv += 1)
        for (let du = -near; du <= near; du += 1) around[i + dv * width + du] = 1;
    return model.at.filter((i) => around[i] === 1).length / model.at.length;
  }, near);
}

test("a run from the empty plate map to the download of all its files", { timeout: 2 * RUN_MS }, async (t) => {
  const { daemon, page, complaints } = await opened(t, 20);
  // The template of a plate is a plate map without mistakes.
  await page.locator("#plate-format").selectOption("6");
  const download = page.waitForEvent("download");
  await page.getByRole("button", { name: "Template (CSV)" }).click();
  const template = join(folder, (await download).suggestedFilename());
  await (await download).saveAs(template);
  await page.getByLabel("Plate map").setInputFiles(template);
  await until(page, "plate-holds", /^6 wells: 6 larvae of unknown age\.$/);
  await page.locator('#plan-plate[data-wells="6"]').waitFor();

  // The run itself has two wells of a plate of 24.
  const map = "well,specimen,dpf,compound,control\nD06,bead,,,\nA01,larva,3,DMSO,negative\n";
  await page.getByLabel("Plate map").setInputFiles({ name: "map.csv", mimeType: "text/csv", buffer: Buffer.from(map) });
  await until(page, "plate-holds", /^2 wells: 1 larva of 3 dpf, 1 bead\.$/);
  await page.getByLabel("Plate barcode").fill("P-24");
  await page.getByLabel("Operator").fill("Kim");
  await page.getByLabel("Run name").fill("small");
  await page.getByRole("button", { name: "Start", exact: true }).click();
  // D06 is not on a plate of 6 wells.
  await until(page, "new-run-list", /D06 is not on a plate of 6 wells: A01 to B03/);
  await page.locator("#plate-format").selectOption("24");
  await page.locator('#plan-plate [data-planned="D06"]').waitFor();
  await page.getByRole("button", { name: "Preflight" }).click();
  await until(page, "new-run-words", /^Preflight/);
  const ticks = await page.locator("#new-run-list li").allInnerTexts();
  for (const name of ["✓ Rotation axis:", "✓ Camera:", "✓ Light:", "✓ Disk:"])
    assert.ok(
      ticks.some((tick) => tick.startsWith(name)),
      `${name} is not in ${ticks.join("; ")}`,
    );
  await shoot(page, "runs-preflight");
  await page.getByRole("button", { name: "Start", exact: true }).click();
  const ended = await daemon.follow((s) => s.run?.id === "small" && s.run.outcome !== null);
  assert.equal(ended.run!.outcome, "succeeded", daemon.log);

  // Found in the list, and opened.
  await page.getByText("All runs").click();
  await page.locator("#runs-outcome").selectOption("failed");
  await until(page, "runs-words", /^0 of 0 runs\.$/);
  await page.locator("#runs-outcome").selectOption("succeeded");
  await page.getByLabel("Search").fill("p-24 kim");
  await until(page, "runs-words", /^1 of 1 runs\.$/);
  await page.locator("#runs-table").getByRole("button", { name: "small" }).click();
  await until(page, "opened-words", /^Stored run small: plate P-24, .*, simulated, method standard/);
  await until(page, "opened-copies", /^No copy of this run is recorded/);
  await page.locator('#plate[data-wells="24"]').waitFor();

  // The model's outline lies on the profile of each view, or on a fin that the views show together. A camera that turns the other way
  // sees the larva elsewhere.
  for (const [well, least] of [
    ["D06", 0.99],
    ["A01", 0.97],
  ] as const) {
    await page.locator(`#plate button[data-well="${well}"]`).click();
    await until(page, "frame-heading", new RegExp(`^Frame of ${well}$`));
    await page.locator("#views-list button").nth(20).waitFor();
    for (const view of [1, 6, 11, 17]) {
      await page
        .locator("#views-list button")
        .nth(view - 1)
        .click();
      await until(page, "frame-whose", new RegExp(`^view ${view} of 21$`));
      await page.locator("#model-image").waitFor();
      const share = await fit(page, 2);
      t.diagnostic(`${well}, view ${view}: ${share.toFixed(3)}`);
      assert.ok(share > least, `${well}, view ${view}: ${share} of the model's outline is at the profile's`);
    }
  }
  await page.locator("#views").scrollIntoViewIfNeeded();
  await page.waitForFunction(() =>
    [...document.querySelectorAll<HTMLImageElement>("#views-list img")].every((image) => image.naturalWidth > 0),
  );
  await page.locator("#standing svg").waitFor();
  await shoot(page, "runs-opened");

  await page.getByText("What happened in this run").click();
  await until(page, "log-list", /A01: measured, [\d.]+ ± [\d.]+.nL/);
  await until(page, "log-list", /The run finished\./);
  await until(page, "log-list", /The run was accepted for plate P-24, method standard\./);

  const whole = page.waitForEvent("download");
  await page.getByRole("link", { name: "All files of the run (tar)" }).click();
  const tar = join(folder, (await whole).suggestedFilename());
  await (await whole).saveAs(tar);
  const run = promisify(execFile);
  await run("tar", ["-xf", tar, "-C", folder]);
  await run("sha256sum", ["--check", "--strict", "--quiet", "SHA256SUMS"], { cwd: join(folder, "small") });
  const record = JSON.parse(await readFile(join(folder, "small", "run.json"), "utf8")) as { plan: object };
  assert.deepEqual((record.plan as { plate_format: number }).plate_format, 24);
  assert.deepEqual(complaints, []);
});

test(
  "an axis that is lost in a turn: the specimen is measured again, and the page says so",
  { timeout: 2 * RUN_MS },
  async (t) => {
    // At half speed the larva is in the capillary at this time, and not yet measured.
    const { daemon, page, complaints } = await opened(t, 0.5, ["--axis-out", "12,4"]);
    await daemon.send("PUT", "/v1/runs/redo", {
      ...{ plate_barcode: "P-1", method: "standard", operator: "Kim" },
      plate_map: [{ well: "A01", specimen: "larva", dpf: 3 }],
    });
    const held = await daemon.follow((s) => s.state === "Held");
    assert.equal(held.run!.hold!.code, "rotation_lost");
    await until(page, "sentence", /^Check the controller's power and cable\./);
    // It goes on by itself when the axis answers.
    await daemon.follow((s) => s.state === "Execute" && s.faults.length === 0);
    const done = await daemon.follow((s) => s.run?.outcome != null);
    assert.equal(done.run!.results[0]!.outcome, "succeeded", JSON.stringify(done.run));
    await page.getByText("What happened in this run").click();
    await until(page, "log-list", /A01 was interrupted .*: it is measured again from the start\./);
    await until(page, "log-list", /The run is held: The axis' controller does not answer/);
    await until(page, "log-list", /The run goes on by itself\./);
    const stored = (await (await fetch(`${daemon.url}/v1/runs/redo/specimens/A01`)).json()) as {
      earlier_attempts: number[];
    };
    assert.deepEqual(stored.earlier_attempts, [1], "the turn that was cut short is kept");
    await until(page, "well-body", /Measured/);
    await shoot(page, "runs-redo");
    assert.deepEqual(complaints, []);
  },
);

test("an axis that is lost again and again needs a person after the third time", { timeout: 3 * RUN_MS }, async (t) => {
  // At a fifth of the speed a well takes several times as long as the time from one loss to the next, so none is finished.
  const losses = Array.from({ length: 12 }, (_, i) => ["--axis-out", `${12 + 15 * i},3`]).flat();
  const { daemon, page, complaints } = await opened(t, 0.2, losses);
  await daemon.send("PUT", "/v1/runs/again", {
    ...{ plate_barcode: "P-1", method: "standard", operator: "Kim" },
    plate_map: [{ well: "A01", specimen: "larva", dpf: 3 }],
  });
  const held = await daemon.follow((s) => s.state === "Held" && (s.run?.hold?.times ?? 0) >= 4);
  assert.equal(held.run!.hold!.code, "rotation_lost");
  assert.equal(held.run!.goes_on_by_itself, false);
  await until(page, "diagnosis", /It has held the run 4 times since a well was finished\./);
  await daemon.follow((s) => s.faults.length === 0);
  // The axis is back, and the run waits for somebody.
  await page.locator("#unhold").waitFor();
  assert.equal((await daemon.status()).state, "Held");
  await shoot(page, "runs-lost-again");
  await page.locator("#unhold").click();
  await daemon.follow((s) => s.state === "Execute");
  await page.locator("#diagnosis").waitFor({ state: "hidden" });
  assert.deepEqual(complaints, []);
});
