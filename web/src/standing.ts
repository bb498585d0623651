// Where volume and area of a larva are among reference larvae: a normal curve with the references' mean and standard deviation, and a line
// at the larva. The sentences are in the card of the well.

import { element, show, svg } from "./dom.ts";
import { grouped, significant, UM3_PER_NL } from "./format.ts";
import type { Measured, StoredPlace, WellStatus } from "./status.ts";

const [WIDTH, HEIGHT] = [340, 132];
const BASE = 100;
const TOP = 22;
/** The curve is drawn to this distance from the mean, SD. */
const FAR_SD = 3.2;

/** A number among references, in the unit in which it is shown. */
export interface Standing extends Pick<StoredPlace, "group" | "n" | "mean" | "sd" | "z" | "percentile"> {
  quantity: "Volume" | "Area";
  unit: string;
  /** The estimator of this number, where the reported one has no references. */
  by: string | null;
}

/** What an estimator measures. */
const ESTIMATORS: Record<string, string> = { voxel: "the voxels", field: "the surface", support: "the outlines" };

/** The numbers of a larva that have references, by the estimator of its reported numbers if that has some. Pure. */
export function standingsOf(measured: Measured | null, estimator: WellStatus["estimator"]): Standing[] {
  const estimates = measured?.reference?.estimates ?? [];
  const first = [...estimates].sort((a, b) => Number(b.estimator === estimator) - Number(a.estimator === estimator));
  const of = (quantity: "volume" | "area", name: Standing["quantity"], unit: string, size: number): Standing[] => {
    const [found] = first.flatMap((e) => {
      const answer = e[quantity];
      return "known" in answer ? [{ estimator: e.estimator, ...answer.known }] : [];
    });
    if (found === undefined) return [];
    const by = found.estimator === estimator ? null : found.estimator;
    return [{ ...found, mean: found.mean / size, sd: found.sd / size, quantity: name, unit, by }];
  };
  return [...of("volume", "Volume", "nL", UM3_PER_NL), ...of("area", "Area", "mm²", 1e6)];
}

/** `Volume 243.1 nL: 0.8 SD above the mean of 12 larvae, larger than 79 % of them`. Pure. */
export function standingWords({ quantity, unit, mean, sd, z, n, percentile, group, by }: Standing): string {
  const side = z < 0 ? "below" : "above";
  const share = percentile > 99 ? "More than 99" : percentile < 1 ? "Less than 1" : grouped(percentile);
  // Another number than the reported one says why it is another.
  const how = by === null ? "" : ` by ${ESTIMATORS[by] ?? by}, as the references were measured`;
  return `${quantity} ${significant(mean + z * sd)} ${unit}${how}: ${grouped(Math.abs(z), 1)} SD ${side} the mean of ${n} larvae (${group}). ${share} % of such larvae are smaller.`;
}

export class StandingView {
  readonly #box: HTMLElement;
  #shown = "";

  constructor(box: HTMLElement) {
    this.#box = box;
  }

  update(standings: readonly Standing[]): void {
    show(this.#box, standings.length > 0);
    const now = JSON.stringify(standings);
    if (now === this.#shown) return;
    this.#shown = now;
    this.#box.replaceChildren(
      ...standings.map((s) =>
        element("figure", "standing", curve(s), element("figcaption", "caption", standingWords(s))),
      ),
    );
  }
}

function curve(s: Standing): SVGElement {
  const far = Math.max(FAR_SD, Math.abs(s.z) + 0.5);
  const x = (z: number) => 10 + ((z + far) / (2 * far)) * (WIDTH - 20);
  const y = (z: number) => BASE - Math.exp((-z * z) / 2) * (BASE - TOP);
  const label = `${s.quantity} among references: ${grouped(s.z, 1)} standard deviations from the mean`;
  const chart = svg("svg", {
    viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
    role: "img",
    "aria-label": label,
    class: "standing-curve",
  });
  chart.dataset["z"] = s.z.toFixed(3);
  const steps = Array.from({ length: 81 }, (_, i) => -FAR_SD + (2 * FAR_SD * i) / 80);
  const area = (most: number) => {
    const within = steps.filter((z) => Math.abs(z) <= most + 1e-9);
    const points = within.map((z) => `${x(z).toFixed(1)},${y(z).toFixed(1)}`);
    return [`${x(within[0]!).toFixed(1)},${BASE}`, ...points, `${x(within.at(-1)!).toFixed(1)},${BASE}`].join(" ");
  };
  chart.append(svg("polygon", { class: "standing-all", points: area(FAR_SD) }));
  chart.append(svg("polygon", { class: "standing-middle", points: area(1) }));
  chart.append(svg("line", { class: "axis", x1: 10, x2: WIDTH - 10, y1: BASE, y2: BASE }));
  for (const z of [-2, -1, 0, 1, 2]) {
    chart.append(svg("line", { class: "axis", x1: x(z), x2: x(z), y1: BASE, y2: BASE + 4 }));
    const value = significant(s.mean + z * s.sd, 3);
    // Neighbouring labels would overlap where the larva is far out.
    if (far < 5 || z % 2 === 0) {
      chart.append(svg("text", { class: "tick", x: x(z), y: BASE + 17, "text-anchor": "middle" }, value));
    }
  }
  chart.append(
    svg("text", { class: "title", x: WIDTH / 2, y: HEIGHT - 2, "text-anchor": "middle" }, `${s.quantity}, ${s.unit}`),
  );
  chart.append(svg("line", { class: "standing-own", x1: x(s.z), x2: x(s.z), y1: TOP - 4, y2: BASE }));
  const anchor = s.z > 0.6 * far ? "end" : s.z < -0.6 * far ? "start" : "middle";
  chart.append(svg("text", { class: "standing-label", x: x(s.z), y: TOP - 9, "text-anchor": anchor }, "this larva"));
  return chart;
}
