// What the page asks of the daemon, and nothing else: status, the live pictures, abort.

import type { Status } from "./status.ts";
import { authorization } from "./token.ts";

/** The daemon did not give what was asked for: it answered with a problem, or (code 0) not at all. */
export class Refused extends Error {
  override name = "Refused";
  readonly code: number;

  constructor(code: number, message: string) {
    super(message);
    this.code = code;
  }
}

/** In the words of the problem+json body, or by the code alone. */
async function refusal(response: Response): Promise<Refused> {
  const code = `${response.status} ${response.statusText}`.trim();
  const body = (await response.json().catch(() => ({}))) as { title?: string; detail?: string };
  return new Refused(response.status, body.detail ?? body.title ?? code);
}

/** What the browser throws where the network fails, also in the middle of a body; a wait cut short stays what it is. */
function away(error: unknown): never {
  if (error instanceof DOMException) throw error;
  throw new Refused(0, "the daemon cannot be reached");
}

function ask(path: string, init: RequestInit = {}): Promise<Response> {
  return fetch(path, { ...init, cache: "no-store", headers: { ...init.headers, ...authorization() } }).catch(away);
}

/** The newest status; with `after`, as soon as its revision is above, or after `waitS` seconds as it is. */
export async function fetchStatus(after: number | null, waitS: number, signal: AbortSignal): Promise<Status> {
  const path = after === null ? "/v1/status" : `/v1/status?wait=${waitS}&after=${after}`;
  const response = await ask(path, { signal });
  if (!response.ok) throw await refusal(response);
  return (await response.json().catch(away)) as Status;
}

export async function abortRun(id: string): Promise<void> {
  const response = await ask(`/v1/runs/${encodeURIComponent(id)}/abort`, { method: "POST" });
  if (!response.ok) throw await refusal(response);
}

/** A live picture or mesh: `same` as the one known by its tag, `none` there yet, or new. */
export type Fetched = { kind: "same" } | { kind: "none" } | { kind: "new"; body: Blob; tag: string | null };

export async function fetchLive(path: string, known: string | null): Promise<Fetched> {
  const headers: HeadersInit = known === null ? {} : { "If-None-Match": known };
  const response = await ask(path, { headers });
  if (response.status === 304) return { kind: "same" };
  if (response.status === 404) {
    // A body that nobody reads would keep the connection busy.
    await response.body?.cancel();
    return { kind: "none" };
  }
  if (!response.ok) throw await refusal(response);
  return { kind: "new", body: await response.blob().catch(away), tag: response.headers.get("ETag") };
}
