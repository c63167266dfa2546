//! Which blocks of a range are projected at all.

use super::WideProjector;
use super::geometry::Placed;
use super::hidden::Hiding;
use crate::columns::LANES;
use crate::cull::{CLUSTER_SIZE, VisibleRange};
use crate::simd::*;

/// A bit for each block of a range.
type Set = u128;
const _: () = assert!(CLUSTER_SIZE <= LANES * Set::BITS as usize);

/// The blocks of a range that may be seen.
#[derive(Clone, Copy, Default)]
pub(crate) struct Blocks {
    set: Set,
    /// How many splats are drawn of them.
    pub(crate) count: usize,
    /// How many are not, of other blocks, since they lie behind cuts.
    pub(crate) behind_cuts: u32,
}

impl Blocks {
    /// All blocks of a range whose splats are all drawn.
    pub(crate) fn all(range: &VisibleRange) -> Self {
        let count = range.splats.len();
        let blocks = count.div_ceil(LANES) as u32;
        let set = Set::MAX.checked_shr(Set::BITS - blocks).unwrap_or(0);
        Self { set, count, behind_cuts: 0 }
    }

    /// How many blocks.
    pub(crate) fn len(&self) -> usize {
        self.set.count_ones() as usize
    }

    /// The first splats of the blocks of a range.
    #[inline(always)]
    pub(super) fn each(&self, range: &VisibleRange) -> impl Iterator<Item = usize> + use<> {
        let (mut left, start) = (self.set, range.splats.start);
        std::iter::from_fn(
            #[inline(always)]
            move || {
                let block = left.trailing_zeros() as usize;
                left &= left.wrapping_sub(1);
                (block < Set::BITS as usize).then_some(start + LANES * block)
            },
        )
    }

    #[inline(always)]
    fn insert(&mut self, number: usize, chosen: u32) {
        self.set |= 1 << number;
        self.count += chosen.count_ones() as usize;
    }
}

impl WideProjector<'_> {
    /// Finds the blocks of a range, whose first splat begins one, of which some splats are drawn, and not all lie beside the picture or
    /// behind what is seen of surfaces. They may be tested together; what is left is tested splat by splat.
    pub(crate) fn blocks(&self, level: Level, range: &VisibleRange) -> Blocks {
        let is_inside = self.scalar.view.frustum.is_between_sides(range.center_in_camera, range.reach);
        // What is stretched unevenly reaches no farther than if it were so in every direction.
        let sides = (!is_inside).then(|| self.reach(range));
        let hiding = Hiding::new(self, range);
        dispatch!(level, simd => self.blocks_wide(simd, range, (sides, hiding.as_ref())))
    }

    /// The same where blocks may lie beside sides, beyond which they reach so far, or behind surfaces.
    #[inline(always)]
    fn blocks_wide<S: Simd>(
        &self,
        simd: S,
        range: &VisibleRange,
        (beyond_sides, hiding): (Option<f32>, Option<&Hiding>),
    ) -> Blocks {
        let mut blocks = Blocks::default();
        let from = self.from(range);
        let is_looked_at = beyond_sides.is_some() || hiding.is_some();
        for (number, first) in range.splats.clone().step_by(LANES).enumerate() {
            let chosen = range.chosen(simd, self.scalar.levels, first);
            if chosen == 0 {
                continue;
            }
            if !is_looked_at {
                blocks.insert(number, chosen);
                continue;
            }
            let (placed, _) = self.placed(simd, first / LANES, from);
            if beyond_sides.is_some_and(
                #[inline(always)]
                |reach| self.is_beside(simd, &placed, reach),
            ) {
                continue;
            }
            if hiding.is_some_and(
                #[inline(always)]
                |hiding| hiding.hides_block(simd, self, &placed),
            ) {
                blocks.behind_cuts += chosen.count_ones();
                continue;
            }
            blocks.insert(number, chosen);
        }
        blocks
    }

    /// Whether a block's splats, which reach so far at most, lie beside the picture.
    #[inline(always)]
    fn is_beside<S: Simd>(&self, simd: S, placed: &Placed<S>, reach: f32) -> bool {
        let [x, y, z] = placed.center;
        let end = splat(simd, -reach);
        let [[left, right], [top, bottom]] = self.sides;
        let outside = [(x, left), (x, right), (y, top), (y, bottom)].each(
            #[inline(always)]
            |(across, [a, b, c])| {
                across.mul_add(splat(simd, a), z.mul_add(splat(simd, b), splat(simd, c))).simd_lt(end)
            },
        );
        // Where numbers are none nothing is left out.
        (outside[0] | outside[1] | outside[2] | outside[3]).all_true()
    }
}
