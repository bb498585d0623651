// Zoom, pan and contrast of the frame: the pictures that lie over each other are moved together, and the contrast is that of the frame alone.
//
//   wheel or + and − ──> larger about the pointer     drag ──> moved     0 or a double click ──> as it was     slider ──> contrast

/** What part of the pictures is shown: `scale` times as large, moved by so many pixels of the page. */
export interface Place {
  scale: number;
  x: number;
  y: number;
}

export const WHOLE: Place = { scale: 1, x: 0, y: 0 };
/** Largest magnification: single pixels of the camera are then some mm. */
const MOST = 16;
/** Magnification of one step of the wheel or of a key. */
const STEP = 1.25;

const between = (value: number, least: number, most: number) => Math.min(Math.max(value, least), most);

/** The pictures never leave the box: what is beyond its edges is always picture. Pure. */
export function kept({ scale, x, y }: Place, width: number, height: number): Place {
  const bounded = between(scale, 1, MOST);
  return {
    scale: bounded,
    x: between(x, width * (1 - bounded), 0),
    y: between(y, height * (1 - bounded), 0),
  };
}

/** Magnifies by a factor about a point of the box, which stays where it is. Pure. */
export function about(place: Place, factor: number, px: number, py: number, width: number, height: number): Place {
  const scale = between(place.scale * factor, 1, MOST);
  const by = scale / place.scale;
  return kept({ scale, x: px - (px - place.x) * by, y: py - (py - place.y) * by }, width, height);
}

export class Zoom {
  readonly #box: HTMLElement;
  readonly #images: readonly HTMLElement[];
  readonly #frame: HTMLElement;
  readonly #contrast: HTMLInputElement;
  #place = WHOLE;
  #from: { x: number; y: number; place: Place } | null = null;

  constructor(box: HTMLElement, frame: HTMLElement, over: readonly HTMLElement[], contrast: HTMLInputElement) {
    this.#box = box;
    this.#frame = frame;
    this.#images = [frame, ...over];
    this.#contrast = contrast;
    box.addEventListener(
      "wheel",
      (event) => {
        // The page scrolls on where there is nothing to make smaller.
        if (event.deltaY > 0 && this.#place.scale === 1) return;
        event.preventDefault();
        const { left, top } = box.getBoundingClientRect();
        this.#by(event.deltaY < 0 ? STEP : 1 / STEP, event.clientX - left, event.clientY - top);
      },
      { passive: false },
    );
    box.addEventListener("pointerdown", (event) => {
      if (this.#place.scale === 1 || event.button !== 0) return;
      this.#from = { x: event.clientX, y: event.clientY, place: this.#place };
      box.setPointerCapture(event.pointerId);
    });
    box.addEventListener("pointermove", (event) => {
      if (this.#from === null) return;
      const { x, y, place } = this.#from;
      this.#to({ ...place, x: place.x + event.clientX - x, y: place.y + event.clientY - y });
    });
    for (const end of ["pointerup", "pointercancel"]) box.addEventListener(end, () => (this.#from = null));
    // The browser would drag the picture as a file, and end the movement.
    box.addEventListener("dragstart", (event) => {
      if (this.#from !== null) event.preventDefault();
    });
    box.addEventListener("dblclick", () => this.reset());
    box.addEventListener("keydown", (event) => {
      const [x, y] = [box.clientWidth / 2, box.clientHeight / 2];
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      if (event.key === "+" || event.key === "=") this.#by(STEP, x, y);
      else if (event.key === "-") this.#by(1 / STEP, x, y);
      else if (event.key === "0") this.reset();
    });
    contrast.addEventListener("input", () => this.#lay());
  }

  /** Shows the whole picture, as the camera took it. */
  reset(): void {
    this.#contrast.value = "1";
    this.#to(WHOLE);
  }

  #by(factor: number, x: number, y: number): void {
    this.#to(about(this.#place, factor, x, y, this.#box.clientWidth, this.#box.clientHeight));
  }

  #to(place: Place): void {
    this.#place = kept(place, this.#box.clientWidth, this.#box.clientHeight);
    this.#lay();
  }

  #lay(): void {
    const { scale, x, y } = this.#place;
    for (const image of this.#images)
      image.style.transform = scale === 1 ? "" : `translate(${x}px, ${y}px) scale(${scale})`;
    const contrast = Number(this.#contrast.value);
    this.#frame.style.filter = contrast === 1 ? "" : `contrast(${contrast})`;
    this.#box.classList.toggle("frame-zoomed", scale > 1);
    this.#box.dataset["scale"] = scale.toFixed(2);
  }
}
