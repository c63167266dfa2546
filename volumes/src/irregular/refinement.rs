//! Long cells in parts, so that surfels do not hang over the edges of what they are samples of.

use glam::DVec3;
use rayon::prelude::*;

use super::IrregularVolume;
use crate::volume::{GridFrame, Volume, VolumeError, Voxels};

/// The longest step that is searched as a whole, as a share of the diagonal of the bounds: a surfel's σ is then 1/180 of it.
const LONGEST: f64 = 1.0 / 128.0;

/// Samples that may come of one, and of all unless a volume has more itself.
const MOST_OF_ONE: usize = 64;
const MOST: usize = 1 << 24;

/// A finer grid in the index space of a volume: cells in equal parts along each axis.
#[derive(Clone, Debug)]
pub(super) struct Refinement {
    /// The index in the volume of each plane of samples across each axis, rising.
    axes: [Vec<f64>; 3],
}

impl Refinement {
    /// Every cell as it is.
    pub(super) fn none(volume: &IrregularVolume) -> Self {
        Self { axes: volume.samples.dims().map(|count| (0..count).map(|i| i as f64).collect()) }
    }

    /// As many parts as leave no step longer than a 128th of the diagonal; fewer where these came to too many samples.
    pub(super) fn of(volume: &IrregularVolume) -> Self {
        let lengths = [0, 1, 2].map(|axis| longest_steps(volume, axis));
        let [low, high] = volume.bounds();
        let mut longest = LONGEST * low.distance(high);
        let count = volume.points.len();
        let most = count.saturating_mul(MOST_OF_ONE).min(MOST).max(count);
        loop {
            let axes = lengths.each_ref().map(|lengths| parts(lengths, longest));
            let count = axes.iter().try_fold(1_usize, |product, axis| product.checked_mul(axis.len()));
            if count.is_some_and(|count| count <= most) {
                return Self { axes };
            }
            longest *= 1.25;
        }
    }

    /// The values of the finer grid, those of the trilinear interpolant, one unit apart.
    pub(super) fn samples(&self, volume: &IrregularVolume) -> Result<Volume, VolumeError> {
        let dims = self.axes.each_ref().map(Vec::len);
        let value = |number: usize| {
            let index = [number % dims[0], number / dims[0] % dims[1], number / (dims[0] * dims[1])];
            let place = DVec3::from([0, 1, 2].map(|axis| self.axes[axis][index[axis]]));
            volume.samples.sample(place).unwrap_or(f32::NAN)
        };
        let values = (0..dims.iter().product()).into_par_iter().map(value).collect();
        Volume::new(dims, Voxels::F32(values), GridFrame::default())
    }

    /// What an index of the finer grid is in the volume, and a step of it there.
    pub(super) fn in_volume(&self, index: DVec3) -> [DVec3; 2] {
        let (mut place, mut step) = (DVec3::ZERO, DVec3::ZERO);
        for (axis, planes) in self.axes.iter().enumerate() {
            let cell = (index[axis].max(0.0) as usize).min(planes.len() - 2);
            step[axis] = planes[cell + 1] - planes[cell];
            place[axis] = planes[cell] + step[axis] * (index[axis] - cell as f64);
        }
        [place, step]
    }
}

/// The longest step from each plane across an axis to the next.
fn longest_steps(volume: &IrregularVolume, axis: usize) -> Vec<f64> {
    let dims = volume.samples.dims();
    let stride: usize = dims[..axis].iter().product();
    let mut lengths = vec![0.0_f64; dims[axis] - 1];
    for (number, points) in volume.points.iter().zip(volume.points.iter().skip(stride)).enumerate() {
        let length = points.0.distance(*points.1);
        if let Some(own) = lengths.get_mut(number / stride % dims[axis]) {
            // Of a point that is not there it is not a number.
            *own = own.max(length);
        }
    }
    lengths
}

/// Indices of planes so that each step is parted into the fewest that are no longer than `longest`.
fn parts(lengths: &[f64], longest: f64) -> Vec<f64> {
    let within = |(first, length): (usize, &f64)| {
        let count = (length / longest).ceil().clamp(1.0, MOST as f64) as usize;
        (0..count).map(move |part| first as f64 + part as f64 / count as f64)
    };
    lengths.iter().enumerate().flat_map(within).chain([lengths.len() as f64]).collect()
}
