//! The splat engine of oblate: one primitive, one EWA rasterizer, one compositor.
//!
//! A *splat* is a Gaussian with a centre, a covariance that may be singular, a strength and a colour.
//! Round splats are volume kernels, flat ones are surfels, and everything between is allowed: no
//! formula divides by the thickness. The stages, in the order in which a picture passes through them:
//!
//! [`cloud`], [`camera`], [`scene`] say what is drawn and from where; `cull`, `footprint`, `order`, `bin`, `layers`,
//! `composite` (both by `raster`) and `resolve` draw it into a [`Frame`]. A [`Renderer`] keeps its buffers from one
//! frame to the next.
//!
//! # Conventions
//! World space is right-handed; camera space is x right, y down, z forward with the camera at the
//! origin; the centre of pixel (i, j) is (i + 0.5, j + 0.5) with the origin top left. Colours are
//! linear Rec. 709, premultiplied in a frame. Depth is z along the view axis.

mod bin;
pub mod camera;
pub mod clip;
mod closed;
mod closing;
pub mod cloud;
pub mod color;
mod columns;
mod composite;
mod cone;
mod cull;
mod cuts;
pub mod footprint;
pub mod frame;
mod grow;
mod harmonics;
mod lattice;
mod layers;
mod levels;
pub mod metrics;
mod morton;
pub mod neighbors;
pub mod observer;
mod occlusion;
mod order;
mod pass;
pub mod pick;
mod raster;
pub mod reference;
pub mod render;
mod resolve;
pub mod scene;
mod settle;
mod shade;
pub mod simd;
pub mod surfels;
mod tile;
pub mod validate;
mod view;

pub use camera::{Camera, CameraError, Intrinsics, Pose, Projection};
pub use clip::HalfSpace;
pub use closed::Closed;
pub use cloud::{Cloud, CloudError, Harmonics, Material, OpacityFilter, Shapes, Splats, Strength, Surface};
pub use frame::{Channels, Frame};
pub use metrics::{Metrics, MetricsError, Pixels, compare};
pub use observer::{Counts, Observer, Stage};
pub use pick::{Picked, Picker};
pub use reference::{ReferenceKind, reference};
pub use render::{Renderer, render};
pub use scene::{Baseline, Blend, FootprintForm, Light, Order, RenderSettings, Scene};
pub use settle::settle;
pub use surfels::{SurfelLook, SurfelPlaces, SurfelRows};
pub use validate::SceneError;
