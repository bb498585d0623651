export function docs(root: string, outdir: string): Promise<number>;
