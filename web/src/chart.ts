// Live volume after each view, as a line over the number of views.
//
// The axis is logarithmic: after the first view nearly the whole box is left, and the last views differ by parts in a thousand.

import { element, setText, svg } from "./dom.ts";
import { counted, nanolitres, percentChange, significant, UM3_PER_NL } from "./format.ts";
import { logTicks, viewTicks } from "./ticks.ts";

const MARGIN = { left: 62, right: 18, top: 14, bottom: 42 };

/** A thousandth of the volume of the smallest bead in use. */
const SMALLEST_NL = 1e-4;

export interface Curve {
  well: string;
  volumes_um3: readonly number[];
  viewsPlanned: number;
  hasEnded: boolean;
  /** The measured volume, if the specimen is done. */
  measured_um3: number | null;
}

export class VolumeChart {
  readonly #box: HTMLElement;
  readonly #caption: HTMLElement;
  #curve: Curve | null = null;
  #shown = "";

  constructor(box: HTMLElement, caption: HTMLElement) {
    this.#box = box;
    this.#caption = caption;
    new ResizeObserver(() => this.#draw()).observe(box);
  }

  update(curve: Curve | null): void {
    this.#curve = curve;
    this.#draw();
  }

  #draw(): void {
    const curve = this.#curve;
    const { clientWidth: width, clientHeight: height } = this.#box;
    const now = JSON.stringify([curve, width, height]);
    if (now === this.#shown) return;
    this.#shown = now;
    if (!curve || curve.volumes_um3.length === 0) {
      const words = curve?.hasEnded
        ? `No volumes of ${curve.well} are kept.`
        : "No volume yet: it comes with the first view.";
      this.#box.replaceChildren(element("p", "placeholder", words));
      setText(this.#caption, "");
      return;
    }
    this.#box.replaceChildren(picture(curve, width, height));
    setText(this.#caption, caption(curve));
  }
}

function caption(curve: Curve): string {
  const volumes = curve.volumes_um3;
  const last = volumes.at(-1)!;
  const before = volumes.at(-2);
  const change = before ? `; the last view changed it by ${percentChange(before, last)}` : "";
  const measured = curve.measured_um3 === null ? "" : `; measured ${nanolitres(curve.measured_um3)}`;
  return `${curve.well}: ${nanolitres(last)} after ${counted(volumes.length, "view")}${change}${measured}.`;
}

function picture(curve: Curve, width: number, height: number): SVGElement {
  // An empty hull has no position on a logarithmic axis, so it is drawn at the bottom.
  const values = curve.volumes_um3.map((v) => Math.max(v / UM3_PER_NL, SMALLEST_NL));
  const measured = curve.measured_um3 === null ? null : curve.measured_um3 / UM3_PER_NL;
  const views = Math.max(curve.viewsPlanned, values.length, 2);
  const all = measured === null ? values : [...values, measured];
  const levels = logTicks(Math.min(...all), Math.max(...all));
  const [low, high] = [Math.log(levels[0]!), Math.log(levels.at(-1)!)];
  const right = width - MARGIN.right;
  const bottom = height - MARGIN.bottom;
  const x = (view: number) => MARGIN.left + ((view - 1) / (views - 1)) * (right - MARGIN.left);
  const y = (nl: number) => bottom - ((Math.log(nl) - low) / (high - low)) * (bottom - MARGIN.top);
  const label = `Volume of the live model of ${curve.well} after each of ${counted(values.length, "view")}`;
  const chart = svg("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label });
  chart.dataset["points"] = String(values.length);

  for (const level of levels) {
    chart.append(svg("line", { class: "grid", x1: MARGIN.left, x2: right, y1: y(level), y2: y(level) }));
    chart.append(
      svg("text", { class: "tick", x: MARGIN.left - 8, y: y(level) + 4, "text-anchor": "end" }, significant(level, 3)),
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
    svg(
      "text",
      { class: "title", x: 14, y: middle, transform: turned, "text-anchor": "middle" },
      "Volume, nL (log scale)",
    ),
  );
  chart.append(
    svg(
      "text",
      { class: "title", x: (MARGIN.left + right) / 2, y: height - 4, "text-anchor": "middle" },
      "Views taken",
    ),
  );

  if (measured !== null) {
    chart.append(svg("line", { class: "measured", x1: MARGIN.left, x2: right, y1: y(measured), y2: y(measured) }));
    chart.append(
      svg("text", { class: "measured-label", x: right, y: y(measured) - 8, "text-anchor": "end" }, "measured"),
    );
  }
  const points = values.map((v, i) => `${x(i + 1).toFixed(1)},${y(v).toFixed(1)}`);
  chart.append(svg("polyline", { class: "curve", points: points.join(" ") }));
  values.forEach((v, i) => {
    const newest = i === values.length - 1;
    const dot = svg("circle", { class: newest ? "dot dot-newest" : "dot", cx: x(i + 1), cy: y(v), r: newest ? 5 : 3 });
    dot.append(svg("title", {}, `after view ${i + 1}: ${nanolitres(v * UM3_PER_NL)}`));
    chart.append(dot);
  });
  return chart;
}
