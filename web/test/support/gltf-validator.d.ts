// The package has no types. Only what the tests read.
declare module "gltf-validator" {
  export function validateBytes(data: Uint8Array): Promise<{
    issues: { messages: { code: string; message: string; pointer?: string }[] };
    info: { totalTriangleCount: number };
  }>;
}
