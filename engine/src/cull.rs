//! Stage `cull`: which ranges of a scene's splats can be seen, on which level of detail.
//!
//! A splat is drawn where the filter of the pixels is as wide as it needs and not as wide as its parent needs. The filter is
//! that at the nearest place of a cluster, or of the cluster above it if that is wider; needs and filters grow with the level,
//! so of a splat and all that stand for it exactly one is drawn. With a budget that place is no nearer than a share of the cluster's farthest.

use crate::camera::{Camera, Projection};
use crate::cloud::Cloud;
use crate::columns::{CHILDREN, LANES};
use crate::cone::Viewer;
use crate::footprint::{CameraSplat, Lens};
use crate::levels::{Cluster, Level, allowance};
use crate::simd::{self, *};
use crate::view::SceneView;
use glam::{DAffine3, DMat3, DVec2, DVec3, DVec4, Vec3};
use std::ops::Range;

/// Splats a cluster.
pub(crate) const CLUSTER_SIZE: usize = 1024;

/// Consecutive splats of one cloud that may be visible.
#[derive(Clone, Debug)]
pub(crate) struct VisibleRange {
    /// The cloud's number in the scene.
    pub(crate) cloud: usize,
    /// Its level of detail.
    pub(crate) level: usize,
    /// Splats of that level.
    pub(crate) splats: Range<usize>,
    /// Which of them are drawn; `None`: all.
    choice: Option<Choice>,
    /// The scene-wide number of the cloud's first splat.
    first_id: u32,
    /// The middle of their box, in cloud space.
    pub(crate) center: Vec3,
    /// The same in camera space, and how far the kernels reach from there.
    pub(crate) center_in_camera: DVec3,
    pub(crate) reach: f64,
    /// How far their centres are from there, and the largest σ, in camera space.
    pub(crate) radius: f64,
    pub(crate) sigma: f64,
    /// Their distances from the eye, or z where rays are parallel: at least and at most.
    pub(crate) distances: [f32; 2],
    /// Whether the cloud is a surface, and one of which no backs are seen.
    pub(crate) is_surface: bool,
    pub(crate) hides_backs: bool,
}

/// Which splats of a range are drawn: those whose needs the filter meets, but not those of their parents.
#[derive(Clone, Copy, Debug)]
struct Choice {
    filter: f32,
    /// `None` on the highest level.
    filter_above: Option<f32>,
}

impl VisibleRange {
    /// Splats of the first cloud's first level.
    #[cfg(test)]
    pub(crate) fn whole(splats: Range<usize>, center: Vec3, is_surface: bool) -> Self {
        Self {
            cloud: 0,
            level: 0,
            splats,
            choice: None,
            first_id: 0,
            center,
            center_in_camera: DVec3::ZERO,
            reach: f64::INFINITY,
            // So that what is left of the reach is a number.
            radius: f64::MAX,
            sigma: f64::INFINITY,
            distances: [0.0, f32::INFINITY],
            is_surface,
            hides_backs: false,
        }
    }

    /// Where rays are parallel, tells depths from a plane.
    pub(crate) fn tell_from_plane(&mut self, z: f64) {
        self.center_in_camera.z -= z;
        self.distances = [-1.0, 1.0].map(|to| (to * self.radius + self.center_in_camera.z) as f32);
    }

    /// Which of eight splats from `first` on, which begins a block, are drawn, of a cloud with these levels.
    #[inline(always)]
    pub(crate) fn chosen<S: Simd>(&self, simd: S, levels: &[Level], first: usize) -> u32 {
        let count = (self.splats.end - first).min(LANES);
        let valid = (1_u32 << count) - 1;
        match &self.choice {
            Some(choice) => valid & choice.of(simd, &levels[self.level..], first),
            None => valid,
        }
    }

    /// Whether all are drawn.
    pub(crate) fn is_chosen_whole(&self) -> bool {
        self.choice.is_none()
    }

    /// The scene-wide number of a splat; of one that stands for others the first one's.
    #[inline(always)]
    pub(crate) fn id(&self, index: usize) -> u32 {
        self.first_id + (index * CHILDREN.pow(self.level as u32)) as u32
    }

    /// That of a splat, and how much greater each of the next ones is.
    pub(crate) fn ids(&self, first: usize) -> [u32; 2] {
        [self.id(first), CHILDREN.pow(self.level as u32) as u32]
    }

    /// How many splats are drawn.
    pub(crate) fn count(&self, levels: &[Level]) -> usize {
        let splats = self.splats.clone();
        if self.choice.is_none() {
            return splats.len();
        }
        dispatch!(simd::Level::best(), simd => {
            splats
                .step_by(LANES)
                .map(
                    #[inline(always)]
                    |first| self.chosen(simd, levels, first).count_ones() as usize,
                )
                .sum()
        })
    }
}

impl Choice {
    /// Of a level and those above it.
    #[inline(always)]
    fn of<S: Simd>(&self, simd: S, levels: &[Level], first: usize) -> u32 {
        let own = V::simd_from(simd, *levels[0].needs(first / LANES));
        let own = own.simd_le(splat(simd, self.filter)).to_bitmask() as u32;
        let Some(filter_above) = self.filter_above else { return own };
        // A block has the children of two splats, which lie in one block.
        let parent = first / CHILDREN;
        let needs = levels[1].needs(parent / LANES);
        let is_open = [0, 1].map(|which| u32::from(needs[(parent + which) % LANES] > filter_above));
        own & ((is_open[0] * 0x0f) | (is_open[1] * 0xf0))
    }
}

/// The planes of a view; a camera-space point p is inside where xyz·p + w ≥ 0.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frustum {
    pub(crate) sides: [DVec4; 4],
    near: f64,
}

impl Frustum {
    pub(crate) fn new(camera: &Camera) -> Self {
        let intrinsics = camera.intrinsics();
        let [width, height] = camera.size().map(f64::from);
        let low = -intrinsics.center / intrinsics.focal;
        let high = (glam::DVec2::new(width, height) - intrinsics.center) / intrinsics.focal;
        let perspective = camera.projection() == Projection::Perspective;
        // x ≥ low·z for a pinhole, x ≥ low for parallel rays.
        let side = |normal: DVec3, bound: f64| {
            let plane =
                if perspective { (normal - DVec3::Z * bound).extend(0.0) } else { normal.extend(-bound) };
            plane / plane.truncate().length()
        };
        let sides = [
            side(DVec3::X, low.x),
            side(-DVec3::X, -high.x),
            side(DVec3::Y, low.y),
            side(-DVec3::Y, -high.y),
        ];
        Self { sides, near: camera.near() }
    }

    fn touches_sphere(&self, center: DVec3, radius: f64) -> bool {
        center.z + radius > self.near
            && self.sides.iter().all(|plane| plane.dot(center.extend(1.0)) + radius >= 0.0)
    }

    /// Whether a sphere lies between all sides, be it before the near plane or behind.
    pub(crate) fn is_between_sides(&self, center: DVec3, radius: f64) -> bool {
        self.sides.iter().all(|plane| plane.dot(center.extend(1.0)) >= radius)
    }

    /// Whether the ellipsoid r ≤ `cutoff` of a filtered splat reaches into all half-spaces.
    pub(crate) fn touches_ellipsoid(&self, splat: &CameraSplat, cutoff: f64, lens: &Lens) -> bool {
        let filter = lens.filter_sigma * splat.center.z.abs() / lens.focal.min_element();
        self.sides.iter().all(|plane| {
            let normal = plane.truncate();
            let spread = splat.factor.transpose() * normal;
            let reach = (cutoff * (spread.length_squared() + filter * filter)).sqrt();
            plane.dot(splat.center.extend(1.0)) + reach >= 0.0
        })
    }
}

/// Finds the clusters whose bounding sphere, grown by the reach of its kernels, touches the frustum, and that show more than backs
/// that are not drawn, on the levels of detail that the pixels' filter allows; `widening` lets them take it for wider than it
/// is. Gives how many splats are outside.
fn find_visible(
    SceneView { scene, camera, settings }: SceneView,
    widening: f64,
    visible: &mut Vec<VisibleRange>,
) -> u64 {
    visible.clear();
    let frustum = Frustum::new(camera);
    let perspective = camera.projection() == Projection::Perspective;
    let pixel_filter = settings.low_pass.sqrt() / camera.intrinsics().focal.min_element();
    let (mut first_id, mut culled) = (0, 0);
    for (index, cloud) in scene.clouds.iter().enumerate() {
        let cloud_to_camera = camera.pose().world_to_camera * cloud.cloud_to_world();
        let stretch = largest_stretch(cloud_to_camera.matrix3);
        let end = settings.farthest_end();
        let placement =
            Placement { frustum: &frustum, perspective, pixel_filter, end, stretch, cloud_to_camera };
        let top = if settings.level_of_detail > 0.0 { cloud.levels().len() - 1 } else { 0 };
        let clusters = &cloud.levels()[top].clusters;
        // Of many clouds most lie beside a small picture: these should cost no more than a look.
        if clusters.iter().any(|cluster| placement.sphere(cluster).touches) {
            let search = Search {
                cloud,
                index,
                first_id,
                near: camera.near(),
                placement,
                allowance: allowance(cloud.levels(), settings.tolerance)
                    * settings.level_of_detail
                    * widening
                    / stretch,
                closest: AROUND_THE_EYE * (1.0 - widening.recip()),
                hides_backs_from: cloud
                    .is_closed_for(camera)
                    .then(|| Viewer::of(&cloud_to_camera, perspective)),
            };
            for cluster in 0..clusters.len() {
                culled += search.visit((top, top), cluster, 0.0, visible);
            }
        } else {
            culled += cloud.levels()[top].columns.len as u64;
        }
        first_id += cloud.len() as u32;
    }
    culled
}

/// Finds the clusters that may be visible; where there is a budget, with a filter so wide that no more splats are drawn than it
/// allows. Gives how many splats lie outside the picture.
pub(crate) fn find_affordable(view: SceneView, visible: &mut Vec<VisibleRange>) -> u64 {
    let SceneView { scene, settings, .. } = view;
    let culled = find_visible(view, 1.0, visible);
    let Some(budget) = settings.budget else { return culled };
    let has_levels =
        settings.level_of_detail > 0.0 && scene.clouds.iter().any(|cloud| cloud.levels().len() > 1);
    if !has_levels {
        return culled;
    }
    let count = |visible: &[VisibleRange]| -> usize {
        visible.iter().map(|range| range.count(scene.clouds[range.cloud].levels())).sum()
    };
    // Powers of two: the first that will do, or one so wide that nothing but the last levels is drawn; then what lies
    // between it and the one before.
    let (mut too_narrow, mut wide_enough) = (0.0, 0.0);
    while count(visible) > budget && wide_enough < WIDEST {
        (too_narrow, wide_enough) = (wide_enough, wide_enough + 1.0);
        find_visible(view, f64::exp2(wide_enough), visible);
    }
    if wide_enough == 0.0 {
        return culled;
    }
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (too_narrow + wide_enough);
        find_visible(view, f64::exp2(middle), visible);
        if count(visible) > budget { too_narrow = middle } else { wide_enough = middle }
    }
    find_visible(view, f64::exp2(wide_enough), visible)
}

/// With a filter that a budget widens, no cluster counts as nearer than up to this share of its farthest place: what is around the eye, where the filter is as
/// narrow as at the near plane, would hardly be merged.
const AROUND_THE_EYE: f64 = 1.0 / 128.0;

/// The widest filter that a budget may ask for, as a power of two, and how often it is halved to fit.
const WIDEST: f64 = 40.0;
const BISECTIONS: usize = 8;

/// How many pixels the rectangle around all ranges has, at most.
pub(crate) fn touched_pixels<'a>(camera: &Camera, ranges: impl Iterator<Item = &'a VisibleRange>) -> f64 {
    let [low, high] = touched_part(camera, ranges);
    (high - low).max(DVec2::ZERO).element_product()
}

/// The part of the picture that all ranges may touch, from its top left to its bottom right in pixels.
pub(crate) fn touched_part<'a>(
    camera: &Camera,
    ranges: impl Iterator<Item = &'a VisibleRange>,
) -> [DVec2; 2] {
    let size = DVec2::from(camera.size().map(f64::from));
    let intrinsics = camera.intrinsics();
    let perspective = camera.projection() == Projection::Perspective;
    let (mut low, mut high) = (size, DVec2::ZERO);
    for VisibleRange { center_in_camera: center, reach, .. } in ranges {
        if perspective && center.z <= 2.0 * reach {
            return [DVec2::ZERO, size];
        }
        // A sphere is seen between slopes that differ from its middle's by at most this.
        let scale = intrinsics.focal / if perspective { center.z - reach } else { 1.0 };
        let (middle, half) = (center.truncate() * scale, scale * reach);
        let nearer = if perspective { middle.abs() * (reach / center.z) } else { DVec2::ZERO };
        low = low.min(intrinsics.center + middle - half - nearer);
        high = high.max(intrinsics.center + middle + half + nearer);
    }
    [low.max(DVec2::ZERO), high.min(size)]
}

/// At most how many times longer a vector gets; exact where proportions are kept.
pub(crate) fn largest_stretch(m: DMat3) -> f64 {
    let product = m.transpose() * m;
    let sums = [product.x_axis, product.y_axis, product.z_axis].map(|axis| axis.abs().element_sum());
    sums.into_iter().fold(0.0, f64::max).sqrt().max(f64::MIN_POSITIVE)
}

/// Where a cloud is in a view.
struct Placement<'a> {
    frustum: &'a Frustum,
    perspective: bool,
    /// Standard deviation of the pixels' filter where z is 1.
    pixel_filter: f64,
    /// The squared Mahalanobis radius at which every splat has ended, kernel or surfel: bounds of what is hidden go by the same.
    end: f64,
    stretch: f64,
    cloud_to_camera: DAffine3,
}

/// Where a cluster is in camera space.
struct Sphere {
    center: DVec3,
    /// Around the centres of its splats.
    radius: f64,
    /// Of the place that is farthest from the camera plane; 1 where rays are parallel.
    farthest: f64,
    /// The largest σ of its splats.
    sigma: f64,
    /// Around all that its splats show.
    reach: f64,
    /// Whether that touches the picture.
    touches: bool,
}

impl Placement<'_> {
    fn sphere(&self, cluster: &Cluster) -> Sphere {
        let center = self.cloud_to_camera.transform_point3(cluster.center.as_dvec3());
        let radius = self.stretch * f64::from(cluster.radius);
        let farthest = if self.perspective { center.z.abs() + radius } else { 1.0 };
        let sigma = self.stretch * f64::from(cluster.largest_sigma);
        let filtered = DVec2::new(sigma, self.pixel_filter * farthest).length();
        let reach = radius + self.end.sqrt() * filtered;
        let touches = self.frustum.touches_sphere(center, reach);
        Sphere { center, radius, farthest, sigma, reach, touches }
    }
}

/// A walk through the clusters of a cloud.
struct Search<'a> {
    cloud: &'a Cloud,
    index: usize,
    first_id: u32,
    near: f64,
    placement: Placement<'a>,
    /// What makes a filter in the world one that needs are compared with.
    allowance: f64,
    /// The least distance that is compared with, as a share of a cluster's farthest.
    closest: f64,
    /// Of a surface whose backs are not drawn, from where it is seen.
    hides_backs_from: Option<Viewer>,
}

impl Search<'_> {
    /// Finds what is drawn of a cluster and of what lies below it; gives how many splats lie outside the picture.
    fn visit(
        &self,
        (level, top): (usize, usize),
        number: usize,
        filter_above: f32,
        visible: &mut Vec<VisibleRange>,
    ) -> u64 {
        let levels = self.cloud.levels();
        let cluster = &levels[level].clusters[number];
        let has_parents = level < top;
        if has_parents && cluster.parents_need[1] <= filter_above {
            return 0;
        }
        let Sphere { center, radius, farthest, sigma, reach, touches } = self.placement.sphere(cluster);
        if !touches {
            return cluster.splats.len() as u64;
        }
        let sphere = (cluster.center, cluster.radius);
        if self.hides_backs_from.is_some_and(|viewer| cluster.normals.faces_away(&viewer, sphere)) {
            return 0;
        }
        let nearest = (center.z - radius).max(self.near).max(self.closest * farthest);
        let Placement { perspective, pixel_filter, .. } = self.placement;
        let nearest = if perspective { nearest } else { 1.0 };
        let filter = ((pixel_filter * nearest * self.allowance) as f32).max(filter_above);
        let [least, most] = cluster.needs;
        let mut culled = 0;
        if level > 0 && most > filter {
            let children = number * CHILDREN..levels[level - 1].clusters.len().min((number + 1) * CHILDREN);
            culled = children.map(|child| self.visit((level - 1, top), child, filter, visible)).sum();
        }
        if least > filter {
            return culled;
        }
        let is_whole = most <= filter && (!has_parents || cluster.parents_need[0] > filter_above);
        let choice = Choice { filter, filter_above: has_parents.then_some(filter_above) };
        let distance = if perspective { center.length() } else { center.z };
        let least = if perspective { (distance - radius).max(0.0) } else { distance - radius };
        visible.push(VisibleRange {
            cloud: self.index,
            level,
            splats: cluster.splats.clone(),
            choice: (!is_whole).then_some(choice),
            first_id: self.first_id,
            center: cluster.center,
            center_in_camera: center,
            reach,
            radius,
            sigma,
            distances: [least as f32, (distance + radius) as f32],
            is_surface: self.cloud.is_surface(),
            hides_backs: self.hides_backs_from.is_some(),
        });
        culled
    }
}
