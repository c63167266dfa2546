//! Files to meshes, and what formats of meshes share.

pub(crate) mod geometry;
mod mtl;
pub mod obj;
pub mod stl;
pub(crate) mod texture;
