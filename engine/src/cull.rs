//! Stage `cull`: which ranges of a scene's splats can be seen.

use crate::camera::{Camera, Projection};
use crate::columns::{Columns, Factors, Kind};
use crate::footprint::{CameraSplat, Lens};
use crate::scene::{RenderSettings, Scene};
use glam::{DVec3, DVec4, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Consecutive splats of one cloud that may be visible.
#[derive(Clone, Debug)]
pub(crate) struct VisibleRange {
    /// The cloud's number in the scene.
    pub(crate) cloud: usize,
    /// Splats of that cloud.
    pub(crate) splats: Range<usize>,
    /// The scene-wide number of the cloud's first splat.
    pub(crate) first_id: u32,
    /// The middle of their box, in cloud space.
    pub(crate) center: Vec3,
    /// Their distances from the eye, or z where rays are parallel: at least and at most.
    pub(crate) distances: [f32; 2],
    /// Whether the cloud is a surface.
    pub(crate) is_surface: bool,
}

/// The planes of a view; a camera-space point p is inside where xyz·p + w ≥ 0.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frustum {
    sides: [DVec4; 4],
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

    /// Whether the ellipsoid r ≤ `cutoff` of a filtered splat reaches into all half-spaces.
    pub(crate) fn touches_ellipsoid(&self, splat: &CameraSplat, cutoff: f64, lens: &Lens) -> bool {
        let filter = lens.low_pass * splat.center.z.abs() / lens.focal.min_element();
        self.sides.iter().all(|plane| {
            let normal = plane.truncate();
            let spread = splat.factor.transpose() * normal;
            let reach = (cutoff * (spread.length_squared() + filter * filter)).sqrt();
            plane.dot(splat.center.extend(1.0)) + reach >= 0.0
        })
    }
}

/// Finds the clusters whose bounding sphere, grown by the reach of its kernels, touches the frustum.
pub(crate) fn find_visible(
    scene: &Scene,
    camera: &Camera,
    settings: &RenderSettings,
    visible: &mut Vec<VisibleRange>,
) {
    visible.clear();
    let frustum = Frustum::new(camera);
    let perspective = camera.projection() == Projection::Perspective;
    let mut first_id = 0;
    for (index, cloud) in scene.clouds.iter().enumerate() {
        let cloud_to_camera = camera.pose().world_to_camera * cloud.cloud_to_world();
        let is_surface = matches!(cloud.columns().kind, Kind::Surface(_));
        // The Frobenius norm bounds how far the transform stretches anything.
        let stretch = frobenius(cloud_to_camera.matrix3);
        for cluster in cloud.clusters() {
            let center = cloud_to_camera.transform_point3(cluster.center.as_dvec3());
            let radius = stretch * f64::from(cluster.radius);
            let farthest = if perspective { center.z.abs() + radius } else { 1.0 };
            let filter = settings.low_pass.sqrt() * farthest / camera.intrinsics().focal.min_element();
            let sigma = (stretch * f64::from(cluster.largest_sigma)).hypot(filter);
            if !frustum.touches_sphere(center, radius + settings.cutoff.sqrt() * sigma) {
                continue;
            }
            let distance = if perspective { center.length() } else { center.z };
            let least = if perspective { (distance - radius).max(0.0) } else { distance - radius };
            visible.push(VisibleRange {
                cloud: index,
                splats: cluster.splats.clone(),
                first_id,
                center: cluster.center,
                distances: [least as f32, (distance + radius) as f32],
                is_surface,
            });
        }
        first_id += cloud.len() as u32;
    }
}

fn frobenius(m: glam::DMat3) -> f64 {
    (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt()
}

/// Consecutive splats with a bounding sphere, in cloud space.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cluster {
    pub(crate) splats: Range<usize>,
    center: Vec3,
    radius: f32,
    largest_sigma: f32,
}

/// Splats a cluster.
pub(crate) const CLUSTER_SIZE: usize = 1024;

/// Cuts a cloud into clusters of consecutive splats.
pub(crate) fn clusters(columns: &Columns) -> Vec<Cluster> {
    let sigma = |index: usize| frobenius(columns.factor(index).as_dmat3()) as f32;
    let cluster = |number: usize| {
        let start = number * CLUSTER_SIZE;
        let splats = start..columns.len.min(start + CLUSTER_SIZE);
        let centers = || splats.clone().map(|i| columns.center(i));
        let first = columns.center(start);
        let (low, high) = centers().fold((first, first), |(low, high), p| (low.min(p), high.max(p)));
        let center = low * 0.5 + high * 0.5;
        let radius = centers().map(|p| p.distance_squared(center)).fold(0.0, f32::max).sqrt();
        let largest_sigma = match &columns.factors {
            Factors::Shared(_) => sigma(start),
            Factors::Each(_) => splats.clone().map(sigma).fold(0.0, f32::max),
        };
        Cluster { splats, center, radius, largest_sigma }
    };
    (0..columns.len.div_ceil(CLUSTER_SIZE)).into_par_iter().map(cluster).collect()
}
