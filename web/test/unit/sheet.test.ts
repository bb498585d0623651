import assert from "node:assert/strict";
import { test } from "node:test";
import { frameLink, nearest, standardLink, sureness } from "../../src/sheet.ts";
import type { Specimen } from "../../src/status.ts";

const omegas = [0, 1, 2, 3].map((quarter) => (quarter * Math.PI) / 2);

test("the view from the side has the back up", () => {
  // In the first view the direction at pi points up.
  assert.equal(nearest(omegas, [0, -1, 0], "lateral"), 0);
  assert.equal(nearest(omegas, [0, 1, 0], "lateral"), 2);
  assert.equal(nearest(omegas, [0.1, 0, 1], "lateral"), 1);
  assert.equal(nearest(omegas, [0, 0, -1], "lateral"), 3);
  assert.equal(nearest(omegas, null, "lateral"), 0);
  assert.equal(nearest([], [0, 1, 0], "lateral"), 0);
});

test("the view from above has the back towards the camera", () => {
  // The camera is at -z; a quarter turn moves what is near it down, so what is up comes near it.
  assert.equal(nearest(omegas, [0, 0, -1], "dorsal"), 0);
  assert.equal(nearest(omegas, [0, -1, 0], "dorsal"), 1);
  assert.equal(nearest(omegas, [0, 0, 1], "dorsal"), 2);
  assert.equal(nearest(omegas, [0, 1, 0], "dorsal"), 3);
});

function specimen(lateral_png: string | null): Pick<Specimen, "links" | "measurement"> {
  const links = { lateral_png, dorsal_png: null, views: ["/w/views/0.png", "/w/views/3.png"], detection: null };
  const views = omegas.map((omega, index) => ({ index, omega, used: true }));
  const shape = { body: { dorsal: { direction: [0, 0, -1] } } };
  const facing = { confidence: 0.84, head_confidence: 0.91 };
  return { links, measurement: { views, shape, facing } } as unknown as Specimen;
}

test("the standard picture is shown where there is one, and else the frame, which is said", () => {
  assert.equal(standardLink(specimen("/w/lateral.png"), "lateral"), "/w/lateral.png");
  assert.match(sureness(specimen("/w/lateral.png"), "lateral"), /confidence 0\.84/);
  assert.equal(standardLink(specimen("/w/lateral.png"), "dorsal"), null);
  assert.match(frameLink(specimen(null), "lateral") ?? "", /views\/3\.jpg/);
  assert.match(frameLink(specimen(null), "dorsal") ?? "", /views\/0\.jpg/);
  assert.match(sureness(specimen(null), "lateral"), /carved export pictures/);
  const undecided = { links: specimen(null).links, measurement: { views: [], facing: null } } as unknown as Specimen;
  assert.match(sureness(undecided, "lateral"), /not decided/);
  assert.match(sureness({ links: specimen(null).links, measurement: null }, "lateral"), /no numbers/);
});
