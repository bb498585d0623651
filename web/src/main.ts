// The operator's page: one status in, every view updated from it.
//
//   keepLive ── Status ──> header, sentence, faults, plate, well, chart, rig      (numbers, at once)
//                     └──> frame, model                                           (fetched when the revision changed)

import { VolumeChart } from "./chart.ts";
import { CommandRow } from "./commands.ts";
import { keepLive } from "./connection.ts";
import { byId, setText } from "./dom.ts";
import { FaultsView } from "./faults.ts";
import { counted } from "./format.ts";
import { FrameView } from "./frame.ts";
import { HeaderView } from "./header.ts";
import { VolumeHistory } from "./history.ts";
import { ModelView, type Look } from "./model.ts";
import { NewRun } from "./newrun.ts";
import { PlateView } from "./plate.ts";
import { progress, progressLine, sentence, toneOf } from "./plain.ts";
import { RigView } from "./rig.ts";
import type { Status } from "./status.ts";
import { TokenForm } from "./token.ts";
import { WellCard } from "./wellcard.ts";

const header = new HeaderView({
  stamp: byId("stamp"),
  version: byId("version"),
  link: byId("link"),
  lost: byId("lost"),
});
const faults = new FaultsView(byId("faults"), byId("fault-list"));
const plate = new PlateView(byId("plate"), byId("legend"), choose);
const card = new WellCard(byId("well-heading"), byId("well-body"));
const chart = new VolumeChart(byId("chart"), byId("chart-caption"));
const rig = new RigView(byId("rig"));
const commands = new CommandRow(byId);
const newRun = new NewRun(byId);
const token = new TokenForm(byId("token-form"), byId("token"));
const history = new VolumeHistory();
const frame = new FrameView({
  box: byId("frame-box"),
  frame: byId("frame-image"),
  profile: byId("profile-image"),
  empty: byId("frame-empty"),
  withProfile: byId("with-profile"),
  whole: byId("whole-frame"),
});
const model = makeModel();

let newest: Status | null = null;
let revisionShown = "";
/** The well the operator asked for; without one the page follows the run. */
let pinned: string | null = null;

/** Without WebGL the page still shows every number. */
function makeModel(): ModelView | null {
  try {
    const made = new ModelView({
      box: byId("model-box"),
      caption: byId("model-caption"),
      bar: byId("scale-bar"),
      barLabel: byId("scale-label"),
      empty: byId("model-empty"),
    });
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

function choose(well: string): void {
  pinned = well;
  if (newest) numbers(newest);
}

byId("follow").addEventListener("click", () => {
  pinned = null;
  if (newest) numbers(newest);
});

/** The well to show: the operator's, or the one under way, or the last that ended. */
function chosenWell(status: Status): string | null {
  const wells = status.run?.results ?? [];
  if (pinned !== null && wells.some((w) => w.well === pinned)) return pinned;
  pinned = null;
  const current = status.specimen?.well;
  if (current !== undefined && wells.some((w) => w.well === current)) return current;
  const ended = wells.filter((w) => w.outcome !== null);
  return (ended.findLast((w) => w.volume_um3 !== null) ?? ended.at(-1) ?? wells[0])?.well ?? null;
}

function numbers(status: Status): void {
  const tone = toneOf(status);
  byId("now").dataset["tone"] = tone;
  setText(byId("sentence"), sentence(status));
  setText(byId("state"), status.state);
  setText(byId("progress-line"), progressLine(status));
  const bar = byId<HTMLProgressElement>("progress");
  bar.hidden = status.run === null;
  bar.value = progress(status);
  setText(byId("plate-name"), plateName(status));
  faults.update(status.faults);
  commands.update(status);
  newRun.update(status);
  rig.update(status);

  const wells = status.run?.results ?? [];
  const chosen = chosenWell(status);
  const well = wells.find((w) => w.well === chosen) ?? null;
  byId("follow").hidden = pinned === null;
  plate.update(wells, status.specimen, chosen);
  card.update(well, status.specimen);
  chart.update(
    well && {
      well: well.well,
      volumes_um3: history.of(well.well),
      viewsPlanned: status.specimen?.views_planned ?? 0,
      measured_um3: well.volume_um3,
    },
  );
}

function plateName(status: Status): string {
  const { barcode, needs, removable, present } = status.plate;
  const parts = [barcode === null ? "no plate named" : barcode];
  if (needs !== null) parts.push(`waits for: ${needs}`);
  else if (present) parts.push(removable ? "may be taken out" : "leave it in place");
  return parts.join(" · ");
}

function pictures(status: Status): void {
  const revision = `${status.boot_id} ${status.revision}`;
  if (revision === revisionShown) return;
  revisionShown = revision;
  void frame.update();
  const specimen = status.specimen;
  if (specimen) void model?.update(`${specimen.well} after ${counted(specimen.hull_volumes_um3.length, "view")}`);
  else void model?.update("Last specimen");
}

void keepLive({
  link(link) {
    header.link(link);
    token.wanted(link.kind === "lost" && link.tokenWanted);
  },
  status(status) {
    newest = status;
    history.take(status);
    header.status(status);
    numbers(status);
    pictures(status);
  },
});
