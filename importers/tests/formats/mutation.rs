//! Valid files with bytes changed, put in and cut off: any outcome but a panic. `PROPTEST_CASES` asks for more
//! cases than the usual 256; without it they are the same at every run.

use crate::common::{Folder, png};
use crate::depth;
use crate::seeds::{self, Seed};
use oblate_engine::{Cloud, Material};
use oblate_importers::{Content, Opened};
use oblate_surfels::{PointError, PointSettings, point_surfels};
use oblate_volumes::{Interpolation, PRESETS, Partition};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::RngSeed;

/// The same changes at every run.
fn config() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, rng_seed: RngSeed::Fixed(5), ..ProptestConfig::default() }
}

/// What is done to a file.
#[derive(Clone, Debug)]
enum Change {
    Set(Index, u8),
    Flip(Index, u8),
    Insert(Index, u8),
    Remove(Index),
    Cut(Index),
    /// Puts digits over what is there: numbers are what most checks are about.
    Number(Index, u64),
}

fn change() -> impl Strategy<Value = Change> {
    prop_oneof![
        (any::<Index>(), any::<u8>()).prop_map(|(at, byte)| Change::Set(at, byte)),
        (any::<Index>(), 0_u8..8).prop_map(|(at, bit)| Change::Flip(at, bit)),
        (any::<Index>(), any::<u8>()).prop_map(|(at, byte)| Change::Insert(at, byte)),
        any::<Index>().prop_map(Change::Remove),
        any::<Index>().prop_map(Change::Cut),
        (any::<Index>(), any::<u64>(), 0_u32..64).prop_map(|(at, n, shift)| Change::Number(at, n >> shift)),
    ]
}

fn changed(mut bytes: Vec<u8>, changes: &[Change]) -> Vec<u8> {
    for change in changes {
        if bytes.is_empty() {
            break;
        }
        let length = bytes.len();
        match change {
            Change::Set(at, byte) => bytes[at.index(length)] = *byte,
            Change::Flip(at, bit) => bytes[at.index(length)] ^= 1 << bit,
            Change::Insert(at, byte) => bytes.insert(at.index(length), *byte),
            Change::Remove(at) => drop(bytes.remove(at.index(length))),
            Change::Cut(at) => bytes.truncate(at.index(length)),
            Change::Number(at, number) => {
                // The nearest digit from here on, so that text numbers are hit often.
                let from = at.index(length);
                let digit = bytes[from..].iter().position(u8::is_ascii_digit).map_or(from, |d| from + d);
                let end =
                    bytes[digit..].iter().position(|b| !b.is_ascii_digit()).map_or(length, |e| digit + e);
                bytes.splice(digit..end, number.to_string().into_bytes());
            }
        }
    }
    bytes
}

/// A mesh that opened must keep what `Primitive` promises, and splats must make a cloud.
pub(crate) fn check(opened: &Opened) {
    let mesh = match &opened.content {
        Content::Mesh(mesh) => mesh,
        Content::Volume(_) => return,
        Content::Irregular(volume) => {
            let Ok(transfer) = PRESETS[0].fit(volume.samples()) else { return };
            // Masses may be too large for single precision, which is said.
            let _ = Partition::new(volume).kernels(&transfer, Material::default());
            let value = volume.samples().value_range().map_or(0.0, |[low, high]| 0.5 * low + 0.5 * high);
            let surfels = volume.iso_surfels(value, Interpolation::Trilinear).unwrap();
            assert!(surfels.iter().all(|surfel| surfel.center.is_finite() && surfel.area > 0.0));
            return;
        }
        Content::Splats { splats, .. } => {
            assert!(Cloud::new(splats.clone()).is_ok_and(|cloud| !cloud.is_empty()));
            return;
        }
        Content::Points(points) => {
            let surfels = point_surfels(points, &PointSettings::default());
            assert!(matches!(surfels, Ok(_) | Err(PointError::Size(_))), "{surfels:?}");
            return;
        }
    };
    for primitive in &mesh.primitives {
        let count = primitive.positions.len();
        assert!(primitive.triangles.iter().flatten().all(|&corner| (corner as usize) < count));
        assert!(primitive.positions.iter().all(|position| position.is_finite()));
        assert!(primitive.normals.as_ref().is_none_or(|normals| normals.len() == count));
        assert!(primitive.tex_coords.as_ref().is_none_or(|tex_coords| tex_coords.len() == count));
        assert!(primitive.colors.as_ref().is_none_or(|colors| colors.len() == count));
        assert!(primitive.primitive_to_mesh.is_finite());
        if let Some(texture) = &primitive.material.texture {
            assert_eq!(texture.texels.len(), texture.width * texture.height);
        }
    }
}

/// Opens a changed copy of a file: any outcome but a panic.
fn outcome(folder: &Folder, name: &str, bytes: &[u8]) {
    match folder.open(name, bytes) {
        Ok(opened) => check(&opened),
        Err(error) => assert!(error.to_string().len() > 10),
    }
}

/// Opens copies cut at every byte, with every byte changed once, and changed at random.
fn survives(Seed { name, bytes, beside }: Seed) {
    let folder = Folder::new();
    for (name, bytes) in beside {
        folder.write(name, bytes);
    }
    check(&folder.open(name, &bytes).unwrap());
    broken(&bytes, |bytes| outcome(&folder, name, bytes));
}

/// Copies cut at every byte, with every byte changed once, and changed at random.
pub(crate) fn broken(bytes: &[u8], outcome: impl Fn(&[u8])) {
    let mut copy = bytes.to_vec();
    for at in 0..bytes.len() {
        outcome(&bytes[..at]);
        for mask in [1 << (at % 8), 0xff] {
            copy[at] ^= mask;
            outcome(&copy);
            copy[at] = bytes[at];
        }
    }
    proptest!(config(), |(changes in vec(change(), 1..6))| outcome(&changed(bytes.to_vec(), &changes)));
}

/// A test for each format's seeds.
macro_rules! mutated {
    ($($format:ident)*) => {
        $(#[test]
        fn $format() {
            seeds::$format().into_iter().for_each(survives);
        })*

        /// The seeds of all formats.
        fn all() -> Vec<Seed> {
            [$(seeds::$format()),*].into_iter().flatten().collect()
        }
    };
}

mutated!(dicom gltf gltf_splats ksplat las laz_layered laz_pointwise meta_image nifti nrrd obj packed pcd plot3d ply points raw sog splat splats spz stl surfels tiff vti vtk xyz);

#[cfg(feature = "meshopt")]
#[test]
fn gltf_packed() {
    seeds::gltf_packed().into_iter().for_each(survives);
}

#[test]
fn material_libraries() {
    let Seed { bytes: text, beside, .. } = seeds::obj().remove(0);
    let library = &beside[0].1;
    let folder = Folder::new();
    folder.write("a.png", png());
    proptest!(config(), |(changes in vec(change(), 1..6))| {
        folder.write("a.mtl", changed(library.clone(), &changes));
        if let Ok(opened) = folder.open("a.obj", &text) {
            check(&opened);
        }
    });
}

#[test]
fn images() {
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n";
    let folder = Folder::new();
    folder.write("a.mtl", "newmtl a\nmap_Kd a.png\n");
    let mut jpeg = std::io::Cursor::new(Vec::new());
    let image = image::RgbImage::from_fn(16, 16, |x, y| image::Rgb([x as u8 * 16, y as u8 * 16, 128]));
    image.write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
    for bytes in [png(), jpeg.into_inner()] {
        folder.write("a.png", &bytes);
        check(&folder.open("a.obj", text).unwrap());
        proptest!(config(), |(changes in vec(change(), 1..4))| {
            folder.write("a.png", changed(bytes.clone(), &changes));
            if let Ok(opened) = folder.open("a.obj", text) {
                check(&opened);
            }
        });
    }
}

/// Where `OBLATE_SEEDS` names the folder of the fuzz targets, they begin with the files that this writes to `corpus`, and find
/// those that these name in `beside`. Targets are called by the endings of files' names.
#[test]
fn seeds_are_written_for_fuzzing() {
    let Some(folder) = std::env::var_os("OBLATE_SEEDS").map(std::path::PathBuf::from) else { return };
    let write = |folder: std::path::PathBuf, name: &str, bytes: &[u8]| {
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(name), bytes).unwrap();
    };
    for (index, seed) in all().iter().enumerate() {
        let target = folder.join("corpus").join(seed.name.rsplit('.').next().unwrap());
        write(target, &format!("seed_{index}"), &seed.bytes);
        seed.beside.iter().for_each(|(name, bytes)| write(folder.join("beside"), name, bytes));
    }
    for (target, seeds) in [("depth", depth::pictures()), ("poses", depth::texts())] {
        for (index, bytes) in seeds.iter().enumerate() {
            write(folder.join("corpus").join(target), &format!("seed_{index}"), bytes);
        }
    }
}

/// Images of splats beside the text that names them: in a zip file a checksum would stand before them.
#[test]
fn sog_images() {
    let Seed { name, bytes: text, beside } = seeds::sog().remove(1);
    let folder = Folder::new();
    let path = folder.write(name, text);
    beside.iter().for_each(|(image, good)| drop(folder.write(image, good)));
    let outcome = || {
        if let Ok(opened) = oblate_importers::open(&path, &Default::default()) {
            check(&opened);
        }
    };
    for (image, good) in &beside {
        broken(good, |bytes| {
            folder.write(image, bytes);
            outcome();
        });
        folder.write(image, good);
    }
}
