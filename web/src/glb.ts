// Reads the single mesh of a binary glTF of carved, in um and with y down. The node above it makes it metres with y up, as the format
// wants: the page shows the mesh without it, and so the models of earlier versions too, which have no such node.

import { Mesh, type BufferGeometry } from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

const loader = new GLTFLoader();

export async function parseGlb(glb: Blob): Promise<BufferGeometry> {
  const parsed = await loader.parseAsync(await glb.arrayBuffer(), "");
  let geometry: BufferGeometry | null = null;
  parsed.scene.traverse((node) => {
    if (geometry || !(node instanceof Mesh)) return;
    const found = node as Mesh<BufferGeometry>;
    geometry = found.geometry;
  });
  if (!geometry) throw new Error("mesh.glb holds no mesh");
  return geometry;
}
