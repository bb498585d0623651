// Converts stored frames and masks to visible pictures: a mosaic to colour, a mask to its outline.

import type { FinCurve } from "./status.ts";

const EDGE = [255, 64, 160, 255] as const;
const FIN = "rgb(64, 220, 255)";

interface Pixels {
  width: number;
  height: number;
  data: Uint8ClampedArray;
}

async function pixelsOf(file: Blob): Promise<Pixels> {
  // Without colour conversion, because the stored values are counts.
  const bitmap = await createImageBitmap(file, { colorSpaceConversion: "none" });
  const { width, height } = bitmap;
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d")!;
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  return { width, height, data: context.getImageData(0, 0, width, height).data };
}

function pictureOf({ width, height, data }: Pixels, fins: readonly FinCurve[] = []): Promise<Blob> {
  const canvas = new OffscreenCanvas(width, height);
  const image = new ImageData(width, height);
  image.data.set(data);
  const drawing = canvas.getContext("2d")!;
  drawing.putImageData(image, 0, 0);
  drawing.strokeStyle = FIN;
  drawing.lineWidth = 2;
  drawing.beginPath();
  // Pixel centres are at integers, those of the canvas half a pixel further.
  for (const fin of fins)
    fin.forEach(([u, v], i) => (i === 0 ? drawing.moveTo(u + 0.5, v + 0.5) : drawing.lineTo(u + 0.5, v + 0.5)));
  drawing.stroke();
  return canvas.convertToBlob({ type: "image/png" });
}

/** Shows a raw frame as the camera saw it: each 2 x 2 pixels of a mosaic (`BayerRG8`) become one colour pixel. */
export async function developed(file: Blob, format: string): Promise<Blob> {
  const first = /^Bayer([RGB]{2})8$/.exec(format)?.[1];
  return first === undefined ? file : pictureOf(colours(await pixelsOf(file), first));
}

/** `first` has the colours of the first two pixels of the first line. Pure. */
export function colours({ width, height, data }: Pixels, first: string): Pixels {
  // Red and blue are opposite each other, and green occurs twice.
  const second = { RG: "GB", GR: "BG", GB: "RG", BG: "GR" }[first] ?? "GB";
  const places = [...first, ...second].map((colour) => "RGB".indexOf(colour));
  const [w, h] = [Math.floor(width / 2), Math.floor(height / 2)];
  const out = new Uint8ClampedArray(w * h * 4);
  for (let v = 0; v < h; v += 1) {
    for (let u = 0; u < w; u += 1) {
      const at = (v * w + u) * 4;
      out[at + 3] = 255;
      places.forEach((colour, i) => {
        const count = data[((2 * v + (i >> 1)) * width + 2 * u + (i & 1)) * 4]!;
        // Two of the four pixels are green.
        out[at + colour]! += colour === 1 ? count / 2 : count;
      });
    }
  }
  return { width: w, height: h, data: out };
}

/** The outline of a mask and fins on a transparent background, wide enough to be visible after scaling down. */
export async function outlined(file: Blob, fins: readonly FinCurve[]): Promise<Blob> {
  const { width, height, data } = await pixelsOf(file);
  const out = new Uint8ClampedArray(width * height * 4);
  const inside = (u: number, v: number) => u < width && v < height && data[(v * width + u) * 4]! > 127;
  for (let v = 0; v < height; v += 1) {
    for (let u = 0; u < width; u += 1) {
      const here = inside(u, v);
      if (inside(u + 1, v) === here && inside(u, v + 1) === here) continue;
      for (const [du, dv] of [
        [0, 0],
        [1, 0],
        [0, 1],
      ] as const) {
        if (u + du < width && v + dv < height) out.set(EDGE, ((v + dv) * width + u + du) * 4);
      }
    }
  }
  return pictureOf({ width, height, data: out }, fins);
}
