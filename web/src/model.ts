// The growing model in 3D: one mesh, replaced after a new one was parsed, and drawn only after a change.
//
// The camera is orthographic, so that the scale bar holds in the whole picture. The first direction is that of the instrument's own camera
// at angle 0: x (the capillary) to the right, y down, the camera at negative z.

import type {
  Box3,
  BufferGeometry,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  OrthographicCamera,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import type { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { fetchLive, Refused } from "./api.ts";
import { setText, show } from "./dom.ts";
import { parseGlb } from "./glb.ts";
import { counted, grouped, micrometres } from "./format.ts";
import { Latest } from "./latest.ts";
import { wellKey, type StoredModels, type StoredWell } from "./stored.ts";
import type { Subject } from "./subject.ts";
import { roundBelow } from "./ticks.ts";

/** The module of three.js, which main.ts reads after the first status. */
type Three = typeof import("./three.ts");

/** Directions from the specimen to the eye, of any length. */
const LOOKS = {
  camera: [0, 0, -1],
  oblique: [0.55, -0.45, -1],
  along: [1, 0, 0],
  // Not quite along the upward direction, which leaves open where right is. So the capillary points to the right, as in the camera's look.
  above: [0, -1, -1e-3],
} as const;

export type Look = keyof typeof LOOKS;

/** Share of the picture for the longer side of the specimen. */
const FILL = 0.86;
const KEY_STEP_RAD = Math.PI / 24;
const KEY_ZOOM = 1.2;
const TARGET_BAR_PX = 140;

export class ModelView {
  readonly #three: Three;
  readonly #stored: StoredModels;
  readonly #storedColoured: StoredModels;
  readonly #coloured: HTMLInputElement;
  readonly #colouredLabel: HTMLElement;
  readonly #heading: HTMLElement;
  readonly #box: HTMLElement;
  readonly #caption: HTMLElement;
  readonly #bar: HTMLElement;
  readonly #barLabel: HTMLElement;
  readonly #empty: HTMLElement;
  readonly #renderer: WebGLRenderer;
  readonly #scene: Scene;
  readonly #camera: OrthographicCamera;
  readonly #controls: OrbitControls;
  readonly #material: MeshStandardMaterial;
  /** The frames have their light already. */
  readonly #ofFrames: MeshBasicMaterial;
  readonly #mesh: Mesh<BufferGeometry, MeshStandardMaterial | MeshBasicMaterial>;
  readonly #refresh = new Latest(() => this.#load());
  #extent: Box3 | null = null;
  #tag: string | null = null;
  /** Run and well of the stored model on screen. */
  #storedShown = "";
  /** Run and well for which a stored model or a message is on screen. */
  #storedOf = "";
  #subject: Subject = { kind: "none", words: "No model yet." };
  #drawAsked = false;
  /** The operator has turned or zoomed: the view is not changed until another direction is chosen. */
  #held = false;

  constructor(
    three: Three,
    root: {
      heading: HTMLElement;
      box: HTMLElement;
      caption: HTMLElement;
      bar: HTMLElement;
      barLabel: HTMLElement;
      empty: HTMLElement;
      coloured: HTMLInputElement;
      colouredLabel: HTMLElement;
    },
    stored: StoredModels,
    storedColoured: StoredModels,
  ) {
    this.#three = three;
    this.#scene = new three.Scene();
    this.#camera = new three.OrthographicCamera();
    this.#material = new three.MeshStandardMaterial({ color: 0x6f9fb8, roughness: 0.62, metalness: 0 });
    this.#ofFrames = new three.MeshBasicMaterial({ vertexColors: true });
    this.#mesh = new three.Mesh<BufferGeometry, MeshStandardMaterial | MeshBasicMaterial>(undefined, this.#material);
    this.#stored = stored;
    this.#storedColoured = storedColoured;
    this.#coloured = root.coloured;
    this.#colouredLabel = root.colouredLabel;
    this.#coloured.addEventListener("change", () => void this.#refresh.ask());
    this.#heading = root.heading;
    this.#box = root.box;
    this.#caption = root.caption;
    this.#bar = root.bar;
    this.#barLabel = root.barLabel;
    this.#empty = root.empty;
    this.#renderer = new three.WebGLRenderer({ antialias: true, alpha: true });
    const canvas = this.#renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute(
      "aria-label",
      "Model of the specimen in 3D. Arrow keys turn it, plus and minus zoom, Home resets the view.",
    );
    this.#box.prepend(canvas);

    const key = new three.DirectionalLight(0xffffff, 2.2);
    // From above the left shoulder, and so far away that the positions of eye and model do not affect the direction.
    key.position.set(-0.5, 0.9, 1).multiplyScalar(1e6);
    this.#camera.add(key);
    const sky = new three.HemisphereLight(0xffffff, 0x8899aa, 1.3);
    sky.position.set(0, -1, 0);
    this.#scene.add(this.#camera, sky, this.#mesh);
    this.#mesh.visible = false;

    this.#camera.up.set(0, -1, 0);
    this.#controls = new three.OrbitControls(this.#camera, canvas);
    this.#controls.addEventListener("change", () => this.#draw());
    this.#controls.addEventListener("start", () => (this.#held = true));
    canvas.addEventListener("keydown", (event) => this.#key(event));
    canvas.addEventListener("webglcontextrestored", () => this.#draw());
    new ResizeObserver(() => this.#resize()).observe(this.#box);
    this.look("oblique");
  }

  update(subject: Subject): Promise<void> {
    this.#subject = subject;
    return this.#refresh.ask();
  }

  look(name: Look): void {
    this.#held = false;
    const direction = new this.#three.Vector3(...LOOKS[name]).normalize();
    this.#camera.position.copy(this.#controls.target).addScaledVector(direction, this.#distance());
    this.#frame();
  }

  async #load(): Promise<void> {
    const subject = this.#subject;
    if (subject.kind !== "stored") show(this.#colouredLabel, false);
    if (subject.kind === "stored") return this.#loadStored(subject);
    this.#storedOf = "";
    if (subject.kind === "none") this.#clear(subject.words);
    else await this.#loadLive(subject);
  }

  async #loadLive(subject: Subject & { kind: "live" }): Promise<void> {
    // A stored model on screen has no tag.
    const fetched = await fetchLive("/v1/live/mesh.glb", this.#tag);
    const shown = fetched.shown;
    const isMeant = shown?.run === subject.run && (subject.well === null || shown.well === subject.well);
    if (fetched.kind === "none" || !isMeant) {
      this.#clear(`No model${isMeant ? ` of ${shown.well}` : ""} yet: it begins with the first view.`);
      return;
    }
    if (fetched.kind === "new") {
      this.#put(await parseGlb(fetched.body));
      this.#tag = fetched.tag;
      this.#storedShown = "";
    }
    this.#describe(shown.well, `after ${counted(shown.views, "view")}`);
  }

  async #loadStored(one: StoredWell): Promise<void> {
    const key = wellKey(one);
    // The model of another well must not stay beside the numbers of the chosen well while its own model is read.
    if (key !== this.#storedOf) this.#clear(`Reading the model of ${one.well} …`);
    this.#storedOf = key;
    try {
      await this.#readStored(one, key);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      this.#clear(`The model of ${one.well} cannot be read: ${error.message}.`);
    }
  }

  async #readStored(one: StoredWell, key: string): Promise<void> {
    const { well } = one;
    const hasColours = await this.#storedColoured.has(one);
    show(this.#colouredLabel, hasColours);
    const coloured = hasColours && this.#coloured.checked;
    const now = `${key} ${coloured}`;
    if (now !== this.#storedShown) {
      const found = await (coloured ? this.#storedColoured : this.#stored).of(one);
      if (!found) {
        this.#clear(`No model of ${well} is kept.`);
        return;
      }
      this.#put(found);
      this.#tag = null;
      this.#storedShown = now;
    }
    this.#describe(well, coloured ? "as it was measured, with the colours of its frames" : "as it was measured");
  }

  #put(geometry: BufferGeometry): void {
    if (!geometry.getAttribute("normal")) geometry.computeVertexNormals();
    geometry.computeBoundingBox();
    const old = this.#mesh.geometry;
    this.#mesh.geometry = geometry;
    this.#mesh.material = geometry.hasAttribute("color") ? this.#ofFrames : this.#material;
    this.#mesh.visible = true;
    old.dispose();
    this.#extent = geometry.boundingBox!.clone();
    if (!this.#held) this.#recentre();
    const index = geometry.getIndex();
    const corners = index ? index.count : geometry.getAttribute("position").count;
    this.#box.dataset["triangles"] = String(corners / 3);
    show(this.#empty, false);
    show(this.#bar, true);
    this.#draw();
  }

  #clear(words: string): void {
    this.#mesh.visible = false;
    this.#extent = null;
    this.#tag = null;
    this.#storedShown = "";
    setText(this.#heading, "Model");
    setText(this.#caption, "");
    setText(this.#empty, words);
    show(this.#empty, true);
    show(this.#bar, false);
    this.#draw();
  }

  #describe(well: string, when: string): void {
    const size = this.#extent!.getSize(this.#vector());
    const dimensions = `${grouped(size.x)} × ${grouped(size.y)} × ${micrometres(size.z)}`;
    setText(this.#heading, `Model of ${well}`);
    setText(this.#caption, `${well} ${when}: ${dimensions} (x along the capillary, y, z).`);
  }

  #vector(): Vector3 {
    return new this.#three.Vector3();
  }

  #distance(): number {
    return this.#extent ? this.#extent.getSize(this.#vector()).length() * 2 : 10_000;
  }

  /** Moves target and eye to the middle of the model, without changing the direction. */
  #recentre(): void {
    if (!this.#extent) return;
    const middle = this.#extent.getCenter(this.#vector());
    const direction = this.#camera.position.clone().sub(this.#controls.target).normalize();
    this.#controls.target.copy(middle);
    this.#camera.position.copy(middle).addScaledVector(direction, this.#distance());
    this.#frame();
  }

  /** Sets the zoom so that the box of the model fills the picture in this direction. */
  #frame(): void {
    const camera = this.#camera;
    const distance = this.#distance();
    camera.near = -distance;
    camera.far = distance * 4;
    this.#controls.update();
    if (this.#extent) {
      camera.updateMatrixWorld(true);
      const inverse = camera.matrixWorldInverse;
      const seen = this.#extent.clone().applyMatrix4(inverse).getSize(this.#vector());
      const { clientWidth: width, clientHeight: height } = this.#box;
      camera.zoom = FILL * Math.min(width / Math.max(seen.x, 1), height / Math.max(seen.y, 1));
    }
    camera.updateProjectionMatrix();
    this.#draw();
  }

  /** At zoom 1, one unit of the scene (um) is one pixel of the page. */
  #resize(): void {
    const { clientWidth: width, clientHeight: height } = this.#box;
    if (width === 0 || height === 0) return;
    this.#renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.#renderer.setSize(width, height);
    Object.assign(this.#camera, { left: -width / 2, right: width / 2, top: height / 2, bottom: -height / 2 });
    this.#camera.updateProjectionMatrix();
    if (this.#held) this.#paint();
    else this.#frame();
    // Setting the size clears the canvas. Painting in the same turn avoids flicker.
    this.#paint();
  }

  #key(event: KeyboardEvent): void {
    const turns: Record<string, [number, number]> = {
      ArrowLeft: [-KEY_STEP_RAD, 0],
      ArrowRight: [KEY_STEP_RAD, 0],
      ArrowUp: [0, -KEY_STEP_RAD],
      ArrowDown: [0, KEY_STEP_RAD],
    };
    const turn = turns[event.key];
    if (turn) this.#turn(...turn);
    else if (event.key === "+" || event.key === "=") this.#zoom(KEY_ZOOM);
    else if (event.key === "-") this.#zoom(1 / KEY_ZOOM);
    else if (event.key === "Home") this.look("oblique");
    else return;
    event.preventDefault();
  }

  #turn(theta: number, phi: number): void {
    this.#held = true;
    const camera = this.#camera;
    const { Quaternion, Spherical, Vector3 } = this.#three;
    const upright = new Quaternion().setFromUnitVectors(camera.up, new Vector3(0, 1, 0));
    const offset = camera.position.clone().sub(this.#controls.target).applyQuaternion(upright);
    const at = new Spherical().setFromVector3(offset);
    at.theta += theta;
    at.phi += phi;
    at.makeSafe();
    offset.setFromSpherical(at).applyQuaternion(upright.invert());
    camera.position.copy(this.#controls.target).add(offset);
    this.#controls.update();
    this.#draw();
  }

  #zoom(factor: number): void {
    this.#held = true;
    this.#camera.zoom *= factor;
    this.#camera.updateProjectionMatrix();
    this.#draw();
  }

  #draw(): void {
    if (this.#drawAsked) return;
    this.#drawAsked = true;
    requestAnimationFrame(() => {
      this.#drawAsked = false;
      this.#paint();
    });
  }

  #paint(): void {
    this.#renderer.render(this.#scene, this.#camera);
    this.#box.dataset["geometries"] = String(this.#renderer.info.memory.geometries);
    const length = roundBelow(TARGET_BAR_PX / this.#camera.zoom);
    this.#bar.style.width = `${length * this.#camera.zoom}px`;
    setText(this.#barLabel, micrometres(length));
  }
}
