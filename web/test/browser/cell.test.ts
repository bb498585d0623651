// A cell of a plate map that is corrected on the page, with real clicks on the real daemon.

import assert from "node:assert/strict";
import { test } from "node:test";
import { shoot } from "../support/browser.ts";
import { RUN_MS } from "../support/daemon.ts";
import { opened, until } from "../support/opened.ts";

const MAP = "well,specimen,dpf,compound,concentration,concentration_unit\nA01,larva,3,,,\nA02,larva,3,,,\n";

test(
  "a cell of a plate map is corrected, and a well is left out, without its file",
  { timeout: 2 * RUN_MS },
  async (t) => {
    const { daemon, page, complaints } = await opened(t, 5);
    const choose = (map: string) =>
      page.locator("#plate-map").setInputFiles({ name: "map.csv", mimeType: "text/csv", buffer: Buffer.from(map) });
    // A map of 384 wells fits beside its legend, and marks of two letters fit into their wells.
    const names = Array.from(
      { length: 384 },
      (_, i) => `${String.fromCharCode(65 + Math.floor(i / 24))}${(i % 24) + 1}`,
    );
    await choose(`well,compound\n${names.map((name, i) => `${name},Compound ${i % 60}`).join("\n")}\n`);
    await until(page, "plate-holds", /^384 wells/);
    const beyond = await page.locator("#plan .plate-box").evaluate((box) => box.scrollWidth - box.clientWidth);
    assert.ok(beyond <= 0, `the map is ${beyond} px wider than its box`);
    const tight = await page.locator("#plan-plate .mark").evaluateAll(
      (marks) =>
        marks.filter((mark) => {
          const [own, well] = [mark, mark.parentElement!].map((of) => of.getBoundingClientRect().width);
          return own! > well! - 2;
        }).length,
    );
    assert.equal(tight, 0, "marks as wide as their wells");
    await page.locator('#plan-plate [data-planned="A02"]').click();
    const out = page.locator(".cell-out");
    const [box, label] = [await out.locator("input").boundingBox(), await out.boundingBox()];
    assert.ok(box!.height + 12 > label!.height, `the box stands beside its words: ${label!.height} px`);
    await shoot(page, "plan-384");
    // A misprint that makes the plate larger is confirmed or corrected before a run can begin.
    const misprint = "well,specimen,dpf\nA01,larva,3\nI12,larva,3\n";
    const alone = /^Line 3: I12 is the only well that is not on a plate of 96 wells, so the plate counts as one of 384/;
    const plate = page.locator("#plate-format");
    const doubt = page.locator("#plate-doubt");
    await choose(misprint);
    await until(page, "plate-doubt-words", alone);
    await until(page, "new-run-missing", /^Still needed: the plate's size,/);
    await shoot(page, "doubt");
    await page.getByRole("button", { name: "It has 384 wells" }).click();
    assert.deepEqual([await plate.inputValue(), await doubt.isVisible()], ["384", false]);
    assert.doesNotMatch(await page.locator("#new-run-missing").innerText(), /size/);
    await plate.selectOption("96");
    await until(page, "new-run-list", /Line 3, well: I12 is not on a plate of 96 wells/);
    await plate.selectOption("");
    await until(page, "plate-doubt-words", alone);
    await page.locator('#plan-plate [data-planned="I12"]').click();
    await page.getByLabel("Leave this well out of the run").check();
    await page.getByRole("button", { name: "Use it" }).click();
    await until(page, "plate-holds", /^1 well: /);
    assert.equal(await doubt.isVisible(), false);
    // The age and the compound of one well are corrected, and the other well is left out.
    await choose(MAP);
    await until(page, "plate-holds", /^2 wells: 2 larvae of 3 dpf\.$/);
    await page.locator('#plan-plate [data-planned="A01"]').click();
    await until(page, "cell-heading", /^Well A01$/);
    await page.getByLabel("Age, dpf").fill("old");
    await page.getByRole("button", { name: "Use it" }).click();
    await until(page, "cell-words", /^Age and concentration are numbers, and a replicate is a whole number from 1\.$/);
    await page.getByLabel("Age, dpf").fill("5");
    await page.locator("#cell-compound").fill("Valproic acid");
    await page.locator("#cell-concentration").fill("1,5");
    await page.locator("#cell-unit").selectOption("mM");
    await page.getByLabel("Strain").fill("casper");
    await page.locator("#cell-control").selectOption("positive");
    await page.locator("#cell-treatment").fill("24 h");
    await page.locator("#cell-replicate").fill("2");
    await shoot(page, "cell");
    await page.getByRole("button", { name: "Use it" }).click();
    await page.locator('#plan-plate [data-planned="A02"]').click();
    await page.getByLabel("Leave this well out of the run").check();
    await page.getByRole("button", { name: "Use it" }).click();
    await until(page, "plate-holds", /^1 well: 1 larva of 5 dpf\. Corrected on this page/);
    await page.getByLabel("Plate barcode").fill("P-7");
    await page.getByLabel("Operator").fill("Kim");
    await page.getByLabel("Run name").fill("vpa");
    await page.getByRole("button", { name: "Start", exact: true }).click();
    await daemon.follow((s) => s.run?.id === "vpa");
    const ended = await daemon.follow((s) => s.run!.outcome !== null);
    const detail = (await (await fetch(`${daemon.url}/v1/runs/vpa`)).json()) as { plan: { plate_map: object[] } };
    assert.deepEqual(
      detail.plan.plate_map.map((well) => ({ ...well })),
      [
        {
          well: "A01",
          specimen: "larva",
          dpf: 5,
          strain: "casper",
          treatment: "24 h",
          compound: "Valproic acid",
          concentration: 1.5,
          concentration_unit: "mM",
          control: "positive",
          replicate: 2,
        },
      ],
      JSON.stringify(ended.run),
    );
    assert.deepEqual(complaints, []);
  },
);
