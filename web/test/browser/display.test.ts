// Stored runs, colours by number, tables, themes, the wall display and calls, against a fixture server; and what axe finds on each screen.

import assert from "node:assert/strict";
import { after, afterEach, before, beforeEach, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import type { Status } from "../../src/status.ts";
import { breaches, isAccessible } from "../support/axe.ts";
import { openBrowser, openPage, shoot } from "../support/browser.ts";
import { FixtureServer, kept, NO_FILES } from "../support/fixture-server.ts";
import { ellipsoidGlb, png } from "../support/picture.ts";
import { carved, fault, placed, run, specimen, status, well } from "../support/statuses.ts";

const larva = (name: string, volume_um3: number, z: number) =>
  well(name, {
    ...{ outcome: "succeeded" as const, volume_um3, volume_sd_um3: 1.4e6, area_um2: 4e6, area_sd_um2: 2e4 },
    reference: { ...placed, volume: { ...placed.volume, z } },
  });
const results = [
  larva("A01", 240e6, -1),
  larva("A02", 250e6, 0),
  larva("A03", 260e6, 1),
  larva("A04", 310e6, 3.4),
  well("A05"),
];
const running = status({
  state: "Execute",
  doing: "taking view 10 of 22 of the larva in A05",
  plate: { barcode: "P-1", present: true, removable: false, needs: null, take_out: null, bring: null },
  run: run(results),
  specimen: specimen("A05", carved(262_000_000, 9)),
});
const plan = {
  ...{ plate_barcode: "P-1", method: "standard", operator: "Kim" },
  plate_map: [
    {
      well: "A01",
      compound: "DMSO",
      concentration: 0.1,
      concentration_unit: "%",
      strain: "ABxTL",
      control: "negative",
    },
    ...["A02", "A03"].map((name) => ({ well: name, control: "negative" })),
  ],
};
const held = {
  ...running,
  state: "Held" as const,
  specimen: null,
  faults: [fault({ operator_required: true, what_to_do: "Check the camera's cable." })],
};

const oldWells = [larva("B01", 199e6, 0.2), well("B02", { outcome: "failed", reason: "no outline" })];
const {
  eta_s: _eta,
  goes_on_by_itself: _on,
  held_by_operator: _by,
  hold: _hold,
  ...stored
} = run(oldWells, {
  ...{ id: "P-9-old", outcome: "partial", started: "2025-11-02T08:00:00Z", ended: "2025-11-02T09:00:00Z" },
});
const detail = {
  ...stored,
  ...{ plate_barcode: "P-9", mode: "imported", method_settings: {}, software_version: "0.0.9", specimens: [] },
  copies: [{ archived: "2025-11-03T08:00:00Z", destination: "/nas/P-9-old", bytes: 2.5e9, files: 812 }],
  plan: { ...plan, plate_barcode: "P-9", plate_format: 24, plate_map: oldWells.map((w) => ({ well: w.well })) },
};
const {
  results: _results,
  plan: _plan,
  method_settings: _settings,
  specimens: _specimens,
  copies: _copies,
  ...row
} = detail;

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
  server = new FixtureServer(running);
  server.answers["/v1/methods"] = {
    methods: [{ name: "standard", asd: 21, order: "coarse_to_fine", voxel_um: 6.93, epsilon: 0.05 }],
  };
  server.answers["/v1/runs"] = {
    runs: [row, { ...row, id: "P-8", plate_barcode: "P-8", operator: "Lee" }],
    next: null,
  };
  server.answers["/v1/runs/P-9-old"] = detail;
  const again = { name: "few", replayed: "2026-01-01T00:00:00Z", software_version: "0.1.0", method_settings: {} };
  server.answers["/v1/runs/P-9-old/replays"] = {
    progress: { name: "few", wells: 2, done: 2, failed: [{ well: "B02", reason: "too few views" }], waits: false },
    results: [{ ...again, result: { ...larva("B01", 201e6, 0.3), views: 7 } }],
  };
  server.answers["/v1/runs/demo-1"] = { ...detail, plan };
  const record = "/v1/runs/P-9-old/specimens/B01";
  const views = [0, 1, 2].map((view) => `${record}/views/${view}.png`);
  for (const view of views)
    server.files[view.replace("png", "jpg")] = png(512, 512, (x, y) => [x % 256, y % 256, 99, 255]);
  server.answers[record] = kept({ run: "P-9-old", well: "B01", links: { ...NO_FILES, views } });
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
const until = (id: string, wanted: RegExp) => page.locator(`#${id}`).filter({ hasText: wanted }).waitFor();
const wellButton = (name: string) => page.locator(`#plate button[data-well="${name}"]`);
/** Waits until the upper end of an element is in the window. */
const inView = (id: string) =>
  page.waitForFunction((id) => {
    const { top } = document.getElementById(id)!.getBoundingClientRect();
    return top >= 0 && top < innerHeight;
  }, id);
const paintOf = (name: string) => wellButton(name).evaluate((b) => getComputedStyle(b).backgroundColor);

test("an old run is found, opened with all that a live one shows, and closed; the commands stay the instrument's", async () => {
  await page.goto(server.url);
  await page.getByText("All runs").click();
  await until("runs-words", /^2 of 2 runs\.$/);
  await page.getByLabel("Search").fill("kim p-9");
  await until("runs-words", /^1 of 2 runs\.$/);
  await page.locator("#runs-table").getByRole("button", { name: "P-9-old" }).click();
  await until(
    "opened-words",
    /^Stored run P-9-old: plate P-9, 2025-11-02 .*, imported, method standard, operator Kim, carved 0\.0\.9\. The run finished in part: 1 of 2 wells measured\. /,
  );
  await inView("opened");
  assert.equal(await wellButton("B01").getAttribute("data-condition"), "succeeded");
  assert.equal(await wellButton("A01").count(), 0);
  await wellButton("B01").click();
  await until("well-body", /199\.0 ± 1\.4/);
  assert.equal(await text("plate-name"), "P-9");
  // The daemon measures nothing again while it has a run.
  await page.getByText("Measure again by another method").click();
  assert.equal(
    await page.locator("#again-wells").getAttribute("placeholder"),
    "all that are measured, or A01, B02-B05",
  );
  const again = page.getByRole("button", { name: "Measure again" });
  await until("again-busy", /^A run is under way: measure again when it is over\.$/);
  assert.equal(await again.isDisabled(), true);
  const over = { ...running.run!, outcome: "succeeded" as const };
  server.publish({ ...running, state: "Complete", specimen: null, run: over });
  await page.locator("#again-busy").waitFor({ state: "hidden" });
  assert.equal(await again.isDisabled(), false);
  server.publish(running);
  await page.locator("#again-busy").waitFor();
  assert.match(await text("sentence"), /^Taking view 10 of 22 of the larva in A05$/, "what the instrument does stays");
  assert.equal(await page.locator("#abort").isVisible(), true);
  assert.equal(await page.locator("#plate").getAttribute("data-wells"), "24", "the plate that the plan names");
  await until("opened-copies", /^Copied to \/nas\/P-9-old on 2025-11-03 .*: 812 files, 2\.50 GB/);
  const whole = page.getByRole("link", { name: "All files of the run (tar)" });
  assert.equal(await whole.getAttribute("href"), "/v1/runs/P-9-old/files.tar");
  const saved = page.waitForEvent("download");
  await whole.click();
  assert.equal((await saved).suggestedFilename(), "P-9-old.tar");
  await shoot(page, "stored-run");
  // Its address can be kept.
  server.answers["/v1/runs/P-9-old"] = { ...detail, copies: [] };
  await page.reload();
  await until("opened-words", /^Stored run P-9-old/);
  await until("opened-copies", /^No copy of this run is recorded: carved archive makes one and checks it\.$/);
  assert.equal(await page.locator("#opened-copies code").innerText(), "carved archive");
  await page.getByRole("button", { name: "Back to the instrument's run" }).click();
  await wellButton("A01").waitFor();
  assert.equal(await page.locator("#opened").isVisible(), false);
  // The browser's own buttons lead from run to run, and not off the page.
  await page.goBack();
  await until("opened-words", /^Stored run P-9-old/);
  await page.goBack();
  await page.locator("#opened").waitFor({ state: "hidden" });
  await wellButton("A01").waitFor();
  await page.goForward();
  await until("opened-words", /^Stored run P-9-old/);
  await page.goto(`${server.url}/?run=nobody`);
  await until("opened-words", /^Run nobody could not be opened/);
  await wellButton("A01").waitFor();
  // Chromium reports the 404 of the run that is not there.
  complaints.splice(0, complaints.length, ...complaints.filter((c) => !/404/.test(c)));
});

test("a run that is opened while it is under way follows the instrument, and is read again when it has ended", async () => {
  const own = { ...detail, id: "demo-1", started: running.run!.started, ended: null, outcome: null };
  server.answers["/v1/runs/demo-1"] = own;
  await page.goto(`${server.url}/?run=demo-1`);
  await until("opened-words", /^Run under way demo-1: /);
  // The wells are those of the status. The record has B01 only.
  await wellButton("A05").waitFor();
  assert.equal(await page.locator("#opened-files a").count(), 0, "its files are still written");
  const results = running.run!.results.map((w) => (w.well === "A05" ? { ...w, outcome: "failed" as const } : w));
  server.publish({ ...running, specimen: null, run: { ...running.run!, results } });
  await page.locator('#plate button[data-well="A05"][data-condition="failed"]').waitFor();

  const ended = { ...running.run!, results, outcome: "partial" as const };
  server.answers["/v1/runs/demo-1"] = { ...own, outcome: "partial" };
  server.publish({ ...running, state: "Complete", specimen: null, run: ended });
  await until("opened-words", /^Stored run demo-1: /);
  await wellButton("B01").waitFor();
  assert.equal(await page.locator("#opened-files a").count(), 1);
  // Another run of the instrument does not take its place.
  server.publish({ ...running, run: { ...running.run!, id: "demo-2", started: "2026-04-01T00:00:00Z" } });
  await until("state", /^Running$/i);
  await wellButton("B01").waitFor();
});

test("groups of the plate map: the daemon's statistics as dots, means and a table, and a dot leads to its well", async () => {
  const point = (name: string, dose: number, value: number) => ({
    run: "demo-1",
    well: name,
    dose,
    value: value * 1e6,
  });
  const number = (value: number) => ({ value, sd: 1, interval_95: { low: value - 2, high: value + 2 } });
  const untreated = { specimen: "larva", dpf: 3, strain: null, treatment: null, control: null };
  const condition = { ...untreated, compound: "BPA", concentration: null, concentration_unit: null };
  const group = (of: object, mean: number, values: [string, number, boolean][], more: object = {}) => ({
    ...{
      condition: { ...condition, ...of },
      n: values.length,
      left_out: 0,
      mean: mean * 1e6,
      sd: null,
      mean_interval_95: null,
    },
    ...{ median: mean * 1e6, mad: 0, reference: null, ...more },
    values: values.map(([name, value, flagged]) => ({ run: "demo-1", well: name, value: value * 1e6, flagged })),
  });
  const dmso = group(
    { compound: "DMSO", control: "negative" },
    250,
    [
      ["A01", 240, false],
      ["A02", 250, true],
      ["A03", 260, false],
    ],
    {
      ...{ sd: 10e6, mad: 10e6, mean_interval_95: { low: 225.2e6, high: 274.8e6 } },
      reference: { group: "fixed, 3 dpf", n: 12, interval_95: { low: 225e6, high: 265e6 } },
    },
  );
  const groups = [
    dmso,
    group({ concentration: 10, concentration_unit: "uM" }, 310, [["A04", 310, false]]),
    group({ specimen: "bead", dpf: null, compound: null }, 65, [["A06", 65, false]]),
  ];
  server.answers["/v1/runs/demo-1/statistics"] = {
    ...{ runs: ["demo-1"], modes: ["simulated"], flagged: "sound", specimens: 5, specimens_with_flags: 1 },
    quantities: [
      {
        ...{ name: "volume_um3", unit: "um^3", groups, compounds: [] },
        left_out: [{ run: "demo-1", well: "A07", value: 90e6, flags: ["clipped_left"] }],
        windows: [{ run: "demo-1", positive: 2, negative: 3, z_prime: 0.55, reason: null }],
        responses: [
          {
            ...{ condition, concentration_unit: "uM" },
            points: [point("A01", 0, 240), point("A02", 1, 250), point("A03", 3, 260), point("A04", 10, 310)],
            curve: {
              ...{ at_zero: number(240e6), at_infinity: number(320e6), hill: number(2), log10_ec50: number(0.7) },
              ...{ ec50: 5, ec50_interval_95: { low: 3, high: 8 }, ec50_is_within_doses: true },
              ...{ p_no_effect: 0.01, residual_sd: 1e6 },
              line: [1, 3, 10].map((dose) => ({ dose, value: 300e6, interval_95: { low: 290e6, high: 310e6 } })),
            },
            reason: null,
          },
        ],
      },
    ],
  };
  await page.goto(server.url);
  await page.getByText("Groups of the plate map").click();
  await page.locator('#groups-chart svg[data-groups="2"]').waitFor();
  await until(
    "groups-words",
    /a square has a flag.* 1 well is left out: 1 because its number is a bound \(clipped left\)\..* of the same age, by the estimator of the references: 12 larvae \(fixed, 3 dpf\)\./,
  );
  const marks = (name: string) => page.locator(`#groups-chart ${name}`).count();
  assert.deepEqual(
    await Promise.all([".groups-reference", "circle", "rect.groups-flagged", ".groups-mean"].map(marks)),
    [...[1, 3, 1, 3]],
  );
  const rows = await page.locator("#groups-table tbody tr").allInnerTexts();
  assert.deepEqual(
    rows.map((row) => row.split("\t")),
    [
      ["a", "Larva, 3 dpf, DMSO, negative control", "3", "250.0", "10.00", "225.2 to 274.8", "250.0", "10.00"],
      ["b", "Larva, 3 dpf, BPA 10 µM", "1", "310.0", "–", "–", "310.0", "0"],
    ],
  );
  // The mean is drawn where the scale has its value, and its interval around it.
  const at = (name: string, nth: number, end: string) =>
    page.locator(name).nth(nth).getAttribute(end).then(Number) as Promise<number>;
  const dot = await at("#groups-chart [data-well=A02]", 0, "y");
  assert.ok(Math.abs((await at(".groups-mean", 0, "y1")) - dot - 3.5) < 0.1);
  const [low, high] = [await at(".groups-mean", 1, "y1"), await at(".groups-mean", 1, "y2")];
  assert.ok(Math.abs((low + high) / 2 - dot - 3.5) < 0.1 && low > high);
  assert.deepEqual(await page.locator("#groups-doses .title").allTextContents(), ["Dose, µM", "Volume, nL"]);
  await until("groups-window", /^Z' of the controls: 0\.55 \(2 positive, 3 negative\)\.$/);
  assert.equal(await page.locator("#groups-doses svg .groups-dot").count(), 4);
  assert.equal(await page.locator("#groups-doses [data-well=A03] title").textContent(), "A03: 260.0 nL at 3 µM");
  // The interval of the EC50 from 3 to 8 lies between the doses of its wells, 3 and 10.
  const centre = (name: string) => at(`#groups-doses [data-well=${name}]`, 0, "cx");
  const band = { x: await at(".dose-interval", 0, "x"), width: await at(".dose-interval", 0, "width") };
  assert.ok(Math.abs(band.x - (await centre("A03"))) < 0.1, JSON.stringify(band));
  const [none, least] = [await centre("A01"), await centre("A02")];
  assert.ok(none > 60 && none + 20 < least, `wells without the compound stand apart: ${none}, ${least}`);
  assert.ok(band.x + band.width < (await centre("A04")) && band.width > 20, JSON.stringify(band));
  // The curve's band is 310 nL high at the dose of A04, whose volume this is.
  const corners = (await page.locator("#groups-doses .dose-band").getAttribute("points"))!.split(" ");
  const [cx, cy] = [await centre("A04"), await at("#groups-doses [data-well=A04]", 0, "cy")];
  assert.deepEqual([corners.length, corners[2]], [6, `${cx.toFixed(1)},${cy.toFixed(1)}`]);
  await until("groups-doses", /BPA, larva, 3 dpf: EC50 5\.00 µM \(95 %: 3\.00 to 8\.00\)/);
  await shoot(page, "groups");
  await page.locator('#groups-chart [data-well="A04"]').click();
  await until("well-heading", /^Well A04$/);
  await page.locator("#groups-quantity").selectOption("area");
  await until("groups-words", /^No larva has this number yet\.$/);
});

test("control charts of the beads mark what is out of its limits", async () => {
  const gate = (i: number, mean: number, jumped = false) => ({
    ...{ id: `g${i}`, rig: "vast", mode: "hardware", measured: `2026-03-${String(i).padStart(2, "0")}T08:00:00Z` },
    ...{ verdict: jumped ? "failed" : "passed", passes: !jumped, beads: 3, nominal_um: 500, begins_history: i === 1 },
    quantities: [
      {
        ...{ name: "diameter_um", mean, sd: 0.5, history_mean: i > 5 ? 500 : null },
        ...{ lower_limit: i > 5 ? 498 : null, upper_limit: i > 5 ? 502 : null, jumped, drifted: false },
      },
    ],
  });
  const gates = Array.from({ length: 9 }, (_, i) => gate(i + 1, 500 + 0.3 * (i % 3), false));
  server.answers["/v1/bead-gates"] = { gates: [...gates, gate(10, 505, true)] };
  await page.goto(server.url);
  await page.getByText("Beads: control charts and drift").click();
  await until("beads-words", /^10 gates\. The newest, of 2026-03-10 .*, did not pass\.$/);
  const chart = page.locator("#beads-charts svg");
  assert.equal(await chart.count(), 1);
  assert.deepEqual([await chart.getAttribute("data-points"), await chart.getAttribute("data-out")], ["10", "1"]);
  await until("beads-charts", /Mean diameter, µm: 2026-03-10 .*: 505\.00 of 3 beads, a jump\./);
  await shoot(page, "beads");
});

test("what happened in a run is read in parts, in words, with each step on demand, and followed", async () => {
  const event = (id: number, kind: string, data: unknown, well: string | null = null) => ({
    ...{ id, time: `2026-03-05T09:30:${String(id).padStart(2, "0")}Z`, kind, run: "demo-1", well, data },
  });
  const events = [
    event(1, "run.accepted", { plate_barcode: "P-1", method: "standard" }),
    event(2, "specimen.phase", { phase: "load" }, "A01"),
    event(3, "specimen.tried_again", { attempt: 1, why: "the specimen moved" }, "A01"),
  ];
  server.answers["/v1/runs/demo-1/events"] = { events, next: null };
  await page.goto(server.url);
  await page.getByText("What happened in this run").click();
  await until("log-words", /^2 events, the newest first; 1 step not listed\.$/);
  const items = page.locator("#log-list li span");
  assert.deepEqual(await items.allInnerTexts(), [
    "A01 is measured again: attempt 1 failed, the specimen moved.",
    "The run was accepted for plate P-1, method standard.",
  ]);
  await page.getByLabel("Each step").check();
  assert.deepEqual((await items.allInnerTexts())[1], "A01: loading.");
  // News are asked for behind the newest event that is known.
  server.answers["/v1/runs/demo-1/events"] = { events: [event(4, "run.held", { by: "operator" })], next: null };
  server.publish({ ...running, uptime_s: 1 });
  await until("log-words", /^4 events/);
  assert.equal(await items.first().innerText(), "An operator holds the run.");
  assert.ok(server.read.includes("/v1/runs/demo-1/events?after=3"), server.read.join(" "));
  await shoot(page, "log");
});

test("the list of runs is filtered by the daemon, which knows all of them", async () => {
  await page.goto(server.url);
  await page.getByText("All runs").click();
  await until("runs-words", /^2 of 2 runs\.$/);
  server.answers["/v1/runs"] = { runs: [row], next: null };
  await page.locator("#runs-outcome").selectOption({ label: "finished in part" });
  await until("runs-words", /^1 of 1 runs\.$/);
  await page.locator("#runs-mode").selectOption({ label: "imported" });
  await page.waitForFunction(() => document.querySelector<HTMLButtonElement>("#runs-refresh")?.disabled === false);
  const asked = server.read.filter((path) => path.startsWith("/v1/runs?"));
  assert.deepEqual(asked, [
    "/v1/runs?limit=100",
    "/v1/runs?limit=100&outcome=partial",
    "/v1/runs?limit=100&outcome=partial&mode=imported",
  ]);
});

test("plates of 6 to 1536 wells fit a desktop and a telephone", async () => {
  await page.goto(server.url);
  for (const [i, [wells, last]] of (
    [
      [6, "B03"],
      [12, "C04"],
      [24, "D06"],
      [48, "F08"],
      [96, "H12"],
      [384, "P24"],
      [1536, "AF48"],
    ] as const
  ).entries()) {
    // The plan is read once per run.
    const id = `plate-${i}`;
    server.answers[`/v1/runs/${id}`] = {
      ...detail,
      id,
      plan: { ...plan, plate_format: wells, plate_map: [{ well: last }] },
    };
    server.publish(status({ run: run([larva("A01", 240e6, 0), larva(last, 250e6, 0)], { id }) }));
    await page.locator(`#plate[data-wells="${wells}"]`).waitFor();
    assert.equal(await page.locator("#plate .well").count(), wells);
    for (const [width, height] of [
      [1920, 1080],
      [390, 844],
    ] as const) {
      await page.setViewportSize({ width, height });
      const beyond = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
      assert.ok(beyond <= 0, `${wells} wells, ${width} px: ${beyond} px beyond the right edge`);
      const table = (await page.locator("#plate").boundingBox())!;
      if (width === 1920) assert.ok(table.height < height, `the plate of ${wells} wells is ${table.height} px high`);
      const well = (await wellButton(last).boundingBox())!;
      const least = wells === 1536 ? 15 : 20;
      assert.ok(Math.min(well.width, well.height) >= least, `${width} px: a well is ${well.width} x ${well.height} px`);
      // The number of each column is within its column.
      const gap = await page.locator("#plate th[scope=col]").evaluateAll((heads) =>
        Math.min(
          ...heads.map((head) => {
            const text = document.createRange();
            text.selectNodeContents(head);
            return head.getBoundingClientRect().width - text.getBoundingClientRect().width;
          }),
        ),
      );
      assert.ok(gap >= 2, `${wells} wells, ${width} px: ${gap} px between the numbers of columns`);
      await wellButton(last).click();
      await until("well-heading", new RegExp(`^Well ${last}$`));
      await shoot(page, `plate-${wells}-${width}`);
    }
  }
});

test("the plate is coloured by volume, by references and by its own controls, with numbers in words", async () => {
  await page.goto(server.url);
  await wellButton("A01").waitFor();
  await page.getByLabel("Colour by").selectOption({ label: "Volume, nL" });
  assert.equal(await paintOf("A01"), "rgb(0, 34, 78)", "the least of the scale");
  assert.equal(await paintOf("A04"), "rgb(254, 232, 56)", "the most");
  assert.match((await wellButton("A01").getAttribute("aria-label")) ?? "", /measured, 240\.0 nL$/);
  await until("scale-legend", /240\.0 nL\s*310\.0 nL\s*Wells without this number have no colour/);
  const pending = await paintOf("A05");
  // A bead would make larvae alike.
  const bead = well("A06", { specimen: "bead", dpf: null, outcome: "succeeded", volume_um3: 65e6, flags: ["drift"] });
  server.publish({ ...running, run: run([...results, bead]) });
  await until("scale-legend", /240\.0 nL\s*310\.0 nL\s*Beads and wells without this number have no colour/);
  assert.equal(await paintOf("A01"), "rgb(0, 34, 78)", "the least of the larvae");
  await page.getByLabel("Colour by").selectOption({ label: "Quality: number of flags" });
  await until("scale-legend", /no flag\s*1 flag/);
  assert.deepEqual(await Promise.all(["A01", "A06"].map(paintOf)), ["rgb(0, 34, 78)", "rgb(254, 232, 56)"]);
  await page.getByLabel("Colour by").selectOption({ label: "Area against references, SD" });
  const arealess = { ...placed.area, words: "area: no reference of 5 dpf", z: null };
  const older = larva("A01", 240e6, 0);
  server.publish({ ...running, run: run([{ ...older, reference: { ...older.reference!, area: arealess } }]) });
  await until("scale-legend", /^No colours: no reference of 5 dpf\.$/);
  server.publish(running);
  await wellButton("A05").waitFor();
  await page.getByLabel("Colour by").selectOption({ label: "Volume against references, SD" });
  await until("scale-legend", /−3\.0 SD\s*\+3\.0 SD/);
  assert.equal(await paintOf("A02"), "rgb(247, 247, 247)", "the middle");
  await page.getByLabel("Colour by").selectOption({ label: "Volume against this plate's controls, SD" });
  await page.waitForFunction(() =>
    /\+6\.0 SD/.test(document.querySelector('#plate button[data-well="A04"]')?.getAttribute("aria-label") ?? ""),
  );
  await shoot(page, "coloured");
  await page.reload();
  await page.waitForFunction(() => document.querySelector<HTMLSelectElement>("#colour-by")?.value === "controls");
  await page.getByLabel("Colour by").selectOption({ label: "Outcome" });
  assert.equal(await paintOf("A05"), pending);
  assert.equal(await page.locator("#scale-legend").isVisible(), false);
});

test("the table of wells sorts by each column, and leads to its wells", async () => {
  await page.goto(server.url);
  await page.getByText("Wells as a table").click();
  const wells = () => page.locator("#results-table tbody tr td:first-child").allInnerTexts();
  assert.deepEqual(await wells(), ["A01", "A02", "A03", "A04", "A05"]);
  // The treatment of the plate map, in the table, on the plate and in the card.
  const treatment = () => page.locator("#results-table tbody tr td:nth-child(3)").allInnerTexts();
  await page.locator("#results-table td", { hasText: "DMSO" }).waitFor();
  assert.deepEqual(await treatment(), [
    "DMSO 0.1 %, ABxTL, negative control",
    ...Array(2).fill("negative control"),
    "",
    "",
  ]);
  const label = await wellButton("A01").getAttribute("aria-label");
  assert.match(label ?? "", /^A01, larva, 3 dpf, DMSO 0\.1 %, ABxTL, negative control, measured/);
  await wellButton("A01").click();
  await until("well-body", /Treatment\s*DMSO 0\.1 %, ABxTL, negative control/);
  const volume = page.getByRole("button", { name: "Volume, nL" });
  await volume.click();
  await volume.click();
  assert.deepEqual(await wells(), ["A04", "A03", "A02", "A01", "A05"], "no number comes last");
  assert.equal(await page.locator("#results-table th[aria-sort]").getAttribute("aria-sort"), "descending");
  // The table is below the window's end, and the card of the well above its beginning.
  await page.setViewportSize({ width: 1440, height: 400 });
  await page.locator("#results-table").getByRole("button", { name: "A03" }).click();
  await until("well-heading", /^Well A03$/);
  await inView("well-heading");
});

test("from two metres: colour over the whole width, wells done and the time of the end in large figures", async () => {
  await page.goto(server.url);
  await until("count", /^4 \/ 5$/);
  assert.match(await text("finish"), /^ready at \d\d:\d\d$/);
  for (const id of ["count", "finish"]) {
    const px = await page.locator(`#${id}`).evaluate((e) => parseFloat(getComputedStyle(e).fontSize));
    assert.ok(px >= 40, `${id} has ${px} px`);
  }
  for (const at of ["", "?wall"]) {
    await page.setViewportSize({ width: 390, height: 844 });
    await page.goto(`${server.url}/${at}`);
    await until("count", /^4 \/ 5$/);
    const px = await page.locator("#count").evaluate((e) => parseFloat(getComputedStyle(e).fontSize));
    assert.ok(px >= 40, `a telephone at /${at} has ${px} px`);
  }
  await page.setViewportSize({ width: 1440, height: 960 });
  await page.goto(server.url);
  await until("count", /^4 \/ 5$/);
  const band = await page.locator(".now-band").boundingBox();
  assert.ok(band && band.width > 0.9 * 1440, `the band is ${band?.width} px wide`);
  const colour = () => page.locator(".now-band").evaluate((e) => getComputedStyle(e).backgroundColor);
  const busy = await colour();
  server.publish(held);
  await until("state", /^Held$/i);
  assert.notEqual(await colour(), busy);
  assert.equal(await text("finish"), "", "nobody knows when a held run ends");
});

test("the wall display shows state, count and plate, keeps the emergency stop and has no other command", async () => {
  server.publish(held);
  await page.goto(`${server.url}/?wall`);
  await until("state", /^Held$/i);
  for (const id of ["count", "sentence", "plate", "frame-box", "emergency-stop"]) {
    assert.equal(await page.locator(`#${id}`).isVisible(), true, id);
  }
  await until("sentence", /^Check the camera's cable\. The button is on the operator's page\.$/);
  for (const id of ["abort", "acknowledge", "new-run", "runs", "rig", "groups", "beads"]) {
    assert.equal(await page.locator(`#${id}`).isVisible(), false, id);
  }
  const buttons = page
    .locator("button:visible")
    .evaluateAll((found) => found.map((b) => b.id).filter((id) => id !== ""));
  assert.deepEqual(await buttons, ["emergency-stop"]);
  await shoot(page, "wall");
  await page.locator("#emergency-stop").click();
  await until("emergency-answer", /the motors were stopped/);
  assert.deepEqual(
    server.taken.map((t) => t.command),
    ["POST /v1/emergency-stop"],
  );
  // From across the room: which instrument it is, the model, and the numbers of the well that was finished last.
  server.publish(running);
  await until("state", /^Running$/i);
  await until("last-done", /Finished last: \w+ \d/);
  for (const id of ["last-done", "model-box", "instrument"]) {
    assert.equal(await page.locator(`#${id}`).isVisible(), true, id);
  }
  const px = await page.locator("#instrument").evaluate((e) => parseFloat(getComputedStyle(e).fontSize));
  assert.ok(px >= 28, `the name has ${px} px`);
  const lines = await page.locator("#last-done").evaluate((e) => {
    const words = e.innerHTML;
    e.append(" A long text.".repeat(200));
    const found = e.clientHeight / parseFloat(getComputedStyle(e).lineHeight);
    e.innerHTML = words;
    return found;
  });
  assert.ok(lines < 3.1, `${lines} lines of the well that was finished last`);
  await shoot(page, "wall-running");
});

test("the wall display fits its screen with 6 to 1536 wells, running and held", async () => {
  for (const [i, [wells, last, rows]] of (
    [
      [6, "B03", 2],
      [96, "H12", 8],
      [384, "P24", 16],
      [1536, "AF48", 32],
    ] as const
  ).entries()) {
    const id = `wall-${i}`;
    const own = { ...plan, plate_format: wells, plate_map: [{ well: last }] };
    server.answers[`/v1/runs/${id}`] = { ...detail, id, plan: own };
    const of = run([larva("A01", 240e6, 0), larva(last, 250e6, 0)], { id });
    for (const status of [running, held]) {
      server.publish({ ...status, run: of });
      await page.goto(`${server.url}/?wall`);
      await page.locator(`#plate[data-wells="${wells}"]`).waitFor();
      for (const [width, height] of [
        [1440, 900],
        [1920, 1080],
        [3840, 2160],
      ] as const) {
        await page.setViewportSize({ width, height });
        const at = `${status.state}, ${wells} wells, ${width} x ${height}`;
        const whole = await page.evaluate(() => {
          const { scrollWidth, scrollHeight } = document.documentElement;
          return { width: scrollWidth, height: scrollHeight };
        });
        assert.ok(whole.height <= height && whole.width <= width, `${at}: ${JSON.stringify(whole)}`);
        const table = (await page.locator("#plate").boundingBox())!;
        const box = (await page.locator(".plate-box:has(#plate)").boundingBox())!;
        assert.ok(table.width <= box.width + 1 && table.height <= box.height + 1, `${at}: ${JSON.stringify(table)}`);
        // It is as wide as its box, or nearly as high: less the row of the numbers, and a pixel per row that is rounded.
        const used = Math.max(table.width / box.width, table.height / box.height);
        assert.ok(used > (0.85 * rows) / (rows + 1), `${at}: the plate uses ${used} of its box`);
        // Names that are shown can be read, lie within the box and over no other.
        const shown = await page.locator("#plate th").evaluateAll((all) =>
          all
            .filter((th) => getComputedStyle(th).visibility === "visible")
            .map((th) => {
              const range = document.createRange();
              range.selectNodeContents(th);
              const { left, top, right, bottom } = range.getBoundingClientRect();
              return { text: th.textContent, px: parseFloat(getComputedStyle(th).fontSize), left, top, right, bottom };
            }),
        );
        assert.ok(shown.length >= 5, at);
        for (const [place, name] of shown.entries()) {
          assert.ok(name.px >= 9, `${at}: ${name.text} has ${name.px} px`);
          assert.ok(name.left >= box.x - 1 && name.bottom <= box.y + box.height + 1, `${at}: ${name.text} is cut`);
          const over = shown.findIndex(
            (other, i) =>
              i !== place &&
              other.left < name.right - 1 &&
              name.left < other.right - 1 &&
              other.top < name.bottom - 1 &&
              name.top < other.bottom - 1,
          );
          assert.equal(over, -1, `${at}: ${name.text} lies over ${shown[over]?.text}`);
        }
        const legend = (await page.locator("#legend").boundingBox())!;
        assert.ok(legend.y + legend.height <= height, `${at}: the legend is beyond the lower edge`);
        await shoot(page, `wall-${wells}-${width}-${status.state}`);
      }
    }
  }
});

test("the left column of a full plate on which every well has flags is not longer than the page beside it needs", async () => {
  const flags = ["fin_detail", "moved", "fins_unseen", "blurred", "few_views"];
  for (const rows of [8, 16]) {
    const wells = Array.from({ length: rows }, (_, row) =>
      Array.from(
        { length: rows * 1.5 },
        (_, column) => `${"ABCDEFGHIJKLMNOP"[row]}${String(column + 1).padStart(2, "0")}`,
      ),
    ).flat();
    server.publish(status({ state: "Complete", run: run(wells.map((name) => ({ ...larva(name, 240e6, 0), flags }))) }));
    await page.setViewportSize({ width: 1440, height: 900 });
    await page.goto(server.url);
    await page.locator("#attention-list > li").nth(4).waitFor();
    const column = (await page.locator(".columns > .column").first().boundingBox())!;
    await shoot(page, `left-${wells.length}`);
    assert.ok(column.height < 2 * 900, `${wells.length} wells: ${column.height} px`);
    // What somebody has to look at is beside the name of the folded card.
    await until("rig-words", /[✓!✕] /);
    assert.equal(await page.locator("#rig").isVisible(), false);
    assert.deepEqual(await breaches(page), []);
    await page.getByText("Wells as a table").click();
    const sentences = (await page.locator("#results td.long").first().boundingBox())!;
    assert.ok(sentences.width >= 280, `the flags have ${sentences.width} px`);
    const beyond = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    assert.ok(beyond <= 0, `${beyond} px beyond the right edge`);
  }
});

test("notices and sound are off by default, and come once for each need", async () => {
  await page.addInitScript(() => {
    const said: string[] = [];
    Object.assign(window, { said });
    class Recorded {
      static permission = "default";
      static async requestPermission() {
        return (Recorded.permission = "granted");
      }
      constructor(title: string, { body }: { body: string }) {
        said.push(`${title}: ${body}`);
      }
    }
    Object.assign(window, { Notification: Recorded });
    const start = OscillatorNode.prototype.start;
    OscillatorNode.prototype.start = function (...when) {
      said.push("sound");
      start.apply(this, when);
    };
  });
  const said = () => page.evaluate(() => (window as unknown as { said: string[] }).said);
  await page.goto(server.url);
  await until("state", /^Running$/i);
  server.publish(held);
  await until("state", /^Held$/i);
  assert.deepEqual(await said(), [], "nobody has asked for notices");
  server.publish(running);
  await until("state", /^Running$/i);
  await page.getByText("Display", { exact: true }).click();
  await page.getByLabel("Notices when somebody is needed").check();
  await page.getByLabel("Sound with them").check();
  // The browser lets it play a moment after the click.
  await page.waitForFunction(() => (window as unknown as { said: string[] }).said.length > 0);
  assert.deepEqual(await said(), ["sound"], "how it sounds");
  server.publish(held);
  await until("state", /^Held$/i);
  server.publish({ ...held, uptime_s: 999 });
  await page.locator("#rig", { hasText: /16 min/ }).waitFor({ state: "attached" });
  assert.deepEqual((await said()).slice(1), ["carved: Held: Check the camera's cable.", "sound"]);
});

test("a sound that the browser does not let play yet is said to wait for a click, also on the wall display", async () => {
  await page.addInitScript(() => localStorage.setItem("carved.sound", "on"));
  await page.goto(`${server.url}/?wall`);
  await until("state", /^Running$/i);
  await until("allow-sound", /^Click once to allow the sound$/);
  await shoot(page, "wall-sound");
  // An alarm meanwhile is not played later.
  server.publish(held);
  await until("state", /^Held$/i);
  await page.locator("#count").click();
  await page.locator("#allow-sound").waitFor({ state: "hidden" });
  // Chromium says that it wants a click.
  complaints.splice(
    0,
    complaints.length,
    ...complaints.filter((c) => !/AudioContext was not allowed to start/.test(c)),
  );
});

test("a browser that shows no notices of a page keeps its page up to date and says so", async () => {
  await page.addInitScript(() => {
    // As Chrome on Android: permitted, but not from a page.
    class Illegal {
      static permission = "granted";
      constructor() {
        throw new TypeError("Failed to construct 'Notification': Illegal constructor.");
      }
    }
    Object.assign(window, { Notification: Illegal });
  });
  await page.goto(server.url);
  await until("state", /^Running$/i);
  await page.getByText("Display", { exact: true }).click();
  await page.getByLabel("Notices when somebody is needed").check();
  server.publish(held);
  await until("state", /^Held$/i);
  await until("display-words", /^This browser shows no notices of a page\. Use the sound, or another browser\.$/);
  assert.equal(await page.getByLabel("Notices when somebody is needed").isChecked(), false);
  server.publish(running);
  await until("state", /^Running$/i);
});

const queued = ["N-1", "N-2"].map((barcode, i) => ({
  ...{ run: `night-${i}`, plate_barcode: barcode, method: "standard", operator: "Kim", wells: 96 },
  trouble: i === 0 ? null : "method retired is not configured",
}));

/** What an operator can have on the page. `ready` waits until it is drawn. */
const SCREENS: { name: string; at: string; status: Status; ready?: () => Promise<unknown> }[] = [
  { name: "idle", at: "", status: status() },
  { name: "running", at: "", status: { ...running, queue: queued } },
  { name: "held", at: "", status: held },
  { name: "stored run", at: "?run=P-9-old", status: running },
  {
    ...{ name: "record", at: "?run=P-9-old", status: running },
    async ready() {
      // The contact sheet has the picture of the well, and the well its views.
      await page.locator("#sheet-list").scrollIntoViewIfNeeded();
      await page.locator('#sheet-list li[data-well="B01"] img[src]').waitFor();
      await page.locator('button[data-well="B01"].well').click();
      await until("frame-whose", /^view 1 of 3$/);
      await page.locator("#views-list").scrollIntoViewIfNeeded();
      await page.locator("#views-list img").first().waitFor();
    },
  },
  { name: "wall", at: "?wall", status: held },
];

/** Whether the element at the middle of the emergency stop is the stop. */
const stopIsInReach = () =>
  page.locator("#emergency-stop").evaluate((button) => {
    const { left, top, width, height } = button.getBoundingClientRect();
    return button.contains(document.elementFromPoint(left + width / 2, top + height / 2));
  });

test("every screen fits 390 to 3840 px with the emergency stop in reach, in both themes, and axe finds nothing", async () => {
  for (const screen of SCREENS) {
    server.publish(screen.status);
    await page.goto(`${server.url}/${screen.at}`);
    await until("link", /^Live$/);
    if (screen.at.startsWith("?run")) await until("opened-words", /^Stored run/);
    // Everything that can be unfolded is looked at, too.
    if (screen.name !== "wall") {
      await page.locator("main details").evaluateAll((folds) => {
        for (const fold of folds as HTMLDetailsElement[]) fold.open = true;
      });
      await page.locator("#display > summary").click();
    }
    await screen.ready?.();
    await isAccessible(page, screen.name, async (of) => {
      assert.ok(await stopIsInReach(), `${of}: something covers the emergency stop`);
      await shoot(page, of.replaceAll(/[ ,]+/g, "-"));
    });
  }
});

test("the documentation fits 390 to 3840 px in both themes, and axe finds nothing", async () => {
  for (const name of ["index", "faults"]) {
    await page.goto(`${server.url}/docs/${name}.html`);
    await page.getByRole("searchbox").fill("emergency stop");
    await page.locator("form ol > li").first().waitFor();
    await isAccessible(page, `docs ${name}`, (of) => shoot(page, of.replaceAll(/[ ,]+/g, "-")));
  }
});
