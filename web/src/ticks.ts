// Round numbers for axes and scale bars. Pure.

/** The largest of 1, 2 or 5 times a power of ten that is not above `value`. */
export function roundBelow(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  // A small tolerance, because 0.3 / 0.1 is 2.999...
  const lead = value / power + 1e-9;
  return (lead >= 5 ? 5 : lead >= 2 ? 2 : 1) * power;
}

/** Round levels at equal distances for a linear axis, four to eight: from the one below the lowest to the one above the highest. */
export function linearTicks(lowest: number, highest: number): number[] {
  // Equal values still need an axis.
  const span = Math.max(highest - lowest, Math.abs(highest) * 1e-3, 1e-9);
  const step = roundBelow(span / 2.5);
  const first = Math.floor(lowest / step + 1e-9);
  const last = Math.max(Math.ceil(highest / step - 1e-9), first + 1);
  return Array.from({ length: last - first + 1 }, (_, i) => Number(((first + i) * step).toPrecision(12)));
}

/** The decimals that tell neighbouring levels of a linear axis apart. */
export function levelDigits(levels: readonly number[]): number {
  return Math.max(0, -Math.floor(Math.log10(levels[1]! - levels[0]!) + 1e-9));
}

/** Views to label on the axis: the first, the last, and round numbers between them with enough space. */
export function viewTicks(views: number): number[] {
  const step = views <= 12 ? 2 : views <= 30 ? 5 : views <= 60 ? 10 : 20;
  const ticks = [1];
  for (let view = step; view <= views - step / 2; view += step) ticks.push(view);
  if (views > 1) ticks.push(views);
  return ticks;
}
