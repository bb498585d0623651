// Reads the single mesh of a binary glTF of carved, in um and with y down. The node above it makes it metres with y up, as the format
// wants: the page shows the mesh without it, and so the models of earlier versions too, which have no such node.

import type { BufferGeometry } from "three";
import { Refused } from "./api.ts";

export async function parseGlb(glb: Blob): Promise<BufferGeometry> {
  const three = await import("./three.ts").catch(() => null);
  if (three === null) throw new Refused(0, "the connection was lost while what draws models was read");
  const { GLTFLoader, Mesh } = three;
  const parsed = await new GLTFLoader().parseAsync(await glb.arrayBuffer(), "");
  let geometry: BufferGeometry | null = null;
  parsed.scene.traverse((node) => {
    if (geometry === null && node instanceof Mesh) geometry = node.geometry;
  });
  if (geometry === null) throw new Error("mesh.glb holds no mesh");
  return geometry;
}
