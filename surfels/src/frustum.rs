//! What a picture shows of polygons.

use glam::{DAffine3, DVec3};
use oblate_engine::{Camera, Projection};

/// The planes around what a picture shows.
pub(crate) struct Frustum {
    world_to_camera: DAffine3,
    /// Inward normals and offsets, in camera space; the near plane comes first.
    planes: [(DVec3, f64); 5],
}

impl Frustum {
    /// A camera's, with a margin of `pixels` and of a `length` besides on every side.
    pub(crate) fn new(camera: &Camera, pixels: f64, length: f64) -> Self {
        let (focal, center) = (camera.intrinsics().focal, camera.intrinsics().center);
        let [width, height] = camera.size().map(f64::from);
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
        Self { world_to_camera: camera.pose().world_to_camera, planes }
    }

    pub(crate) fn to_camera<const N: usize>(&self, points: [DVec3; N]) -> [DVec3; N] {
        points.map(|p| self.world_to_camera.transform_point3(p))
    }

    /// Whether all points, in camera space, lie on the outer side of one plane.
    pub(crate) fn misses(&self, points: &[DVec3]) -> bool {
        let outside = |(normal, offset): &(DVec3, f64)| points.iter().all(|p| p.dot(*normal) + offset < 0.0);
        self.planes.iter().any(outside)
    }

    /// The smallest z of what the frustum holds of a convex polygon in camera space; `None` if it holds nothing.
    pub(crate) fn nearest(&self, polygon: &[DVec3]) -> Option<f64> {
        nearest(polygon, &self.planes)
    }

    /// As [`Self::nearest`], but of all that lies behind the near plane.
    pub(crate) fn nearest_around(&self, polygon: &[DVec3]) -> Option<f64> {
        nearest(polygon, &self.planes[..1])
    }
}

fn nearest(polygon: &[DVec3], planes: &[(DVec3, f64)]) -> Option<f64> {
    let cuts = |(normal, offset): &&(DVec3, f64)| polygon.iter().any(|p| p.dot(*normal) + offset < 0.0);
    let mut cutting = planes.iter().filter(cuts).peekable();
    let least = |polygon: &[DVec3]| polygon.iter().map(|p| p.z).min_by(f64::total_cmp);
    if cutting.peek().is_none() {
        return least(polygon);
    }
    least(
        &cutting
            .fold(polygon.to_vec(), |polygon, (normal, offset)| clip(polygon, |p| p.dot(*normal) + offset)),
    )
}

/// The part of a polygon where `inside` is at least 0 (Sutherland, Hodgman, *Reentrant Polygon Clipping*,
/// 1974).
fn clip(polygon: Vec<DVec3>, inside: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
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
