// Lines to draw over a frame: the outline of a mask with the fins, and the outline of the model.

import { ellipseOf, type Ellipsoid } from "./ellipsoid.ts";
import { edgeOf, silhouetteOf, type Triangles } from "./silhouette.ts";
import type { Projection } from "./projection.ts";
import type { StoredViewRecord } from "./status.ts";

/** The colours of the lines, as app.css names them in the legend. */
const PROFILE = [255, 64, 160] as const;
const MODEL = [16, 92, 255] as const;
const FIN = "rgb(64, 220, 255)";
const ORGAN = "rgb(255, 196, 0)";

type Rgb = readonly [number, number, number];

/** A canvas with the marked pixels in one colour on a transparent background. */
function drawn(edge: Uint8Array, width: number, height: number, [r, g, b]: Rgb): OffscreenCanvas {
  const canvas = new OffscreenCanvas(width, height);
  const image = new ImageData(width, height);
  edge.forEach((is, i) => {
    if (is) image.data.set([r, g, b, 255], 4 * i);
  });
  canvas.getContext("2d")!.putImageData(image, 0, 0);
  return canvas;
}

/** The outline of a mask and fins on a transparent background, wide enough to be visible after scaling down. */
export async function outlined(file: Blob, fins: NonNullable<StoredViewRecord["fins_px"]>): Promise<Blob> {
  // Without colour conversion, because the stored values are counts.
  const bitmap = await createImageBitmap(file, { colorSpaceConversion: "none" });
  const { width, height } = bitmap;
  const context = new OffscreenCanvas(width, height).getContext("2d")!;
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const { data } = context.getImageData(0, 0, width, height);
  const canvas = drawn(
    edgeOf((u, v) => data[4 * (v * width + u)]! > 127, width, height),
    width,
    height,
    PROFILE,
  );
  const drawing = canvas.getContext("2d")!;
  drawing.strokeStyle = FIN;
  drawing.lineWidth = 2;
  drawing.beginPath();
  // Pixel centres are at integers, those of the canvas half a pixel further.
  for (const fin of fins)
    fin.forEach(([u, v], i) => (i === 0 ? drawing.moveTo(u + 0.5, v + 0.5) : drawing.lineTo(u + 0.5, v + 0.5)));
  drawing.stroke();
  return canvas.convertToBlob({ type: "image/png" });
}

/** The outlines of the model and of the organs in it, seen by the camera of a view, on a transparent background. */
export function modelOutline(
  model: Triangles,
  organs: readonly Ellipsoid[],
  p: Projection,
  width: number,
  height: number,
): Promise<Blob> {
  const mask = silhouetteOf(model, p, width, height);
  const canvas = drawn(
    edgeOf((u, v) => mask[v * width + u] === 1, width, height),
    width,
    height,
    MODEL,
  );
  const drawing = canvas.getContext("2d")!;
  drawing.strokeStyle = ORGAN;
  drawing.lineWidth = 2;
  for (const organ of organs) {
    const seen = ellipseOf(organ, p);
    if (seen === null) continue;
    drawing.beginPath();
    drawing.ellipse(seen.u + 0.5, seen.v + 0.5, seen.half[0], seen.half[1], seen.angle, 0, 2 * Math.PI);
    drawing.stroke();
  }
  return canvas.convertToBlob({ type: "image/png" });
}
