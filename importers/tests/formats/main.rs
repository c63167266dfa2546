//! Every format, from files that the tests write, that others wrote, and that are broken.

mod common;
mod gltf;
mod mutation;
mod nrrd;
mod obj;
mod ply;
mod raw;
mod real_data;
mod vti;
