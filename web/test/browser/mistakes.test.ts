// An operator who does the wrong thing, with real clicks on the real daemon: double clicks, a reload within a question, two tabs, a run name
// that is taken, names that are too long, and remarks that are not saved when something else happens.

import assert from "node:assert/strict";
import { test } from "node:test";
import { shoot } from "../support/browser.ts";
import { RUN_MS } from "../support/daemon.ts";
import { onPage, opened, until } from "../support/opened.ts";

const MAP =
  'well,specimen,dpf,compound\nA01,larva,3,"5-(N,N) ""Müller"" <b>ß"\nA02,larva,3,\nA03,larva,3,\nA05,larva,3,\n';

test(
  "double clicks, reloads, two tabs, taken names and unsaved remarks lose nothing",
  { timeout: 3 * RUN_MS },
  async (t) => {
    const { daemon, page, complaints } = await opened(t, 20);
    const choose = (name: string, text: string) =>
      page.getByLabel("Plate map").setInputFiles({ name, mimeType: "text/csv", buffer: Buffer.from(text) });
    await choose("picture.png", "\u0089PNG\r\n\u001a\n\0\0\0\rIHDR");
    await until(page, "new-run-words", /^picture\.png cannot be used: 1 mistake\.$/);
    await until(page, "new-run-list", /a picture or another file that is no text; choose the CSV file/);
    await choose("map.csv", MAP);
    await until(page, "plate-holds", /^4 wells: 4 larvae of 3 dpf\.$/);
    await page.getByLabel("Plate barcode").fill("P-1");
    const operator = page.getByLabel("Operator", { exact: true });
    await operator.fill("Ö".repeat(1000));
    assert.equal((await operator.inputValue()).length, 64, "no name is longer than the log keeps");
    await operator.fill(`K"im <b>Ö'Néill`);
    await page.getByLabel("Run name").fill("../one two");
    await until(page, "new-run-missing", /a run name of letters, digits, dots, _ and - alone/);
    await page.getByLabel("Run name").fill("one");
    await page.getByRole("button", { name: "Start", exact: true }).dblclick();
    const started = await daemon.follow((s) => s.run?.id === "one");
    assert.equal(started.run!.operator, `K"im <b>Ö'Néill`);

    // A double click asks once and answers nothing; a reload closes the question.
    await daemon.follow((s) => s.run!.results.some((w) => w.outcome === "succeeded"));
    await page.getByRole("button", { name: "Hold", exact: true }).dblclick();
    const held = await daemon.follow((s) => s.state === "Held");
    assert.equal(held.run!.outcome, null);
    await page.getByRole("button", { name: "Abort run" }).dblclick();
    await page.locator("#ask-yes").waitFor();
    await page.reload();
    await page.locator("#link", { hasText: /^Live$/ }).waitFor();
    assert.equal(await page.locator("#ask-yes").isVisible(), false);

    // What is typed about a well and not saved is there again after a look at another one, and is not said of that one.
    const of = held.run!.results.find((w) => w.outcome === "succeeded")!.well;
    const about = async (well: string) => {
      await page.locator(`#plate button[data-well="${well}"]`).click();
      await until(page, "well-heading", new RegExp(`^Well ${well}$`));
    };
    const words = page.getByLabel("Remark or reason");
    await about(of);
    await page.getByText("Remark, leave out, skip, measure again").click();
    await words.fill(`half a "sentence" äöü`);
    await about("A05");
    assert.equal(await words.inputValue(), "");
    await about(of);
    await until(page, "remark-words", /^What is typed here is not saved yet\.$/);
    assert.equal(await words.inputValue(), `half a "sentence" äöü`);

    // Another tab aborts the run and says something of the same well: the first one shows both and keeps what is typed.
    const { page: other } = await onPage(t, daemon);
    await page.getByRole("button", { name: "Abort run" }).click();
    await other.getByRole("button", { name: "Abort run" }).click();
    await other.locator("#ask-yes").click();
    await daemon.follow((s) => s.run!.outcome === "aborted");
    await page.locator("#ask-yes").waitFor({ state: "hidden" });
    const note = { by: "Lee", excluded: true, comment: "x".repeat(1000), tags: [] };
    await daemon.send("PUT", `/v1/runs/one/wells/${of}/note`, note);
    await until(page, "remark-words", /^Lee has saved a remark meanwhile: x+\. What is typed here is not saved yet\.$/);
    assert.equal(await words.inputValue(), `half a "sentence" äöü`);
    const said = (await page.locator(".remark-said").boundingBox())!;
    assert.ok(said.height < 300, `a long remark takes ${said.height} px`);
    await page.getByText("Wells as a table").click();
    await page.locator("main table", { hasText: note.comment }).waitFor();
    const beyond = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    assert.ok(beyond <= 0, `the page is ${beyond} px wider than its window`);
    await shoot(page, "mistakes-remark");
    await page.getByLabel("Leave it out of statistics").uncheck();
    await page.getByRole("button", { name: "Save remark" }).click();
    await until(page, "remark-words", /^The remark is kept\.$/);
    await until(page, "well-body", /K"im <b>Ö'Néill: half a "sentence" äöü\./);

    // A name that is taken keeps the plan. The rest is asked for twice.
    const state = await daemon.follow(() => true);
    if (state.plate.take_out !== null) await page.locator("#is-out").click();
    await page.locator("#measure-rest").dblclick();
    await until(page, "plate-holds", /^Of run one: \d+ wells?: /);
    await page.getByLabel("Run name").fill("one");
    await page.getByRole("button", { name: "Start", exact: true }).click();
    await until(
      page,
      "new-run-words",
      /^The run was not started: run one exists with another plan; name the new run otherwise\.$/,
    );
    await until(page, "plate-holds", /^Of run one: \d+ wells?: /);
    await shoot(page, "mistakes-taken");
    await page.getByLabel("Run name").fill("two");
    await page.getByRole("button", { name: "Start", exact: true }).dblclick();
    await daemon.follow((s) => s.run?.id === "two");
    assert.deepEqual(complaints, []);
  },
);
