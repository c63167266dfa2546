//! Which neighbouring pixels show one surface.

use super::RgbdImage;
use super::lanes::*;
use oblate_engine::simd::{Level, dispatch};
use rayon::prelude::*;

/// Depths of neighbours that differ by at most so many pixel widths belong to one surface, whatever it is like beyond them: up to
/// 84.6° to the ray. Depth cameras count in steps of several pixel widths.
const STEP: f32 = 10.6;

/// Where the surface goes on as it began on one side, up to so many: 88°.
pub(super) const STEEPEST: f32 = 28.6;

/// How far, in pixel widths, depths may lie off what goes on as it began; and as a share of the step.
const OFF: [f32; 2] = [0.5, 0.1];

/// Scattered depths are of one surface up to 72° to the ray, in pixel widths a pixel; in any case where they differ by a tenth, as rows
/// of laser scanners on the ground do, and never where they differ by more than a quarter.
const SLOPE: f32 = 3.0;
const SHARES: [f32; 2] = [0.1, 0.25];

/// Tells steps from surfaces.
#[derive(Clone, Copy)]
pub(super) struct Steps {
    /// Focal lengths in pixels.
    focal: [f32; 2],
}

impl Steps {
    pub(super) fn of(image: &RgbdImage) -> Self {
        Self { focal: image.intrinsics.focal.as_vec2().to_array() }
    }

    /// Whether depths in one pixel, or in neighbours, are of one surface.
    pub(super) fn are_one_surface(&self, [a, b]: [f32; 2]) -> bool {
        (a - b).abs() * self.focal[0].min(self.focal[1]) <= STEP * a.min(b)
    }

    /// Whether depths that are several pixels apart are taken for one surface, with nothing known between them.
    pub(super) fn may_go_on(&self, [a, b]: [f32; 2], pixels: f32) -> bool {
        let slope = SLOPE * pixels / self.focal[0].min(self.focal[1]);
        (a - b).abs() <= slope.clamp(SHARES[0], SHARES[1]) * a.min(b)
    }

    /// Whether inverse depths of known pixels beside each other are of one surface, whatever it is like beyond them.
    #[inline(always)]
    pub(super) fn are_near<S: Simd>(&self, simd: S, [a, b]: [F<S>; 2]) -> <F<S> as SimdBase<S>>::Mask {
        let focal = self.focal[0].min(self.focal[1]);
        ((a - b).abs() * focal).simd_le(a.min(b) * splat(simd, STEP))
    }

    /// 1 where the second and third of four pixels in a line are of one surface, 0 elsewhere. They are given by their inverse depths, 0
    /// where unknown: in 1/z planes are linear, and so is what goes on as it began.
    #[inline(always)]
    fn links<S: Simd>(&self, simd: S, [before, near, far, after]: [F<S>; 4], axis: usize) -> F<S> {
        let (zero, least) = (splat(simd, 0.0), near.min(far));
        // In pixel widths at the nearer of both, times the lesser inverse depth: nothing is divided.
        let step = (far - near).abs() * self.focal[axis];
        let off = least.mul_add(splat(simd, OFF[0]), step * OFF[1]);
        let is_steep_surface = self.goes_on(simd, [before, near, far], (axis, off))
            | self.goes_on(simd, [after, far, near], (axis, off));
        let is_small = step.simd_le(least * STEP);
        let is_one = is_small | (step.simd_le(least * STEEPEST) & is_steep_surface);
        (least.simd_gt(zero) & is_one).select(splat(simd, 1.0), zero)
    }

    /// Whether what comes third goes on as the first two began, but for what it may be off.
    #[inline(always)]
    fn goes_on<S: Simd>(
        &self,
        simd: S,
        [from, by, to]: [F<S>; 3],
        (axis, off): (usize, F<S>),
    ) -> <F<S> as SimdBase<S>>::Mask {
        let (zero, expected) = (splat(simd, 0.0), by + by - from);
        let is_expected = ((expected - to).abs() * by * self.focal[axis]).simd_le(off * expected);
        from.simd_gt(zero) & expected.simd_gt(zero) & is_expected
    }
}

/// Links between the pixels of a depth image: 1 where both show one surface, else 0.
#[derive(Default)]
pub(super) struct Edges {
    /// Between each pixel and the one to its right.
    pub(super) right: Bordered,
    /// And the one below.
    pub(super) below: Bordered,
}

impl Edges {
    /// Of inverse depths along the axis, 0 where unknown, of an image of a size; in the memory of another's.
    pub(super) fn of(
        level: Level,
        (size, inverses): ([usize; 2], &Bordered),
        steps: &Steps,
        memory: Self,
    ) -> Self {
        let [mut right, mut below] = [memory.right, memory.below].map(|old| old.renewed(size));
        right.rows().zip(below.rows()).enumerate().for_each(|(row, rows)| {
            let place = inverses.place([0, row]);
            dispatch!(level, simd => steps.link_row(simd, (inverses, place), rows));
        });
        Self { right, below }
    }
}

impl Steps {
    /// Fills a row, which begins at a place, of both.
    #[inline(always)]
    fn link_row<S: Simd>(
        &self,
        simd: S,
        (inverses, place): (&Bordered, usize),
        (right, below): (&mut [f32], &mut [f32]),
    ) {
        let groups = right.chunks_exact_mut(LANES).zip(below.chunks_exact_mut(LANES));
        for (number, (right, below)) in groups.enumerate() {
            let place = place + number * LANES;
            for (links, axis, step) in [(right, 0, 1), (below, 1, inverses.stride)] {
                let line = [
                    inverses.load(simd, place - step),
                    inverses.load(simd, place),
                    inverses.load(simd, place + step),
                    inverses.load(simd, place + 2 * step),
                ];
                self.links(simd, line, axis).store_slice(links);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_told_from_steps() {
        let focal = 500.0;
        let wall = 2.0;
        let widths = |n: f32| n * wall / focal;
        let steps = Steps { focal: [focal; 2] };
        let linked = |depths: [f32; 4]| {
            let inverses = depths.map(|depth| if depth > 0.0 { 1.0 / depth } else { 0.0 });
            dispatch!(Level::best(), simd => steps.links(simd, inverses.map(|x| splat(simd, x)), 0)[0] == 1.0)
        };
        assert!(linked([wall; 4]));
        // What a depth camera counts in is no edge, a step of more is one, whichever side it is on.
        assert!(linked([wall, wall, wall + widths(5.0), wall + widths(5.0)]));
        assert!(!linked([wall, wall, wall + widths(12.0), wall + widths(12.0)]));
        assert!(!linked([wall + widths(12.0), wall + widths(12.0), wall, wall]));
        // A floor seen at a grazing angle: 1/z is linear.
        let floor = |x: f32| 1.0 / (0.5 - x * 0.02);
        assert!(
            linked([0.0, 1.0, 2.0, 3.0].map(floor)) && (floor(2.0) - floor(1.0)) * focal / floor(1.0) > STEP
        );
        // And where it ends at an edge.
        assert!(linked([0.0, floor(1.0), floor(2.0), floor(3.0)]));
        assert!(!linked([0.0, floor(1.0), floor(2.0), 0.0]));
        // Steeper than 88° nothing is one.
        let sheer = |x: f32| 1.0 / (0.5 - x * 0.06);
        assert!(!linked([0.0, 1.0, 2.0, 3.0].map(sheer)));
        // Unknown depths are linked to nothing.
        assert!(!linked([wall, wall, 0.0, wall]) && !linked([wall, 0.0, wall, wall]));
    }
}
