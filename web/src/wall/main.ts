// Up to twelve instruments on one page: state, plate, time, last volume, and who is needed. It reads their statuses and commands nothing.
//
//   kept in this browser: address, token that only reads ──> GET ADDRESS/v1/status, again and again ──> a tile

import { byId, element, setText, show } from "../dom.ts";
import { remember, remembered } from "../remembered.ts";
import type { Status } from "../status.ts";
import { tileOf, type Tile } from "./tile.ts";

interface Named {
  address: string;
  token: string;
}

const KEY = "carved.instruments";
const MOST = 12;
/** Pause between two readings of an instrument, and between two drawings, ms. What is heard within two pauses is live. */
const PAUSE_MS = 1000;
/** How long an answer may take, ms. */
const PATIENCE_MS = 8000;

interface Followed {
  named: Named;
  status: Status | null;
  /** On the clock of `performance.now()`. */
  heard: number;
  trouble: string | null;
  isOver: boolean;
}

let followed: Followed[] = [];

function kept(): Named[] {
  try {
    const found: unknown = JSON.parse(remembered(KEY) ?? "[]");
    const isNamed = (one: unknown): one is Named =>
      typeof one === "object" && one !== null && "address" in one && "token" in one;
    return Array.isArray(found) ? found.filter(isNamed).slice(0, MOST) : [];
  } catch {
    return [];
  }
}

async function read(one: Followed): Promise<void> {
  const { address, token } = one.named;
  const headers: HeadersInit = token === "" ? {} : { Authorization: `Bearer ${token}` };
  try {
    const response = await fetch(`${address}/v1/status`, {
      cache: "no-store",
      headers,
      signal: AbortSignal.timeout(PATIENCE_MS),
    });
    if (response.ok) {
      one.status = (await response.json()) as Status;
      one.heard = performance.now();
      one.trouble = null;
    } else {
      one.trouble = response.status === 401 ? "the token is missing or wrong" : `it answers ${response.status}`;
    }
  } catch {
    one.trouble = "it does not answer, or this page is not in its wall_origins";
  }
}

async function follow(one: Followed): Promise<void> {
  while (!one.isOver) {
    await read(one);
    draw();
    await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
  }
}

function drawn({
  tone,
  name,
  isSimulated,
  state,
  needed,
  plate,
  count,
  finish,
  words,
  last,
  trouble,
}: Tile): HTMLElement {
  const tile = element(
    "li",
    "tile",
    element("h2", "", name, ...(isSimulated ? [element("strong", "stamp", "SIMULATED")] : [])),
    element("p", "band", element("span", "state", state), element("span", "figure", count)),
    element("p", "needed", needed ?? words),
    element("p", "quiet", [plate, finish].filter((part) => part !== "").join(" · ")),
    element("p", "last", last),
  );
  tile.dataset["tone"] = tone;
  tile.dataset["needed"] = String(needed !== null);
  if (trouble !== null) tile.append(element("p", "trouble", trouble));
  return tile;
}

function draw(): void {
  const tiles = followed.map(({ named, status, heard, trouble }) =>
    tileOf(named.address, status, trouble, (performance.now() - heard) / 1000),
  );
  byId("tiles").replaceChildren(...tiles.map(drawn));
  byId("tiles").style.setProperty("--columns", String(Math.ceil(Math.sqrt(tiles.length))));
  show(byId("none"), tiles.length === 0);
  const needed = tiles.filter((tile) => tile.needed !== null).map((tile) => tile.name);
  const words = needed.length === 0 ? "Nobody is needed." : `Somebody is needed at ${needed.join(", ")}.`;
  setText(byId("needs"), tiles.length === 0 ? "" : words);
  byId("needs").dataset["needed"] = String(needed.length > 0);
}

function keep(named: Named[]): void {
  remember(KEY, JSON.stringify(named));
  for (const one of followed) one.isOver = true;
  followed = named.map((one) => ({ named: one, status: null, heard: 0, trouble: null, isOver: false }));
  for (const one of followed) void follow(one);
  byId("list").replaceChildren(
    ...named.map((one) => {
      const button = element("button", "", `Remove ${one.address}`);
      button.type = "button";
      button.addEventListener("click", () => keep(kept().filter(({ address }) => address !== one.address)));
      return element("li", "", button);
    }),
  );
  byId<HTMLButtonElement>("add-button").disabled = named.length >= MOST;
  draw();
}

byId<HTMLFormElement>("add").addEventListener("submit", (event) => {
  event.preventDefault();
  const [address, token] = [byId<HTMLInputElement>("address"), byId<HTMLInputElement>("token")];
  const { origin, protocol } = new URL(address.value);
  const isWrong = !["http:", "https:"].includes(protocol);
  setText(byId("add-words"), isWrong ? "An address begins with http:// or https://." : "");
  if (isWrong) return;
  const others = kept().filter((one) => one.address !== origin);
  keep([...others, { address: origin, token: token.value.trim() }].slice(0, MOST));
  address.value = token.value = "";
});

byId<HTMLDetailsElement>("named").open = kept().length === 0;
keep(kept());
// An answer that does not come grows older without a reading that ends.
setInterval(draw, PAUSE_MS);
