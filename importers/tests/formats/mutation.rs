//! Valid files with bytes changed, put in and cut off: any outcome but a panic. `PROPTEST_CASES` asks for more
//! cases than the usual 256.

use crate::common::{Folder, as_text, base64, corner_marked, gzip, png, zlib};
use oblate_engine::Cloud;
use oblate_importers::Opened;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

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
fn check(opened: &Opened) {
    let mesh = match opened {
        Opened::Mesh(mesh) => mesh,
        Opened::Volume(_) => return,
        Opened::Splats(splats) => {
            assert!(Cloud::new(splats.clone()).is_ok_and(|cloud| !cloud.is_empty()));
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

/// Opens changed copies of `bytes`, with whole files beside them.
fn survives(name: &'static str, bytes: Vec<u8>, beside: &[(&str, Vec<u8>)]) {
    let folder = Folder::new();
    for (name, bytes) in beside {
        folder.write(name, bytes);
    }
    check(&folder.open(name, &bytes).unwrap());
    let config = ProptestConfig { failure_persistence: None, ..ProptestConfig::default() };
    proptest!(config, |(changes in vec(change(), 1..6))| {
        match folder.open(name, changed(bytes.clone(), &changes)) {
            Ok(opened) => check(&opened),
            Err(error) => assert!(error.to_string().len() > 10),
        }
    });
}

#[test]
fn nrrd() {
    let header = |encoding: &str| {
        format!(
            "NRRD0004\ntype: short\ndimension: 4\nsizes: 1 4 3 2\nendian: big\nencoding: {encoding}\nkinds: list domain domain domain\n\
             space directions: none (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nline skip: 1\nbyte skip: 0\n\n\n"
        )
    };
    let samples: Vec<u8> = corner_marked().iter().flat_map(|&s| i16::from(s).to_be_bytes()).collect();
    survives("a.nrrd", [header("raw").into_bytes(), samples.clone()].concat(), &[]);
    survives("a.nrrd", [header("gzip").into_bytes(), gzip(&samples)].concat(), &[]);
    survives("a.nrrd", (header("ascii") + &as_text()).into_bytes(), &[]);
}

#[test]
fn vti() {
    let file = |array: &str, compressor: &str| {
        format!(
            "<VTKFile type=\"ImageData\" header_type=\"UInt64\" {compressor}><ImageData WholeExtent=\"0 3 0 2 0 1\" Origin=\"0 0 0\" \
             Spacing=\"1 1 1\" Direction=\"1 0 0 0 1 0 0 0 1\"><Piece Extent=\"0 3 0 2 0 1\"><PointData Scalars=\"a\">\
             <DataArray type=\"UInt8\" Name=\"a\" NumberOfComponents=\"1\" {array}</DataArray></PointData></Piece></ImageData>"
        )
    };
    let block = zlib(&corner_marked());
    let numbers = [1, 24, 24, block.len()].map(|n| (n as u64).to_le_bytes()).concat();
    let zlib = "compressor=\"vtkZLibDataCompressor\"";
    let inline = format!("format=\"binary\">{}{}", base64(&numbers), base64(&block));
    survives("a.vti", (file(&inline, zlib) + "</VTKFile>").into_bytes(), &[]);
    let appended = file("format=\"appended\" offset=\"0\">", zlib) + "<AppendedData encoding=\"raw\">_";
    survives("a.vti", [appended.into_bytes(), numbers, block].concat(), &[]);
    let ascii = format!("format=\"ascii\">{}", as_text());
    survives("a.vti", (file(&ascii, "") + "</VTKFile>").into_bytes(), &[]);
}

#[test]
fn raw() {
    survives("a_4x3x2_u8.raw.gz", gzip(&corner_marked()), &[]);
}

#[test]
fn ply() {
    let header = |encoding: &str| {
        format!(
            "ply\nformat {encoding} 1.0\ncomment TextureFile a.png\nelement vertex 3\nproperty float x\nproperty float y\n\
             property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
             property list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
        )
    };
    let vertices = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mut binary = header("binary_little_endian").into_bytes();
    for vertex in vertices {
        binary.extend(vertex.iter().flat_map(|c| c.to_le_bytes()));
        binary.extend([255, 128, 0]);
    }
    binary.push(3);
    binary.extend([0_i32, 1, 2].iter().flat_map(|i| i.to_le_bytes()));
    binary.push(6);
    binary.extend([0.0_f32, 0.0, 1.0, 0.0, 0.0, 1.0].iter().flat_map(|c| c.to_le_bytes()));
    survives("a.ply", binary, &[("a.png", png())]);
    let rows = "0 0 0 255 128 0\n1 0 0 255 128 0\n0 1 0 255 128 0\n3 0 1 2 6 0 0 1 0 0 1\n";
    survives("a.ply", (header("ascii") + rows).into_bytes(), &[("a.png", png())]);
}

#[test]
fn splats() {
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        survives("a.ply", crate::splats::example(encoding), &[]);
    }
}

#[test]
fn obj() {
    let text = "mtllib a.mtl\nv 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nusemtl a\n\
        f 1/1/1 2/1/1 3/2/1 4/2/1\nf -1//-1 -2//-1 -3//-1\n";
    let library = b"newmtl a\nKd 1 0.5 0\nd 0.5\nmap_Kd -clamp on -o 0 0 0 -mm 0 1 a.png\n".to_vec();
    survives("a.obj", text.into(), &[("a.mtl", library.clone()), ("a.png", png())]);
    // The same for the library beside a whole mesh.
    let folder = Folder::new();
    folder.write("a.png", png());
    proptest!(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() }, |(changes in vec(change(), 1..6))| {
        folder.write("a.mtl", changed(library.clone(), &changes));
        if let Ok(opened) = folder.open("a.obj", text) {
            check(&opened);
        }
    });
}

#[test]
fn gltf() {
    survives("a.glb", crate::gltf::example_glb(), &[]);
    survives("a.gltf", crate::gltf::example_gltf(), &[("a.png", png())]);
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
        proptest!(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() }, |(changes in vec(change(), 1..4))| {
            folder.write("a.png", changed(bytes.clone(), &changes));
            if let Ok(opened) = folder.open("a.obj", text) {
                check(&opened);
            }
        });
    }
}
