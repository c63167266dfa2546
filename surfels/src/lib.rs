//! Meshes to surfels.

pub mod mesh;
pub mod primitives;

mod appearance;
mod error;
mod facets;
mod grid;
mod measure;
mod points;
mod relax;
mod sample;
mod texture;

pub use error::SampleError;
pub use mesh::{BaseColor, Mesh, Primitive, Texture, Wrap};
pub use sample::{COVERAGE_FLOOR, Density, KERNEL_SIGMA, SamplerSettings, sample};
