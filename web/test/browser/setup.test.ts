// The page of `carved setup --listen` on an emulated rig: from no file to a configuration with a right bead; and with mistakes.
//
// CARVED_BIN names the program; without it the one that `cargo test` has left in target/debug is used.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { join } from "node:path";
import type { Browser, Page } from "playwright-core";
import { isAccessible } from "../support/axe.ts";
import { openBrowser, openPage, shoot } from "../support/browser.ts";
import { SetUp } from "../support/setup.ts";

/** Two turns, one turn and one turn again, each with its pictures, in a test build on a busy machine. */
const WORK_MS = 240_000;

let browser: Browser;
before(async () => void (browser = await openBrowser()));
after(async () => browser?.close());

/** Waits for a question, gives an answer, and does not wait for what follows. */
async function answer(page: Page, title: string, typed?: string): Promise<void> {
  await page.getByRole("heading", { name: title, exact: true }).waitFor({ timeout: WORK_MS });
  if (typed !== undefined) {
    const field = page.locator("#input input[type=text]");
    if (await field.count()) await field.fill(typed);
    else await page.locator(`#input input[value="${typed}"]`).check();
  }
  await page.locator("#send").click();
}

/** The answers of a person from the start to the question of the bore. */
async function toTheBore(page: Page, folder: string): Promise<void> {
  await answer(page, "Name of the instrument", "bench");
  await answer(page, "Port of the controller");
  await answer(page, "Steps of one turn");
  await answer(page, "Step 0");
  await answer(page, "Light");
  await answer(page, "Camera");
  await answer(page, "Format of the frames");
  await answer(page, "Width of the picture");
  await answer(page, "Height of the picture");
  await answer(page, "Folder for the runs", join(folder, "data"));
  await answer(page, "The capillary is empty");
  await page.getByRole("heading", { name: "Inner diameter of the capillary" }).waitFor({ timeout: WORK_MS });
}

const number = (config: string, key: string) => Number(new RegExp(`^${key} = ([-0-9.]+)`, "m").exec(config)?.[1]);

test("a rig is set up by clicks, and its bead is right", { timeout: 3 * WORK_MS }, async () => {
  const setUp = await SetUp.start();
  try {
    const { page, complaints } = await openPage(browser, { width: 1280, height: 900 });
    await page.goto(setUp.url);
    assert.equal(await page.getByText("SIMULATED", { exact: true }).isVisible(), true);
    await toTheBore(page, setUp.folder);
    // The bore is what the person is told, and nothing else is proposed.
    await page.getByText("Its capillary has an inner diameter of 650 um").first().waitFor();
    assert.equal(await page.locator("#input input[type=text]").inputValue(), "");
    await shoot(page, "setup-bore");
    await isAccessible(page, "set-up");
    assert.ok(await page.locator("#picture").isVisible(), "the picture of the empty capillary");
    await answer(page, "Inner diameter of the capillary", "650");
    await answer(page, "Diameter of the bead", "500");
    await answer(page, "Accepted deviation");
    await answer(page, "The bead is in the picture");
    await page.getByRole("heading", { name: "The motors may move" }).waitFor();
    await shoot(page, "setup-motion");
    await answer(page, "The motors may move");
    await page.getByText(/^Picture \d+ of \d+\.$/).waitFor({ timeout: WORK_MS });
    await shoot(page, "setup-turn");
    await answer(page, "Sense of the turn", "down");
    await answer(page, "Ruler", "bead");
    await page.getByRole("heading", { name: "The rig is set up" }).waitFor({ timeout: WORK_MS });
    await shoot(page, "setup-done");
    await isAccessible(page, "set-up");
    assert.match(
      await page.locator("#ended").innerText(),
      /The bead is right: (499|500|501)\.\d+ um measured, 500 um stated/,
    );
    const config = await setUp.config();
    const scale = number(config, "ky_px_per_um") * 5.2;
    assert.ok(Math.abs(scale - 1) < 0.01, `scale ${scale} of the true one`);
    assert.ok(Math.abs(number(config, "uy_px") - 498) < 0.2, config);
    assert.doesNotMatch(config, /5\.5 um/, "the scale of the example, beside that of this rig");
    await page.getByRole("button", { name: "Close the set-up" }).click();
    assert.equal(await setUp.ended(), 0, setUp.log);
    assert.deepEqual(complaints, []);
  } catch (error) {
    throw new Error(`${(error as Error).message}\n${setUp.log}`, { cause: error });
  } finally {
    await setUp.remove();
  }
});

test(
  "a wrong number is refused with the reason, back goes back, and a stop ends the set-up",
  { timeout: 2 * WORK_MS },
  async () => {
    let setUp = await SetUp.start();
    try {
      const { page, complaints } = await openPage(browser, { width: 1280, height: 900 });
      await page.goto(setUp.url);
      await toTheBore(page, setUp.folder);
      // 60, where the capillary has 600 um.
      await answer(page, "Inner diameter of the capillary", "60");
      await page.getByText("60 um; expected 100 to 5000 um.").waitFor();
      await shoot(page, "setup-refused");
      await isAccessible(page, "set-up");
      assert.equal(await page.locator("#input input[type=text]").inputValue(), "60", "what was typed stays");
      await answer(page, "Inner diameter of the capillary", "650");
      // Unusual: it has to be said twice, and is not.
      await answer(page, "Diameter of the bead", "50");
      await page.getByText(/A bead of 50 um in a bore of 650 um; usual are 130 to 63\d um/).waitFor();
      await page.getByRole("button", { name: "Back" }).click();
      await answer(page, "Inner diameter of the capillary", "650");
      await page.getByRole("heading", { name: "Diameter of the bead" }).waitFor();
      assert.ok(
        await page.locator("#refused").isHidden(),
        "the reason belongs to an answer that is not given any more",
      );
      // Another process goes on after the end of this one, as after a power cut.
      await setUp.kill();
      await page.getByText("The set-up cannot be reached").waitFor();
      setUp = await SetUp.start(setUp.folder);
      await page.goto(setUp.url);
      await answer(page, "Diameter of the bead", "500");
      await answer(page, "Accepted deviation");
      await answer(page, "The bead is in the picture");
      await answer(page, "The motors may move");
      await page.getByText(/^Picture \d+ of \d+\.$/).waitFor({ timeout: WORK_MS });
      await page.keyboard.press("F8");
      await page.getByRole("heading", { name: "The set-up has ended" }).waitFor();
      await page.getByText("the motors were told to stop").waitFor();
      await shoot(page, "setup-stopped");
      assert.notEqual(await setUp.ended(), 0, "a stopped set-up has not succeeded");
      const fetches = complaints.filter((text) => !text.includes("ERR_CONNECTION_REFUSED"));
      assert.deepEqual(fetches, []);
    } catch (error) {
      throw new Error(`${(error as Error).message}\n${setUp.log}`, { cause: error });
    } finally {
      await setUp.remove();
    }
  },
);
