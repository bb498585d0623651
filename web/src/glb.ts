// Reads the single mesh of a binary glTF, in um.

import { Mesh, type BufferGeometry } from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

const loader = new GLTFLoader();

export async function parseGlb(glb: Blob): Promise<BufferGeometry> {
  const parsed = await loader.parseAsync(await glb.arrayBuffer(), "");
  parsed.scene.updateMatrixWorld(true);
  let geometry: BufferGeometry | null = null;
  parsed.scene.traverse((node) => {
    if (geometry || !(node instanceof Mesh)) return;
    const found = node as Mesh<BufferGeometry>;
    geometry = found.geometry;
    geometry.applyMatrix4(found.matrixWorld);
  });
  if (!geometry) throw new Error("mesh.glb holds no mesh");
  return geometry;
}
