// Explains the status in plain words. Pure.

import { aboutDuration, capitalised, grouped, hourOf } from "./format.ts";
import { conditionOf } from "./wells.ts";
import type { Phase, RunOutcome, RunStatus, SpecimenStatus, State, Status } from "./status.ts";

/** The level of attention that a state needs. */
export type Tone = "calm" | "busy" | "good" | "attention" | "alarm";

const ENDED: Record<RunOutcome, Tone> = {
  succeeded: "good",
  partial: "attention",
  failed: "alarm",
  aborted: "attention",
  interrupted: "attention",
};

export function toneOf(status: Status): Tone {
  if (status.faults.some((f) => f.operator_required)) return "alarm";
  if (status.state === "Aborted" || status.state === "Aborting") return "alarm";
  if (status.faults.length > 0 || ATTENTION.has(status.state)) return "attention";
  // The daemon looks for it for a while before it holds the run.
  if (runsNow(status) && !status.hardware.camera.connected) return "attention";
  if (BUSY.has(status.state)) return "busy";
  return status.run?.outcome ? ENDED[status.run.outcome] : "calm";
}

const ATTENTION: ReadonlySet<State> = new Set(["Holding", "Held", "Suspending", "Suspended", "Stopping", "Stopped"]);
const BUSY: ReadonlySet<State> = new Set([
  "Starting",
  "Execute",
  "Unholding",
  "Unsuspending",
  "Completing",
  "Clearing",
  "Resetting",
]);

/** Plain words for the PackML states. */
export const STATES: Record<State, string> = {
  Stopped: "Stopped",
  Idle: "Idle",
  Starting: "Starting",
  Execute: "Running",
  Holding: "Holding",
  Held: "Held",
  Unholding: "Going on",
  Suspending: "Waiting",
  Suspended: "Waiting",
  Unsuspending: "Going on",
  Completing: "Finishing",
  Complete: "Finished",
  Stopping: "Stopping",
  Aborting: "Aborting",
  Aborted: "Aborted",
  Clearing: "Resetting",
  Resetting: "Resetting",
};

export const PHASES: Record<Phase, string> = {
  load: "loading",
  detect: "looking for a specimen",
  position: "positioning",
  revolve: "taking views",
  reconstruct: "reconstructing",
  measure: "measuring",
  eject: "ejecting",
  wash: "washing",
};

export const OUTCOMES: Record<RunOutcome, string> = {
  succeeded: "finished",
  partial: "finished in part",
  failed: "failed",
  aborted: "was aborted",
  interrupted: "was interrupted",
};

/** `3 measured (1 of them flagged), 1 skipped`: the count of each kind that is not zero. */
export function tally(run: RunStatus): string {
  const w = run.wells;
  // The counts of the daemon have these in one number.
  const aborted = run.results.filter(({ outcome }) => outcome === "aborted");
  const cut = aborted.filter(({ views }) => (views ?? 0) > 0).length;
  const isOver = run.outcome !== null;
  const parts: [number, string][] = [
    [w.succeeded + w.flagged, w.flagged === 0 ? "measured" : `measured (${grouped(w.flagged)} of them flagged)`],
    [w.skipped, "skipped"],
    [w.failed, "failed"],
    [w.interrupted - aborted.length, "interrupted"],
    [cut, "interrupted by the end of the run"],
    [aborted.length - cut + (isOver ? w.pending : 0), "not measured"],
    [isOver ? 0 : w.pending, "waiting"],
  ];
  return parts
    .filter(([count]) => count > 0)
    .map(([count, word]) => `${grouped(count)} ${word}`)
    .join(", ");
}

/** Number of wells that ended by themselves. Wells that an abort or a stop left out do not count. */
function done(run: RunStatus): number {
  return run.wells.total - run.wells.pending - run.wells.interrupted;
}

/** The specimen that the instrument works on, else null. A held run has given its specimen up, or not begun it yet. */
export function underWay(status: Status): SpecimenStatus | null {
  return runsNow(status) && status.state !== "Held" ? status.specimen : null;
}

/** Finished share of the run, 0 to 1. The current specimen counts by its views, and one whose numbers are being made counts as done. */
export function progress(status: Status): number {
  const run = status.run;
  if (!run || run.wells.total === 0) return 0;
  if (run.outcome === "succeeded") return 1;
  const specimen = underWay(status);
  const open = run.results.filter((w) => w.outcome === null);
  const measuring = open.filter((w) => conditionOf(w, specimen, run.results) === "measuring").length;
  const isOpen = open.some((w) => w.well === specimen?.well);
  const within = specimen && isOpen && specimen.views_planned > 0 ? specimen.view / specimen.views_planned : 0;
  return Math.min(1, (done(run) + measuring + Math.min(1, within)) / run.wells.total);
}

/** The largest share of a run that was reached: a specimen that is begun again does not move the progress bar back. */
export class Furthest {
  #run: string | null = null;
  #share = 0;

  of(run: string | null, share: number): number {
    this.#share = run === this.#run ? Math.max(this.#share, share) : share;
    this.#run = run;
    return this.#share;
  }
}

/** One line below the sentence: the progress of the run, or its end. */
export function progressLine(status: Status): string {
  const run = status.run;
  if (!run)
    return status.ready ? "Ready for a run." : `Not ready for a run: ${status.not_ready_reason ?? "no reason given"}.`;
  if (run.outcome) return `Run ${run.id} ${OUTCOMES[run.outcome]}: ${tally(run)}.`;
  const parts = [`Run ${run.id}: ${grouped(done(run))} of ${grouped(run.wells.total)} wells done`];
  if (run.eta_s && !waitsForHand(status))
    parts.push(`${aboutDuration(run.eta_s.p50)} left${status.state === "Held" ? " once it continues" : ""}`);
  return `${parts.join(" · ")}.`;
}

/** `38 / 96`: the wells that are done with, of all. Empty without a run. */
export function count(status: Status): string {
  return status.run === null ? "" : `${grouped(done(status.run))} / ${grouped(status.run.wells.total)}`;
}

/** The plate, and whether it may be taken. */
export function plateName(status: Status): string {
  const { barcode, needs, removable } = status.plate;
  const parts = [barcode === null ? "no plate named" : barcode];
  if (needs !== null) parts.push(mayStillCome(status) ? "waits for a person" : "waits for the loader");
  else if (barcode !== null) parts.push(removable ? "may be taken out" : "leave it in place");
  return parts.join(" · ");
}

/** When the run ends or ended, in local time: `ready at 14:32`, `ended at 09:12`. Empty where nobody knows. */
export function finish(status: Status): string {
  const { run } = status;
  if (run === null) return "";
  if (run.ended !== null) return `ended at ${hourOf(new Date(run.ended))}`;
  if (run.eta_s === null || status.state === "Held" || waitsForHand(status)) return "";
  return `ready at ${hourOf(new Date(Date.parse(status.server_time) + run.eta_s.p50 * 1000))}`;
}

/** The one thing that a person does next, and the button that carries it out or confirms it. */
export interface NextStep {
  words: string;
  /** The name of the button; null while a cause stands that no button ends. */
  button: "acknowledge" | "unhold" | "is-out" | "is-in" | null;
  /** The fault that the step is about. */
  fault: number | null;
}

export function nextStep(status: Status): NextStep | null {
  const hold = runsNow(status) ? (status.run?.hold ?? null) : null;
  if (hold?.next_action != null) {
    return { words: hold.next_action, button: hold.next_command, fault: hold.fault_seq };
  }
  const fault = status.faults.findLast((f) => f.operator_required);
  if (fault) {
    return { words: fault.what_to_do, button: fault.ends_by_itself ? null : "acknowledge", fault: fault.seq };
  }
  const { take_out: out, bring } = status.plate;
  if (status.run === null || (out === null && bring === null)) return null;
  if (out !== null) {
    const words = mayStillCome(status)
      ? `By hand: the specimen of ${out} may still come. Take it out of the capillary once it has, then confirm. Confirm too if it does not come.`
      : `By hand: take the specimen of ${out} out of the capillary, then confirm.`;
    return { words, button: "is-out", fault: null };
  }
  return {
    words: `By hand: put the specimen of ${bring} into the capillary, then confirm.`,
    button: "is-in",
    fault: null,
  };
}

/** Whether the specimen that has to be taken out is not in the capillary: a driven sampler was asked for it, and its run has ended. */
export function mayStillCome(status: Status): boolean {
  const out = status.plate.take_out;
  return out !== null && status.specimen?.well === out && !status.specimen.in_capillary;
}

/** Whether a person brings or takes the next specimen: nobody knows how long that takes. */
function waitsForHand(status: Status): boolean {
  const button = nextStep(status)?.button;
  return button === "is-out" || button === "is-in";
}

/** What is the matter, below the next step: why the run is held and how often, or what the instrument is doing. */
export function diagnosis(status: Status): string {
  const next = nextStep(status);
  if (next === null) return "";
  const hold = runsNow(status) ? status.run?.hold : null;
  const isLoaders = (next.button === "is-out" || next.button === "is-in") && !mayStillCome(status);
  if (!hold)
    return isLoaders
      ? `${sentence(status)} The key N reports it too, with the specimen that comes next. A plate-loader does this by itself.`
      : sentence(status);
  // The cause may be over while the run still waits for somebody.
  const isOver = hold.code !== "operator" && !status.faults.some((f) => f.code === hold.code || hold.code === "fault");
  const why = isOver ? "Held by a cause that is over" : "Held because";
  const again = hold.next_try == null ? "" : ` The next try is at ${hourOf(new Date(hold.next_try))}.`;
  const often = hold.times > 1 ? ` It has held the run ${grouped(hold.times)} times since a well was finished.` : "";
  return `${why}: ${hold.cause}${often}${again}`;
}

/** The headline: the next step where somebody has to take one, else what the instrument is doing. */
export function headline(status: Status): string {
  return nextStep(status)?.words ?? sentence(status);
}

/** Whether a run is under way. A held run counts. */
export function runsNow(status: Status): boolean {
  return status.run !== null && status.run.outcome === null;
}

/** Whether the run is between two wells, or waits. */
export function isAtRest(status: Status): boolean {
  return runsNow(status) && (status.state === "Held" || status.state === "Suspended");
}

/** Whether there is a run that an abort would end. */
export function canAbort(status: Status): boolean {
  return runsNow(status) && !status.pending.abort && status.state !== "Aborting";
}

/** Whether there is a run that continues after the current well. */
export function canStop(status: Status): boolean {
  return canAbort(status) && !status.pending.stop && status.state !== "Stopping";
}

const HOLDABLE: ReadonlySet<State> = new Set(["Starting", "Execute", "Suspended", "Suspending", "Unsuspending"]);

/** Whether a held run continues by itself. An operator can prevent this with a hold. */
export function goesOnByItself(status: Status): boolean {
  return status.state === "Held" && status.run?.goes_on_by_itself === true;
}

export function canHold(status: Status): boolean {
  return canStop(status) && !status.pending.hold && (HOLDABLE.has(status.state) || goesOnByItself(status));
}

/** Whether nothing but somebody's word keeps a held run from going on. While a cause stands, the daemon would refuse. */
export function canGoOn(status: Status): boolean {
  const hold = status.run?.hold;
  const waits = hold ? hold.next_command === "unhold" : nextStep(status) === null;
  return canAbort(status) && status.state === "Held" && waits;
}

/** The barcode of the plate whose open handover blocks runs, according to the status; else null. */
export function handedOver(status: Status): string | null {
  return /^plate (\S+) is being handed over$/.exec(status.not_ready_reason ?? "")?.[1] ?? null;
}

/** Whether a new run could be requested. */
export function canStart(status: Status): boolean {
  return !runsNow(status) && ["Idle", "Complete", "Stopped", "Aborted"].includes(status.state);
}

export function sentence(status: Status): string {
  return capitalised(status.doing);
}
