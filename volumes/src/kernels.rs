//! Volumes to extinction kernels.

use glam::{DAffine3, DVec3, Vec3};

use oblate_engine::{Cloud, CloudError, Material, Shapes, Splats, Strength};

use crate::brick::{Brick, MORTON, walk_bricks};
use crate::transfer::{Optical, TransferFunction};
use crate::volume::{Volume, Voxels};

/// Standard deviation of a sample's kernel, in steps of the grid. Kernels of a constant field then sum to the
/// field within 6 exp(−2π²·0.7²) = 4·10⁻⁴ (Poisson summation; the next terms are 10⁻⁸).
pub const KERNEL_SIGMA: f64 = 0.7;

/// How [`to_kernels`] makes kernels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KernelSettings {
    /// How the kernels answer light.
    pub material: Material,
}

/// One extinction kernel for each sample that `transfer` gives extinction; samples that are empty, or not
/// finite, become nothing.
///
/// The kernels share one covariance, that of a round Gaussian of [`KERNEL_SIGMA`] steps taken to the world by
/// the grid's steps, and have the mass extinction × voxel volume: where the field is constant they sum to it,
/// whatever spacing and directions are (Zwicker et al., *EWA Volume Splatting*, 2001, section 4.3). Normals
/// point to lower values, and are zero where the gradient is. The cloud's space has the world's axes and its
/// origin at sample (0, 0, 0); kernels are in Morton order.
///
/// # Errors
/// When a mass or a place is no finite f32, or there are 2³² kernels or more.
pub fn to_kernels(
    volume: &Volume,
    transfer: &TransferFunction,
    settings: &KernelSettings,
) -> Result<Cloud, CloudError> {
    let lookup = Lookup::new(volume.voxels(), transfer);
    let batches =
        walk_bricks(volume, |brick, base, batch: &mut Batch| batch.add(brick, base, &lookup, volume));

    let count = batches.iter().map(|batch| batch.centers.len()).sum();
    let mut all = Batch::with_capacity(count);
    for batch in batches {
        all.centers.extend(batch.centers);
        all.masses.extend(batch.masses);
        all.colors.extend(batch.colors);
        all.normals.extend(batch.normals);
    }
    let cloud = Cloud::new(Splats {
        centers: all.centers,
        shapes: Shapes::Shared((volume.steps() * KERNEL_SIGMA).as_mat3()),
        strength: Strength::Extinction { masses: all.masses },
        colors: all.colors,
        harmonics: None,
        normals: Some(all.normals),
        material: settings.material,
    })?;
    Ok(cloud.transformed(DAffine3::from_translation(volume.frame().origin)))
}

/// The transfer function of every value that an integer can take, or the function itself.
struct Lookup<'a> {
    transfer: &'a TransferFunction,
    table: Vec<Optical>,
    first: f32,
}

impl<'a> Lookup<'a> {
    fn new(voxels: &Voxels, transfer: &'a TransferFunction) -> Self {
        let (first, count) = match voxels {
            Voxels::U8(_) => (0.0, 1 << 8),
            Voxels::U16(_) => (0.0, 1 << 16),
            Voxels::I16(_) => (f32::from(i16::MIN), 1 << 16),
            Voxels::F32(_) => (0.0, 0),
        };
        let table = (0..count).map(|offset| transfer.at(first + offset as f32)).collect();
        Self { transfer, table, first }
    }

    fn at(&self, value: f32) -> Optical {
        if self.table.is_empty() {
            return self.transfer.at(value);
        }
        if value.is_finite() { self.table[(value - self.first) as usize] } else { Optical::default() }
    }
}

/// Arrays of kernels in the making.
#[derive(Default)]
struct Batch {
    centers: Vec<Vec3>,
    masses: Vec<f32>,
    colors: Vec<[f32; 3]>,
    normals: Vec<Vec3>,
}

impl Batch {
    fn with_capacity(count: usize) -> Self {
        Self {
            centers: Vec::with_capacity(count),
            masses: Vec::with_capacity(count),
            colors: Vec::with_capacity(count),
            normals: Vec::with_capacity(count),
        }
    }

    fn add(&mut self, brick: &Brick, base: [usize; 3], lookup: &Lookup, volume: &Volume) {
        let (steps, voxel_volume) = (volume.steps(), volume.voxel_volume());
        let gradients_to_world = volume.gradients_to_world();
        let dims = volume.dims();
        for local in MORTON {
            let index = [0, 1, 2].map(|axis| base[axis] + usize::from(local[axis]));
            if (0..3).any(|axis| index[axis] >= dims[axis]) {
                continue;
            }
            let place = Brick::place(local);
            let Optical { extinction, color } = lookup.at(brick.value(place));
            if extinction <= 0.0 {
                continue;
            }
            let gradient = gradients_to_world * DVec3::from(brick.differences(place).map(f64::from));
            let factor = lookup.transfer.gradient().map_or(1.0, |ramp| ramp.factor(gradient.length() as f32));
            if factor <= 0.0 {
                continue;
            }
            let mass = f64::from(extinction) * f64::from(factor) * voxel_volume;
            self.centers.push((steps * DVec3::from(index.map(|i| i as f64))).as_vec3());
            self.masses.push(mass as f32);
            self.colors.push(color);
            self.normals.push(-gradient.normalize_or_zero().as_vec3());
        }
    }
}
