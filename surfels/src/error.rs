//! Why a mesh cannot be sampled.

use oblate_engine::CloudError;
use thiserror::Error;

/// Why a mesh cannot be sampled.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SampleError {
    /// No primitive has a triangle.
    #[error("the mesh has no triangles")]
    Empty,
    /// Every triangle is a line or a point.
    #[error("the mesh has no area: all its triangles are lines or points")]
    NoArea,
    /// A triangle names a vertex that does not exist.
    #[error("primitive {primitive}, triangle {triangle}: vertex {index}; there are only {positions}")]
    Index {
        /// The primitive.
        primitive: usize,
        /// The triangle in it.
        triangle: usize,
        /// The vertex it names.
        index: u32,
        /// How many vertices there are.
        positions: usize,
    },
    /// An array does not have one entry for each vertex.
    #[error("primitive {primitive}: {found} {array} for {positions} positions; there must be one for each")]
    Length {
        /// The primitive.
        primitive: usize,
        /// The name of the array.
        array: &'static str,
        /// Its length.
        found: usize,
        /// How many vertices there are.
        positions: usize,
    },
    /// A number is infinite or not a number.
    #[error("primitive {primitive}: {what} {index} is not finite")]
    NotFinite {
        /// The primitive.
        primitive: usize,
        /// Which of its arrays.
        what: &'static str,
        /// The entry.
        index: usize,
    },
    /// A texture's texels do not fill its rows.
    #[error("primitive {primitive}: a texture of {width} x {height} with {found} texels")]
    Texture {
        /// The primitive.
        primitive: usize,
        /// Texels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// How many texels there are.
        found: usize,
    },
    /// A wanted density that says nothing.
    #[error("{what} is {value}; it must be finite and above 0")]
    Density {
        /// What was asked for.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// More triangles than can be held.
    #[error("{0} triangles; at most 2147483647 can be sampled")]
    Triangles(usize),
    /// Surfels whose areas single precision cannot hold.
    #[error(
        "surfels {0:e} apart have areas beyond single precision; scale the mesh to between 1e-15 and 1e15"
    )]
    Size(f64),
    /// The surfels are not a cloud.
    #[error("the surfels cannot be drawn: {0}")]
    Cloud(#[from] CloudError),
}
