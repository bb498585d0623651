// The search of the documentation. The pages can be read without it.

import { find, type Page } from "./search";

const form = document.querySelector("form");
const input = form?.querySelector("input");
const list = form?.querySelector("ol");
let pages: Promise<Page[]> | undefined;

async function show(): Promise<void> {
  if (!input || !list) return;
  const query = input.value;
  pages ??= fetch("search.json").then((answer) => answer.json() as Promise<Page[]>);
  const hits = find(await pages, query);
  if (query !== input.value) return;
  list.replaceChildren(
    ...hits.map(({ href, title, excerpt }) => {
      const link = document.createElement("a");
      link.href = href;
      link.textContent = title;
      const item = document.createElement("li");
      item.append(link, ` ${excerpt}`);
      return item;
    }),
  );
  if (hits.length === 0 && query.trim() !== "") list.textContent = "No section has all these words.";
}

if (form && input) {
  form.hidden = false;
  form.addEventListener("submit", (event) => event.preventDefault());
  input.addEventListener("input", () => void show());
}
