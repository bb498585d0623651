// The contact sheet of a plate: of each well the standard picture of its larva, from the left side or from above, head to the left. Where there
// is none, the frame of the view that is nearest to it. Pictures are read only for wells that are in the window, a few at a time.

import { fetchFile, fetchSpecimen, Refused } from "./api.ts";
import { element, show } from "./dom.ts";
import { nanolitres } from "./format.ts";
import type { RunStatus, Specimen, WellStatus } from "./status.ts";
import { runKey } from "./stored.ts";
import { isStored } from "./subject.ts";
import { pictureOf, viewNumber } from "./views.ts";
import { CONDITIONS, conditionOf, conditionWords, isBound } from "./wells.ts";

/** Width of a picture, px: twice that on the page. */
const PICTURE_PX = 480;
/** Requests at a time. The daemon reads the disk for four clients. */
const AT_A_TIME = 2;

/** What the sheet shows of each larva. */
export type Aspect = "lateral" | "dorsal";

/**
 * The place in a list of angles (rad) of the view from the side, back up, or from above. `dorsal` is the direction to the back; in a view at
 * `omega` the direction at `pi - omega` about the capillary points up, and that at `-pi / 2 - omega` to the camera. Pure.
 */
export function nearest(omegas: readonly number[], dorsal: readonly number[] | null, aspect: Aspect): number {
  if (dorsal === null || omegas.length === 0) return 0;
  const wanted = (aspect === "lateral" ? Math.PI : -Math.PI / 2) - Math.atan2(dorsal[2] ?? 0, dorsal[1] ?? 0);
  const off = omegas.map((omega) => 1 - Math.cos(omega - wanted));
  return off.indexOf(Math.min(...off));
}

type Pictured = Pick<Specimen, "links" | "measurement">;

/** The link to the standard picture of a larva; null where there is none. Pure. */
export function standardLink({ links }: Pick<Specimen, "links">, aspect: Aspect): string | null {
  return (aspect === "lateral" ? links.lateral_png : links.dorsal_png) ?? null;
}

/** The link to the frame of a well nearest to that picture; null where none is kept. Pure. */
export function frameLink({ links, measurement }: Pictured, aspect: Aspect): string | null {
  const views = measurement?.views.filter((view) => view.used) ?? [];
  const direction = measurement?.shape?.body?.dorsal.direction ?? null;
  const omegas = views.map((view) => view.omega);
  const number = views[nearest(omegas, direction, aspect)]?.index ?? 0;
  const link = links.views.find((link) => viewNumber(link) === number) ?? links.views[0] ?? links.detection ?? null;
  return link === null ? null : pictureOf(link, PICTURE_PX);
}

/** Less of it, and a larva has no standard pictures. */
const LEAST_CONFIDENCE = 0.1;

/** How sure it is that a picture shows what it should, or why there is no such picture. Pure. */
export function sureness(specimen: Pictured, aspect: Aspect): string {
  const facing = specimen.measurement?.facing;
  const confidence = facing ? Math.min(facing.confidence, facing.head_confidence) : 0;
  if (standardLink(specimen, aspect) !== null)
    return `Head and back were found with confidence ${confidence.toFixed(2)} of 1.`;
  const why =
    specimen.measurement === null
      ? "there are no numbers"
      : confidence < LEAST_CONFIDENCE
        ? "head or back are not decided"
        : "the run has no standard pictures; carved export pictures makes them";
  return `A frame as it was taken: ${why}.`;
}

interface Cell {
  well: string;
  item: HTMLElement;
  picture: HTMLImageElement;
  words: HTMLElement;
  /** Whether its picture was asked for. */
  isAsked: boolean;
}

export class ContactSheet {
  readonly #panel: HTMLDetailsElement;
  readonly #list: HTMLElement;
  readonly #aspect: HTMLSelectElement;
  readonly #choose: (well: string) => void;
  #run: RunStatus | null = null;
  #of = "";
  #cells = new Map<string, Cell>();
  #urls: string[] = [];
  #watch: IntersectionObserver | null = null;
  #waiting: Cell[] = [];
  #workers = 0;

  constructor(panel: HTMLDetailsElement, list: HTMLElement, aspect: HTMLSelectElement, choose: (well: string) => void) {
    this.#panel = panel;
    this.#list = list;
    this.#aspect = aspect;
    this.#choose = choose;
    panel.addEventListener("toggle", () => this.#fill());
    aspect.addEventListener("change", () => this.#fill());
  }

  update(run: RunStatus | null): void {
    this.#run = run;
    show(this.#panel, run?.results.some((well) => well.outcome !== null) === true);
    this.#fill();
  }

  #fill(): void {
    const run = this.#run;
    if (!this.#panel.open || run === null) return;
    const of = `${this.#aspect.value} ${runKey(run)}`;
    if (of !== this.#of) this.#clear(of);
    for (const well of run.results) {
      const known = this.#cells.get(well.well);
      // A well that is measured again has another picture.
      if (well.outcome === null) known?.item.remove();
      if (well.outcome === null) this.#cells.delete(well.well);
      else this.#say(known ?? this.#add(well.well), well);
    }
  }

  #clear(of: string): void {
    this.#of = of;
    this.#watch?.disconnect();
    for (const url of this.#urls) URL.revokeObjectURL(url);
    this.#urls = [];
    this.#waiting = [];
    this.#cells.clear();
    this.#list.replaceChildren();
    this.#watch = new IntersectionObserver(
      (seen) => {
        for (const { isIntersecting, target } of seen) {
          const cell = this.#cells.get((target as HTMLElement).dataset["well"] ?? "");
          if (isIntersecting && cell !== undefined) this.#want(cell);
        }
      },
      { rootMargin: "200px" },
    );
  }

  #add(well: string): Cell {
    const picture = element("img", "");
    picture.alt = "";
    picture.hidden = true;
    const words = element("span", "sheet-words");
    const button = element("button", "sheet-well", element("span", "sheet-picture", picture), words);
    button.type = "button";
    button.addEventListener("click", () => this.#choose(well));
    const item = element("li", "", button);
    item.dataset["well"] = well;
    this.#list.append(item);
    const cell = { well, item, picture, words, isAsked: false };
    this.#cells.set(well, cell);
    this.#watch?.observe(item);
    return cell;
  }

  #say({ item, words }: Cell, well: WellStatus): void {
    const condition = conditionOf(well, null);
    const { sign } = CONDITIONS[condition];
    const volume = well.volume_um3 === null ? conditionWords(well, condition) : nanolitres(well.volume_um3);
    const text = `${sign} ${well.well} ${isBound(well) && well.volume_um3 !== null ? "≥ " : ""}${volume}`.trim();
    if (words.textContent !== text) words.textContent = text;
    item.dataset["condition"] = condition;
  }

  #want(cell: Cell): void {
    if (cell.isAsked) return;
    cell.isAsked = true;
    this.#waiting.push(cell);
    if (this.#workers < AT_A_TIME) void this.#work(this.#of);
  }

  async #work(of: string): Promise<void> {
    this.#workers += 1;
    try {
      for (let cell = this.#waiting.shift(); cell !== undefined && this.#of === of; cell = this.#waiting.shift())
        await this.#photograph(cell, of);
    } finally {
      this.#workers -= 1;
    }
  }

  async #photograph(cell: Cell, of: string): Promise<void> {
    try {
      const well = this.#run?.results.find((well) => well.well === cell.well);
      if (well === undefined || !isStored(well)) return;
      const specimen = this.#run && (await fetchSpecimen(this.#run.id, cell.well));
      if (!specimen) return;
      const aspect = this.#aspect.value === "dorsal" ? "dorsal" : "lateral";
      const standard = standardLink(specimen, aspect);
      const link = standard ?? frameLink(specimen, aspect);
      if (link === null) return;
      const picture = await fetchFile(link);
      if (this.#of !== of) return;
      cell.picture.classList.toggle("standard", standard !== null);
      cell.item.title = sureness(specimen, aspect);
      const url = URL.createObjectURL(picture);
      this.#urls.push(url);
      cell.picture.src = url;
      cell.picture.hidden = false;
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      cell.item.title = `The picture cannot be read: ${error.message}.`;
    }
  }
}
