// Reads the trained splats among the test data with @playcanvas/splat-transform and writes what it says into expected/.
//
//     node splats.mjs [part of a path ...]

import { convertToSpace, getInputFormat, logger, MemoryReadFileSystem, readFile, getSHBands, Transform, version } from '@playcanvas/splat-transform';
import fs from 'node:fs';
import path from 'node:path';
import { fileURLToPath } from 'node:url';

const HERE = path.dirname(fileURLToPath(import.meta.url));
const DATA = process.env.OBLATE_DATA ?? path.join(HERE, '../../../shared/data');
const SPOTS = 32;
const LEVELS = [0, 1, 2, 3, 4, 5, 6].map(level => `splats/playbot/${level}_0/meta.json`);
const FILES = [
    'splats/biker.compressed.ply',
    'splats/biker.spz',
    'splats/fixtures/minimal-raw.spz',
    'splats/fixtures/minimal-v2.spz',
    'splats/fixtures/minimal-v3.spz',
    'splats/fixtures/minimal-v4.spz',
    'splats/fixtures/minimal.ksplat',
    'splats/fixtures/minimal.splat',
    ...LEVELS,
    'written/degree3.compressed.ply',
    'written/degree3.glb',
    'written/degree3.ply',
    'written/degree3.sog',
    'written/degree3.v3.spz',
    'written/degree3.v4.spz'
];
const LEVEL_SET = 'splats/playbot/lod-meta.json';

/** Files that write.mjs made lie here. */
const place = file => path.join(file.startsWith('written/') ? HERE : DATA, file);

/** The table of a file. Everything in its folder is at hand, since .sog is a set of files. */
const tableOf = async (file) => {
    if (file.endsWith('.glb')) {
        // Only written, in the axes of glTF, and with all digits: what should be in it is in the .ply beside it.
        return convertToSpace(await tableOf(file.replace('.glb', '.ply')), Transform.IDENTITY);
    }
    const full = place(file);
    const folder = path.dirname(full);
    const fileSystem = new MemoryReadFileSystem();
    for (const entry of fs.readdirSync(folder, { withFileTypes: true }).filter(entry => entry.isFile())) {
        const bytes = fs.readFileSync(path.join(folder, entry.name));
        // A copy: small files share one buffer, of which the reader would take the whole.
        fileSystem.set(entry.name, new Uint8Array(bytes));
    }
    const filename = path.basename(full);
    const tables = await readFile({ filename, inputFormat: getInputFormat(filename), options: {}, params: [], fileSystem });
    if (tables.length !== 1) throw new Error(`${file} gives ${tables.length} tables`);
    return tables[0];
};

/** Nine digits tell every f32 apart. */
const single = value => Number(Math.fround(value).toPrecision(9));
/** Means and deviations are made in f64; twelve digits are more than any quantization leaves. */
const double = value => Number(value.toPrecision(12));

/** Both ends and, between them, places that no period of a file meets again and again. */
const spotIndices = (count) => {
    if (count <= SPOTS) return [...Array(count).keys()];
    const golden = (Math.sqrt(5) - 1) / 2;
    const inner = [...Array(SPOTS - 2).keys()].map(k => Math.floor(((k + 1) * golden % 1) * count));
    return [...new Set([0, ...inner, count - 1])].sort((a, b) => a - b);
};

/** The spherical harmonic of degree 0. */
const CONSTANT_HARMONIC = Math.sqrt(1 / (4 * Math.PI));

const sigmoid = x => 1 / (1 + Math.exp(-x));

/** Unit quaternion w x y z, w at least 0; zero stays. */
const unit = (q) => {
    const length = Math.hypot(...q);
    const sign = q[0] < 0 ? -1 : 1;
    return length > 0 ? q.map(v => sign * v / length) : q;
};

/** Columns of the rotation, one after the other: the directions of the axes of the splat. */
const axesOf = ([w, x, y, z]) => [
    1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y),
    2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x),
    2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
];

/** The covariance R diag(e^2s) Rᵀ as xx xy xz yy yz zz: the same whatever order and signs the axes have. */
const covarianceOf = (axes, logScales) => {
    const variances = logScales.map(s => Math.exp(2 * s));
    const entry = (i, j) => variances.reduce((sum, v, k) => sum + v * axes[3 * k + i] * axes[3 * k + j], 0);
    return [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)];
};

const statistics = (count, value) => {
    let [sum, squares, min, max] = [0, 0, Infinity, -Infinity];
    for (let i = 0; i < count; i++) {
        const v = value(i);
        [sum, min, max] = [sum + v, Math.min(min, v), Math.max(max, v)];
    }
    const mean = sum / count;
    for (let i = 0; i < count; i++) squares += (value(i) - mean) ** 2;
    return { mean: double(mean), deviation: double(Math.sqrt(squares / count)), min, max };
};

const describe = (table) => {
    const count = table.numRows;
    // The WebAssembly reader of .spz says why on the console and gives nothing.
    if (count === 0) throw new Error('no splats');
    const column = name => table.getColumnByName(name).data;
    const columns = names => names.map(column);
    const xyz = columns(['x', 'y', 'z']);
    const scales = columns(['scale_0', 'scale_1', 'scale_2']);
    const rotation = columns(['rot_0', 'rot_1', 'rot_2', 'rot_3']);
    const dc = columns(['f_dc_0', 'f_dc_1', 'f_dc_2']);
    const logits = column('opacity');
    const degree = getSHBands(table);
    const perChannel = (degree + 1) ** 2 - 1;
    // f_rest is all of red, all of green, all of blue.
    const rest = (coefficient, channel) => column(`f_rest_${channel * perChannel + coefficient}`);
    const at = (columns, i) => columns.map(data => data[i]);

    const stats = {};
    const add = (name, value) => {
        const { mean, deviation } = statistics(count, value);
        stats[name] = [mean, deviation];
    };
    ['x', 'y', 'z'].forEach((name, k) => add(name, i => xyz[k][i]));
    ['log_scale_0', 'log_scale_1', 'log_scale_2'].forEach((name, k) => add(name, i => scales[k][i]));
    const axes = new Float64Array(9 * count);
    for (let i = 0; i < count; i++) axes.set(axesOf(unit(at(rotation, i))), 9 * i);
    for (let k = 0; k < 9; k++) add(`axis_${Math.floor(k / 3)}_${'xyz'[k % 3]}`, i => axes[9 * i + k]);
    add('opacity', i => sigmoid(logits[i]));
    dc.forEach((data, k) => add(`dc_${'rgb'[k]}`, i => data[i]));
    dc.forEach((data, k) => add(`color_${'rgb'[k]}`, i => Math.max(0, 0.5 + CONSTANT_HARMONIC * data[i])));
    for (let k = 0; k < perChannel; k++) {
        for (let c = 0; c < 3; c++) {
            const data = rest(k, c);
            add(`sh_${k}_${'rgb'[c]}`, i => data[i]);
        }
    }

    const spots = spotIndices(count).map((i) => {
        const spot = {
            index: i,
            position: at(xyz, i).map(single),
            log_scales: at(scales, i).map(single),
            rotation_wxyz: unit(at(rotation, i)).map(single),
            opacity: single(sigmoid(logits[i])),
            dc: at(dc, i).map(single)
        };
        if (degree > 0) spot.sh = [0, 1, 2].map(k => [0, 1, 2].map(c => single(rest(k, c)[i])));
        return spot;
    });
    const ranges = xyz.map(data => statistics(count, i => data[i]));
    return {
        count,
        sh_degree: degree,
        bounds: [ranges.map(r => single(r.min)), ranges.map(r => single(r.max))],
        mean_opacity: stats.opacity[0],
        mean_covariance: [...Array(6).keys()].map(k => double(statistics(count, (i) => {
            return covarianceOf(axes.subarray(9 * i, 9 * i + 9), at(scales, i))[k];
        }).mean)),
        mean_and_deviation: stats,
        spots
    };
};

/** One line for every value and for every object in a list. */
const textOf = (facts) => {
    const lines = Object.entries(facts).map(([key, value]) => {
        const inLines = (items, [open, close]) => `${open}\n${items.map(item => `    ${item}`).join(',\n')}\n  ${close}`;
        let text = JSON.stringify(value);
        if (Array.isArray(value) && typeof value[0] === 'object' && !Array.isArray(value[0])) {
            text = inLines(value.map(v => JSON.stringify(v)), '[]');
        } else if (key === 'mean_and_deviation') {
            text = inLines(Object.entries(value).map(([k, v]) => `${JSON.stringify(k)}: ${JSON.stringify(v)}`), '{}');
        }
        return `  ${JSON.stringify(key)}: ${text}`;
    });
    return `{\n${lines.join(',\n')}\n}\n`;
};

const write = (file, facts) => {
    const name = `${file.replaceAll(/[^A-Za-z0-9]/g, '_')}.json`;
    const text = textOf({ file, ...facts });
    if (text.length > 20_000) throw new Error(`${name} has ${text.length} bytes`);
    fs.writeFileSync(path.join(HERE, 'expected', name), text);
    console.log(name, text.length);
};

const formatOf = file => (file.endsWith('meta.json') ? 'sog' : path.basename(file).replace(/^(degree3|minimal(-\w+)?|biker)\.(v\d\.)?/, ''));
const READER = `@playcanvas/splat-transform ${version}`;
// The reader gives all formats these axes; of .spz, which holds x right, y up, z back, it turns y and z around.
const FRAME = 'RDF: x right, y down, z forward, as in trained .ply files';

/** Which chunks of which files make each level, as the tree says; the reader itself reads only one file at a time. */
const levelSet = () => {
    const meta = JSON.parse(fs.readFileSync(path.join(DATA, LEVEL_SET)));
    const chunks = [];
    const walk = (node) => {
        for (const [level, { file, offset, count }] of Object.entries(node.lods ?? {})) {
            chunks.push({ level: Number(level), file: meta.filenames[file], offset, count });
        }
        node.children?.forEach(walk);
    };
    walk(meta.tree);
    return { levels: meta.lodLevels, chunks: chunks.sort((a, b) => a.level - b.level || a.offset - b.offset) };
};

logger.setVerbosity?.('quiet');
const wanted = process.argv.slice(2);
const counts = {};
for (const file of [...FILES, LEVEL_SET]) {
    if (wanted.length > 0 && !wanted.some(part => file.includes(part))) continue;
    if (file === LEVEL_SET) {
        const { levels, chunks } = levelSet();
        const read = [];
        for (const level of LEVELS) read.push({ file: level, count: (await tableOf(level)).numRows });
        write(file, { kind: 'splat_levels', format: 'lod-meta.json', reader: READER, levels, chunks, read });
    } else {
        const frame = file.endsWith('.glb') ? 'glTF: that of the .ply after half a turn about z' : FRAME;
        const facts = { kind: 'splats', format: formatOf(file), reader: READER, frame };
        try {
            write(file, { ...facts, ...describe(await tableOf(file)) });
        } catch (error) {
            // What the reader cannot read is a result, too.
            write(file, { ...facts, kind: 'refused', why: String(error.message ?? error) });
        }
    }
}
