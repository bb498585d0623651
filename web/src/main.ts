// The operator's page: every view is updated from one status.
//
//   keepLive ── Status ──> header, sentence, faults, plate, well, chart, rig      (numbers, at once)
//                     └──> frame, model                                           (fetched when the revision or the subject changed)
//                             └── live, or stored for the well that the operator chose: subject.ts

import { AttentionList } from "./attention.ts";
import { VolumeChart } from "./chart.ts";
import { CommandRow } from "./commands.ts";
import { keepLive } from "./connection.ts";
import { byId, setText, show } from "./dom.ts";
import { EmergencyStop } from "./emergency.ts";
import { FaultsView } from "./faults.ts";
import { FrameView } from "./frame.ts";
import { HeaderView } from "./header.ts";
import { VolumeHistory } from "./history.ts";
import { ModelView, type Look } from "./model.ts";
import { NewRun } from "./newrun.ts";
import { PlateView } from "./plate.ts";
import { diagnosis, headline, nextStep, progress, progressLine, STATES, toneOf, underWay } from "./plain.ts";
import { RigView } from "./rig.ts";
import type { RunStatus, Status } from "./status.ts";
import { StoredSpecimens } from "./stored.ts";
import { chosenWell, isStored, subjectOf } from "./subject.ts";
import { saveTable } from "./table.ts";
import { TokenForm } from "./token.ts";
import { WellCard } from "./wellcard.ts";

// First: whatever fails below, the stop works.
const emergency = new EmergencyStop(byId("emergency-stop"), byId("emergency-answer"));
const header = new HeaderView({
  stamp: byId("stamp"),
  version: byId("version"),
  link: byId("link"),
  lost: byId("lost"),
});
const faults = new FaultsView(byId("faults"), byId("fault-list"));
const plate = new PlateView(byId("plate"), byId("legend"), choose);
const attention = new AttentionList(byId("attention"), byId("attention-list"), choose);
const card = new WellCard(byId("well-heading"), byId("well-body"));
const chart = new VolumeChart(byId("chart"), byId("chart-caption"), byId<HTMLInputElement>("with-hull"));
const rig = new RigView(byId("rig"));
const commands = new CommandRow(byId);
const newRun = new NewRun(byId);
const token = new TokenForm(byId("token-form"), byId("token"));
const history = new VolumeHistory();
const stored = new StoredSpecimens();
const frameParts = {
  heading: byId("frame-heading"),
  whose: byId("frame-whose"),
  box: byId("frame-box"),
  frame: byId<HTMLImageElement>("frame-image"),
  profile: byId<HTMLImageElement>("profile-image"),
  empty: byId("frame-empty"),
  withProfile: byId<HTMLInputElement>("with-profile"),
  whole: byId<HTMLInputElement>("whole-frame"),
  viewLabel: byId("frame-view-label"),
  view: byId<HTMLInputElement>("frame-view"),
};
const frame = new FrameView(frameParts, stored);
const model = makeModel();

let newest: Status | null = null;
let picturesShown = "";
/** The well that the operator chose. Without one the page follows the run. */
let pinned: string | null = null;

/** Without WebGL the page still shows all numbers. */
function makeModel(): ModelView | null {
  try {
    const parts = {
      heading: byId("model-heading"),
      box: byId("model-box"),
      caption: byId("model-caption"),
      bar: byId("scale-bar"),
      barLabel: byId("scale-label"),
      empty: byId("model-empty"),
    };
    const made = new ModelView(parts, stored);
    for (const button of document.querySelectorAll<HTMLButtonElement>("[data-look]")) {
      button.addEventListener("click", () => made.look(button.dataset["look"] as Look));
    }
    return made;
  } catch {
    setText(
      byId("model-empty"),
      "This browser offers no WebGL, so the model cannot be drawn. All numbers are complete.",
    );
    return null;
  }
}

/** The well to show. With none the page follows the run. */
function choose(well: string | null): void {
  pinned = well;
  if (newest) showAll(newest);
}

byId("follow").addEventListener("click", () => choose(null));

byId("save-table").addEventListener("click", () => {
  const run = newest?.run?.id;
  if (run !== undefined) void commands.attempt("The table was not saved", () => saveTable(run));
});

function showAll(status: Status): void {
  numbers(status);
  pictures(status);
}

function numbers(status: Status): void {
  const tone = toneOf(status);
  byId("now").dataset["tone"] = tone;
  setText(byId("sentence"), headline(status));
  setText(byId("state"), STATES[status.state]);
  setText(byId("progress-line"), progressLine(status));
  const below = diagnosis(status);
  setText(byId("diagnosis"), below);
  show(byId("diagnosis"), below !== "");
  const bar = byId<HTMLProgressElement>("progress");
  bar.hidden = status.run === null;
  bar.value = progress(status);
  setText(byId("plate-name"), plateName(status));
  faults.update(status.faults, nextStep(status));
  commands.update(status);
  newRun.update(status);
  rig.update(status);

  const wells = status.run?.results ?? [];
  if (!wells.some((w) => w.well === pinned)) pinned = null;
  const chosen = chosenWell(status, pinned);
  const well = wells.find((w) => w.well === chosen) ?? null;
  const specimen = underWay(status);
  byId("follow").hidden = pinned === null;
  plate.update(wells, specimen, chosen);
  attention.update(wells);
  byId("save-table").hidden = wells.every((w) => w.outcome === null);
  card.update(well, specimen, wells, well ? (history.of(well.well).hulls_um3.at(-1) ?? null) : null);
  chart.update(
    well && {
      well: well.well,
      ...history.of(well.well),
      viewsPlanned: status.specimen?.views_planned ?? 0,
      hasEnded: well.outcome !== null,
      measured: well.volume_um3 === null ? null : { volume_um3: well.volume_um3, sd_um3: well.volume_sd_um3 },
    },
  );
  if (status.run && well && isStored(well)) void recall(status.run, well.well);
}

/** Loads the volumes of a well that ended before the page was opened, or while it was disconnected. */
async function recall(run: RunStatus, well: string): Promise<void> {
  const one = { run: run.id, started: run.started, well };
  const kept = await stored.of(one).catch(() => null);
  if (kept === null) return;
  const volumes = { hulls_um3: kept.hull_volumes_um3, estimates: kept.estimates };
  if (history.recall(run, well, volumes) && newest) numbers(newest);
}

function plateName(status: Status): string {
  const { barcode, needs, removable, present } = status.plate;
  const parts = [barcode === null ? "no plate named" : barcode];
  if (needs !== null) parts.push("waits for the loader");
  else if (present) parts.push(removable ? "may be taken out" : "leave it in place");
  return parts.join(" · ");
}

function pictures(status: Status): void {
  const now = `${status.boot_id} ${status.revision} ${pinned}`;
  if (now === picturesShown) return;
  picturesShown = now;
  const subject = subjectOf(status, pinned);
  const specimen = status.specimen;
  void frame.update(subject, (well) => (specimen?.well === well ? specimen.views_planned : null));
  void model?.update(subject);
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
    history.take(status);
    header.status(status);
    showAll(status);
  },
});
