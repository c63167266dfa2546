//! What kernels of merged surfels cover.

use super::neighborhood::Neighborhood;
use super::patch::{Bounds, Patch, Sample};
use glam::DVec3;
use rayon::prelude::*;

/// The share that a merged kernel may lose of what is flat around it, for each radian of the largest angle: a hundredth at 10°. Beyond an edge all of a
/// share is wrong, while an angle changes light by about itself.
const LOSS_PER_RADIAN: f64 = 0.06;

/// Half-axes after which a kernel counts for nothing; 0.01 of it lies beyond.
const REACH: f64 = 3.0;

/// The least share of a sample's former coverage, up to 1, that is left of it.
const LEAST_COVERED: f64 = 0.95;

/// How often areas are raised; neighbours that are raised make up for the rest.
const ROUNDS: usize = 4;

/// How much an area may be raised in all, for borders, where nothing is that could cover more.
const MOST: f64 = 2.0;

/// A surfel's kernel in its plane, ready to be evaluated: normalized, times its area.
struct Kernel {
    center: DVec3,
    /// Half-axes over their squared lengths.
    inverse: [DVec3; 2],
    plane: DVec3,
    peak: f64,
    /// Half of the box around it.
    reach: DVec3,
}

impl Kernel {
    fn new(surfel: &Sample) -> Self {
        let [u, v] = surfel.half_axes;
        let squares = [u, v].map(|axis| axis.length_squared().max(f64::MIN_POSITIVE));
        // Half-axes of extremely small or slanted surfels may fail this; they then count for nothing.
        let extent = u.cross(v).length();
        let peak = if extent > 0.0 { surfel.area / (2.0 * std::f64::consts::PI * extent) } else { 0.0 };
        let plane = surfel.plane;
        // As far off the plane as along it: what bends stays near.
        let reach = (u * u + v * v + plane * plane * squares[0].min(squares[1])).map(f64::sqrt) * REACH;
        Self { center: surfel.center, inverse: [u / squares[0], v / squares[1]], plane, peak, reach }
    }

    /// Whether it covers anything of a sample: nothing of what faces away or lies beyond its box.
    fn reaches(&self, sample: &Sample) -> bool {
        let d = sample.center - self.center;
        d.abs().cmple(self.reach).all() && sample.plane.dot(self.plane) > 0.0
    }

    /// Its coverage at a sample that it reaches, seen along its normal.
    fn at(&self, sample: &Sample) -> f64 {
        let d = sample.center - self.center;
        let [x, y] = self.inverse.map(|axis| axis.dot(d));
        self.peak * (-0.5 * (x * x + y * y)).exp()
    }
}

/// Whether the merged kernel lies as well on what is flat around it as those of its surfels do: nearly all of what they cover
/// of samples within the bounds, times their areas, is covered by it.
pub(super) fn is_flat_around(patch: &Patch, bounds: &Bounds, around: &Neighborhood<'_>) -> bool {
    let on_flat = |surfel: &Sample| -> f64 {
        let kernel = Kernel::new(surfel);
        let of = |index: &u32| {
            let sample = &around.samples[*index as usize];
            let counts = kernel.reaches(sample) && sample.is_within(bounds, &patch.mean);
            if counts { kernel.at(sample) * sample.area } else { 0.0 }
        };
        around.touched(kernel.center, kernel.reach).flat_map(|cell| around.indices(cell)).map(of).sum()
    };
    let least = 1.0 - LOSS_PER_RADIAN * bounds.most.angle;
    let merged = on_flat(&patch.mean);
    merged >= least * patch.mean.area
        || merged >= least * patch.members.iter().map(|i| on_flat(&around.samples[*i as usize])).sum::<f64>()
}

/// Areas of the patches' surfels, raised where their samples would be bare.
pub(super) fn evened(patches: &[Patch], around: &Neighborhood<'_>) -> Vec<f64> {
    let old: Vec<Kernel> = around.samples.par_iter().map(Kernel::new).collect();
    let new: Vec<Kernel> = patches.par_iter().map(|patch| Kernel::new(&patch.mean)).collect();
    let wanted = coverage(&old, &vec![1.0; old.len()], around);
    let lists = Lists::new(&new, around);
    let mut factors = vec![1.0; patches.len()];
    for _ in 0..ROUNDS {
        let found = lists.coverage(&new, &factors, around);
        let raised = |(patch, factor): (&Patch, &mut f64)| {
            let lacking = |index: &u32| {
                let (wanted, found) = (wanted[*index as usize].min(1.0), found[*index as usize]);
                LEAST_COVERED * wanted / found.max(f64::MIN_POSITIVE)
            };
            let most = patch.members.iter().map(lacking).fold(1.0, f64::max);
            *factor = (*factor * most).min(MOST);
        };
        patches.par_iter().zip(&mut factors).for_each(raised);
    }
    patches.iter().zip(factors).map(|(patch, factor)| patch.mean.area * factor).collect()
}

fn coverage(kernels: &[Kernel], factors: &[f64], around: &Neighborhood<'_>) -> Vec<f64> {
    Lists::new(kernels, around).coverage(kernels, factors, around)
}

/// Kernels by the cubes that they touch.
struct Lists {
    /// Cube and kernel, in order.
    entries: Vec<(u32, u32)>,
}

impl Lists {
    fn new(kernels: &[Kernel], around: &Neighborhood<'_>) -> Self {
        let touched = |(number, kernel): (usize, &Kernel)| {
            let cubes: Vec<_> = around.touched(kernel.center, kernel.reach).collect();
            cubes.into_iter().map(move |cube| (cube as u32, number as u32))
        };
        let mut entries: Vec<(u32, u32)> = kernels.par_iter().enumerate().flat_map_iter(touched).collect();
        entries.par_sort_unstable();
        Self { entries }
    }

    /// What kernels, times their factors, cover at each sample.
    fn coverage(&self, kernels: &[Kernel], factors: &[f64], around: &Neighborhood<'_>) -> Vec<f64> {
        let of_cube = |cube: usize| {
            let first = self.entries.partition_point(|(of, _)| (*of as usize) < cube);
            let listed = self.entries[first..].iter().take_while(move |(of, _)| *of as usize == cube);
            let listed: Vec<usize> = listed.map(|(_, kernel)| *kernel as usize).collect();
            let of_sample = move |index: &u32| {
                let sample = &around.samples[*index as usize];
                let sum: f64 =
                    listed.iter().map(|kernel| factors[*kernel] * kernels[*kernel].at(sample)).sum();
                (*index, sum)
            };
            around.indices(cube).iter().map(of_sample)
        };
        let sums: Vec<(u32, f64)> = around.cubes().into_par_iter().flat_map_iter(of_cube).collect();
        let mut covered = vec![0.0; around.samples.len()];
        sums.into_iter().for_each(|(index, sum)| covered[index as usize] = sum);
        covered
    }
}
