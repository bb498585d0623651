// Explains flags and reasons: what was found, and what to do about it. docs/quality.md describes the limits. Pure.

import { FLAGS } from "./flags.ts";
import { words } from "./format.ts";

const REASONS: Record<string, string> = {
  blocked: "the capillary lets no light through",
  bubble: "an air bubble",
  clipped: "it goes on beyond the picture",
  debris: "debris",
  empty: "the capillary is empty",
  no_pictures: "no picture of it was stored",
  two: "two larvae",
};

/** Whether a number with these flags is a bound: part of the specimen was not measured. */
export function isBoundBy(flags: readonly string[]): boolean {
  return flags.some((flag) => FLAGS[flag]?.effect === "bound");
}

/** Whether statistics use a number with these flags, as the daemon does. A flag of another version lets it count. */
export function countsWith(flags: readonly string[]): boolean {
  return flags.every((flag) => (FLAGS[flag]?.effect ?? "counts") === "counts");
}

/** What a flag means. A run of another version may have a flag that this page does not know. */
export function meaningWords(flag: string): string {
  const entry = FLAGS[flag];
  return entry === undefined ? words(flag) : phrase(entry.meaning);
}

/** What a flag means, and what to do. */
export function flagWords(flag: string): string {
  const entry = FLAGS[flag];
  return entry === undefined ? words(flag) : `${meaningWords(flag)}: ${phrase(entry.whatToDo)}`;
}

/** A sentence as a part of another one. */
function phrase(sentence: string): string {
  return sentence.charAt(0).toLowerCase() + sentence.slice(1).replace(/\.$/, "");
}

/** Why a well has no number. The reason of a failure is a sentence already, in which paths and commands are kept unchanged. */
export function reasonWords(reason: string): string {
  return REASONS[reason] ?? (/^[a-z_]+$/.test(reason) ? words(reason) : reason);
}
