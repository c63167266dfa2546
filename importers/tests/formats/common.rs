//! Files for the tests to open.

use glam::DVec3;
use oblate_engine::Splats;
use oblate_importers::{Content, ImportError, OpenOptions, Opened, open};
use oblate_surfels::{Mesh, PointCloud, Primitive};
use oblate_volumes::{IrregularVolume, Volume};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder that is removed in the end.
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        // Some file systems wait for the disk where a file is cut to nothing and written again.
        let _ = fs::remove_file(&path);
        fs::write(&path, bytes).unwrap();
        path
    }

    /// Writes a file and opens it.
    pub(crate) fn open(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<Opened, ImportError> {
        self.open_with(name, bytes, &OpenOptions::default())
    }

    pub(crate) fn open_with(
        &self,
        name: &str,
        bytes: impl AsRef<[u8]>,
        options: &OpenOptions,
    ) -> Result<Opened, ImportError> {
        open(self.write(name, bytes), options)
    }

    pub(crate) fn volume(&self, name: &str, bytes: impl AsRef<[u8]>) -> Volume {
        volume(self.open(name, bytes))
    }

    pub(crate) fn mesh(&self, name: &str, bytes: impl AsRef<[u8]>) -> Mesh {
        mesh(self.open(name, bytes))
    }

    /// The only primitive of a mesh.
    pub(crate) fn primitive(&self, name: &str, bytes: impl AsRef<[u8]>) -> Primitive {
        let mut mesh = self.mesh(name, bytes);
        assert_eq!(mesh.primitives.len(), 1, "{name} should have one primitive");
        mesh.primitives.remove(0)
    }

    /// The message of a file that must not open; it must name the file and hold all of `parts`.
    #[track_caller]
    pub(crate) fn refused(&self, name: &str, bytes: impl AsRef<[u8]>, parts: &[&str]) -> String {
        refused(self.open(name, bytes), name, parts)
    }
}

#[track_caller]
pub(crate) fn refused(opened: Result<Opened, ImportError>, name: &str, parts: &[&str]) -> String {
    let message = opened.expect_err("the file should be refused").to_string();
    for part in parts.iter().chain([&name]) {
        assert!(message.contains(part), "{message:?} should contain {part:?}");
    }
    message
}

#[track_caller]
pub(crate) fn volume(opened: Result<Opened, ImportError>) -> Volume {
    match opened.unwrap_or_else(|error| panic!("{error}")).content {
        Content::Volume(volume) => volume,
        _ => panic!("a volume is expected"),
    }
}

#[track_caller]
pub(crate) fn irregular(opened: Result<Opened, ImportError>) -> IrregularVolume {
    match opened.unwrap_or_else(|error| panic!("{error}")).content {
        Content::Irregular(volume) => volume,
        _ => panic!("irregular samples are expected"),
    }
}

#[track_caller]
pub(crate) fn mesh(opened: Result<Opened, ImportError>) -> Mesh {
    match opened.unwrap_or_else(|error| panic!("{error}")).content {
        Content::Mesh(mesh) => mesh,
        _ => panic!("a mesh is expected"),
    }
}

#[track_caller]
pub(crate) fn splats(opened: Result<Opened, ImportError>) -> Splats {
    match opened.unwrap_or_else(|error| panic!("{error}")).content {
        Content::Splats { splats, .. } => splats,
        _ => panic!("splats are expected"),
    }
}

#[track_caller]
pub(crate) fn points(opened: Result<Opened, ImportError>) -> PointCloud {
    match opened.unwrap_or_else(|error| panic!("{error}")).content {
        Content::Points(points) => points,
        _ => panic!("points are expected"),
    }
}

/// The dims of test volumes: all different, so that no two axes can be confused.
pub(crate) const DIMS: [usize; 3] = [4, 3, 2];

/// Samples from 10 on, except for the eight corners, which are 1 to 8 in the order of their indices.
pub(crate) fn corner_marked() -> Vec<u8> {
    let mut samples: Vec<u8> = (10..34).collect();
    for corner in 0..8 {
        let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
        let [x, y, z] = [i * (DIMS[0] - 1), j * (DIMS[1] - 1), k * (DIMS[2] - 1)];
        samples[(z * DIMS[1] + y) * DIMS[0] + x] = corner as u8 + 1;
    }
    samples
}

/// That a volume holds the corner-marked samples, read sample by sample through its own indexing.
#[track_caller]
pub(crate) fn assert_corner_marked(volume: &Volume) {
    assert_eq!(volume.dims(), DIMS);
    for corner in 0..8_usize {
        let bits = [corner & 1, corner >> 1 & 1, corner >> 2];
        let index = std::array::from_fn(|axis| bits[axis] * (DIMS[axis] - 1));
        assert_eq!(volume.value(index), corner as f32 + 1.0, "corner {index:?}");
    }
    let inner: Vec<f32> = (0..volume.voxels().len()).map(|i| volume.voxels().get(i)).collect();
    assert_eq!(inner, corner_marked().into_iter().map(f32::from).collect::<Vec<_>>());
}

/// That a volume holds the corner-marked samples and all eight corners lie at `origin` + i, j, k times the steps along
/// the axes, within 1e-12 of the numbers' size: a few roundings of f64.
#[track_caller]
pub(crate) fn assert_corners_at(volume: &Volume, origin: [f64; 3], steps: [[f64; 3]; 3]) {
    assert_corner_marked(volume);
    for corner in 0..8_usize {
        let index = [corner & 1, corner >> 1 & 1, corner >> 2];
        let index: [usize; 3] = std::array::from_fn(|axis| index[axis] * (DIMS[axis] - 1));
        let expected = (0..3).fold(DVec3::from_array(origin), |position, axis| {
            position + DVec3::from_array(steps[axis]) * index[axis] as f64
        });
        let found = volume.index_to_world().transform_point3(DVec3::from_array(index.map(|i| i as f64)));
        let tolerance = 1e-12 * (1.0 + expected.abs().max_element());
        assert!(found.abs_diff_eq(expected, tolerance), "corner {index:?}: {found} should be {expected}");
    }
    assert!(volume.frame().spacing.min_element() > 0.0);
}

/// The corner-marked samples in a number type of files, and the type that they should come back as.
pub(crate) struct Written {
    /// Rust's name of the type.
    pub(crate) name: &'static str,
    pub(crate) little: Vec<u8>,
    pub(crate) big: Vec<u8>,
    pub(crate) voxel_type: &'static str,
}

/// The corner-marked samples in all number types.
pub(crate) fn written() -> Vec<Written> {
    macro_rules! written {
        ($($type:ident => $voxels:expr),*) => {
            vec![$(Written {
                name: stringify!($type),
                little: corner_marked().iter().flat_map(|&s| (s as $type).to_le_bytes()).collect(),
                big: corner_marked().iter().flat_map(|&s| (s as $type).to_be_bytes()).collect(),
                voxel_type: $voxels,
            }),*]
        };
    }
    written!(u8 => "u8", i8 => "i16", u16 => "u16", i16 => "i16", i32 => "f32", u32 => "f32", i64 => "f32",
        u64 => "f32", f32 => "f32", f64 => "f32")
}

/// The corner-marked samples as text.
pub(crate) fn as_text() -> String {
    let words: Vec<String> = corner_marked().iter().map(u8::to_string).collect();
    words.chunks(5).map(|line| line.join(" ")).collect::<Vec<_>>().join("\n")
}

/// A PNG of 2×2 texels: red, green in the upper row, blue, half-transparent white in the lower one.
pub(crate) fn png() -> Vec<u8> {
    encoded_png(&TEXELS.concat(), 2)
}

/// A PNG of one texel.
pub(crate) fn tiny_png() -> Vec<u8> {
    encoded_png(&TEXELS[0], 1)
}

fn encoded_png(texels: &[u8], side: u32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let (color, format) = (image::ExtendedColorType::Rgba8, image::ImageFormat::Png);
    image::write_buffer_with_format(&mut bytes, texels, side, side, color, format).unwrap();
    bytes.into_inner()
}

pub(crate) const TEXELS: [[u8; 4]; 4] =
    [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 128]];

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub(crate) fn zlib(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub(crate) fn base64(bytes: &[u8]) -> String {
    use base64::Engine;
    base64::engine::general_purpose::STANDARD.encode(bytes)
}
