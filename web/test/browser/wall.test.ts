// Several instruments on one page: one daemon serves it, another one has a token and is read with the token that only reads.

import assert from "node:assert/strict";
import { mkdtemp, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { test } from "node:test";
import { isAccessible } from "../support/axe.ts";
import { shoot } from "../support/browser.ts";
import { BINARY, Daemon, RUN_MS } from "../support/daemon.ts";
import { larva, opened, plan, until } from "../support/opened.ts";

test("two instruments on one page, one of which lets this page only read", { timeout: 2 * RUN_MS }, async (t) => {
  const { daemon, page, complaints } = await opened(t, 5);
  const folder = await mkdtemp(join(tmpdir(), "carved-wall-"));
  t.after(() => rm(folder, { recursive: true }));
  const [token, read] = ["k".repeat(32), "r".repeat(32)];
  const tokens = [join(folder, "token"), join(folder, "read")] as const;
  await writeFile(tokens[0], token, { mode: 0o600 });
  await writeFile(tokens[1], read, { mode: 0o600 });
  const more = ["--no-demo", "--small", "--token-file", tokens[0], "--read-token-file", tokens[1]];
  const other = await Daemon.start(BINARY, 5, [...more, "--wall-origin", daemon.url]);
  t.after(() => other.stop());

  await page.getByText("Display", { exact: true }).click();
  await page.getByRole("link", { name: "Several instruments" }).click();
  await page.getByText("No instrument is named yet.").waitFor();
  const add = async (address: string, word: string) => {
    await page.getByLabel("Address").fill(address);
    await page.getByLabel("Token that only reads").fill(word);
    await page.getByRole("button", { name: "Add it" }).click();
  };
  await add(daemon.url, "");
  await until(page, "needs", /^Nobody is needed\.$/);
  await add(other.url, "wrong".repeat(8));
  const tiles = page.locator("#tiles > li");
  await tiles.nth(1).getByText("No status: the token is missing or wrong.").waitFor();
  await add(other.url, read);
  await tiles.nth(1).getByText("Idle", { exact: true }).waitFor();
  assert.equal(await tiles.count(), 2, "the same address is named once");

  // What happens at an instrument is seen on the page: a run, its numbers, and that somebody is needed.
  await daemon.send("PUT", "/v1/runs/r1", plan([larva("A01")]));
  await tiles
    .nth(0)
    .getByText(/^Last: A01 \d+\.\d\s±\s.*nL/)
    .waitFor({ timeout: RUN_MS });
  await tiles.nth(0).getByText("1 / 1", { exact: true }).waitFor();
  const stop = { method: "POST", headers: { Authorization: `Bearer ${read}` } };
  assert.equal((await fetch(`${other.url}/v1/emergency-stop`, stop)).status, 403, "this token only reads");
  await fetch(`${other.url}/v1/emergency-stop`, { method: "POST", headers: { Authorization: `Bearer ${token}` } });
  await until(page, "needs", /^Somebody is needed at /);
  assert.equal(await tiles.nth(1).getAttribute("data-tone"), "alarm");

  await isAccessible(page, "instruments", (of) => shoot(page, of.replaceAll(/[ ,]+/g, "-")));

  // Alone on the page, one that hangs in a run is not shown as running. At first nobody is needed, then somebody is, and it answers again.
  await page.getByRole("button", { name: `Remove ${other.url}` }).click();
  await until(page, "needs", /^Nobody is needed\.$/);
  assert.equal(await tiles.count(), 1);
  await daemon.send("PUT", "/v1/runs/r2", plan([larva("A01"), larva("A02")]));
  const hung = tiles.nth(0);
  const state = (words: string) => hung.locator(".state").getByText(words, { exact: true });
  await state("Running").waitFor();
  daemon.signal("SIGSTOP");
  await hung.and(page.locator('[data-tone="calm"][data-needed="false"]')).waitFor();
  await state("No answer").waitFor();
  await hung.getByText(/^No answer for \d+ s\. What is shown is that old\.$/).waitFor();
  await shoot(page, "instruments-no-answer");
  await hung.and(page.locator('[data-tone="alarm"][data-needed="true"]')).waitFor();
  await state("Silent").waitFor();
  await until(page, "needs", /^Somebody is needed at /);
  daemon.signal("SIGCONT");
  await hung
    .locator(".state")
    .filter({ hasNotText: /^(No answer|Silent)$/ })
    .waitFor();
  await hung.locator(".trouble").waitFor({ state: "detached" });

  // One that is away needs somebody, too.
  await daemon.stop();
  await hung
    .locator(".needed")
    .getByText(/^No answer for .*: it does not answer/)
    .waitFor();
  const away = /ERR_CONNECTION_REFUSED|401/;
  assert.deepEqual(
    complaints.filter((complaint) => !away.test(complaint)),
    [],
  );
});
