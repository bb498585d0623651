// The operator's page: every view is updated from one status.
//
//   keepLive ── Status ──> header, sentence, faults, plate, well, chart, rig      (numbers, at once)
//                     └──> frame, model                                           (fetched when the revision or the subject changed)
//                             └── live, or stored for the well that the operator chose: subject.ts

import { AgainView } from "./again.ts";
import { fetchRest, fetchRun } from "./api.ts";
import { LiveAtRest } from "./atrest.ts";
import { AttentionList } from "./attention.ts";
import { BeadCharts } from "./beads.ts";
import { reported, VolumeChart } from "./chart.ts";
import { PlateColouring } from "./colouring.ts";
import { CommandRow } from "./commands.ts";
import { keepLive } from "./connection.ts";
import { Display } from "./display.ts";
import { bringIntoView, byId, setText, show } from "./dom.ts";
import { saveOfRun, saveTable, WellFiles } from "./downloads.ts";
import { EmergencyStop } from "./emergency.ts";
import { FaultsView } from "./faults.ts";
import { FrameView } from "./frame.ts";
import { GroupsView } from "./groups.ts";
import { HeaderView } from "./header.ts";
import { VolumeHistory } from "./history.ts";
import { LastDone } from "./lastdone.ts";
import { ModelView, type Look } from "./model.ts";
import { NewRun } from "./newrun.ts";
import { PlateView } from "./plate.ts";
import { QueueView } from "./queue.ts";
import { counted } from "./format.ts";
import {
  canStart,
  count,
  diagnosis,
  finish,
  plateName,
  Furthest,
  headline,
  nextStep,
  progress,
  progressLine,
  runsNow,
  STATES,
  toneOf,
  underWay,
} from "./plain.ts";
import { Recent } from "./recent.ts";
import { ResultsTable } from "./results.ts";
import { Remark } from "./remark.ts";
import { RigView } from "./rig.ts";
import { RunLog } from "./runlog.ts";
import { asStatus, OpenedRun, RunList } from "./runs.ts";
import type { RunDetail, RunPlan, RunStatus, Status } from "./status.ts";
import { StandingView, standingsOf } from "./standing.ts";
import { ContactSheet } from "./sheet.ts";
import { runKey, StoredModels, StoredSpecimens } from "./stored.ts";
import { chosenWell, isStored, subjectOf, type Subject } from "./subject.ts";
import { TokenForm } from "./token.ts";
import { ViewStrip } from "./views.ts";
import { WellCard } from "./wellcard.ts";
import { Zoom } from "./zoom.ts";

// First: whatever fails below, the stop works.
const emergency = new EmergencyStop({
  button: byId("emergency-stop"),
  answer: byId("emergency-answer"),
  bar: byId("emergency-bar"),
  words: byId("emergency-words"),
  withdraw: byId("emergency-withdraw"),
});
const header = new HeaderView({
  stamp: byId("stamp"),
  version: byId("version"),
  instrument: byId("instrument"),
  link: byId("link"),
  lost: byId("lost"),
});
const display = new Display();
const faults = new FaultsView(byId("faults"), byId("fault-list"));
const plate = new PlateView(byId("plate"), byId("legend"), choose);
const attention = new AttentionList(byId("attention"), byId("attention-list"), choose);
const card = new WellCard(byId("well-heading"), byId("well-body"));
const chart = new VolumeChart(byId("chart"), byId("chart-caption"), byId<HTMLInputElement>("with-hull"));
const rig = new RigView(byId("rig"), byId("rig-words"));
const commands = new CommandRow(byId);
const newRun = new NewRun(byId, (words) => commands.tell(words));
const queue = new QueueView(byId, newRun);
const token = new TokenForm(byId("token-form"), byId("token"));
const colouring = new PlateColouring(byId("colour-by"), byId("scale-legend"), redraw);
const results = new ResultsTable(byId("results"), byId("results-table"), lookAt);
const log = new RunLog(byId);
/** The volumes after each view of the instrument's run, and of a stored run that is shown instead. */
const histories = { live: new VolumeHistory(), opened: new VolumeHistory() };
const stored = new StoredSpecimens();
const models = new StoredModels(stored, (links) => links.mesh_glb);
const colouredModels = new StoredModels(stored, (links) => links.coloured_glb);
const standing = new StandingView(byId("standing"));
const groups = new GroupsView(byId, lookAt);
const again = new AgainView(byId);
const sheet = new ContactSheet(byId("sheet"), byId("sheet-list"), byId("sheet-aspect"), lookAt);
const lastDone = new LastDone(byId("last-done"), choose);
const remark = new Remark(
  byId,
  async (run, well) => newRun.offer(await fetchRest(run, [well]), run),
  (run) => opened.said(run),
);
const files = new WellFiles(byId("well-files"));
const frameParts = {
  heading: byId("frame-heading"),
  whose: byId("frame-whose"),
  box: byId("frame-box"),
  frame: byId<HTMLImageElement>("frame-image"),
  profile: byId<HTMLImageElement>("profile-image"),
  model: byId<HTMLImageElement>("model-image"),
  empty: byId("frame-empty"),
  withProfile: byId<HTMLInputElement>("with-profile"),
  withModel: byId<HTMLInputElement>("with-model"),
  withModelLabel: byId("with-model-label"),
  whole: byId<HTMLInputElement>("whole-frame"),
  viewLabel: byId("frame-view-label"),
  view: byId<HTMLInputElement>("frame-view"),
};
const frame = new FrameView(frameParts, stored, models, (view) => {
  views.mark(view);
  files.mark(view);
});
const zoom = new Zoom(
  frameParts.box,
  frameParts.frame,
  [frameParts.model, frameParts.profile],
  byId<HTMLInputElement>("frame-contrast"),
);
byId("frame-reset").addEventListener("click", () => zoom.reset());
const atRest = new LiveAtRest(
  { label: byId("live-rest-label"), choice: byId<HTMLInputElement>("live-rest") },
  (picture) => frame.showAtRest(picture),
  (why) => {
    picturesShown = "";
    redraw();
    if (why !== null) commands.tell(`The live picture has ended: ${why}.`);
  },
);
const viewParts = { panel: byId("views"), list: byId("views-list"), words: byId("views-words") };
const views = new ViewStrip(viewParts, stored, models, (place) => {
  frame.show(place);
  // The view is shown in large where the reader sees it.
  bringIntoView(byId("frame-heading"));
});
document.addEventListener("keydown", (event) => {
  const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  const isOther = event.ctrlKey || event.altKey || event.metaKey || event.shiftKey;
  // Where arrows mean something else, they keep that meaning.
  const isUsed = event.target instanceof Element && event.target.closest(ARROWS_USED) !== null;
  if (step !== undefined && !isOther && !isUsed) frame.step(step);
});
/** Null until three.js is read, and in a browser without WebGL. */
let model: ModelView | null = null;
let isModelAsked = false;

let newest: Status | null = null;
let picturesShown = "";
/** The well that the operator chose. Without one the page follows the run. */
let pinned: string | null = null;
/** Parts of the page in which arrow keys move something else. */
const ARROWS_USED = "input, select, textarea, [role=region], #plate, #model-box, dialog";
/** Pause before a plate map that could not be read is read again, ms. */
const PLAN_AGAIN_MS = 5000;
/** What the page needs of a run's plan. */
type Planned = Pick<RunPlan, "plate_map" | "plate_format">;
const NO_PLAN: Planned = { plate_map: [] };
/** The plans of the newest runs, by run. They are read once. */
const plans = new Recent<Planned>(4);

const furthest = new Furthest();

const opened = new OpenedRun(byId, {
  opened() {
    pinned = null;
    redraw();
  },
  read: redraw,
});
new RunList(byId, (run) => void opened.open(run));
new BeadCharts(byId);

/** Reads what draws the model. Without it the page still shows all numbers. */
async function makeModel(): Promise<void> {
  const empty = byId("model-empty");
  const three = await import("./three.ts").catch(() => null);
  if (three === null) {
    // The connection was lost meanwhile: the next status asks again.
    isModelAsked = false;
    return;
  }
  try {
    const parts = {
      heading: byId("model-heading"),
      box: byId("model-box"),
      caption: byId("model-caption"),
      bar: byId("scale-bar"),
      barLabel: byId("scale-label"),
      empty,
      coloured: byId<HTMLInputElement>("with-colours"),
      colouredLabel: byId("with-colours-label"),
    };
    const made = new ModelView(three, parts, models, colouredModels);
    for (const button of document.querySelectorAll<HTMLButtonElement>("[data-look]")) {
      button.addEventListener("click", () => made.look(button.dataset["look"] as Look));
    }
    model = made;
  } catch {
    setText(empty, "This browser offers no WebGL, so the model cannot be drawn. All numbers are complete.");
    return;
  }
  picturesShown = "";
  redraw();
}

/** The well to show, in place of the live picture. With none the page follows the run. */
function choose(well: string | null): void {
  pinned = well;
  atRest.end();
  redraw();
}

/** Chooses a well from a list or a picture below, far from its card. */
function lookAt(well: string): void {
  choose(well);
  bringIntoView(byId("well-heading"));
}

function redraw(): void {
  if (newest) showAll(newest);
}

byId("follow").addEventListener("click", () => choose(null));

byId("save-table").addEventListener("click", () => {
  const run = newest && shown(newest).run?.id;
  if (run) void commands.attempt("The table was not saved", () => saveTable(run));
});

for (const [id, what] of [
  ["save-report", "report.html"],
  ["save-shape", "shape.csv"],
  ["save-groups", "groups.csv?spreadsheet=true"],
] as const) {
  byId(id).addEventListener("click", () => {
    const run = newest && shown(newest).run?.id;
    if (run) void commands.attempt("The file was not saved", () => saveOfRun(run, what));
  });
}

byId("measure-rest").addEventListener("click", () => {
  const run = newest && shown(newest).run?.id;
  if (run) void commands.attempt("The rest cannot be planned", async () => newRun.offer(await fetchRest(run), run));
});

/** Shows how many wells a run has left without numbers, where a run of them could start. */
function showRest(run: RunStatus | null): void {
  const left = run?.results.filter((w) => w.outcome === "aborted" || w.outcome === "interrupted").length ?? 0;
  const button = byId("measure-rest");
  show(button, left > 0 && run?.outcome !== null && newest !== null && canStart(newest));
  setText(button, `Measure the rest: ${counted(left, "well")}`);
}

/** The status whose run is shown: the instrument's own, or one made of the stored run that is opened. */
function shown(status: Status): Status {
  const detail = opened.instead(status);
  return detail === null ? status : asStatus(detail, status);
}

function showAll(status: Status): void {
  stored.see(status.run);
  instrument(status);
  const detail = opened.instead(status);
  run(shown(status), detail);
  pictures(shown(status), detail);
}

/** What the instrument does, whichever run is shown. */
function instrument(status: Status): void {
  byId("now").dataset["tone"] = toneOf(status);
  // The wall display has no commands.
  const isElsewhere = document.body.classList.contains("wall") && nextStep(status)?.button != null;
  setText(byId("sentence"), headline(status) + (isElsewhere ? " The button is on the operator's page." : ""));
  setText(byId("state"), STATES[status.state]);
  setText(byId("count"), count(status));
  setText(byId("finish"), finish(status));
  setText(byId("progress-line"), progressLine(status));
  const below = diagnosis(status);
  setText(byId("diagnosis"), below);
  show(byId("diagnosis"), below !== "");
  const bar = byId<HTMLProgressElement>("progress");
  bar.hidden = status.run === null;
  // A run that has ended shows what it has measured.
  bar.value = furthest.of(status.run?.outcome === null ? runKey(status.run) : null, progress(status));
  faults.update(status.faults, nextStep(status));
  commands.update(status);
  newRun.update(status);
  queue.update(status);
  rig.update(status);
}

/** The numbers of a run. `detail` is the stored one that is shown in the place of the instrument's. */
function run(status: Status, detail: RunDetail | null): void {
  const history = detail === null ? histories.live : histories.opened;
  history.take(status);
  setText(byId("plate-name"), detail === null ? plateName(status) : (status.plate.barcode ?? ""));
  const wells = status.run?.results ?? [];
  if (!wells.some((w) => w.well === pinned)) pinned = null;
  const chosen = chosenWell(status, pinned);
  const well = wells.find((w) => w.well === chosen) ?? null;
  const specimen = underWay(status);
  const plan = planOf(status.run, detail);
  const planned = new Map(plan.plate_map.map((one) => [one.well, one]));
  byId("follow").hidden = pinned === null || detail !== null;
  plate.update(wells, specimen, chosen, colouring.of(wells, plan.plate_map), plan.plate_format ?? null, planned);
  results.update(wells, chosen, planned);
  attention.update(wells);
  log.update(status.run, status.revision);
  groups.update(status.run);
  again.update(status.run, newest !== null && runsNow(newest));
  const isEmpty = wells.every((w) => w.outcome === null);
  for (const id of ["save-table", "save-report", "save-shape", "save-groups"]) byId(id).hidden = isEmpty;
  showRest(status.run);
  sheet.update(status.run);
  lastDone.update(status.run, chosen);
  remark.update(status.run, well, status.state === "Held" && detail === null);
  const hull_um3 = well ? (history.of(well.well).hulls_um3.at(-1) ?? null) : null;
  card.update(well, specimen, wells, hull_um3, well ? planned.get(well.well) : undefined);
  chart.update(
    well && {
      well: well.well,
      ...history.of(well.well),
      viewsPlanned: status.specimen?.views_planned ?? 0,
      hasEnded: well.outcome !== null,
      wait: specimen?.well === well.well ? specimen.volume_wait : null,
      measured: reported(well),
    },
  );
  if (status.run && well && isStored(well)) void recall(history, status.run, well.well);
}

/** The plan of a run: empty until it is read. */
function planOf(run: RunStatus | null, stored: RunDetail | null): Planned {
  if (stored !== null) return stored.plan;
  if (run === null) return NO_PLAN;
  const key = runKey(run);
  const known = plans.get(key);
  if (known) return known;
  plans.set(key, NO_PLAN);
  fetchRun(run.id).then(
    (detail) => {
      plans.set(key, detail.plan);
      redraw();
    },
    // Read again a little later, for example when the connection is back.
    () => setTimeout(() => plans.delete(key), PLAN_AGAIN_MS),
  );
  return NO_PLAN;
}

/** Loads the volumes of a well that ended before the page was opened, or while it was disconnected. */
async function recall(history: VolumeHistory, run: RunStatus, well: string): Promise<void> {
  const one = { run: run.id, started: run.started, well };
  const kept = await stored.of(one).catch(() => null);
  if (kept === null) return;
  const volumes = { hulls_um3: kept.hull_volumes_um3, estimates: kept.estimates };
  if (history.recall(run, well, volumes)) redraw();
}

function pictures(status: Status, detail: RunDetail | null): void {
  atRest.update(status, detail === null);
  if (atRest.isOn) return;
  const now = `${status.boot_id} ${status.revision} ${pinned} ${detail?.id}`;
  if (now === picturesShown) return;
  picturesShown = now;
  const subject = subjectOf(status, pinned);
  const specimen = status.specimen;
  const planned = (well: string) => (specimen?.well === well ? specimen.views_planned : null);
  // First the frame in large, then the strip of all views.
  void views.update(subject, frame.update(subject, planned));
  void model?.update(subject);
  void showRecord(subject);
}

/** Shows the files of a stored well, and where the numbers of a larva are among references. */
async function showRecord(subject: Subject): Promise<void> {
  const now = picturesShown;
  const one = subject.kind === "stored" ? subject : null;
  const kept = one && (await stored.of(one).catch(() => null));
  // Another well was chosen meanwhile.
  if (now !== picturesShown) return;
  files.update(kept);
  standing.update(standingsOf(kept?.measurement ?? null, kept?.result?.estimator ?? null));
}

void keepLive({
  link(link) {
    header.link(link);
    token.wanted(link.kind === "lost" && link.tokenWanted);
    // Reads that failed are repeated, also if the status has not changed.
    if (link.kind === "lost") picturesShown = "";
  },
  status(status) {
    // A page of another version could misread the answers of this daemon.
    if (newest && newest.version !== status.version) location.reload();
    newest = status;
    emergency.update(status);
    histories.live.take(status);
    header.status(status);
    opened.follow(status);
    showAll(status);
    // Last: what a browser does with notices and sound must not keep the numbers from the page.
    display.update(status);
    if (!isModelAsked) {
      isModelAsked = true;
      // Once the numbers are painted.
      requestAnimationFrame(() => setTimeout(() => void makeModel()));
    }
  },
});
