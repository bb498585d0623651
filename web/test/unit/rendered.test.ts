import assert from "node:assert/strict";
import { mkdir, mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { gunzipSync } from "node:zlib";
import { docs } from "../../docs.mjs";

let root: string;
before(async () => {
  root = await mkdtemp(join(tmpdir(), "carved-docs-"));
  await mkdir(join(root, "docs"));
  await writeFile(join(root, "config.toml"), "");
  await writeFile(join(root, "docs/a.png"), "png");
});
after(() => rm(root, { recursive: true }));

async function rendered(index: string, other: string): Promise<string> {
  await writeFile(join(root, "docs/README.md"), index);
  await writeFile(join(root, "docs/other.md"), other);
  await docs(root, join(root, "out"));
  return gunzipSync(await readFile(join(root, "out/index.html.gz"))).toString();
}

const INDEX =
  "# Pages\n\n## How-to: do it\n\n| page | what |\n|---|---|\n| [other.md](other.md) | [how](other.md#the-way) |\n";

test("links lead to rendered pages, headings and pictures, and other files become text", async () => {
  const html = await rendered(
    `${INDEX}\n![x](a.png) [file](../config.toml) [api](openapi.json)\n`,
    "# Other page\n\n## The way\n",
  );
  for (const part of [
    'href="other.html#the-way"',
    'src="a.png"',
    'href="/openapi.json"',
    "file <a",
    '<a href="other.html">Other page</a>',
  ])
    assert.ok(html.includes(part), part);
  assert.ok(!html.includes("config.toml"));
  assert.ok(!html.includes("other.md"), "the index names pages by their titles");
});

test("a link that leads nowhere ends the build and is named", async () => {
  await assert.rejects(rendered(INDEX, "# Other page\n"), /docs\/README.md: docs\/other.md has no heading #the-way/);
  await assert.rejects(
    rendered(INDEX, "# Other\n\n## The way\n\n[gone](gone.md)\n"),
    /docs\/other.md: a link leads to docs\/gone.md/,
  );
  await assert.rejects(
    rendered(INDEX, "# Other\n\n## The way\n\n[gone](../no.toml)\n"),
    /leads to no.toml, which does not exist/,
  );
});
