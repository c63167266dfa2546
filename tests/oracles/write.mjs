// Writes a few splats with harmonics of degree 3 into written/, in the formats that @playcanvas/splat-transform writes.
//
//     node write.mjs

import { Column, DataTable, logger, MemoryFileSystem, Transform, getOutputFormat, writeFile } from '@playcanvas/splat-transform';
import fs from 'node:fs';
import path from 'node:path';
import { fileURLToPath } from 'node:url';

const WRITTEN = path.join(path.dirname(fileURLToPath(import.meta.url)), 'written');
const COUNT = 40;

// The same numbers in every run: a linear congruential generator (Knuth, MMIX).
let state = 1n;
const random = () => {
    state = BigInt.asUintN(64, state * 6364136223846793005n + 1442695040888963407n);
    return Number(state >> 40n) / 2 ** 24;
};
const between = (low, high) => () => low + (high - low) * random();

const makers = [
    ['x', between(-2, 3)], ['y', between(0, 4)], ['z', between(-1, 1)],
    ['scale_0', between(-6, -1)], ['scale_1', between(-6, -1)], ['scale_2', between(-6, -1)],
    ['f_dc_0', between(-1.5, 2)], ['f_dc_1', between(-1.5, 2)], ['f_dc_2', between(-1.5, 2)],
    ['opacity', between(-3, 5)],
    ['rot_0', between(-1, 1)], ['rot_1', between(-1, 1)], ['rot_2', between(-1, 1)], ['rot_3', between(-1, 1)],
    ...[...Array(45).keys()].map(k => [`f_rest_${k}`, between(-0.5, 0.5)])
];
const table = new DataTable(makers.map(([name, make]) => {
    return new Column(name, Float32Array.from({ length: COUNT }, make));
}), Transform.PLY);

logger.setVerbosity('quiet');
const options = { iterations: 10, lodSelect: [], unbundled: false, lodChunkCount: 512, lodChunkExtent: 16 };
for (const [filename, more] of [
    ['degree3.ply', {}],
    ['degree3.compressed.ply', {}],
    ['degree3.v3.spz', { spzVersion: 3 }],
    ['degree3.v4.spz', { spzVersion: 4 }],
    ['degree3.sog', {}],
    ['degree3.glb', {}]
]) {
    const files = new MemoryFileSystem();
    const outputFormat = getOutputFormat(filename, {});
    await writeFile({ filename, outputFormat, dataTable: table.clone(), options: { ...options, ...more } }, files);
    for (const [name, bytes] of files.results ?? files.files) fs.writeFileSync(path.join(WRITTEN, path.basename(name)), bytes);
}
