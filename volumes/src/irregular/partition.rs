//! Irregular samples to extinction kernels.

use glam::{DAffine3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

use oblate_engine::{Cloud, CloudError, Material, Shapes, Splats, Strength};

use super::IrregularVolume;
use super::local::{Local, cofactors, downhill};
use super::supports::Supports;
use crate::kernels::KERNEL_SIGMA;
use crate::transfer::TransferFunction;

/// Squared distance in σ beyond which a kernel is left out of sums: e^{−9} of its peak.
const CUTOFF: f32 = 18.0;

/// The samples of an irregular volume as kernels that add up to nearly 1, ready for one transfer function after another.
///
/// A sample with steps J to its neighbours stands for the volume |det J|, and its kernel has the covariance J diag(σ²) Jᵀ, σ being [`KERNEL_SIGMA`]:
/// on an even grid that is the kernel of [`to_kernels`](crate::to_kernels). Where steps change, such kernels do not add up to 1; so each is divided
/// by what they add up to at its own centre (a step of Shepard's: *A Two-Dimensional Interpolation Function for Irregularly-Spaced Data*,
/// 1968; Zwicker et al., *EWA Volume Splatting*, 2001, section 4.1, ask for a partition of unity), also along borders, where half of the neighbours
/// are missing, and where parts of a grid overlap. What is left is the [`Residual`].
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

/// What kernels of a constant field of 1 add up to at the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residual {
    /// Least and greatest sum.
    pub range: [f64; 2],
    /// Root of the mean squared difference from 1.
    pub rms: f64,
    /// The same two before the step of Shepard's.
    pub before: ([f64; 2], f64),
}

impl Partition {
    /// Kernels of all samples that are there and span a volume with their neighbours.
    pub fn new(volume: &IrregularVolume) -> Self {
        let (locals, origin) = (volume.locals(), volume.middle());
        let center = |local: &Local| (volume.points()[local.number] - origin).as_vec3();
        let reach = |local: &Local| {
            let rows = local.steps.transpose();
            let along = DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
            (along * KERNEL_SIGMA * f64::from(CUTOFF).sqrt()).as_vec3()
        };
        let boxes: Vec<(Vec3, Vec3)> = locals.par_iter().map(|local| (center(local), reach(local))).collect();
        let sums = Sums::new(&locals, &boxes);
        let first = sums.at_centers(&vec![1.0; locals.len()]);
        let shares: Vec<f32> = first.par_iter().map(|sum| sum.recip()).collect();
        let second = sums.at_centers(&shares);
        let (range, rms) = spread(&second);
        let residual = Residual { range, rms, before: spread(&first) };
        let kernel = |(local, share): (&Local, &f32)| Kernel {
            center: center(local),
            factor: (local.steps * KERNEL_SIGMA).as_mat3(),
            volume: (local.steps.determinant().abs() * f64::from(*share)) as f32,
            value: volume.samples().voxels().get(local.number),
            gradient: local.gradient.as_vec3(),
        };
        let kernels = locals.par_iter().zip(&shares).map(kernel).collect();
        Self { kernels, origin, residual }
    }

    /// How far from 1 the kernels of a constant field add up to.
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

/// Sums of kernels at points.
struct Sums {
    supports: Supports,
    /// Of each kernel in the supports' order: where it is, and what takes differences to its own units, σ.
    kernels: Vec<(Vec3, Mat3)>,
}

impl Sums {
    fn new(locals: &[Local], boxes: &[(Vec3, Vec3)]) -> Self {
        let supports = Supports::new(boxes);
        let to_units = |number: &u32| {
            let steps = locals[*number as usize].steps;
            let inverse = cofactors(steps).transpose() * (KERNEL_SIGMA * steps.determinant()).recip();
            (boxes[*number as usize].0, inverse.as_mat3())
        };
        let kernels = supports.order.par_iter().map(to_units).collect();
        Self { supports, kernels }
    }

    /// What the kernels add up to at the centre of each, where the volume of each is multiplied by its share.
    ///
    /// A volume |det J| over the kernel's (2π)^{3/2} σ³ |det J| is the same for all.
    fn at_centers(&self, shares: &[f32]) -> Vec<f32> {
        let peak = ((2.0 * std::f64::consts::PI).powf(-1.5) * KERNEL_SIGMA.powi(-3)) as f32;
        let at = |place: usize| {
            let (point, mut sum) = (self.kernels[place].0, 0.0);
            self.supports.around(point, &mut |other| {
                let (center, to_units) = self.kernels[other];
                let squared = (to_units * (point - center)).length_squared();
                if squared < CUTOFF {
                    sum += shares[self.supports.order[other] as usize] * (-0.5 * squared).exp();
                }
            });
            peak * sum
        };
        let sums: Vec<f32> = (0..self.kernels.len()).into_par_iter().map(at).collect();
        let mut of_kernels = vec![1.0; sums.len()];
        for (number, sum) in self.supports.order.iter().zip(sums) {
            of_kernels[*number as usize] = sum;
        }
        of_kernels
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
