//! Every format, from files that the tests write, that others wrote, and that are broken.

#![expect(clippy::unwrap_used, reason = "helpers of tests may panic as tests do")]

mod common;
mod depth;
mod dicom;
mod gltf;
mod gltf_packed;
mod gltf_splats;
mod ksplat;
mod las;
mod meta_image;
mod mutation;
mod nifti;
mod nrrd;
mod obj;
mod packed;
mod pcd;
mod plot3d;
mod ply;
mod raw;
mod real_data;
mod seeds;
mod slices;
mod sog;
mod splat;
mod splat_notes;
mod splats;
mod spz;
mod stl;
mod surfels;
mod tiff;
mod vti;
mod vtk;
mod xyz;
