//! How dense surfels must be for a view.

use crate::frustum::Frustum;
use glam::DVec3;
use oblate_engine::{Camera, Projection};

/// Nearest depth that counts for a camera inside the bounds, as a share of their diagonal: around it, it
/// cannot be known how near the surface is.
const INSIDE: f64 = 0.1;

/// The widest spacing for a pinhole camera, as a share of the depth.
///
/// A surfel of a σ of 0.7 spacings that ends at 3.5 σ then reaches at most 0.31 of its depth towards the eye: well clear of the camera
/// plane, at which it would be seen all over the picture.
const WIDEST: f64 = 0.125;

/// The spacing of surfels at which neighbours are one pixel apart where the bounds come nearest to the
/// camera in its picture: the width of a pixel there, in world units. Pixels wider than an eighth of their depth count as that.
///
/// `bounds` are the smallest and largest corner in the world, as [`crate::Mesh::bounds`] gives them. For a
/// perspective camera inside the bounds it is the width of a pixel a tenth of the diagonal away; bounds that the picture
/// doesn't show count as if they were all in it. How many surfels that makes is capped by
/// [`crate::SamplerSettings::max_surfels`].
pub fn view_spacing(camera: &Camera, bounds: [DVec3; 2]) -> f64 {
    shown_spacing(camera, bounds).unwrap_or_else(|| {
        let frustum = Frustum::new(camera, 0.0, 0.0);
        let depths = faces(bounds).filter_map(|face| frustum.nearest(&frustum.part_ahead(face)));
        let nearest = depths.min_by(f64::total_cmp).filter(|&z| z > 0.0);
        spacing_at(camera, nearest.unwrap_or(least_depth(camera, bounds)))
    })
}

/// As [`view_spacing`], but `None` where the picture doesn't show the bounds: of several places of one thing those count that
/// it shows.
pub fn shown_spacing(camera: &Camera, bounds: [DVec3; 2]) -> Option<f64> {
    let [low, high] = bounds;
    let eye = camera.pose().eye();
    let inside = eye.cmpge(low).all() && eye.cmple(high).all();
    if inside && camera.projection() == Projection::Perspective {
        return Some(spacing_at(camera, least_depth(camera, bounds)));
    }
    let frustum = Frustum::new(camera, 0.0, 0.0);
    let depths = faces(bounds).filter_map(|face| frustum.nearest(&frustum.part(face)));
    let nearest = depths.min_by(f64::total_cmp)?;
    Some(spacing_at(camera, if nearest > 0.0 { nearest } else { least_depth(camera, bounds) }))
}

/// The width of a pixel at a depth, or of what stands for one that is too wide.
pub(crate) fn spacing_at(camera: &Camera, depth: f64) -> f64 {
    let pixel = camera.pixel_width_at(depth);
    match camera.projection() {
        Projection::Perspective => pixel.min(WIDEST * depth),
        Projection::Orthographic => pixel,
    }
}

/// The nearest depth that counts for a camera inside the bounds.
fn least_depth(camera: &Camera, [low, high]: [DVec3; 2]) -> f64 {
    camera.near().max(INSIDE * (high - low).length())
}

/// The faces of a box.
fn faces(bounds: [DVec3; 2]) -> impl Iterator<Item = Vec<DVec3>> {
    (0..6).map(move |face| {
        let (axis, side) = (face % 3, face / 3);
        let corner = |(i, j): (usize, usize)| {
            let mut picked = [0; 3];
            picked[axis] = side;
            picked[(axis + 1) % 3] = i;
            picked[(axis + 2) % 3] = j;
            DVec3::from_array(std::array::from_fn(|k| bounds[picked[k]][k]))
        };
        [(0, 0), (1, 0), (1, 1), (0, 1)].map(corner).to_vec()
    })
}
