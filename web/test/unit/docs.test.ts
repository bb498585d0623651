import assert from "node:assert/strict";
import { mkdtemp, readFile, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { test } from "node:test";
import { gunzipSync } from "node:zlib";
import { docs } from "../../docs.mjs";
import { find, type Page } from "../../src/docs/search";
import { FLAGS } from "../../src/flags";
import { flagWords } from "../../src/reasons";

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
    find(PAGES, "cable CAMERA").map((hit) => hit.href),
    ["faults.html#camera", "setup.html#b"],
  );
  assert.deepEqual(
    find(PAGES, "rig light").map((hit) => hit.href),
    ["setup.html#a"],
  );
  assert.deepEqual(find(PAGES, "camera lamp"), []);
  assert.deepEqual(find(PAGES, "  "), []);
});

test("a section with the words as they stand in the query is first, whatever their punctuation", () => {
  assert.equal(find(PAGES, "Camera, cable")[0]?.href, "setup.html#b");
  assert.equal(find(PAGES, "check its CABLE.")[0]?.href, "faults.html#camera");
});

test("an excerpt is the text around the first word", () => {
  const [, second] = find(PAGES, "cable");
  assert.ok(second?.excerpt.startsWith("... ") && second.excerpt.includes("camera cable at the end"), second?.excerpt);
});

test("what is copied from the page is found where it is explained", async () => {
  const out = await mkdtemp(join(tmpdir(), "carved-search-"));
  try {
    await docs("..", out);
    const pages = JSON.parse(gunzipSync(await readFile(join(out, "search.json.gz"))).toString()) as Page[];
    const first = (query: string) => find(pages, query)[0]?.href ?? "nothing";
    const textOf = (href: string) =>
      pages.flatMap((page) => page.sections.filter(({ id }) => href === `${page.name}#${id}`))[0]?.text ?? "";
    const plain = (text: string) => text.toLowerCase().replace(/[^a-z0-9]+/g, " ");
    const has = (query: string) => plain(textOf(first(query))).includes(plain(query));
    const missed: string[] = [];
    for (const [code, { meaning, whatToDo }] of Object.entries(FLAGS)) {
      for (const query of [flagWords(code), meaning, code])
        if (!first(query).endsWith(`#row-${code}`)) missed.push(`${query} -> ${first(query)}`);
      // Several may have one remedy.
      if (!has(whatToDo)) missed.push(`${whatToDo} -> ${first(whatToDo)}`);
    }
    const faults = await readFile("../docs/faults.md", "utf8");
    const rows = [...faults.matchAll(/^\| `([a-z_]+)` \|(?:[^|]*\|){4} ([^|]*) \| ([^|]*) \|$/gm)];
    assert.ok(rows.length > 30, String(rows.length));
    for (const [, code, meaning, remedy] of rows) {
      if (first(meaning!) !== `faults.html#row-${code}`) missed.push(`${meaning} -> ${first(meaning!)}`);
      if (!has(remedy!)) missed.push(`${remedy} -> ${first(remedy!)}`);
    }
    assert.deepEqual(missed, []);
  } finally {
    await rm(out, { recursive: true });
  }
});
