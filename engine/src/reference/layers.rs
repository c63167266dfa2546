//! Surface samples of a ray to layers: what surfels mean, written as the rule stands.

use crate::cloud::Material;
use glam::DVec3;

/// The most layers of a ray; the last takes all that is left.
const MOST_LAYERS: usize = 64;

/// Sheets nearer than this share of the depth tolerance are one; as far again, and they are two.
const LEAST_GAP: f64 = 1.0 / 16.0;

/// The share of the variance of depths that two sheets make by being apart: of samples spread evenly it is the first, from the second on they are two.
const APART: [f64; 2] = [0.75, 0.9];

/// A surfel as a ray meets it.
#[derive(Clone, Copy)]
pub(super) struct Sample<'a> {
    pub(super) z: f64,
    /// Where its plane meets the ray, no farther from `z` than a steep slope takes it.
    pub(super) plane_z: f64,
    /// How much thicker than its depth tolerance a layer is that begins with it.
    pub(super) thickness: f64,
    pub(super) id: u32,
    /// Spread of z inside the pixel's filter.
    pub(super) sigma: f64,
    /// Coverage: the surface area that a unit of area across the ray has in this sample.
    pub(super) weight: f64,
    pub(super) opacity: f64,
    pub(super) color: DVec3,
    /// In camera space, of length 1; zero for none.
    pub(super) normal: DVec3,
    /// Whether the ray meets its back, and whether that tells it from its neighbours.
    pub(super) back: bool,
    pub(super) has_sides: bool,
    pub(super) material: &'a Material,
    pub(super) depth_tolerance: f64,
    /// Raised by the filter.
    pub(super) coverage_floor: f64,
    pub(super) cloud_floor: f64,
    /// How even the coverage of a single sheet is there, at least: between this and as much above 1 as this is below.
    pub(super) even: f64,
}

impl Sample<'_> {
    fn coverage(&self) -> f64 {
        self.weight / self.coverage_floor
    }
}

/// A sheet that a ray passes at one depth.
#[derive(Clone, Copy)]
pub(super) struct Layer<'a> {
    pub(super) z: f64,
    /// Of its first sample.
    pub(super) id: u32,
    pub(super) alpha: f64,
    pub(super) color: DVec3,
    /// The mean of its samples' normals on the side that is seen.
    pub(super) normal: DVec3,
    pub(super) material: &'a Material,
}

/// The depths that layers divide a ray into, from the nearest on, each with the layer behind it.
pub(super) fn segments<'a>(
    layers: impl Iterator<Item = Layer<'a>>,
    near: f64,
) -> impl Iterator<Item = ([f64; 2], Option<Layer<'a>>)> {
    let mut from = near;
    layers.map(Some).chain([None]).map(move |layer| {
        let to = layer.as_ref().map_or(f64::INFINITY, |layer| layer.z);
        ([std::mem::replace(&mut from, to), to], layer)
    })
}

/// Yields the layers of the samples, front to back. A sample spans the depths between itself and its plane. A
/// layer's first sample is the nearest (equal depths: the lowest id); it takes each sample whose span begins
/// within the first one's tolerance plus three of the sample's own σ behind the end of the first one's span, or, where that is of a surfel
/// much smaller than the filter, a σ of the filter more.
/// Means are weighted by coverage over its floor, that of colours by opacity, too; that of normals is taken over the side, front
/// or back, that covers more.
pub(super) fn layers<'a>(samples: &mut [Sample<'a>]) -> impl Iterator<Item = Layer<'a>> + use<'a> {
    samples.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.id.cmp(&b.id)));
    let mut left = samples.to_vec();
    let mut nearest = f64::NEG_INFINITY;
    // Shares that fronts and backs cover, what they cover together, and what that lets through.
    let (mut sides, mut covered_together, mut veiled) = ([0.0_f64; 2], 0.0, 0.0);
    (1..=MOST_LAYERS).map_while(move |number| {
        let first = *left.first()?;
        let end = first.z.max(first.plane_z) + first.thickness + first.depth_tolerance;
        let belongs = |s: &Sample<'_>| number == MOST_LAYERS || s.z.min(s.plane_z) <= end + 3.0 * s.sigma;
        let (taken, behind): (Vec<_>, Vec<_>) = left.iter().partition(|s| belongs(s));
        left = behind;
        let total: f64 = taken.iter().map(|s| s.coverage()).sum();
        let covered: f64 = taken.iter().map(|s| s.opacity * s.coverage()).sum();
        let hidden = hidden(&first, &taken);
        let shown = |s: &Sample<'_>| s.opacity * s.coverage() * (1.0 - hidden(s));
        let color: DVec3 = taken.iter().map(|s| shown(s) * s.color).sum();
        let all_shown: f64 = taken.iter().map(shown).sum();
        let mean_z = first.z + taken.iter().map(|s| s.coverage() * (s.z - first.z)).sum::<f64>() / total;
        // Spans that interleave may have means out of order.
        nearest = mean_z.max(nearest);
        let covered_by =
            |back: bool| taken.iter().filter(|s| s.back == back).map(|s| s.coverage()).sum::<f64>();
        let side = |back: bool| -> DVec3 {
            taken.iter().filter(|s| s.back == back).map(|s| s.coverage() * s.normal).sum()
        };
        let shows_back = covered_by(true) > covered_by(false);
        let own = if first.has_sides { [covered_by(false), covered_by(true)] } else { [total, 0.0] };
        let coverage = own[0].max(own[1]).min(1.0);
        // A layer may be several sheets, one behind the other: as many as it covers its share of the pixel times. But what a single one may cover too much by
        // unevenness is none, and twice that is as much. Samples of one sheet let through their mean, of two, m − d and m + d, the product m² − d².
        let clear = |s: &Sample<'_>| (1.0 - s.opacity) * s.coverage();
        // No number where all is opaque.
        let even =
            taken.iter().map(|s| s.even * clear(s)).sum::<f64>() / taken.iter().map(clear).sum::<f64>();
        let times = total / coverage;
        let more = times * even - 1.0;
        let twice_beyond = 2.0 * (more - (1.0 - even));
        let sheets = 1.0 + twice_beyond.min(more).max(0.0);
        let mean_clear = (1.0 - covered / total).max(0.0);
        let variance = if mean_clear > 0.0 {
            let squares: f64 = taken.iter().map(|s| (1.0 - s.opacity) * clear(s)).sum();
            (squares / total / mean_clear.powi(2) - 1.0).max(0.0)
        } else {
            0.0
        };
        let product = 1.0 - twice_beyond.min(times / even - 1.0).max(0.0) * variance;
        let opacity = 1.0 - mean_clear.powf(sheets) * product.max(0.0);
        // Fronts lie beside fronts, backs beside backs, as long as there is room; fronts and backs in the same place.
        let covered_before = covered_together;
        let seen_before = 1.0 - covered_before + veiled;
        sides = [0, 1].map(|side| (sides[side] + own[side]).min(1.0));
        let covered_now = together(sides).max(covered_before);
        covered_together = covered_now;
        let newly = covered_now - covered_before;
        let again = if covered_before > 0.0 { (coverage - newly).max(0.0) / covered_before } else { 0.0 };
        veiled = veiled * (1.0 - opacity * again) + newly * (1.0 - opacity);
        let seen = 1.0 - covered_now + veiled;
        let alpha = if seen_before > 0.0 { 1.0 - seen / seen_before } else { 1.0 };
        Some(Layer {
            z: nearest,
            id: first.id,
            alpha,
            color: if all_shown > 0.0 { color / all_shown } else { first.color },
            normal: if shows_back { -side(true) } else { side(false) } / covered_by(shows_back),
            material: first.material,
        })
    })
}

/// What a layer's samples lose of their colours where it is two sheets: what the near one hides of the far one, which lie beside each other as long as there
/// is room.
///
/// The sheets are what has its plane before the planes' mean depth and what has it behind, as far as the layer covers more than one sheet does, and the means
/// of both are what the planes' depths vary by.
fn hidden(first: &Sample<'_>, taken: &[Sample<'_>]) -> impl Fn(&Sample<'_>) -> f64 + use<> {
    let mean = |some: &[Sample<'_>], of: &dyn Fn(&Sample<'_>) -> f64| {
        let weight: f64 = some.iter().map(Sample::coverage).sum();
        (weight, some.iter().map(|s| s.coverage() * of(s)).sum::<f64>() / weight)
    };
    let (total, seen) = mean(taken, &|s| s.z - first.z);
    let (_, gap) = mean(taken, &|s| s.plane_z);
    let is_far = move |s: &Sample<'_>| s.plane_z > gap;
    let (far, near): (Vec<_>, Vec<_>) = taken.iter().partition(|s| is_far(s));
    let sides = [false, true].map(|back| taken.iter().filter(|s| s.back == back).map(|s| s.coverage()).sum());
    let coverage = if first.has_sides { f64::max(sides[0], sides[1]) } else { total }.min(1.0);
    let ((near, near_z), (far, far_z)) = (mean(&near, &|s| s.plane_z), mean(&far, &|s| s.plane_z));
    let (_, near_opacity) = mean(taken, &|s| if is_far(s) { 0.0 } else { s.opacity });
    let near_opacity = near_opacity * total / near;
    let (_, variance) = mean(taken, &|s| (s.plane_z - gap).powi(2));
    let apart = far_z - near_z;
    let between = apart.powi(2) * near * far / total.powi(2);
    // Of no width it is a step.
    let from_to = |value: f64, [from, to]: [f64; 2]| {
        if value > from { ((value - from) / (to - from)).min(1.0) } else { 0.0 }
    };
    let least = LEAST_GAP * first.depth_tolerance;
    let clearly = from_to(total * first.cloud_floor / coverage, [1.0, 2.0 - first.cloud_floor])
        * from_to(between, APART.map(|share| share * variance))
        * from_to(apart, [least, 2.0 * least])
        * from_to(seen, [least / 2.0, least]);
    let beside = far.min(1.0).min(1.0 - near.min(1.0)) / far.min(1.0);
    let share = if near > 0.0 && far > 0.0 { clearly * near_opacity * (1.0 - beside) } else { 0.0 };
    move |s| if is_far(s) { share } else { 0.0 }
}

/// The share of a pixel that fronts and backs cover together: the greater one, within which the lesser lies unless it is so little beside it that it is
/// samples turned here and there.
fn together(sides: [f64; 2]) -> f64 {
    let [most, least] = [sides[0].max(sides[1]), sides[0].min(sides[1])];
    if most > 0.0 { (most + least * (1.0 - least / most).powi(8)).min(1.0) } else { 0.0 }
}
