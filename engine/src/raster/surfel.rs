//! Surface records: samples with a plane, block by block.

use super::{ExactRows, StripRows};
use crate::camera::Projection;
use crate::footprint::{Form, Lens, Record, Rect};
use crate::simd::*;
use crate::tile::{BLOCK_ROWS, Tile};
use std::ops::Range;

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
    /// Change of n·v a pixel, over n·v at the mean; 0 where the surfel is seen edge-on.
    tilt: [f32; 2],
    /// The plane is followed no further than this.
    farthest_offset: f32,
    /// d_z, or 1 where rays are parallel.
    zeta: f32,
}

/// Some rows of a strip within one block.
pub(crate) struct Part {
    /// The block: strip · blocks a strip + its number in the strip.
    pub(crate) block: usize,
    /// The cells of the tile.
    pub(crate) cells: Range<usize>,
    /// Centre of the block's first pixel and of the rows' first one, in pixels from the mean.
    corner: [f32; 2],
    top: f32,
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

    /// Coverage over the cloud's floor.
    #[inline(always)]
    pub(crate) fn weight(&self, simd: S) -> V<S> {
        exp(simd, self.exponent) * self.peak
    }
}

impl SurfelRaster<'_> {
    #[inline(always)]
    pub(crate) fn surfel(&self, index: u32) -> Surfel<'_> {
        let (record, rect) = (&self.records[index as usize], &self.rects[index as usize]);
        let zeta = if self.lens.projection == Projection::Perspective { record.depth } else { 1.0 };
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
            tilt,
            farthest_offset: STEEPEST * filter_reach * zeta.abs(),
            zeta,
        }
    }

    /// Calls `take` with each row of a part, from 0, and the samples there.
    #[inline(always)]
    pub(crate) fn draw<S: Simd>(
        &self,
        simd: S,
        surfel: &Surfel,
        part: &Part,
        mut take: impl FnMut(usize, Sample<S>),
    ) {
        let record = surfel.record;
        let u = lane_numbers(simd) + part.corner[0];
        if record.tag.form == Form::Exact {
            let rows = ExactRows::new(record);
            for row in 0..part.cells.len() {
                take(row, self.exact_sample(simd, surfel, rows, [u, splat(simd, part.top + row as f32)]));
            }
            return;
        }
        let [a, b, c] = record.conic_root;
        let [slope_x, slope_y] = record.depth_slope;
        let [tilt_x, tilt_y] = surfel.tilt;
        let limit = splat(simd, surfel.farthest_offset);
        let rise = splat(simd, -surfel.zeta);
        let is_perspective = self.lens.projection == Projection::Perspective;
        let faces_away = splat(simd, record.amplitude).simd_gt(splat(simd, 0.0));
        let (reach, peak) = (splat(simd, 3.0 * record.sigma_z), splat(simd, record.amplitude.abs()));
        for row in 0..part.cells.len() {
            let v = part.top + row as f32;
            let along = u.mul_add(splat(simd, a), splat(simd, b * v));
            let r = along.mul_add(along, splat(simd, c * v * c * v));
            let depth = u.mul_add(splat(simd, slope_x), splat(simd, record.depth + slope_y * v));
            let change = u.mul_add(splat(simd, tilt_x), splat(simd, tilt_y * v));
            let change = if is_perspective { change / (change + 1.0) } else { change };
            let offset = change.mul_add(rise, splat(simd, record.depth) - depth);
            let inside = r.simd_le(splat(simd, self.cutoff)) & depth.simd_gt(splat(simd, self.near));
            take(
                row,
                Sample {
                    inside,
                    depth,
                    offset: offset.max(-limit).min(limit),
                    reach,
                    exponent: r * -0.5,
                    peak,
                    faces_away,
                },
            );
        }
    }

    #[inline(always)]
    fn exact_sample<S: Simd>(
        &self,
        simd: S,
        surfel: &Surfel,
        rows: ExactRows,
        [u, v]: [V<S>; 2],
    ) -> Sample<S> {
        let record = surfel.record;
        let row = rows.row(simd, record, u, v[0]);
        let [slope_x, slope_y] = record.amplitude_slope;
        // n·v at the pixel, times the factor that makes it a coverage.
        let change = u.mul_add(splat(simd, slope_x), v * slope_y);
        let facing = change + record.amplitude;
        let zero = splat(simd, 0.0);
        let offset = change * -surfel.zeta / facing + record.depth - row.depth;
        let limit = splat(simd, surfel.farthest_offset);
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
}

impl Surfel<'_> {
    /// The rows of a tile that the record meets, block by block.
    #[inline(always)]
    pub(crate) fn parts<S: Simd>(&self, simd: S, tile: Tile) -> impl Iterator<Item = Part> {
        let rows = StripRows::new(simd, self.record, self.rect, tile, self.cutoff);
        let mean = self.record.mean;
        let blocks = tile.side / BLOCK_ROWS;
        rows.into_iter().flat_map(move |(strip, rows)| {
            let first_block = rows.start / BLOCK_ROWS;
            (first_block..rows.end.div_ceil(BLOCK_ROWS)).map(move |block| {
                let start = rows.start.max(block * BLOCK_ROWS);
                let end = rows.end.min((block + 1) * BLOCK_ROWS);
                let x = (tile.origin[0] + strip * 8) as f32 + 0.5 - mean[0];
                let y = |row: usize| (tile.origin[1] + row) as f32 + 0.5 - mean[1];
                Part {
                    block: strip * blocks + block,
                    cells: strip * tile.side + start..strip * tile.side + end,
                    corner: [x, y(block * BLOCK_ROWS)],
                    top: y(start),
                }
            })
        })
    }

    /// No sample in the part's block has a span that begins nearer, 3σ_z included.
    #[inline(always)]
    pub(crate) fn nearest(&self, part: &Part) -> f32 {
        if self.record.tag.form == Form::Exact {
            return f32::NEG_INFINITY;
        }
        let [x, y] = part.corner.each(
            #[inline(always)]
            |corner| corner + 3.5,
        );
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
        self.record.depth + rise - range + offset - 3.0 * self.record.sigma_z
    }
}
