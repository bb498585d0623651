// Pictures and meshes made on the spot: a PNG encoder and a binary glTF of an ellipsoid.

import { crc32Of } from "./crc.ts";
import { deflateSync } from "node:zlib";

function chunk(type: string, data: Buffer): Buffer {
  const body = Buffer.concat([Buffer.from(type, "ascii"), data]);
  const head = Buffer.alloc(4);
  head.writeUInt32BE(data.length);
  const tail = Buffer.alloc(4);
  tail.writeUInt32BE(crc32Of(body));
  return Buffer.concat([head, body, tail]);
}

/** RGBA picture of `colour(x, y)`. */
export function png(
  width: number,
  height: number,
  colour: (x: number, y: number) => [number, number, number, number],
): Buffer {
  const rows = Buffer.alloc(height * (1 + width * 4));
  for (let y = 0; y < height; y += 1) {
    for (let x = 0; x < width; x += 1) rows.set(colour(x, y), y * (1 + width * 4) + 1 + x * 4);
  }
  const header = Buffer.alloc(13);
  header.writeUInt32BE(width, 0);
  header.writeUInt32BE(height, 4);
  header.set([8, 6, 0, 0, 0], 8);
  const signature = Buffer.from([0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a]);
  return Buffer.concat([
    signature,
    chunk("IHDR", header),
    chunk("IDAT", deflateSync(rows)),
    chunk("IEND", Buffer.alloc(0)),
  ]);
}

/** Binary glTF of an ellipsoid about the origin with the given half axes; with `taper` its end at positive x is thicker than the other. */
export function ellipsoidGlb(halfAxes: [number, number, number], rings = 32, taper = 0): Buffer {
  const segments = rings * 2;
  const positions: number[] = [];
  for (let ring = 0; ring <= rings; ring += 1) {
    const polar = (ring / rings) * Math.PI;
    for (let segment = 0; segment <= segments; segment += 1) {
      const azimuth = (segment / segments) * 2 * Math.PI;
      const radius = Math.sin(polar) * (1 - taper * (0.5 - 0.5 * Math.cos(polar)));
      positions.push(
        halfAxes[0] * Math.cos(polar),
        halfAxes[1] * radius * Math.cos(azimuth),
        halfAxes[2] * radius * Math.sin(azimuth),
      );
    }
  }
  const triangles: number[] = [];
  for (let ring = 0; ring < rings; ring += 1) {
    for (let segment = 0; segment < segments; segment += 1) {
      const a = ring * (segments + 1) + segment;
      const b = a + segments + 1;
      triangles.push(a, b, a + 1, a + 1, b, b + 1);
    }
  }
  const vertices = Buffer.from(new Float32Array(positions).buffer);
  const indices = Buffer.from(new Uint32Array(triangles).buffer);
  const json = {
    asset: { version: "2.0" },
    scene: 0,
    scenes: [{ nodes: [0] }],
    nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1 }] }],
    buffers: [{ byteLength: vertices.length + indices.length }],
    bufferViews: [
      { buffer: 0, byteOffset: 0, byteLength: vertices.length },
      { buffer: 0, byteOffset: vertices.length, byteLength: indices.length },
    ],
    accessors: [
      {
        bufferView: 0,
        componentType: 5126,
        count: positions.length / 3,
        type: "VEC3",
        min: halfAxes.map((h) => -h),
        max: halfAxes,
      },
      { bufferView: 1, componentType: 5125, count: triangles.length, type: "SCALAR" },
    ],
  };
  const padded = (data: Buffer, fill: string) =>
    Buffer.concat([data, Buffer.alloc((4 - (data.length % 4)) % 4, fill, "ascii")]);
  const part = (type: number, data: Buffer) => {
    const head = Buffer.alloc(8);
    head.writeUInt32LE(data.length, 0);
    head.writeUInt32LE(type, 4);
    return Buffer.concat([head, data]);
  };
  const body = Buffer.concat([
    part(0x4e4f534a, padded(Buffer.from(JSON.stringify(json)), " ")),
    part(0x004e4942, padded(Buffer.concat([vertices, indices]), "\0")),
  ]);
  const head = Buffer.alloc(12);
  head.writeUInt32LE(0x46546c67, 0);
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(12 + body.length, 8);
  return Buffer.concat([head, body]);
}
