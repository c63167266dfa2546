//! What a layer's samples add up to, and what is seen through layers.

use crate::frame::LEAST_VISIBLE;
use crate::raster::{Look, Surfel};
use crate::simd::*;

/// A layer that lets through less counts as one sheet: what it lets through is a difference of two sums, most of it rounding.
const LEAST_CLEAR: f32 = 1e-5;

/// What sums of hundreds of equal samples may be off by.
const ROUNDING: f32 = 4e-6;

/// Sums over the samples of a layer.
#[derive(Clone, Copy)]
pub(super) struct Sums<S: Simd> {
    /// Of the splats that show their front, and of those that show their back. The two sides of a thin sheet would
    /// cancel, so their normals are never added.
    pub(super) front: Side<S>,
    pub(super) back: Side<S>,
    /// Of how far colours are from the tile's usual one, which surfaces most often have all over, times their opacity.
    pub(super) tint: [W<S>; 3],
    /// Of depths behind the first sample's.
    pub(super) depth: W<S>,
    /// Of those that aren't plain: of weights, and of opacity.
    pub(super) special: W<S>,
    pub(super) shown: W<S>,
    /// How much less of all is shown than opacities say, since a near sheet hides a far one; whether any.
    pub(super) hidden: W<S>,
    pub(super) is_parted: bool,
    /// Of (1 − opacity)², and of 1 − opacity by how even coverage is.
    clear_squared: W<S>,
    even: W<S>,
}

#[derive(Clone, Copy)]
pub(super) struct Side<S: Simd> {
    pub(super) weight: W<S>,
    pub(super) normal: [W<S>; 3],
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    pub(super) fn zero(simd: S) -> Self {
        let zero = W::simd_from(simd, 0.0);
        let side = Side { weight: zero, normal: [zero; 3] };
        Self {
            front: side,
            back: side,
            tint: [zero; 3],
            depth: zero,
            special: zero,
            shown: zero,
            hidden: zero,
            is_parted: false,
            clear_squared: zero,
            even: zero,
        }
    }

    #[inline(always)]
    pub(super) fn weight(&self) -> W<S> {
        self.front.weight + self.back.weight
    }

    /// Adds samples of a surfel, by their weights and how far they are behind the first ones.
    #[inline(always)]
    pub(super) fn add(&mut self, simd: S, (surfel, look): (&Surfel, &Look), [weight, behind]: [W<S>; 2]) {
        self.depth = behind.mul_add(weight, self.depth);
        if !surfel.is_plain() {
            let clear = 1.0 - look.opacity;
            // Of opaque ones bit for bit the same.
            self.special += weight;
            self.shown = weight.mul_add(W::simd_from(simd, look.opacity), self.shown);
            self.even = weight.mul_add(W::simd_from(simd, clear * look.even), self.even);
            self.clear_squared = weight.mul_add(W::simd_from(simd, clear * clear), self.clear_squared);
            self.tint = [0, 1, 2].each(
                #[inline(always)]
                |i| weight.mul_add(W::simd_from(simd, look.tint[i]), self.tint[i]),
            );
        }
        // An index would keep both sides in memory.
        if surfel.faces_away() {
            self.back.add(simd, surfel, weight);
        } else {
            self.front.add(simd, surfel, weight);
        }
    }

    /// The opacity of a layer that covers `coverage` of the pixel, and what tints are multiplied by; weights are multiplied by `inverse`.
    ///
    /// A layer may be several sheets, one behind the other: as many as it covers its share times. But what a single one may cover too
    /// much by unevenness is none, and twice that is as much. Samples of one sheet lie beside each other, and let through their mean. Those of
    /// several lie behind each other, and let through the product of their means: of two, m − d and m + d, that is m² − d², where all
    /// samples together have the mean m and the variance d². So an opaque sheet hides what shares its layer.
    #[inline(always)]
    pub(super) fn opacity(&self, simd: S, coverage: W<S>, inverse: W<S>) -> [W<S>; 2] {
        let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
        let (weight, clear) = (self.weight(), self.special - self.shown);
        let opacity = one - (clear * inverse).min(one);
        if !clear.simd_gt(zero).any_true() {
            let of_shown = if self.is_parted { one / (weight - self.hidden) } else { inverse };
            return [opacity, inverse.simd_gt(zero).select(of_shown, zero)];
        }
        // What rounding leaves of a clear layer has no colour; neither that nor what is left of nothing is more in several sheets.
        let is_visible = opacity.simd_gt(W::simd_from(simd, LEAST_VISIBLE));
        let shown = weight - self.special + self.shown - self.hidden;
        let of_shown = (is_visible & inverse.simd_gt(zero)).select(one / shown, zero);
        let (even, times) = (self.even / clear, weight / coverage);
        let more = times.mul_sub(even, one);
        let twice_beyond = (more - (one - even)) * 2.0;
        let is_seen_through = (clear * inverse).simd_gt(W::simd_from(simd, LEAST_CLEAR));
        let is_many = twice_beyond.simd_gt(zero) & is_visible & is_seen_through;
        if !is_many.any_true() {
            return [opacity, of_shown];
        }
        let sheets = twice_beyond.min(more) + one;
        let deep = crate::simd::opacity(simd, optical_depth(simd, opacity) * sheets);
        // Beside the squared mean, but for what rounding leaves of nothing; as many more sheets as there may be.
        let variance = (self.clear_squared * weight / (clear * clear) - (1.0 + ROUNDING)).max(zero);
        let hidden = (twice_beyond.min(times / even - one) * variance).min(one);
        [is_many.select((one - deep).mul_add(hidden, deep), opacity), of_shown]
    }
}

impl<S: Simd> Side<S> {
    #[inline(always)]
    fn add(&mut self, simd: S, surfel: &Surfel, weight: W<S>) {
        self.weight += weight;
        self.normal = [0, 1, 2].each(
            #[inline(always)]
            |axis| weight.mul_add(W::simd_from(simd, surfel.normal[axis]), self.normal[axis]),
        );
    }
}

/// How far one sees into a pixel past its layers so far.
///
/// Coverage is a share of the pixel's area. Fronts cover first what fronts have left bare, and only then what these
/// cover already, and so do backs: the parts of one surface that fall into two layers, at a crease or along a silhouette, lie
/// beside each other. Were they independent, every such pixel would let the background through. But a front and a back meet only
/// where a sheet folds, and there both end at one line: what one covers, the other covers, too.
#[derive(Clone, Copy)]
pub(super) struct SeenThrough<S: Simd> {
    /// Shares of the pixel that fronts cover, and that backs do.
    sides: [W<S>; 2],
    /// What they cover together.
    covered: W<S>,
    /// What the covered share lets through, as a share of the pixel.
    veiled: W<S>,
}

impl<S: Simd> SeenThrough<S> {
    #[inline(always)]
    pub(super) fn all(simd: S) -> Self {
        let zero = W::simd_from(simd, 0.0);
        Self { sides: [zero; 2], covered: zero, veiled: zero }
    }

    /// Puts a layer behind, by the coverage of its fronts and of its backs; gives the opacity with which it is composited, and what is still seen.
    #[inline(always)]
    pub(super) fn cover(&mut self, simd: S, [front, back]: [W<S>; 2], opacity: W<S>) -> [W<S>; 2] {
        let (one, zero) = (W::simd_from(simd, 1.0), W::simd_from(simd, 0.0));
        let covered = self.covered;
        let before = one - covered + self.veiled;
        self.sides = [(self.sides[0] + front).min(one), (self.sides[1] + back).min(one)];
        let all = self.together(simd).max(covered);
        self.covered = all;
        let beside = all - covered;
        let again = (front.max(back).min(one) - beside).max(zero);
        let behind = covered.simd_gt(zero).select(again / covered, zero);
        self.veiled = self.veiled * (one - opacity * behind) + beside * (one - opacity);
        let after = one - all + self.veiled;
        let alpha = before.simd_gt(zero).select(one - after / before, one);
        [alpha, after]
    }

    /// The share of the pixel that both sides cover together: the greater one, within which the lesser lies unless it is so little beside it that it is
    /// samples turned here and there.
    #[inline(always)]
    fn together(&self, simd: S) -> W<S> {
        let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
        let [front, back] = self.sides;
        let (most, least) = (front.max(back), front.min(back));
        let mut beside = most.simd_gt(zero).select(one - least / most, zero);
        for _ in 0..3 {
            beside = beside * beside;
        }
        least.mul_add(beside, most).min(one)
    }
}
