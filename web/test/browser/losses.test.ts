// A camera and an axis that are lost while the real daemon works, as the operator sees it. The two tests wait much and compute little, so
// they run at the same time.

import assert from "node:assert/strict";
import { test } from "node:test";
import { shoot } from "../support/browser.ts";
import { BINARY, Daemon, RUN_MS } from "../support/daemon.ts";
import { bySize, larva, onPage, plan, until } from "../support/opened.ts";

type Ends = Parameters<typeof onPage>[0];

/** A daemon whose devices are lost, its run, which begins at once, and its page. */
async function running(t: Ends, timeScale: number, losses: readonly string[], wells: object[]) {
  const daemon = await begun(t, timeScale, losses, wells);
  return { daemon, ...(await onPage(t, daemon)) };
}

/** Its run begins before a page is opened, which takes its time: the devices are lost at fixed times. */
async function begun(t: Ends, timeScale: number, losses: readonly string[], wells: object[]): Promise<Daemon> {
  const daemon = await Daemon.start(BINARY, timeScale, ["--no-demo", "--small", ...losses]);
  t.after(() => daemon.stop());
  await daemon.send("PUT", "/v1/runs/lost", plan(wells));
  return daemon;
}

async function cameraLost(t: Ends): Promise<void> {
  const daemon = await begun(t, 1, ["--camera-out", "8,60"], [larva("A01"), larva("A02")]);
  const [lost, { page, complaints }] = await Promise.all([
    daemon.follow((s) => !s.hardware.camera.connected),
    onPage(t, daemon),
  ]);
  assert.equal(lost.state, "Execute");
  await page.locator('#now[data-tone="attention"]').waitFor();
  const held = await daemon.follow((s) => s.state === "Held");
  const hold = held.run!.hold!;
  assert.deepEqual([hold.code, hold.times, hold.next_command], ["camera_lost", 1, null]);
  await page
    .locator("#sentence", { hasText: /^Check the camera's power and network cable\. The run continues by/ })
    .waitFor();
  await page.locator("#diagnosis", { hasText: /^Held because: Camera lost\./ }).waitFor();
  await page.locator("#fault-list", { hasText: "Needs you" }).waitFor();
  assert.equal(await page.locator("#unhold").isVisible(), false);
  assert.equal(await page.getByRole("button", { name: "Acknowledge" }).count(), 0);
  await shoot(page, "control-camera-lost");
  // Held by an operator too, it waits once the camera is back, and its words no longer say that it does not.
  await page.getByRole("button", { name: "Keep it held" }).click();
  await page.locator("#sentence", { hasText: /When the camera answers, let the run go on\.$/ }).waitFor();
  await daemon.follow((s) => s.faults.length === 0);
  await page.locator("#sentence", { hasText: /^Let the run go on when you are ready\.$/ }).waitFor();
  await page.locator("#diagnosis", { hasText: /^Held by a cause that is over: Camera lost\./ }).waitFor();
  assert.equal((await bySize(page))[0], "unhold", "the one thing to do is the largest button");
  await shoot(page, "control-camera-back");
  await page.locator("#unhold").click();
  await daemon.follow((s) => s.state === "Execute" && s.hardware.camera.connected);
  await page.locator("#diagnosis").waitFor({ state: "hidden" });
  assert.deepEqual(complaints, []);
}

async function axisLostInATurn(t: Ends): Promise<void> {
  // At a fifth of the speed the turn lasts from the 7th second to the 38th on a quiet machine, and later on a busy one. The loss outlasts the
  // opening of a slow page.
  const { daemon, page, complaints } = await running(t, 0.2, ["--axis-out", "26,20"], [larva("A01")]);
  const held = await daemon.follow((s) => s.state === "Held");
  assert.equal(held.run!.hold!.code, "rotation_lost");
  await until(
    page,
    "sentence",
    /^Check the controller's power and cable, .* When the axis answers, acknowledge that it is back/,
  );
  assert.equal(await page.locator("#unhold").isVisible(), false);
  // Its power may have been off, so a person decides when it turns again.
  const back = await daemon.follow((s) => s.faults[0]?.code === "rotation_intervention");
  assert.deepEqual([back.state, back.run!.goes_on_by_itself], ["Held", false]);
  await page.locator("#fault-list", { hasText: "was away and is back" }).waitFor();
  await shoot(page, "control-axis-back");
  await page.getByRole("button", { name: "Acknowledge" }).first().click();
  // Who has not given a name is asked once, and nothing waits for the answer.
  await page.getByLabel("Your name, for the record of what you ask").fill("Kim");
  await shoot(page, "control-name");
  await page.getByRole("button", { name: "Keep it" }).click();
  await page.locator("#who").waitFor({ state: "hidden" });
  await page.locator("#unhold").click();
  await daemon.follow((s) => s.state === "Execute" && s.faults.length === 0);
  assert.equal(await page.locator("#who").isVisible(), false);
  const done = await daemon.follow((s) => s.run?.outcome != null);
  assert.equal(done.run!.results[0]!.outcome, "succeeded", JSON.stringify(done.run));
  await page.getByText("What happened in this run").click();
  await until(page, "log-list", /A01 was interrupted .*: it is measured again from the start\./);
  await until(page, "log-list", /The run is held: The axis' controller does not answer/);
  await until(page, "log-list", /A client at the instrument's computer \(no name given\) acknowledged the fault/);
  await until(page, "log-list", /Kim \(the instrument's computer\) lets the run go on\./);
  const stored = (await (await fetch(`${daemon.url}/v1/runs/lost/specimens/A01`)).json()) as {
    earlier_attempts: number[];
  };
  // On a busy machine a frame may be lost as well, and the specimen is begun once more.
  assert.equal(stored.earlier_attempts[0], 1, "the turn that was cut short is kept");
  await until(page, "well-body", /Measured/);
  await shoot(page, "runs-redo");
  assert.deepEqual(complaints, []);
}

test("devices that are lost while a run is under way", { concurrency: 2, timeout: 3 * RUN_MS }, async (t) => {
  await Promise.all([
    t.test(
      "a camera: shown at once, its remedy is the headline, and nobody is offered to go on before it is back",
      cameraLost,
    ),
    t.test("an axis in a turn: a person is asked when it is back, and the specimen is measured again", axisLostInATurn),
  ]);
});
