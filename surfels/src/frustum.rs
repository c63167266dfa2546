//! What a picture shows of polygons.

use glam::{DAffine3, DVec3};
use oblate_engine::{Camera, Projection};

/// What a picture shows of the world: all within planes.
pub(crate) struct Frustum {
    /// Inward normals and offsets, in the world; the near plane comes first.
    planes: [(DVec3, f64); 5],
    /// The view axis; where z is 0.
    forward: (DVec3, f64),
}

impl Frustum {
    /// A camera's, with a margin of `pixels` and of a `length` besides on every side.
    pub(crate) fn new(camera: &Camera, pixels: f64, length: f64) -> Self {
        let (focal, center) = (camera.intrinsics().focal, camera.intrinsics().center);
        let [width, height] = camera.size().map(f64::from);
        let DAffine3 { matrix3, translation } = camera.pose().world_to_camera;
        // n · (M p + t) + d
        let in_world =
            |(normal, offset): (DVec3, f64)| (matrix3.transpose() * normal, normal.dot(translation) + offset);
        let side = |normal: DVec3, border: f64| match camera.projection() {
            Projection::Perspective => {
                let normal = normal + DVec3::Z * (border + pixels);
                (normal, length * normal.length())
            }
            Projection::Orthographic => (normal, border + pixels + length * normal.length()),
        };
        let planes = [
            (DVec3::Z, length - camera.near()),
            side(DVec3::X * focal.x, center.x),
            side(DVec3::NEG_X * focal.x, width - center.x),
            side(DVec3::Y * focal.y, center.y),
            side(DVec3::NEG_Y * focal.y, height - center.y),
        ];
        Self { planes: planes.map(in_world), forward: in_world((DVec3::Z, 0.0)) }
    }

    /// Whether all points lie outside one of the planes.
    pub(crate) fn misses(&self, points: &[DVec3]) -> bool {
        self.planes.iter().any(|&plane| points.iter().all(|p| height(plane, *p) < 0.0))
    }

    /// Whether all of a box lies outside one of the planes: its middle and half its lengths along the axes.
    pub(crate) fn misses_box(&self, middle: DVec3, half: DVec3) -> bool {
        self.planes.iter().any(|&plane| height(plane, middle) + plane.0.abs().dot(half) < 0.0)
    }

    /// What it holds of a convex polygon.
    pub(crate) fn part(&self, polygon: Vec<DVec3>) -> Vec<DVec3> {
        part(polygon, &self.planes)
    }

    /// The smallest z of a polygon's corners.
    pub(crate) fn nearest(&self, polygon: &[DVec3]) -> Option<f64> {
        polygon.iter().map(|p| height(self.forward, *p)).min_by(f64::total_cmp)
    }

    /// What lies of a convex polygon behind the near plane.
    pub(crate) fn part_ahead(&self, polygon: Vec<DVec3>) -> Vec<DVec3> {
        part(polygon, &self.planes[..1])
    }
}

fn height((normal, offset): (DVec3, f64), point: DVec3) -> f64 {
    normal.dot(point) + offset
}

fn part(polygon: Vec<DVec3>, planes: &[(DVec3, f64)]) -> Vec<DVec3> {
    planes.iter().fold(polygon, |polygon, plane| {
        let cuts = polygon.iter().any(|p| height(*plane, *p) < 0.0);
        if cuts { clip(polygon, |p| height(*plane, p)) } else { polygon }
    })
}

/// The part of a polygon where `inside` is at least 0 (Sutherland, Hodgman, *Reentrant Polygon Clipping*,
/// 1974).
pub(crate) fn clip(polygon: Vec<DVec3>, inside: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    let mut from = polygon.last().copied().unwrap_or_default();
    for to in polygon {
        let (a, b) = (inside(from), inside(to));
        if (a < 0.0) != (b < 0.0) {
            kept.push(from.lerp(to, a / (a - b)));
        }
        if b >= 0.0 {
            kept.push(to);
        }
        from = to;
    }
    kept
}
