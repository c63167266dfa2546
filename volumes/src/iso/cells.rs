//! Bricks to the cells that a surface crosses, and those to surfels.

use oblate_engine::simd::Level;

use super::columns::Columns;
use super::ends::Ends;
use super::hierarchy::{Hierarchy, SIDE};
use super::lanes::*;
use super::polygon::Geometry;
use super::sheets::{FACE_CORNERS, SHEETS};
use super::slab::{Scalar, Slab};
use super::spline::coefficients;
use super::stencil::Group;
use super::surfel::{Interpolation, add_group};
use super::window::{HALO, ROW, Window};

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
    splines: [Window; 2],
    group: Box<Group>,
    pub(super) surfels: Columns,
    pub(super) ends: Ends,
}

impl Scratch {
    pub(super) fn new() -> Self {
        Self {
            window: Window::default(),
            splines: [Window::default(), Window::default()],
            group: Box::new(Group::new()),
            surfels: Columns::default(),
            ends: Ends::default(),
        }
    }

    /// Finds the surfels of a block of bricks, which replace those of the last.
    #[inline(always)]
    pub(super) fn block<S: Simd, T: Scalar>(&mut self, simd: S, search: &Search<'_, T>, block: [usize; 3]) {
        self.surfels.clear();
        self.ends = Ends::default();
        for base in search.hierarchy.bricks(block, search.value) {
            self.brick(simd, search, base);
        }
        self.flush(simd, search);
    }

    #[inline(always)]
    fn flush<S: Simd, T>(&mut self, simd: S, search: &Search<'_, T>) {
        if self.group.len > 0 {
            add_group(simd, &self.group, (search.geometry, search.interpolation), &mut self.surfels);
            self.group.len = 0;
        }
    }

    #[inline(always)]
    fn brick<S: Simd, T: Scalar>(&mut self, simd: S, search: &Search<'_, T>, base: [usize; 3]) {
        let is_cubic = search.interpolation == Interpolation::Tricubic;
        self.window.load(search.slab, base, (search.value, if is_cubic { HALO } else { 1 }));
        if is_cubic {
            let [from, to] = &mut self.splines;
            coefficients(&self.window, [from, to]);
        }
        let dims = search.slab.dims;
        // Cells along each axis, and bits of those along x.
        let cells = [0, 1, 2].map(|axis| SIDE.min(dims[axis] - 1 - base[axis]));
        let is_at_border = (0..3).any(|axis| base[axis] == 0 || base[axis] + cells[axis] + 1 == dims[axis]);
        let there = (1_u32 << cells[0]) - 1;
        let mut sides = [[0_u32; SIDE + 1]; SIDE + 1];
        for (k, plane) in sides.iter_mut().enumerate() {
            for (j, sides) in plane.iter_mut().enumerate() {
                *sides = sides_of(simd, self.window.row(j, k));
            }
        }
        // The four rows of samples around cells, and which of the cells are crossed.
        let rows_of =
            |j: usize, k: usize| [sides[k][j], sides[k][j + 1], sides[k + 1][j], sides[k + 1][j + 1]];
        let crossed = |j: usize, k: usize| {
            if j >= cells[1] || k >= cells[2] {
                return 0;
            }
            let any = rows_of(j, k).into_iter().fold(0, |any, row| any | row);
            let any = any | any >> 1;
            any & any >> OUTSIDE & there
        };
        let sheets_of = &*SHEETS;
        // Four rows of cells at a time, cubes of 2×2×2 one after the other: neighbours stay together.
        let pairs = |axis: usize| (0..cells[axis]).step_by(2);
        for [j, k] in pairs(2).flat_map(|k| pairs(1).map(move |j| [j, k])) {
            let row = |number: usize| by_pairs(crossed(j + (number & 1), k + (number >> 1))) << (2 * number);
            let mut cubes = row(0) | row(1) | row(2) | row(3);
            while cubes != 0 {
                let bit = cubes.trailing_zeros() as usize;
                cubes &= cubes - 1;
                let local = [bit / 8 * 2 + bit % 2, j + bit / 2 % 2, k + bit / 4 % 2];
                let [inside, outside] = corners(rows_of(local[1], local[2]), local[0]);
                let index = [0, 1, 2].map(|axis| base[axis] + local[axis]);
                if inside | outside != 0xff {
                    self.ends.has_gaps = true;
                    continue;
                }
                if is_at_border {
                    self.ends.faces |= faces_crossed([inside, outside], index, dims);
                }
                for sheet in sheets_of[usize::from(inside)] {
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
            self.group.push(around, index, sheet);
        }
        if search.interpolation == Interpolation::Tricubic
            && let Some(around) = self.splines[1].around(local)
        {
            self.group.push_coefficients(around);
        }
        if self.group.len == F::<S>::LEN {
            self.flush(simd, search);
        }
    }
}

/// The first bit of samples that are outside, where those that are inside begin at bit 0.
const OUTSIDE: u32 = 16;

/// Which samples of a row are inside, and which outside, from the brick's first on as bits; those that are missing are neither.
#[inline(always)]
fn sides_of<S: Simd>(simd: S, row: &[f32; ROW]) -> u32 {
    let zero = splat(simd, 0.0);
    let [mut inside, mut outside] = [0_u64; 2];
    for (number, values) in row.chunks_exact(F::<S>::LEN).enumerate() {
        let values = F::<S>::from_slice(simd, values);
        inside |= values.simd_ge(zero).to_bitmask() << (number * F::<S>::LEN);
        outside |= values.simd_lt(zero).to_bitmask() << (number * F::<S>::LEN);
    }
    let own = (1 << (SIDE + 1)) - 1;
    (inside >> HALO) as u32 & own | ((outside >> HALO) as u32 & own) << OUTSIDE
}

/// A row of eight bits in pairs that are eight bits apart.
fn by_pairs(row: u32) -> u32 {
    row & 0x3 | (row & 0xc) << 6 | (row & 0x30) << 12 | (row & 0xc0) << 18
}

/// Which corners of a cell are inside, and which outside, from its rows of samples.
fn corners(rows: [u32; 4], column: usize) -> [u8; 2] {
    let pair = |row: u32| row >> column & (3 | 3 << OUTSIDE);
    let corners = pair(rows[0]) | pair(rows[1]) << 2 | pair(rows[2]) << 4 | pair(rows[3]) << 6;
    [corners as u8, (corners >> OUTSIDE) as u8]
}

/// The faces of the grid at which a surface leaves it through a cell.
fn faces_crossed([inside, outside]: [u8; 2], index: [usize; 3], dims: [usize; 3]) -> u8 {
    let is_crossed = |face: &usize| {
        let axis = face / 2;
        let at_border = [index[axis] == 0, index[axis] + 2 == dims[axis]];
        at_border[face % 2] && inside & FACE_CORNERS[*face] != 0 && outside & FACE_CORNERS[*face] != 0
    };
    (0..6).filter(is_crossed).fold(0, |faces, face| faces | 1 << face)
}
