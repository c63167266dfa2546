//! Every format, from files that the tests write, that others wrote, and that are broken.

#![expect(clippy::unwrap_used, reason = "helpers of tests may panic as tests do")]

mod common;
mod gltf;
mod las;
mod mutation;
mod nrrd;
mod obj;
mod pcd;
mod ply;
mod raw;
mod real_data;
mod seeds;
mod splats;
mod vti;
mod xyz;
