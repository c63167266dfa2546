//! Layers that are two sheets: the near one hides the colours of the far one.

use super::list::Listed;
use super::sums::Sums;
use super::{Here, LayerBuilder, Own, Peel};
use crate::raster::Surfels;
use crate::simd::*;

/// Sheets nearer than this share of the depth tolerance are one; as far again, and they are two.
const LEAST_GAP: f32 = 1.0 / 16.0;

/// The share of the variance of a layer's depths that two sheets make by being apart: of samples spread evenly it is the first, from the second on they are two.
const APART: [f32; 2] = [0.75, 0.9];

impl LayerBuilder<'_> {
    /// Which pixels have samples that cover more than one sheet does, aren't all at one depth, and don't all look as most of the tile does.
    #[inline(always)]
    pub(super) fn may_be_two<S: Simd>(&self, simd: S, peel: &Peel<S>, sums: &Sums<S>) -> mask32x16<S> {
        let is_special = sums.special.simd_gt(W::simd_from(simd, 0.0));
        if !is_special.any_true() {
            return is_special;
        }
        let is_apart = sums.depth.simd_gt(sums.weight() * peel.tolerance * (0.5 * LEAST_GAP));
        is_special & is_apart & self.sheets(simd, peel, sums).simd_gt(W::simd_from(simd, 1.0))
    }

    /// How many times a layer covers its share of the pixel, 1 being what a single sheet does on average.
    #[inline(always)]
    fn sheets<S: Simd>(&self, simd: S, peel: &Peel<S>, sums: &Sums<S>) -> W<S> {
        let [front, back] = self.coverage(simd, (sums, peel.cloud));
        sums.weight() * peel.floor / front.max(back).min(W::simd_from(simd, 1.0))
    }

    /// Leaves out of a layer's colours what a near sheet of it hides of a far one.
    ///
    /// The sheets are what has its plane before the planes' mean depth and what has it behind, as far as the means of both are what the planes' depths vary by.
    /// They lie beside each other as long as there is room.
    #[inline(always)]
    pub(super) fn part<S: Simd>(
        &self,
        simd: S,
        (batches, here): (&[Surfels], Here<S>),
        listed: &[Listed],
        (peel, sums): (&Peel<S>, &mut Sums<S>),
    ) {
        let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
        let may_be_two = self.may_be_two(simd, peel, sums);
        let weight = sums.weight();
        let seen_behind = sums.depth / weight;
        let farthest = may_be_two.select(peel.limit, -W::simd_from(simd, f32::INFINITY)).reduce_max();
        let own = || listed.iter().filter(|candidate| candidate.nearest <= farthest);
        let mut depth = zero;
        for candidate in own() {
            let [weight, behind] = self.plane(simd, (batches, here), candidate, peel);
            depth = weight.mul_add(behind, depth);
        }
        let mean = depth / weight;
        // Squares of planes' distances from there; of the near sheet weights, planes' depths, opacity and tints.
        let (mut squares, mut near, mut near_depth, mut near_shown) = (zero, zero, zero, zero);
        let mut near_tint = [zero; 3];
        for candidate in own() {
            let (surfels, number) = candidate.of(batches);
            let surfel = surfels.get(number);
            let [weight, behind] = self.plane(simd, (batches, here), candidate, peel);
            let from_mean = behind - mean;
            let own = from_mean.simd_le(zero).select(weight, zero);
            squares = (weight * from_mean).mul_add(from_mean, squares);
            near += own;
            near_depth = own.mul_add(behind, near_depth);
            if surfel.is_plain() {
                near_shown += own;
            } else {
                let look = surfels.look(number);
                near_shown = own.mul_add(W::simd_from(simd, look.opacity), near_shown);
                near_tint = [0, 1, 2].each(
                    #[inline(always)]
                    |i| own.mul_add(W::simd_from(simd, look.tint[i]), near_tint[i]),
                );
            }
        }
        let far = weight - near;
        let is_two = may_be_two & near.simd_gt(zero) & far.simd_gt(zero);
        let apart = (depth - near_depth) / far - near_depth / near;
        let between = apart * apart * (near * far / (weight * weight));
        let variance = squares / weight;
        // How clearly there are two.
        let from_to = |value: W<S>, from: W<S>, to: W<S>| {
            value.simd_gt(from).select(((value - from) / (to - from)).min(one), zero)
        };
        let least = peel.tolerance * LEAST_GAP;
        let clearly = from_to(self.sheets(simd, peel, sums), one, W::simd_from(simd, 2.0) - peel.floor)
            * from_to(between, variance * APART[0], variance * APART[1])
            * from_to(apart, least, least * 2.0)
            * from_to(seen_behind, least * 0.5, least);
        let [near_covered, far_covered] = [near.min(one), far.min(one)];
        let beside = far_covered.min(one - near_covered) / far_covered;
        let hidden = is_two.select(clearly * (near_shown / near) * (one - beside), zero);
        let far_shown = weight - sums.special + sums.shown - near_shown;
        sums.hidden = far_shown * hidden;
        for (sum, near) in sums.tint.iter_mut().zip(near_tint) {
            *sum = *sum - (*sum - near) * hidden;
        }
        sums.is_parted = true;
    }

    /// The weights that the layer has of a record, and how far behind the first samples its plane is.
    #[inline(always)]
    fn plane<S: Simd>(
        &self,
        simd: S,
        (batches, here): (&[Surfels], Here<S>),
        candidate: &Listed,
        peel: &Peel<S>,
    ) -> [W<S>; 2] {
        let zero = W::simd_from(simd, 0.0);
        let (surfels, number) = candidate.of(batches);
        let Own { weight, .. } = self.own(simd, (batches, here), candidate, peel);
        let plane = surfels.slant(number).plane(simd, here.pixels, (candidate.depth.load(simd), &self.lens));
        [weight, weight.simd_gt(zero).select(plane - peel.depth, zero)]
    }
}
