// Twelve instruments in different states on one page: what each tile says, that it fits every screen, and that axe finds nothing.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import type { Browser } from "playwright-core";
import type { Status } from "../../src/status.ts";
import { breaches } from "../support/axe.ts";
import { openBrowser, openPage, shoot } from "../support/browser.ts";
import { FixtureServer } from "../support/fixture-server.ts";
import { carved, fault, run, specimen, status, well } from "../support/statuses.ts";

let browser: Browser;

before(async () => {
  browser = await openBrowser();
});
after(async () => {
  await browser?.close();
});

const measured = (name: string) =>
  well(name, {
    ...{ outcome: "succeeded" as const, volume_um3: 243.1e6, volume_sd_um3: 1.4e6, area_um2: 3.73e6, area_sd_um2: 2e4 },
  });
const names = (count: number) =>
  Array.from({ length: count }, (_, i) => `${"ABCDEFGH"[Math.floor(i / 12)]}${String((i % 12) + 1).padStart(2, "0")}`);
const plateOf = (done: number, change: Parameters<typeof run>[1] = {}) =>
  run(
    names(96).map((name, i) => (i < done ? measured(name) : well(name))),
    change,
  );
const inPlace = { barcode: "P-2026-0311", present: true, removable: false, needs: null, take_out: null, bring: null };
const free = { ...inPlace, removable: true };
const over = (outcome: "succeeded" | "aborted" | "partial") =>
  plateOf(96, { outcome, ended: "2026-03-05T11:02:00Z", eta_s: null });
const names12 = (name: string, change: Partial<Status> = {}): Status => {
  const plain = status(change);
  return { ...plain, mode: "hardware", instrument: { ...plain.instrument, name } };
};

const cause = { code: "disk_full", fault_seq: 7, times: 2, next_try: null };
const INSTRUMENTS: Record<string, Status | 401 | null> = {
  "vast-1": names12("vast-1"),
  "vast-2": names12("vast-2", {
    ...{ state: "Execute", doing: "taking view 10 of 22 of the larva in D03", plate: inPlace },
    ...{ run: plateOf(38, { eta_s: { p50: 5400, p90: 6100 } }), specimen: specimen("D03", carved(262e6, 9)) },
  }),
  "vast-3": names12("vast-3", {
    ...{ state: "Held", doing: "waiting until the disk has space", plate: inPlace },
    run: plateOf(61, {
      hold: {
        ...cause,
        cause: "the data disk has 0.4 GB left; a plate needs 11 GB",
        next_action: "Make space on the data disk, then let the run go on.",
        next_command: null,
      },
    }),
    faults: [fault({ code: "disk_full", category: "storage", operator_required: true, ends_by_itself: true })],
  }),
  "vast-4": null,
  "vast-5": names12("vast-5", { state: "Complete", doing: "waiting for a run", plate: free, run: over("succeeded") }),
  "vast-6": names12("vast-6", {
    ...{ state: "Execute", doing: "waiting for the specimen of B07", run: plateOf(18) },
    plate: { ...inPlace, bring: "B07" },
  }),
  "Zebrafish core facility, room 2.17, bench by the window": names12(
    "Zebrafish core facility, room 2.17, bench by the window",
    {
      ...{ state: "Execute", doing: "washing the capillary", plate: inPlace },
      run: plateOf(95, { id: "2026-03-05-toxicity-screen-compound-library-B-plate-11" }),
    },
  ),
  "vast-8": 401,
  "vast-9": names12("vast-9", {
    ...{ ready: false, not_ready_reason: "the axis has no reference", state: "Stopped", doing: "waiting" },
  }),
  "vast-10": names12("vast-10", {
    ...{ state: "Aborted", doing: "stopped by the emergency stop", plate: free, run: over("aborted") },
    faults: [
      fault({
        ...{ code: "emergency_stop", category: "operator", operator_required: true },
        what_to_do: "Look at the instrument. When nobody is in danger, press Reset.",
      }),
    ],
  }),
  "vast-11": { ...names12("vast-11"), mode: "simulated" },
  "vast-12": names12("vast-12", {
    ...{ state: "Suspended", doing: "waiting for the next plate", plate: { ...inPlace, needs: "plate" } },
    run: plateOf(4),
  }),
};

test("twelve instruments fit every screen, say who is needed, and axe finds nothing", async (t) => {
  const server = new FixtureServer(status());
  await server.start();
  t.after(() => server.stop());
  const { page, complaints } = await openPage(browser);
  t.after(() => page.context().close());
  const all = Object.values(INSTRUMENTS).map((of, i) => ({ address: `http://10.0.0.${i + 1}:8420`, of }));
  for (const { address, of } of all) {
    await page.route(`${address}/v1/status`, (route) => {
      const headers = { "Access-Control-Allow-Origin": "*", "Access-Control-Allow-Headers": "*" };
      if (of === null) return route.abort("connectionrefused");
      return of === 401 ? route.fulfill({ status: 401, headers }) : route.fulfill({ headers, json: of });
    });
  }
  const kept = all.map(({ address }) => ({ address, token: "" }));
  await page.addInitScript((json) => localStorage.setItem("carved.instruments", json), JSON.stringify(kept));
  for (const theme of ["light", "dark"] as const) {
    await page.emulateMedia({ colorScheme: theme });
    await page.goto(`${server.url}/wall/`);
    const tiles = page.locator("#tiles > li");
    await tiles
      .nth(3)
      .getByText(/^No status: it does not answer/)
      .waitFor();
    await tiles.nth(7).getByText("No status: the token is missing or wrong.").waitFor();
    for (const at of [0, 1, 2, 4, 5, 6, 8, 9, 10, 11]) {
      await tiles
        .nth(at)
        .getByRole("heading", { name: Object.keys(INSTRUMENTS)[at]! })
        .waitFor();
    }
    assert.equal(await tiles.count(), 12);
    await tiles.nth(8).getByText("Not ready for a run: the axis has no reference.").waitFor();
    const tones = await tiles.evaluateAll((all) => all.map((tile) => (tile as HTMLElement).dataset["tone"]));
    assert.deepEqual(tones, [
      ...["calm", "busy", "alarm", "alarm", "good", "attention"],
      ...["busy", "alarm", "attention", "alarm", "calm", "attention"],
    ]);
    for (const width of [3840, 1920, 1440, 768, 390]) {
      await page.setViewportSize({ width, height: width === 390 ? 844 : Math.round((width * 9) / 16) });
      const beyond = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      assert.ok(beyond <= 0, `${width} px: ${beyond} px beyond the right edge`);
      assert.deepEqual(await breaches(page), [], `${width} px, ${theme}`);
      await shoot(page, `twelve-${width}-${theme}`);
    }
  }
  assert.deepEqual(
    complaints.filter((complaint) => !/ERR_CONNECTION_REFUSED|401/.test(complaint)),
    [],
  );
});
