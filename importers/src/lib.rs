//! Files to meshes, volumes and splats.
//!
//! [`open`] tells formats by what a file holds, then by its name:
//!
//! | format | gives | module |
//! |---|---|---|
//! | glTF 2.0, GLB | mesh | [`gltf`](mod@gltf) |
//! | OBJ with MTL and textures | mesh | [`obj`] |
//! | PLY, ascii and binary | mesh, or trained splats | [`ply`] |
//! | NRRD, attached and detached | volume | [`nrrd`] |
//! | VTI (VTK ImageData) | volume | [`vti`] |
//! | raw samples, also under gzip | volume | [`raw`] |
//!
//! Nothing a file says is believed before the file's own size was asked: declared sizes are compared with
//! the bytes that are there before anything is allocated, decompression stops at the size that is
//! expected, indices and offsets are checked, and what is wrong is an [`ImportError`] that says where.
//!
//! Meshes and splats keep the axes of their file; glTF's are oblate's (+Y up, right-handed). Volumes keep the frame of
//! their file, whatever it calls its axes; samples are voxel centres.

mod error;
mod file;
mod format;
mod geometry;
pub mod gltf;
mod inflate;
mod mtl;
pub mod nrrd;
pub mod obj;
pub mod ply;
pub mod raw;
mod scalar;
mod texture;
mod voxels;
pub mod vti;
mod vti_array;

pub use error::{ImportError, Place};
pub use raw::{Endian, LayoutError, RawLayout, SampleType, parse_dims};

use file::File;
use format::Format;
use glam::DVec3;
use oblate_engine::Splats;
use oblate_surfels::Mesh;
use oblate_volumes::Volume;
use std::path::{Path, PathBuf};

/// What a caller knows that a file may not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// How raw samples lie in the file; also makes a file without a known beginning a raw one.
    pub raw: Option<RawLayout>,
    /// Distance between samples along a volume's axes, in place of the file's; meshes don't heed it.
    pub spacing: Option<DVec3>,
    /// A PNG or JPEG for the parts of an OBJ or PLY mesh that have texture coordinates and no texture.
    pub texture: Option<PathBuf>,
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Opened {
    /// Triangles.
    Mesh(Mesh),
    /// Voxels.
    Volume(Volume),
    /// Gaussians with peak opacities, as training makes them.
    Splats(Splats),
}

/// Reads the file at `path`, whatever of the formats above it is.
///
/// # Errors
/// When the file, or one that it names, cannot be read, is malformed or of an unsupported kind; for raw
/// samples when neither `options` nor the file's name tell their layout.
pub fn open(path: impl AsRef<Path>, options: &OpenOptions) -> Result<Opened, ImportError> {
    let file = File::read(path.as_ref())?;
    match Format::of(&file, options.raw.is_some()) {
        Format::Gltf => gltf::read(&file).map(Opened::Mesh),
        Format::Obj => obj::read(&file, options).map(Opened::Mesh),
        Format::Ply => ply::read(file, options),
        Format::Nrrd => nrrd::read(&file, options).map(Opened::Volume),
        Format::Vti => vti::read(&file, options).map(Opened::Volume),
        Format::Raw => raw::read(&file, options).map(Opened::Volume),
    }
}
