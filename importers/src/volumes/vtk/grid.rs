//! Grids of points, and the samples at these or at the cells between them.

use crate::volumes::frame;
use glam::{DMat3, DVec3};
use oblate_volumes::GridFrame;

/// Points at `origin` + `edges` · (i, j, k).
#[derive(Clone, Copy, Debug)]
pub(crate) struct PointGrid {
    /// Points along x, y, z.
    pub(crate) points: [usize; 3],
    pub(crate) origin: DVec3,
    pub(crate) edges: DMat3,
}

/// The coordinates of the points along one axis.
pub(crate) struct Coordinates {
    pub(crate) values: Vec<f64>,
    /// The relative spacing of the number type in which they are stored.
    pub(crate) rounding: f64,
}

impl PointGrid {
    /// The grid with these coordinates along x, y, z, if their steps are equal.
    pub(crate) fn rectilinear(axes: &[Coordinates; 3]) -> Result<Self, String> {
        let mut grid =
            Self { points: axes.each_ref().map(|a| a.values.len()), origin: DVec3::ZERO, edges: DMat3::ZERO };
        for (axis, coordinates) in axes.iter().enumerate() {
            let uniform = frame::uniform(&coordinates.values, coordinates.rounding);
            let (first, step) =
                uniform.map_err(|problem| format!("{} coordinates: {problem}", ["x", "y", "z"][axis]))?;
            grid.origin[axis] = first;
            grid.edges.col_mut(axis)[axis] = step;
        }
        Ok(grid)
    }

    /// How many samples lie along x, y, z.
    pub(crate) fn dims(&self, on_cells: bool) -> Result<[usize; 3], String> {
        let dims = self.points.map(|points| points.saturating_sub(usize::from(on_cells)));
        match (dims.contains(&0), on_cells) {
            (false, _) => Ok(dims),
            (true, false) => Err("a grid must have points along each axis".into()),
            (true, true) => Err("a grid with cell data must have cells along each axis".into()),
        }
    }

    /// Where they lie.
    pub(crate) fn frame(&self, on_cells: bool) -> GridFrame {
        let first = if on_cells { 0.5 } else { 0.0 };
        frame::of_edges(self.origin + self.edges * DVec3::splat(first), self.edges)
    }
}
