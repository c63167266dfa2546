//! The surface parted at a cubic lattice: a surfel for each sheet of it in a cell.
//!
//! Cells are looked at in blocks, blocks and the cells in them along a Morton curve: what a block holds depends on no other, and
//! surfels come in the order in which they are wanted.

use crate::appearance::Appearance;
use crate::divide::Divider;
use crate::facets::{Facet, Facets};
use crate::share::{Share, Surfel};
use crate::sight::Sight;
use glam::{DVec3, UVec3};
use rayon::prelude::*;

/// The longest extent of a surface, in cells: Morton keys of 63 bits.
pub(crate) const LONGEST_EXTENT: f64 = (1_u32 << 20) as f64;

/// Cells of a block along an axis, and how many bits number them.
const SIDE: u32 = 1 << SIDE_BITS;
const SIDE_BITS: u32 = 5;

/// Facets that one task puts into blocks.
const FACETS_PER_TASK: usize = 1024;

/// No sheet.
const END: u32 = u32::MAX;

/// How surfels are made of what lies in a cell.
#[derive(Clone, Copy)]
pub(crate) struct Rule {
    /// Where the facets' origin lies on the lattice, in cells: all facets are at places above 0 of it.
    pub(crate) shift: DVec3,
    /// What lies at higher places is left out.
    pub(crate) end: DVec3,
    /// What faces elsewhere than the rest of a sheet, by more than the angle of this cosine, is of another.
    pub(crate) least_cosine: f64,
    /// Added to the covariance of what a surfel owns, in squared cells.
    pub(crate) blur: f64,
}

/// The surfels of all cells in blocks that are seen, block by block.
pub(crate) fn surfels(
    (facets, look): (&Facets, &Appearance),
    sight: Option<&Sight>,
    rule: Rule,
) -> Vec<Vec<Surfel>> {
    let is_seen = |block: UVec3| {
        let side = f64::from(SIDE);
        let middle = ((block.as_dvec3() + 0.5) * side - rule.shift) * facets.cell + facets.middle;
        sight.is_none_or(|sight| !sight.misses_box(middle, DVec3::splat(side / 2.0 * facets.cell)))
    };
    let entries = entries(facets, rule, is_seen);
    let blocks: Vec<&[Entry]> = entries.chunk_by(|a, b| a.block == b.block).collect();
    let of_block = |cells: &mut Cells, block: &&[Entry]| cells.surfels(block, (facets, look), rule);
    blocks.par_iter().map_init(Cells::default, of_block).collect()
}

/// A facet in a block that it goes through.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    /// The block's Morton key.
    block: u64,
    facet: u32,
}

/// All facets in all blocks that they go through and that are seen, in the order of blocks and facets.
fn entries(facets: &Facets, rule: Rule, is_seen: impl Fn(UVec3) -> bool + Sync) -> Vec<Entry> {
    let last = (rule.end / f64::from(SIDE)).as_uvec3();
    let of_facets = |(task, some): (usize, &[Facet])| {
        let mut found = Vec::with_capacity(some.len());
        let mut divider = Divider::default();
        for (number, facet) in some.iter().enumerate() {
            let facet_number = (task * FACETS_PER_TASK + number) as u32;
            let corners = facets.corners(facet).map(|p| (p + rule.shift) / f64::from(SIDE));
            divider.divide(corners, [UVec3::ZERO, last], &mut |block, _| {
                if is_seen(block) {
                    found.push(Entry { block: morton(block), facet: facet_number });
                }
            });
        }
        found
    };
    let found: Vec<Vec<Entry>> =
        facets.facets.par_chunks(FACETS_PER_TASK).enumerate().map(of_facets).collect();
    let mut entries = found.concat();
    entries.par_sort_unstable();
    entries
}

/// The cells of a block.
struct Cells {
    divider: Divider,
    /// The last sheet of each cell, in Morton order.
    last: Vec<u32>,
    /// Each with the one before it in its cell.
    sheets: Vec<(Share, u32)>,
}

impl Default for Cells {
    fn default() -> Self {
        let last = vec![END; 1 << (3 * SIDE_BITS)];
        Self { divider: Divider::default(), last, sheets: Vec::new() }
    }
}

impl Cells {
    fn surfels(
        &mut self,
        block: &[Entry],
        (facets, look): (&Facets, &Appearance),
        rule: Rule,
    ) -> Vec<Surfel> {
        let Some(&Entry { block: key, .. }) = block.first() else { return Vec::new() };
        // From the facets' space to the block's.
        let origin = (place(key) * SIDE).as_dvec3() - rule.shift;
        let mut divider = std::mem::take(&mut self.divider);
        for entry in block {
            let facet = &facets.facets[entry.facet as usize];
            let facing = facet.normal.as_dvec3();
            let corners = facets.corners(facet).map(|p| p - origin);
            let look = look.of(facet);
            let most_area = f64::from(look.most_area());
            divider.divide(corners, [UVec3::ZERO, UVec3::splat(SIDE - 1)], &mut |cell, polygon| {
                let middle = cell.as_dvec3() + 0.5;
                let share = self.sheet(cell, facing, rule);
                for pair in polygon[1..].windows(2) {
                    let triangle = [polygon[0], pair[0], pair[1]];
                    let area = share.add(triangle.map(|p| p - middle), facing);
                    halve(triangle, (area, most_area), &mut |middle, area| {
                        share.add_look(area, look.at(middle + origin, area as f32));
                    });
                }
            });
        }
        self.divider = divider;
        let mut surfels = Vec::with_capacity(self.sheets.len());
        for (key, last) in (0..).zip(&mut self.last) {
            let mut at = std::mem::replace(last, END);
            while let Some((share, before)) = self.sheets.get(at as usize) {
                surfels.extend(share.surfel(origin + place(key).as_dvec3() + 0.5, rule.blur));
                at = *before;
            }
        }
        self.sheets.clear();
        surfels
    }

    /// The sheet of a cell that faces most nearly as a piece does, a new one if all face elsewhere.
    fn sheet(&mut self, cell: UVec3, facing: DVec3, rule: Rule) -> &mut Share {
        let last = &mut self.last[morton(cell) as usize];
        let (mut best, mut most, mut at) = (END, rule.least_cosine, *last);
        while let Some((share, before)) = self.sheets.get(at as usize) {
            let cosine = share.cosine(facing);
            if cosine >= most {
                (best, most) = (at, cosine);
            }
            at = *before;
        }
        if best == END {
            best = self.sheets.len() as u32;
            self.sheets.push((Share::default(), std::mem::replace(last, best)));
        }
        &mut self.sheets[best as usize].0
    }
}

/// Halves a triangle across its longest edge until no part has more than an area; visits the middle and the area of each.
fn halve(corners: [DVec3; 3], (area, most): (f64, f64), visit: &mut impl FnMut(DVec3, f64)) {
    let [a, b, c] = corners;
    if area <= most {
        return visit((a + b + c) / 3.0, area);
    }
    let (ab, bc, ca) = (a.distance_squared(b), b.distance_squared(c), c.distance_squared(a));
    let [a, b, c] = if ab >= bc && ab >= ca {
        [a, b, c]
    } else if bc >= ca {
        [b, c, a]
    } else {
        [c, a, b]
    };
    let middle = a.midpoint(b);
    halve([a, middle, c], (area / 2.0, most), visit);
    halve([middle, b, c], (area / 2.0, most), visit);
}

/// The Morton key of a place, of at most 21 bits along each axis.
fn morton(place: UVec3) -> u64 {
    spread(place.x) | spread(place.y) << 1 | spread(place.z) << 2
}

/// The place of a Morton key.
fn place(key: u64) -> UVec3 {
    UVec3::new(gather(key), gather(key >> 1), gather(key >> 2))
}

/// Every bit in the place of three times its own.
fn spread(value: u32) -> u64 {
    let mut bits = u64::from(value);
    bits = (bits | bits << 32) & 0x001F_0000_0000_FFFF;
    bits = (bits | bits << 16) & 0x001F_0000_FF00_00FF;
    bits = (bits | bits << 8) & 0x100F_00F0_0F00_F00F;
    bits = (bits | bits << 4) & 0x10C3_0C30_C30C_30C3;
    (bits | bits << 2) & 0x1249_2492_4924_9249
}

/// Undoes [`spread`], whatever the other bits are.
fn gather(bits: u64) -> u32 {
    let mut bits = bits & 0x1249_2492_4924_9249;
    bits = (bits | bits >> 2) & 0x10C3_0C30_C30C_30C3;
    bits = (bits | bits >> 4) & 0x100F_00F0_0F00_F00F;
    bits = (bits | bits >> 8) & 0x001F_0000_FF00_00FF;
    bits = (bits | bits >> 16) & 0x001F_0000_0000_FFFF;
    (bits | bits >> 32) as u32 & 0x001F_FFFF
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn keys_have_the_bits_of_places_in_turns(place in prop::array::uniform3(0..1_u32 << 21)) {
            let bit = |i: u32| u64::from(place[i as usize % 3] >> (i / 3) & 1) << i;
            let key = (0..63).map(bit).sum::<u64>();
            prop_assert_eq!(morton(place.into()), key);
            prop_assert_eq!(super::place(key), UVec3::from(place));
        }

        /// Halves are parts of one area, none too large, around the middle of the whole.
        #[test]
        fn halves_are_the_whole(corners in prop::array::uniform9(-1.0..1.0), most in 0.01..1.0) {
            let [a, b, c] = [0, 3, 6].map(|i| DVec3::from_slice(&corners[i..]));
            let area = (b - a).cross(c - a).length() / 2.0;
            let (mut sum, mut first) = (0.0, DVec3::ZERO);
            halve([a, b, c], (area, most), &mut |middle, part| {
                assert!(part <= most);
                sum += part;
                first += middle * part;
            });
            // Of some hundred sums each is off by a rounding of numbers below 2.
            prop_assert!((sum - area).abs() < 1e-13);
            prop_assert!((first - (a + b + c) / 3.0 * area).length() < 1e-13);
        }
    }
}
