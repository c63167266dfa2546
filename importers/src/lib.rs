//! Files to meshes, volumes, points and splats, and splats and volumes to [files](export).
//!
//! [`open`] tells formats by what a file holds, then by its name:
//!
//! | format | gives | module |
//! |---|---|---|
//! | glTF 2.0, GLB | mesh, or trained splats | [`gltf`](mod@gltf) |
//! | OBJ with MTL and textures | mesh | [`meshes::obj`] |
//! | STL, binary and ascii | mesh | [`meshes::stl`] |
//! | PLY, ascii and binary | mesh, points, or trained splats, also packed ones | [`ply`] |
//! | .splat | trained splats | [`splats::splat`] |
//! | NRRD, attached and detached | volume | [`volumes::nrrd`] |
//! | MetaImage, `.mha` and `.mhd` | volume | [`volumes::meta_image`] |
//! | NIfTI-1 and -2, also under gzip, and pairs | volume | [`volumes::nifti`] |
//! | VTI, VTR and VTS (VTK ImageData, RectilinearGrid, StructuredGrid) | volume, regular or irregular | [`volumes::vtk::xml`] |
//! | legacy VTK | volume, regular or irregular | [`volumes::vtk::legacy`] |
//! | PLOT3D, points and flow | irregular volume | [`volumes::plot3d`] |
//! | TIFF stacks | volume | [`volumes::tiff`] |
//! | DICOM, a file of a series or its folder | volume | [`volumes::dicom`] |
//! | a folder of numbered slices | volume | [`volumes::slices`] |
//! | SPZ | trained splats | [`splats::spz`] |
//! | SOG, as zip or `meta.json`; sets of levels | trained splats | [`splats::sog`] |
//! | KSPLAT | trained splats | [`splats::ksplat`] |
//! | LAS, LAZ | points | [`points::las`] |
//! | PCD | points | [`points::pcd`] |
//! | XYZ, PTS and other text | points | [`points::xyz`] |
//! | raw samples, also under gzip | volume | [`volumes::raw`] |
//!
//! Depth maps, the photographs that belong to them and where their cameras stood are no content by themselves: [`depth`] reads
//! each of them.
//!
//! Nothing a file says is believed before the file's own size was asked: declared sizes are compared with
//! the bytes that are there before anything is allocated, decompression stops at the size that is
//! expected, indices and offsets are checked, and what is wrong is an [`ImportError`] that says where.
//!
//! Meshes, points and splats keep the axes of their file (but [`splats::spz`]); glTF's are oblate's (+Y up, right-handed).
//! Volumes keep the frame of their file, whatever it calls its axes; samples are voxel centres.

mod content;
mod decoder;
pub mod depth;
mod error;
pub mod export;
mod file;
mod format;
pub mod gltf;
mod grey;
mod inflate;
pub mod meshes;
pub mod ply;
mod pnm;
pub mod points;
mod scalar;
mod source;
pub mod splats;
pub mod volumes;
mod watch;

pub use content::{Content, Note, Opened};
pub use error::{ImportError, Place};
pub use export::ExportError;
pub use volumes::raw::{Endian, LayoutError, RawLayout, RawSlices, SampleType, parse_dims};
pub use watch::Watch;

use glam::DVec3;
use source::Source;
use std::path::{Path, PathBuf};
use volumes::slices;

/// What a caller knows that a file may not say.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenOptions {
    /// How raw samples lie in the file; also makes a file a raw one that neither its beginning nor its name tells.
    pub raw: Option<RawLayout>,
    /// Distance between samples along a volume's axes, in place of the file's; meshes don't heed it.
    pub spacing: Option<DVec3>,
    /// A PNG, JPEG or WebP for the parts of an OBJ or PLY mesh that have texture coordinates and no texture.
    pub texture: Option<PathBuf>,
    /// The file of the flow that belongs to a PLOT3D grid, in place of the one beside it; other files don't heed it.
    pub flow: Option<PathBuf>,
    /// The level of detail of a file that has several, 0 being the finest and the default; other files don't heed it.
    pub level: Option<u32>,
    /// Bytes that a compressed file may unpack to, at most.
    pub max_memory: u64,
    /// Is told how far reading the file itself has come.
    pub watch: Option<Watch>,
}

impl OpenOptions {
    /// What compressed files may unpack to where nothing is said: 16 GiB.
    pub const MAX_MEMORY: u64 = 16 << 30;
}

impl Default for OpenOptions {
    fn default() -> Self {
        let max_memory = Self::MAX_MEMORY;
        Self { raw: None, spacing: None, texture: None, flow: None, level: None, max_memory, watch: None }
    }
}

/// Reads the file or folder at `path`, whatever of the formats above it is.
///
/// # Errors
/// When the file, or one that it names, cannot be read, is malformed or of an unsupported kind; for raw
/// samples when neither `options` nor the file's name tell their layout.
pub fn open(path: impl AsRef<Path>, options: &OpenOptions) -> Result<Opened, ImportError> {
    let path = path.as_ref();
    if path.is_dir() {
        return Ok(Opened { format: "slices", ..slices::read(path, options)? });
    }
    let source = Source::open(path, options.watch.as_ref())?;
    let format = format::of(&source.head, source.size, options.raw.is_some());
    let opened = (format.read)(source, options)?;
    Ok(Opened { format: format.name, up: format.up.unwrap_or(opened.up), ..opened })
}
