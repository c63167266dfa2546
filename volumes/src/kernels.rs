//! Volumes to extinction kernels.

use std::borrow::Borrow;

use glam::DAffine3;

use oblate_engine::{Cloud, CloudError, Material};

use crate::brick::{BrickRange, brick_ranges};
use crate::classify::splats;
use crate::transfer::TransferFunction;
use crate::volume::Volume;

/// Standard deviation of a sample's kernel, in steps of the grid. Kernels of a constant field then sum to the
/// field within 6 exp(−2π²·0.7²) = 4·10⁻⁴ (Poisson summation; the next terms are 10⁻⁸).
pub const KERNEL_SIGMA: f64 = 0.7;

/// How [`to_kernels`] makes kernels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KernelSettings {
    /// How the kernels answer light.
    pub material: Material,
    /// Which of them are flat.
    pub flattening: Option<Flattening>,
}

/// Samples beside a surface as surfels among the kernels of the others (Zwicker et al., *EWA Volume Splatting*, 2001, section 6
/// and figure 10).
///
/// A sample within half a step of the place where its value and gradient put the surface is pressed onto it: of its kernel's distance
/// to the surface, and of its extent along the gradient, 1 / `ratio` is left. Its mass stays, and it is one sample as before, so
/// that nothing is counted twice and nothing steps as the ratio goes from 1, where kernels are as ever, to infinity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flattening {
    /// The value on the surface; finite.
    pub value: f32,
    /// The least gradient of what becomes flat, in value per world unit; at least 0. A sample whose own gradient is zero never does.
    pub least_gradient: f32,
    /// Radius over thickness: from 1 (as ever) to infinity (surfels).
    pub ratio: f32,
}

/// One extinction kernel for each sample that `transfer` gives extinction; samples that are empty, or not
/// finite, become nothing.
///
/// But for a [`Flattening`], the kernels share one covariance, that of a round Gaussian of [`KERNEL_SIGMA`] steps taken to the world by
/// the grid's steps, and have the mass extinction × voxel volume: where the field is constant they sum to it,
/// whatever spacing and directions are (Zwicker et al., *EWA Volume Splatting*, 2001, section 4.3). Normals
/// point to lower values, and are zero where the gradient is. The cloud's space has the world's axes and its
/// origin at sample (0, 0, 0); kernels are in Morton order.
///
/// Where one function follows another on the same volume, a [`Classifier`] is faster.
///
/// # Errors
/// When a mass or a place is no finite f32, or there are 2³² kernels or more.
pub fn to_kernels(
    volume: &Volume,
    transfer: &TransferFunction,
    settings: &KernelSettings,
) -> Result<Cloud, CloudError> {
    Classifier::new(volume, *settings).classify(transfer)
}

/// A volume ready to become kernels under one transfer function after another, as while a user moves a
/// function's points.
///
/// It knows the smallest and largest value in each brick of 8×8×8 samples (32 bytes a brick), so that bricks in
/// which a function shows nothing are not looked at. Gradients are not kept: packed into 32 bits a sample they
/// would save a seventh of a classification, and packing them takes as long as two.
///
/// ```
/// # use oblate_volumes::{Classifier, KernelSettings, PRESETS, shepp_logan};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let volume = shepp_logan(32)?;
/// let classifier = Classifier::new(&volume, KernelSettings::default());
/// for preset in &PRESETS {
///     let cloud = classifier.classify(&preset.fit(&volume)?)?;
///     assert!(!cloud.is_empty());
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Classifier<V> {
    volume: V,
    settings: KernelSettings,
    bricks: Vec<BrickRange>,
}

impl<V: Borrow<Volume>> Classifier<V> {
    /// Looks through the samples of a `Volume`, of a reference to one, or of an `Arc` of one.
    pub fn new(volume: V, settings: KernelSettings) -> Self {
        let bricks = brick_ranges(volume.borrow());
        Self { volume, settings, bricks }
    }

    /// The volume.
    pub fn volume(&self) -> &Volume {
        self.volume.borrow()
    }

    /// The cloud of [`to_kernels`] under `transfer`.
    ///
    /// # Errors
    /// As [`to_kernels`].
    pub fn classify(&self, transfer: &TransferFunction) -> Result<Cloud, CloudError> {
        let cloud = Cloud::new(splats(self.volume(), &self.bricks, transfer, &self.settings))?;
        Ok(cloud.transformed(DAffine3::from_translation(self.volume().frame().origin)))
    }
}
