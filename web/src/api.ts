// The page's requests to the daemon.

import type {
  Acknowledged,
  Check,
  ColumnProposal,
  GateRow,
  Gates,
  MappedColumn,
  MethodOffer,
  Methods,
  Mistake,
  NextPlate,
  NoteOnWell,
  PlateMap,
  Preflight,
  Problem,
  QueueOrder,
  ReplayRequest,
  RunDetail,
  RunEvents,
  RunPlan,
  RunReplays,
  Runs,
  SaidBy,
  Specimen,
  SpecimenDetail,
  Statistics,
  Status,
  WellLoaded,
} from "./status.ts";
import { authorization } from "./token.ts";

/** A failed request: the daemon answered with a problem, or (code 0) not at all. */
export class Refused extends Error {
  override name = "Refused";
  readonly code: number;
  /** All errors in the request, if the daemon lists them. */
  readonly mistakes: readonly Mistake[];
  /** The run under way, if the refusal is due to it. */
  readonly run: string | null;

  constructor(code: number, message: string, mistakes: readonly Mistake[] = [], run: string | null = null) {
    // The text becomes part of a sentence.
    super(message.replace(/\.$/, ""));
    this.code = code;
    this.mistakes = mistakes;
    this.run = run;
  }
}

/** A command without an answer: whether it is carried out is not known. */
export class Unanswered extends Refused {
  override name = "Unanswered";
}

/** How long a command may take that is only accepted, ms. */
const ACCEPTED_MS = 5000;
/** How long a request may take for which the daemon computes or asks its devices, ms. */
const WORK_MS = 60_000;

let noticed: () => void = () => {};

/** `silent` is called when the daemon has not answered a command. */
export function watchCommands(silent: () => void): void {
  noticed = silent;
}

/** Sends a command and waits so long for the answer. */
async function command(path: string, init: RequestInit, ms = ACCEPTED_MS): Promise<Response> {
  try {
    const response = await ask(path, { ...init, signal: AbortSignal.timeout(ms) });
    if (!response.ok) throw await refusal(response);
    return response;
  } catch (error) {
    const isLate = error instanceof DOMException;
    if (isLate || (error instanceof Refused && error.code === 0)) noticed();
    throw isLate ? new Unanswered(0, `no answer came within ${ms / 1000} s`) : error;
  }
}

/** The message of the problem+json body, or one made from the status code. */
async function refusal(response: Response): Promise<Refused> {
  const code = `${response.status} ${response.statusText}`.trim();
  // A proxy in between answers without these fields.
  const body = (await response.json().catch(() => ({}))) as Partial<Problem>;
  const words = ON_THIS_PAGE[body.code ?? ""] ?? body.detail ?? body.title ?? code;
  return new Refused(response.status, words, body.errors ?? [], body.run ?? null);
}

/** What to do on this page about a refusal; another program would send another request. */
const ON_THIS_PAGE: Record<string, string> = {
  capillary_full: "a specimen is still in the capillary: take it out, and say so by the button above",
  fault_stands: "a fault is not acknowledged: see to its cause, then acknowledge it in the list of faults",
  handoff_open: "a plate is being handed over: the loader has to say first how that ended, or you by the button above",
};

/** Converts the error of a failed network, also in the middle of a body. An aborted wait is passed on unchanged. */
function away(error: unknown): never {
  if (error instanceof DOMException) throw error;
  throw new Refused(0, "the daemon cannot be reached");
}

function ask(path: string, init: RequestInit = {}): Promise<Response> {
  return fetch(path, { ...init, cache: "no-store", headers: { ...init.headers, ...authorization() } }).catch(away);
}

/** The newest status. With `after`: as soon as its revision is higher, or unchanged after `waitS` seconds. */
export async function fetchStatus(after: number | null, waitS: number, signal: AbortSignal): Promise<Status> {
  const path = after === null ? "/v1/status" : `/v1/status?wait=${waitS}&after=${after}`;
  const response = await ask(path, { signal });
  if (!response.ok) throw await refusal(response);
  return (await response.json().catch(away)) as Status;
}

/** Sends a command. The answer only confirms that it was accepted. */
export async function post(path: string, ms?: number): Promise<void> {
  const response = await command(path, { method: "POST" }, ms);
  await response.body?.cancel();
}

function sendJson(method: string, path: string, body: unknown, ms?: number): Promise<Response> {
  const headers = { "Content-Type": "application/json" };
  return command(path, { method, headers, body: JSON.stringify(body) }, ms);
}

/** Reports by hand, like a loader, that the specimen of this well is in the capillary or out of it. */
export async function sayLoaded(run: string, well: string, loaded: boolean): Promise<void> {
  const body: WellLoaded = { loaded };
  const response = await sendJson("PUT", `/v1/runs/${encodeURIComponent(run)}/wells/${well}`, body);
  await response.body?.cancel();
}

/** Reports by hand, like a loader, that the announced plate stays in its place. */
export async function sayNotMoved(): Promise<void> {
  const response = await command("/v1/plate/handoff/aborted", { method: "PUT" });
  await response.body?.cancel();
}

async function putAboutWell(run: string, well: string, what: string, body: SaidBy | NoteOnWell): Promise<void> {
  const response = await sendJson("PUT", `/v1/runs/${encodeURIComponent(run)}/wells/${well}/${what}`, body);
  await response.body?.cancel();
}

/** Writes a remark on a well. */
export function noteWell(run: string, well: string, note: NoteOnWell): Promise<void> {
  return putAboutWell(run, well, "note", note);
}

/** Leaves a well out of a held run. */
export function skipWell(run: string, well: string, says: SaidBy): Promise<void> {
  return putAboutWell(run, well, "skip", says);
}

/** Has a well of a held run measured again. */
export function redoWell(run: string, well: string, says: SaidBy): Promise<void> {
  return putAboutWell(run, well, "redo", says);
}

/** The plan of the wells that a run has left without numbers, or of these wells. */
export async function fetchRest(run: string, wells: readonly string[] = []): Promise<RunPlan> {
  const query = wells.length === 0 ? "" : `?wells=${wells.join(",")}`;
  const response = await ask(`/v1/runs/${encodeURIComponent(run)}/rest${query}`);
  if (!response.ok) throw await refusal(response);
  return (await response.json().catch(away)) as RunPlan;
}

/** Takes a picture while no run is under way. */
export async function takePicture(): Promise<Blob> {
  const response = await command("/v1/live/picture", { method: "POST" }, WORK_MS);
  return response.blob().catch(away);
}

/** Starts a run. Returns false if the daemon has this run with the same plan: then nothing is started. */
export async function startRun(id: string, plan: RunPlan): Promise<boolean> {
  const response = await sendJson("PUT", `/v1/runs/${encodeURIComponent(id)}`, plan, WORK_MS);
  await response.body?.cancel();
  return response.status === 201;
}

/** Queues a plate, or changes the plan of the one that waits for this run. */
export async function queuePlate(run: string, plan: RunPlan): Promise<void> {
  const response = await sendJson("PUT", `/v1/queue/${encodeURIComponent(run)}`, plan, WORK_MS);
  await response.body?.cancel();
}

/** The plan of a queued plate. */
export async function fetchQueued(run: string): Promise<RunPlan> {
  const response = await ask(`/v1/queue/${encodeURIComponent(run)}`);
  if (!response.ok) throw await refusal(response);
  return (await response.json().catch(away)) as RunPlan;
}

/** Takes a plate out of the queue. */
export async function unqueue(run: string): Promise<void> {
  const response = await command(`/v1/queue/${encodeURIComponent(run)}`, { method: "DELETE" });
  await response.body?.cancel();
}

/** Puts the queue into the order of these runs. */
export async function orderQueue(runs: string[]): Promise<void> {
  const body: QueueOrder = { runs };
  const response = await sendJson("PUT", "/v1/queue", body);
  await response.body?.cancel();
}

/** Reports the plate that is in its place. Returns the name of its run, which begins if it is the next plate of the queue. */
export async function beginNext(barcode: string): Promise<string> {
  const body: NextPlate = { barcode };
  const response = await sendJson("PUT", "/v1/plate/next", body, WORK_MS);
  return ((await response.json().catch(away)) as Acknowledged).run;
}

async function sendFile(path: string, file: File): Promise<Response> {
  const type = isJson(file) ? "application/json" : "text/csv";
  return command(path, { method: "POST", headers: { "Content-Type": type }, body: await file.arrayBuffer() }, WORK_MS);
}

/** Whether a plate map is JSON. Other files are tables. */
export function isJson(file: File): boolean {
  return /\.json$/i.test(file.name);
}

/**
 * The wells in a plate map's file, as the daemon reads it. With `wells`: on a plate of so many; with `columns`: its columns are these. A
 * refusal lists every mistake.
 */
export async function checkPlateMap(
  file: File,
  wells: number | null,
  columns: readonly MappedColumn[] | null,
): Promise<PlateMap> {
  const query = new URLSearchParams();
  if (wells !== null) query.set("plate_format", String(wells));
  if (columns !== null) query.set("columns", JSON.stringify(columns));
  const response = await sendFile(`/v1/plate-maps/check${`?${query}`.replace(/^\?$/, "")}`, file);
  return (await response.json().catch(away)) as PlateMap;
}

/** What the columns of a table seem to be. */
export async function proposeColumns(file: File): Promise<ColumnProposal> {
  const response = await sendFile("/v1/plate-maps/columns", file);
  return (await response.json().catch(away)) as ColumnProposal;
}

/** Every precondition of a plan, whether it is met or not. */
export async function preflight(plan: RunPlan): Promise<Check[]> {
  const response = await sendJson("POST", "/v1/preflight", plan, WORK_MS);
  return ((await response.json().catch(away)) as Preflight).checks;
}

export async function fetchMethods(): Promise<MethodOffer[]> {
  const response = await ask("/v1/methods");
  if (!response.ok) throw await refusal(response);
  return ((await response.json().catch(away)) as Methods).methods;
}

/** Which runs: all of them, or those with an outcome (`open`: without one) and of a mode. */
export interface RunFilter {
  outcome: string;
  mode: string;
  /** A part of the name of a compound. */
  compound: string;
}

/** A page of the list of runs, the newest first; with `after`, the page that follows this cursor. */
export async function fetchRuns(after: string | null, filter: RunFilter): Promise<Runs> {
  const query = new URLSearchParams({ limit: "100" });
  for (const [name, value] of Object.entries({ ...filter, cursor: after ?? "" }))
    if (value !== "") query.set(name, value);
  const response = await ask(`/v1/runs?${query}`);
  if (!response.ok) throw await refusal(response);
  return (await response.json().catch(away)) as Runs;
}

/** The stored record of a run, including its plan. */
export async function fetchRun(run: string): Promise<RunDetail> {
  const response = await ask(`/v1/runs/${encodeURIComponent(run)}`);
  if (!response.ok) throw await refusal(response);
  return (await response.json().catch(away)) as RunDetail;
}

/** Statistics of a run: groups, Z' of its controls, responses to doses. */
export async function fetchStatistics(run: string): Promise<Statistics> {
  const response = await ask(`/v1/runs/${encodeURIComponent(run)}/statistics`);
  if (!response.ok) throw await refusal(response);
  return (await response.json().catch(away)) as Statistics;
}

/** What other methods gave for the wells of a run, and how far measuring again has come. */
export async function fetchReplays(run: string): Promise<RunReplays> {
  const response = await ask(`/v1/runs/${encodeURIComponent(run)}/replays`);
  if (!response.ok) throw await refusal(response);
  return (await response.json().catch(away)) as RunReplays;
}

/** Has wells of a run measured again. `name` names the method and its results. */
export async function measureAgain(run: string, name: string, body: ReplayRequest): Promise<RunReplays> {
  const path = `/v1/runs/${encodeURIComponent(run)}/replays/${encodeURIComponent(name)}`;
  return (await (await sendJson("PUT", path, body, WORK_MS)).json().catch(away)) as RunReplays;
}

/** The bead gates of the instrument, oldest first. */
export async function fetchGates(): Promise<GateRow[]> {
  const response = await ask("/v1/bead-gates");
  if (!response.ok) throw await refusal(response);
  return ((await response.json().catch(away)) as Gates).gates;
}

/** Events of a run after the event `after`, oldest first. */
export async function fetchRunEvents(run: string, after: number): Promise<RunEvents> {
  const response = await ask(`/v1/runs/${encodeURIComponent(run)}/events?after=${after}`);
  if (!response.ok) throw await refusal(response);
  return (await response.json().catch(away)) as RunEvents;
}

/** The stored record of a well; null if there is none. */
export async function fetchSpecimen(run: string, well: string): Promise<Specimen | null> {
  const response = await ask(`/v1/runs/${encodeURIComponent(run)}/specimens/${well}`);
  if (response.status === 404) {
    // An unread body would keep the connection busy.
    await response.body?.cancel();
    return null;
  }
  if (!response.ok) throw await refusal(response);
  return (await response.json().catch(away)) as SpecimenDetail;
}

/** The specimen of a live picture, and the number of its views so far. */
export interface Shown {
  run: string;
  well: string;
  views: number;
}

/** A live picture or mesh: `same` as the one with the known tag, `none`, or new. */
export type Fetched =
  | { kind: "same"; shown: Shown | null }
  | { kind: "none"; shown: Shown | null }
  | { kind: "new"; shown: Shown | null; body: Blob; tag: string | null };

function shownBy(headers: Headers): Shown | null {
  const [run, well, views] = ["Carved-Run", "Carved-Well", "Carved-Views"].map((name) => headers.get(name));
  return run && well && views ? { run, well, views: Number(views) } : null;
}

export async function fetchLive(path: string, known: string | null): Promise<Fetched> {
  const headers: HeadersInit = known === null ? {} : { "If-None-Match": known };
  const response = await ask(path, { headers });
  const shown = shownBy(response.headers);
  if (response.status === 304) return { kind: "same", shown };
  if (response.status === 204) return { kind: "none", shown };
  if (!response.ok) throw await refusal(response);
  return { kind: "new", shown, body: await response.blob().catch(away), tag: response.headers.get("ETag") };
}

/** A file of a stored specimen, from its link. */
export async function fetchFile(link: string): Promise<Blob> {
  const response = await ask(link);
  if (!response.ok) throw await refusal(response);
  return response.blob().catch(away);
}
