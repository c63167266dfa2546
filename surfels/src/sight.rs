//! The triangles that a picture shows.

use crate::frustum::Frustum;
use crate::measure::placed;
use crate::mesh::Mesh;
use glam::DVec3;
use oblate_engine::{Camera, Projection};
use rayon::prelude::*;

/// How far beside the picture triangles are looked at: in pixels, which leaves room for filters, and in spacings. A surfel of a σ of 0.7
/// spacings reaches 3.5 σ, and what is left out of its cell lies within the cell's diagonal.
pub(crate) const MARGIN_PIXELS: f64 = 16.0;
const MARGIN: f64 = 5.0;

/// What a camera sees of a mesh in the world.
pub(crate) struct Sight {
    frustum: Frustum,
    is_perspective: bool,
    drops_backs: bool,
}

impl Sight {
    /// Surfels will be `spacing` apart.
    pub(crate) fn new(camera: &Camera, spacing: f64, drops_backs: bool) -> Self {
        Self {
            frustum: Frustum::new(camera, MARGIN_PIXELS, MARGIN * spacing),
            is_perspective: camera.projection() == Projection::Perspective,
            drops_backs,
        }
    }

    /// Whether a triangle may be seen, its corners counter-clockwise seen from outside.
    pub(crate) fn sees(&self, corners: [DVec3; 3]) -> bool {
        let [a, b, c] = self.frustum.to_camera(corners);
        let ray = if self.is_perspective { a } else { DVec3::Z };
        let faces_away = || (b - a).cross(c - a).dot(ray) >= 0.0;
        !(self.frustum.misses(&[a, b, c]) || self.drops_backs && faces_away())
    }
}

/// The smallest depth at which a camera's picture shows a mesh; `None` where it doesn't.
pub(crate) fn nearest_depth(mesh: &Mesh, camera: &Camera) -> Option<f64> {
    let frustum = Frustum::new(camera, 0.0, 0.0);
    let of_triangle = |corners: [DVec3; 3]| frustum.nearest(&frustum.to_camera(corners));
    mesh.primitives
        .par_iter()
        .flat_map(|part| {
            part.triangles.par_iter().map(move |triangle| (part, std::slice::from_ref(triangle)))
        })
        .flat_map_iter(|(part, triangle)| placed(part, triangle).filter_map(of_triangle))
        .min_by(f64::total_cmp)
}
