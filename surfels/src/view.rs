//! How dense surfels must be for a view.

use glam::DVec3;
use oblate_engine::{Camera, Projection};

/// Nearest depth that counts for a camera inside the bounds, as a share of their diagonal: around it, it
/// cannot be known how near the surface is.
const INSIDE: f64 = 0.1;

/// The spacing of surfels at which neighbours are one pixel apart where the bounds come nearest to the
/// camera in its picture: the width of a pixel there, in world units.
///
/// `bounds` are the smallest and largest corner in the world, as [`crate::Mesh::bounds`] gives them. For a
/// perspective camera inside the bounds it is the width of a pixel a tenth of the diagonal away; bounds that the picture
/// doesn't show count as if they were all in it. How many surfels that makes is capped by
/// [`crate::SamplerSettings::max_surfels`].
pub fn view_spacing(camera: &Camera, bounds: [DVec3; 2]) -> f64 {
    shown_spacing(camera, bounds).unwrap_or_else(|| {
        let nearest = nearest_depth(camera, bounds, &[]).filter(|&z| z > 0.0);
        camera.pixel_width_at(nearest.unwrap_or(least_depth(camera, bounds)))
    })
}

/// As [`view_spacing`], but `None` where the picture doesn't show the bounds: of several places of one thing those count that
/// it shows.
pub fn shown_spacing(camera: &Camera, bounds: [DVec3; 2]) -> Option<f64> {
    let [low, high] = bounds;
    let eye = camera.pose().eye();
    let inside = eye.cmpge(low).all() && eye.cmple(high).all();
    if inside && camera.projection() == Projection::Perspective {
        return Some(camera.pixel_width_at(least_depth(camera, bounds)));
    }
    let nearest = nearest_depth(camera, bounds, &sides(camera))?;
    Some(camera.pixel_width_at(if nearest > 0.0 { nearest } else { least_depth(camera, bounds) }))
}

/// The nearest depth that counts for a camera inside the bounds.
fn least_depth(camera: &Camera, [low, high]: [DVec3; 2]) -> f64 {
    camera.near().max(INSIDE * (high - low).length())
}

/// The planes that bound the picture, in camera space: inward normals and offsets.
fn sides(camera: &Camera) -> [(DVec3, f64); 4] {
    let (focal, center) = (camera.intrinsics().focal, camera.intrinsics().center);
    let [width, height] = camera.size().map(f64::from);
    let side = |normal: DVec3, margin: f64| match camera.projection() {
        Projection::Perspective => (normal + DVec3::Z * margin, 0.0),
        Projection::Orthographic => (normal, margin),
    };
    [
        side(DVec3::X * focal.x, center.x),
        side(DVec3::NEG_X * focal.x, width - center.x),
        side(DVec3::Y * focal.y, center.y),
        side(DVec3::NEG_Y * focal.y, height - center.y),
    ]
}

/// The smallest z of what is left of a box's faces behind the near plane and within some planes; `None` if nothing is.
fn nearest_depth(camera: &Camera, bounds: [DVec3; 2], sides: &[(DVec3, f64)]) -> Option<f64> {
    let to_camera = camera.pose().world_to_camera;
    let face = |face: usize| {
        let (axis, side) = (face % 3, face / 3);
        let corner = |(i, j): (usize, usize)| {
            let mut picked = [0; 3];
            picked[axis] = side;
            picked[(axis + 1) % 3] = i;
            picked[(axis + 2) % 3] = j;
            to_camera.transform_point3(DVec3::from_array(std::array::from_fn(|k| bounds[picked[k]][k])))
        };
        [(0, 0), (1, 0), (1, 1), (0, 1)].map(corner).to_vec()
    };
    let near = |p: DVec3| p.z - camera.near();
    (0..6)
        .flat_map(|index| {
            let polygon = clip(face(index), near);
            sides.iter().fold(polygon, |polygon, (normal, offset)| clip(polygon, |p| p.dot(*normal) + offset))
        })
        .map(|p| p.z)
        .min_by(f64::total_cmp)
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
