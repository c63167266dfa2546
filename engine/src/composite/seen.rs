//! What is seen of blocks so far, in memory and in registers.

use crate::cuts::Cut;
use crate::simd::*;
use crate::tile::{Plane, Tile};

/// What is seen of a block of pixels so far.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Seen {
    /// Red, green, blue, each times its contribution.
    pub(crate) color: [Plane; 3],
    /// What does not pass. Kept instead of the transmittance, of which 1 − α loses the thinnest media.
    pub(crate) opacity: Plane,
    /// z times its contribution; kept only where it is asked for.
    pub(crate) depth: Plane,
    /// z at which the transmittance has fallen to a half; ∞ where it has not. Kept only where depth is, as is the opacity at
    /// which that happens: less than a half behind other segments.
    pub(crate) median: Plane,
    pub(super) half: Plane,
}

impl Seen {
    /// Nothing there.
    pub(crate) const CLEAR: Self = Self {
        color: [Plane::ZERO; 3],
        opacity: Plane::ZERO,
        depth: Plane::ZERO,
        median: Plane::INFINITY,
        half: Plane::HALF,
    };
}

/// The runs of a tile: for each segment between cuts, near to far, its blocks.
pub(crate) struct Runs {
    pub(super) segments: Vec<Vec<Seen>>,
    /// The distance from which on kernels make no difference, for nothing is seen through those before or they lie behind cuts; ∞ if
    /// there is none.
    pub(crate) reached: f32,
    /// Blocks in which there are rough kernels.
    pub(crate) rough: u64,
}

impl Runs {
    pub(crate) fn new() -> Self {
        Self { segments: Vec::new(), reached: f32::INFINITY, rough: 0 }
    }

    /// Clears as many segments as the cuts make.
    #[inline(always)]
    pub(crate) fn clear<S: Simd>(&mut self, simd: S, tile: Tile, segments: usize) {
        (self.reached, self.rough) = (f32::INFINITY, 0);
        self.segments.resize_with(segments.max(self.segments.len()), Vec::new);
        for blocks in &mut self.segments[..segments] {
            blocks.clear();
            blocks.resize(tile.blocks(), Seen::CLEAR);
        }
        // What lies beside the picture is done.
        for (number, block) in self.segments[0].iter_mut().enumerate() {
            let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
            block.opacity.store(tile.inside(simd, number).select(zero, one));
        }
    }

    /// What the pixels of a block without cuts send and let through.
    pub(crate) fn block_mut(&mut self, block: usize) -> &mut Seen {
        &mut self.segments[0][block]
    }

    /// What the pixels of a block send and let through in a segment.
    pub(crate) fn block(&self, segment: usize, block: usize) -> &Seen {
        &self.segments[segment][block]
    }
}

/// [`Seen`] in registers: what a block of rays sends towards the camera, and does not let through.
#[derive(Clone, Copy)]
pub(crate) struct Seeing<S: Simd> {
    pub(crate) opacity: W<S>,
    pub(crate) color: [W<S>; 3],
    pub(crate) depth: W<S>,
    pub(crate) median: W<S>,
    pub(super) half: W<S>,
}

impl<S: Simd> Seeing<S> {
    #[inline(always)]
    pub(crate) fn load(simd: S, seen: &Seen) -> Self {
        let Seen { opacity, color: [red, green, blue], depth, median, half } = seen;
        Self {
            opacity: opacity.load(simd),
            color: [red.load(simd), green.load(simd), blue.load(simd)],
            depth: depth.load(simd),
            median: median.load(simd),
            half: half.load(simd),
        }
    }

    #[inline(always)]
    pub(super) fn store(&self, seen: &mut Seen) {
        seen.opacity.store(self.opacity);
        for (plane, color) in seen.color.iter_mut().zip(&self.color) {
            plane.store(*color);
        }
        seen.depth.store(self.depth);
        seen.median.store(self.median);
    }

    /// One layer alone.
    #[inline(always)]
    pub(crate) fn layer(simd: S, color: [W<S>; 3], depth: W<S>, alpha: W<S>) -> Self {
        let color = color.each(
            #[inline(always)]
            |c| c * alpha,
        );
        let half = W::simd_from(simd, 0.5);
        Self { opacity: alpha, color, depth: depth * alpha, median: depth, half }
    }

    /// (C, T)∘(C', T') = (C + T·C', T·T').
    #[inline(always)]
    pub(crate) fn over(self, simd: S, behind: Self) -> Self {
        let (one, half) = (W::simd_from(simd, 1.0), W::simd_from(simd, 0.5));
        let through = one - self.opacity;
        let opacity = behind.opacity.mul_add(through, self.opacity);
        let comes_behind = self.opacity.simd_lt(half) & opacity.simd_ge(half);
        Self {
            opacity,
            color: [0, 1, 2].each(
                #[inline(always)]
                |i| behind.color[i].mul_add(through, self.color[i]),
            ),
            depth: behind.depth.mul_add(through, self.depth),
            median: comes_behind.select(behind.median_or_mean(simd), self.median),
            half: self.half,
        }
    }

    /// Puts something flat behind: its opacity and its z, and its colour at all pixels.
    #[inline(always)]
    pub(super) fn show<const DEPTH: bool>(&mut self, simd: S, [alpha, depth]: [W<S>; 2], color: [f32; 3]) {
        let color = color.each(
            #[inline(always)]
            |own| W::simd_from(simd, own),
        );
        self.show_in::<DEPTH>([alpha, depth], color);
    }

    /// The same with a colour at each pixel.
    #[inline(always)]
    pub(super) fn show_in<const DEPTH: bool>(&mut self, [alpha, depth]: [W<S>; 2], color: [W<S>; 3]) {
        let before = self.opacity;
        let shown = (-before).mul_add(alpha, alpha);
        self.opacity = before + shown;
        for (sum, own) in self.color.iter_mut().zip(color) {
            *sum = shown.mul_add(own, *sum);
        }
        if DEPTH {
            self.depth = shown.mul_add(depth, self.depth);
            let is_half = self.opacity.simd_ge(self.half) & before.simd_lt(self.half);
            self.median = is_half.select(depth, self.median);
        }
    }

    /// The median; the mean where rounding has it that half of the light isn't lost yet.
    #[inline(always)]
    fn median_or_mean(&self, simd: S) -> W<S> {
        let mean = self.depth / self.opacity.max(W::simd_from(simd, 1e-30));
        self.median.simd_lt(W::simd_from(simd, f32::INFINITY)).select(self.median, mean)
    }

    /// Where it is known only in the end that half of the light is lost here, since what lies in nearer segments was still open, the median is
    /// the mean.
    #[inline(always)]
    pub(super) fn place_missed(&mut self, simd: S) {
        let is_missed =
            self.opacity.simd_ge(self.half) & self.median.simd_eq(W::simd_from(simd, f32::INFINITY));
        if is_missed.any_true() {
            let mean = self.depth / self.opacity.max(W::simd_from(simd, 1e-30));
            let is_seen = self.opacity.simd_gt(W::simd_from(simd, 0.0));
            self.median = (is_missed & is_seen).select(mean, self.median);
        }
    }
}

/// What is seen through the segments of a block so far; only where depth is asked for.
#[derive(Clone, Copy)]
pub(super) struct Through<S: Simd>(W<S>);

impl<S: Simd> Through<S> {
    #[inline(always)]
    pub(super) fn all(simd: S) -> Self {
        Self(W::simd_from(simd, 1.0))
    }

    /// Says to the next segment at which opacity of its own half of the light is left.
    #[inline(always)]
    pub(super) fn tell(self, simd: S, next: &mut Seen) {
        let least = W::simd_from(simd, 1e-6);
        next.half.store(W::simd_from(simd, 1.0) - W::simd_from(simd, 0.5) / self.0.max(least));
    }

    /// Passes a segment of an opacity and the cut behind it.
    #[inline(always)]
    pub(super) fn pass(self, simd: S, opacity: W<S>, cut: Option<&Cut>) -> Self {
        let one = W::simd_from(simd, 1.0);
        let alpha = cut.map_or(W::simd_from(simd, 0.0), |cut| cut.alpha.load(simd));
        Self(self.0 * (one - opacity) * (one - alpha))
    }
}
