//! What all mesh formats share: fans, checks, and a place for what is wrong.

use crate::file::File;
use crate::{ImportError, Place};
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
