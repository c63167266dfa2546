//! oblate draws meshes, volumes, iso-surfaces and trained Gaussians with one primitive, the Gaussian *splat*, through one
//! rasterizer and one compositor, on the CPU.
//!
//! An oblate spheroid is a sphere flattened along one axis: flatten it a little and it is a kernel of a
//! volume, flatten it all the way and it is a *surfel*, a sample of a surface. The way from a file to a
//! picture:
//!
//! 1. [`importers::open`] reads a file into a [`surfels::Mesh`], a [`volumes::Volume`], a [`surfels::PointCloud`] or
//!    [`engine::Splats`], which [`engine::Cloud::new`] takes as they are; [`importers::export::save`] writes splats and volumes.
//! 2. [`surfels::sample()`] spreads surfels over a mesh; [`surfels::point_surfels`] makes one of each point, [`surfels::depth_surfels`] of each pixel of a depth image
//!    ([`importers::depth`] reads them); [`volumes::iso_surfels`] over the surface at a value
//!    of a volume ([`volumes::IsoExtractor`] at one value after another); [`volumes::to_kernels`] turns its inside into kernels, under a
//!    [`volumes::TransferFunction`]. Each gives an [`engine::Cloud`].
//! 3. An [`engine::Scene`] holds clouds and lights, all mixed; an [`engine::Camera`] sees it.
//! 4. [`engine::render()`] draws an [`engine::Frame`]: colour, alpha, depth, normal and id of each pixel.
//!    [`engine::reference()`] draws the same slowly and right, and [`engine::compare`] says how far two
//!    pictures are apart.
//!
//! ```
//! use oblate::engine::{Camera, Pose, RenderSettings, Scene, render};
//! use oblate::surfels::{Density, Mesh, SamplerSettings, primitives, sample};
//! use oblate::volumes::{IsoSettings, iso_surfels, shepp_logan};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let knot = Mesh { primitives: vec![primitives::torus_knot(2, 3, 0.2, [60, 12])] };
//! let scene = Scene {
//!     clouds: vec![
//!         sample(&knot, Density::Count(2_000), &SamplerSettings::default())?,
//!         iso_surfels(&shepp_logan(16)?, 0.5, &IsoSettings::default())?,
//!     ],
//!     lights: Vec::new(), // a headlight
//! };
//! let pose = Pose::look_at([3.0, 2.0, 5.0].into(), [0.0; 3].into(), [0.0, 1.0, 0.0].into())?;
//! let camera = Camera::perspective(pose, 0.6, [32, 32])?;
//! let frame = render(&scene, &camera, &RenderSettings::default(), &())?;
//! assert!(frame.depth[16 * 32 + 16] < 6.2);
//! # Ok(())
//! # }
//! ```
//!
//! The program `oblate` is these steps with options and scene files; `examples/mixed_scene.rs` is a program
//! that a user might write.

pub use oblate_chart as chart;
pub use oblate_engine as engine;
pub use oblate_importers as importers;
pub use oblate_surfels as surfels;
pub use oblate_volumes as volumes;
