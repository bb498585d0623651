// The estimate of the volume over the number of views, with its band of one standard deviation, on a linear axis. The volume of the hull is
// an option: after a few views it is several times too large, and the estimate becomes a flat line beside it.

import { element, setText, svg } from "./dom.ts";
import { counted, grouped, nanolitres, UM3_PER_NL } from "./format.ts";
import type { Volumes } from "./history.ts";
import type { VolumeWait, WellStatus } from "./status.ts";
import { levelDigits, linearTicks, viewTicks } from "./ticks.ts";
import { NOT_YET } from "./wellcard.ts";
import { isBound } from "./wells.ts";

const MARGIN = { left: 62, right: 18, top: 14, bottom: 42 };

export interface Curve extends Volumes {
  well: string;
  viewsPlanned: number;
  hasEnded: boolean;
  /** Why there is no estimate yet of the specimen under way. */
  wait: VolumeWait | null;
  /** The reported volume, if the specimen is done. */
  measured: Reported | null;
}

interface Reported {
  volume_um3: number;
  /** `null` also where the volume is a bound: an interval around it would not contain the true one. */
  sd_um3: number | null;
  isBound: boolean;
}

/** The reported volume of a well, if it has one. Pure. */
export function reported(well: WellStatus): Reported | null {
  const bound = isBound(well);
  if (well.volume_um3 === null) return null;
  return { volume_um3: well.volume_um3, sd_um3: bound ? null : well.volume_sd_um3, isBound: bound };
}

/** `reported 243 ± 1 nL (± 1 SD)`, `reported at least 65 nL`. Pure. */
function reportedWords({ volume_um3, sd_um3, isBound: bound }: Reported): string {
  return `reported ${bound ? "at least " : ""}${nanolitres(volume_um3, sd_um3)}${sd_um3 === null ? "" : " (± 1 SD)"}`;
}

export class VolumeChart {
  readonly #box: HTMLElement;
  readonly #caption: HTMLElement;
  readonly #withHull: HTMLInputElement;
  #curve: Curve | null = null;
  #shown = "";

  constructor(box: HTMLElement, caption: HTMLElement, withHull: HTMLInputElement) {
    this.#box = box;
    this.#caption = caption;
    this.#withHull = withHull;
    withHull.addEventListener("change", () => this.#draw());
    new ResizeObserver(() => this.#draw()).observe(box);
  }

  update(curve: Curve | null): void {
    this.#curve = curve;
    this.#draw();
  }

  #draw(): void {
    const curve = this.#curve;
    const hasHull = this.#withHull.checked;
    const { clientWidth: width, clientHeight: height } = this.#box;
    // Not laid out yet: its size comes later.
    if (width <= MARGIN.left + MARGIN.right || height <= MARGIN.top + MARGIN.bottom) return;
    const now = JSON.stringify([curve, hasHull, width, height]);
    if (now === this.#shown) return;
    this.#shown = now;
    const isEmpty =
      !curve || (curve.estimates.length === 0 && !curve.measured && !(hasHull && curve.hulls_um3.length > 0));
    if (isEmpty) {
      this.#box.replaceChildren(element("p", "placeholder", nothing(curve)));
      setText(this.#caption, "");
      return;
    }
    this.#box.replaceChildren(picture(curve, hasHull, width, height));
    setText(this.#caption, caption(curve, hasHull));
  }
}

function nothing(curve: Curve | null): string {
  if (curve === null) return "There has been no run yet.";
  if (curve.hasEnded) return `No estimates of ${curve.well} are kept.`;
  return curve.wait === null ? "No estimate yet." : `Volume ${NOT_YET[curve.wait]}.`;
}

function caption({ well, estimates, hulls_um3: hulls, measured }: Curve, hasHull: boolean): string {
  const said = [];
  const last = estimates.at(-1);
  if (measured) said.push(reportedWords(measured));
  else if (last) {
    const sd = last.volume_sd_um3 ?? null;
    said.push(`${nanolitres(last.volume_um3, sd)}${sd === null ? "" : " (± 1 SD)"} of ${counted(last.views, "view")}`);
  }
  const hull = hulls.at(-1);
  if (hasHull && hull !== undefined) {
    said.push(`rough live volume ${nanolitres(hull)} after ${counted(hulls.length, "view")}, which is no estimate`);
  }
  // On a busy computer the turn may end before the first estimate is ready.
  const none = measured && estimates.length === 0 ? " No estimates were made during the turn." : "";
  return `${well}: ${said.join("; ")}.${none}`;
}

interface Point {
  view: number;
  nl: number;
  sd: number;
}

function picture(curve: Curve, hasHull: boolean, width: number, height: number): SVGElement {
  const point = (view: number, um3: number, sd_um3: number | null | undefined): Point => ({
    view,
    nl: um3 / UM3_PER_NL,
    sd: (sd_um3 ?? 0) / UM3_PER_NL,
  });
  const estimates = curve.estimates.map((e) => point(e.views, e.volume_um3, e.volume_sd_um3));
  const hulls = hasHull ? curve.hulls_um3.map((um3, i) => point(i + 1, um3, 0)) : [];
  const measured = curve.measured && point(0, curve.measured.volume_um3, curve.measured.sd_um3);
  const views = Math.max(curve.viewsPlanned, curve.hulls_um3.length, ...estimates.map((p) => p.view), 2);
  const all = [...estimates, ...hulls, ...(measured ? [measured] : [])];
  const levels = linearTicks(Math.min(...all.map((p) => p.nl - p.sd)), Math.max(...all.map((p) => p.nl + p.sd)));
  const [low, high] = [levels[0]!, levels.at(-1)!];
  const digits = levelDigits(levels);
  const right = width - MARGIN.right;
  const bottom = height - MARGIN.bottom;
  const x = (view: number) => MARGIN.left + ((view - 1) / (views - 1)) * (right - MARGIN.left);
  const y = (nl: number) => bottom - ((nl - low) / (high - low)) * (bottom - MARGIN.top);
  const label = `Estimated volume of ${curve.well}, ${counted(estimates.length, "estimate")} of up to ${counted(views, "view")}`;
  const chart = svg("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label });
  chart.dataset["points"] = String(estimates.length);
  chart.dataset["hulls"] = String(hulls.length);

  for (const level of levels) {
    chart.append(svg("line", { class: "grid", x1: MARGIN.left, x2: right, y1: y(level), y2: y(level) }));
    chart.append(
      svg("text", { class: "tick", x: MARGIN.left - 8, y: y(level) + 4, "text-anchor": "end" }, grouped(level, digits)),
    );
  }
  for (const view of viewTicks(views)) {
    chart.append(svg("line", { class: "axis", x1: x(view), x2: x(view), y1: bottom, y2: bottom + 5 }));
    chart.append(svg("text", { class: "tick", x: x(view), y: bottom + 18, "text-anchor": "middle" }, String(view)));
  }
  chart.append(svg("line", { class: "axis", x1: MARGIN.left, x2: right, y1: bottom, y2: bottom }));
  const middle = (MARGIN.top + bottom) / 2;
  const turned = `rotate(-90 14 ${middle})`;
  chart.append(
    svg("text", { class: "title", x: 14, y: middle, transform: turned, "text-anchor": "middle" }, "Volume, nL"),
  );
  chart.append(
    svg(
      "text",
      { class: "title", x: (MARGIN.left + right) / 2, y: height - 4, "text-anchor": "middle" },
      "Views taken",
    ),
  );

  if (measured !== null) {
    const [top, base] = [y(measured.nl + measured.sd), y(measured.nl - measured.sd)];
    const wide = right - MARGIN.left;
    chart.append(svg("rect", { class: "measured-band", x: MARGIN.left, y: top, width: wide, height: base - top }));
    chart.append(
      svg("line", { class: "measured", x1: MARGIN.left, x2: right, y1: y(measured.nl), y2: y(measured.nl) }),
    );
    chart.append(
      svg(
        "text",
        { class: "measured-label", x: right, y: y(measured.nl) - 8, "text-anchor": "end" },
        curve.measured?.isBound ? "at least" : "reported",
      ),
    );
  }
  const at = (p: Point, nl = p.nl) => `${x(p.view).toFixed(1)},${y(nl).toFixed(1)}`;
  const upper = estimates.map((p) => at(p, p.nl + p.sd));
  const lower = estimates.map((p) => at(p, p.nl - p.sd)).reverse();
  chart.append(svg("polygon", { class: "band", points: [...upper, ...lower].join(" ") }));
  if (hulls.length > 0) chart.append(svg("polyline", { class: "hull", points: hulls.map((p) => at(p)).join(" ") }));
  chart.append(svg("polyline", { class: "curve", points: estimates.map((p) => at(p)).join(" ") }));
  estimates.forEach((p, i) => {
    const newest = i === estimates.length - 1;
    const made = svg("circle", {
      class: newest ? "dot dot-newest" : "dot",
      cx: x(p.view),
      cy: y(p.nl),
      r: newest ? 5 : 3,
    });
    const words = `of ${counted(p.view, "view")}: ${nanolitres(p.nl * UM3_PER_NL, p.sd * UM3_PER_NL)}`;
    made.append(svg("title", {}, words));
    chart.append(made);
  });
  return chart;
}
