//! Files to clouds of points, and what formats of points share.
//!
//! All keep the axes of their file (scanners' z is up) and its unit. Coordinates are read in double precision and kept as
//! single-precision positions about an origin with whole coordinates near the first point; the origin is zero where that
//! point is nearer than a unit to it along each axis. Points with a coordinate, colour or intensity that is not finite in single precision
//! are left out and counted; normals and radii that are not finite are unknown. Colours of integers are sRGB-encoded.

mod gather;
pub mod las;
mod laz;
mod lzf;
pub mod pcd;
pub mod xyz;

pub(crate) use gather::{Gather, Has, Point};
