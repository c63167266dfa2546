//! Surface samples of a ray to layers: what surfels mean, written as the rule stands.

use crate::cloud::Material;
use glam::DVec3;

/// The most layers a ray keeps; the last takes all that is left.
const MOST_LAYERS: usize = 4;

/// A surfel as a ray meets it.
#[derive(Clone, Copy)]
pub(super) struct Sample<'a> {
    pub(super) z: f64,
    pub(super) id: u32,
    /// Spread of z inside the pixel's filter.
    pub(super) sigma: f64,
    /// Coverage: the surface area that a unit of area across the ray has in this sample.
    pub(super) weight: f64,
    pub(super) opacity: f64,
    pub(super) color: DVec3,
    /// In camera space; zero for none.
    pub(super) normal: DVec3,
    pub(super) material: &'a Material,
    pub(super) depth_tolerance: f64,
    pub(super) coverage_floor: f64,
}

/// A sheet that a ray passes at one depth.
#[derive(Clone, Copy)]
pub(super) struct Layer<'a> {
    pub(super) z: f64,
    /// Of its first sample.
    pub(super) id: u32,
    pub(super) alpha: f64,
    pub(super) color: DVec3,
    pub(super) normal: DVec3,
    pub(super) material: &'a Material,
}

/// Sorts the samples by (z, id) and yields the layers, front to back. A layer takes the samples that are
/// within its first sample's tolerance plus three of its σ behind the first; means are weighted by coverage.
pub(super) fn layers<'a, 's>(samples: &'s mut [Sample<'a>]) -> impl Iterator<Item = Layer<'a>> + use<'a, 's> {
    samples.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.id.cmp(&b.id)));
    let mut left = &*samples;
    (1..=MOST_LAYERS).map_while(move |number| {
        let first = left.first()?;
        let end = first.z + first.depth_tolerance + 3.0 * first.sigma;
        let count = match number {
            MOST_LAYERS => left.len(),
            _ => left.iter().take_while(|s| s.z <= end).count().max(1),
        };
        let (taken, behind) = left.split_at(count);
        left = behind;
        let total: f64 = taken.iter().map(|s| s.weight).sum();
        let mean = |value: fn(&Sample<'_>) -> DVec3| -> DVec3 {
            taken.iter().map(|s| s.weight * value(s)).sum::<DVec3>() / total
        };
        let covered: f64 = taken.iter().map(|s| s.opacity * s.weight / s.coverage_floor).sum();
        Some(Layer {
            z: first.z + taken.iter().map(|s| s.weight * (s.z - first.z)).sum::<f64>() / total,
            id: first.id,
            alpha: covered.min(1.0),
            color: mean(|s| s.color),
            normal: mean(|s| s.normal),
            material: first.material,
        })
    })
}
