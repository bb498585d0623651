// Formats numbers and times for operators. Pure: the text does not depend on the locale.

const MINUS = "\u2212";
const THIN = "\u202f";

/** Rounds to `digits` decimals and separates thousands with commas. */
export function grouped(value: number, digits = 0): string {
  const text = Math.abs(value).toFixed(digits);
  const [whole = "", fraction] = text.split(".");
  const separated = whole.replace(/\B(?=(\d{3})+$)/g, ",");
  const sign = value < 0 && Number(text) !== 0 ? MINUS : "";
  return sign + separated + (fraction === undefined ? "" : `.${fraction}`);
}

/** At least four significant digits, without an exponent: 0.06545, 65.45, 243.1, 1,204. */
export function significant(value: number, digits = 4): string {
  if (value === 0) return "0";
  const magnitude = Math.floor(Math.log10(Math.abs(value)));
  return grouped(value, Math.min(12, Math.max(0, digits - 1 - magnitude)));
}

/** `226.7 ± 1.4`: the spread has two digits, and the value ends at the same decimal place. */
export function withSpread(value: number, sd: number): string {
  const digits = sd > 0 ? Math.min(12, Math.max(0, 1 - Math.floor(Math.log10(sd)))) : 4;
  return `${grouped(value, digits)} ± ${grouped(sd, digits)}`;
}

/** Words in which no line ends between a value and its spread. */
export function unbroken(words: string): string {
  return words.replaceAll(" ± ", "\u00a0±\u00a0");
}

/** 1 nL is 10^6 um^3. */
export const UM3_PER_NL = 1e6;

export function nanolitres(um3: number, sd_um3: number | null = null): string {
  return `${scaled(um3, sd_um3, UM3_PER_NL)}${THIN}nL`;
}

function scaled(value: number, sd: number | null, unit: number): string {
  return sd === null ? significant(value / unit) : withSpread(value / unit, sd / unit);
}

export function cubicMicrometres(um3: number): string {
  return `${grouped(um3)}${THIN}µm³`;
}

export function squareMillimetres(um2: number, sd_um2: number | null = null): string {
  return `${scaled(um2, sd_um2, 1e6)}${THIN}mm²`;
}

export function squareMicrometres(um2: number): string {
  return `${grouped(um2)}${THIN}µm²`;
}

export function micrometres(um: number, digits = 0): string {
  return `${grouped(um, digits)}${THIN}µm`;
}

/** A rough age that changes seldom: 45 min, 5 h, 3 days. */
export function age(seconds: number): string {
  const s = Math.max(0, seconds);
  if (s < 3600) return `${Math.floor(s / 60)} min`;
  if (s < 2 * 86400) return `${Math.floor(s / 3600)} h`;
  return `${Math.floor(s / 86400)} days`;
}

/** A duration in its two largest useful units: 8 s, 3 min 20 s, 2 h 5 min. */
export function duration(seconds: number): string {
  const s = Math.max(0, Math.round(seconds));
  if (s < 60) return `${s} s`;
  const minutes = Math.floor(s / 60);
  if (minutes < 60) return s % 60 === 0 ? `${minutes} min` : `${minutes} min ${s % 60} s`;
  const hours = Math.floor(minutes / 60);
  return minutes % 60 === 0 ? `${hours} h` : `${hours} h ${minutes % 60} min`;
}

/** An estimated duration, rounded to its accuracy. */
export function aboutDuration(seconds: number): string {
  if (seconds < 45) return "less than a minute";
  const minutes = Math.round(seconds / 60);
  return minutes < 60 ? `about ${minutes} min` : `about ${duration(Math.round(minutes / 5) * 300)}`;
}

export function bytes(count: number): string {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let value = count;
  let unit = 0;
  while (value >= 1000 && unit < units.length - 1) {
    value /= 1000;
    unit += 1;
  }
  return `${significant(value, 3)} ${units[unit]}`;
}

/** A concentration or dose as it was entered, without the noise of binary numbers: 1.5, 10. */
export function asEntered(value: number): string {
  return String(Number(value.toPrecision(12)));
}

/** `uM` -> `µM`. */
export function unitWords(unit: string): string {
  return unit.replace(/^u/, "µ");
}

/** `brief_reason` -> `brief reason`. */
export function words(name: string): string {
  return name.replaceAll("_", " ");
}

/** `1 view`, `2 views`. */
export function counted(count: number, noun: string, plural = `${noun}s`): string {
  return `${grouped(count)} ${count === 1 ? noun : plural}`;
}

export function capitalised(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** Local day and time of the browser: `2026-03-05 09:30`. A text that is no time is returned unchanged. */
export function day(rfc3339: string): string {
  const date = new Date(rfc3339);
  if (Number.isNaN(date.getTime())) return rfc3339;
  const two = (n: number) => String(n).padStart(2, "0");
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())} ${hourOf(date)}`;
}

/** Local day and time of the browser with seconds: `2026-03-05 09:30:00`. */
export function moment(rfc3339: string): string {
  const [date = ""] = day(rfc3339).split(" ");
  return Number.isNaN(Date.parse(rfc3339)) ? rfc3339 : `${date} ${clockTime(rfc3339)}`;
}

/** Local time of the browser without seconds: `09:30`. */
export function hourOf(date: Date): string {
  return [date.getHours(), date.getMinutes()].map((n) => String(n).padStart(2, "0")).join(":");
}

/** Local time of the browser with seconds. A text that is no time is returned unchanged. */
export function clockTime(rfc3339: string): string {
  const date = new Date(rfc3339);
  if (Number.isNaN(date.getTime())) return rfc3339;
  return [date.getHours(), date.getMinutes(), date.getSeconds()].map((n) => String(n).padStart(2, "0")).join(":");
}
