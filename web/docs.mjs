// Renders the Markdown pages of the repository to HTML for the daemon, which serves them at /docs without a network.
//
//   docs/README.md ──links──► the other pages ──► dist/docs/*.html, their pictures, search.json (the text of every section)
//
// A link to a page, a heading or a picture that does not exist ends the build. A link to another file of the repository, such as a
// configuration, becomes plain text: the program does not hold that file.

import { copyFile, mkdir, readFile, stat, writeFile } from "node:fs/promises";
import { dirname, join, normalize } from "node:path";
import { gzipSync } from "node:zlib";
import { Marked } from "marked";
import { getHeadingList, gfmHeadingId } from "marked-gfm-heading-id";

const INDEX = "docs/README.md";
/** What the daemon serves under another address. */
const SERVED = { "docs/openapi.json": "/openapi.json" };
const PICTURE = /\.(png|svg|jpg|webp)$/;

const escaped = (text) =>
  text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;").replaceAll('"', "&quot;");
const isOutside = (href) => /^[a-z]+:/i.test(href);

/** The name of the HTML page of a Markdown file. */
export function nameOf(source) {
  if (source === INDEX) return "index.html";
  return `${source
    .replace(/^docs\//, "")
    .replace(/\.md$/, "")
    .replaceAll("/", "-")
    .toLowerCase()}.html`;
}

/** Where a link of a page leads: `{ source, hash }` within the repository. */
export function target(from, href) {
  const [path, hash = ""] = href.split("#", 2);
  return { source: path === "" ? from : normalize(join(dirname(from), path)), hash };
}

async function exists(path) {
  return stat(path).then(
    () => true,
    () => false,
  );
}

/** One page: its HTML, headings, the sections of its text, and the links that it has. */
async function read(root, source) {
  const marked = new Marked(gfmHeadingId());
  const links = [];
  const unheld = [];
  const coded = new Set();
  const shown = async (token) => {
    if (token.type !== "link" && token.type !== "image") return;
    if (isOutside(token.href)) return;
    const { source: to, hash } = target(source, token.href);
    const known = SERVED[to];
    if (known !== undefined) token.href = known;
    else if (to.endsWith(".md")) {
      links.push({ to, hash });
      token.href = to === source ? `#${hash}` : nameOf(to) + (hash ? `#${hash}` : "");
    } else if (PICTURE.test(to)) {
      links.push({ to, hash: "" });
      token.href = to.replace(/^docs\//, "").replaceAll("/", "-");
    } else {
      if (!(await exists(join(root, to)))) throw new Error(`${source}: a link leads to ${to}, which does not exist`);
      unheld.push(token);
    }
  };
  marked.use({
    async: true,
    walkTokens: shown,
    renderer: {
      link(token) {
        return unheld.includes(token) ? this.parser.parseInline(token.tokens) : false;
      },
      table(token) {
        const row = (cells, tag) =>
          `<tr>${cells.map((c) => `<${tag}${tag === "th" ? ' scope="col"' : ""}>${this.parser.parseInline(c.tokens)}</${tag}>`).join("")}</tr>`;
        // The first row about a code has it as its anchor: `row-moved`.
        const anchored = (cells) => {
          const [, code] = /^`([a-z0-9_]+)`$/.exec(cells[0].text) ?? [];
          const anchor = code === undefined || coded.has(code) ? "" : ` id="row-${code}"`;
          coded.add(code);
          return row(cells, "td").replace("<tr>", `<tr${anchor}>`);
        };
        const rows = token.rows.map(anchored).join("\n");
        return `<div class="wide" tabindex="0"><table><thead>${row(token.header, "th")}</thead><tbody>${rows}</tbody></table></div>`;
      },
      code({ text }) {
        return `<pre tabindex="0"><code>${escaped(text)}</code></pre>`;
      },
    },
  });
  const text = await readFile(join(root, source), "utf8");
  const html = await marked.parse(text);
  const headings = getHeadingList();
  return {
    source,
    html,
    links,
    title: headings[0]?.raw.replaceAll("`", "") ?? source,
    anchors: new Set(headings.map((h) => h.id)),
    sections: sections(html),
  };
}

const ENTITIES = { "&lt;": "<", "&gt;": ">", "&quot;": '"', "&#39;": "'", "&amp;": "&" };

/** The text of a page for the search: by heading, and the rows about a code once more by themselves. */
export function sections(html) {
  const plain = (part) =>
    part
      .replace(/<[^>]*>/g, " ")
      .replace(/&(lt|gt|quot|#39|amp);/g, (entity) => ENTITIES[entity])
      .replace(/\s+/g, " ")
      .trim();
  const parts = html.split(/<h[1-6] id="([^"]*)">/);
  const found = [];
  for (let i = 1; i < parts.length; i += 2) {
    found.push({ id: parts[i], text: plain(parts[i + 1]) });
    const rows = parts[i + 1].matchAll(/<tr id="([^"]*)">(.*?)<\/tr>/gs);
    for (const [, id, cells] of rows) found.push({ id, text: plain(cells) });
  }
  return found;
}

/** The index with the titles of its pages in place of their files' names. */
function titled(html, pages) {
  return html.replace(/<a href="([^"#]+)([^"]*)">[\w./-]+\.md<\/a>/g, (link, name, hash) => {
    const page = pages.find((other) => nameOf(other.source) === name);
    return page === undefined ? link : `<a href="${name}${hash}">${escaped(page.title)}</a>`;
  });
}

/** The navigation: the headings of the index, each with the pages of the table below it. */
function navigation(index, pages) {
  const groups = [];
  for (const part of index.html.split(/<h2 id="[^"]*">/).slice(1)) {
    const heading = part.slice(0, part.indexOf("</h2>")).split(":")[0];
    const names = [...part.matchAll(/<tr><td><a href="([^"#]+)[^"]*">/g)].map((m) => m[1]);
    const listed = [...new Set(names)].flatMap((name) => pages.filter((page) => nameOf(page.source) === name));
    groups.push({ heading, listed });
  }
  return groups;
}

function document(page, groups) {
  const name = nameOf(page.source);
  const item = (listed) => {
    const current = nameOf(listed.source) === name ? ' aria-current="page"' : "";
    return `<li><a href="${nameOf(listed.source)}"${current}>${escaped(listed.title)}</a></li>`;
  };
  const nav = groups.map((group) => `<h2>${group.heading}</h2><ul>${group.listed.map(item).join("")}</ul>`).join("");
  return `<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>${escaped(page.title)} - carved</title><link rel="icon" href="data:,"><link rel="stylesheet" href="docs.css"><script type="module" src="docs.js"></script></head>
<body>
<nav aria-label="documentation">
<p><a href="/">The instrument</a> <a href="index.html">All pages</a> <a href="/docs/api">HTTP contract</a></p>
<form role="search" hidden><label>Search <input type="search" autocomplete="off"></label><ol aria-live="polite"></ol></form>
${nav}
</nav>
<main>
${page.html}</main>
</body>
</html>
`;
}

/** Renders the index and every page that it leads to, from `root` into `outdir`: `FILE.gz` alone, to keep the program small. Returns the
 * number of pages. */
export async function docs(root, outdir) {
  const pages = [];
  const pictures = new Set();
  const waiting = [INDEX];
  const seen = new Set(waiting);
  while (waiting.length > 0) {
    const page = await read(root, waiting.shift());
    pages.push(page);
    for (const { to } of page.links) {
      if (!(await exists(join(root, to))))
        throw new Error(`${page.source}: a link leads to ${to}, which does not exist`);
      if (PICTURE.test(to)) pictures.add(to);
      else if (!seen.has(to)) {
        seen.add(to);
        waiting.push(to);
      }
    }
  }
  for (const page of pages) {
    for (const { to, hash } of page.links) {
      const there = pages.find((other) => other.source === to);
      if (hash && there && !there.anchors.has(hash)) throw new Error(`${page.source}: ${to} has no heading #${hash}`);
    }
  }
  pages[0].html = titled(pages[0].html, pages);
  pages[0].sections = sections(pages[0].html);
  const groups = navigation(pages[0], pages);
  await mkdir(outdir, { recursive: true });
  const pack = (name, text) => writeFile(join(outdir, `${name}.gz`), gzipSync(text, { level: 9 }));
  for (const page of pages) await pack(nameOf(page.source), document(page, groups));
  for (const picture of pictures)
    await copyFile(join(root, picture), join(outdir, picture.replace(/^docs\//, "").replaceAll("/", "-")));
  const index = pages.map((page) => ({ name: nameOf(page.source), title: page.title, sections: page.sections }));
  await pack("search.json", JSON.stringify(index));
  return pages.length;
}
