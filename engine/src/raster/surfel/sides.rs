//! Octets to the surfels that a tile needs of them, side by side.

use super::batch::Look;
use super::{CLOUD, FACES_AWAY, IS_EXACT, IS_PLAIN, Slant, Surfel, SurfelLens};
use crate::columns::LANES;
use crate::footprint::{EVENLY_COVERED, Octet};
use crate::raster::column::{BATCH, Column, Place, eight, eight_of, sixteen};
use crate::raster::outline::Outlines;
use crate::simd::*;
use crate::tile::Tile;
use bytemuck::cast;

/// What is known of a batch's surfels besides their outlines, until it is put down surfel by surfel.
pub(super) struct Sides {
    /// As in a [`Surfel`].
    pub(super) facing: Column,
    normal: [Column; 3],
    /// As in an octet.
    pub(super) tilt: [Column; 2],
    /// Bits of the flags.
    flags: Column,
    /// Those of its octet and of itself in it.
    numbers: Column,
    /// As in a [`Look`]; old of octets of which all are plain.
    tint: [Column; 3],
    opacity: Column,
    /// Coverage floors; then how even coverage is.
    even: Column,
    /// What is made of them, as in a [`Surfel`] and a [`Slant`].
    pub(super) along: [Column; 3],
    pub(super) across: [Column; 2],
    pub(super) plane: [Column; 3],
    /// The least one, how far planes are followed, how much thicker layers are.
    pub(super) reaches: [Column; 3],
}

impl Sides {
    pub(super) const NONE: Self = Self {
        facing: [1.0; BATCH],
        normal: [[0.0; BATCH]; 3],
        tilt: [[0.0; BATCH]; 2],
        flags: [0.0; BATCH],
        numbers: [0.0; BATCH],
        tint: [[0.0; BATCH]; 3],
        opacity: [1.0; BATCH],
        even: [1.0; BATCH],
        along: [[0.0; BATCH]; 3],
        across: [[0.0; BATCH]; 2],
        plane: [[1.0; BATCH]; 3],
        reaches: [[0.0; BATCH]; 3],
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
            let opacity = V::simd_from(simd, look[3]);
            is_plain = opacity.simd_ge(one);
            place.put(simd, &mut self.opacity, &opacity.into());
            place.put(simd, &mut self.even, &[floor; LANES]);
            for ((column, look), usual) in self.tint.iter_mut().zip(look).zip(usual) {
                let tint = V::simd_from(simd, look) - usual;
                is_plain &= tint.simd_eq(zero);
                place.put(simd, column, &(tint * opacity).into());
            }
        }
        let flags = is_plain.select(u32x8::simd_from(simd, IS_PLAIN), none)
            | M::from_bitmask(simd, octet.exact.into()).select(u32x8::simd_from(simd, IS_EXACT), none)
            | octet.cloud << CLOUD;
        let numbers = u32x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]) + number * LANES as u32;
        place.put(simd, &mut self.flags, &V::from_bits(flags).into());
        place.put(simd, &mut self.numbers, &V::from_bits(numbers).into());
        place.put(simd, &mut self.facing, &octet.amplitude);
        for (column, normal) in self.normal.iter_mut().zip(&octet.normal) {
            place.put(simd, column, normal);
        }
        for (column, tilt) in self.tilt.iter_mut().zip(&octet.amplitude_slope) {
            place.put(simd, column, tilt);
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

    /// A surfel's number among all.
    #[inline(always)]
    pub(super) fn number(&self, number: usize) -> u32 {
        self.numbers[number % BATCH].to_bits()
    }

    /// Puts eight surfels down from a place on, and what is special about them if anything is.
    #[inline(always)]
    pub(super) fn set<S: Simd>(
        &self,
        simd: S,
        lens: &SurfelLens,
        (first, outlines, line): (usize, &Outlines, &[Column; 3]),
        (surfels, slants, looks): (&mut [Surfel; BATCH], &mut [Slant; BATCH], &mut [Look; BATCH]),
    ) {
        let (zero, none) = (splat(simd, 0.0), u32x8::simd_from(simd, 0));
        let own = eight(simd, &self.flags, first).to_bits();
        let [depth, sigma_z] = [&outlines.depth, &outlines.sigma_z].each(
            #[inline(always)]
            |column| eight(simd, column, first),
        );
        // Of what isn't in the exact form this is old.
        let is_exact = (own & IS_EXACT).simd_ne(none);
        let spread = is_exact.select(eight(simd, &outlines.spread, first), zero);
        let facing = eight(simd, &self.facing, first);
        // n·v as it is, and by z of the centre where rays meet in the eye.
        let away = if lens.is_perspective { facing * depth } else { facing };
        let away = away.simd_gt(zero).select(u32x8::simd_from(simd, FACES_AWAY), none);
        let [x, y, z] = eight_of(simd, &self.normal, first);
        let [reach, farthest_offset, thickness] = eight_of(simd, &self.reaches, first);
        let [at_first, a, b] = eight_of(simd, &self.along, first);
        let [across, c] = eight_of(simd, &self.across, first);
        let [line, to_right, down] = eight_of(simd, line, first);
        let quads = [
            rows(simd, [at_first, a, b, across]),
            rows(simd, [c, line, to_right, down]),
            rows(simd, [depth, spread, facing, x]),
            rows(simd, [y, z, reach, V::from_bits(own | away)]),
        ];
        for (lane, surfel) in surfels[first..first + LANES].iter_mut().enumerate() {
            *surfel = cast([quads[0][lane], quads[1][lane], quads[2][lane], quads[3][lane]]);
        }
        let [plane, to_right, down] = eight_of(simd, &self.plane, first);
        let quads = [
            rows(simd, [plane, to_right, down, depth]),
            rows(simd, [sigma_z, farthest_offset, thickness, eight(simd, &self.numbers, first)]),
        ];
        for (lane, slant) in slants[first..first + LANES].iter_mut().enumerate() {
            *slant = cast([quads[0][lane], quads[1][lane]]);
        }
        if (own & IS_PLAIN).simd_eq(none).any_true() {
            let [red, green, blue] = eight_of(simd, &self.tint, first);
            let special = rows(simd, [red, green, blue, eight(simd, &self.opacity, first)]);
            let looks = looks[first..first + LANES].iter_mut();
            for ((look, [red, green, blue, opacity]), even) in looks.zip(special).zip(&self.even[first..]) {
                *look = Look { tint: [red, green, blue], opacity, even: *even };
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
        let half = (tile.side - 1) as f32 / 2.0;
        let beside = [0, 1].each(
            #[inline(always)]
            |axis| {
                let middle = tile.origin[axis] as f32 + 0.5 + half;
                let far = (V::simd_from(simd, octet.mean[axis]) - middle).abs();
                (far - (half + MARGIN)).max(splat(simd, 0.0))
            },
        );
        // Ellipses reach √(ρ (b² + c²))/(ac) along rows, √ρ/c along columns.
        let cutoff = splat(simd, self.cutoff);
        let (x, y) = (beside[0] * (a * c), beside[1] * c);
        let is_near = (x * x).simd_le(b.mul_add(b, c * c) * cutoff) & (y * y).simd_le(cutoff);
        let exact = M::from_bitmask(simd, octet.exact.into());
        (is_near | exact) & M::from_bitmask(simd, octet.seen.into())
    }
}
