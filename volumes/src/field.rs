//! A grid as a field: its value range, its values between samples, its gradients.

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use crate::brick::Extremes;
use crate::volume::{GridFrame, Volume, VolumeError, Voxels};

/// The difference per sample step at `here` from its two neighbours along one axis: central where both are
/// finite, one-sided where one is, 0 where none is. Samples outside the grid count as not finite.
#[inline]
pub(crate) fn difference(before: f32, here: f32, after: f32) -> f32 {
    let central = 0.5 * (after - before);
    if central.is_finite() {
        return central;
    }
    let (forward, backward) = (after - here, here - before);
    if forward.is_finite() {
        forward
    } else if backward.is_finite() {
        backward
    } else {
        0.0
    }
}

impl Volume {
    /// The linear part of [`Volume::index_to_world`]: its columns are the steps from sample to sample.
    pub fn steps(&self) -> DMat3 {
        self.index_to_world().matrix3
    }

    /// The world volume that each sample stands for: |det| of the steps.
    pub fn voxel_volume(&self) -> f64 {
        self.steps().determinant().abs()
    }

    /// Takes gradients from index space to the world: the inverse transpose of the steps, right for any
    /// spacing and for directions that are not orthogonal.
    pub fn gradients_to_world(&self) -> DMat3 {
        self.steps().inverse().transpose()
    }

    /// Smallest and largest finite value; `None` if there is none.
    pub fn value_range(&self) -> Option<[f32; 2]> {
        fn range<T: Copy + Into<f32> + Sync>(samples: &[T]) -> [f32; 2] {
            let of_chunk = |chunk: &[T]| {
                let mut extremes = Extremes::default();
                extremes.include(chunk);
                extremes.range()
            };
            samples
                .par_chunks(1 << 16)
                .map(of_chunk)
                .reduce(|| Extremes::default().range(), |a, b| [a[0].min(b[0]), a[1].max(b[1])])
        }
        let [low, high] = match self.voxels() {
            Voxels::U8(v) => range(v),
            Voxels::U16(v) => range(v),
            Voxels::I16(v) => range(v),
            Voxels::F32(v) => range(v),
        };
        (low <= high).then_some([low, high])
    }

    /// The trilinear interpolant at `index`, in sample indices (sample (0, 0, 0) is at the origin of index
    /// space; [`Volume::index_to_world`] inverted takes world points there).
    ///
    /// `None` outside the grid, and where a sample that takes part is not finite.
    pub fn sample(&self, index: DVec3) -> Option<f32> {
        let (mut low, mut fraction) = ([0; 3], [0.0; 3]);
        for axis in 0..3 {
            let last = self.dims()[axis] - 1;
            if !(index[axis] >= 0.0 && index[axis] <= last as f64) {
                return None;
            }
            low[axis] = (index[axis] as usize).min(last.saturating_sub(1));
            fraction[axis] = index[axis] - low[axis] as f64;
        }
        let mut sum = 0.0;
        for corner in 0..8 {
            let mut at = low;
            let mut weight = 1.0;
            for axis in 0..3 {
                let upper = corner >> axis & 1;
                at[axis] += upper;
                weight *= if upper == 1 { fraction[axis] } else { 1.0 - fraction[axis] };
            }
            if weight > 0.0 {
                sum += weight * f64::from(self.value(at));
            }
        }
        sum.is_finite().then_some(sum as f32)
    }

    /// The same field in voxels that are divided into `times` along each axis. Each part has a sample in its middle, of the trilinear interpolant; in the
    /// outer half of border voxels, where there is none, that of the nearest place between samples. Not finite where a sample that takes part isn't.
    ///
    /// Kernels of a refined volume are *post-classified*: values are interpolated first, and a transfer function sees what is between
    /// samples. Kernels of the volume itself are pre-classified: its samples' colours and extinctions are interpolated. That differs
    /// where the function changes much from sample to sample, and takes `times`³ as many samples, as f32.
    ///
    /// # Errors
    /// When `times` is 0, or memory cannot hold the samples.
    pub fn refined(&self, times: usize) -> Result<Self, VolumeError> {
        let refused = || VolumeError::Refined { times, dims: self.dims() };
        let dims = self.dims();
        let fine = |d: usize| d.checked_mul(times).filter(|_| times > 0);
        let [Some(nx), Some(ny), Some(nz)] = dims.map(fine) else { return Err(refused()) };
        let count = nx.checked_mul(ny).and_then(|n| n.checked_mul(nz)).ok_or_else(refused)?;
        let mut values = Vec::new();
        values.try_reserve_exact(count).map_err(|_| refused())?;
        values.resize(count, 0.0_f32);
        let step = 1.0 / times as f64;
        let first = DVec3::splat(0.5 * (step - 1.0));
        values.par_chunks_mut(nx).enumerate().for_each(|(row, values)| {
            for (i, value) in values.iter_mut().enumerate() {
                let index = DVec3::from([i, row % ny, row / ny].map(|n| n as f64)) * step + first;
                let last = DVec3::from(dims.map(|d| (d - 1) as f64));
                *value = self.sample(index.clamp(DVec3::ZERO, last)).unwrap_or(f32::NAN);
            }
        });
        let origin = self.index_to_world().transform_point3(first);
        let frame = GridFrame { origin, spacing: self.frame().spacing * step, ..self.frame() };
        Self::new([nx, ny, nz], Voxels::F32(values), frame)
    }

    /// The gradient at sample (i, j, k) in value per world unit, along the world's axes.
    ///
    /// Central differences inside, one-sided at borders and beside values that are not finite; exact for
    /// linear fields. An axis without a usable neighbour contributes 0.
    pub fn gradient(&self, index: [usize; 3]) -> Vec3 {
        let dims = self.dims();
        let differences = match self.voxels() {
            Voxels::U8(v) => differences(v, dims, index),
            Voxels::U16(v) => differences(v, dims, index),
            Voxels::I16(v) => differences(v, dims, index),
            Voxels::F32(v) => differences(v, dims, index),
        };
        (self.gradients_to_world() * differences).as_vec3()
    }
}

/// A number that a sample can be.
pub(crate) trait Sample: Copy + Into<f32> + Sync {}
impl<T: Copy + Into<f32> + Sync> Sample for T {}

/// The gradient at a sample in index space: differences per sample step.
#[inline]
pub(crate) fn differences<T: Sample>(samples: &[T], dims: [usize; 3], index: [usize; 3]) -> DVec3 {
    let place = (index[2] * dims[1] + index[1]) * dims[0] + index[0];
    let here = samples[place].into();
    let along = |axis: usize, stride: usize| {
        let before = if index[axis] > 0 { samples[place - stride].into() } else { f32::NAN };
        let after = if index[axis] + 1 < dims[axis] { samples[place + stride].into() } else { f32::NAN };
        f64::from(difference(before, here, after))
    };
    DVec3::new(along(0, 1), along(1, dims[0]), along(2, dims[0] * dims[1]))
}
