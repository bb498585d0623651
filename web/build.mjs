// Bundles the page into dist/ (three files that the daemon embeds), or with --tests the tests into build/.

import { build } from "esbuild";
import { copyFile, mkdir, readdir, rm, stat } from "node:fs/promises";
import { join } from "node:path";

/** Small and without a trace of the machine it was built on: the same sources give the same bytes. */
async function page() {
  await rm("dist", { recursive: true, force: true });
  await mkdir("dist", { recursive: true });
  await build({
    entryPoints: { app: "src/main.ts" },
    outdir: "dist",
    bundle: true,
    minify: true,
    format: "esm",
    target: ["chrome109", "firefox115", "safari16.4"],
    legalComments: "eof",
    logLevel: "warning",
  });
  await build({
    entryPoints: { app: "src/app.css" },
    outdir: "dist",
    bundle: true,
    minify: true,
    target: ["chrome109", "firefox115", "safari16.4"],
    logLevel: "warning",
  });
  await copyFile("src/index.html", "dist/index.html");
  for (const name of await readdir("dist")) {
    const { size } = await stat(join("dist", name));
    console.log(`web/dist/${name}  ${(size / 1024).toFixed(1)} KiB`);
  }
}

/** Node 18 does not strip types by itself, so the tests are bundled as well; packages stay outside. */
async function tests() {
  await rm("build", { recursive: true, force: true });
  const found = [];
  for (const kind of ["unit", "browser"]) {
    for (const name of await readdir(join("test", kind))) {
      if (name.endsWith(".test.ts")) found.push(join("test", kind, name));
    }
  }
  await build({
    entryPoints: found,
    outbase: ".",
    outdir: "build",
    outExtension: { ".js": ".mjs" },
    bundle: true,
    platform: "node",
    format: "esm",
    target: "node18",
    packages: "external",
    sourcemap: "inline",
    logLevel: "warning",
  });
}

await (process.argv.includes("--tests") ? tests() : page());
