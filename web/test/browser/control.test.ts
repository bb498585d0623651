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
