// Round numbers for axes and scale bars. Pure.

/** The largest of 1, 2 or 5 times a power of ten that is not above `value`. */
export function roundBelow(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  // A hair of tolerance: 0.3 / 0.1 is 2.999...
  const lead = value / power + 1e-9;
  return (lead >= 5 ? 5 : lead >= 2 ? 2 : 1) * power;
}

/** Round levels from 0 to the first at or above `highest`, about `count` of them. */
export function niceTicks(highest: number, count: number): number[] {
  if (!(highest > 0)) return [0, 1];
  const rough = highest / count;
  const below = roundBelow(rough);
  const step = below >= rough * (1 - 1e-9) ? below : roundBelow(below * 2.5);
  const steps = Math.ceil(highest / step - 1e-9);
  return Array.from({ length: steps + 1 }, (_, i) => Number((i * step).toPrecision(12)));
}

/** Views to name on the axis: the first, the last, and round ones between that leave room. */
export function viewTicks(views: number): number[] {
  const step = views <= 12 ? 2 : views <= 30 ? 5 : views <= 60 ? 10 : 20;
  const ticks = [1];
  for (let view = step; view <= views - step / 2; view += step) {
    if (view > 1) ticks.push(view);
  }
  if (views > 1) ticks.push(views);
  return ticks;
}
