// Round numbers for axes and scale bars. Pure.

/** The largest of 1, 2 or 5 times a power of ten that is not above `value`. */
export function roundBelow(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  // A small tolerance, because 0.3 / 0.1 is 2.999...
  const lead = value / power + 1e-9;
  return (lead >= 5 ? 5 : lead >= 2 ? 2 : 1) * power;
}

/** Levels 1, 2 and 5 times powers of ten for a logarithmic axis: from the one below the lowest to the one above the highest. */
export function logTicks(lowest: number, highest: number): number[] {
  const ticks = [roundBelow(lowest)];
  // The next of 1, 2, 5 is at most 2.5 times higher, and the one after it at least 4 times.
  while (ticks.length < 2 || ticks.at(-1)! < highest) ticks.push(roundBelow(ticks.at(-1)! * 2.5));
  return ticks.map((tick) => Number(tick.toPrecision(12)));
}

/** Views to label on the axis: the first, the last, and round numbers between them with enough space. */
export function viewTicks(views: number): number[] {
  const step = views <= 12 ? 2 : views <= 30 ? 5 : views <= 60 ? 10 : 20;
  const ticks = [1];
  for (let view = step; view <= views - step / 2; view += step) {
    if (view > 1) ticks.push(view);
  }
  if (views > 1) ticks.push(views);
  return ticks;
}
