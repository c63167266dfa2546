//! Where the body inside an iso-surface ends though its surface doesn't close it.

use glam::DMat3;
use oblate_engine::{Closed, HalfSpace};

use super::slab::{Scalar, Slab};
use crate::volume::GridFrame;

/// Where a body of samples from a value on ends.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Ends {
    /// Whether its surface ends beside samples that are not finite.
    pub(super) has_gaps: bool,
    /// The faces of the grid that it reaches, as bits: each axis' first, then its last.
    pub(super) faces: u8,
}

impl Ends {
    /// The faces that are known by the corners of slices: one inside which nothing goes through is inside all over.
    pub(super) fn of_corners<T: Scalar>(slab: Slab<'_, T>, value: f32) -> Self {
        let [nx, ny, nz] = slab.dims;
        let slices = slab.samples.len().checked_div(nx * ny).unwrap_or(0);
        let mut faces = 0;
        if slices > 0 {
            for corner in 0..8 {
                let of_last = [0, 1, 2].map(|axis| corner >> axis & 1);
                let first = [0, 0, slab.first];
                let last = [nx - 1, ny - 1, slab.first + slices - 1];
                let [i, j, k] =
                    [0, 1, 2].map(|axis| if of_last[axis] == 1 { last[axis] } else { first[axis] });
                if slab.row(j, k)[i].above(value) >= 0.0 {
                    faces |= 1 << of_last[0] | 4 << of_last[1];
                    faces |= if k == 0 { 16 } else { 0 } | if k + 1 == nz { 32 } else { 0 };
                }
            }
        }
        Self { has_gaps: false, faces }
    }

    pub(super) fn and(self, other: Self) -> Self {
        Self { has_gaps: self.has_gaps | other.has_gaps, faces: self.faces | other.faces }
    }

    /// From where no backs are seen, relative to the grid's sample (0, 0, 0): from this side of the faces that the body reaches.
    pub(super) fn closed(self, frame: GridFrame, dims: [usize; 3]) -> Closed {
        if self.has_gaps {
            return Closed::Sided;
        }
        let to_samples = (frame.direction * DMat3::from_diagonal(frame.spacing)).inverse();
        let half_space = |face: usize| {
            let normal = to_samples.row(face / 2);
            match face % 2 {
                0 => HalfSpace { normal, offset: 0.0 },
                _ => HalfSpace { normal: -normal, offset: 1.0 - dims[face / 2] as f64 },
            }
        };
        Closed::Within((0..6).filter(|face| self.faces >> face & 1 == 1).map(half_space).collect())
    }
}
