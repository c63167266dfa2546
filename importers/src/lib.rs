//! Files to meshes, volumes and splats.
//!
//! [`open`] tells formats by what a file holds, then by its name:
//!
//! | format | gives | module |
//! |---|---|---|
//! | glTF 2.0, GLB | mesh | [`gltf`](mod@gltf) |
//! | OBJ with MTL and textures | mesh | [`meshes::obj`] |
//! | PLY, ascii and binary | mesh, trained splats or surfels | [`ply`] |
//! | NRRD, attached and detached | volume | [`volumes::nrrd`] |
//! | VTI (VTK ImageData) | volume | [`volumes::vti`] |
//! | TIFF stacks | volume | [`volumes::tiff`] |
//! | DICOM, a file of a series or its folder | volume | [`volumes::dicom`] |
//! | a folder of numbered slices | volume | [`volumes::slices`] |
//! | raw samples, also under gzip | volume | [`volumes::raw`] |
//!
//! Nothing a file says is believed before the file's own size was asked: declared sizes are compared with
//! the bytes that are there before anything is allocated, decompression stops at the size that is
//! expected, indices and offsets are checked, and what is wrong is an [`ImportError`] that says where.
//!
//! Meshes and splats keep the axes of their file; glTF's are oblate's (+Y up, right-handed). Volumes keep the frame of
//! their file, whatever it calls its axes; samples are voxel centres.

mod content;
mod error;
#[cfg_attr(not(test), expect(dead_code, reason = "writers are for the command to come"))]
mod export;
mod file;
mod format;
pub mod gltf;
mod inflate;
pub mod meshes;
pub mod ply;
mod scalar;
pub mod splats;
pub mod volumes;

pub use content::{Content, Note, Opened};
pub use error::{ImportError, Place};
pub use export::ExportError;
pub use volumes::raw::{Endian, LayoutError, RawLayout, SampleType, parse_dims};

use file::File;
use format::Format;
use glam::DVec3;
use meshes::obj;
use std::path::{Path, PathBuf};
use volumes::{dicom, nrrd, raw, slices, tiff, vti};

/// What a caller knows that a file may not say.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenOptions {
    /// How raw samples lie in the file; also makes a file without a known beginning a raw one.
    pub raw: Option<RawLayout>,
    /// Distance between samples along a volume's axes, in place of the file's; meshes don't heed it.
    pub spacing: Option<DVec3>,
    /// A PNG or JPEG for the parts of an OBJ or PLY mesh that have texture coordinates and no texture.
    pub texture: Option<PathBuf>,
    /// Bytes that a compressed file may unpack to, at most.
    pub max_memory: u64,
}

impl OpenOptions {
    /// What compressed files may unpack to where nothing is said: 16 GiB.
    pub const MAX_MEMORY: u64 = 16 << 30;
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self { raw: None, spacing: None, texture: None, max_memory: Self::MAX_MEMORY }
    }
}

/// Reads the file or folder at `path`, whatever of the formats above it is.
///
/// # Errors
/// When the file, or one that it names, cannot be read, is malformed or of an unsupported kind; for raw
/// samples when neither `options` nor the file's name tell their layout.
pub fn open(path: impl AsRef<Path>, options: &OpenOptions) -> Result<Opened, ImportError> {
    if path.as_ref().is_dir() {
        return slices::read(path.as_ref(), options);
    }
    let file = File::read(path.as_ref())?;
    match Format::of(&file, options.raw.is_some()) {
        Format::Gltf => gltf::read(&file).map(Opened::from),
        Format::Obj => obj::read(&file, options).map(Opened::from),
        Format::Ply => ply::read(file, options),
        Format::Nrrd => nrrd::read(&file, options).map(Opened::from),
        Format::Vti => vti::read(&file, options).map(Opened::from),
        Format::Tiff => tiff::read(&file, options),
        Format::Dicom => dicom::read(&file, options),
        Format::Raw => raw::read(&file, options).map(Opened::from),
    }
}
