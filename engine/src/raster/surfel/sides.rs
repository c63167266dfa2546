//! Octets to the surfels that a tile needs of them, side by side.

use super::batch::Look;
use super::{FACES_AWAY, IS_EXACT, IS_PLAIN, Surfel, SurfelLens};
use crate::columns::LANES;
use crate::footprint::{EVENLY_COVERED, Octet};
use crate::raster::outline::{BATCH, Column, Outlines, Place, eight, sixteen};
use crate::simd::*;
use crate::tile::Tile;

/// What is known of a batch's surfels besides their outlines, until it is put down surfel by surfel.
pub(super) struct Sides {
    /// As in a [`Surfel`].
    pub(super) facing: Column,
    normal: [Column; 3],
    pub(super) least_reach: Column,
    /// Bits of the flags.
    flags: Column,
    /// Those of its octet and of itself in it.
    numbers: Column,
    /// As in a [`Look`]; old of octets of which all are plain.
    tint: [Column; 3],
    clear: Column,
    /// Coverage floors; then how even coverage is.
    even: Column,
}

impl Sides {
    pub(super) const NONE: Self = Self {
        facing: [1.0; BATCH],
        normal: [[0.0; BATCH]; 3],
        least_reach: [0.0; BATCH],
        flags: [0.0; BATCH],
        numbers: [0.0; BATCH],
        tint: [[0.0; BATCH]; 3],
        clear: [0.0; BATCH],
        even: [1.0; BATCH],
    };

    /// Puts in some surfels of an octet from a place on.
    #[inline(always)]
    pub(super) fn put<S: Simd>(
        &mut self,
        simd: S,
        place: Place<S>,
        (number, octet, floor): (u32, &Octet, f32),
        usual: [f32; 3],
    ) {
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let none = u32x8::simd_from(simd, 0);
        let [red, green, blue] = usual;
        let mut is_plain = M::splat(simd, true);
        if !octet.are_alike || octet.first_look != [red, green, blue, 1.0] {
            let look =
                if octet.are_alike { octet.first_look.map(|number| [number; LANES]) } else { octet.looks };
            let clear = one - V::simd_from(simd, look[3]);
            is_plain = clear.simd_le(zero);
            place.put(simd, &mut self.clear, &clear.into());
            place.put(simd, &mut self.even, &[floor; LANES]);
            for ((column, look), usual) in self.tint.iter_mut().zip(look).zip(usual) {
                let tint = V::simd_from(simd, look) - usual;
                is_plain &= tint.simd_eq(zero);
                place.put(simd, column, &tint.into());
            }
        }
        let flags = is_plain.select(u32x8::simd_from(simd, IS_PLAIN), none)
            | M::from_bitmask(simd, octet.exact.into()).select(u32x8::simd_from(simd, IS_EXACT), none);
        let numbers = u32x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]) + number * LANES as u32;
        place.put(simd, &mut self.flags, &V::from_bits(flags).into());
        place.put(simd, &mut self.numbers, &V::from_bits(numbers).into());
        place.put(simd, &mut self.facing, &octet.amplitude);
        for (column, normal) in self.normal.iter_mut().zip(&octet.normal) {
            place.put(simd, column, normal);
        }
    }

    /// Raises sixteen floors by the filter's share of footprints. As that and the share to which the filter dims a surfel add up to one at most
    /// (Minkowski's inequality), coverage is as even at least.
    #[inline(always)]
    pub(super) fn even_out<S: Simd>(&mut self, simd: S, first: usize, of_filter: W<S>) {
        let floor = sixteen(simd, &self.even, first);
        let even = floor.max(W::simd_from(simd, EVENLY_COVERED as f32));
        let own = (W::simd_from(simd, 1.0) - of_filter).sqrt();
        (floor - even).mul_add(own, even).store_slice(&mut self.even[first..first + 16]);
    }

    /// Which of the first ones are in the exact form.
    #[inline(always)]
    pub(super) fn exact(&self, count: usize) -> u64 {
        let is_exact = |number: usize| u64::from(self.flags[number].to_bits() & IS_EXACT != 0) << number;
        (0..count.min(BATCH)).map(is_exact).sum()
    }

    /// The numbers among all surfels.
    #[inline(always)]
    pub(super) fn numbers(&self) -> [u32; BATCH] {
        self.numbers.map(f32::to_bits)
    }

    /// Puts eight surfels down from a place on, and what is special about them if anything is.
    #[inline(always)]
    pub(super) fn set<S: Simd>(
        &self,
        simd: S,
        (first, outlines): (usize, &Outlines),
        surfels: &mut [Surfel; BATCH],
        looks: &mut [Look; BATCH],
    ) {
        let zero = splat(simd, 0.0);
        let none = u32x8::simd_from(simd, 0);
        let own = eight(simd, &self.flags, first).to_bits();
        let [x, y, z] = self.normal.each_ref().each(
            #[inline(always)]
            |column| eight(simd, column, first),
        );
        let columns = [
            &outlines.mean[0],
            &outlines.mean[1],
            &outlines.root[0],
            &outlines.root[1],
            &outlines.root[2],
            &outlines.depth,
            &outlines.depth_slope[0],
            &outlines.depth_slope[1],
            &self.least_reach,
        ];
        let [left, top, a, b, c, depth, across, down, reach] = columns.each(
            #[inline(always)]
            |column| eight(simd, column, first),
        );
        let facing = eight(simd, &self.facing, first);
        let away = (facing * depth).simd_gt(zero).select(u32x8::simd_from(simd, FACES_AWAY), none);
        // What isn't in the exact form has none of these; where nothing is, they are old.
        let is_exact = (own & IS_EXACT).simd_ne(none);
        let [per_depth, spread] = [&outlines.per_depth, &outlines.spread].each(
            #[inline(always)]
            |column| is_exact.select(eight(simd, column, first), zero),
        );
        let quads = [
            rows(simd, [left, top, a, b]),
            rows(simd, [c, depth, across, down]),
            rows(simd, [per_depth, spread, facing, x]),
            rows(simd, [y, z, reach, V::from_bits(own | away)]),
        ];
        for (lane, surfel) in surfels[first..first + LANES].iter_mut().enumerate() {
            surfel.set(quads.each_ref().each(
                #[inline(always)]
                |quad| &quad[lane],
            ));
        }
        if (own & IS_PLAIN).simd_eq(none).any_true() {
            let [red, green, blue] = self.tint.each_ref().each(
                #[inline(always)]
                |column| eight(simd, column, first),
            );
            let special = rows(simd, [red, green, blue, eight(simd, &self.clear, first)]);
            let looks = looks[first..first + LANES].iter_mut();
            for ((look, [red, green, blue, clear]), even) in looks.zip(special).zip(&self.even[first..]) {
                *look = Look { tint: [red, green, blue], clear, even: *even };
            }
        }
    }
}

/// Room for what is needed of a batch only while it is made.
pub(crate) struct Room {
    pub(super) outlines: Outlines,
    pub(super) sides: Sides,
}

impl Default for Room {
    fn default() -> Self {
        Self { outlines: Outlines::NONE, sides: Sides::NONE }
    }
}

impl SurfelLens {
    /// Which surfels of an octet may be seen in a tile: those whose ellipses' boxes reach into it, and what is in the exact form.
    #[inline(always)]
    pub(super) fn touching<S: Simd>(&self, simd: S, tile: Tile, octet: &Octet) -> M<S> {
        let [a, b, c] = octet.conic_root.each(
            #[inline(always)]
            |root| V::simd_from(simd, root),
        );
        // Rounding moves a pixel by less than this.
        const MARGIN: f32 = 0.02;
        let per_c = splat(simd, self.cutoff.sqrt()) / c;
        // √V_xx is √(b² + c²)/(ac).
        let reach = [b.mul_add(b, c * c).sqrt() * per_c / a, per_c];
        let half = (tile.side - 1) as f32 / 2.0;
        let is_near = [0, 1].each(
            #[inline(always)]
            |axis| {
                let middle = tile.origin[axis] as f32 + 0.5 + half;
                let far = (V::simd_from(simd, octet.mean[axis]) - middle).abs();
                far.simd_le(reach[axis] + (half + MARGIN))
            },
        );
        let exact = M::from_bitmask(simd, octet.exact.into());
        (is_near[0] & is_near[1] | exact) & M::from_bitmask(simd, octet.seen.into())
    }
}
