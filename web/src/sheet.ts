// The contact sheet of a plate: of each well the view that shows its larva from the side, back up where that is known. Pictures are read only
// for wells that are in the window, a few at a time.

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

/**
 * The place in a list of angles (rad) of the view from the side. `dorsal` is the direction to the back; in a view at `omega` the direction
 * at `pi - omega` about the capillary points up. Pure.
 */
export function lateral(omegas: readonly number[], dorsal: readonly number[] | null): number {
  if (dorsal === null || omegas.length === 0) return 0;
  const wanted = Math.PI - Math.atan2(dorsal[2] ?? 0, dorsal[1] ?? 0);
  const off = omegas.map((omega) => 1 - Math.cos(omega - wanted));
  return off.indexOf(Math.min(...off));
}

/** The link to the picture of a well from the side; null where none is kept. Pure. */
export function lateralLink({ links, measurement }: Pick<Specimen, "links" | "measurement">): string | null {
  const views = measurement?.views.filter((view) => view.used) ?? [];
  const direction = measurement?.shape?.body?.dorsal.direction ?? null;
  const number =
    views[
      lateral(
        views.map((view) => view.omega),
        direction,
      )
    ]?.index ?? 0;
  const link = links.views.find((link) => viewNumber(link) === number) ?? links.views[0] ?? links.detection ?? null;
  return link === null ? null : pictureOf(link, PICTURE_PX);
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
  readonly #choose: (well: string) => void;
  #run: RunStatus | null = null;
  #of = "";
  #cells = new Map<string, Cell>();
  #urls: string[] = [];
  #watch: IntersectionObserver | null = null;
  #waiting: Cell[] = [];
  #workers = 0;

  constructor(panel: HTMLDetailsElement, list: HTMLElement, choose: (well: string) => void) {
    this.#panel = panel;
    this.#list = list;
    this.#choose = choose;
    panel.addEventListener("toggle", () => this.#fill());
  }

  update(run: RunStatus | null): void {
    this.#run = run;
    show(this.#panel, run?.results.some((well) => well.outcome !== null) === true);
    this.#fill();
  }

  #fill(): void {
    const run = this.#run;
    if (!this.#panel.open || run === null) return;
    if (runKey(run) !== this.#of) this.#clear(runKey(run));
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
      const link = specimen && lateralLink(specimen);
      if (!link) return;
      const picture = await fetchFile(link);
      if (this.#of !== of) return;
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
