// A frame with its profile drawn over it: the newest, or a stored one of the well that the operator chose, which also has the outline of
// the model. All pictures are decoded before they are shown, and are replaced together. The text beside them names the specimen.

import { fetchFile, fetchLive, Refused, type Fetched, type Shown } from "./api.ts";
import { modelOutline, outlined } from "./develop.ts";
import { setText, show } from "./dom.ts";
import { counted } from "./format.ts";
import { Latest } from "./latest.ts";
import { organsOf } from "./ellipsoid.ts";
import { cameraOfView } from "./projection.ts";
import type { Specimen } from "./status.ts";
import { wellKey, type StoredModels, type StoredSpecimens, type StoredWell } from "./stored.ts";
import type { Subject } from "./subject.ts";
import { pictureOf, trianglesOf, viewNumber } from "./views.ts";

/** Frames taller than this are cropped to the strip around the capillary, which runs through the middle of the picture. */
const STRIP_RATIO = 3;

class Picture {
  tag: string | null = null;
  url: string | null = null;
  readonly #image: HTMLImageElement;

  constructor(image: HTMLImageElement) {
    this.#image = image;
  }

  /** Decodes the new picture off screen. The returned function shows it. */
  async prepare(body: Blob | null, tag: string | null): Promise<() => void> {
    if (body === null) {
      return () => {
        this.#replace(null, null);
        this.#image.removeAttribute("src");
      };
    }
    const url = URL.createObjectURL(body);
    const probe = new Image();
    probe.src = url;
    try {
      await probe.decode();
    } catch (error) {
      URL.revokeObjectURL(url);
      throw error;
    }
    return () => {
      this.#image.src = url;
      this.#replace(url, tag);
    };
  }

  #replace(url: string | null, tag: string | null): void {
    const old = this.url;
    this.url = url;
    this.tag = tag;
    // The old picture stays on screen until the new one is painted.
    if (old) setTimeout(() => URL.revokeObjectURL(old), 1000);
  }
}

export interface FrameParts {
  heading: HTMLElement;
  whose: HTMLElement;
  box: HTMLElement;
  frame: HTMLImageElement;
  profile: HTMLImageElement;
  model: HTMLImageElement;
  empty: HTMLElement;
  withProfile: HTMLInputElement;
  withModel: HTMLInputElement;
  withModelLabel: HTMLElement;
  whole: HTMLInputElement;
  viewLabel: HTMLElement;
  view: HTMLInputElement;
}

export class FrameView {
  readonly #parts: FrameParts;
  readonly #stored: StoredSpecimens;
  readonly #models: StoredModels;
  readonly #frame: Picture;
  readonly #profile: Picture;
  readonly #model: Picture;
  readonly #viewShown: (view: number | null) => void;
  readonly #refresh = new Latest(() => this.#load());
  #subject: Subject = { kind: "none", words: "No frame yet." };
  #planned: (well: string) => number | null = () => null;
  /** Run, well and view of the stored frame on screen. */
  #storedShown = "";
  /** Run and well for which a stored frame or a message is on screen. */
  #storedOf = "";

  /** `viewShown` is told the number of the stored view on screen, or null. */
  constructor(
    parts: FrameParts,
    stored: StoredSpecimens,
    models: StoredModels,
    viewShown: (view: number | null) => void,
  ) {
    this.#parts = parts;
    this.#stored = stored;
    this.#models = models;
    this.#viewShown = viewShown;
    this.#model = new Picture(parts.model);
    this.#frame = new Picture(parts.frame);
    this.#profile = new Picture(parts.profile);
    parts.withProfile.addEventListener("change", () => this.#lay());
    parts.withModel.addEventListener("change", () => this.#lay());
    parts.whole.addEventListener("change", () => this.#lay());
    parts.frame.addEventListener("load", () => this.#lay());
    parts.view.addEventListener("input", () => void this.#refresh.ask());
    this.#lay();
  }

  /** `planned` returns the planned number of views of a well, or null if it is not known. */
  update(subject: Subject, planned: (well: string) => number | null): Promise<void> {
    this.#subject = subject;
    this.#planned = planned;
    return this.#refresh.ask();
  }

  /** Shows a stored view of the well on screen, counted from 1. */
  show(view: number): void {
    this.#parts.view.value = String(view);
    void this.#refresh.ask();
  }

  /** Shows a picture of the instrument at rest, which is of no specimen. */
  async showAtRest(picture: Blob): Promise<void> {
    const swaps = [
      await this.#frame.prepare(picture, null),
      await this.#profile.prepare(null, null),
      await this.#model.prepare(null, null),
    ];
    for (const swap of swaps) swap();
    this.#storedShown = this.#storedOf = "";
    this.#viewShown(null);
    this.#say("Frame", "live picture, no run", false);
  }

  /** Shows the view so many places further, of a stored well with more than one. */
  step(by: number): void {
    const { view, viewLabel } = this.#parts;
    const place = Number(view.value) + by;
    if (!viewLabel.hidden && place >= 1 && place <= Number(view.max)) this.show(place);
  }

  #load(): Promise<void> {
    const subject = this.#subject;
    if (subject.kind === "stored") return this.#loadStored(subject);
    this.#storedOf = "";
    return subject.kind === "none" ? this.#clear(subject.words) : this.#loadLive(subject);
  }

  async #loadLive(subject: Subject & { kind: "live" }): Promise<void> {
    // A stored picture on screen has no tag.
    const [frame, profile] = await Promise.all([
      fetchLive("/v1/live/frame.jpg", this.#frame.tag),
      fetchLive("/v1/live/profile.png", this.#profile.tag),
    ]);
    const shown = frame.shown;
    const isMeant = shown?.run === subject.run && (subject.well === null || shown.well === subject.well);
    if (frame.kind === "none" || !isMeant) {
      return this.#clear(subject.well === null ? "No frame yet." : `No frame of ${subject.well} yet.`);
    }
    const swaps = [
      await this.#swap(this.#frame, frame),
      await this.#swap(this.#profile, profile),
      await this.#model.prepare(null, null),
    ];
    for (const swap of swaps) swap();
    this.#storedShown = "";
    // The profile of another view would not match the specimen. It is shown after the next update.
    this.#say(`Frame of ${shown.well}`, this.#liveWords(shown), sameViews(shown, profile.shown));
  }

  #liveWords({ well, views }: Shown): string {
    if (views === 0) return "before its first view";
    const planned = this.#planned(well);
    return planned === null ? `${counted(views, "view")} taken` : `${views} of ${counted(planned, "view")} taken`;
  }

  #swap(picture: Picture, fetched: Fetched): Promise<() => void> {
    if (fetched.kind === "same") return Promise.resolve(() => {});
    return fetched.kind === "none" ? picture.prepare(null, null) : picture.prepare(fetched.body, fetched.tag);
  }

  async #loadStored(one: StoredWell): Promise<void> {
    const of = wellKey(one);
    // The frame of another well must not stay beside the numbers of the chosen well while its own frame is read.
    if (of !== this.#storedOf) await this.#clear(`Reading the frames of ${one.well} …`);
    this.#storedOf = of;
    try {
      await this.#readStored(one, of);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      // The other views may still be readable.
      const { view } = this.#parts;
      const isOneOfMore = view.dataset["of"] === of && Number(view.max) > 1;
      const what = isOneOfMore ? `View ${view.value}` : "The frames";
      await this.#clear(`${what} of ${one.well} cannot be read: ${error.message}.`, isOneOfMore);
    }
  }

  async #readStored(one: StoredWell, of: string): Promise<void> {
    const { view } = this.#parts;
    const { well } = one;
    const specimen = await this.#stored.of(one);
    const { views: taken = [], detection = null } = specimen?.links ?? {};
    // A skipped well has only the frame that judged it.
    const views = taken.length === 0 && detection !== null ? [detection] : taken;
    if (!specimen || views.length === 0) return this.#clear(`No frames of ${well} are kept.`);
    if (view.dataset["of"] !== of) {
      view.dataset["of"] = of;
      view.max = String(views.length);
      view.value = "1";
    }
    const index = Math.min(Number(view.value), views.length) - 1;
    const key = `${of}/${index}`;
    if (key !== this.#storedShown) {
      const number = viewNumber(views[index]!);
      // Found by its view number: a view without a profile is missing from the list.
      const mask = number === null ? undefined : specimen.links.profiles.find((link) => viewNumber(link) === number);
      const fins = specimen.measurement?.views.find(({ index }) => index === number)?.fins_px ?? [];
      const [frame, profile] = await Promise.all([
        fetchFile(pictureOf(views[index]!)),
        mask === undefined ? null : fetchFile(mask).then((file) => outlined(file, fins)),
      ]);
      const swaps = [
        await this.#frame.prepare(frame, null),
        await this.#profile.prepare(profile, null),
        await this.#model.prepare(null, null),
      ];
      for (const swap of swaps) swap();
      this.#storedShown = key;
      this.#viewShown(number);
      // The model may take a moment longer to read than the frame.
      void this.#drawModel(one, specimen, number, key);
    }
    if (views === taken) this.#say(`Frame of ${well}`, `view ${index + 1} of ${views.length}`, true, true);
    else this.#say(`Frame of ${well}`, "as it was found", true);
  }

  /** Draws the outline of the model over the frame that is on screen. */
  async #drawModel(one: StoredWell, specimen: Specimen, view: number | null, key: string): Promise<void> {
    const outline = await this.#outlineOf(one, specimen, view);
    // Another view was chosen meanwhile.
    if (this.#storedShown !== key) return;
    const swap = await this.#model.prepare(outline, null);
    if (this.#storedShown !== key) return;
    swap();
    this.#lay();
  }

  /** The outline of the model as this view sees it. A model that cannot be read leaves the frame without it. */
  async #outlineOf(one: StoredWell, specimen: Specimen, view: number | null): Promise<Blob | null> {
    const seen = view === null ? null : cameraOfView(specimen.recording, specimen.measurement, view);
    if (seen === null) return null;
    try {
      const model = await this.#models.of(one);
      const organs = organsOf(specimen.measurement);
      return model && (await modelOutline(trianglesOf(model), organs, seen.projection, seen.width, seen.height));
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      return null;
    }
  }

  async #clear(words: string, isStored = false): Promise<void> {
    for (const picture of [this.#frame, this.#profile, this.#model]) (await picture.prepare(null, null))();
    this.#storedShown = "";
    this.#viewShown(null);
    setText(this.#parts.empty, words);
    this.#say("Frame", "", false, isStored);
  }

  #say(heading: string, whose: string, hasProfile: boolean, isStored = false): void {
    const { heading: head, whose: words, box, view, viewLabel } = this.#parts;
    setText(head, heading);
    setText(words, whose);
    box.classList.toggle("without-profile", !hasProfile);
    show(viewLabel, isStored);
    view.setAttribute("aria-valuetext", whose);
    this.#lay();
  }

  #lay(): void {
    const { box, frame, profile, model, empty, withProfile, withModel, withModelLabel, whole } = this.#parts;
    const has = this.#frame.url !== null;
    show(model, has && this.#model.url !== null && withModel.checked);
    show(withModelLabel, has && this.#model.url !== null);
    show(frame, has);
    show(empty, !has);
    show(
      profile,
      has && this.#profile.url !== null && withProfile.checked && !box.classList.contains("without-profile"),
    );
    const { naturalWidth: width, naturalHeight: height } = frame;
    if (!width || !height) return;
    box.style.aspectRatio = String(whole.checked ? width / height : Math.max(width / height, STRIP_RATIO));
  }
}

function sameViews(a: Shown, b: Shown | null): boolean {
  return b !== null && a.run === b.run && a.well === b.well && a.views === b.views;
}
