//! The surface parted at cubic lattices: a surfel for each sheet of it in a cell.
//!
//! Cells are looked at in blocks, blocks and the cells in them along a Morton curve: what a block holds depends on no other, and
//! surfels come in the order in which they are wanted. Where cells may be wider the farther they are, blocks are those of an octree.

use crate::appearance::Appearance;
use crate::divide::Divider;
use crate::facets::{Facet, Facets};
use crate::grading::{Grading, side};
use crate::share::{Share, Surfel};
use crate::sight::Sight;
use glam::{DVec3, UVec3};
use rayon::prelude::*;

/// The longest extent of a surface in narrowest cells: Morton keys of blocks have 63 bits.
pub(crate) const LONGEST_EXTENT: f64 = (1_u32 << (20 + SIDE_BITS)) as f64;

/// Cells of a block along an axis, and how many bits number them.
const SIDE: u32 = 1 << SIDE_BITS;
const SIDE_BITS: u32 = 5;
pub(crate) const BLOCK_SIDE: f64 = SIDE as f64;

/// Facets that one task puts into blocks.
const FACETS_PER_TASK: usize = 1024;

/// No sheet.
const END: u32 = u32::MAX;

/// How surfels are made of what lies in a cell.
#[derive(Clone, Copy)]
pub(crate) struct Rule {
    /// Where the facets' origin lies on the first level's lattice, in its cells: all facets are at places above 0 of it.
    pub(crate) shift: DVec3,
    /// What lies at higher places is left out.
    pub(crate) end: DVec3,
    /// How wide cells are, at places relative to the facets' origin, and the highest level of them.
    pub(crate) grading: Grading,
    pub(crate) level: u32,
    /// What faces elsewhere than the rest of a sheet, by more than the angle of this cosine, is of another.
    pub(crate) least_cosine: f64,
    /// Once a cell has so many sheets, parts of the mesh don't begin new ones.
    pub(crate) most_sheets: usize,
    /// Added to the covariance of what a surfel owns, in squared widths of the grading.
    pub(crate) blur: f64,
}

impl Rule {
    /// The middle of a block relative to the facets' origin, and half its side, in the first level's cells.
    fn block(&self, level: u32, block: UVec3) -> (DVec3, f64) {
        let side = side(level) * BLOCK_SIDE;
        ((block.as_dvec3() + 0.5) * side - self.shift, side / 2.0)
    }

    /// Whether a block's cells are nowhere too wide.
    fn suits(&self, level: u32, block: UVec3) -> bool {
        let (middle, half) = self.block(level, block);
        level <= self.grading.level_in_box(middle, DVec3::splat(half))
    }
}

/// What is made of the blocks of a level, one after the other.
pub(crate) struct Found {
    pub(crate) level: u32,
    /// Lengths in cells of the level.
    pub(crate) blocks: Vec<Vec<Surfel>>,
}

impl Found {
    pub(crate) fn count(&self) -> usize {
        self.blocks.iter().map(Vec::len).sum()
    }

    /// The middle of the bounds of all surfels' centers, in cells of the level, and the surfels' mean width, beside the narrowest.
    pub(crate) fn middle_and_width(&self, grading: Grading) -> (DVec3, f64) {
        let side = side(self.level);
        let of_block = |block: &Vec<Surfel>| {
            let begin = ([DVec3::INFINITY, DVec3::NEG_INFINITY], 0.0);
            block.iter().map(|surfel| surfel.center).fold(begin, |([low, high], sum), center| {
                ([low.min(center), high.max(center)], sum + grading.width(center * side))
            })
        };
        // One after the other: sums are the same whoever made them.
        let blocks: Vec<([DVec3; 2], f64)> = self.blocks.par_iter().map(of_block).collect();
        let all = blocks
            .into_iter()
            .reduce(|([a, b], sum), ([low, high], own)| ([a.min(low), b.max(high)], sum + own));
        let ([low, high], sum) = all.unwrap_or_default();
        ((low + high) / 2.0, sum / self.count().max(1) as f64)
    }
}

/// The surfels of all cells in blocks that are seen, level by level.
pub(crate) fn surfels(
    (facets, look): (&Facets, &Appearance),
    sight: Option<&Sight>,
    rule: Rule,
) -> Vec<Found> {
    let is_seen = |level: u32, block: UVec3| {
        let (middle, half) = rule.block(level, block);
        let in_mesh = middle * facets.cell + facets.middle;
        sight.is_none_or(|sight| !sight.misses_box(in_mesh, DVec3::splat(half * facets.cell)))
    };
    let entries = entries(facets, rule, is_seen);
    let of_block = |cells: &mut Cells, block: &&[Entry]| cells.surfels(block, (facets, look), rule);
    let of_level = |entries: &[Entry]| {
        let blocks: Vec<&[Entry]> = entries.chunk_by(|a, b| a.block == b.block).collect();
        let found = blocks.par_iter().map_init(Cells::default, of_block).collect();
        Found { level: entries[0].level, blocks: found }
    };
    entries.chunk_by(|a, b| a.level == b.level).map(of_level).collect()
}

/// A facet in a block that it goes through.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    level: u32,
    /// The block's Morton key.
    block: u64,
    facet: u32,
}

/// All facets in all blocks that they go through and that are seen, in the order of levels, blocks and facets.
fn entries(facets: &Facets, rule: Rule, is_seen: impl Fn(u32, UVec3) -> bool + Sync) -> Vec<Entry> {
    let side = side(rule.level) * BLOCK_SIDE;
    let all = [UVec3::ZERO, (rule.end / side).as_uvec3()];
    let of_facets = |(task, some): (usize, &[Facet])| {
        let mut found = Vec::with_capacity(some.len());
        let mut dividers: Vec<Divider> = (0..=rule.level).map(|_| Divider::default()).collect();
        for (number, facet) in some.iter().enumerate() {
            let facet_number = (task * FACETS_PER_TASK + number) as u32;
            let corners = facets.corners(facet).map(|p| (p + rule.shift) / side);
            descend(&mut dividers, (&corners, all), (&rule, &is_seen), &mut |level, block| {
                found.push(Entry { level, block: morton(block), facet: facet_number });
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

/// Visits the blocks of an octree that are seen and that a polygon goes through, those of the level of the last divider as far as they
/// suit the rule, else those within them; the polygon is in sides of the former.
fn descend(
    dividers: &mut [Divider],
    (polygon, blocks): (&[DVec3], [UVec3; 2]),
    (rule, is_seen): (&Rule, &impl Fn(u32, UVec3) -> bool),
    visit: &mut impl FnMut(u32, UVec3),
) {
    let Some((divider, finer)) = dividers.split_last_mut() else { return };
    let level = finer.len() as u32;
    divider.divide(polygon, blocks, &mut |block, part| {
        if !is_seen(level, block) {
            return;
        }
        if rule.suits(level, block) {
            return visit(level, block);
        }
        let part: Vec<DVec3> = part.iter().map(|p| p * 2.0).collect();
        descend(finer, (&part, [block * 2, block * 2 + 1]), (rule, is_seen), visit);
    });
}

/// The cells of a block.
struct Cells {
    divider: Divider,
    /// The last sheet of each cell, in Morton order.
    last: Vec<u32>,
    sheets: Vec<Sheet>,
}

struct Sheet {
    share: Share,
    kind: Kind,
    /// The one before it in its cell.
    before: u32,
}

/// What pieces of one sheet have in common.
#[derive(Clone, Copy, PartialEq)]
struct Kind {
    /// The part of the mesh that they are of: a poster is not of the wall behind it, however near.
    part: u32,
    /// Whether nothing can be seen through it: one surfel that stood for such and for others would let through what is behind both.
    is_opaque: bool,
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
        let Some(&Entry { level, block: key, .. }) = block.first() else { return Vec::new() };
        let side = side(level);
        // From the facets' space to the block's, in cells of the level.
        let origin = (place(key) * SIDE).as_dvec3() - rule.shift / side;
        let mut divider = std::mem::take(&mut self.divider);
        for entry in block {
            let facet = &facets.facets[entry.facet as usize];
            let facing = facet.normal.as_dvec3();
            let kind = Kind { part: facet.part, is_opaque: look.is_opaque(facet) };
            let corners = facets.corners(facet).map(|p| p / side - origin);
            let look = look.of(facet, side);
            let most_area = f64::from(look.most_area());
            divider.divide(&corners, [UVec3::ZERO, UVec3::splat(SIDE - 1)], &mut |cell, polygon| {
                let middle = cell.as_dvec3() + 0.5;
                let share = self.sheet(cell, (facing, kind), rule);
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
            while let Some(Sheet { share, before, .. }) = self.sheets.get(at as usize) {
                let middle = origin + place(key).as_dvec3() + 0.5;
                let width = rule.grading.width(middle * side) / side;
                surfels.extend(share.surfel(middle, rule.blur * width * width));
                at = *before;
            }
        }
        self.sheets.clear();
        surfels
    }

    /// The sheet of a cell that faces most nearly as a piece does, of those of its kind; a new one if all face elsewhere. Where many parts meet in a
    /// cell, later ones join those that are as opaque.
    fn sheet(&mut self, cell: UVec3, (facing, kind): (DVec3, Kind), rule: Rule) -> &mut Share {
        let last = &mut self.last[morton(cell) as usize];
        // Of its part, and of any.
        let (mut best, mut most, mut at) = ([END; 2], [rule.least_cosine; 2], *last);
        let mut count = 0;
        while let Some(sheet) = self.sheets.get(at as usize) {
            let cosine = sheet.share.cosine(facing);
            for (which, fits) in
                [sheet.kind == kind, sheet.kind.is_opaque == kind.is_opaque].into_iter().enumerate()
            {
                if fits && cosine >= most[which] {
                    (best[which], most[which]) = (at, cosine);
                }
            }
            (at, count) = (sheet.before, count + 1);
        }
        let [own, any] = best;
        let mut best = if own == END && count >= rule.most_sheets { any } else { own };
        if best == END {
            best = self.sheets.len() as u32;
            let before = std::mem::replace(last, best);
            self.sheets.push(Sheet { share: Share::default(), kind, before });
        }
        &mut self.sheets[best as usize].share
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
