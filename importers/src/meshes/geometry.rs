//! What all mesh formats share: fans, checks, and a place for what is wrong.

use crate::file::File;
use crate::{ImportError, Place};
use glam::{DAffine3, DVec3, Vec3};
use oblate_engine::color::srgb_to_linear;
use oblate_surfels::{Mesh, Primitive};

/// The corners of a polygon's triangles, around its first corner.
pub(crate) fn fan<T: Copy>(corners: &[T]) -> impl Iterator<Item = [T; 3]> {
    let pairs = corners.get(1..).unwrap_or(&[]).windows(2);
    pairs.map(|pair| [corners[0], pair[0], pair[1]])
}

/// The first of `vectors` that has a component which is not finite.
pub(crate) fn first_not_finite<const N: usize>(vectors: &[[f32; N]]) -> Option<usize> {
    vectors.iter().position(|vector| !vector.iter().all(|c| c.is_finite()))
}

/// How many times as far as they are wide all positions may lie from 0 and stay as they are: in single precision they are then moved by at
/// most a 260,000th of that width.
const FARTHEST: f64 = 64.0;

/// Positions in single precision, and what moves them to where they are: nothing, or as far as their middle where they are far away, as
/// coordinates of maps are; by those of them that are used.
pub(crate) fn near_zero<'a>(
    positions: &[DVec3],
    used: impl Iterator<Item = &'a DVec3>,
) -> (Vec<Vec3>, DAffine3) {
    let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    let [low, high] = used.fold(none, |[low, high], p| [low.min(*p), high.max(*p)]);
    let farthest = low.abs().max(high.abs()).max_element();
    let is_far = farthest > FARTHEST * (high - low).max_element();
    let origin = if is_far && farthest.is_finite() { 0.5 * low + 0.5 * high } else { DVec3::ZERO };
    let near = positions.iter().map(|position| (position - origin).as_vec3()).collect();
    (near, DAffine3::from_translation(origin))
}

/// Linear colour of a display-encoded one; alpha is linear already.
pub(crate) fn decoded([r, g, b, a]: [f32; 4]) -> [f32; 4] {
    [srgb_to_linear(r), srgb_to_linear(g), srgb_to_linear(b), a]
}

/// A mesh of those primitives that have triangles, if any has.
pub(crate) fn mesh(file: &File, mut primitives: Vec<Primitive>) -> Result<Mesh, ImportError> {
    primitives.retain(|primitive| !primitive.triangles.is_empty());
    if primitives.is_empty() {
        return Err(file.malformed(Place::Whole, "there are no triangles in it; a mesh needs at least one"));
    }
    Ok(Mesh { primitives })
}
