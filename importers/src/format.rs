//! Every format: how its files are told, and who reads them.

use crate::file::{File, unmarked};
use crate::gltf;
use crate::meshes::{obj, stl};
use crate::ply;
use crate::points::{las, pcd, xyz};
use crate::source::Source;
use crate::splats::{ksplat, sog, splat, spz};
use crate::volumes::{dicom, dicom_data_set, meta_image, nifti, nrrd, plot3d, raw, tiff, vtk};
use crate::{ImportError, OpenOptions, Opened};
use glam::DVec3;

/// What a file is read as.
pub(crate) struct Format {
    pub(crate) name: &'static str,
    /// Endings of files' names, in lower case.
    extensions: &'static [&'static str],
    /// Whether a file begins as no other format's do; of a large file only the beginning is shown.
    begins: fn(&[u8]) -> bool,
    /// What is up in such files, where the format says so whatever they hold.
    pub(crate) up: Option<DVec3>,
    pub(crate) read: Read,
}

/// Some formats are read part by part, which suits large files; others have all of a file in memory.
type Read = fn(Source, &OpenOptions) -> Result<Opened, ImportError>;

impl Format {
    const fn new(name: &'static str, extensions: &'static [&'static str], read: Read) -> Self {
        Self { name, extensions, begins: |_| false, up: None, read }
    }

    /// Told by its beginning too.
    const fn beginning(self, begins: fn(&[u8]) -> bool) -> Self {
        Self { begins, ..self }
    }

    const fn up(self, up: DVec3) -> Self {
        Self { up: Some(up), ..self }
    }
}

/// All formats but raw samples, which anything can be. Beginnings are asked in this order.
static FORMATS: &[Format] = &[
    // Its JSON may have an "asset", as glTF's does.
    Format::new("SOG", &["sog"], |source, options| sog::read(&source.into_file()?, options))
        .beginning(|bytes| bytes.starts_with(sog::ZIP) || json(bytes).is_some_and(sog::is_meta)),
    Format::new("glTF", &["gltf", "glb"], |source, options| gltf::read(&source.into_file()?, options))
        .beginning(|bytes| {
            bytes.starts_with(b"glTF") || json(bytes).is_some_and(|text| contains(text, b"\"asset\""))
        })
        .up(DVec3::Y),
    Format::new("OBJ", &["obj"], |source, options| obj::read(&source.into_file()?, options)),
    Format::new("STL", &["stl"], |source, _| stl::read(&source.into_file()?))
        .beginning(stl::is_stl)
        .up(DVec3::Z),
    Format::new("PLY", &["ply"], ply::read)
        .beginning(|bytes| bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r")),
    Format::new("LAS", &["las", "laz"], |source, options| las::read(&source.into_file()?, options))
        .beginning(|bytes| bytes.starts_with(b"LASF")),
    Format::new("PCD", &["pcd"], |source, options| pcd::read(&source.into_file()?, options))
        .beginning(|bytes| bytes.starts_with(b"# .PCD")),
    Format::new("XYZ", &["xyz", "xyzrgb", "xyzn", "pts", "asc", "csv", "txt"], |source, _| {
        xyz::read(&source.into_file()?)
    }),
    Format::new(".splat", &["splat"], |source, _| splat::read(&source)),
    Format::new("SPZ", &["spz"], |source, options| spz::read(&source.into_file()?, options))
        .beginning(spz::begins),
    Format::new("KSPLAT", &["ksplat"], |source, _| ksplat::read(&source.into_file()?)),
    Format::new("NRRD", &["nrrd", "nhdr"], |source, options| {
        Ok(nrrd::read(&source.into_file()?, options)?.into())
    })
    .beginning(|bytes| bytes.starts_with(b"NRRD0")),
    Format::new("MetaImage", &["mhd", "mha"], |source, options| {
        meta_image::read(&source.into_file()?, options)
    })
    .beginning(meta_image::begins),
    Format::new("NIfTI", &["nii", "hdr"], |source, options| nifti::read(&source.into_file()?, options))
        .beginning(nifti::begins),
    Format::new("VTK XML", &["vti", "vtr", "vts"], |source, options| {
        vtk::xml::read(&source.into_file()?, options)
    })
    .beginning(|bytes| text(bytes).starts_with(b"<") && contains(start(text(bytes)), b"<VTKFile")),
    Format::new("legacy VTK", &["vtk"], |source, options| vtk::legacy::read(&source.into_file()?, options))
        .beginning(|bytes| bytes.starts_with(vtk::legacy::MAGIC)),
    Format::new("DICOM", &["dcm"], |source, options| dicom::read(&source.into_file()?, options))
        .beginning(dicom_data_set::is_dicom),
    // After DICOM, whose preamble may be a TIFF's beginning.
    Format::new("TIFF", &["tif", "tiff"], |source, options| tiff::read(&source.into_file()?, options))
        .beginning(|bytes| TIFF.iter().any(|beginning| bytes.starts_with(beginning))),
];

/// Told by its counts and size together, where nothing else tells a file; or by its name.
static PLOT3D: Format = Format::new("PLOT3D", &["x", "g", "q", "p3d"], plot3d::read);

static RAW: Format =
    Format::new(
        "raw",
        &["raw", "gz"],
        |source, options| Ok(raw::read(&source.into_file()?, options)?.into()),
    );

/// In both byte orders, and BigTIFF.
const TIFF: [&[u8]; 4] = [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"];

/// The format of a file of `size` bytes, of which only the beginning may be there: by that; else PLOT3D by its counts and size unless the caller
/// `says_raw`; else by name; else raw where the caller says so; else OBJ where the text looks like it, which has no fixed beginning; else raw.
pub(crate) fn of(file: &File, size: usize, says_raw: bool) -> &'static Format {
    if let Some(format) = of_beginning(&file.bytes) {
        return format;
    }
    if !says_raw && plot3d::is_plot3d(&file.bytes, size) {
        return &PLOT3D;
    }
    let extension = file.path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let named = |format: &&Format| format.extensions.contains(&extension.as_str());
    let looks_like = |format: &&Format| !says_raw && format.name == "OBJ" && looks_like_obj(&file.bytes);
    let other = || FORMATS.iter().find(looks_like).unwrap_or(&RAW);
    FORMATS.iter().chain([&PLOT3D, &RAW]).find(named).unwrap_or_else(other)
}

/// The format whose fixed beginning `bytes` have.
pub(crate) fn of_beginning(bytes: &[u8]) -> Option<&'static Format> {
    FORMATS.iter().find(|format| (format.begins)(bytes))
}

/// The names of all formats but raw samples.
pub(crate) fn names() -> String {
    FORMATS.iter().chain([&PLOT3D]).map(|format| format.name).collect::<Vec<_>>().join(", ")
}

/// What follows the mark of a text's encoding and white space.
fn text(bytes: &[u8]) -> &[u8] {
    unmarked(bytes).trim_ascii_start()
}

fn json(bytes: &[u8]) -> Option<&[u8]> {
    Some(text(bytes)).filter(|text| text.starts_with(b"{"))
}

fn start(text: &[u8]) -> &[u8] {
    &text[..text.len().min(1024)]
}

fn contains(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

/// Whether the first line that says something begins with a word of OBJ.
fn looks_like_obj(bytes: &[u8]) -> bool {
    let head = unmarked(&bytes[..bytes.len().min(4096)]);
    let line = head.split(|&b| b == b'\n').map(<[u8]>::trim_ascii).find(|l| !l.is_empty() && l[0] != b'#');
    let word = line.and_then(|l| l.split(|b| b.is_ascii_whitespace()).next());
    matches!(word, Some(b"v" | b"vt" | b"vn" | b"f" | b"o" | b"g" | b"s" | b"mtllib" | b"usemtl"))
}
