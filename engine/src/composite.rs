//! Stage `composite`: fragments to runs. Between cuts things add, cuts fold with *over*.
//!
//! Order `Centers`: every splat is closed before the next opens. What is behind an opaque cut is left out, a kernel
//! between two cuts belongs to one run, and only where a cut goes through a kernel is it shared out between runs.

use crate::columns::{LANES, Lanes};
use crate::footprint::{Form, Kind, Lens, Record, Rect};
use crate::layers::{BlockCuts, Cuts};
use crate::raster::{ExactRows, Recurrence, StripRows, ray_lengths};
use crate::simd::*;
use crate::tile::{BLOCK_ROWS, Cell, MAX_SIDE, Tile};
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};

/// A surface layer at eight pixels side by side.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Cut {
    /// ∞ where there is none.
    pub(crate) depth: Lanes,
    /// The opacity with which it is composited.
    pub(crate) alpha: Lanes,
    /// Base colour in the blend space; shaded when the pixel is resolved.
    pub(crate) color: [Lanes; 3],
    /// Unit normal in camera space, on the side that is seen.
    pub(crate) normal: [Lanes; 3],
    /// The front-most record, whose cloud's material shades the layer; [`Cut::NO_RECORD`] where there is none.
    pub(crate) record: [u32; LANES],
}

impl Cut {
    pub(crate) const NO_RECORD: u32 = u32::MAX;

    /// No surface.
    pub(crate) const NONE: Self = Self {
        depth: [f32::INFINITY; LANES],
        alpha: [0.0; LANES],
        color: [[0.0; LANES]; 3],
        normal: [[0.0; LANES]; 3],
        record: [Self::NO_RECORD; LANES],
    };
}

/// The runs of a tile: for each segment between cuts, near to far, its cells.
pub(crate) struct Runs {
    segments: Vec<Vec<Cell>>,
}

impl Runs {
    pub(crate) fn new() -> Self {
        Self { segments: Vec::new() }
    }

    /// Clears as many segments as the cuts make.
    fn clear(&mut self, tile: Tile, segments: usize) {
        self.segments.resize_with(segments.max(self.segments.len()), Vec::new);
        for cells in &mut self.segments[..segments] {
            cells.clear();
            cells.resize(Tile::cells(tile.side), Cell::CLEAR);
        }
        // What lies beside the picture is done.
        for strip in (0..tile.strips()).filter(|strip| tile.columns(*strip) < 8) {
            for cell in &mut self.segments[0][tile.strip(strip)] {
                cell.opacity[tile.columns(strip)..].fill(1.0);
            }
        }
    }

    /// What a cell's pixels send and let through in a segment.
    pub(crate) fn cell(&self, segment: usize, cell: usize) -> &Cell {
        &self.segments[segment][cell]
    }
}

/// The rows of each strip that still see something in the first segment.
struct OpenRows([Range<usize>; MAX_SIDE / 8]);

impl OpenRows {
    fn all(tile: Tile) -> Self {
        Self(std::array::from_fn(|_| 0..tile.size[1]))
    }

    /// Closes rows at the ends whose pixels are all opaque to `spent`; says whether any are left.
    #[inline(always)]
    fn update<S: Simd>(&mut self, simd: S, tile: Tile, cells: &[Cell], spent: f32) -> bool {
        let is_open = |strip: usize, row: usize| {
            let opacity = V::simd_from(simd, cells[strip * tile.side + row].opacity);
            opacity.simd_lt(splat(simd, 1.0 - spent)).any_true()
        };
        let mut any = false;
        for (strip, rows) in self.0[..tile.strips()].iter_mut().enumerate() {
            while rows.start < rows.end && !is_open(strip, rows.start) {
                rows.start += 1;
            }
            while rows.start < rows.end && !is_open(strip, rows.end - 1) {
                rows.end -= 1;
            }
            any |= rows.start < rows.end;
        }
        any
    }
}

/// Adds fragments to runs.
pub(crate) struct Compositor<'a> {
    pub(crate) records: &'a [Record],
    pub(crate) rects: &'a [Rect],
    pub(crate) lens: Lens,
    pub(crate) cutoff: f32,
    pub(crate) near: f32,
    pub(crate) spent: f32,
    /// e^{−ρ/2} at the cut-off ρ.
    pub(crate) least_weight: f32,
    /// Whether the mean depth of what is seen is asked for.
    pub(crate) keeps_depth: bool,
    /// `Opacity` kernels end where they fall below this.
    pub(crate) least_alpha: f32,
}

/// After so many records the tile is asked whether it still sees anything.
const RECORDS_A_CHECK: usize = 32;

/// Beyond this many σ_z a kernel has 6e-5 of its mass, which counts as none.
const REACH: f32 = 4.0;

/// The narrowest filter, in squared pixels, under which [`Recurrence`] holds.
const RECURRENCE_LOW_PASS: f64 = 0.3 - 1e-9;

/// One record on one strip of a tile.
struct Strip<'a> {
    record: &'a Record,
    tile: Tile,
    strip: usize,
    rows: Range<usize>,
}

impl Strip<'_> {
    /// Offsets of the first row's pixels from the record's mean.
    #[inline(always)]
    fn offsets<S: Simd>(&self, simd: S) -> (V<S>, f32) {
        let x = (self.tile.origin[0] + self.strip * 8) as f32 + 0.5 - self.record.mean[0];
        let y = (self.tile.origin[1] + self.rows.start) as f32 + 0.5 - self.record.mean[1];
        (lane_numbers(simd) + x, y)
    }

    fn cells(&self) -> Range<usize> {
        let first = self.strip * self.tile.side;
        first + self.rows.start..first + self.rows.end
    }
}

/// α as a polynomial of w = e^{−r/2}, without constant term, or the way from optical depth to opacity.
#[derive(Clone, Copy)]
enum Alpha {
    /// c₀w: opacities.
    Peak(f32),
    /// Optical depths up to ¼, to 2e-5 of themselves.
    Thin([f32; 3]),
    /// Optical depths up to 1, to 3e-6 of themselves.
    Medium([f32; 5]),
    /// Any optical depth.
    Thick(f32),
}

impl Alpha {
    #[inline(always)]
    fn new(record: &Record) -> Self {
        // (1 − e^{−t})/t on [0, ¼] and [0, 1]; relative minimax.
        const THIN: [f32; 3] = [0.999_980_4, -0.498_614_63, 0.151_798_94];
        const MEDIUM: [f32; 5] = [0.999_997_76, -0.499_894_22, 0.165_839_5, -0.039_332_894, 0.005_511_83];
        let peak = record.amplitude;
        let scaled = |c: f32, power: i32| c * peak.powi(power + 1);
        match record.tag.kind {
            Kind::Opacity => Self::Peak(peak),
            _ if peak <= 0.25 => Self::Thin([0, 1, 2].each(
                #[inline(always)]
                |i| scaled(THIN[i], i as i32),
            )),
            _ if peak <= 1.0 => Self::Medium([0, 1, 2, 3, 4].each(
                #[inline(always)]
                |i| scaled(MEDIUM[i], i as i32),
            )),
            _ => Self::Thick(peak),
        }
    }
}

/// Where a record is among the cuts of a block.
enum Place {
    /// Behind what is opaque.
    Hidden,
    /// Before all cuts.
    FirstRun,
    /// It may be shared out between so many runs.
    Between(usize),
}

/// How far a record reaches along z from its centre, anywhere in the picture: to the end of its ellipsoid, and
/// [`REACH`] σ_z.
#[inline(always)]
fn reach(record: &Record) -> f32 {
    // Σ_zz is σ_z² and what the slope of the depth adds over the footprint, |M⁻ᵀ slope|².
    let [a, b, c] = record.conic_root;
    let x = record.depth_slope[0] / a;
    let y = (record.depth_slope[1] - b * x) / c;
    3.5 * (x * x + y * y).sqrt() + 1.25 * REACH * record.sigma_z
}

/// Within which depths a record lies in the pixels of a block.
#[inline(always)]
fn depth_range(part: &Strip) -> [f32; 2] {
    let record = part.record;
    let (depth, reach) = if record.tag.form == Form::Exact {
        (record.depth, reach(record))
    } else {
        let middle = [
            (part.tile.origin[0] + part.strip * 8 + 4) as f32 - record.mean[0],
            (part.tile.origin[1] + part.rows.start / BLOCK_ROWS * BLOCK_ROWS + 4) as f32 - record.mean[1],
        ];
        let [x, y] = record.depth_slope;
        let depth = record.depth + x * middle[0] + y * middle[1];
        (depth, 3.5 * (x.abs() + y.abs()) + REACH * record.sigma_z)
    };
    [depth - reach, depth + reach]
}

impl Compositor<'_> {
    /// Clears the runs and adds the records of a tile's list, which come from near to far. Gives the number of
    /// pixels that were evaluated.
    #[inline(always)]
    pub(crate) fn add<S: Simd>(
        &self,
        simd: S,
        (tile, list): (Tile, &[AtomicU32]),
        cuts: &Cuts,
        runs: &mut Runs,
    ) -> u64 {
        runs.clear(tile, cuts.segments());
        let mut open = OpenRows::all(tile);
        let mut lanes = 0;
        let mut batch = [(Record::BLANK, Rect::default()); RECORDS_A_CHECK];
        for list in list.chunks(RECORDS_A_CHECK) {
            if !open.update(simd, tile, &runs.segments[0], self.spent) {
                break;
            }
            // Fetched together, since a record is not in the cache and many can be on their way at once.
            for (entry, copy) in list.iter().zip(&mut batch) {
                let index = entry.load(Ordering::Relaxed) as usize;
                *copy = (self.records[index], self.rects[index]);
            }
            for (record, rect) in &batch[..list.len()] {
                lanes += self.add_record(simd, (tile, record, rect), (cuts, &open), runs);
            }
        }
        lanes as u64
    }

    /// Adds a record to the runs of a tile; gives the number of pixels that were evaluated.
    #[inline(always)]
    fn add_record<S: Simd>(
        &self,
        simd: S,
        (tile, record, rect): (Tile, &Record, &Rect),
        (cuts, open): (&Cuts, &OpenRows),
        runs: &mut Runs,
    ) -> usize {
        let mut lanes = 0;
        let nearest = record.depth - reach(record);
        if cuts.hide(nearest) {
            return 0;
        }
        // Neither cuts nor the near plane can go through it.
        let is_whole = cuts.is_empty() && nearest > self.near;
        let alpha = Alpha::new(record);
        let change = Recurrence::change(simd, record);
        for (strip, rows) in StripRows::new(simd, record, rect, tile, self.cutoff).into_iter() {
            let open = &open.0[strip];
            let mut rows = rows.start.max(open.start)..rows.end.min(open.end);
            while rows.start < rows.end {
                let block = rows.start / BLOCK_ROWS;
                let end = if is_whole { rows.end } else { rows.end.min((block + 1) * BLOCK_ROWS) };
                let part = Strip { record, tile, strip, rows: rows.start..end };
                rows.start = end;
                lanes += 8 * part.rows.len();
                let place = if is_whole {
                    Place::FirstRun
                } else {
                    self.place(&part, cuts.block(tile, strip, block))
                };
                match place {
                    Place::Hidden => {}
                    Place::FirstRun => self.plain(simd, &part, (alpha, change), &mut runs.segments[0]),
                    Place::Between(segments) => self.shared(simd, &part, (cuts, segments), runs),
                }
            }
        }
        lanes
    }

    /// Where a record is in the pixels of a block.
    #[inline(always)]
    fn place(&self, part: &Strip, cuts: BlockCuts) -> Place {
        let [nearest, farthest] = depth_range(part);
        if nearest > cuts.hidden {
            Place::Hidden
        } else if farthest < cuts.nearest && nearest > self.near {
            Place::FirstRun
        } else {
            Place::Between(cuts.segments)
        }
    }

    /// Adds a record to one run.
    #[inline(always)]
    fn plain<S: Simd>(&self, simd: S, strip: &Strip, (alpha, change): (Alpha, V<S>), cells: &mut [Cell]) {
        if strip.record.tag.form == Form::Exact || self.lens.low_pass.powi(2) < RECURRENCE_LOW_PASS {
            return self.rows(simd, strip, cells);
        }
        // w² and so on; a loop of fixed length for each kind.
        match alpha {
            Alpha::Peak(peak) => {
                self.recurrence(
                    simd,
                    (strip, change),
                    cells,
                    #[inline(always)]
                    |w| w * peak,
                );
            }
            Alpha::Thin([a, b, c]) => {
                let [a, b, c] = [a, b, c].each(
                    #[inline(always)]
                    |x| splat(simd, x),
                );
                self.recurrence(
                    simd,
                    (strip, change),
                    cells,
                    #[inline(always)]
                    |w| w * w.mul_add(w.mul_add(c, b), a),
                );
            }
            Alpha::Medium(coefficients) => {
                let [a, b, c, d, e] = coefficients.each(
                    #[inline(always)]
                    |x| splat(simd, x),
                );
                self.recurrence(
                    simd,
                    (strip, change),
                    cells,
                    #[inline(always)]
                    |w| w * w.mul_add(w.mul_add(w.mul_add(w.mul_add(e, d), c), b), a),
                );
            }
            Alpha::Thick(peak) => {
                self.recurrence(
                    simd,
                    (strip, change),
                    cells,
                    #[inline(always)]
                    |w| opacity(simd, w * peak),
                );
            }
        }
    }

    #[inline(always)]
    fn recurrence<S: Simd>(
        &self,
        simd: S,
        (strip, change): (&Strip, V<S>),
        cells: &mut [Cell],
        alpha: impl Fn(V<S>) -> V<S>,
    ) {
        let record = strip.record;
        let least = match record.tag.kind {
            Kind::Opacity => self.least_alpha / record.amplitude,
            _ => 0.0,
        };
        let threshold = splat(simd, self.least_weight.max(least));
        let color = splat3(simd, record.color);
        let (u, mut v) = strip.offsets(simd);
        let [slope_x, slope_y] = record.depth_slope;
        let rows_a_start = Recurrence::<S>::rows_a_start(record, self.cutoff);
        let reach = self.cutoff.sqrt();
        for cells in cells[strip.cells()].chunks_mut(rows_a_start) {
            let mut w = Recurrence::new(simd, (record, change, reach), u, v);
            let mut depth = u.mul_add(splat(simd, slope_x), splat(simd, record.depth + slope_y * v));
            v += cells.len() as f32;
            for cell in cells {
                let kept = keep(simd, w.value.simd_ge(threshold), w.value);
                blend(simd, cell, alpha(kept), (color, self.keeps_depth.then_some(depth)));
                w.step();
                depth += slope_y;
            }
        }
    }

    /// As [`Self::recurrence`], for any form.
    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, strip: &Strip, cells: &mut [Cell]) {
        let color = splat3(simd, strip.record.color);
        for (row, cell) in cells[strip.cells()].iter_mut().enumerate() {
            let [strength, depth, _] = self.row(simd, strip, row);
            let alpha = match strip.record.tag.kind {
                Kind::Opacity => strength,
                _ => opacity(simd, strength),
            };
            blend(simd, cell, alpha, (color, self.keeps_depth.then_some(depth)));
        }
    }

    /// A record's strength (optical depth, or opacity), z and σ_z in a row of a strip.
    #[inline(always)]
    fn row<S: Simd>(&self, simd: S, strip: &Strip, number: usize) -> [V<S>; 3] {
        let record = strip.record;
        let (u, v) = strip.offsets(simd);
        let v = v + number as f32;
        let row = ExactRows::new(record).row(simd, record, u, v);
        let w = keep(simd, row.r.simd_le(splat(simd, self.cutoff)), exp(simd, row.r * -0.5));
        let mut strength = w * record.amplitude;
        if record.tag.kind == Kind::Opacity {
            strength = keep(simd, strength.simd_ge(splat(simd, self.least_alpha)), strength);
        } else if record.tag.form == Form::Exact {
            strength *= row.scale * ray_lengths(simd, &self.lens, u + record.mean[0], v + record.mean[1]);
        }
        [strength, row.depth, row.sigma_z]
    }

    /// Shares a record out between the runs of a block:
    /// share_j = Φ((z_{j+1} − z)/σ_z) − Φ((z_j − z)/σ_z).
    #[inline(always)]
    fn shared<S: Simd>(&self, simd: S, part: &Strip, (cuts, segments): (&Cuts, usize), runs: &mut Runs) {
        let color = splat3(simd, part.record.color);
        for (row, cell) in part.cells().enumerate() {
            let [strength, depth, sigma_z] = self.row(simd, part, row);
            let tau = match part.record.tag.kind {
                Kind::Opacity => optical_depth(simd, strength),
                _ => strength,
            };
            let inverse = splat(simd, 1.0) / sigma_z.max(splat(simd, 1e-20));
            let mut from = splat(simd, self.near);
            let mut before_from = normal_cdf(simd, (from - depth) * inverse);
            for (segment, cells) in runs.segments[..segments].iter_mut().enumerate() {
                let to = V::simd_from(simd, cuts.depth(segment, cell));
                let before_to = normal_cdf(simd, (to - depth) * inverse);
                let share = (before_to - before_from).max(splat(simd, 0.0));
                let alpha = opacity(simd, tau * share);
                blend(
                    simd,
                    &mut cells[cell],
                    alpha,
                    (color, self.keeps_depth.then_some(depth.max(from).min(to))),
                );
                (from, before_from) = (to, before_to);
            }
        }
    }
}

/// (C, T)∘(C', T') = (C + T·C', T·T').
#[inline(always)]
fn blend<S: Simd>(simd: S, cell: &mut Cell, alpha: V<S>, (color, depth): (V3<S>, Option<V<S>>)) {
    let opacity = V::simd_from(simd, cell.opacity);
    let seen = (splat(simd, 1.0) - opacity) * alpha;
    cell.opacity = (opacity + seen).into();
    for (lanes, color) in cell.color.iter_mut().zip(color) {
        add_product(simd, lanes, color, seen);
    }
    if let Some(depth) = depth {
        add_product(simd, &mut cell.depth, depth, seen);
    }
}
