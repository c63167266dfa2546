//! Irregular samples to extinction kernels.

use glam::{DAffine3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

use oblate_engine::{Cloud, CloudError, Material, Shapes, Splats, Strength};

use super::IrregularVolume;
use super::local::{Local, downhill};
use super::sums::{EvenGrid, Sums};
use crate::kernels::KERNEL_SIGMA;
use crate::transfer::TransferFunction;

/// How often a step of Shepard's is made. Each takes as long; four leave a quarter to three fifths of what one does.
const ROUNDS: usize = 4;

/// The samples of an irregular volume as kernels that add up to nearly 1, ready for one transfer function after another.
///
/// A sample with steps J to its neighbours stands for the volume |det J|, and its kernel has the covariance J diag(σ²) Jᵀ, σ being [`KERNEL_SIGMA`]:
/// on an even grid that is the kernel of [`to_kernels`](crate::to_kernels). Where steps change, such kernels do not add up to 1; so each is divided
/// by what they add up to at its own centre (a step of Shepard's: *A Two-Dimensional Interpolation Function for Irregularly-Spaced Data*,
/// 1968; Zwicker et al., *EWA Volume Splatting*, 2001, section 4.1, ask for a partition of unity), four times over. What is left is the [`Residual`].
///
/// Along borders, where neighbours are missing, kernels add up to less, as those of a regular volume do: at least to what an even grid has where
/// the same ones are missing. Where borders of a grid meet, or parts of it overlap, they add up to 1. Of scattered samples it isn't known which are
/// missing: theirs add up to 1 everywhere.
#[derive(Clone, Debug)]
pub struct Partition {
    kernels: Vec<Kernel>,
    origin: DVec3,
    residual: Residual,
}

/// A sample's kernel of constant extinction 1.
#[derive(Clone, Copy, Debug)]
struct Kernel {
    center: Vec3,
    /// Columns are its half-axes.
    factor: Mat3,
    /// In cubic world units.
    volume: f32,
    value: f32,
    gradient: Vec3,
}

/// What kernels of a constant field of 1 add up to at the samples, as a share of what they should: 1, but less along borders (see [`Partition`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residual {
    /// Least and greatest share.
    pub range: [f64; 2],
    /// Root of the mean squared difference from 1.
    pub rms: f64,
    /// The same two before the steps of Shepard's.
    pub before: ([f64; 2], f64),
}

impl Partition {
    /// Kernels of all samples that are there and span a volume with their neighbours.
    pub fn new(volume: &IrregularVolume) -> Self {
        let (locals, origin) = (volume.locals(), volume.middle());
        let center = |local: &Local| (volume.points()[local.number] - origin).as_vec3();
        let centers: Vec<Vec3> = locals.par_iter().map(center).collect();
        let sums = Sums::new(&locals, &centers);
        let mut shares = vec![1.0; locals.len()];
        let first = sums.at_centers(&shares);
        let mut have_kernels = vec![false; volume.points().len()];
        locals.iter().for_each(|local| have_kernels[local.number] = true);
        let has =
            |number: usize, steps| volume.beside(number, steps).is_some_and(|beside| have_kernels[beside]);
        let even = EvenGrid::new();
        let whole = even.sum(|_| true);
        // Where borders of a grid meet, more is there than an even grid has at a border.
        let expected =
            |(local, sum): (&Local, &f32)| sum.clamp(even.sum(|steps| has(local.number, steps)), whole);
        let expected: Vec<f32> = locals.par_iter().zip(&first).map(expected).collect();
        let of_expected = |sums: Vec<f32>| -> Vec<f32> {
            sums.iter().zip(&expected).map(|(sum, expected)| sum / expected).collect()
        };
        let mut ratios = of_expected(first);
        let before = spread(&ratios);
        for _ in 0..ROUNDS {
            shares.iter_mut().zip(&ratios).for_each(|(share, ratio)| *share /= ratio);
            ratios = of_expected(sums.at_centers(&shares));
        }
        let (range, rms) = spread(&ratios);
        let residual = Residual { range, rms, before };
        let kernel = |((local, center), share): ((&Local, &Vec3), &f32)| Kernel {
            center: *center,
            factor: (local.steps * KERNEL_SIGMA).as_mat3(),
            volume: (local.steps.determinant().abs() * f64::from(*share)) as f32,
            value: volume.samples().voxels().get(local.number),
            gradient: local.gradient.as_vec3(),
        };
        let kernels = locals.par_iter().zip(&centers).zip(&shares).map(kernel).collect();
        Self { kernels, origin, residual }
    }

    /// How far what kernels of a constant field add up to is from what it should be.
    pub fn residual(&self) -> Residual {
        self.residual
    }

    /// One extinction kernel for each sample that `transfer` gives extinction, as [`to_kernels`](crate::to_kernels) makes them of a regular
    /// volume. The cloud's space has the world's axes and its origin in the middle of the samples; kernels are in Morton order.
    ///
    /// # Errors
    /// When a mass or a place is no finite f32, or there are 2³² kernels or more.
    pub fn kernels(&self, transfer: &TransferFunction, material: Material) -> Result<Cloud, CloudError> {
        let mass = |kernel: &Kernel| {
            let ramp = transfer.gradient().map_or(1.0, |ramp| ramp.factor(kernel.gradient.length()));
            transfer.extinction(kernel.value) * ramp * kernel.volume
        };
        let shown: Vec<(&Kernel, f32)> = self
            .kernels
            .par_iter()
            .map(|kernel| (kernel, mass(kernel)))
            .filter(|(_, mass)| *mass != 0.0)
            .collect();
        let splats = Splats {
            centers: shown.par_iter().map(|(kernel, _)| kernel.center).collect(),
            shapes: Shapes::Each(shown.par_iter().map(|(kernel, _)| kernel.factor).collect()),
            strength: Strength::Extinction { masses: shown.par_iter().map(|(_, mass)| *mass).collect() },
            colors: shown.par_iter().map(|(kernel, _)| transfer.color(kernel.value)).collect(),
            harmonics: None,
            normals: Some(shown.par_iter().map(|(k, _)| downhill(k.gradient.as_dvec3())).collect()),
            material,
        };
        let cloud = Cloud::new(splats.in_morton_order())?;
        Ok(cloud.transformed(DAffine3::from_translation(self.origin)))
    }
}

/// Least and greatest sum, and the root of the mean squared difference from 1.
fn spread(sums: &[f32]) -> ([f64; 2], f64) {
    let join = |[low, high]: [f64; 2], sum: &f32| [low.min(f64::from(*sum)), high.max(f64::from(*sum))];
    if sums.is_empty() {
        return ([1.0; 2], 0.0);
    }
    let squares: f64 = sums.iter().map(|sum| (f64::from(*sum) - 1.0).powi(2)).sum();
    (sums.iter().fold([f64::INFINITY, f64::NEG_INFINITY], join), (squares / sums.len() as f64).sqrt())
}
