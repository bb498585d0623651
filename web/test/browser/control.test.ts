// The commands of the page against the running daemon: each test clicks, and looks what the daemon did.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { openBrowser, openPage, shoot } from "../support/browser.ts";
import { BINARY, Daemon } from "../support/daemon.ts";

let browser: Browser;

before(async () => {
  browser = await openBrowser();
});
after(async () => {
  await browser?.close();
});

const plan = (wells: object[], more: object = {}) => ({
  plate_barcode: "P-1",
  method: "standard",
  operator: "Kim",
  plate_map: wells,
  ...more,
});
const larva = (well: string) => ({ well, specimen: "larva", dpf: 3 });

/** A daemon with these arguments, and its page. Both end with the test. */
async function opened(
  t: { after: (end: () => Promise<unknown>) => void },
  timeScale: number,
  more: readonly string[] = [],
  context: Parameters<typeof openPage>[1] = {},
): Promise<{ daemon: Daemon; page: Page; complaints: string[] }> {
  const daemon = await Daemon.start(BINARY, timeScale, more);
  t.after(() => daemon.stop());
  const { page, complaints } = await openPage(browser, context);
  t.after(() => page.context().close());
  await page.goto(daemon.url);
  await page.locator("#link", { hasText: /^Live$/ }).waitFor();
  return { daemon, page, complaints };
}

/** Whether the element at the middle of the stop is the stop, within the window. */
const isInReach = (page: Page) =>
  page.locator("#emergency-stop").evaluate((button) => {
    const { left, top, width, height } = button.getBoundingClientRect();
    return button.contains(document.elementFromPoint(left + width / 2, top + height / 2));
  });

for (const [name, size, press] of [
  ["mouse", { width: 1440, height: 600 }, (page: Page) => page.locator("#emergency-stop").click({ timeout: 5000 })],
  ["touch", { width: 390, height: 844 }, (page: Page) => page.locator("#emergency-stop").tap({ timeout: 5000 })],
  ["keyboard", { width: 820, height: 500 }, (page: Page) => page.keyboard.press("F8")],
  [
    "tab",
    { width: 820, height: 500 },
    async (page: Page) => {
      // From the question back to the header.
      for (let i = 0; i < 3 && (await page.locator("#emergency-stop:focus").count()) === 0; i += 1)
        await page.keyboard.press("Shift+Tab");
      await page.keyboard.press("Enter");
    },
  ],
] as const) {
  test(`the emergency stop works over a question and wherever the page is scrolled: ${name}`, async (t) => {
    const { daemon, page, complaints } = await opened(t, 1, ["--no-demo"], { ...size, hasTouch: name === "touch" });
    await daemon.send("PUT", "/v1/runs/stop-1", plan([larva("A01"), larva("A02")]));
    await page.getByRole("button", { name: "Abort run" }).click();
    await page.locator("#ask").waitFor();
    assert.ok(await isInReach(page), "over the question");
    await page.evaluate(() => window.scrollTo(0, document.body.scrollHeight));
    assert.ok((await page.evaluate(() => window.scrollY)) > 200, "the page is long enough to scroll");
    assert.ok(await isInReach(page), "at the end of the page");
    await shoot(page, `stop-${name}`);
    await press(page);
    const stopped = await daemon.follow((s) => s.state === "Aborted");
    assert.deepEqual([stopped.faults.map((f) => f.code), stopped.run?.outcome], [["emergency_stop"], "aborted"]);
    await page.locator("#emergency-answer", { hasText: "the motors were stopped" }).waitFor();
    await page.locator("#ask").waitFor({ state: "hidden" });
    assert.ok(await isInReach(page), "with its answer");
    // What the question made inert is so no more.
    await page.getByRole("button", { name: "Acknowledge" }).click();
    await daemon.follow((s) => s.faults.length === 0);
    await page.locator("#emergency-answer").waitFor({ state: "hidden" });
    assert.deepEqual(complaints, []);
  });
}

test("a question keeps the focus off the rest of the page, and Escape closes it", async (t) => {
  const { daemon, page } = await opened(t, 1, ["--no-demo"]);
  await daemon.send("PUT", "/v1/runs/ask-1", plan([larva("A01")]));
  const abort = page.getByRole("button", { name: "Abort run" });
  await abort.click();
  assert.ok(await page.locator("#ask-no").evaluate((no) => no === document.activeElement));
  for (let i = 0; i < 6; i += 1) {
    await page.keyboard.press("Tab");
    assert.ok(await page.evaluate(() => !document.activeElement?.closest("main")), "what is behind is inert");
  }
  await page.keyboard.press("Escape");
  await page.locator("#ask").waitFor({ state: "hidden" });
  assert.equal((await daemon.status()).run?.outcome, null, "Escape aborts nothing");
  await abort.click();
  await page.locator("#ask-yes").click();
  await daemon.follow((s) => s.run?.outcome === "aborted");
});

/** The identifiers of the buttons of the main part, the largest first. */
const bySize = (page: Page) =>
  page.locator("main button:visible").evaluateAll((buttons) => {
    const area = (b: Element) => b.getBoundingClientRect().width * b.getBoundingClientRect().height;
    return buttons.sort((a, b) => area(b) - area(a)).map((b) => b.id);
  });

test("a lost camera: shown at once, its remedy is the headline, and nobody is offered to go on before it is back", async (t) => {
  const { daemon, page, complaints } = await opened(t, 1, ["--no-demo", "--camera-out", "8,45"]);
  await daemon.send("PUT", "/v1/runs/camera-1", plan([larva("A01"), larva("A02")]));
  const lost = await daemon.follow((s) => !s.hardware.camera.connected);
  assert.equal(lost.state, "Execute");
  await page.locator('#now[data-tone="attention"]').waitFor();
  const held = await daemon.follow((s) => s.state === "Held");
  const hold = held.run!.hold!;
  assert.deepEqual([hold.code, hold.times, hold.next_command], ["camera_lost", 1, null]);
  await page
    .locator("#sentence", { hasText: /^Check the camera's power and network cable\. The run goes on by/ })
    .waitFor();
  await page.locator("#diagnosis", { hasText: /^Held because: The camera does not answer/ }).waitFor();
  await page.locator("#fault-list", { hasText: "Needs you" }).waitFor();
  assert.equal(await page.locator("#unhold").isVisible(), false);
  assert.equal(await page.getByRole("button", { name: "Acknowledge" }).count(), 0);
  await shoot(page, "control-camera-lost");
  // Held by an operator too, it waits once the camera is back, and its words no longer say that it does not.
  await page.getByRole("button", { name: "Keep it held" }).click();
  await page.locator("#sentence", { hasText: /When the camera answers, let the run go on\.$/ }).waitFor();
  await daemon.follow((s) => s.faults.length === 0);
  await page.locator("#sentence", { hasText: /^Let the run go on when you are ready\.$/ }).waitFor();
  await page.locator("#diagnosis", { hasText: /^Held because: The camera does not answer/ }).waitFor();
  assert.equal((await bySize(page))[0], "unhold", "the one thing to do is the largest button");
  await shoot(page, "control-camera-back");
  await page.locator("#unhold").click();
  await daemon.follow((s) => s.state === "Execute" && s.hardware.camera.connected);
  await page.locator("#diagnosis").waitFor({ state: "hidden" });
  assert.deepEqual(complaints, []);
});

test("who exchanges specimens by hand reads each step, and its button is the largest", async (t) => {
  const { daemon, page, complaints } = await opened(t, 20, ["--no-demo", "--sampler", "loader"]);
  await daemon.send("PUT", "/v1/runs/hand-1", plan([larva("A01"), larva("A02")]));
  await page
    .locator("#sentence", { hasText: /^By hand: put the specimen of A01 into the capillary, then confirm\.$/ })
    .waitFor();
  assert.equal((await bySize(page))[0], "is-in");
  await shoot(page, "control-by-hand");
  await page.locator("#is-in").click();
  await page.locator("#ask-yes").click();
  await daemon.follow((s) => s.specimen?.well === "A01" && s.specimen.in_capillary && s.state === "Execute");
  await page.locator("#sentence", { hasText: /^Well A01/ }).waitFor();
  await daemon.follow((s) => s.plate.take_out === "A01" && s.plate.bring === "A02");
  await page
    .locator("#sentence", { hasText: /^By hand: take the specimen of A01 out of the capillary, then confirm\.$/ })
    .waitFor();
  assert.equal((await bySize(page))[0], "is-out");
  await page.locator("#is-out").click();
  await page.locator("#ask-yes").click();
  await page
    .locator("#sentence", { hasText: /^By hand: put the specimen of A02 into the capillary, then confirm\.$/ })
    .waitFor();
  assert.equal((await daemon.status()).plate.take_out, null);
  assert.deepEqual(complaints, []);
});

test("a run from its map to its numbers: unknown columns, barcode, hold, one reported volume", async (t) => {
  const { daemon, page, complaints } = await opened(t, 20, ["--no-demo"]);
  await page
    .locator("#new-run-missing", { hasText: /^Still needed: a plate map, the plate's barcode, your name\.$/ })
    .waitFor();
  const map = (text: string) => ({ name: "map.csv", mimeType: "text/csv", buffer: Buffer.from(text) });
  await page.getByLabel("Plate map").setInputFiles(map("well,dpf,colour\nZZ9,3,red\nA02,old,\n"));
  await page.locator("#new-run-words", { hasText: /^map\.csv cannot be used: 2 mistakes\.$/ }).waitFor();
  const strain = "well,specimen,dpf,strain,colour\nA01,larva,3,ABxTL,red\nA02,larva,3,ABxTL,\n";
  await page.getByLabel("Plate map").setInputFiles(map(strain));
  await page.locator("#new-run-list", { hasText: /colour: carved does not read this column and keeps it/ }).waitFor();
  await page.getByLabel("Operator").fill("Kim");
  await page.getByLabel("Plate barcode").fill("P/7 b");
  await page.locator("#barcode-words", { hasText: /^A barcode has letters, digits/ }).waitFor();
  assert.equal(await page.locator("#start").isDisabled(), true);
  await page.getByLabel("Plate barcode").fill("P-7");
  await page.getByLabel("Run name").fill("map-1");
  await page.getByRole("button", { name: "Start", exact: true }).click();
  await daemon.follow((s) => s.run?.id === "map-1");
  const stored = (await (await fetch(`${daemon.url}/v1/runs/map-1`)).json()) as { plan: { metadata: object } };
  assert.deepEqual(stored.plan.metadata, { columns: { colour: { A01: "red" } } });

  await daemon.follow((s) => (s.specimen?.view ?? 0) > 3);
  await page.getByRole("button", { name: "Hold", exact: true }).click();
  const held = await daemon.follow((s) => s.state === "Held");
  assert.deepEqual([held.run!.hold!.code, held.run!.hold!.next_command], ["operator", "unhold"]);
  await page.locator("#sentence", { hasText: /^Let the run go on when you are ready\.$/ }).waitFor();
  await page.locator("#diagnosis", { hasText: /^Held because: An operator asked for it\.$/ }).waitFor();
  // Ring, numbers and pictures are of one well.
  const ring = await page.locator('#plate [aria-pressed="true"]').getAttribute("data-well");
  await page.locator("#well-heading", { hasText: `Well ${ring}` }).waitFor();
  await page.locator("#frame-heading", { hasText: `Frame of ${ring}` }).waitFor();
  await shoot(page, "control-held");
  await page.locator("#unhold").click();
  const done = await daemon.follow((s) => {
    // Two thirds of a turn in sequence are views from enough sides: what is missing then is time.
    const { view, views_planned, volume_wait } = s.specimen ?? { view: 0, views_planned: 0, volume_wait: null };
    assert.ok(view < (2 / 3) * views_planned || volume_wait !== "views", `${view} of ${views_planned}`);
    return s.run?.outcome != null;
  });
  const [first] = done.run!.results;
  assert.equal(first!.outcome, "succeeded", JSON.stringify(first));
  // The map gave the strain, which is that of the references.
  const mismatches = [first!.reference!.volume, first!.reference!.area].flatMap((place) => place.mismatches).join();
  assert.doesNotMatch(mismatches, /strain/);

  await page.locator('button[data-well="A01"]').click();
  const card = page.locator('#well-body dl[data-well="A01"]');
  await card.locator('[data-number="volume"]').waitFor();
  assert.equal(await card.locator('[data-number="field-volume"]').isVisible(), false, "one volume is reported");
  await card.getByText("Other volumes, and why they differ").click();
  await card.locator('[data-number="field-volume"]', { hasText: /The surface that is drawn/ }).waitFor();
  await card.locator('[data-number="hull-volume"]', { hasText: /The live hull/ }).waitFor();
  await page.locator("#chart-caption", { hasText: /^A01: reported [\d.]+ ± [\d.]+.nL \(± 1 SD\)\.$/ }).waitFor();
  await shoot(page, "control-volumes");
  assert.deepEqual(complaints, []);
});
