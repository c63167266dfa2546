//! The affine form down a strip.

use crate::footprint::Record;
use crate::simd::*;

/// e^{−q/2} at eight pixels side by side, row after row.
///
/// q is a parabola of the row, so e^{−q/2} goes from row to row by a factor that itself changes by a constant one.
/// Rounding grows with the square of the number of rows; over 32 it is within 6e-5.
#[derive(Clone, Copy)]
pub(crate) struct Recurrence<S: Simd> {
    /// e^{−q/2}.
    pub(crate) value: V<S>,
    ratio: V<S>,
    change: V<S>,
}

impl<S: Simd> Recurrence<S> {
    /// e^{−Q_yy}, by which the ratio of a record changes from row to row.
    #[inline(always)]
    pub(crate) fn change(simd: S, record: &Record) -> V<S> {
        let [_, b, c] = record.conic_root;
        exp(simd, splat(simd, -(b * b + c * c)))
    }

    /// Starts at offsets (u, v) from the record's mean; `reach` is the √r at which the kernel ends.
    ///
    /// A pixel so far out that f32 can't hold its start stays at 0. It is outside the ellipse as far as
    /// [`Self::rows_a_start`] rows on.
    #[inline(always)]
    pub(crate) fn new(simd: S, (record, change, reach): (&Record, V<S>, f32), u: V<S>, v: f32) -> Self {
        let [a, b, c] = record.conic_root;
        let along = u.mul_add(splat(simd, a), splat(simd, b * v));
        let square = along.mul_add(along, splat(simd, c * v * c * v));
        let s = b * b + c * c;
        let exponent = square * -0.5;
        // Columns beside the ellipse stay at 0: their values would become subnormal, which is slow.
        let beside = u.abs().simd_gt(splat(simd, reach * s.sqrt() / (a * c)));
        let starts = exponent.simd_gt(splat(simd, -85.9)) & !beside;
        let value = keep(simd, starts, exp(simd, exponent));
        let slope = u.mul_add(splat(simd, -a * b), splat(simd, -s * (v + 0.5)));
        Self { value, ratio: exp(simd, slope), change }
    }

    /// How many rows may follow a start.
    ///
    /// A start's row meets the ellipse, so its other pixels are at most 7.5 pixels beside it: √q there is at most
    /// √ρ + 7.5a. Up to 13.2 f32 holds e^{−q/2}; beyond, a pixel that comes into the ellipse within eight rows is
    /// that near along the column, since √Q_yy and a can't both be large when the filter is at least 0.3 px².
    #[inline(always)]
    pub(crate) fn rows_a_start(record: &Record, cutoff: f32) -> usize {
        if cutoff.sqrt() + 7.5 * record.conic_root[0] > 13.2 { 8 } else { usize::MAX }
    }

    /// Goes on to the next row.
    #[inline(always)]
    pub(crate) fn step(&mut self) {
        self.value *= self.ratio;
        self.ratio *= self.change;
    }
}
