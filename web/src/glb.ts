// Reads the single mesh of a binary glTF of carved, in um and with y down. The node above it makes it metres with y up, as the format
// wants: the page shows the mesh without it, and so the models of earlier versions too, which have no such node.

import type { BufferGeometry } from "three";

export async function parseGlb(glb: Blob): Promise<BufferGeometry> {
  const { GLTFLoader, Mesh } = await import("./three.ts");
  const parsed = await new GLTFLoader().parseAsync(await glb.arrayBuffer(), "");
  let geometry: BufferGeometry | null = null;
  parsed.scene.traverse((node) => {
    if (geometry === null && node instanceof Mesh) geometry = node.geometry;
  });
  if (geometry === null) throw new Error("mesh.glb holds no mesh");
  return geometry;
}
