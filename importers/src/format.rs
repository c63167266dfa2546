//! Telling formats apart.

use crate::file::File;
use glam::DVec3;

/// What a file is read as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Gltf,
    Obj,
    Ply,
    Nrrd,
    Vti,
    Las,
    Pcd,
    Xyz,
    Raw,
}

impl Format {
    /// By a known beginning; else raw when the caller `says_raw`; else by name; else by whether the text
    /// looks like OBJ, which has no fixed beginning; else raw.
    pub(crate) fn of(file: &File, says_raw: bool) -> Self {
        if let Some(format) = Self::of_beginning(&file.bytes) {
            return format;
        }
        if says_raw {
            return Self::Raw;
        }
        let extension = file.path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        match extension.as_deref() {
            Some("gltf" | "glb") => Self::Gltf,
            Some("obj") => Self::Obj,
            Some("ply") => Self::Ply,
            Some("nrrd" | "nhdr") => Self::Nrrd,
            Some("vti") => Self::Vti,
            Some("las" | "laz") => Self::Las,
            Some("pcd") => Self::Pcd,
            Some("xyz" | "xyzrgb" | "xyzn" | "pts" | "asc" | "csv" | "txt") => Self::Xyz,
            Some("raw" | "gz") => Self::Raw,
            _ if looks_like_obj(&file.bytes) => Self::Obj,
            _ => Self::Raw,
        }
    }

    /// The format whose fixed beginning `bytes` have.
    pub(crate) fn of_beginning(bytes: &[u8]) -> Option<Self> {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
        let head = &text[..text.len().min(1024)];
        if bytes.starts_with(b"glTF") || (head.starts_with(b"{") && contains(text, b"\"asset\"")) {
            Some(Self::Gltf)
        } else if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
            Some(Self::Ply)
        } else if bytes.starts_with(b"NRRD0") {
            Some(Self::Nrrd)
        } else if head.starts_with(b"<") && contains(head, b"<VTKFile") {
            Some(Self::Vti)
        } else if bytes.starts_with(b"LASF") {
            Some(Self::Las)
        } else if bytes.starts_with(b"# .PCD") {
            Some(Self::Pcd)
        } else {
            None
        }
    }

    /// What is up in such files, where the format says so whatever it holds.
    pub(crate) fn up(self) -> Option<DVec3> {
        match self {
            Self::Gltf => Some(DVec3::Y),
            _ => None,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Gltf => "glTF",
            Self::Obj => "OBJ",
            Self::Ply => "PLY",
            Self::Nrrd => "NRRD",
            Self::Vti => "VTI",
            Self::Las => "LAS",
            Self::Pcd => "PCD",
            Self::Xyz => "XYZ",
            Self::Raw => "raw",
        }
    }
}

fn contains(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

/// Whether the first line that says something begins with a word of OBJ.
fn looks_like_obj(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(4096)];
    let line = head.split(|&b| b == b'\n').map(<[u8]>::trim_ascii).find(|l| !l.is_empty() && l[0] != b'#');
    let word = line.and_then(|l| l.split(|b| b.is_ascii_whitespace()).next());
    matches!(word, Some(b"v" | b"vt" | b"vn" | b"f" | b"o" | b"g" | b"s" | b"mtllib" | b"usemtl"))
}
