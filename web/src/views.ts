// The views of a stored specimen as a strip: each with the profile's distance from the model, and why a view does not count.
//
//   links ── thumbnails, a few at a time ──> img        model ── silhouette under the calibrated camera ──> canvas over it
//   click ──> the view in the frame panel

import type { BufferGeometry } from "three";
import { fetchFile, Refused } from "./api.ts";
import { bladderWords } from "./bladder.ts";
import { modelOutline } from "./develop.ts";
import { element, setText, show } from "./dom.ts";
import { organsOf } from "./ellipsoid.ts";
import { eyesWords } from "./eyes.ts";
import { counted, grouped, words } from "./format.ts";
import { cameraOfView, scaled } from "./projection.ts";
import type { Triangles } from "./silhouette.ts";
import type { Specimen, StoredViewRecord } from "./status.ts";
import { wellKey, type StoredModels, type StoredSpecimens, type StoredWell } from "./stored.ts";
import type { Subject } from "./subject.ts";

/** Width of a thumbnail in the picture's pixels: twice its width on the page, for displays with small pixels. */
const THUMBNAIL_PX = 320;
/** Requests for thumbnails at a time. The daemon reads the disk for four clients. */
const AT_A_TIME = 2;
/** The pictures are read when the strip is this far outside of the window. */
const NEARLY = "100px";

/** The number of a view in the link to its frame or mask; null for the frame that judged the well. Pure. */
export function viewNumber(link: string): number | null {
  const found = /\/(\d+)\.png(?:\?|$)/.exec(link);
  return found ? Number(found[1]) : null;
}

/** The picture of a frame to look at, in place of the raw frame. Pure. */
export function pictureOf(link: string, width?: number): string {
  const picture = link.replace(/\.png(?=\?|$)/, ".jpg");
  return width === undefined ? picture : `${picture}${picture.includes("?") ? "&" : "?"}width=${width}`;
}

export function trianglesOf(model: BufferGeometry): Triangles {
  const positions = model.getAttribute("position").array;
  return { positions, corners: model.getIndex()?.array ?? Array.from({ length: positions.length / 3 }, (_, i) => i) };
}

/** One line about a view: `residual 0.21 px`, or why it does not count. Pure. */
export function viewWords(record: StoredViewRecord | undefined): string {
  if (record === undefined) return "no numbers";
  if (!record.used) return `left out: ${record.reason == null ? "no reason given" : words(record.reason)}`;
  const residual = record.residual_px;
  return residual == null ? "counts" : `${grouped(residual, 2)} px`;
}

/** What the views say together. `taken`: the number of views, of which a well that was not measured has no records. Pure. */
export function stripWords(records: readonly StoredViewRecord[], taken = records.length): string {
  if (records.length === 0) return `${counted(taken, "view")}, not measured.`;
  const used = records.filter((v) => v.used);
  const out = records.length - used.length;
  const said = [`${counted(records.length, "view")}, ${out === 0 ? "all of them count" : `${out} left out`}.`];
  const residuals = used.flatMap((v) => (typeof v.residual_px === "number" ? [v] : []));
  const sorted = residuals.sort((a, b) => a.residual_px! - b.residual_px!);
  const worst = sorted.at(-1);
  if (worst) {
    const middle =
      (sorted[Math.floor((sorted.length - 1) / 2)]!.residual_px! +
        sorted[Math.floor(sorted.length / 2)]!.residual_px!) /
      2;
    said.push(
      `Distance of the outlines from what the other views make expected: ${grouped(middle, 2)} px (median), ` +
        `${grouped(worst.residual_px!, 2)} px in view ${worst.index + 1}.`,
    );
  }
  return said.join(" ");
}

interface Item {
  view: number;
  link: string;
  button: HTMLButtonElement;
  picture: HTMLImageElement;
  outline: HTMLImageElement;
}

export class ViewStrip {
  readonly #panel: HTMLElement;
  readonly #list: HTMLElement;
  readonly #words: HTMLElement;
  readonly #stored: StoredSpecimens;
  readonly #models: StoredModels;
  readonly #choose: (place: number) => void;
  #of = "";
  #items: Item[] = [];
  #shown: number | null = null;
  #urls: string[] = [];
  #watch: IntersectionObserver | null = null;

  /** `choose` is told the place of a view in the list of its specimen, from 1. */
  constructor(
    root: { panel: HTMLElement; list: HTMLElement; words: HTMLElement },
    stored: StoredSpecimens,
    models: StoredModels,
    choose: (place: number) => void,
  ) {
    this.#panel = root.panel;
    this.#list = root.list;
    this.#words = root.words;
    this.#stored = stored;
    this.#models = models;
    this.#choose = choose;
  }

  /** Shows the views of a stored well, filled once the frame in large is there. Those of another well disappear at once. */
  async update(subject: Subject, framed: Promise<void>): Promise<void> {
    const key = subject.kind === "stored" ? wellKey(subject) : "";
    if (key === this.#of) return;
    this.#of = key;
    this.#clear();
    if (subject.kind !== "stored") return;
    try {
      await framed;
      // Another well was chosen meanwhile.
      if (this.#of !== key) return;
      await this.#fill(subject, key);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      // The frame panel says what cannot be read. The next status repeats this.
      if (this.#of === key) this.#of = "";
    }
  }

  /** Marks the view that the frame panel shows. */
  mark(view: number | null): void {
    this.#shown = view;
    for (const item of this.#items) item.button.setAttribute("aria-pressed", String(item.view === view));
  }

  /** Resolves when the strip is in the window, or nearly. */
  #seen(): Promise<void> {
    return new Promise((resolve) => {
      this.#watch = new IntersectionObserver(
        ([entry]) => {
          if (!entry?.isIntersecting) return;
          this.#watch?.disconnect();
          resolve();
        },
        { rootMargin: NEARLY },
      );
      this.#watch.observe(this.#panel);
    });
  }

  #clear(): void {
    this.#watch?.disconnect();
    show(this.#panel, false);
    this.#list.replaceChildren();
    for (const url of this.#urls) URL.revokeObjectURL(url);
    this.#urls = [];
    this.#items = [];
  }

  async #fill(one: StoredWell, key: string): Promise<void> {
    const specimen = await this.#stored.of(one);
    if (this.#of !== key || !specimen) return;
    const links = specimen.links.views;
    if (links.length === 0) return;
    const records = new Map((specimen.measurement?.views ?? []).map((v) => [v.index, v]));
    const residuals = [...records.values()].map((v) => (v.used ? (v.residual_px ?? 0) : 0));
    const most = Math.max(...residuals, 1e-9);
    this.#items = links.map((link, place) => this.#item(link, place, records.get(viewNumber(link) ?? -1), most));
    this.#list.replaceChildren(...this.#items.map(({ button }) => element("li", "", button)));
    const { eyes, bladder } = specimen.measurement ?? {};
    const said = [stripWords([...records.values()], links.length), eyesWords(eyes), bladderWords(bladder)];
    setText(this.#words, said.filter((words) => words !== "").join(" "));
    show(this.#panel, true);
    this.mark(this.#shown);
    // Pictures of a strip that nobody looks at are not read.
    await this.#seen();
    const waiting = [...this.#items];
    const worker = async () => {
      for (let item = waiting.shift(); item && this.#of === key; item = waiting.shift())
        await this.#photograph(item, key);
    };
    await Promise.all([...Array.from({ length: AT_A_TIME }, worker), this.#outlines(one, specimen, key)]);
  }

  #item(link: string, place: number, record: StoredViewRecord | undefined, most: number): Item {
    const view = viewNumber(link) ?? -1;
    const [picture, outline] = [element("img", ""), element("img", "")];
    // The words of the button describe the view.
    picture.alt = outline.alt = "";
    picture.hidden = outline.hidden = true;
    const degrees = record ? ` · ${grouped((record.omega * 180) / Math.PI)}°` : "";
    const said = viewWords(record);
    const bar = element("span", "view-bar");
    if (record?.used && typeof record.residual_px === "number") {
      const fill = element("span", "");
      fill.style.width = `${Math.round((100 * record.residual_px) / most)}%`;
      bar.append(fill);
    }
    const button = element(
      "button",
      record && !record.used ? "view view-out" : "view",
      element("span", "view-picture", picture, outline),
      element("span", "view-words", element("b", "", `${view + 1}${degrees}`), element("span", "", said)),
      bar,
    );
    button.type = "button";
    button.dataset["view"] = String(view);
    button.title = record?.quality
      ? `View ${view + 1}: ${said}; error of the edge by noise ${grouped(record.quality.edge_error_px, 2)} px; ` +
        `contrast of the edge ${grouped(record.quality.edge_contrast_sigma, 1)} SD of the noise`
      : `View ${view + 1}: ${said}`;
    button.addEventListener("click", () => this.#choose(place + 1));
    return { view, link, button, picture, outline };
  }

  async #photograph(item: Item, key: string): Promise<void> {
    try {
      this.#put(item.picture, await fetchFile(pictureOf(item.link, THUMBNAIL_PX)), key);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      item.button.title = `The picture cannot be read: ${error.message}.`;
    }
  }

  /** Draws the outline of the model into each thumbnail, with a pause after each, so that the page stays usable on a slow machine. */
  async #outlines(one: StoredWell, specimen: Specimen, key: string): Promise<void> {
    const model = await this.#models.of(one);
    if (!model) return;
    const triangles = trianglesOf(model);
    const organs = organsOf(specimen.measurement);
    for (const item of this.#items) {
      const seen = cameraOfView(specimen.recording, specimen.measurement, item.view);
      if (this.#of !== key) return;
      if (seen === null) continue;
      const factor = Math.min(1, THUMBNAIL_PX / seen.width);
      const [width, height] = [seen.width, seen.height].map((px) => Math.round(px * factor)) as [number, number];
      this.#put(
        item.outline,
        await modelOutline(triangles, organs, scaled(seen.projection, factor), width, height),
        key,
      );
      await new Promise((resolve) => setTimeout(resolve));
    }
  }

  #put(image: HTMLImageElement, picture: Blob, key: string): void {
    if (this.#of !== key) return;
    const url = URL.createObjectURL(picture);
    this.#urls.push(url);
    image.src = url;
    image.hidden = false;
  }
}
