// The page against a fixture server: conditions that are hard to reach with a rig.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { after, afterEach, before, beforeEach, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import type { Status, VolumeEstimate } from "../../src/status.ts";
import { drawn, openBrowser, openPage, rightShare, shoot } from "../support/browser.ts";
import { FixtureServer, kept, NO_FILES } from "../support/fixture-server.ts";
import { ellipsoidGlb, png } from "../support/picture.ts";
import { areaPlace, noVolumePlace } from "../support/references.ts";
import { carved, fault, placed, run, specimen, status, well } from "../support/statuses.ts";

/** A dark ellipse between two wall lines on a pale ground. */
const frame = png(512, 512, (x, y) => {
  if (((x - 256) / 180) ** 2 + ((y - 256) / 30) ** 2 < 1) return [96, 84, 70, 255];
  return Math.abs(y - 200) < 2 || Math.abs(y - 312) < 2 ? [60, 66, 80, 255] : [226, 234, 243, 255];
});
const profile = png(512, 512, (x, y) => {
  const r = ((x - 256) / 180) ** 2 + ((y - 256) / 30) ** 2;
  return r > 0.92 && r < 1.08 ? [230, 20, 60, 255] : [0, 0, 0, 0];
});

const measured = well("A01", {
  outcome: "succeeded",
  volume_um3: 243_123_456,
  area_um2: 4_012_345,
  reference: placed,
});
const bead = well("A03", {
  specimen: "bead",
  dpf: null,
  outcome: "succeeded",
  flags: ["moved"],
  volume_um3: 65_449_847,
  area_um2: 785_398,
  diameter_um: 500.04,
});
const empty = well("A04", { outcome: "skipped", reason: "empty" });

function running(views: number): Status {
  return status({
    state: "Execute",
    doing: `taking view ${views + 1} of 22 of the larva in A02`,
    // Nobody has handed it over, as where a person puts the plate in.
    plate: { barcode: "DEMO-1", present: false, removable: false, needs: null, take_out: null, bring: null },
    run: run([measured, well("A02", { dpf: 5 }), bead, empty]),
    specimen: specimen("A02", carved(262_000_000, views), { estimates: estimated(views) }),
  });
}

/** An estimate after each view from the seventh on. */
function estimated(views: number): VolumeEstimate[] {
  return Array.from({ length: Math.max(0, views - 6) }, (_, i) => ({
    views: i + 7,
    volume_um3: 251e6 + 2e6 / (i + 1),
    volume_sd_um3: 1.3e6 + 2e6 / (i + 1),
  }));
}

let browser: Browser;
let server: FixtureServer;
let page: Page;
let complaints: string[];

before(async () => {
  browser = await openBrowser();
});
after(async () => {
  await browser?.close();
});

beforeEach(async () => {
  server = new FixtureServer(status());
  server.answers["/v1/methods"] = {
    methods: [{ name: "standard", asd: 21, order: "coarse_to_fine", voxel_um: 6.93, epsilon: 0.05 }],
  };
  server.live["/v1/live/frame.jpg"] = { body: frame, type: "image/png" };
  server.live["/v1/live/profile.png"] = { body: profile, type: "image/png" };
  server.live["/v1/live/mesh.glb"] = { body: ellipsoidGlb([1900, 260, 240]), type: "model/gltf-binary" };
  await server.start();
  ({ page, complaints } = await openPage(browser));
});
afterEach(async () => {
  await page.context().close();
  await server.stop();
  assert.deepEqual(complaints, [], "the page complained");
});

const text = async (id: string) => (await page.locator(`#${id}`).innerText()).trim();
const commands = () => server.taken.map((t) => t.command);
const until = (id: string, wanted: RegExp) => page.locator(`#${id}`).filter({ hasText: wanted }).waitFor();

test("an idle instrument with nothing to show says so", async () => {
  server.live["/v1/live/frame.jpg"] = undefined;
  server.live["/v1/live/mesh.glb"] = undefined;
  server.publish(status({ ready: false, not_ready_reason: "the rotation axis is not referenced" }));
  await page.goto(server.url);
  await until("sentence", /^Waiting for a run$/);
  assert.equal(await text("progress-line"), "Not ready for a run: the rotation axis is not referenced.");
  assert.equal(await text("stamp"), "SIMULATED");
  assert.equal(await page.locator("#abort").isVisible(), false);
  assert.equal(await page.locator("#frame-empty").isVisible(), true);
  assert.equal(await page.locator("#model-empty").isVisible(), true);
  assert.equal(await page.locator("#plate td .well").count(), 96);
  await shoot(page, "idle");
});

test("a rig that is not simulated bears no stamp", async () => {
  server.publish(status({ mode: "hardware" }));
  await page.goto(server.url);
  await until("link", /^Live$/);
  assert.equal(await page.locator("#stamp").isVisible(), false);
});

test("a specimen that is begun again does not move the progress bar back", async () => {
  const turning = running(9);
  server.publish(turning);
  await page.goto(server.url);
  await until("frame-whose", /views taken/);
  const bar = () => page.locator("#progress").evaluate((bar: HTMLProgressElement) => bar.value);
  const before = await bar();
  server.publish({ ...turning, doing: "begins again", specimen: specimen("A02", []) });
  await until("sentence", /^Begins again$/);
  assert.equal(await bar(), before);
  // Another run begins at its own place.
  server.publish({
    ...turning,
    run: { ...turning.run!, id: "demo-2" },
    doing: "another",
    specimen: specimen("A02", []),
  });
  await until("sentence", /^Another$/);
  assert.ok((await bar()) < before);
});

test("the volume so far: not told at first, then with its spread, its views and whether it has settled", async () => {
  const turning = running(9);
  server.publish(turning);
  await page.goto(server.url);
  await until("well-body", /Volume so far\s*not known yet: it takes views from more sides/);
  for (const [wait, words] of [
    ["views", /not known yet: it takes views from more sides/],
    ["computing", /not known yet: computing/],
    ["slices", /known once the turn is measured/],
  ] as const) {
    server.publish({ ...turning, specimen: specimen("A02", carved(262_000_000, 20), { volume_wait: wait }) });
    await until("well-body", words);
    await until("chart", words);
  }
  const told = { volume_um3: 251_000_000, volume_sd_um3: 1_300_000, volume_views: 8, converged: false };
  server.publish({ ...turning, revision: 2, specimen: specimen("A02", carved(262_000_000, 9), told) });
  await until("well-body", /251\.0 ± 1\.3.nL\s*251,000,000.µm³, of 8 views$/);
  server.publish({
    ...turning,
    revision: 3,
    specimen: specimen("A02", carved(262_000_000, 9), { ...told, converged: true }),
  });
  await until("well-body", /of 8 views, settled/);
});

test("a run under way: sentence, plate, numbers, frame, model and chart", async () => {
  server.publish(running(9));
  await page.goto(server.url);
  await until("sentence", /^Taking view 10 of 22 of the larva in A02$/);
  assert.equal(await text("plate-name"), "DEMO-1 · leave it in place");
  assert.equal(await text("progress-line"), "Run demo-1: 3 of 4 wells done · about 2 min left.");
  const condition = (name: string) => page.locator(`[data-well="${name}"].well`).getAttribute("data-condition");
  assert.deepEqual(await Promise.all(["A01", "A02", "A03", "A04"].map(condition)), [
    "succeeded",
    "active",
    "flagged",
    "skipped",
  ]);
  assert.match(await text("well-heading"), /A02/);

  await page.locator("#frame-image").waitFor();
  assert.equal(await page.locator("#profile-image").isVisible(), true);
  await page.getByLabel("Outline", { exact: true }).uncheck();
  assert.equal(await page.locator("#profile-image").isVisible(), false);
  await page.getByLabel("Outline", { exact: true }).check();

  await until("model-caption", /A02 after 9 views: 3,800 × 520 × 480/);
  const picture = await drawn(page.locator("#model-box canvas"));
  assert.ok(picture.share > 0.03 && picture.shades > 20, `a shaded body, not ${JSON.stringify(picture)}`);
  assert.equal(await page.locator("#chart circle").count(), 3);
  assert.equal(await page.locator("#chart .hull").count(), 0);
  await until("chart-caption", /^A02: 251\.7 ± 2\.0.nL \(± 1 SD\) of 9 views\.$/);
  await shoot(page, "running");
  await page.getByLabel("Rough live volume").check();
  await page.locator('#chart svg[data-hulls="9"]').waitFor();
  await until("chart-caption", /rough live volume .* after 9 views, which is no estimate/);
  await shoot(page, "running-hull");
  await page.getByLabel("Rough live volume").uncheck();

  await page.locator('[data-well="A03"].well').click();
  await until("well-heading", /A03/);
  const card = await text("well-body");
  for (const wanted of [
    "65.45\u202fnL",
    "65,449,847\u202fµm³",
    "0.7854\u202fmm²",
    "500.0\u202fµm",
    "moved during the turn",
  ]) {
    assert.ok(card.includes(wanted), `${wanted} in ${card}`);
  }
  await page.keyboard.press("ArrowRight");
  await until("well-heading", /A04/);
  assert.match(await text("well-body"), /Skipped[\s\S]*The capillary is empty/);
  assert.doesNotMatch(await text("well-body"), /larvae/);
  await page.locator('[data-well="A01"].well').click();
  await until("well-heading", /A01/);
  const among =
    /Volume: no reference of 3 dpf\.[\s\S]*Area 0\.8 SD below the mean of 12 larvae of 3 dpf\.[\s\S]*not stated/;
  assert.match(await text("well-body"), among);
  await shoot(page, "reference");
  await page.getByRole("button", { name: "Follow the run" }).click();
  await until("well-heading", /A02/);
});

test("a chosen well shows what is stored of it, and the page says whose pictures it shows", async () => {
  const late = carved(243_000_000, 21);
  const base = "/v1/runs/demo-1/specimens/A01";
  const views = [0, 1, 2].map((i) => `${base}/views/${i}.png`);
  // The second view has no profile.
  const profiles = [0, 2].map((i) => `${base}/profiles/${i}.png`);
  const links = { ...NO_FILES, mesh_glb: `${base}/mesh.glb`, views, profiles };
  const fin: [number, number][] = [
    [100, 180],
    [400, 180],
  ];
  // The camera that sees the model of 3400 x 500 x 460 um as the ellipse of the profiles.
  const camera = { f: 1e9, kx: 180 / 1700, ky: 30 / 250, ux: 256, uy: 256, width: 512, height: 512 };
  const view = (index: number, residual_px: number) => ({
    ...{ index, omega: index * Math.PI, used: true, reason: null, dy_px: 0, residual_px },
  });
  const measurement = {
    calibration: { psi: camera, rho: 1 },
    views: [{ ...view(0, 0.2), fins_px: [fin] }, { ...view(1, 0), used: false, reason: "not_seen" }, view(2, 0.4)],
    reference: { estimates: [{ estimator: "support", volume: noVolumePlace, area: areaPlace(1.5, 93) }] },
  };
  server.answers[base] = kept({
    recording: { rig: { camera } },
    measurement,
    hull_volumes_um3: late,
    estimates: estimated(21),
    links,
  });
  for (const path of views) server.files[path.replace("png", "jpg")] = frame;
  for (const path of profiles)
    server.files[path] = png(512, 512, (x, y) =>
      ((x - 256) / 180) ** 2 + ((y - 256) / 30) ** 2 < 1 ? [255, 255, 255, 255] : [0, 0, 0, 255],
    );
  server.files[`${base}/mesh.glb`] = ellipsoidGlb([1700, 250, 230]);
  const withMeasured = { ...running(9), run: run([measured, well("A02", { dpf: 5 }), bead, empty]) };
  server.publish(withMeasured);
  await page.goto(server.url);
  await until("frame-heading", /^Frame of A02$/);
  assert.equal(await text("frame-whose"), "9 of 22 views taken");
  await until("model-heading", /^Model of A02$/);
  assert.equal(await page.locator("#frame-view").isVisible(), false);

  await page.locator('[data-well="A01"].well').click();
  await until("frame-heading", /^Frame of A01$/);
  assert.equal(await text("frame-whose"), "view 1 of 3");
  await until("model-caption", /^A01 as it was measured: 3,400 × 500 × 460/);
  assert.equal(await text("model-heading"), "Model of A01");
  // Opened late, the page has the whole curve all the same.
  await page.locator('#chart svg[data-points="15"]').waitFor();
  await until("chart-caption", /^A01: reported 243\.1.nL/);
  assert.equal(await page.locator("#profile-image").isVisible(), true);
  // The fin that all views share is drawn above the specimen, and nothing beside it.
  const drawn = (u: number, v: number, of = "profile") =>
    page.locator(`#${of}-image`).evaluate(
      (image: HTMLImageElement, [x, y]) => {
        const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight).getContext("2d")!;
        canvas.drawImage(image, 0, 0);
        return [...canvas.getImageData(x!, y!, 1, 1).data];
      },
      [u, v],
    );
  assert.deepEqual(await drawn(250, 180), [64, 220, 255, 255]);
  assert.deepEqual(await drawn(250, 190), [0, 0, 0, 0]);
  await page.locator("#model-image").waitFor();
  // The outline of the model is where the camera sees it: at both ends of the ellipse and at its upper border.
  const model = [16, 92, 255, 255];
  for (const [u, v] of [
    [76, 256],
    [436, 256],
    [256, 226],
  ] as const)
    assert.deepEqual(await drawn(u, v, "model"), model);
  for (const [u, v] of [
    [256, 256],
    [256, 220],
    [66, 256],
  ] as const)
    assert.deepEqual(await drawn(u, v, "model"), [0, 0, 0, 0]);
  await page.getByLabel("Model's outline").uncheck();
  assert.equal(await page.locator("#model-image").isVisible(), false);
  await page.getByLabel("Model's outline").check();
  // The strip has every view with its distance, and marks the one in large.
  const strip = page.locator("#views-list button");
  assert.equal(await strip.count(), 3);
  assert.match(await strip.nth(1).innerText(), /^2 · 180°\s*left out: not seen$/);
  await until("views-words", /^3 views, 1 left out\. .* 0\.40 px in view 3\.$/);
  // The strip stands below the frame, and its pictures are read once it is in the window.
  await page.locator("#views").scrollIntoViewIfNeeded();
  await page.waitForFunction(() =>
    [...document.querySelectorAll<HTMLImageElement>("#views-list img")].every((image) => image.naturalWidth > 0),
  );
  assert.equal(await strip.nth(0).getAttribute("aria-pressed"), "true");
  assert.match(
    await text("standing"),
    /Area 3\.425 mm² by the outlines, .* 1\.5 SD above the mean of 12 larvae .* 93 % of such/s,
  );
  assert.equal(await page.locator("#standing svg").getAttribute("data-z"), "1.500");
  await shoot(page, "stored");
  await strip.nth(2).click();
  await until("frame-whose", /^view 3 of 3$/);
  assert.equal(await strip.nth(2).getAttribute("aria-pressed"), "true");
  assert.equal(await strip.nth(0).getAttribute("aria-pressed"), "false");
  await strip.nth(0).click();
  await until("frame-whose", /^view 1 of 3$/);
  await page.locator("#frame-view").focus();
  await page.keyboard.press("ArrowRight");
  await until("frame-whose", /^view 2 of 3$/);
  await page.locator("#profile-image").waitFor({ state: "hidden" });
  // News of the run change nothing of what was chosen.
  server.shown = { ...server.shown, views: 10 };
  server.publish({ ...withMeasured, specimen: specimen("A02", carved(262_000_000, 10)) });
  await until("sentence", /view 10/);
  assert.equal(await text("frame-heading"), "Frame of A01");

  const skipped = "/v1/runs/demo-1/specimens/A04";
  const judged = `${skipped}/views/detection.png`;
  server.files[judged.replace("png", "jpg")] = frame;
  server.answers[skipped] = kept({ links: { ...NO_FILES, detection: judged } });
  await page.locator('[data-well="A04"].well').click();
  await until("frame-whose", /^as it was found$/);
  assert.equal(await page.locator("#frame-image").isVisible(), true);
  assert.equal(await page.locator("#profile-image").isVisible(), false);
  assert.equal(await page.locator("#frame-view").isVisible(), false);
  await until("model-empty", /^No model of A04 is kept\.$/);
  await page.getByRole("button", { name: "Follow the run" }).click();
  await until("frame-whose", /^10 of 22 views taken$/);
});

test("the strip has the views of the chosen well, also where those of another are still being read", async () => {
  const views: Record<string, string[]> = {};
  for (const [name, count] of [
    ["A01", 3],
    ["A03", 2],
  ] as const) {
    const base = `/v1/runs/demo-1/specimens/${name}`;
    views[name] = Array.from({ length: count }, (_, i) => `${base}/views/${i}.png`);
    for (const link of views[name]) server.files[link.replace("png", "jpg")] = frame;
    server.answers[base] = kept({ well: name, links: { ...NO_FILES, views: views[name] } });
  }
  let release = () => {};
  const first = views["A03"]![0]!.replace("png", "jpg");
  server.slow[first] = new Promise((resolve) => (release = resolve));
  const wells = [measured, well("A03", { specimen: "bead", dpf: null, outcome: "succeeded", volume_um3: 65e6 })];
  server.publish(status({ state: "Complete", run: run(wells, { outcome: "succeeded" }) }));
  await page.goto(server.url);
  await page.waitForResponse((answer) => answer.url().endsWith("/specimens/A03"));
  await page.locator('[data-well="A01"].well').click();
  await until("well-heading", /^Well A01$/);
  release();
  await until("frame-whose", /^view 1 of 3$/);
  await page.locator("#views").scrollIntoViewIfNeeded();
  await page.waitForFunction(() => {
    const pictures = [...document.querySelectorAll<HTMLImageElement>("#views-list img:first-child")];
    return pictures.length > 0 && pictures.every((image) => image.naturalWidth > 0);
  });
  assert.equal(await page.locator("#views-list button").count(), 3);
  assert.ok(
    server.read.every((path) => !/A03.*width=/.test(path)),
    "thumbnails of the other well were read",
  );
});

test("pictures of another run are not shown as this one's", async () => {
  server.shown = { run: "yesterday", well: "A02", views: 21 };
  server.publish(running(0));
  await page.goto(server.url);
  await until("link", /^Live$/);
  await until("model-empty", /^No model yet/);
  assert.equal(await page.locator("#frame-image").isVisible(), false);
  server.shown = { run: "demo-1", well: "A02", views: 0 };
  server.publish(running(0));
  await until("frame-whose", /^before its first view$/);
  // As after a restart of the daemon: nothing to show is no mistake.
  for (const path of Object.keys(server.live)) server.live[path] = undefined;
  server.publish(running(0));
  await until("frame-empty", /^No frame yet\.$/);
});

test("what there is to look at is listed by reason, and leads to its wells", async () => {
  const results = [
    measured,
    bead,
    empty,
    well("A05", { outcome: "skipped", reason: "two" }),
    well("A06", { outcome: "skipped", reason: "empty" }),
    well("A07", { outcome: "failed", reason: "the frame is dark" }),
    well("A08", { outcome: "succeeded", volume_um3: 1, flags: ["clipped_left", "no_closure"] }),
  ];
  server.publish(status({ state: "Complete", run: run(results, { outcome: "partial" }) }));
  await page.goto(server.url);
  await page.locator("#attention-list li").first().waitFor();
  assert.deepEqual(
    (await page.locator("#attention-list li").allInnerTexts()).map((line) => line.replace(/\s+/g, " ").trim()),
    [
      "✕ The frame is dark – A07",
      "! The specimen moved during the turn: measure it again, and check flow, bubbles and lost steps if several in a row moved – A03",
      "! The specimen extends beyond the left side of the picture, so the volume is a lower bound: measure it again, further to the right – A08",
      "! No view at 360 deg shows whether the specimen moved: let the program that takes the views add one at 360 deg, or find out why it has no outline or is a copy of the view at 0 deg – A08",
      "– The capillary is empty – A04 A06",
      "– Two larvae – A05",
    ],
  );
  assert.equal(
    await text("progress-line"),
    "Run demo-1 finished in part: 3 measured (2 of them flagged), 3 skipped, 1 failed.",
  );
  const table = "\ufeffrun,well,compound\r\ndemo-1,A01,DMSO\r\n";
  server.files["/v1/runs/demo-1/table.csv"] = Buffer.from(table);
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("button", { name: "Save table" }).click(),
  ]);
  assert.equal(download.suggestedFilename(), "demo-1.csv");
  assert.equal(await readFile(await download.path(), "utf8"), table);
  assert.ok(server.read.includes("/v1/runs/demo-1/table.csv?spreadsheet=true"));
  await page.locator("#attention-list").getByRole("button", { name: "A06" }).click();
  await until("well-heading", /A06/);
  // What is cut off is a bound, and each flag leads to its help.
  await page.locator("#attention-list").getByRole("button", { name: "A08" }).first().click();
  await page.locator('#well-body [data-number="volume"]', { hasText: /^At least/ }).waitFor();
  const help = page.locator("#well-body a.flag").first();
  assert.equal(await help.getAttribute("href"), "/docs/quality.html#row-clipped_left");
  await shoot(page, "to-look-at");
});

test("who exchanges specimens by hand says so on the page", async () => {
  const plate = {
    barcode: "L-1",
    present: true,
    removable: false,
    needs: "A01 out, then A02 in",
    take_out: "A01",
    bring: "A02",
  };
  const waiting = { ...running(0), state: "Suspended" as const, plate };
  server.publish(waiting);
  await page.goto(server.url);
  await page.getByRole("button", { name: "Specimen of A01 is out" }).waitFor();
  assert.equal(await page.locator("#is-in").isVisible(), false, "one step after the other");
  await page.getByRole("button", { name: "Specimen of A01 is out" }).click();
  const undo = page.locator("#undo");
  await until("undo-words", /^Specimen of A01 is out\. Reported in 4 s\.$/);
  // The loader was quicker: the report is over, and is none of the next specimen.
  server.publish({ ...waiting, plate: { ...plate, take_out: null } });
  await undo.waitFor({ state: "hidden" });
  await page.getByRole("button", { name: "Specimen of A02 is in" }).click();
  await page.getByRole("button", { name: "Undo" }).click();
  await undo.waitFor({ state: "hidden" });
  assert.deepEqual(server.taken, []);
  await page.getByRole("button", { name: "Specimen of A02 is in" }).click();
  await until("answer", /accepted/);
  const isIn = { command: "PUT /v1/runs/demo-1/wells/A02", body: '{"loaded":true}' };
  assert.deepEqual(server.taken, [isIn]);

  // One key reports both, the second once the run asks for it alone.
  server.publish(waiting);
  await page.getByRole("button", { name: "Specimen of A01 is out" }).waitFor();
  await page.keyboard.press("n");
  await until("undo-words", /^A01 is out and A02 is in\. Reported in 4 s\.$/);
  await page.keyboard.press("Escape");
  await undo.waitFor({ state: "hidden" });
  assert.equal(server.taken.length, 1, "what was undone is not sent");
  await page.keyboard.press("n");
  const isOut = { command: "PUT /v1/runs/demo-1/wells/A01", body: '{"loaded":false}' };
  await page.waitForResponse(/wells\/A01$/);
  assert.deepEqual(server.taken.slice(1), [isOut]);
  server.publish({ ...waiting, plate: { ...plate, take_out: null } });
  await page.waitForResponse(/wells\/A02$/);
  assert.deepEqual(server.taken.slice(1), [isOut, isIn]);
  server.publish(running(0));
  await page.locator("#is-in").waitFor({ state: "hidden" });
});

test("a handover whose loader died is called off by the operator, without a run too", async () => {
  const open = (barcode: string) =>
    status({ ready: false, not_ready_reason: `plate ${barcode} is being handed over`, doing: "waiting for a run" });
  server.publish(open("P-1"));
  await page.goto(server.url);
  await page.getByRole("button", { name: "Plate P-1 was not moved" }).click();
  await until("ask-title", /^Call the handover of plate P-1 off\?$/);
  // Another plate was announced meanwhile: the question is over.
  server.publish(open("P-2"));
  await page.locator("dialog").waitFor({ state: "hidden" });
  assert.deepEqual(server.taken, []);
  await page.getByRole("button", { name: "Plate P-2 was not moved" }).click();
  await page.locator("dialog").getByRole("button", { name: "Wait for the loader" }).click();
  assert.deepEqual(server.taken, []);
  await page.getByRole("button", { name: "Plate P-2 was not moved" }).click();
  await shoot(page, "handover");
  await page.locator("dialog").getByRole("button", { name: "Plate P-2 was not moved" }).click();
  await until("answer", /accepted/);
  assert.deepEqual(server.taken, [{ command: "PUT /v1/plate/handoff/aborted", body: "" }]);
  server.publish(status());
  await page.locator("#not-moved").waitFor({ state: "hidden" });
  assert.equal(await page.locator("#answer").isVisible(), false);
});

test("what is stored and cannot be read says why, and is read once it can be", async () => {
  const base = "/v1/runs/demo-1/specimens/A01";
  const views = [0, 1].map((i) => `${base}/views/${i}.png`);
  const links = { ...NO_FILES, mesh_glb: `${base}/mesh.glb`, views };
  server.answers[base] = kept({ links });
  const pictures = views.map((path) => path.replace("png", "jpg"));
  for (const path of pictures) server.files[path] = frame;
  server.files[links.mesh_glb] = ellipsoidGlb([1700, 250, 230]);
  server.broken[base] = "the folder of A01 is damaged.";
  server.publish(running(9));
  await page.goto(server.url);
  await page.locator('[data-well="A01"].well').click();
  await until("frame-empty", /^The frames of A01 cannot be read: the folder of A01 is damaged\.$/);
  await until("model-empty", /^The model of A01 cannot be read: the folder of A01 is damaged\.$/);
  delete server.broken[base];
  server.broken[pictures[1]!] = "the frame is damaged";
  server.publish(running(10));
  await until("frame-whose", /^view 1 of 2$/);
  await until("model-heading", /^Model of A01$/);
  await page.locator("#frame-view").focus();
  await page.keyboard.press("ArrowRight");
  await until("frame-empty", /^View 2 of A01 cannot be read: the frame is damaged\.$/);
  assert.equal(await page.locator("#frame-image").isVisible(), false);
  await page.keyboard.press("ArrowLeft");
  await until("frame-whose", /^view 1 of 2$/);

  server.broken["/v1/runs/demo-1/table.csv"] = "a measurement is damaged.";
  await page.getByRole("button", { name: "Save table" }).click();
  await until("answer", /^The table was not saved: a measurement is damaged\.$/);
  delete server.broken["/v1/runs/demo-1/table.csv"];
  server.files["/v1/runs/demo-1/table.csv"] = Buffer.from("run,well\r\n");
  await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Save table" }).click()]);
  assert.equal(await page.locator("#answer").isVisible(), false);
});

test("a page of another version is read anew", async () => {
  server.publish(running(9));
  await page.goto(server.url);
  await until("version", /\d/);
  await until("instrument", /^vast-1, room 2\.17$/);
  assert.match((await page.locator("#instrument").getAttribute("title")) ?? "", /0042.*0fb2c0de/);
  await page.evaluate(() => (document.body.dataset["page"] = "old"));
  server.publish({ ...running(9), version: "99.0.0" });
  await until("version", /^99\.0\.0$/);
  await page.locator('body:not([data-page="old"])').waitFor();
});

test("a rig with a second camera and a translation shows both, its light, and what glows in a well", async () => {
  const glowing = well("A01", { outcome: "succeeded", volume_um3: 65_449_847, signal_per_nl: 7100.64 });
  const base = status({ run: run([glowing]), state: "Complete", doing: "the run is done" });
  const { camera } = base.hardware;
  server.publish({
    ...base,
    hardware: {
      ...base.hardware,
      translation: {
        identity: "Grbl 1.1h",
        connected: true,
        referenced: true,
        position_steps: -106667,
        position_um: -5000.02,
      },
      camera: { ...camera, light: { background: 240, saturated: 0.031, focus: 0.0012345 } },
      camera_second: { ...camera, identity: "Fluo 1", completed_frames: 22, missing_packets: 3, light: null },
    },
  });
  await page.goto(server.url);
  await page.locator("#rig-panel > summary").click();
  await until("rig", /Frames\s*✓ none damaged[\s\S]*Second camera\s*✓ Fluo 1\s*Its frames\s*3 packets missing/);
  const shown = (await text("rig")).replaceAll("\u202f", " ");
  for (const wanted of ["✓ at −5,000 µm", "background 240 of 255, 3.1 % saturated", "1,235 (higher is sharper)"]) {
    assert.ok(shown.includes(wanted), `${wanted} in ${shown}`);
  }
  await page.locator('[data-well="A01"].well').click();
  const card = page.locator("#well-body");
  await card.filter({ hasText: /Fluorescence/ }).waitFor();
  assert.match(await text("well-body"), /7,101 per nL/);
  await shoot(page, "second-camera");
});

test("the model grows without leaking: old geometry leaves the GPU, the canvas stays", async () => {
  server.shown = { ...server.shown, views: 1 };
  server.publish(running(1));
  await page.goto(server.url);
  await until("model-caption", /A02 after 1 view/);
  const canvas = await page.locator("#model-box canvas").elementHandle();
  for (let views = 2; views <= 22; views += 1) {
    server.shown = { ...server.shown, views };
    server.live["/v1/live/mesh.glb"] = {
      body: ellipsoidGlb([1900, 260 + views, 240], 16 + 2 * views),
      type: "model/gltf-binary",
    };
    server.publish(running(views));
    await until("model-caption", new RegExp(`A02 after ${views} views: 3,800 × ${520 + 2 * views} × 480`));
  }
  const rings = 16 + 2 * 22;
  await page.locator(`#model-box[data-triangles="${rings * 2 * rings * 2}"][data-geometries="1"]`).waitFor();
  assert.ok(await canvas!.evaluate((old) => old.isConnected), "the same canvas throughout");
  assert.equal(await page.locator("#chart circle").count(), 16);
});

test("the model turns by key and returns by Home", async () => {
  server.shown = { ...server.shown, views: 5 };
  server.publish(running(5));
  await page.goto(server.url);
  await until("model-caption", /A02 after 5 views/);
  const canvas = page.locator("#model-box canvas");
  await canvas.focus();
  await page.keyboard.press("Home");
  const first = await canvas.screenshot();
  for (let i = 0; i < 6; i += 1) await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("ArrowUp");
  const turned = await canvas.screenshot();
  assert.ok(!turned.equals(first), "six presses turn it by 45 degrees");
  await page.keyboard.press("Home");
  await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
  assert.ok((await canvas.screenshot()).equals(first), "Home gives the first look again");
  // Head and tail are on the same side from the camera and from above: the thick end of this body is at the right.
  server.shown = { ...server.shown, views: 6 };
  server.live["/v1/live/mesh.glb"] = { body: ellipsoidGlb([1900, 260, 240], 30, 0.8), type: "model/gltf-binary" };
  server.publish(running(6));
  await until("model-caption", /A02 after 6 views/);
  for (const look of ["Camera", "Above", "Oblique"]) {
    await page.getByRole("button", { name: look, exact: true }).click();
    await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
    const share = await rightShare(canvas);
    assert.ok(share > 0.55, `${look}: the thick end is at the right, not ${share}`);
  }
  await shoot(page, "above");
  // Length of the bar and its label agree with the model: 3,800 um seen as the camera sees them.
  await page.getByRole("button", { name: "Camera" }).click();
  await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
  const label = Number((await text("scale-label")).replace(/[^\d.]/g, ""));
  const bar = (await page.locator("#scale-bar").boundingBox())!.width;
  const width = (await canvas.boundingBox())!.width;
  const seen = (3800 / label) * bar;
  // The box fills 86 % of the picture's width; the bar's borders round to whole pixels.
  assert.ok(Math.abs(seen - 0.86 * width) < (3800 / label) * 1.01, `${seen} px of ${width} px`);
});

test("the remedy of a fault is the headline, and what happened stands below", async () => {
  const held = { ...running(9), state: "Held" as const, doing: "held: the camera does not answer" };
  server.publish({
    ...held,
    faults: [
      fault({
        seq: 8,
        code: "disk_low",
        category: "disk",
        meaning: "The disk that holds the data is full.",
        message: "4.1 GB of disk are free; a plate needs 6.0 GB",
        what_to_do: "Free some of the disk.",
        ends_by_itself: true,
      }),
      fault({ scheduler_action: "escalate_operator", operator_required: true }),
    ],
  });
  await page.goto(server.url);
  await until("sentence", /^Look at the camera's cable\.$/);
  await until("diagnosis", /^Held: the camera does not answer$/);
  const [disk, camera] = await page.locator("#fault-list li").allInnerTexts();
  // The headline has the camera's remedy and its button; the disk's has its own, and ends by itself.
  assert.match(camera!, /^The camera does not answer any more\.\s*Needs you/);
  assert.match(disk!, /^Free some of the disk\.\s*The disk that holds the data is full\.[\s\S]*Details for support$/m);
  assert.doesNotMatch(disk!, /4\.1 GB/);
  await page.getByText("Details for support").first().click();
  await page.getByText("Found: 4.1 GB of disk are free").waitFor();
  const acknowledge = page.getByRole("button", { name: "Acknowledge" });
  assert.equal(await acknowledge.count(), 1);
  const areas = await page
    .locator("main button:visible")
    .evaluateAll((buttons) =>
      buttons.map((b) => [b.id, b.getBoundingClientRect().width * b.getBoundingClientRect().height] as const),
    );
  assert.equal(areas.sort((a, b) => b[1] - a[1])[0]![0], "acknowledge", "the one thing to do is the largest button");
  assert.equal(await page.locator("#now").getAttribute("data-tone"), "alarm");
  await shoot(page, "faults");
  server.publish(running(10));
  await page.locator("#faults").waitFor({ state: "hidden" });
});

test("abort asks once, says what it did, and takes no for an answer", async () => {
  server.publish(running(9));
  await page.goto(server.url);
  await page.getByRole("button", { name: "Abort run" }).click();
  await until("ask-title", /^Abort run demo-1\?$/);
  await shoot(page, "abort-question");
  await page.getByRole("button", { name: "Keep running" }).click();
  assert.deepEqual(server.taken, []);

  server.refusal = { detail: "the run has ended" };
  await page.getByRole("button", { name: "Abort run" }).click();
  await page.locator("dialog").getByRole("button", { name: "Abort run" }).click();
  await until("answer", /did not get through: the run has ended/);

  server.refusal = null;
  await page.getByRole("button", { name: "Abort run" }).click();
  await page.locator("dialog").getByRole("button", { name: "Abort run" }).click();
  await until("answer", /^Abort run: accepted\.$/);
  assert.deepEqual(commands(), ["POST /v1/runs/demo-1/abort"]);

  const wells = [
    measured,
    well("A02", { dpf: 5, outcome: "aborted", reason: "aborted_by_operator" }),
    well("A03", { specimen: "bead", dpf: null }),
    well("A04"),
  ];
  server.publish(
    status({ state: "Aborted", doing: "run demo-1 was aborted", run: run(wells, { outcome: "aborted" }) }),
  );
  await until("state", /Aborted/i);
  assert.equal(await text("progress-line"), "Run demo-1 was aborted: 1 measured, 3 not measured.");
  assert.equal(await page.locator("#progress").evaluate((bar: HTMLProgressElement) => bar.value), 0.25);
  assert.equal(await page.locator("#abort").isVisible(), false);
  assert.equal(await page.locator("#answer").isVisible(), false, "what was accepted has happened");
  assert.equal(await page.locator("#now").getAttribute("data-tone"), "alarm");
  await shoot(page, "aborted");
});

test("a daemon that hangs: a command says that no answer came, and the link is lost at once", async () => {
  server.publish(running(9));
  await page.goto(server.url);
  await until("link", /^Live$/);
  await page.evaluate(() => {
    const links: string[] = [];
    Object.assign(window, { links });
    const link = document.getElementById("link")!;
    new MutationObserver(() => links.push(link.dataset["link"] ?? "")).observe(link, { attributes: true });
  });
  // Its status still comes, so that only the command can say that it hangs.
  server.isSilent = true;
  await page.getByRole("button", { name: "Hold", exact: true }).click();
  await until("answer", /^Hold: no answer came within 5 s\. It may still be carried out\.$/);
  await page.getByRole("button", { name: "Abort run" }).click();
  await page.locator("dialog").getByRole("button", { name: "Abort run" }).click();
  await until("answer", /^Abort run: no answer came within 5 s\. .* Use the instrument's own emergency stop/);
  await until("link", /^Live$/);
  const links = await page.evaluate(() => (window as unknown as { links: string[] }).links);
  assert.ok(links.filter((link) => link === "lost").length >= 2, links.join());
});

test("hold, go on, and stop after the well, each offered where it applies", async () => {
  const button = (name: string) => page.getByRole("button", { name, exact: true });
  server.publish(running(9));
  await page.goto(server.url);
  await button("Hold").click();
  await until("answer", /^Hold: accepted\.$/);
  server.publish({ ...running(10), state: "Holding", pending: { hold: true, stop: false, abort: false } });
  await button("Holding…").waitFor();
  assert.equal(await button("Holding…").isDisabled(), true);
  const held = { ...running(0), state: "Held" as const, specimen: null };
  server.publish({ ...held, run: run([well("A01")], { held_by_operator: true }) });
  await page.locator("#answer").waitFor({ state: "hidden" });
  // The second click of a double click on what stood here before.
  await page.locator("#unhold").dispatchEvent("click", { detail: 2 });
  await button("Go on").click();
  await until("answer", /Go on: accepted/);
  assert.equal(await page.locator("#hold").isVisible(), false);
  await button("End the run").click();
  await until("ask-title", /^End run demo-1\?$/);
  await page.getByRole("button", { name: "Keep the run" }).click();
  // A lost camera holds it: nobody can let it go on while the cause stands.
  const lost = fault({ code: "camera_lost", operator_required: true, ends_by_itself: true });
  const hold = {
    code: "camera_lost",
    cause: "The camera is gone.",
    times: 3,
    next_action: "Check its cable. The run continues by itself when the camera answers.",
    next_command: null,
    fault_seq: 7,
    next_try: null,
  };
  const standing = { ...held, faults: [lost], run: run([well("A01")], { goes_on_by_itself: true, hold }) };
  server.publish(standing);
  await until("sentence", /^Check its cable\. The run continues by itself/);
  await until(
    "diagnosis",
    /^Held because: The camera is gone\. It has held the run 3 times since a well was finished\.$/,
  );
  assert.equal(await page.locator("#unhold").isVisible(), false);
  assert.equal(await page.getByRole("button", { name: "Acknowledge" }).count(), 0, "it ends with its cause");
  await button("Keep it held").click();
  await until("answer", /Keep it held: accepted/);
  // What only another configuration ends has no large button, and can still be acknowledged.
  const unusable = { ...hold, next_action: "Correct the configuration.", next_command: null };
  server.publish({
    ...held,
    faults: [fault({ operator_required: true })],
    run: run([well("A01")], { hold: unusable }),
  });
  await button("Acknowledge fault 7").waitFor();
  assert.equal(await page.locator(".button-next").count(), 0);
  // Another fault waits for somebody who has seen to it.
  const other = fault({ operator_required: true });
  const waits = { ...hold, next_action: "Look. Then acknowledge the fault.", next_command: "acknowledge" as const };
  server.publish({ ...held, faults: [other], run: run([well("A01")], { hold: waits }) });
  assert.equal(await page.locator("#unhold").isVisible(), false);
  server.refusal = { code: "fault_stands", detail: "then POST /v1/faults/7/acknowledge" };
  await button("Acknowledge").click();
  await until("answer", /^Acknowledge did not get through: a fault is not acknowledged: .* The fault is still open\.$/);
  server.refusal = null;
  await button("Acknowledge").click();
  await until("answer", /^Acknowledge: accepted\.$/);
  server.publish(running(1));
  await button("Stop after this well").click();
  await until("ask-title", /^Stop run demo-1 after this well\?$/);
  await page.locator("dialog").getByRole("button", { name: "Stop after this well" }).click();
  await until("answer", /Stop after this well: accepted/);
  const path = "POST /v1/runs/demo-1";
  const acknowledged = "POST /v1/faults/7/acknowledge";
  assert.deepEqual(commands(), [`${path}/hold`, `${path}/unhold`, `${path}/hold`, acknowledged, `${path}/stop`]);
});

test("the emergency stop asks nothing, and its fault is acknowledged", async () => {
  server.publish(running(9));
  await page.goto(server.url);
  await until("link", /^Live$/);
  await page.getByRole("button", { name: "Emergency stop" }).click();
  await until("emergency-answer", /the motors were stopped/);
  const stopped = fault({ seq: 12, code: "emergency_stop", operator_required: true, message: "Emergency stop" });
  server.publish({ ...running(9), state: "Aborted", faults: [stopped] });
  await page.getByRole("button", { name: "Acknowledge" }).click();
  server.publish({ ...running(9), state: "Aborted", faults: [] });
  await page.locator("#faults").waitFor({ state: "hidden" });
  await page.locator("#emergency-answer").waitFor({ state: "hidden" });
  assert.deepEqual(commands(), ["POST /v1/emergency-stop", "POST /v1/faults/12/acknowledge"]);
});

test("an emergency stop that is not confirmed is sent until it is, also by a page that is loaded again", async () => {
  const stops = () => commands().filter((command) => command === "POST /v1/emergency-stop").length;
  const bar = page.locator("#emergency-bar");
  server.publish(running(9));
  await page.goto(server.url);
  await until("link", /^Live$/);
  server.refusal = { detail: "the daemon is busy" };
  await page.keyboard.press("F8");
  await until("emergency-words", /was not confirmed: the daemon is busy\. Use the instrument's own emergency stop/);
  // Over the width of the page but for its margins, which have its colour, and over everything else.
  const [share, ...ends] = await bar.evaluate((one) => {
    const { left, right, top } = one.getBoundingClientRect();
    const at = (x: number) => one.ownerDocument.elementFromPoint(x, top + 5)?.closest("#emergency-bar") === one;
    return [(right - left) / innerWidth, at(left + 2), at(right - 2)] as const;
  });
  assert.deepEqual([share > 0.95, ...ends], [true, true, true], String(share));
  await shoot(page, "stop-unconfirmed");
  await page.reload();
  await until("emergency-words", /was not confirmed: the daemon is busy/);
  assert.equal(stops(), 0);
  server.refusal = null;
  await until("emergency-answer", /the motors were stopped/);
  await bar.waitFor({ state: "hidden" });
  assert.equal(stops(), 1, "once it is confirmed it is sent no more");
  await page.reload();
  await until("link", /^Live$/);
  assert.equal(stops(), 1, "also by a page that is loaded again");

  // A daemon that hangs gives no answer at all.
  server.isSilent = true;
  await page.keyboard.press("F8");
  await until("emergency-words", /was not confirmed: no answer came within 2 s/);
  await page.getByRole("button", { name: "Withdraw the stop" }).click();
  await bar.waitFor({ state: "hidden" });
  server.isSilent = false;
  await page.reload();
  await until("link", /^Live$/);
  assert.equal(stops(), 1, "a stop that was withdrawn is not sent");
});

test("a browser that gives no storage shows the page and sends the stop", async () => {
  await page.addInitScript(() => {
    for (const name of ["localStorage", "sessionStorage"]) {
      Object.defineProperty(window, name, {
        get() {
          throw new DOMException("denied", "SecurityError");
        },
      });
    }
  });
  server.publish(running(9));
  await page.goto(server.url);
  await until("link", /^Live$/);
  await page.keyboard.press("F8");
  await until("emergency-answer", /the motors were stopped/);
  assert.ok(commands().includes("POST /v1/emergency-stop"), commands().join());
});

test("the page is live only while answers come: after two seconds it says for how long there was none", async () => {
  server.publish(running(9));
  await page.goto(server.url);
  await until("link", /^Live$/);
  // What the page says of the connection, also in passing.
  await page.evaluate(() => {
    const heard: string[] = [];
    Object.assign(window, { heard });
    const link = document.getElementById("link")!;
    new MutationObserver(() => heard.push(link.textContent ?? "")).observe(link, {
      ...{ childList: true, characterData: true, subtree: true },
    });
  });
  server.isFrozen = true;
  await until("link", /^No answer for \d+ s$/);
  const first = await page.evaluate(() => (window as unknown as { heard: string[] }).heard[0] ?? "");
  assert.match(first, /^No answer for [2-4] s$/, "live for too long");
  assert.equal(await page.locator("#lost").isVisible(), false);
  await until("link", /^Connection lost$/);
  server.isFrozen = false;
  await until("link", /^Live$/);
});

test("a new run: every mistake of its map, the preflight, the start", async () => {
  await page.goto(server.url);
  await until("method-words", /^21 views, coarse to fine, voxels of 6.93/);
  assert.equal(await page.locator("#start").isDisabled(), true);
  const map = { name: "map.csv", mimeType: "text/csv", buffer: Buffer.from("well,dpf\nA1,3\nZ9,x\n") };
  server.refusal = {
    detail: "the plate map has 2 mistakes",
    errors: [
      { line: 3, column: "well", detail: '"Z9" is not a well' },
      { line: 3, column: "dpf", detail: '"x" is not a number' },
    ],
  };
  await page.getByLabel("Plate map").setInputFiles(map);
  await until("new-run-words", /^map\.csv cannot be used: 2 mistakes\.$/);
  await until("new-run-missing", /^Still needed: a plate map without mistakes, the plate's barcode, your name\.$/);
  assert.deepEqual(await page.locator("#new-run-list li").allInnerTexts(), [
    'Line 3, well: "Z9" is not a well',
    'Line 3, dpf: "x" is not a number',
  ]);
  await shoot(page, "plate-map-mistakes");

  server.refusal = null;
  const wells = [
    { well: "A01", specimen: "larva", dpf: 3, compound: "DMSO" },
    { well: "A02", specimen: "bead" },
  ];
  const metadata = { StudyInformation: {} };
  server.answers["/v1/plate-maps/check"] = {
    ...{ plate_format: 24, plate_map: wells, metadata, notes: ["A1 is read as A01"] },
  };
  server.answers["/v1/preflight"] = {
    checks: [
      { code: "camera", passed: true, blocks: true, detail: "the camera sends frames", what_to_do: null },
      {
        code: "disk",
        passed: false,
        blocks: true,
        detail: "this plate needs 12 GB, 3 GB are free",
        what_to_do: "Free 9 GB.",
      },
    ],
  };
  await page.getByLabel("Plate map").setInputFiles({ ...map, buffer: Buffer.from("well,dpf\nA1,3\n") });
  await until("plate-holds", /^2 wells: 1 larva of 3 dpf, 1 bead\.$/);
  assert.equal(await page.locator("#new-run-list li").innerText(), "A1 is read as A01");
  // The plate is drawn before the start, on the plate that the map names.
  assert.equal(await page.locator("#plan-plate").getAttribute("data-wells"), "24");
  assert.equal(await page.locator("#plate-format").inputValue(), "24");
  assert.equal(await page.locator("#plan-plate [data-planned]").count(), 2);
  assert.match(
    (await page.locator('[data-planned="A01"]').getAttribute("title")) ?? "",
    /larva, 3 dpf, DMSO; number 1/,
  );
  assert.deepEqual(await page.locator("#plan-legend li").allInnerTexts(), [
    "a\nlarva, 3 dpf, DMSO (1 well)",
    "b\nbead (1 well)",
  ]);
  // Another plate: the map is checked again, on this one.
  server.refusal = {
    code: "invalid_plate_map",
    detail: "...",
    errors: [{ line: 2, column: "well", detail: "A01 is not on it" }],
  };
  await page.locator("#plate-format").selectOption({ label: "6 wells" });
  await until("new-run-words", /^map\.csv cannot be used: 1 mistake\.$/);
  assert.equal(await page.locator("#new-run-list li").innerText(), "Line 2, well: A01 is not on it");
  await until("new-run-missing", /a plate map without mistakes/);
  server.refusal = null;
  server.answers["/v1/plate-maps/check"] = { plate_format: 48, plate_map: wells, metadata, notes: [] };
  await page.locator("#plate-format").selectOption({ label: "48 wells" });
  await page.locator('#plan-plate[data-wells="48"]').waitFor();
  assert.equal(await page.locator("#start").isDisabled(), true, "barcode and operator are missing");
  await page.getByLabel("Plate barcode").fill("P-7");
  await until("new-run-missing", /^Still needed: your name\.$/);
  await page.getByLabel("Plate barcode").fill("P 7/b");
  await until("barcode-words", /^A barcode has letters, digits, dots, _ and - only/);
  await until("new-run-missing", /^Still needed: another barcode, your name\.$/);
  await page.getByLabel("Plate barcode").fill("P-7");
  await page.locator("#barcode-words").waitFor({ state: "hidden" });
  await page.getByLabel("Operator").fill("Kim");
  await page.locator("#new-run-missing").waitFor({ state: "hidden" });
  await page.getByRole("button", { name: "Preflight" }).click();
  await until("new-run-words", /1 of 2 checks failed\. The run would not start\./);
  assert.match(
    await page.locator("#new-run-list li").first().innerText(),
    /✕ Disk: this plate needs 12 GB.*Free 9 GB/s,
  );
  assert.deepEqual(await page.locator("#new-run-list h3").allInnerTexts(), [
    "What prevents the start",
    "What is right",
  ]);
  await shoot(page, "preflight");
  await page.getByLabel("Operator").fill("Kim B.");
  await page.locator("#new-run-words").waitFor({ state: "hidden" });
  assert.equal(await page.locator("#new-run-list li").count(), 0, "a preflight of another plan is none of this one");
  await page.getByLabel("Operator").fill("Kim");
  server.publish(status({ ready: false, not_ready_reason: "a fault stands: The disk is full." }));
  await until("new-run-missing", /^No run can start yet: a fault stands: The disk is full\.$/);
  assert.equal(await page.locator("#start").isDisabled(), true);
  assert.equal(await page.locator("#preflight").isEnabled(), true);
  server.publish(status());

  await page.getByLabel("Run name").fill("monday-1");
  await page.getByRole("button", { name: "Start", exact: true }).click();
  await page.waitForFunction(() => document.querySelector<HTMLInputElement>("#barcode")?.value === "");
  server.publish(running(1));
  await page.locator("#new-run").waitFor({ state: "hidden" });
  const plan = {
    ...{ plate_barcode: "P-7", method: "standard", operator: "Kim", plate_format: 48, plate_map: wells, metadata },
  };
  const check = "POST /v1/plate-maps/check";
  assert.deepEqual(commands(), [check, check, "POST /v1/preflight", "PUT /v1/runs/monday-1"]);
  assert.deepEqual(JSON.parse(server.taken[2]!.body), plan);
  assert.deepEqual(JSON.parse(server.taken[3]!.body), plan);
});

/** Fills the form of a new run. */
async function planned(): Promise<void> {
  server.answers["/v1/plate-maps/check"] = {
    ...{ plate_format: null, plate_map: [{ well: "A01" }], metadata: {}, notes: [] },
  };
  await page.goto(server.url);
  await until("method-words", /^21 views/);
  const map = { name: "map.csv", mimeType: "text/csv", buffer: Buffer.from("well\nA1\n") };
  await page.getByLabel("Plate map").setInputFiles(map);
  await until("plate-holds", /^1 well:/);
  await page.getByLabel("Plate barcode").fill("P-7");
  await page.getByLabel("Operator").fill("  ");
  await until("new-run-missing", /^Still needed: your name\.$/);
  assert.equal(await page.locator("#start").isDisabled(), true, "blanks are no name");
  await page.getByLabel("Operator").fill("Kim");
  await page.getByLabel("Run name").fill("monday-1");
}

const start = () => page.getByRole("button", { name: "Start", exact: true }).click();

test("a start that lost against another one says which run is under way, also once the form is hidden", async () => {
  const another = /^The run was not started\. Another run is under way: demo-1\.$/;
  const detail = "the instrument is in state Execute; this command is accepted in [Idle, Complete, Stopped, Aborted]";
  await planned();
  server.refusal = { code: "wrong_state", detail, run: "demo-1" };
  await start();
  // The status of the other run comes after the refusal.
  await until("new-run-words", another);
  server.publish(running(1));
  await page.locator("#new-run").waitFor({ state: "hidden" });
  await until("answer", another);
  assert.equal(await page.locator("#answer").isVisible(), true);
  server.publish(running(2));
  await until("sentence", /view 3/);
  assert.equal(await page.locator("#answer").isVisible(), true, "it stands while that run is under way");
  const over = { ...running(22), run: run([measured], { outcome: "succeeded" }), specimen: null };
  server.publish({ ...over, state: "Complete" });
  await page.locator("#new-run").waitFor();
  assert.equal(await page.locator("#new-run-words").isVisible(), false, "the other run has ended");
  assert.equal(await page.locator("#answer").isVisible(), false, "the other run has ended");
  assert.equal(await page.getByLabel("Plate barcode").inputValue(), "P-7");
  // The status of the other run comes before the refusal.
  let release = () => {};
  await page.route("**/v1/runs/monday-1", async (route) => {
    await new Promise<void>((resolve) => (release = resolve));
    await route.continue();
  });
  const asked = page.waitForRequest("**/v1/runs/monday-1");
  await start();
  await asked;
  server.publish(running(1));
  await page.locator("#new-run").waitFor({ state: "hidden" });
  release();
  await until("answer", another);
  assert.equal(await page.locator("#answer").isVisible(), true);
  // A refusal without another run is over when the state changes.
  await page.unroute("**/v1/runs/monday-1");
  server.publish({ ...over, state: "Aborted" });
  await page.locator("#new-run").waitFor();
  server.refusal = { code: "busy", detail: "the instrument is being checked" };
  await start();
  await until("new-run-words", /^The run was not started: the instrument is being checked\.$/);
  server.publish({ ...over, state: "Complete" });
  await page.locator("#new-run-words").waitFor({ state: "hidden" });
});

test("a start under the name of an earlier run with the same plan says that nothing was started", async () => {
  await planned();
  server.known.add("monday-1");
  await start();
  await until(
    "new-run-words",
    /^Run monday-1 exists already; nothing was started\. Choose another run name, or leave it empty\.$/,
  );
  assert.equal(await page.getByLabel("Plate barcode").inputValue(), "P-7", "the form is kept");
  await page.getByLabel("Run name").fill("monday-2");
  await start();
  await page.waitForFunction(() => document.querySelector<HTMLInputElement>("#barcode")?.value === "");
});

test("after a question the focus is on the button that asked it, or on what the instrument does", async () => {
  server.publish(running(9));
  await page.goto(server.url);
  await page.locator("#abort").focus();
  await page.keyboard.press("Enter");
  await page.locator("#ask-no:focus").waitFor();
  await page.keyboard.press("Escape");
  await page.locator("#abort:focus").waitFor();
  await page.keyboard.press("Enter");
  await page.locator("#ask-no:focus").waitFor();
  await page.keyboard.press("Enter");
  await page.locator("#abort:focus").waitFor();
  await page.locator("#stop").click();
  await page.locator("#ask-yes").click();
  await until("answer", /accepted/);
  await page.locator("#stop:focus").waitFor();
  server.publish({ ...running(10), pending: { hold: false, stop: true, abort: false } });
  await page.locator("#now:focus").waitFor();
});

test("the question of an abort follows the run: a held one has no specimen under way", async () => {
  server.publish(running(9));
  await page.goto(server.url);
  await page.getByRole("button", { name: "Abort run" }).click();
  await until("ask-words", /; the specimen in the capillary is not measured\.$/);
  server.publish({ ...running(22), state: "Holding", pending: { hold: true, stop: false, abort: false } });
  await until("state", /Holding/i);
  await until("ask-words", /; the specimen in the capillary is not measured\.$/);
  server.publish({ ...running(22), state: "Held" });
  await until("ask-words", /; wells that were not visited stay without numbers\.$/);
  await until("ask-title", /^Abort run demo-1\?$/);
});

test("a question about a run that ended meanwhile goes away", async () => {
  server.publish(running(9));
  await page.goto(server.url);
  await page.getByRole("button", { name: "Abort run" }).click();
  await until("ask-title", /demo-1/);
  server.publish({ ...running(22), run: run([measured], { outcome: "succeeded" }), specimen: null, state: "Complete" });
  await page.locator("dialog").waitFor({ state: "hidden" });
  assert.deepEqual(server.taken, []);
});

test("a page whose long polls are refused asks from time to time, and is not cut off", async () => {
  server.isFull = true;
  await page.goto(server.url);
  await until("link", /^Live$/);
  const links = page.locator("#link");
  const seen: string[] = [];
  await page.exposeFunction("seen", (text: string) => seen.push(text));
  await links.evaluate((link) => {
    const told = (globalThis as unknown as { seen: (text: string) => void }).seen;
    new MutationObserver(() => told(link.textContent ?? "")).observe(link, {
      childList: true,
      characterData: true,
      subtree: true,
    });
  });
  for (const reason of ["one reason", "another reason"]) {
    server.publish(status({ ready: false, not_ready_reason: reason }));
    await until("progress-line", new RegExp(`: ${reason}`));
  }
  assert.ok(server.asked.filter((query) => query.includes("wait")).length >= 2, "it tries to wait again");
  // On a busy machine an answer may take longer than the time after which the page names the silence.
  assert.ok(!seen.includes("Connection lost"), seen.join(", "));
});

test("a lost connection is said with its age, and heals by itself", async () => {
  server.publish(running(9));
  await page.goto(server.url);
  await until("link", /^Live$/);
  const port = Number(new URL(server.url).port);
  await server.stop();
  await until("lost", /the daemon cannot be reached\. What is shown below is \d+ s old/);
  assert.equal(await text("link"), "Connection lost");
  // Anyone who looks at the page must see the age rise.
  await until("lost", /is ([2-9]|\d\d+) s old/);
  await shoot(page, "connection-lost");
  // A daemon that starts anew counts its revisions from 1 again.
  server = new FixtureServer(status({ boot_id: "c9e2", doing: "waiting for a run after the restart" }));
  server.answers["/v1/methods"] = { methods: [] };
  await server.start(port);
  await until("sentence", /after the restart/);
  assert.equal(server.asked[0], "", "a revision of the old daemon means nothing to the new one");
  assert.equal(await text("link"), "Live");
  assert.equal(await page.locator("#lost").isVisible(), false);
});

test("what draws the model is read again after the connection was lost while it was read", async () => {
  let times = 0;
  await page.route("**/three.js", (route) => ((times += 1) === 1 ? route.abort() : route.continue()));
  server.publish(running(9));
  await page.goto(server.url);
  await until("link", /^Live$/);
  server.publish(running(10));
  await page.locator("#model-box canvas").waitFor();
  assert.ok(times >= 2, `read ${times} times`);
});

test("an instrument that wants its token gets it from the operator", async () => {
  server.token = "s3cret";
  server.publish(running(9));
  await page.goto(server.url);
  await until("lost", /send the instrument's token/);
  await page.getByLabel("Token of this instrument").fill("s3cret");
  await page.getByRole("button", { name: "Use it" }).click();
  await until("link", /^Live$/);
  await page.locator("#token-form").waitFor({ state: "hidden" });
  await page.locator("#frame-image").waitFor();
});

test("the page holds on a telephone", async () => {
  server.publish({ ...running(9), faults: [fault({ operator_required: true })] });
  await page.setViewportSize({ width: 390, height: 844 });
  await page.goto(server.url);
  await page.locator("#frame-image").waitFor();
  const overflow = await page.evaluate(
    () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
  );
  assert.equal(overflow, 0, "no sideways scrolling");
  assert.ok((await page.locator("#sentence").boundingBox())!.width > 250, "the sentence has the page's width");
  // State, plate and well come first, the pictures behind them, and the instrument last.
  const tops = await Promise.all(
    ["now", "plate", "well-body", "frame-box", "chart", "rig-panel"].map(async (id) => {
      return (await page.locator(`#${id}`).boundingBox())!.y;
    }),
  );
  assert.deepEqual(
    tops,
    [...tops].sort((a, b) => a - b),
  );
  await shoot(page, "telephone");
  // The form for a new run is folded, and can be opened.
  server.publish(status());
  await page.getByText("New run", { exact: true }).waitFor();
  assert.equal(await page.getByLabel("Plate map").isVisible(), false);
  await page.getByText("New run", { exact: true }).click();
  await page.getByLabel("Plate map").waitFor();
});

test("the page holds on a tablet and on a plate of 384 wells", async () => {
  const many = Array.from({ length: 384 }, (_, i) =>
    well(`${String.fromCharCode(65 + Math.floor(i / 24))}${String((i % 24) + 1).padStart(2, "0")}`, {
      outcome: i < 40 ? "succeeded" : null,
      volume_um3: i < 40 ? 240_000_000 + i * 1e6 : null,
    }),
  );
  server.publish({ ...running(9), run: run(many, { eta_s: { p50: 20_000, p90: 21_000 } }), specimen: null });
  await page.setViewportSize({ width: 820, height: 1180 });
  await page.goto(server.url);
  await page.locator('[data-well="P24"].well').waitFor();
  const overflow = await page.evaluate(
    () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
  );
  assert.equal(overflow, 0, "no sideways scrolling");
  await shoot(page, "tablet-384");
});
