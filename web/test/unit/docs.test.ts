import assert from "node:assert/strict";
import { test } from "node:test";
import { find, type Page } from "../../src/docs/search";

const PAGES: Page[] = [
  {
    name: "faults.html",
    title: "Faults",
    sections: [{ id: "camera", text: "Camera The camera does not answer. Check its cable." }],
  },
  {
    name: "setup.html",
    title: "Set up a rig",
    sections: [
      { id: "a", text: "Light Switch the light on." },
      { id: "b", text: "Long " + "word ".repeat(60) + "camera cable at the end" },
    ],
  },
];

test("a section is found by all words of a query, a heading first", () => {
  assert.deepEqual(
    find(PAGES, "camera CABLE").map((hit) => hit.href),
    ["faults.html#camera", "setup.html#b"],
  );
  assert.deepEqual(
    find(PAGES, "rig light").map((hit) => hit.href),
    ["setup.html#a"],
  );
  assert.deepEqual(find(PAGES, "camera lamp"), []);
  assert.deepEqual(find(PAGES, "  "), []);
});

test("an excerpt is the text around the first word", () => {
  const [, second] = find(PAGES, "cable");
  assert.ok(second?.excerpt.startsWith("... ") && second.excerpt.includes("camera cable at the end"), second?.excerpt);
});
