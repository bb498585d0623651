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
  /** The text around the first word. */
  excerpt: string;
}

const AROUND = 70;

/** The sections with all words, those with a word in the page's title or at the section's beginning (its heading) first. */
export function find(pages: Page[], query: string, most = 12): Hit[] {
  const words = query.toLowerCase().split(/\s+/).filter(Boolean);
  if (words.length === 0) return [];
  const hits: { hit: Hit; rank: number }[] = [];
  for (const page of pages) {
    const title = page.title.toLowerCase();
    for (const { id, text } of page.sections) {
      const lower = text.toLowerCase();
      if (!words.every((word) => lower.includes(word) || title.includes(word))) continue;
      const places = words.map((word) => lower.indexOf(word)).filter((at) => at >= 0);
      const at = places.length > 0 ? Math.min(...places) : 0;
      const rank = words.filter((word) => title.includes(word)).length * 2 + (at < 40 ? 1 : 0);
      const start = Math.max(0, at - AROUND);
      const excerpt = `${start > 0 ? "... " : ""}${text.slice(start, at + AROUND)}${at + AROUND < text.length ? " ..." : ""}`;
      hits.push({ hit: { href: `${page.name}#${id}`, title: page.title, excerpt }, rank });
    }
  }
  return hits
    .sort((a, b) => b.rank - a.rank)
    .slice(0, most)
    .map(({ hit }) => hit);
}
