//! Volume records to optical depths or opacities at the pixels of a block.

use super::column::{BATCH, Column, sixteen, sixteen_of};
use super::offsets::{Exact, HALF_LOG2_E, Plane};
use super::outline::{BlockMasks, Outlines};
use super::plain::{ONE_THICK_OF, TAYLOR, THIN, THIN_PEAK};
use super::sixteen::{Sixteen, touch};
use super::slabs::SlabColumns;
use crate::camera::Projection;
use crate::closing::Closing;
use crate::footprint::{Kind, Lens, Record, Rect};
use crate::lattice::LEAST_SIGMA;
use crate::simd::*;
use crate::tile::{HALF_BLOCK, Tile};

/// Beyond this many σ_z a kernel has 6e-5 of its mass, which counts as none.
const REACH: f32 = NORMAL_END;

/// Kernels are taken to reach as many σ_z from their densest point, at most.
pub(crate) const KERNEL_REACH: f64 = 1.25 * REACH as f64;

/// What volume records share.
#[derive(Clone, Copy)]
pub(crate) struct KernelLens {
    pub(crate) lens: Lens,
    pub(crate) near: f32,
    /// Where r ends.
    pub(crate) cutoff: f32,
    pub(crate) closing: Closing,
    /// Whether opacities are taken to be optical depths.
    pub(crate) is_taylor: bool,
    /// See [`reach_to_cuts`].
    pub(crate) reach_to_cuts: f32,
    /// Kernels whose standard deviation in the picture is less, in pixels, are [rough](Kernels::rough); where it is 0, none are.
    pub(crate) narrowest: f32,
    /// Rough, too, are kernels that end higher.
    pub(crate) highest_end: f32,
}

/// How many σ_z from a cut kernels are taken to lie wholly before it or behind it.
///
/// Of an even extinction σ_t those that lie x σ_z or more before a cut have σ_t σ_z (φ(x) − xΦ(−x)) of optical depth behind it,
/// which is less than σ_t σ_z φ(x)/x²; those behind it have as much before it, of the other sign. That factor is an eighth of the
/// tolerance, or less; below a tolerance of 7e-5 it is that of [`REACH`].
pub(crate) fn reach_to_cuts(tolerance: f64) -> f32 {
    let share = tolerance / 8.0 * std::f64::consts::TAU.sqrt();
    // x² = −2 ln(share x²); each step brings it nearer by a factor of x²/2, two or more.
    let step = |x: f64| (-2.0 * (share * x * x).ln()).max(4.0).sqrt();
    (0..32).fold(3.0, |x, _| step(x)).min(f64::from(REACH)) as f32
}

/// Volume records of a tile, as many as go together, and what follows from them.
#[repr(C, align(64))]
pub(crate) struct Kernels {
    pub(super) outlines: Outlines,
    /// α as a polynomial of the strength without constant term, where a kernel is plain and there are neither slabs nor a thick batch.
    pub(super) alpha: [Column; 3],
    /// −kr where they end.
    pub(super) least: Column,
    /// log₂ of amplitudes, by which strengths are 2^{peak − kr}.
    pub(super) peak: Column,
    pub(super) color: [Column; 3],
    pub(super) amplitude: Column,
    /// How far they reach along z from their centres, anywhere in the picture: to the end of their ellipsoids, and
    /// [`REACH`] σ_z.
    reach: Column,
    /// Those whose opacities are the polynomial; of optical depths only in the affine form, where they have a peak. Where there are slabs, those
    /// in the affine form, and opacities that are whole.
    pub(super) thin: u64,
    /// Those that need no more than an opacity, and z where that is asked for: the thin ones, and all of a thick batch.
    pub(crate) plain: u64,
    /// Where there are slabs.
    pub(crate) slabs: SlabColumns,
    pub(super) is_taylor: bool,
    /// Whether all are of kind `Opacity`: their polynomials end after the first term.
    pub(super) is_linear: bool,
    /// Whether all are optical depths, many of them large or in the exact form: all are plain then.
    pub(super) is_thick: bool,
    /// Those of kind `Opacity`.
    pub(super) opacities: u64,
    /// Those that lie wholly behind the near plane.
    pub(crate) whole: u64,
    /// Those that pixels a step apart don't tell of: round ones with a standard deviation below a bound, longer ones with a mean of 1/σ²
    /// over the directions in the picture as large, and those that end where they still show.
    pub(crate) rough: u64,
    /// Those that each block needs.
    pub(crate) masks: BlockMasks,
}

/// What a kernel is in a block.
pub(crate) struct Fragments<S: Simd> {
    /// Optical depth, or opacity.
    pub(crate) strength: W<S>,
    /// z of the densest point.
    pub(crate) depth: W<S>,
    pub(crate) sigma_z: W<S>,
}

/// Between which z the records of a batch lie in a block.
pub(crate) struct Spans {
    nearest: Column,
    farthest: Column,
}

/// Sets of records by where they are from a segment of rays.
#[derive(Clone, Copy, Default)]
pub(crate) struct Places {
    /// Those that may lie in it.
    pub(crate) touched: u64,
    /// Those that lie wholly behind where it begins, and before where it ends.
    pub(crate) behind_begin: u64,
    pub(crate) before_end: u64,
}

impl Places {
    /// Those that lie wholly in the segment.
    #[inline(always)]
    pub(crate) fn whole(&self) -> u64 {
        self.behind_begin & self.before_end
    }
}

impl Kernels {
    pub(crate) const NONE: Self = Self {
        outlines: Outlines::NONE,
        alpha: [[0.0; BATCH]; 3],
        least: [0.0; BATCH],
        peak: [0.0; BATCH],
        color: [[0.0; BATCH]; 3],
        amplitude: [0.0; BATCH],
        reach: [0.0; BATCH],
        thin: 0,
        plain: 0,
        slabs: SlabColumns::NONE,
        is_taylor: false,
        is_linear: false,
        is_thick: false,
        opacities: 0,
        whole: 0,
        rough: 0,
        masks: BlockMasks::NONE,
    };

    /// Takes in listed records of a tile, up to [`BATCH`], with their rectangles. Those behind `hidden_from` no block needs.
    #[inline(always)]
    pub(crate) fn fill<S: Simd>(
        &mut self,
        simd: S,
        (tile, lens, hidden_from): (Tile, &KernelLens, f32),
        list: &[u32],
        (records, rects): (&[Record], &[Rect]),
    ) {
        let last = list.len().saturating_sub(1);
        let rect = |number: usize| &rects[list[number] as usize];
        self.outlines.begin_with(list.len(), 0);
        (self.opacities, self.thin, self.whole, self.rough) = (0, 0, 0, 0);
        self.is_taylor = lens.is_taylor;
        touch(records, list);
        for first in self.outlines.sixteens() {
            let own = Sixteen::of(
                simd,
                #[inline(always)]
                |number| &records[list[(first + number).min(last)] as usize],
            );
            self.outlines.set(simd, first, &own);
            let range = first..first + 16;
            for (column, color) in self.color.iter_mut().zip(own.color) {
                color.store_slice(&mut column[range.clone()]);
            }
            own.amplitude.store_slice(&mut self.amplitude[range.clone()]);
            own.ends.store_slice(&mut self.outlines.end[range]);
            self.opacities |= own.of_kind(simd, Kind::Opacity) << first & self.outlines.all();
        }
        self.is_linear = self.opacities == self.outlines.all();
        self.outlines.prepare(simd, tile);
        let mut hidden = 0;
        for first in self.outlines.sixteens() {
            self.prepare(simd, lens, first);
            let nearest = sixteen(simd, &self.outlines.depth, first) - sixteen(simd, &self.reach, first);
            hidden |= nearest.simd_gt(W::simd_from(simd, hidden_from)).to_bitmask() << first;
            self.whole |= nearest.simd_gt(W::simd_from(simd, lens.near)).to_bitmask() << first;
        }
        let others = self.outlines.all() & !self.thin;
        let are_many = ONE_THICK_OF * others.count_ones() as usize >= list.len();
        self.is_thick = self.opacities == 0 && !lens.is_taylor && !lens.closing.has_slabs() && are_many;
        self.plain = if self.is_thick { u64::MAX } else { self.thin };
        if let Closing::Slabs(slabs) = &lens.closing {
            self.slabs.at_centers = if lens.closing.is_mixed() { self.opacities } else { 0 };
            for first in self.outlines.sixteens() {
                self.prepare_slabs(simd, (tile, slabs), first);
            }
        }
        self.masks = self.outlines.blocks(simd, tile, !hidden, rect);
        // Their ellipses may lie between the pixels.
        let mut rough = self.rough & !hidden & self.outlines.all();
        while rough != 0 {
            let number = rough.trailing_zeros() as usize;
            self.masks.add_rect(number, rect(number), tile);
            rough &= rough - 1;
        }
    }

    /// Finds what follows from sixteen records.
    #[inline(always)]
    fn prepare<S: Simd>(&mut self, simd: S, lens: &KernelLens, first: usize) {
        let range = first..first + 16;
        let mut amplitude = sixteen(simd, &self.amplitude, first);
        // As opacities, which they are taken for where there are no slabs.
        if lens.is_taylor && !lens.closing.has_slabs() {
            amplitude = amplitude.min(W::simd_from(simd, 1.0));
        }
        let opacity = mask32x16::from_bitmask(simd, self.opacities >> first);
        let exact = mask32x16::from_bitmask(simd, self.outlines.exact >> first);
        let thin = if lens.is_taylor { TAYLOR } else { THIN };
        for ((column, thin), of_opacity) in self.alpha.iter_mut().zip(thin).zip(TAYLOR) {
            let alpha = opacity.select(W::simd_from(simd, of_opacity), W::simd_from(simd, thin));
            alpha.store_slice(&mut column[range.clone()]);
        }
        let is_thin = if lens.closing.has_slabs() {
            // Optical depths add up, and need no polynomial; nor do opacities that are composited whole.
            !exact | (opacity & mask32x16::splat(simd, lens.closing.is_mixed()))
        } else {
            let most = W::simd_from(simd, if lens.is_taylor { f32::INFINITY } else { THIN_PEAK });
            opacity | (amplitude.simd_le(most) & !exact)
        };
        self.thin |= is_thin.to_bitmask() << first;
        let end = W::simd_from(simd, lens.cutoff * HALF_LOG2_E);
        let end = opacity.select(sixteen(simd, &self.outlines.end, first).min(end), end);
        end.store_slice(&mut self.outlines.end[range.clone()]);
        (-end).store_slice(&mut self.least[range.clone()]);
        // Where kernels end their strengths are no subnormal numbers.
        let peak = log2(simd, amplitude.max(W::simd_from(simd, f32::MIN_POSITIVE))).max(end - 126.0);
        peak.store_slice(&mut self.peak[range.clone()]);
        // Σ_zz is σ_z² and what the slope of the depth adds over the footprint, |M⁻ᵀ slope|².
        let [a, b, c] = sixteen_of(simd, &self.outlines.root, first);
        let slope = sixteen_of(simd, &self.outlines.depth_slope, first);
        if lens.narrowest > 0.0 {
            let trace = a.mul_add(a, b.mul_add(b, c * c));
            let most = 2.0 * HALF_LOG2_E / (lens.narrowest * lens.narrowest);
            let narrow = trace.simd_gt(W::simd_from(simd, most));
            let border = exp2_from(simd, -end, -126.0) * amplitude;
            let rough = narrow | border.simd_gt(W::simd_from(simd, lens.highest_end));
            self.rough |= rough.to_bitmask() << first;
        }
        let x = slope[0] * reciprocal(simd, a);
        let y = (slope[1] - b * x) * reciprocal(simd, c);
        let reach = (x.mul_add(x, y * y) * end).sqrt()
            + sixteen(simd, &self.outlines.sigma_z, first) * (1.25 * REACH);
        reach.store_slice(&mut self.reach[range]);
    }

    /// Between which z records lie, with so many σ_z, in the block with a corner.
    #[inline(always)]
    pub(crate) fn spans_in<S: Simd>(&self, simd: S, (corner, reach): ([f32; 2], f32)) -> Spans {
        let (mut nearest, mut farthest) = ([0.0; BATCH], [0.0; BATCH]);
        for first in (0..BATCH).step_by(16) {
            let x = W::simd_from(simd, corner[0] + HALF_BLOCK) - sixteen(simd, &self.outlines.mean[0], first);
            let y = W::simd_from(simd, corner[1] + HALF_BLOCK) - sixteen(simd, &self.outlines.mean[1], first);
            let slope = sixteen_of(simd, &self.outlines.depth_slope, first);
            let (depth, sigma_z) =
                (sixteen(simd, &self.outlines.depth, first), sixteen(simd, &self.outlines.sigma_z, first));
            let exact = mask32x16::from_bitmask(simd, self.outlines.exact >> first);
            let middle = exact.select(depth, slope[0].mul_add(x, slope[1].mul_add(y, depth)));
            let half =
                sigma_z.mul_add(W::simd_from(simd, reach), (slope[0].abs() + slope[1].abs()) * HALF_BLOCK);
            let half = exact.select(sixteen(simd, &self.reach, first), half);
            (middle - half).store_slice(&mut nearest[first..first + 16]);
            (middle + half).store_slice(&mut farthest[first..first + 16]);
        }
        Spans { nearest, farthest }
    }

    /// Where records are from a segment that begins, and ends, between two depths; the first one begins at the near plane. Without
    /// spans there is only that, without an end.
    #[inline(always)]
    pub(crate) fn places<S: Simd>(
        &self,
        simd: S,
        spans: Option<&Spans>,
        (begin, end): (Option<[f32; 2]>, [f32; 2]),
    ) -> Places {
        let Some(Spans { nearest, farthest }) = spans else {
            debug_assert!(begin.is_none(), "where there are cuts there are spans");
            return Places { touched: u64::MAX, behind_begin: self.whole, before_end: u64::MAX };
        };
        // Behind the near plane lies what does so in every block.
        let [from, all_from] = begin.unwrap_or([f32::NEG_INFINITY; 2]);
        let mut places = Places::default();
        for first in (0..BATCH).step_by(16) {
            let (nearest, farthest) = (sixteen(simd, nearest, first), sixteen(simd, farthest, first));
            // Where one of them is none, nothing is known.
            let beside =
                nearest.simd_gt(W::simd_from(simd, end[1])) | farthest.simd_lt(W::simd_from(simd, from));
            let behind_begin = nearest.simd_gt(W::simd_from(simd, all_from));
            let before_end = farthest.simd_lt(W::simd_from(simd, end[0]));
            places.touched |= (!beside).to_bitmask() << first;
            places.behind_begin |= behind_begin.to_bitmask() << first;
            places.before_end |= before_end.to_bitmask() << first;
        }
        if begin.is_none() {
            places.behind_begin = self.whole;
        }
        places
    }

    /// 2^x down to where the kernel ends, 0 beyond and of NaN.
    #[inline(always)]
    pub(super) fn weight<S: Simd>(&self, simd: S, number: usize, exponent: W<S>) -> W<S> {
        exp2_from(simd, exponent, self.least[number])
    }

    #[inline(always)]
    pub(crate) fn color(&self, number: usize) -> [f32; 3] {
        [self.color[0][number], self.color[1][number], self.color[2][number]]
    }

    /// Whether strengths are opacities.
    #[inline(always)]
    pub(crate) fn is_opacity(&self, number: usize) -> bool {
        self.opacities >> number & 1 != 0
    }

    /// σ_z of a kernel in the affine form.
    #[inline(always)]
    pub(crate) fn sigma_z(&self, number: usize) -> f32 {
        self.outlines.sigma_z[number]
    }

    /// z at pixels.
    #[inline(always)]
    pub(crate) fn depth_at<S: Simd>(&self, simd: S, number: usize, pixels: [W<S>; 2]) -> W<S> {
        let offsets = self.outlines.offsets(simd, number, pixels);
        if !self.outlines.is_exact(number) {
            let Plane { depth, slope, .. } = self.outlines.plane(number);
            offsets.linear(simd, depth, slope)
        } else {
            Exact::new(simd, &offsets, &self.outlines.plane(number)).depth
        }
    }

    /// Strength, z and σ_z at pixels.
    #[inline(always)]
    pub(crate) fn fragments<S: Simd>(
        &self,
        simd: S,
        number: usize,
        pixels: [W<S>; 2],
        (tile, lens): (Tile, &KernelLens),
    ) -> Fragments<S> {
        let offsets = self.outlines.offsets(simd, number, pixels);
        let (amplitude, sigma_z) = (self.amplitude[number], self.outlines.sigma_z[number]);
        if !self.outlines.is_exact(number) {
            return Fragments {
                strength: self.weight(simd, number, offsets.exponent) * amplitude,
                depth: self.depth_at(simd, number, pixels),
                sigma_z: W::simd_from(simd, sigma_z),
            };
        }
        let Exact { exponent, depth, den, .. } = Exact::new(simd, &offsets, &self.outlines.plane(number));
        let scale = inverse_root(simd, den);
        let mut strength = self.weight(simd, number, exponent) * amplitude;
        if !self.is_opacity(number) {
            strength *= scale * lens.ray_lengths(simd, pixels, tile);
        }
        Fragments { strength, depth, sigma_z: scale * sigma_z }
    }
}

impl KernelLens {
    /// The same for a picture of every second pixel, or of still fewer.
    pub(crate) fn of_every(self, step: usize) -> Self {
        Self {
            lens: self.lens.of_every(step),
            closing: self.closing.of_every(step),
            narrowest: LEAST_SIGMA as f32 / step as f32,
            ..self
        }
    }

    /// |v| of the rays through a tile's pixels.
    #[inline(always)]
    pub(crate) fn ray_lengths<S: Simd>(&self, simd: S, pixels: [W<S>; 2], tile: Tile) -> W<S> {
        let one = W::simd_from(simd, 1.0);
        if self.lens.projection == Projection::Orthographic {
            return one;
        }
        let in_picture = [0, 1].each(
            #[inline(always)]
            |axis| pixels[axis] + (tile.origin[axis] as f32 + 0.5),
        );
        let [x, y, _] = self.lens.positions(in_picture, one);
        x.mul_add(x, y.mul_add(y, one)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_beyond_the_reach_to_cuts_is_a_share_of_the_tolerance() {
        // ∫ (x − r) φ(x) from the reach r on, by the trapezoidal rule; what lies beyond 12 is nothing.
        let beyond = |reach: f64| {
            let step = 1e-4;
            let density = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
            (0..120_000).map(|i| f64::from(i) * step).map(|x| x * density(reach + x) * step).sum::<f64>()
        };
        let mut before = 0.0;
        for tolerance in [1.0, 0.3, 8.0 / 255.0, 1.0 / 255.0, 1.0 / 2550.0, 7e-5] {
            let reach = f64::from(reach_to_cuts(tolerance));
            assert!(beyond(reach) <= tolerance / 8.0, "{tolerance}: {}", beyond(reach));
            assert!(reach >= before && reach <= f64::from(REACH));
            before = reach;
        }
        assert_eq!(reach_to_cuts(1e-9), REACH);
    }
}
