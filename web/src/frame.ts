// The newest frame with the profile drawn over it. Both pictures are swapped together, decoded before they are shown.

import { fetchLive, type Fetched } from "./api.ts";
import { show } from "./dom.ts";
import { Latest } from "./latest.ts";

/** Frames taller than this are cut to the strip around the capillary, which runs along the picture's middle. */
const STRIP_RATIO = 3;

class LivePicture {
  tag: string | null = null;
  url: string | null = null;
  readonly #path: string;
  readonly #image: HTMLImageElement;

  constructor(path: string, image: HTMLImageElement) {
    this.#path = path;
    this.#image = image;
  }

  fetch(): Promise<Fetched> {
    return fetchLive(this.#path, this.tag);
  }

  /** Decodes the new picture off screen; showing it is the returned step. */
  async prepare(fetched: Fetched): Promise<() => void> {
    if (fetched.kind === "same") return () => {};
    if (fetched.kind === "none") {
      return () => {
        this.#replace(null, null);
        this.#image.removeAttribute("src");
      };
    }
    const url = URL.createObjectURL(fetched.body);
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
      this.#replace(url, fetched.tag);
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

export class FrameView {
  readonly #box: HTMLElement;
  readonly #frameImage: HTMLImageElement;
  readonly #profileImage: HTMLImageElement;
  readonly #empty: HTMLElement;
  readonly #withProfile: HTMLInputElement;
  readonly #whole: HTMLInputElement;
  readonly #frame: LivePicture;
  readonly #profile: LivePicture;
  readonly #refresh = new Latest(() => this.#load());

  constructor(root: {
    box: HTMLElement;
    frame: HTMLImageElement;
    profile: HTMLImageElement;
    empty: HTMLElement;
    withProfile: HTMLInputElement;
    whole: HTMLInputElement;
  }) {
    this.#box = root.box;
    this.#frameImage = root.frame;
    this.#profileImage = root.profile;
    this.#empty = root.empty;
    this.#withProfile = root.withProfile;
    this.#whole = root.whole;
    this.#frame = new LivePicture("/v1/live/frame.jpg", root.frame);
    this.#profile = new LivePicture("/v1/live/profile.png", root.profile);
    root.withProfile.addEventListener("change", () => this.#lay());
    root.whole.addEventListener("change", () => this.#lay());
    root.frame.addEventListener("load", () => this.#lay());
    this.#lay();
  }

  update(): Promise<void> {
    return this.#refresh.ask();
  }

  async #load(): Promise<void> {
    const [frame, profile] = await Promise.all([this.#frame.fetch(), this.#profile.fetch()]);
    const swaps = await Promise.all([this.#frame.prepare(frame), this.#profile.prepare(profile)]);
    for (const swap of swaps) swap();
    this.#lay();
  }

  #lay(): void {
    const has = this.#frame.url !== null;
    show(this.#frameImage, has);
    show(this.#empty, !has);
    show(this.#profileImage, has && this.#profile.url !== null && this.#withProfile.checked);
    const { naturalWidth: width, naturalHeight: height } = this.#frameImage;
    if (!width || !height) return;
    const ratio = this.#whole.checked ? width / height : Math.max(width / height, STRIP_RATIO);
    this.#box.style.aspectRatio = String(ratio);
  }
}
