// The commands of the page against the running daemon: each test clicks, and looks what the daemon did.

import assert from "node:assert/strict";
import { test } from "node:test";
import type { Page } from "playwright-core";
import { shoot } from "../support/browser.ts";
import { BINARY, Daemon } from "../support/daemon.ts";
import { bySize, larva, onPage, opened, plan } from "../support/opened.ts";

/** Whether the element at the middle of the stop is the stop, within the window. */
const isInReach = (page: Page) =>
  page.locator("#emergency-stop").evaluate((button) => {
    const { left, top, width, height } = button.getBoundingClientRect();
    return button.contains(document.elementFromPoint(left + width / 2, top + height / 2));
  });

test("the emergency stop works over a question and wherever the page is scrolled, and a question keeps the focus", async (t) => {
  const daemon = await Daemon.start(BINARY, 1, ["--no-demo"]);
  t.after(() => daemon.stop());
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
    await t.test(name, async () => {
      const { page, complaints } = await onPage(t, daemon, { ...size, hasTouch: name === "touch" });
      await daemon.send("PUT", `/v1/runs/stop-${name}`, plan([larva("A01"), larva("A02")]));
      await page.getByRole("button", { name: "Abort run" }).click();
      await page.locator("#ask").waitFor();
      assert.ok(await isInReach(page), "over the question");
      await page.evaluate(() => window.scrollTo(0, document.body.scrollHeight));
      assert.ok((await page.evaluate(() => window.scrollY)) > 200, "the page is long enough to scroll");
      assert.ok(await isInReach(page), "at the end of the page");
      await shoot(page, `stop-${name}`);
      await press(page);
      const stopped = await daemon.follow((s) => s.run?.id === `stop-${name}` && s.state === "Aborted");
      assert.deepEqual([stopped.faults.map((f) => f.code), stopped.run?.outcome], [["emergency_stop"], "aborted"]);
      await page.locator("#emergency-answer", { hasText: "the motors were stopped" }).waitFor();
      await page.locator("#ask").waitFor({ state: "hidden" });
      assert.ok(await isInReach(page), "with its answer");
      // What the question made inert is so no more.
      await page.getByRole("button", { name: "Acknowledge" }).click();
      await daemon.follow((s) => s.faults.length === 0);
      await page.locator("#emergency-answer").waitFor({ state: "hidden" });
      assert.deepEqual(complaints, []);
      await page.context().close();
    });
  }
  await t.test("focus", async () => {
    const { page } = await onPage(t, daemon);
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
});

test("an emergency stop reaches a daemon that hung or crashed when it was pressed", async (t) => {
  const { daemon, page } = await opened(t, 1);
  const stopped = async (run: string) => {
    const { faults } = await daemon.follow(
      (s) => s.run?.id === run && s.faults.some((f) => f.code === "emergency_stop"),
    );
    await page.locator("#emergency-answer", { hasText: "the motors were stopped" }).waitFor();
    await page.locator("#emergency-bar").waitFor({ state: "hidden" });
    const { seq } = faults.find((f) => f.code === "emergency_stop")!;
    await daemon.send("POST", `/v1/faults/${seq}/acknowledge`);
  };
  const unconfirmed = () =>
    page.locator("#emergency-words", { hasText: /was not confirmed: .* cut its power/ }).waitFor();

  await daemon.send("PUT", "/v1/runs/hung", plan([larva("A01")]));
  await daemon.follow((s) => s.specimen?.in_capillary === true);
  daemon.signal("SIGSTOP");
  await page.keyboard.press("F8");
  await unconfirmed();
  await page.locator("#link", { hasText: /No answer for|Connection lost/ }).waitFor();
  await shoot(page, "stop-hung");
  daemon.signal("SIGCONT");
  await stopped("hung");
  await daemon.follow((s) => s.run?.outcome === "aborted" && s.faults.length === 0);

  await daemon.send("PUT", "/v1/runs/crashed", plan([larva("A01")]));
  await daemon.follow((s) => s.run?.id === "crashed" && s.specimen?.in_capillary === true);
  await daemon.crash();
  await page.keyboard.press("F8");
  await unconfirmed();
  await daemon.again();
  await stopped("crashed");
});

test("who exchanges specimens by hand reads each step, and its button is the largest", async (t) => {
  // So slow that a turn is still under way when the page has shown it and the abort is confirmed.
  const { daemon, page, complaints } = await opened(t, 0.5, ["--sampler", "loader"]);
  await daemon.send("PUT", "/v1/runs/hand-1", plan(["A01", "A02", "A03"].map(larva)));
  await page
    .locator("#sentence", { hasText: /^By hand: put the specimen of A01 into the capillary, then confirm\.$/ })
    .waitFor();
  assert.equal((await bySize(page))[0], "is-in");
  await shoot(page, "control-by-hand");
  await page.locator("#is-in").click();
  await daemon.follow((s) => s.specimen?.well === "A01" && s.specimen.in_capillary && s.state === "Execute");
  await page.locator("#sentence", { hasText: /^Well A01/ }).waitFor();
  await daemon.follow((s) => s.plate.take_out === "A01" && s.plate.bring === "A02");
  await page
    .locator("#sentence", { hasText: /^By hand: take the specimen of A01 out of the capillary, then confirm\.$/ })
    .waitFor();
  assert.equal((await bySize(page))[0], "is-out");
  assert.equal(await page.locator("#is-in").isVisible(), false, "one step after the other");
  // One key for the whole exchange.
  await page.keyboard.press("n");
  await page.locator("#undo-words", { hasText: "A01 is out and A02 is in." }).waitFor();
  await shoot(page, "control-undo");
  // Aborted while A02 is inside: ring, card and pictures are of A02, whose stored views are shown, and A03 was never begun.
  await daemon.follow((s) => s.specimen?.well === "A02" && s.specimen.view > 2);
  await page.locator("#abort").click();
  await page.locator("#ask-yes").click();
  const { run } = await daemon.follow((s) => s.run?.outcome === "aborted");
  const [, cut, left] = run!.results;
  assert.ok(cut!.views! > 2 && cut!.views! < 21 && left!.views === 0, JSON.stringify([cut, left]));
  await page.locator('#plate [data-well="A02"][aria-pressed="true"][data-condition="cut"]').waitFor();
  await page.locator("#frame-heading", { hasText: /^Frame of A02$/ }).waitFor();
  await page.locator("#frame-whose", { hasText: new RegExp(`^view 1 of ${cut!.views}$`) }).waitFor();
  await page.locator("#well-body", { hasText: `Interrupted after ${cut!.views} views` }).waitFor();
  await page.locator("#well-files a").first().waitFor();
  assert.equal(await page.locator("#views-list button").count(), cut!.views);
  await shoot(page, "control-cut-short");
  await page.locator('#plate [data-well="A03"]').click();
  await page
    .locator("#frame-empty", { hasText: /^Well A03: not measured: the run was ended before its first view\.$/ })
    .waitFor();
  assert.deepEqual(complaints, []);
});
