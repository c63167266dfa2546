//! Surface records: samples with a plane, block by block.

use super::{ExactRows, StripRows};
use crate::camera::Projection;
use crate::footprint::{Form, Lens, Record, Rect};
use crate::simd::*;
use crate::tile::{BLOCK_ROWS, Tile};

/// The steepest slope dz/dx that a surfel's plane is followed along: 88°.
const STEEPEST: f32 = 30.0;

/// What rasterizing surface records needs.
pub(crate) struct SurfelRaster<'a> {
    pub(crate) records: &'a [Record],
    pub(crate) rects: &'a [Rect],
    pub(crate) lens: Lens,
    pub(crate) cutoff: f32,
    pub(crate) near: f32,
}

/// A record with what follows from it.
pub(crate) struct Surfel<'a> {
    pub(crate) record: &'a Record,
    rect: &'a Rect,
    cutoff: f32,
    near: f32,
    is_perspective: bool,
    /// Change of n·v a pixel, over n·v at the mean; 0 where the surfel is seen edge-on.
    tilt: [f32; 2],
    /// The plane is followed no further than this.
    farthest_offset: f32,
    /// d_z, or 1 where rays are parallel.
    zeta: f32,
}

/// What a block of 8×8 pixels still needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Needs {
    /// A bit for each row that has pixels to which samples matter.
    pub(crate) rows: u8,
    /// Samples whose spans begin at most this deep, less 3σ_z, belong to layers that are done.
    pub(crate) done: f32,
    /// Samples whose spans begin behind this matter no more.
    pub(crate) farthest: f32,
}

/// A surface at eight pixels, seen by one splat.
pub(crate) struct Sample<S: Simd> {
    /// Where the pixel is within the cut-off and behind the near plane.
    pub(crate) inside: M<S>,
    /// z of the densest point.
    pub(crate) depth: V<S>,
    /// The surfel's plane at the pixel lies this much deeper. Zero for a surfel that fills the pixel's
    /// filter; for a smaller one the filter sees it where it is, and its plane somewhere else.
    offset: V<S>,
    /// 3σ_z.
    reach: V<S>,
    /// −r/2.
    exponent: V<S>,
    /// Coverage over the cloud's floor where r is 0.
    peak: V<S>,
    /// Where the splat shows its back.
    pub(crate) faces_away: M<S>,
}

impl<S: Simd> Sample<S> {
    /// The near end of its span, and 3σ_z before it.
    #[inline(always)]
    pub(crate) fn nearest(&self) -> V<S> {
        self.depth + self.offset.min(self.offset * 0.0) - self.reach
    }

    /// The far end of its span.
    #[inline(always)]
    pub(crate) fn farthest(&self) -> V<S> {
        self.depth + self.offset.max(self.offset * 0.0)
    }

    /// Coverage over the cloud's floor where the mask is set, 0 elsewhere.
    #[inline(always)]
    pub(crate) fn weight(&self, simd: S, mask: M<S>) -> V<S> {
        keep(simd, mask, exp(simd, self.exponent)) * self.peak
    }
}

impl SurfelRaster<'_> {
    #[inline(always)]
    pub(crate) fn surfel(&self, index: u32) -> Surfel<'_> {
        let (record, rect) = (&self.records[index as usize], &self.rects[index as usize]);
        let is_perspective = self.lens.projection == Projection::Perspective;
        let zeta = if is_perspective { record.depth } else { 1.0 };
        let filter_reach = self.cutoff.sqrt() * (self.lens.low_pass / self.lens.focal.min_element()) as f32;
        let tilt = [0, 1].each(
            #[inline(always)]
            |axis| {
                let tilt = record.amplitude_slope[axis] / record.amplitude;
                if tilt.is_finite() { tilt } else { 0.0 }
            },
        );
        Surfel {
            record,
            rect,
            cutoff: self.cutoff,
            near: self.near,
            is_perspective,
            tilt,
            farthest_offset: STEEPEST * filter_reach * zeta.abs(),
            zeta,
        }
    }
}

impl Surfel<'_> {
    /// Whether a sample can show the front, and the back: in the affine form only one.
    #[inline(always)]
    pub(crate) fn shows_front(&self) -> bool {
        self.record.tag.form == Form::Exact || self.record.amplitude <= 0.0
    }

    #[inline(always)]
    pub(crate) fn shows_back(&self) -> bool {
        self.record.tag.form == Form::Exact || self.record.amplitude > 0.0
    }

    /// Calls `take` with each cell of a tile that the record meets and the samples there, where blocks may need them.
    /// Gives the number of pixels.
    #[inline(always)]
    pub(crate) fn draw<S: Simd>(
        &self,
        simd: S,
        tile: Tile,
        needs: &[Needs],
        mut take: impl FnMut(usize, Sample<S>),
    ) -> u64 {
        let record = self.record;
        let blocks = tile.side / BLOCK_ROWS;
        let mut rows_drawn = 0;
        for (strip, rows) in StripRows::new(simd, record, self.rect, tile, self.cutoff).into_iter() {
            let x = (tile.origin[0] + strip * 8) as f32 + 0.5 - record.mean[0];
            let top = tile.origin[1] as f32 + 0.5 - record.mean[1];
            let u = lane_numbers(simd) + x;
            for block in rows.start / BLOCK_ROWS..rows.end.div_ceil(BLOCK_ROWS) {
                let first = block * BLOCK_ROWS;
                let needs = &needs[strip * blocks + block];
                let [nearest, farthest] = self.spans([x, top + first as f32]);
                if nearest > needs.farthest || farthest <= needs.done {
                    continue;
                }
                let from = rows.start.max(first) - first;
                let to = rows.end.min(first + BLOCK_ROWS) - first;
                let mut wanted = u32::from(needs.rows) & ((1 << to) - (1 << from));
                rows_drawn += u64::from(wanted.count_ones());
                while wanted != 0 {
                    let row = first + wanted.trailing_zeros() as usize;
                    wanted &= wanted - 1;
                    let v = top + row as f32;
                    let sample = if record.tag.form == Form::Exact {
                        self.exact_sample(simd, u, v)
                    } else {
                        self.affine_sample(simd, u, v)
                    };
                    take(strip * tile.side + row, sample);
                }
            }
        }
        8 * rows_drawn
    }

    #[inline(always)]
    fn affine_sample<S: Simd>(&self, simd: S, u: V<S>, v: f32) -> Sample<S> {
        let record = self.record;
        let [a, b, c] = record.conic_root;
        let [slope_x, slope_y] = record.depth_slope;
        let [tilt_x, tilt_y] = self.tilt;
        let limit = splat(simd, self.farthest_offset);
        let along = u.mul_add(splat(simd, a), splat(simd, b * v));
        let r = along.mul_add(along, splat(simd, c * v * c * v));
        let depth = u.mul_add(splat(simd, slope_x), splat(simd, record.depth + slope_y * v));
        let change = u.mul_add(splat(simd, tilt_x), splat(simd, tilt_y * v));
        let change = if self.is_perspective { change / (change + 1.0) } else { change };
        let offset = change.mul_add(splat(simd, -self.zeta), splat(simd, record.depth) - depth);
        Sample {
            inside: r.simd_le(splat(simd, self.cutoff)) & depth.simd_gt(splat(simd, self.near)),
            depth,
            offset: offset.max(-limit).min(limit),
            reach: splat(simd, 3.0 * record.sigma_z),
            exponent: r * -0.5,
            peak: splat(simd, record.amplitude.abs()),
            faces_away: splat(simd, record.amplitude).simd_gt(splat(simd, 0.0)),
        }
    }

    #[inline(always)]
    fn exact_sample<S: Simd>(&self, simd: S, u: V<S>, v: f32) -> Sample<S> {
        let record = self.record;
        let row = ExactRows::new(record).row(simd, record, u, v);
        let [slope_x, slope_y] = record.amplitude_slope;
        // n·v at the pixel, times the factor that makes it a coverage.
        let change = u.mul_add(splat(simd, slope_x), splat(simd, v * slope_y));
        let facing = change + record.amplitude;
        let zero = splat(simd, 0.0);
        let offset = change * -self.zeta / facing + record.depth - row.depth;
        let limit = splat(simd, self.farthest_offset);
        // Seen exactly edge-on a plane has no depth at the pixel: the near limit.
        let offset = facing.simd_eq(zero).select(-limit, offset.max(-limit).min(limit));
        let peak = facing.abs() * row.scale;
        let inside = row.r.simd_le(splat(simd, self.cutoff))
            & row.depth.simd_gt(splat(simd, self.near))
            & peak.simd_gt(zero);
        Sample {
            inside,
            depth: row.depth,
            offset,
            reach: row.sigma_z * 3.0,
            exponent: row.r * -0.5,
            peak,
            faces_away: facing.simd_gt(zero),
        }
    }

    /// Between which depths the spans of samples in a block begin, less 3σ_z; the block's first pixel has this offset
    /// from the mean.
    #[inline(always)]
    fn spans(&self, first: [f32; 2]) -> [f32; 2] {
        if self.record.tag.form == Form::Exact {
            return [f32::NEG_INFINITY, f32::INFINITY];
        }
        let [x, y] = [first[0] + 3.5, first[1] + 3.5];
        let over_block =
            |slope: [f32; 2]| [slope[0] * x + slope[1] * y, 3.5 * (slope[0].abs() + slope[1].abs())];
        let [rise, range] = over_block(self.record.depth_slope);
        // To first order the plane rises by −ζ t, t the change of n·v; the rest is at most ζ t²/(1 − |t|).
        let [change, _] = over_block(self.tilt);
        let offset_slope = [0, 1].each(
            #[inline(always)]
            |i| -self.zeta * self.tilt[i] - self.record.depth_slope[i],
        );
        let [offset, offset_range] = over_block(offset_slope);
        let most = change.abs() + over_block(self.tilt)[1];
        let rest = if most < 0.5 { 2.0 * self.zeta.abs() * most * most } else { f32::INFINITY };
        let offset = (offset - offset_range - rest).min(0.0).max(-self.farthest_offset);
        let middle = self.record.depth + rise - 3.0 * self.record.sigma_z;
        [middle - range + offset, middle + range]
    }
}
