//! Bricks to the cells that a surface crosses, and those to surfels.

use oblate_engine::simd::Level;

use super::block::Block;
use super::crossed::{Crossed, Sides};
use super::ends::Ends;
use super::hierarchy::{Hierarchy, SIDE};
use super::lanes::*;
use super::polygon::Geometry;
use super::sheets::{FACE_CORNERS, SHEETS};
use super::slab::{Scalar, Slab};
use super::spline::coefficients;
use super::stencil::{Batch, REGISTERS};
use super::surfel::{Interpolation, add_batch};
use super::window::{HALO, Window};

/// What every block needs to know.
#[derive(Clone, Copy)]
pub(super) struct Search<'a, T> {
    pub(super) slab: Slab<'a, T>,
    pub(super) hierarchy: &'a Hierarchy,
    pub(super) geometry: &'a Geometry,
    pub(super) value: f32,
    pub(super) interpolation: Interpolation,
    pub(super) level: Level,
}

impl<'a, T> Search<'a, T> {
    /// On this processor's best level of SIMD.
    pub(super) fn new(
        slab: Slab<'a, T>,
        hierarchy: &'a Hierarchy,
        geometry: &'a Geometry,
        (value, interpolation): (f32, Interpolation),
    ) -> Self {
        Self { slab, hierarchy, geometry, value, interpolation, level: Level::best() }
    }
}

/// What a thread keeps from one block to the next.
pub(super) struct Scratch {
    window: Window,
    splines: Option<[Window; 2]>,
    batch: Box<Batch>,
    /// Of the block that is searched.
    pub(super) surfels: Block,
    pub(super) ends: Ends,
}

impl Scratch {
    pub(super) fn new() -> Self {
        Self {
            window: Window::default(),
            splines: None,
            batch: Box::new(Batch::new()),
            surfels: Block::default(),
            ends: Ends::default(),
        }
    }

    /// Finds the surfels of a block of bricks, which replace those that were there.
    #[inline(always)]
    pub(super) fn block<S: Simd, T: Scalar>(&mut self, simd: S, search: &Search<'_, T>, block: [usize; 3]) {
        self.surfels.clear();
        self.ends = Ends::default();
        let bricks: Vec<_> = search.hierarchy.bricks(block, search.value).collect();
        let are_near =
            |a: &[usize; 3], b: &[usize; 3]| (0..3).all(|axis| a[axis] / PART[axis] == b[axis] / PART[axis]);
        for near in bricks.chunk_by(are_near) {
            let part = Part::of(near, search.slab.dims);
            let sides = self.load(simd, search, &part);
            let crossed = Crossed::new(&sides, &part);
            self.ends.has_gaps |= crossed.has_gaps;
            for brick in near {
                self.brick(simd, search, (&part, &sides, &crossed), *brick);
            }
        }
        self.flush(simd, search);
    }

    /// Loads a part's samples and their coefficients, where there is a spline; gives their sides.
    #[inline(always)]
    fn load<S: Simd, T: Scalar>(&mut self, simd: S, search: &Search<'_, T>, part: &Part) -> Sides {
        let is_cubic = search.interpolation == Interpolation::Tricubic;
        let halo = if is_cubic { HALO } else { 1 };
        let sides = self.window.load(simd, (search.slab, search.value), (part, halo));
        if is_cubic {
            let [from, to] = self.splines.get_or_insert_default();
            coefficients(&self.window, [from, to]);
        } else {
            self.window.extend(part, search.slab.dims);
        }
        sides
    }

    #[inline(always)]
    fn flush<S: Simd, T>(&mut self, simd: S, search: &Search<'_, T>) {
        if self.batch.len > 0 {
            add_batch(simd, &self.batch, (search.geometry, search.interpolation), &mut self.surfels);
            self.batch.len = 0;
        }
    }

    #[inline(always)]
    fn brick<S: Simd, T: Scalar>(
        &mut self,
        simd: S,
        search: &Search<'_, T>,
        (part, sides, crossed): (&Part, &Sides, &Crossed),
        brick: [usize; 3],
    ) {
        let dims = search.slab.dims;
        let is_at_border = (0..3).any(|axis| brick[axis] == 0 || brick[axis] + SIDE + 1 >= dims[axis]);
        let in_part = [0, 1, 2].map(|axis| brick[axis] - part.base[axis]);
        let sheets_of = &*SHEETS;
        // Four rows of cells at a time, cubes of 2×2×2 one after the other: neighbours stay together.
        for pair in 0..SIDE * SIDE / 4 {
            let [j, k] = [in_part[1] + pair % (SIDE / 2) * 2, in_part[2] + pair / (SIDE / 2) * 2];
            let mut cubes = crossed.cubes(in_part[0] / SIDE, [j, k]);
            while cubes != 0 {
                let bit = cubes.trailing_zeros() as usize;
                cubes &= cubes - 1;
                let local = [in_part[0] + bit / 8 * 2 + bit % 2, j + bit / 2 % 2, k + bit / 4 % 2];
                let inside = sides.corners(local);
                let index = [0, 1, 2].map(|axis| part.base[axis] + local[axis]);
                if is_at_border {
                    self.ends.faces |= faces_crossed(inside, index, dims);
                }
                let [first, others @ ..] = sheets_of[usize::from(inside)];
                self.sheet(simd, search, (local, index, first));
                for sheet in others {
                    if sheet == 0 {
                        break;
                    }
                    self.sheet(simd, search, (local, index, sheet));
                }
            }
        }
    }

    #[inline(always)]
    fn sheet<S: Simd, T>(
        &mut self,
        simd: S,
        search: &Search<'_, T>,
        (local, index, sheet): ([usize; 3], [usize; 3], u8),
    ) {
        if let Some(around) = self.window.around(local) {
            self.batch.push(around, index, sheet);
        }
        if search.interpolation == Interpolation::Tricubic
            && let Some(around) = self.splines.as_ref().and_then(|splines| splines[1].around(local))
        {
            self.batch.push_coefficients(around);
        }
        if self.batch.len == REGISTERS * F::<S>::LEN {
            self.flush(simd, search);
        }
    }
}

/// The most cells of a part along each axis: its samples stay in the second cache, and few rows lie around its own.
pub(super) const PART: [usize; 3] = [4 * SIDE, 2 * SIDE, 2 * SIDE];

/// What is loaded at once: the least box around those of 4×2×2 bricks that a surface may be in.
pub(super) struct Part {
    /// Its first sample.
    pub(super) base: [usize; 3],
    /// Cells along each axis, at most [`PART`].
    pub(super) cells: [usize; 3],
}

impl Part {
    /// Of bricks, by their first samples.
    fn of(bricks: &[[usize; 3]], dims: [usize; 3]) -> Self {
        let [base, last] = [usize::min, usize::max].map(|end: fn(usize, usize) -> usize| {
            let ends = bricks.iter().copied().reduce(|a, b| [0, 1, 2].map(|axis| end(a[axis], b[axis])));
            ends.unwrap_or_default()
        });
        let cells = [0, 1, 2].map(|axis| (last[axis] + SIDE).min(dims[axis] - 1) - base[axis]);
        Self { base, cells }
    }
}

/// The faces of the grid at which a surface leaves it through a cell.
fn faces_crossed(inside: u8, index: [usize; 3], dims: [usize; 3]) -> u8 {
    let at_border = |axis: usize| [index[axis] == 0, index[axis] + 2 == dims[axis]];
    let is_crossed = |face: &usize| {
        at_border(face / 2)[face % 2] && ![0, FACE_CORNERS[*face]].contains(&(inside & FACE_CORNERS[*face]))
    };
    (0..6).filter(is_crossed).fold(0, |faces, face| faces | 1 << face)
}
