// A run of the real daemon from the empty plate map to the download: plate map with mistakes, start, hold, numbers, views with the outline of
// the model, stored runs, events, and wells measured again by another method.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { promisify } from "node:util";
import { validateBytes } from "gltf-validator";
import type { Page } from "playwright-core";
import { drawn, shoot } from "../support/browser.ts";
import { BINARY, RUN_MS } from "../support/daemon.ts";
import { opened, until } from "../support/opened.ts";

const run = promisify(execFile);
let folder: string;

before(async () => {
  folder = await mkdtemp(join(tmpdir(), "carved-runs-"));
});
after(async () => {
  await rm(folder, { recursive: true, force: true });
});

/** A model of A01, as Khronos' validator judges it: without errors, warnings or remarks. */
async function isValidGltf(page: Page, file: string): Promise<void> {
  const response = await page.request.get(new URL(`/v1/runs/small/specimens/A01/${file}`, page.url()).href);
  assert.equal(response.status(), 200, file);
  const { issues, info } = await validateBytes(new Uint8Array(await response.body()));
  assert.deepEqual(issues.messages, [], file);
  assert.ok(info.totalTriangleCount > 1000, `${file}: ${info.totalTriangleCount} triangles`);
}

/** Share of the model's outline that is within `near` px of the outline of the profile or of a fin, in the view on screen. */
async function fit(page: Page, near: number): Promise<number> {
  return page.evaluate((near) => {
    // The eyes are drawn with the model, in a colour with more red.
    const pixels = (id: string, mostRed: number) => {
      const image = document.querySelector<HTMLImageElement>(id)!;
      const [width, height] = [image.naturalWidth, image.naturalHeight];
      const canvas = new OffscreenCanvas(width, height).getContext("2d")!;
      canvas.drawImage(image, 0, 0);
      const { data } = canvas.getImageData(0, 0, width, height);
      return {
        width,
        height,
        at: [...Array(width * height).keys()].filter((i) => data[4 * i + 3]! > 0 && data[4 * i]! <= mostRed),
      };
    };
    const [model, profile] = [pixels("#model-image", 128), pixels("#profile-image", 255)];
    const { width, height } = profile;
    if (model.width !== width || model.height !== height) throw new Error("pictures of different sizes");
    const around = new Uint8Array(width * height);
    for (const i of profile.at)
      for (let dv = -near; dv <= near; dv += 1)
        for (let du = -near; du <= near; du += 1) around[i + dv * width + du] = 1;
    return model.at.filter((i) => around[i] === 1).length / model.at.length;
  }, near);
}

/** Share of the drawn model that is dark. */
async function darkShare(page: Page): Promise<number> {
  const picture = (await page.locator("#model-box canvas").screenshot()).toString("base64");
  return page.evaluate(async (base64) => {
    const image = new Image();
    image.src = `data:image/png;base64,${base64}`;
    await image.decode();
    const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight).getContext("2d")!;
    canvas.drawImage(image, 0, 0);
    const { data } = canvas.getImageData(0, 0, image.naturalWidth, image.naturalHeight);
    const light = [...Array(data.length / 4).keys()].map((i) => data[4 * i]! + data[4 * i + 1]! + data[4 * i + 2]!);
    const background = light[0]!;
    const body = light.filter((value) => Math.abs(value - background) > 60);
    return body.filter((value) => value < 150).length / body.length;
  }, picture);
}

/** A method of seven views and large voxels, which is soon computed. */
const COARSE = 'asd = 7\norder = "sequential"\nepsilon = 0.05\nvoxel_um = 14.0\n';

test("a run from the empty plate map to the download of all its files", { timeout: 3 * RUN_MS }, async (t) => {
  const { daemon, page, complaints } = await opened(t, 5);
  await until(page, "new-run-missing", /^Still needed: a plate map, the plate's barcode, your name\.$/);
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
  const map = (text: string) => ({ name: "map.csv", mimeType: "text/csv", buffer: Buffer.from(text) });
  await page.getByLabel("Plate map").setInputFiles(map("well,dpf,colour\nZZ9,3,red\nA02,old,\n"));
  await until(page, "new-run-words", /^map\.csv cannot be used: 2 mistakes\.$/);
  const wells = "D06,bead,,,,,red\nA01,larva,3,ABxTL,DMSO,negative,\n";
  const columns = "well,specimen,dpf,strain,compound,control,colour\n";
  await page.getByLabel("Plate map").setInputFiles(map(columns + wells));
  // D06 is not on the plate that was chosen. On another plate the map is checked again.
  await until(page, "new-run-list", /D06 is not on a plate of 6 wells: A01 to B03/);
  await page.locator("#plate-format").selectOption("24");
  await until(page, "plate-holds", /^2 wells: 1 larva of 3 dpf, 1 bead\.$/);
  await until(page, "new-run-list", /colour: carved does not read this column and keeps it/);
  await page.getByLabel("Operator").fill("Kim");
  await page.getByLabel("Plate barcode").fill("P/24 b");
  await until(page, "barcode-words", /^A barcode has letters, digits/);
  assert.equal(await page.locator("#start").isDisabled(), true);
  await page.getByLabel("Plate barcode").fill("P-24");
  await page.getByLabel("Run name").fill("small");
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

  // Held in the first well, it waits after it.
  await daemon.follow((s) => s.run?.id === "small" && (s.specimen?.view ?? 0) > 3);
  await page.getByRole("button", { name: "Hold", exact: true }).click();
  const held = await daemon.follow((s) => s.state === "Held");
  assert.deepEqual([held.run!.hold!.code, held.run!.hold!.next_command], ["operator", "unhold"]);
  await until(page, "sentence", /^Let the run go on when you are ready\.$/);
  await until(page, "diagnosis", /^Held because: An operator asked for it\.$/);
  // Ring, numbers and pictures are of one well.
  const ring = await page.locator('#plate [aria-pressed="true"]').getAttribute("data-well");
  await until(page, "well-heading", new RegExp(`^Well ${ring}$`));
  await until(page, "frame-heading", new RegExp(`^Frame of ${ring}$`));
  await shoot(page, "runs-held");
  await page.locator("#unhold").click();
  const ended = await daemon.follow((s) => {
    // Two thirds of a turn in sequence are views from enough sides: what is missing then is time.
    const { view, views_planned, volume_wait } = s.specimen ?? { view: 0, views_planned: 0, volume_wait: null };
    assert.ok(view < (2 / 3) * views_planned || volume_wait !== "views", `${view} of ${views_planned}`);
    return s.run?.outcome != null;
  });
  assert.equal(ended.run!.outcome, "succeeded", `${JSON.stringify(ended.run!.results)}\n${daemon.log}`);
  const larva = ended.run!.results[1]!;
  // The map gave the strain, which is that of the references.
  const mismatches = [larva.reference!.volume, larva.reference!.area].flatMap((place) => place.mismatches).join();
  assert.doesNotMatch(mismatches, /strain/);

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
  const card = page.locator('#well-body dl[data-well="A01"]');
  await card.locator('[data-number="volume"]').waitFor();
  assert.equal(await card.locator('[data-number="field-volume"]').isVisible(), false, "one volume is reported");
  await card.getByText("Other volumes, and why they differ").click();
  await card.locator('[data-number="field-volume"]', { hasText: /The surface that is drawn/ }).waitFor();
  await card.locator('[data-number="hull-volume"]', { hasText: /The rough live volume/ }).waitFor();
  await until(page, "chart-caption", /^A01: reported [\d.]+ ± [\d.]+.nL \(± 1 SD\)\./);

  // The model with the colours of the frames: eyes and pigment are dark, which the plain model is nowhere.
  const canvas = page.locator("#model-box canvas");
  const plain = await darkShare(page);
  await page.getByLabel("Colours of the frames").check();
  await until(page, "model-caption", /with the colours of its frames/);
  const coloured = await darkShare(page);
  assert.ok((await drawn(canvas)).shades > 20 && coloured > plain + 0.05, `dark: ${plain} plain, ${coloured} coloured`);
  await page.getByRole("link", { name: "Model with the colours of the frames (GLB)" }).waitFor();
  const saved = page.waitForEvent("download");
  await page.getByRole("button", { name: "Save table" }).click();
  const [head, ...lines] = (await readFile(await (await saved).path(), "utf8")).trimEnd().split("\r\n");
  assert.match(head!, /^\ufeffrun,.*,well,.*,compound,.*,volume_um3,volume_sd_um3,/);
  assert.deepEqual([lines.length, lines.filter((line) => line.includes(",A01,")).length], [2, 1]);
  await isValidGltf(page, "mesh.glb");
  await isValidGltf(page, "coloured.glb");
  await shoot(page, "runs-opened");

  await page.getByText("What happened in this run").click();
  await until(page, "log-list", /A01: measured, [\d.]+ ± [\d.]+.nL/);
  await until(page, "log-list", /The run finished\./);
  await until(page, "log-list", /The run was accepted for plate P-24, method standard\./);

  await page.getByText("Measure again by another method").click();
  const settings = join(folder, "coarse.toml");
  await writeFile(settings, COARSE);
  await page.locator("#again-method").selectOption({ label: "of a file …" });
  await page
    .locator("#again-file")
    .setInputFiles({ name: "no.toml", mimeType: "text/plain", buffer: Buffer.from("a") });
  await page.getByRole("button", { name: "Measure again" }).click();
  await until(page, "again-words", /^Nothing is measured again: not the keys of a `\[methods\.NAME\]` table/);
  await page.locator("#again-file").setInputFiles(settings);
  await page.locator("#again-wells").fill("d6");
  await page.getByRole("button", { name: "Measure again" }).click();
  await until(page, "again-words", /^1 of 1 well measured by coarse\.$/);
  const rows = page.locator('#again-table tr[data-well="D06"]');
  const views = await rows.locator("td:nth-child(3)").allInnerTexts();
  assert.deepEqual(views, ["21", "7"], "the first numbers, and those of seven views beside them");
  const change = await rows.nth(1).locator("td:nth-child(6)").innerText();
  // Seven views of a bead: some per cent at most.
  assert.match(change, /^[+\u2212]?\d\.\d %$/);
  await shoot(page, "runs-again");
  // The command line gives the same, and finds it there.
  const replayed = await run(BINARY, ["replay", join(daemon.folder, "runs/small"), "D06", "--method", settings]);
  assert.match(replayed.stdout, /replays\/coarse: identical, bit for bit, to what is there/);

  const whole = page.waitForEvent("download");
  await page.getByRole("link", { name: "All files of the run (tar)" }).click();
  const tar = join(folder, (await whole).suggestedFilename());
  await (await whole).saveAs(tar);
  await run("tar", ["-xf", tar, "-C", folder]);
  await run("sha256sum", ["--check", "--strict", "--quiet", "SHA256SUMS"], { cwd: join(folder, "small") });
  const record = JSON.parse(await readFile(join(folder, "small", "run.json"), "utf8")) as { plan: object };
  const kept = record.plan as { plate_format: number; metadata: object };
  assert.deepEqual([kept.plate_format, kept.metadata], [24, { columns: { colour: { D06: "red" } } }]);
  assert.deepEqual(complaints, []);
});
