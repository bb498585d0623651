// Finds sections of the documentation that hold all words of a query.

export interface Section {
  id: string;
  text: string;
}

export interface Page {
  name: string;
  title: string;
  sections: Section[];
}

export interface Hit {
  href: string;
  title: string;
  /** The text around the first of the query's words. */
  excerpt: string;
}

const AROUND = 70;
/** A text that begins with what is asked for is about it: its heading has it, or the code of its row is short. */
const BEGINNING = 40;

/** What of a text is compared. As long as the text, so that places in one are places in the other. */
function compared(text: string): string {
  // Some characters have two in lower case.
  const lower = text.toLowerCase();
  return (lower.length === text.length ? lower : text).replace(/[^\p{L}\p{N}]/gu, " ");
}

/** The words of a query, and of a text in which it is looked for. Punctuation is none. */
function wordsOf(text: string): string[] {
  return compared(text).split(" ").filter(Boolean);
}

/** The words of a section, parted by single spaces, once they are asked for. */
const SINGLE = new WeakMap<Section, string>();

function singleOf(section: Section): string {
  const known = SINGLE.get(section) ?? wordsOf(section.text).join(" ");
  SINGLE.set(section, known);
  return known;
}

/** The parts of a query that a text holds as they stand, the longest from each word on. Null where the text has not all of its words. */
function parts(words: string[], text: string, title: string): string[] | null {
  const found: string[] = [];
  for (let from = 0, to = 0; from < words.length; from = to) {
    to = from + 1;
    if (!text.includes(words[from]!) && !title.includes(words[from]!)) return null;
    while (to < words.length && text.includes(words.slice(from, to + 1).join(" "))) to++;
    found.push(words.slice(from, to).join(" "));
  }
  return found;
}

/**
 * The sections with all words of a query. The row of a code comes first. Then come those that have the query in the fewest parts: what is copied
 * from the page is found where it is explained. Of the others, those with a word in the page's title or at the section's beginning (its heading) come first. Of equal ones, the
 * shortest.
 */
export function find(pages: Page[], query: string, most = 12): Hit[] {
  const words = wordsOf(query);
  if (words.length === 0) return [];
  const hits: { hit: Hit; rank: number[] }[] = [];
  for (const page of pages) {
    const title = wordsOf(page.title).join(" ");
    for (const section of page.sections) {
      const { id, text } = section;
      const single = singleOf(section);
      const found = parts(words, single, title);
      if (found === null) continue;
      const lower = compared(text);
      const places = words.map((word) => lower.indexOf(word)).filter((at) => at >= 0);
      const at = places.length > 0 ? Math.min(...places) : 0;
      const isPhrase = found.length < words.length;
      const titled = isPhrase ? 0 : words.filter((word) => title.includes(word)).length;
      const begins = (isPhrase ? single.indexOf(found[0]!) : at) < BEGINNING;
      const start = Math.max(0, at - AROUND);
      const excerpt = `${start > 0 ? "... " : ""}${text.slice(start, at + AROUND)}${at + AROUND < text.length ? " ..." : ""}`;
      const isCode = id === `row-${words.join("_")}`;
      const rank = [isCode ? 0 : 1, found.length, -titled * 2 - (begins ? 1 : 0), text.length];
      hits.push({ hit: { href: `${page.name}#${id}`, title: page.title, excerpt }, rank });
    }
  }
  const order = (a: number[], b: number[]) => a.map((value, i) => value - b[i]!).find((off) => off !== 0) ?? 0;
  return hits
    .sort((a, b) => order(a.rank, b.rank))
    .slice(0, most)
    .map(({ hit }) => hit);
}
