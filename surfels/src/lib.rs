//! Meshes, point clouds and depth images to surfels: samples of a surface, each with the area that it stands for.
//!
//! [`sample`] parts the surface at a cubic lattice; what of a sheet lies in one cell becomes a surfel with that area, middle,
//! covariance, normal and colour. Nothing of the surface is lost or counted twice, so the areas sum to the
//! mesh's. Blurred by one Gaussian they are an even cover, whatever the triangles are like: huge, tiny, slivers, or all of them.
//! [`sample_seen`] does so for what a camera sees, with cells as wide as pixels near and far.
//!
//! [`point_surfels`] makes each point of a scan a surfel, whose plane and area its neighbours tell, [`depth_surfels`] each pixel of an
//! [`RgbdImage`]; [`DepthSampler`] does so of one after the other. [`merge_flat`] merges surfels where a surface is flat.
//!
//! ```
//! use oblate_surfels::{Density, Mesh, SamplerSettings, primitives, sample};
//!
//! let mesh = Mesh { primitives: vec![primitives::torus_knot(2, 3, 0.2, [256, 32])] };
//! let cloud = sample(&mesh, Density::Count(10_000), &SamplerSettings::default())?;
//! assert!(cloud.len() > 9_000 && cloud.len() < 11_000);
//! # Ok::<(), oblate_surfels::SampleError>(())
//! ```

pub mod mesh;
pub mod primitives;

mod appearance;
mod cells;
mod depth_image;
mod divide;
mod error;
mod facets;
mod flat;
mod frustum;
mod grading;
mod measure;
mod point_cloud;
mod sample;
mod share;
mod sight;
mod texture;
mod view;

pub use depth_image::{
    DEPTH_LOW_PASS, DepthError, DepthKind, DepthSampler, DepthSettings, Hit, RgbdImage, Room, depth_surfels,
    fill_disocclusions, merged_depth_surfels,
};
pub use error::SampleError;
pub use flat::{Deviation, MergeError, Merged, merge_flat};
pub use mesh::{BaseColor, Filter, Mesh, Primitive, Texture, Wrap};
pub use point_cloud::{
    POINT_COVERAGE_FLOOR, PointCloud, PointColor, PointError, PointSettings, point_range, point_surfels,
    point_values,
};
pub use sample::{
    Density, MESH_COVERAGE_FLOOR, MESH_SURFEL_RADIUS, SamplerSettings, sample, sample_seen, seen_count,
};
pub use view::{shown_spacing, view_spacing};
