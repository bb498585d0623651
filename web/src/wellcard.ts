// The numbers of one well.

import { element, fact } from "./dom.ts";
import {
  capitalised,
  counted,
  cubicMicrometres,
  micrometres,
  nanolitres,
  significant,
  squareMicrometres,
  squareMillimetres,
} from "./format.ts";
import { flagWords, reasonWords } from "./reasons.ts";
import { PHASES } from "./plain.ts";
import type { PlannedWell, SpecimenStatus, VolumeWait, WellNote, WellStatus } from "./status.ts";
import { treatmentWords } from "./treatment.ts";
import { CONDITIONS, conditionOf, conditionWords, contents, isBound, places, type Condition } from "./wells.ts";

export class WellCard {
  readonly #heading: HTMLElement;
  readonly #body: HTMLElement;
  #shown = "";

  constructor(heading: HTMLElement, body: HTMLElement) {
    this.#heading = heading;
    this.#body = body;
  }

  /** `hull_um3`: the volume of the live hull after the last view. `planned`: the well in the plan, once that is read. */
  update(
    well: WellStatus | null,
    specimen: SpecimenStatus | null,
    wells: readonly WellStatus[],
    hull_um3: number | null,
    planned: PlannedWell | undefined,
  ): void {
    const own = specimen?.well === well?.well ? specimen : null;
    const condition = well && conditionOf(well, specimen, wells);
    const now = JSON.stringify([
      well,
      condition,
      own?.phase,
      own?.view,
      own?.views_planned,
      own?.volume_um3,
      own?.volume_sd_um3,
      own?.volume_views,
      own?.converged,
      own?.volume_wait,
      hull_um3,
      planned,
    ]);
    if (now === this.#shown) return;
    this.#shown = now;
    if (!well || !condition) {
      this.#heading.textContent = "Well";
      this.#body.replaceChildren(element("p", "quiet", "No run yet: the plate map comes with it."));
      return;
    }
    this.#heading.textContent = `Well ${well.well}`;
    const list = element("dl", "facts", ...facts(well, own, condition, hull_um3, planned));
    list.dataset["well"] = well.well;
    this.#body.replaceChildren(list);
  }
}

/** A person's remark in words: `Left out of statistics by Kim: two larvae. Tags: twin.` Pure. */
export function noteWords({ by, excluded, comment, tags }: WellNote): string {
  const what = excluded ? `Left out of statistics by ${by}` : by;
  const tagged = tags.length === 0 ? "" : ` Tags: ${tags.join(", ")}.`;
  return `${what}${comment === "" ? "" : `: ${comment.replace(/\.$/, "")}`}.${tagged}`;
}

/** Letters of a remark from which on it is scrolled. */
const LONG = 300;

function remark(note: WellNote): HTMLElement {
  const made = element("div", "remark-said", noteWords(note));
  if (note.comment.length > LONG) made.tabIndex = 0;
  return made;
}

function facts(
  well: WellStatus,
  specimen: SpecimenStatus | null,
  condition: Condition,
  hull_um3: number | null,
  planned: PlannedWell | undefined,
): HTMLElement[] {
  const treatment = planned === undefined ? "" : treatmentWords(planned);
  const rows = [
    ...fact("Specimen", capitalised(contents(well))),
    ...(treatment === "" ? [] : fact("Treatment", treatment)),
    ...fact("Outcome", outcome(well, specimen, condition)),
  ];
  if (well.reason !== null) rows.push(...fact("Reason", capitalised(reasonWords(well.reason))));
  if (well.flags.length > 0) {
    rows.push(...fact("Flags", ...well.flags.map(flagLink)));
  }
  if (well.note !== null) rows.push(...fact("Remark", remark(well.note)));
  const volume = well.volume_um3;
  // An interval around a bound would not contain the true volume.
  const bound = isBound(well);
  const atLeast = bound ? "At least " : "";
  if (volume !== null) {
    const sd = bound ? null : well.volume_sd_um3;
    const shown = number("volume", atLeast + nanolitres(volume, sd), cubicMicrometres(volume));
    rows.push(...fact(sd === null ? "Volume" : "Volume ± 1 SD", shown));
  } else if (well.outcome === null && specimen && specimen.view > 0) {
    rows.push(...fact("Volume so far", volumeSoFar(specimen)));
  }
  if (well.area_um2 !== null) {
    const sd = bound ? null : well.area_sd_um2;
    const shown = number("area", atLeast + squareMillimetres(well.area_um2, sd), squareMicrometres(well.area_um2));
    rows.push(...fact(sd === null ? "Area" : "Area ± 1 SD", shown));
  }
  if (well.diameter_um !== null) rows.push(...fact("Diameter", number("diameter", micrometres(well.diameter_um, 1))));
  if (well.signal_per_nl !== null) {
    const shown = number("signal", `${significant(well.signal_per_nl)} per nL`, "grey levels × px, second camera");
    rows.push(...fact("Fluorescence", shown));
  }
  const among = places(well);
  if (among.length > 0) rows.push(...fact("Among its age", ...among.map(place)));
  if (volume !== null) {
    const others = otherNumbers(well, hull_um3);
    if (others.length > 0) {
      const summary = element("summary", "", "Other volumes, and why they differ");
      rows.push(...fact("Details", element("details", "other-volumes", summary, ...others)));
    }
  }
  return rows;
}

/** Numbers that are not reported, each with a sentence that says what it is. */
function otherNumbers(well: WellStatus, hull_um3: number | null): HTMLElement[] {
  const { field_volume_um3: volume, field_area_um2: area } = well;
  const shown: HTMLElement[] = [];
  if (volume !== null) {
    const what = "The surface that is drawn holds this much. Gaps that no view looks into are filled.";
    shown.push(small("field-volume", nanolitres(volume), cubicMicrometres(volume), what));
  }
  if (area !== null) {
    shown.push(small("field-area", squareMillimetres(area), squareMicrometres(area), "The area of that surface."));
  }
  if (hull_um3 !== null) {
    const what = "The rough live volume after the last view: the largest body that fits the outlines, made of voxels.";
    shown.push(small("hull-volume", nanolitres(hull_um3), cubicMicrometres(hull_um3), what));
  }
  return shown;
}

function small(name: string, text: string, exact: string, what: string): HTMLElement {
  const made = element("span", "exact", `${text} (${exact}). ${what}`);
  made.dataset["number"] = name;
  return made;
}

/** Why there is no estimate of the volume. */
export const NOT_YET: Record<VolumeWait, string> = {
  views: "not known yet: it takes views from more sides",
  computing: "not known yet: computing",
  slices: "known once the turn is measured: the slices so far do not determine it",
};

// The estimate, not the hull, which is too large after few views.
function volumeSoFar(specimen: SpecimenStatus): HTMLElement {
  const { volume_um3, volume_sd_um3, volume_views, volume_wait, converged } = specimen;
  if (volume_um3 === null) return element("span", "quiet", NOT_YET[volume_wait ?? "computing"]);
  const views = volume_views === null ? "" : `, of ${counted(volume_views, "view")}`;
  const settled = converged === true ? ", settled" : "";
  return number("volume-live", nanolitres(volume_um3, volume_sd_um3), cubicMicrometres(volume_um3) + views + settled);
}

function place({ text, doubts }: { text: string; doubts: string }): HTMLElement {
  const made = element("span", "place", text);
  if (doubts !== "") made.append(element("span", "exact", doubts));
  return made;
}

function outcome(well: WellStatus, specimen: SpecimenStatus | null, condition: Condition): Node {
  const { sign } = CONDITIONS[condition];
  const mark = element("span", `well well-${condition}`, sign);
  mark.setAttribute("aria-hidden", "true");
  const text = condition === "active" && specimen ? PHASES[specimen.phase] : conditionWords(well, condition);
  const made = element("span", "outcome", mark, capitalised(text));
  made.dataset["outcome"] = well.outcome ?? "";
  return made;
}

/** A flag in words, as a link to its help. */
function flagLink(flag: string): HTMLElement {
  const made = element("a", "flag", capitalised(flagWords(flag)));
  made.href = `/docs/quality.html#row-${flag}`;
  made.target = "_blank";
  return made;
}

function number(name: string, large: string, exact?: string): HTMLElement {
  const made = element("span", "number", element("b", "", large));
  made.dataset["number"] = name;
  if (exact !== undefined) made.append(element("span", "exact", exact));
  return made;
}
