//! Meshes to surfels.

pub mod mesh;

pub use mesh::{BaseColor, Mesh, Primitive, Texture, Wrap};
