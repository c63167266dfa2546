//! The triangles that a picture shows.

use crate::cells::BLOCK_SIDE;
use crate::frustum::Frustum;
use crate::grading::Grading;
use crate::measure::{placed, tasks};
use crate::mesh::Mesh;
use glam::DVec3;
use oblate_engine::{Camera, Projection};
use rayon::prelude::*;

/// How far beside the picture triangles are looked at: in pixels, which leaves room for filters, and in spacings, which widen as pixels
/// do. A surfel of a σ of 0.7 spacings reaches 3.5 σ, and what is left out of its cell lies within the cell's diagonal.
const MARGIN_PIXELS: f64 = 16.0;
const MARGIN: f64 = 5.0;

/// What a camera sees of a mesh in the world.
pub(crate) struct Sight {
    frustum: Frustum,
    /// From where backs are told, if they are dropped.
    viewpoint: Option<Viewpoint>,
    pub(crate) grading: Grading,
    /// What has the levels that places have in the mean, since a block has one as a whole.
    pub(crate) mean_grading: Grading,
}

enum Viewpoint {
    Eye(DVec3),
    /// Along parallel rays.
    Along(DVec3),
}

impl Sight {
    /// Surfels will be a spacing apart at a depth, and as many pixels behind it.
    pub(crate) fn new(camera: &Camera, (nearest, spacing): (f64, f64), drops_backs: bool) -> Self {
        let viewpoint = match camera.projection() {
            Projection::Perspective => Viewpoint::Eye(camera.pose().eye()),
            Projection::Orthographic => Viewpoint::Along(camera.pose().forward()),
        };
        let pixels = MARGIN_PIXELS + MARGIN * spacing / camera.pixel_width_at(nearest);
        let frustum = Frustum::new(camera, pixels, MARGIN * spacing);
        let grading = Grading::of_pixels(camera, nearest);
        // The side of a cell is 1 to 1.3 spacings.
        let mean_grading = grading.of_boxes(BLOCK_SIDE / 2.0 * 1.2 * spacing);
        Self { frustum, viewpoint: drops_backs.then_some(viewpoint), grading, mean_grading }
    }

    /// Whether a triangle may be seen, its corners counter-clockwise from outside.
    pub(crate) fn sees(&self, corners: [DVec3; 3]) -> bool {
        let [a, b, c] = corners;
        let faces_away = self.viewpoint.as_ref().is_some_and(|viewpoint| {
            let ray = match viewpoint {
                Viewpoint::Eye(eye) => a - eye,
                Viewpoint::Along(forward) => *forward,
            };
            (b - a).cross(c - a).dot(ray) >= 0.0
        });
        !(faces_away || self.frustum.misses(&corners))
    }

    /// What is in the picture of a triangle that may be seen: a convex polygon.
    pub(crate) fn part(&self, corners: [DVec3; 3]) -> Vec<DVec3> {
        if self.sees(corners) { self.frustum.part(corners.to_vec()) } else { Vec::new() }
    }

    /// Whether all of a box is beside the picture: its middle and half its lengths along the axes.
    pub(crate) fn misses_box(&self, middle: DVec3, half: DVec3) -> bool {
        self.frustum.misses_box(middle, half)
    }
}

/// The smallest depth at which a camera's picture shows a mesh; `None` where it doesn't.
pub(crate) fn nearest_depth(mesh: &Mesh, camera: &Camera) -> Option<f64> {
    let frustum = Frustum::new(camera, 0.0, 0.0);
    let of_triangle = |corners: [DVec3; 3]| frustum.nearest(&frustum.part(corners.to_vec()));
    let of_some = |(part, some)| placed(part, some).filter_map(of_triangle).min_by(f64::total_cmp);
    tasks(mesh).filter_map(of_some).min_by(f64::total_cmp)
}
