//! Fields sampled where no regular grid has its samples: on curvilinear grids, and at points anywhere.
//!
//! An [`IrregularVolume`] has a point for each value. What `local` says of a sample, its steps and its gradient, is all that kernels know of
//! how samples are arranged: `partition` makes kernels of them, `sums` what these add up to, of those that `supports` finds around points. `surfaces` takes the
//! iso-surfels of the values, as an even grid in index space, to where the cells lie; `refinement` parts long cells before.

mod local;
mod partition;
mod refinement;
mod sums;
mod supports;
mod surfaces;

use glam::{DAffine3, DVec3};
use thiserror::Error;

pub use partition::{Partition, Residual};
pub use surfaces::IrregularExtractor;

use crate::volume::{GridFrame, Volume, VolumeError, Voxels};

/// How the samples of an irregular volume are arranged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrangement {
    /// In rows, columns and layers of hexahedral cells, which may lie, bend and stretch in any way.
    Curvilinear,
    /// In no order.
    Scattered,
}

/// A scalar field with a point for each sample; samples whose value or point is not finite are not there.
///
/// A rectilinear grid is a curvilinear one whose points are products of three axes.
#[derive(Clone, Debug, PartialEq)]
pub struct IrregularVolume {
    arrangement: Arrangement,
    points: Vec<DVec3>,
    samples: Volume,
    bounds: [DVec3; 2],
}

/// Why points and values do not make an irregular volume.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum IrregularError {
    /// Values for other points than there are, or a grid of other dimensions.
    #[error("{points} points and {values} values; there must be as many of both")]
    Count {
        /// How many points.
        points: usize,
        /// How many values.
        values: usize,
    },
    /// A grid without cells.
    #[error("a grid of {}x{}x{} points; it must have two or more along each axis", dims[0], dims[1], dims[2])]
    Cells {
        /// Points along each axis.
        dims: [usize; 3],
    },
    /// No volume lies between the points.
    #[error(
        "the {0} points of finite value enclose no volume; they must not lie in a plane, all together or cell by cell"
    )]
    Flat(usize),
    /// Points so far apart or so close together that computing with them fails.
    #[error("the points reach {0} far; it must be from 1e-12 to 1e15")]
    Extent(f64),
    /// The values do not make a volume.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

impl IrregularVolume {
    /// A grid of `dims` points along its axes, at least two each; the first axis is the fastest.
    ///
    /// # Errors
    /// When the counts don't agree, the grid has no cells, or its cells no volume.
    pub fn curvilinear(
        dims: [usize; 3],
        points: Vec<DVec3>,
        values: Vec<f32>,
    ) -> Result<Self, IrregularError> {
        if dims.iter().any(|points| *points < 2) {
            return Err(IrregularError::Cells { dims });
        }
        Self::new(Arrangement::Curvilinear, dims, points, values)
    }

    /// A grid whose points have all combinations of the coordinates along x, y and z, which may rise or fall in any steps.
    ///
    /// # Errors
    /// As [`Self::curvilinear`].
    pub fn rectilinear(axes: [&[f64]; 3], values: Vec<f32>) -> Result<Self, IrregularError> {
        let dims = axes.map(<[f64]>::len);
        let count = dims.iter().try_fold(1_usize, |product, count| product.checked_mul(*count));
        if count != Some(values.len()) {
            return Err(IrregularError::Count { points: count.unwrap_or(usize::MAX), values: values.len() });
        }
        let [x, y, z] = axes;
        let mut points = Vec::with_capacity(values.len());
        for &z in z {
            for &y in y {
                points.extend(x.iter().map(|&x| DVec3::new(x, y, z)));
            }
        }
        Self::curvilinear(dims, points, values)
    }

    /// Samples in no order. They have kernels, but no surfaces, since they have no cells.
    ///
    /// # Errors
    /// When the counts don't agree or all points lie in a plane that is parallel to two axes.
    pub fn scattered(points: Vec<DVec3>, values: Vec<f32>) -> Result<Self, IrregularError> {
        Self::new(Arrangement::Scattered, [values.len(), 1, 1], points, values)
    }

    fn new(
        arrangement: Arrangement,
        dims: [usize; 3],
        points: Vec<DVec3>,
        mut values: Vec<f32>,
    ) -> Result<Self, IrregularError> {
        if points.len() != values.len() {
            return Err(IrregularError::Count { points: points.len(), values: values.len() });
        }
        // One mark for both: a sample without a place has no value.
        for (value, _) in values.iter_mut().zip(&points).filter(|(_, point)| !point.is_finite()) {
            *value = f32::NAN;
        }
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let mut count = 0;
        for (point, _) in points.iter().zip(&values).filter(|(_, value)| value.is_finite()) {
            bounds = [bounds[0].min(*point), bounds[1].max(*point)];
            count += 1;
        }
        if count == 0 {
            return Err(IrregularError::Flat(0));
        }
        let extent =
            (bounds[1] - bounds[0]).max_element().max(bounds[0].abs().max(bounds[1].abs()).max_element());
        // Cubes of it, and of its single-precision roundings, are ordinary numbers.
        if !(1e-12..=1e15).contains(&extent) {
            return Err(IrregularError::Extent(extent));
        }
        let samples = Volume::new(dims, Voxels::F32(values), GridFrame::default())?;
        let mut volume = Self { arrangement, points, samples, bounds };
        let mean = volume.total_volume() / count as f64;
        let spacing = mean.cbrt();
        if !(spacing.is_finite() && spacing > 0.0) {
            return Err(IrregularError::Flat(count));
        }
        let frame = GridFrame { spacing: DVec3::splat(spacing), ..GridFrame::default() };
        volume.samples = volume.samples.with_frame(frame)?;
        Ok(volume)
    }

    /// The volume of all samples together: that of their local steps, or of the box of scattered ones.
    fn total_volume(&self) -> f64 {
        match self.arrangement {
            Arrangement::Curvilinear => self.local_volumes(),
            Arrangement::Scattered => (self.bounds[1] - self.bounds[0]).element_product(),
        }
    }

    /// How its samples are arranged.
    pub fn arrangement(&self) -> Arrangement {
        self.arrangement
    }

    /// Where the samples are, in world units; not finite where there is none.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// The values as those of an even grid: index space, where a voxel has the volume that a sample has on average. It is what histograms,
    /// presets and proposals look at. Scattered samples make one row.
    pub fn samples(&self) -> &Volume {
        &self.samples
    }

    /// Least and greatest coordinates of the samples.
    pub fn bounds(&self) -> [DVec3; 2] {
        self.bounds
    }

    /// In the middle of the bounds: what numbers of single precision are relative to.
    pub(crate) fn middle(&self) -> DVec3 {
        0.5 * (self.bounds[0] + self.bounds[1])
    }

    /// The same values at points that `placement` takes these to.
    ///
    /// # Errors
    /// When it leaves no volume.
    pub fn placed(self, placement: DAffine3) -> Result<Self, IrregularError> {
        let points = self.points.into_iter().map(|point| placement.transform_point3(point)).collect();
        let dims = self.samples.dims();
        let Voxels::F32(values) = self.samples.into_voxels() else { return Err(IrregularError::Flat(0)) };
        Self::new(self.arrangement, dims, points, values)
    }
}
