// Links to files. On an instrument with a token a link alone would be refused, so the file is read with the token and then offered.

import { fetchFile, Refused } from "./api.ts";
import { element, show } from "./dom.ts";
import type { Specimen } from "./status.ts";
import { authorization } from "./token.ts";
import { viewNumber } from "./views.ts";

/** Offers a file as a download. */
export function save(file: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** Offers the table of a run for a spreadsheet, in a file named after the run. */
export async function saveTable(run: string): Promise<void> {
  save(await fetchFile(`/v1/runs/${encodeURIComponent(run)}/table.csv?spreadsheet=true`), `${run}.csv`);
}

/** What else of a run is saved as a file: its report, its shapes, and its statistics for a spreadsheet. */
type OfRun = "report.html" | "shape.csv" | "groups.csv?spreadsheet=true";

/** Offers it in a file named after the run. */
export async function saveOfRun(run: string, what: OfRun): Promise<void> {
  save(await fetchFile(`/v1/runs/${encodeURIComponent(run)}/${what}`), `${run}-${what.split("?")[0]}`);
}

/** A link that offers a file under a name. */
export function downloadLink(href: string, name: string, words: string): HTMLAnchorElement {
  const link = element("a", "", words);
  link.href = href;
  link.download = name;
  link.addEventListener("click", (event) => {
    if (Object.keys(authorization()).length === 0) return;
    event.preventDefault();
    void (async () => {
      try {
        save(await fetchFile(href), name);
      } catch (error) {
        if (!(error instanceof Refused)) throw error;
        link.title = `${name} cannot be read: ${error.message}.`;
        link.after(element("span", "quiet", ` ${link.title}`));
      }
    })();
  });
  return link;
}

/** The files of a stored well, and the raw frame of the view on screen. */
export class WellFiles {
  readonly #box: HTMLElement;
  #specimen: Specimen | null = null;
  #view: number | null = null;

  constructor(box: HTMLElement) {
    this.#box = box;
  }

  update(specimen: Specimen | null): void {
    if (specimen === this.#specimen) return;
    this.#specimen = specimen;
    this.#draw();
  }

  /** The number of the view on screen. */
  mark(view: number | null): void {
    if (view === this.#view) return;
    this.#view = view;
    this.#draw();
  }

  #draw(): void {
    const specimen = this.#specimen;
    show(this.#box, specimen !== null);
    if (specimen === null) return;
    const { run, well, links } = specimen;
    const of = `${run}-${well}`;
    const raw = links.views.find((link) => viewNumber(link) === this.#view);
    const files: [string | null | undefined, string, string][] = [
      [links.mesh_ply, `${of}.ply`, "Surface (PLY)"],
      [links.mesh_glb, `${of}.glb`, "Model (GLB)"],
      [links.coloured_glb, `${of}-coloured.glb`, "Model with the colours of the frames (GLB)"],
      [links.lateral_png, `${of}-lateral.png`, "Left side (PNG)"],
      [links.lateral_tif, `${of}-lateral.tif`, "Left side (TIFF)"],
      [links.dorsal_png, `${of}-dorsal.png`, "Back (PNG)"],
      [links.dorsal_tif, `${of}-dorsal.tif`, "Back (TIFF)"],
      [`/v1/runs/${encodeURIComponent(run)}/specimens/${well}`, `${of}.json`, "Record and numbers (JSON)"],
      [raw, `${of}-view-${this.#view}.png`, `Raw frame of view ${(this.#view ?? 0) + 1} (PNG)`],
    ];
    this.#box.replaceChildren(
      ...files.flatMap(([link, name, words]) => (link ? [downloadLink(link, name, words)] : [])),
    );
  }
}
