//! Meshes, point clouds and depth images to surfels: samples of a surface, each with the area that it stands for.
//!
//! [`sample`] turns the surface into many small pieces of known area ("points"), chooses some of them as
//! samples that keep their distance, and gives every point to its nearest sample: what a sample owns is its
//! area, its normal and its colour. Nothing of the surface is lost or counted twice, so the areas sum to the
//! mesh's. One Gaussian of one width for all surfels then smooths these areas to an even cover, whatever
//! the triangles are like: huge, tiny, slivers, or all of them.
//!
//! [`point_surfels`] makes each point of a scan a surfel, whose plane and area its neighbours tell, [`depth_surfels`] each pixel of an
//! [`RgbdImage`]. [`merge_flat`] merges surfels where a surface is flat.
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
mod depth_image;
mod error;
mod facets;
mod flat;
mod grid;
mod measure;
mod point_cloud;
mod points;
mod relax;
mod sample;
mod texture;
mod view;

pub use depth_image::{
    DEPTH_LOW_PASS, DepthError, DepthKind, DepthSettings, Hit, RgbdImage, Room, depth_surfels,
    fill_disocclusions, merged_depth_surfels,
};
pub use error::SampleError;
pub use flat::{Deviation, MergeError, Merged, merge_flat};
pub use mesh::{BaseColor, Mesh, Primitive, Texture, Wrap};
pub use point_cloud::{
    POINT_COVERAGE_FLOOR, PointCloud, PointColor, PointError, PointSettings, point_surfels,
};
pub use sample::{COVERAGE_FLOOR, Density, KERNEL_SIGMA, SamplerSettings, sample};
pub use view::{shown_spacing, view_spacing};
