//! Which rows of a tile's strips the ellipse of a record meets.

use crate::columns::LANES;
use crate::footprint::{Form, Record, Rect};
use crate::simd::*;
use crate::tile::{MAX_SIDE, Tile};
use std::ops::Range;

/// Strips of the largest tile.
const STRIPS: usize = MAX_SIDE / LANES;

/// The rows of each strip of a tile, from the tile's first.
pub(crate) struct StripRows {
    strips: Range<usize>,
    rows: [[i32; LANES]; 2],
}

impl StripRows {
    /// The rows between the outermost pixels of the ellipse r ≤ `cutoff` in each strip. Exact perspective shifts the
    /// ellipse: then they are those of the rectangle.
    #[inline(always)]
    pub(crate) fn new<S: Simd>(simd: S, record: &Record, rect: &Rect, tile: Tile, cutoff: f32) -> Self {
        let low = [0, 1].each(
            #[inline(always)]
            |axis| (rect.min[axis] as usize).max(tile.origin[axis]) - tile.origin[axis],
        );
        let high = [0, 1].each(
            #[inline(always)]
            |axis| {
                (rect.max[axis] as usize).min(tile.origin[axis] + tile.size[axis]).max(tile.origin[axis])
                    - tile.origin[axis]
            },
        );
        let strips = low[0] / LANES..high[0].div_ceil(LANES);
        if record.tag.form == Form::Exact {
            return Self { strips, rows: [[low[1] as i32; LANES], [high[1] as i32; LANES]] };
        }
        let [a, b, c] = record.conic_root;
        let s = b * b + c * c;
        // v = mu ± √((ρ − u²/V_xx)/s); the lowest point over an interval is at its end nearest to the lowest of all.
        let m = -a * b / s;
        let (root, inverse_s) = (cutoff.sqrt(), 1.0 / s);
        let reach = root * s.sqrt() / (a * c);
        let lowest = -b / (a * c) * root;
        // Lanes 0–3 take the strips, lanes 4–7 the strips mirrored, whose lowest points are the highest.
        const FIRST: [f32; LANES] = [0.0, 8.0, 16.0, 24.0, -7.0, -15.0, -23.0, -31.0];
        const SIGN: [f32; LANES] = [1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0];
        let [u, v] = [0, 1].each(
            #[inline(always)]
            |axis| tile.origin[axis] as f32 + 0.5 - record.mean[axis],
        );
        let sign = V::simd_from(simd, SIGN);
        let left = sign.mul_add(splat(simd, u), V::simd_from(simd, FIRST));
        let (left, right) = (left.max(splat(simd, -reach)), (left + 7.0).min(splat(simd, reach)));
        let at = splat(simd, lowest).max(left).min(right);
        let per_u = -(a * c) * (a * c) * inverse_s;
        let under = (at * at).mul_add(splat(simd, per_u), splat(simd, cutoff)).max(splat(simd, 0.0));
        // Rounding moves a pixel by less than a hundredth.
        let outermost = (under * inverse_s).sqrt() + at * m + 0.01;
        let rows = outermost - sign * v;
        let rows: [f32; LANES] = rows.floor().max(splat(simd, -1e6)).min(splat(simd, 1e6)).into();
        let mut found = [[low[1] as i32; LANES], [high[1] as i32; LANES]];
        for strip in 0..STRIPS {
            found[0][strip] = found[0][strip].max(-(rows[STRIPS + strip] as i32));
            found[1][strip] = found[1][strip].min(rows[strip] as i32 + 1);
        }
        Self { strips, rows: found }
    }

    /// Strips and their rows; empty ones are left out.
    #[inline(always)]
    pub(crate) fn into_iter(self) -> impl Iterator<Item = (usize, Range<usize>)> {
        let [from, to] = self.rows;
        self.strips.filter_map(move |strip| {
            let [from, to] = [from, to].each(
                #[inline(always)]
                |rows| rows[strip % STRIPS],
            );
            (from < to).then_some((strip, from as usize..to as usize))
        })
    }
}
