//! Triangle meshes as files give them.

use glam::{DAffine3, Vec2, Vec3, Vec4};
use std::sync::Arc;

/// A mesh of several primitives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Its parts, each with its own material and transform.
    pub primitives: Vec<Primitive>,
}

/// Triangles with one material.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive {
    /// Positions in the primitive's space.
    pub positions: Vec<Vec3>,
    /// Corners of each triangle, counter-clockwise seen from outside; each below `positions.len()`.
    pub triangles: Vec<[u32; 3]>,
    /// A normal for each position (any length), if the file has them.
    pub normals: Option<Vec<Vec3>>,
    /// A texture coordinate for each position; (0, 0) is the top left corner of the texture.
    pub tex_coords: Option<Vec<Vec2>>,
    /// Linear RGBA for each position, multiplied into the base colour.
    pub colors: Option<Vec<Vec4>>,
    /// What the surface looks like.
    pub material: BaseColor,
    /// Whether alpha is a mask: what has at least this much is there and opaque, the rest is not. `None`: alpha is
    /// the opacity. The product of factor, vertex colour and texel is compared: of texels before they are filtered, of vertex
    /// colours after they are interpolated. Where vertex alphas differ and texels are smaller than surfels, one of eight masks between the extremes counts.
    pub alpha_cutoff: Option<f32>,
    /// Whether its colours are shown as they are, whatever the lights; [`sample`](crate::sample()) heeds it where it is so of
    /// all of a mesh.
    pub unlit: bool,
    /// Whether its backs are to be seen. [`sample`](crate::sample()) asks for it where a mesh is not opaque; formats that
    /// say nothing of sides mean `true`.
    pub double_sided: bool,
    /// From the primitive's space to the mesh's.
    pub primitive_to_mesh: DAffine3,
}

/// Base colour of a primitive.
#[derive(Clone, Debug, PartialEq)]
pub struct BaseColor {
    /// Linear RGBA.
    pub factor: Vec4,
    /// Multiplied into the factor.
    pub texture: Option<Arc<Texture>>,
}

impl BaseColor {
    /// Light grey, for surfaces that a file says nothing of: white would leave no room for highlights.
    pub const UNSPECIFIED: Self = Self { factor: Vec4::new(0.6, 0.6, 0.6, 1.0), texture: None };
}

impl Default for BaseColor {
    fn default() -> Self {
        Self { factor: Vec4::ONE, texture: None }
    }
}

/// An image on a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Texels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// sRGB-encoded red, green, blue and linear alpha, rows from top to bottom; `width * height` of them.
    pub texels: Vec<[u8; 4]>,
    /// What lies outside [0, 1], for u and v.
    pub wrap: [Wrap; 2],
    /// What is between the middles of texels that are larger than surfels; smaller ones are averaged.
    pub filter: Filter,
}

/// How a texture is magnified.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// Colours are interpolated bilinearly.
    #[default]
    Linear,
    /// Texels are squares of one colour.
    Nearest,
}

/// What lies outside a texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The texture again.
    #[default]
    Repeat,
    /// The texture again, every other time mirrored.
    Mirror,
    /// Its border texels.
    Clamp,
}
