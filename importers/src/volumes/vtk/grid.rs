//! Grids of points, and the samples at these or at the cells between them.

use crate::file::File;
use crate::volumes::frame;
use crate::volumes::voxels::Layout;
use crate::{Content, ImportError, Note, OpenOptions, Opened};
use glam::{DMat3, DVec3};
use oblate_volumes::{GridFrame, IrregularVolume, Voxels};

/// Points of a grid, the first axis the fastest.
#[derive(Clone, Debug)]
pub(crate) struct PointGrid {
    /// Points along the grid's axes.
    pub(crate) points: [usize; 3],
    pub(crate) places: Places,
}

/// Where the points are.
#[derive(Clone, Debug)]
pub(crate) enum Places {
    /// At `origin` + `edges` · (i, j, k).
    Even { origin: DVec3, edges: DMat3 },
    /// At all combinations of coordinates along x, y, z.
    Axes([Vec<f64>; 3]),
    /// Anywhere.
    Each(Vec<DVec3>),
    /// Anywhere, and in no order: the only axis is their list.
    Scattered(Vec<DVec3>),
}

/// The coordinates of the points along one axis.
pub(crate) struct Coordinates {
    pub(crate) values: Vec<f64>,
    /// The relative spacing of the number type in which they are stored.
    pub(crate) rounding: f64,
}

impl PointGrid {
    /// The grid with these coordinates along x, y, z.
    pub(crate) fn rectilinear(axes: [Coordinates; 3]) -> Result<Self, String> {
        let points = axes.each_ref().map(|axis| axis.values.len());
        let (mut origin, mut edges, mut is_even) = (DVec3::ZERO, DMat3::ZERO, true);
        for (axis, coordinates) in axes.iter().enumerate() {
            let steps = frame::steps(&coordinates.values, coordinates.rounding);
            let steps =
                steps.map_err(|problem| format!("{} coordinates: {problem}", ["x", "y", "z"][axis]))?;
            match steps {
                Some((first, step)) => (origin[axis], edges.col_mut(axis)[axis]) = (first, step),
                None => is_even = false,
            }
        }
        let places =
            if is_even { Places::Even { origin, edges } } else { Places::Axes(axes.map(|axis| axis.values)) };
        Ok(Self { points, places })
    }

    /// How many samples lie along the grid's axes.
    pub(crate) fn dims(&self, on_cells: bool) -> Result<[usize; 3], String> {
        let dims = self.points.map(|points| points.saturating_sub(usize::from(on_cells)));
        match (dims.contains(&0), on_cells) {
            (false, _) => Ok(dims),
            (true, false) => Err("a grid must have points along each axis".into()),
            (true, true) => Err("a grid with cell data must have cells along each axis".into()),
        }
    }

    /// The volume of these samples.
    pub(crate) fn volume(
        self,
        (file, options): (&File, &OpenOptions),
        (layout, voxels): (&Layout, Voxels),
        on_cells: bool,
    ) -> Result<Opened, ImportError> {
        let values = |voxels: &Voxels| (0..voxels.len()).map(|index| voxels.get(index)).collect();
        let volume = match self.places {
            Places::Even { origin, edges } => {
                let first = if on_cells { 0.5 } else { 0.0 };
                let frame: GridFrame = frame::of_edges(origin + edges * DVec3::splat(first), edges);
                return Ok(layout.placed(file, voxels, frame, options)?.into());
            }
            Places::Axes(axes) => {
                let middles = |axis: &[f64]| axis.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
                let axes = if on_cells { axes.map(|axis| middles(&axis)) } else { axes };
                IrregularVolume::rectilinear(
                    axes.each_ref().map(|axis: &Vec<f64>| &axis[..]),
                    values(&voxels),
                )
            }
            Places::Each(points) => {
                let points = if on_cells { centers(self.points, &points) } else { points };
                IrregularVolume::curvilinear(layout.dims, points, values(&voxels))
            }
            Places::Scattered(points) => IrregularVolume::scattered(points, values(&voxels)),
        };
        let volume = volume.map_err(|source| ImportError::Irregular { path: file.path.clone(), source })?;
        let note = "the spacing that was asked for; the file says where each sample lies";
        let notes = options.spacing.map(|_| Note::LeftOut(note.into()));
        Ok(Opened::noting(Content::Irregular(volume), notes.into_iter().collect()))
    }
}

/// The middles of cells' corners.
fn centers([nx, ny, nz]: [usize; 3], points: &[DVec3]) -> Vec<DVec3> {
    let corner = |at: [usize; 3], bits: usize| {
        let [i, j, k] = [0, 1, 2].map(|axis| at[axis] + (bits >> axis & 1));
        points[(k * ny + j) * nx + i]
    };
    let center = |at: [usize; 3]| (0..8).map(|bits| corner(at, bits)).sum::<DVec3>() / 8.0;
    let mut centers = Vec::with_capacity((nx - 1) * (ny - 1) * (nz - 1));
    for k in 0..nz - 1 {
        for j in 0..ny - 1 {
            centers.extend((0..nx - 1).map(|i| center([i, j, k])));
        }
    }
    centers
}

/// Numbers three by three.
pub(crate) fn triples(numbers: &[f64]) -> Vec<DVec3> {
    numbers.as_chunks::<3>().0.iter().copied().map(DVec3::from_array).collect()
}
