// What people say about wells, with real clicks on the real daemon: a held run skips a well and measures another again, a well is left out of
// statistics by name and reason, and the rest of an aborted or interrupted plate is measured without its file. Beside it the contact sheet,
// the frame that is magnified, moved, made brighter and leafed through, and a flag that leads to its help.

import assert from "node:assert/strict";
import { test } from "node:test";
import type { Page } from "playwright-core";
import { shoot } from "../support/browser.ts";
import { RUN_MS } from "../support/daemon.ts";
import { larva, opened, plan, until } from "../support/opened.ts";

const pick = (page: Page, well: string) => page.locator(`#plate button[data-well="${well}"]`).click();

/** The well on the card, with the form for it. */
async function about(page: Page, well: string): Promise<void> {
  await pick(page, well);
  await until(page, "well-heading", new RegExp(`^Well ${well}$`));
  const form = page.locator("#remark-form");
  if (!(await form.isVisible())) await page.getByText("Remark, leave out, skip, measure again").click();
}

/** Where the edges of this picture of the frame are, in px from the same edges of its box. */
const edges = (page: Page, id = "frame-image") =>
  page.locator(`#${id}`).evaluate((image) => {
    const [picture, box] = [image.getBoundingClientRect(), image.parentElement!.getBoundingClientRect()];
    // With 0 added there is no -0, which `deepEqual` tells from 0.
    const off = (side: "left" | "top" | "right" | "bottom") => Math.round(picture[side] - box[side]) + 0;
    return { left: off("left"), top: off("top"), right: off("right"), bottom: off("bottom") };
  });

/** Drags the frame with the mouse, from one place to another, both as shares of its box. */
async function drag(page: Page, [x, y]: readonly [number, number], [toX, toY]: readonly [number, number]) {
  await page.locator("#frame-box").scrollIntoViewIfNeeded();
  const box = (await page.locator("#frame-box").boundingBox())!;
  await page.mouse.move(box.x + x * box.width, box.y + y * box.height);
  await page.mouse.down();
  await page.mouse.move(box.x + toX * box.width, box.y + toY * box.height, { steps: 5 });
  await page.mouse.up();
  return { dx: Math.round((toX - x) * box.width), dy: Math.round((toY - y) * box.height) };
}

test(
  "a well is skipped, measured again and left out by name, and the rest of a plate is measured",
  { timeout: 3 * RUN_MS },
  async (t) => {
    const { daemon, page, complaints } = await opened(t, 5);
    // A04 would be empty.
    const wells = ["A01", "A02", "A03", "A05", "A06"];
    await page.evaluate(() => localStorage.setItem("carved.operator", "Kim Ö."));
    await daemon.send("PUT", "/v1/runs/people", plan(wells.map(larva)));
    await daemon.follow((s) => s.specimen?.well === "A01" && s.specimen.view > 2);
    await page.getByRole("button", { name: "Hold", exact: true }).click();
    await daemon.follow((s) => s.state === "Held");

    // Without a reason nothing is skipped.
    await about(page, "A02");
    assert.equal(await page.locator("#remark-by").inputValue(), "Kim Ö.");
    await page.getByRole("button", { name: "Skip this well" }).click();
    await until(page, "remark-words", /^Nothing was changed: the reason: it is empty\.$/);
    await page.getByLabel("Remark or reason").fill("no larva in it");
    await page.getByRole("button", { name: "Skip this well" }).click();
    const skipped = await daemon.follow((s) => s.run!.results[1]!.outcome === "skipped");
    assert.equal(skipped.run!.results[1]!.reason, "skipped by Kim Ö.: no larva in it");
    await until(page, "well-body", /skipped by Kim Ö\.: no larva in it/i);

    // Measured again, and left out.
    await about(page, "A01");
    await page.getByLabel("Remark or reason").fill("a bubble");
    await page.getByRole("button", { name: "Measure it again" }).click();
    await daemon.follow((s) => s.run!.results[0]!.outcome === null);
    await page.locator("#unhold").click();
    const again = await daemon.follow((s) => s.run!.results[0]!.outcome !== null && s.specimen?.well === "A03");
    assert.equal(again.run!.results[0]!.outcome, "succeeded", JSON.stringify(again.run!.results[0]));
    const detail = (await (await fetch(`${daemon.url}/v1/runs/people/specimens/A01`)).json()) as {
      earlier_attempts: number[];
    };
    assert.deepEqual(detail.earlier_attempts, [1]);
    // The one that was finished last stays beside the one under way.
    await page.getByRole("button", { name: "Follow the run" }).click();
    await until(page, "last-done", /^Finished last: A01 [\d.,]+/);
    await page.locator("#last-done").getByRole("button", { name: "A01" }).click();
    await about(page, "A01");
    await page.locator("#groups summary").click();
    await until(page, "groups-words", /^A dot is a larva/);
    await page.getByLabel("Remark or reason").fill("two larvae");
    await page.getByLabel("Tags").fill("twin, big");
    await page.getByLabel("Leave it out of statistics").check();
    await page.getByRole("button", { name: "Save remark" }).click();
    await until(page, "remark-words", /^The remark is kept\.$/);
    await until(page, "well-body", /Left out of statistics by Kim Ö\.: two larvae\. Tags: twin, big\./);
    await until(page, "groups-words", /1 well is left out: 1 by a person\./);
    await shoot(page, "people-remark");

    await page.getByRole("button", { name: "Abort run" }).click();
    await page.locator("#ask-yes").click();
    const aborted = await daemon.follow((s) => s.run!.outcome !== null);
    const [first] = aborted.run!.results;
    assert.ok(first!.volume_um3! > 0 && first!.flags.includes("excluded"), "its numbers stay");
    const statistics = await (await fetch(`${daemon.url}/v1/runs/people/statistics`)).json();
    assert.deepEqual(
      statistics.quantities[0]?.left_out.map((w: { well: string; flags: string[] }) => [
        w.well,
        w.flags.includes("excluded"),
      ]),
      [["A01", true]],
      JSON.stringify(statistics).slice(0, 400),
    );
    const table = await (await fetch(`${daemon.url}/v1/runs/people/table.csv`)).text();
    assert.match(table, /Kim Ö\.,two larvae,twin;big/);
    await page.getByText("What happened in this run").click();
    for (const said of [
      /Kim Ö\. \(the instrument's computer\) asked to hold the run\./,
      /Kim Ö\. skips A02: no larva in it\./,
      /Kim Ö\. has A01 measured again: a bubble\./,
      /Kim Ö\. \(the instrument's computer\) asked to abort the run\./,
    ])
      await until(page, "log-list", said);

    // The rest of the plate, without its file.
    for (const fault of aborted.faults) await daemon.send("POST", `/v1/faults/${fault.seq}/acknowledge`);
    if (aborted.plate.take_out !== null) await page.locator("#is-out").click();
    // A03 and A05 may have been finished before the abort.
    const left = aborted.run!.results.filter((w) => w.outcome === "aborted").map((w) => w.well);
    assert.ok(left.includes("A06"), JSON.stringify(aborted.run!.results));
    const [several, larvae] =
      left.length === 1 ? ["1 well", "1 larva"] : [`${left.length} wells`, `${left.length} larvae`];
    await page
      .locator("#measure-rest")
      .filter({ hasText: new RegExp(`^Measure the rest: ${several}$`) })
      .click();
    await until(page, "plate-holds", new RegExp(`^Of run people: ${several}: ${larvae} of 3 dpf\\.$`));
    assert.equal(await page.getByLabel("Plate barcode").inputValue(), "P-1");
    await page.getByLabel("Run name").fill("rest");
    await shoot(page, "people-rest");
    await page.getByRole("button", { name: "Start", exact: true }).click();
    const rest = await daemon.follow((s) => s.run?.id === "rest" && s.run.results.some((w) => w.outcome !== null));
    assert.deepEqual(
      rest.run!.results.map((w) => w.well),
      left,
    );

    // The frame: leafed through by keys, magnified, and made brighter.
    const done = rest.run!.results.find((w) => w.outcome !== null)!.well;
    await pick(page, done);
    await until(page, "frame-whose", /^view 1 of \d+$/);
    await page.locator("#frame-box").focus();
    await page.keyboard.press("ArrowRight");
    await until(page, "frame-whose", /^view 2 of \d+$/);
    await page.keyboard.press("ArrowLeft");
    await until(page, "frame-whose", /^view 1 of \d+$/);
    await page.locator("#frame-box").hover();
    await page.mouse.wheel(0, -300);
    await page.locator('#frame-box[data-scale="1.25"]').waitFor();
    await page.keyboard.press("+");
    await page.locator('#frame-box[data-scale="1.56"]').waitFor();
    await page.locator("#frame-contrast").fill("2");
    const look = () =>
      page.locator("#frame-image").evaluate((image) => [image.style.filter, image.style.transform !== ""]);
    assert.deepEqual(await look(), ["contrast(2)", true]);
    await shoot(page, "people-zoomed");

    // Dragged with the mouse: picture and outline move by as much as the pointer, and stay when the button is up.
    const near = (found: number, wanted: number, what: string) =>
      assert.ok(Math.abs(found - wanted) <= 2, `${what}: ${found} px, not ${wanted}`);
    const before = await edges(page);
    const by = await drag(page, [0.5, 0.5], [0.4, 0.45]);
    const after = await edges(page);
    near(after.left - before.left, by.dx, "along");
    near(after.top - before.top, by.dy, "across");
    assert.deepEqual(await edges(page, "profile-image"), after, "the outline lies on the picture");
    await page.locator("#frame-box").hover({ position: { x: 20, y: 20 } });
    assert.deepEqual(await edges(page), after, "without the button nothing moves");
    // No further than to the edges of the picture.
    for (const [from, to] of [
      [0.02, 0.98],
      [0.98, 0.02],
    ] as const) {
      await drag(page, [from, from], [to, to]);
      const { left, top, right, bottom } = await edges(page);
      assert.deepEqual(from < to ? [left, top] : [right, bottom], [0, 0], "edge at edge");
      assert.ok(left <= 0 && top <= 0 && right >= 0 && bottom >= 0, "the box is full of picture");
    }
    await page.getByRole("button", { name: "Reset" }).click();
    assert.deepEqual(await look(), ["", false]);
    // A click on a view brings the frame into sight.
    await page.locator("#views-list button").nth(4).click();
    await until(page, "frame-whose", /^view 5 of \d+$/);
    const box = (await page.locator("#frame-box").boundingBox())!;
    const height = page.viewportSize()!.height;
    assert.ok(box.y >= 0 && box.y + box.height / 2 < height, `${box.y} to ${box.y + box.height} of ${height}`);

    // The contact sheet: a picture of each well that was measured, and a click leads to the well.
    await page.getByText("Contact sheet").click();
    const picture = page.locator(`#sheet-list li[data-well="${done}"] img`);
    await picture.waitFor();
    assert.ok((await picture.evaluate((image: HTMLImageElement) => image.naturalWidth)) > 100);
    await shoot(page, "people-sheet");
    // The other side of it: another picture, and how sure that is or why it is a frame.
    const side = await picture.getAttribute("src");
    await page.locator("#sheet-aspect").selectOption("dorsal");
    // Pictures are read for wells in the window only.
    await page.locator("#sheet-list").scrollIntoViewIfNeeded();
    await page.locator(`#sheet-list li[data-well="${done}"] img[src]:not([src="${side}"])`).waitFor();
    const title = await page.locator(`#sheet-list li[data-well="${done}"]`).getAttribute("title");
    assert.match(title ?? "", /^Head and back were found with confidence|^A frame as it was taken: /);
    await shoot(page, "people-sheet-dorsal");
    await page.locator(`#sheet-list li[data-well="${done}"] button`).click();
    await until(page, "well-heading", new RegExp(`^Well ${done}$`));

    // A remark about a well of a stored run, which no status brings.
    await page.goto(`${daemon.url}/?run=people`);
    await until(page, "opened-words", /^Stored run people/);
    await about(page, "A01");
    await page.getByLabel("Remark or reason").fill("three larvae");
    await page.getByRole("button", { name: "Save remark" }).click();
    await until(page, "well-body", /Left out of statistics by Kim Ö\.: three larvae\./);
    await about(page, "A06");
    await about(page, "A01");
    assert.equal(await page.locator("#remark-words").innerText(), "", "it is saved");

    // From a flag to its help: the row about it, in sight.
    const opens = page.waitForEvent("popup");
    await page.locator("#well-body a.flag", { hasText: "A person has left the specimen out of statistics" }).click();
    const help = await opens;
    const row = help.locator("tr#row-excluded");
    await row.getByText("excluded", { exact: true }).waitFor();
    const { pathname, hash } = new URL(help.url());
    assert.deepEqual([pathname, hash], ["/docs/quality.html", "#row-excluded"]);
    await help.waitForFunction(() => {
      const { top, bottom } = document.querySelector(location.hash)!.getBoundingClientRect();
      return scrollY > 0 && top > -1 && bottom <= innerHeight;
    });
    // The record and pictures of a well that is measured again are moved away, maybe while the page reads them.
    const moved = /404 .*\/specimens\/A01(\/|$)/;
    assert.deepEqual(
      complaints.filter((text) => !moved.test(text)),
      [],
    );
  },
);

test(
  "a plate that ends with the daemon is shown as interrupted, and the rest of it is measured",
  { timeout: 3 * RUN_MS },
  async (t) => {
    const { daemon, page, complaints } = await opened(t, 5);
    await daemon.send("PUT", "/v1/runs/cut", plan(["A01", "A02", "A03", "A05"].map(larva)));
    const rest = page.locator("#measure-rest");

    // Killed in a turn, it goes on by itself: no rest is offered of a run that is under way.
    await daemon.follow((s) => s.specimen?.well === "A02" && s.specimen.view > 2);
    await daemon.crash();
    await page.locator("#lost", { hasText: /^Connection lost/ }).waitFor();
    await daemon.again();
    await until(page, "link", /^Live$/);
    await page.getByText("What happened in this run").click();
    await until(page, "log-list", /The program was started again and found the run open\./);
    await until(page, "log-list", /A02 was interrupted .*: it is measured again from the start\./);
    assert.equal(await rest.isVisible(), false);

    // Ended as a service manager does it, the run is over.
    await daemon.follow((s) => s.specimen?.well === "A03" && s.specimen.view > 2);
    await daemon.end();
    await daemon.again();
    const { run } = await daemon.follow(
      (s) => s.run?.outcome != null && s.run.results.every((w) => w.outcome !== null),
    );
    assert.equal(run!.outcome, "interrupted", JSON.stringify(run));
    const left = run!.results.filter((w) => w.outcome === "interrupted").map((w) => w.well);
    // On a busy machine all views of A03 may have been there.
    assert.ok(!left.includes("A01") && !left.includes("A02") && left.includes("A05"), JSON.stringify(run!.results));
    await until(page, "progress-line", new RegExp(`^Run cut was interrupted: .*\\b${left.length} interrupted\\.$`));
    const marked = page.locator('#plate [data-condition="interrupted"]');
    assert.deepEqual(await marked.evaluateAll((wells) => wells.map((well) => well.getAttribute("data-well"))), left);
    await pick(page, "A05");
    await until(page, "well-body", /Interrupted and given up/);
    await shoot(page, "people-interrupted");

    const several = left.length === 1 ? ["1 well", "1 larva"] : [`${left.length} wells`, `${left.length} larvae`];
    await rest.filter({ hasText: new RegExp(`^Measure the rest: ${several[0]}$`) }).waitFor();
    if ((await daemon.status()).plate.take_out !== null) await page.locator("#is-out").click();
    await rest.click();
    await until(page, "plate-holds", new RegExp(`^Of run cut: ${several[0]}: ${several[1]} of 3 dpf\\.$`));
    await page.getByLabel("Run name").fill("rest");
    await page.getByRole("button", { name: "Start", exact: true }).click();
    const started = await daemon.follow((s) => s.run?.id === "rest");
    assert.deepEqual(
      started.run!.results.map((w) => w.well),
      left,
    );
    assert.deepEqual(complaints, []);
  },
);
