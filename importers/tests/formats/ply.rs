use crate::common::{Folder, mesh, png, refused};
use glam::{Vec2, Vec3, Vec4, dvec3, vec3};
use oblate_engine::color::srgb_to_linear;
use oblate_importers::{Note, OpenOptions};

/// A value of a row: a number, or a list of them.
enum Value {
    One(&'static str, f64),
    List(&'static str, &'static str, Vec<f64>),
}

use Value::{List, One};

pub(crate) fn bytes(kind: &str, value: f64, big: bool) -> Vec<u8> {
    macro_rules! bytes {
        ($type:ty) => {
            if big {
                (value as $type).to_be_bytes().to_vec()
            } else {
                (value as $type).to_le_bytes().to_vec()
            }
        };
    }
    match kind {
        "char" | "int8" => bytes!(i8),
        "uchar" | "uint8" => bytes!(u8),
        "short" => bytes!(i16),
        "ushort" => bytes!(u16),
        "int" => bytes!(i32),
        "uint" => bytes!(u32),
        "float" => bytes!(f32),
        "double" => bytes!(f64),
        _ => panic!("no type {kind}"),
    }
}

/// Rows in an encoding.
fn rows(encoding: &str, rows: &[Vec<Value>]) -> Vec<u8> {
    let big = encoding == "binary_big_endian";
    let mut out = Vec::new();
    for row in rows {
        let flat: Vec<(&str, f64)> = row
            .iter()
            .flat_map(|value| match value {
                One(kind, value) => vec![(*kind, *value)],
                List(count, kind, values) => {
                    let head = (*count, values.len() as f64);
                    [head].into_iter().chain(values.iter().map(|value| (*kind, *value))).collect()
                }
            })
            .collect();
        if encoding == "ascii" {
            let words: Vec<String> = flat.iter().map(|(_, value)| value.to_string()).collect();
            out.extend(format!(" {} \n", words.join(" ")).into_bytes());
        } else {
            flat.iter().for_each(|(kind, value)| out.extend(bytes(kind, *value, big)));
        }
    }
    out
}

/// A quad and a triangle with everything on them, between elements that nobody knows.
fn everything(encoding: &str, [real, color, count, index]: [&'static str; 4]) -> Vec<u8> {
    let full = if color == "float" { 1.0 } else { 255.0 };
    let vertex = |x: f64, y: f64, u: f64, r: f64| {
        vec![
            One(real, x),
            One("char", -7.0),
            One(real, y),
            One(real, 0.5),
            One(real, 0.0),
            One(real, 0.0),
            One(real, 1.0),
            One(color, r * full),
            One(color, 0.0),
            One(color, full),
            One(color, full),
            One(real, u),
            One(real, 0.25),
        ]
    };
    let face =
        |corners: &[f64]| vec![List("uchar", "float", vec![9.0; 3]), List(count, index, corners.to_vec())];
    let header = format!(
        "ply\nformat {encoding} 1.0\ncomment by hand\nelement junk 2\nproperty list uchar double numbers\nproperty short s\n\
         element vertex 5\nproperty {real} x\nproperty char junk\nproperty {real} y\nproperty {real} z\n\
         property {real} nx\nproperty {real} ny\nproperty {real} nz\n\
         property {color} red\nproperty {color} green\nproperty {color} blue\nproperty {color} alpha\n\
         property {real} s\nproperty {real} t\nobj_info nothing\nelement nothing 5\n\
         element face 3\nproperty list uchar float weights\nproperty list {count} {index} vertex_indices\nend_header\n"
    );
    let junk = [
        vec![List("uchar", "double", vec![1.0, 2.0]), One("short", 3.0)],
        vec![List("uchar", "double", vec![]), One("short", 4.0)],
    ];
    let vertices = [
        vertex(0.0, 0.0, 0.0, 1.0),
        vertex(1.0, 0.0, 1.0, 0.0),
        vertex(1.0, 1.0, 1.0, 0.0),
        vertex(0.0, 1.0, 0.0, 0.0),
        vertex(2.0, 2.0, 2.0, 0.0),
    ];
    let faces = [face(&[0.0, 1.0, 2.0, 3.0]), face(&[4.0, 2.0]), face(&[1.0, 4.0, 2.0])];
    [header.into_bytes(), rows(encoding, &junk), rows(encoding, &vertices), rows(encoding, &faces)].concat()
}

#[test]
fn every_encoding_and_type() {
    let folder = Folder::new();
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for types in [
            ["float", "uchar", "uchar", "int"],
            ["double", "float", "uint", "ushort"],
            ["short", "uchar", "int", "char"],
        ] {
            if types[0] == "short" && encoding != "ascii" {
                // Halves and quarters are not whole.
                continue;
            }
            let primitive = folder.primitive("a.ply", everything(encoding, types));
            let positions = [[0., 0., 0.5], [1., 0., 0.5], [1., 1., 0.5], [0., 1., 0.5], [2., 2., 0.5]];
            assert_eq!(primitive.positions, positions.map(Vec3::from_array));
            // The quad's fan, nothing for the face of two corners, the triangle.
            assert_eq!(primitive.triangles, [[0, 1, 2], [0, 2, 3], [1, 4, 2]]);
            assert_eq!(primitive.normals.unwrap(), [Vec3::Z; 5]);
            let colors = primitive.colors.unwrap();
            assert_eq!(colors[0], Vec4::new(1.0, 0.0, 1.0, 1.0));
            assert_eq!(colors[1], Vec4::new(0.0, 0.0, 1.0, 1.0));
            // v upwards in the file.
            assert_eq!(primitive.tex_coords.unwrap()[1], Vec2::new(1.0, 0.75));
            assert_eq!(primitive.material.texture, None);
        }
    }
}

const TRIANGLE: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

#[test]
fn line_ends_of_all_kinds() {
    let folder = Folder::new();
    for end in ["\n", "\r\n", "\r"] {
        let primitive = folder.primitive("a.ply", TRIANGLE.replace('\n', end));
        assert_eq!(primitive.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
        let message =
            folder.refused("a.ply", TRIANGLE.replace("1 0 0", "1 zero 0").replace('\n', end), &["\"zero\""]);
        assert!(message.contains("line 11"), "{message}");
    }
}

#[test]
fn colours_are_decoded() {
    let colored = TRIANGLE
        .replace("float z\n", "float z\nproperty ushort red\nproperty ushort green\nproperty ushort blue\n")
        .replace("0 0 0", "0 0 0 32768 0 65535")
        .replace("1 0 0", "1 0 0 0 0 0")
        .replace("0 1 0", "0 1 0 0 0 0");
    let color = Folder::new().primitive("a.ply", colored).colors.unwrap()[0];
    // sRGB's 0.5 is 0.2140 in linear light.
    assert!((color - Vec4::new(0.2140, 0.0, 1.0, 1.0)).abs().max_element() < 1e-4, "{color}");
}

#[test]
fn textures_by_comment_by_corner_and_by_option() {
    let folder = Folder::new();
    folder.write("skin.png", png());
    let by_corner = TRIANGLE
        .replace("element vertex", "comment TextureFile skin.png\nelement vertex")
        .replace("vertex_index\n", "vertex_index\nproperty list uchar float texcoord\n")
        .replace("face 1", "face 2")
        .replace("3 0 1 2\n", "3 0 1 2 6 0 0 1 0 0 1\n3 2 1 0 6 0.5 0.5 0 0 0.25 0.25\n");
    let primitive = folder.primitive("a.ply", &by_corner);
    assert_eq!(primitive.triangles, [[0, 1, 2], [3, 4, 5]]);
    assert_eq!(primitive.positions, [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Y, Vec3::X, Vec3::ZERO]);
    assert_eq!(primitive.tex_coords.unwrap()[2..4], [Vec2::new(0.0, 0.0), Vec2::new(0.5, 0.5)]);
    assert_eq!(primitive.material.texture.unwrap().texels, crate::common::TEXELS);
    folder.refused("a.ply", by_corner.replace("skin.png", "gone.png"), &["line 3", "gone.png"]);
    folder.refused(
        "a.ply",
        by_corner.replace("6 0 0 1", "5 0 0 1").replace("0 0 1 0 0 1\n", "0 0 1 0 0\n"),
        &["face 0", "5 numbers"],
    );
    let plain = TRIANGLE
        .replace("float z\n", "float z\nproperty float u\nproperty float v\n")
        .replace("0 0 0\n1 0 0\n0 1 0\n", "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n");
    let texture = Some(folder.write("given.png", png()));
    let options = OpenOptions { texture, ..OpenOptions::default() };
    let opened = mesh(folder.open_with("a.ply", plain, &options));
    assert_eq!(opened.primitives[0].material.texture.as_ref().unwrap().width, 2);
}

#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let refuse = |from: &str, to: &str, parts: &[&str]| {
        assert!(TRIANGLE.contains(from), "{from}");
        folder.refused("a.ply", TRIANGLE.replace(from, to), parts);
    };
    refuse("3 0 1 2", "3 0 1 3", &["face 0", "index 3", "below 3"]);
    refuse("3 0 1 2", "3 0 1 -1", &["face 0", "index -1"]);
    refuse("3 0 1 2", "3 0 1 1.5", &["face 0", "1.5"]);
    refuse("3 0 1 2", "4 0 1 2", &["line 13", "fewer values"]);
    refuse("3 0 1 2", "3 0 1 2 2", &["line 13", "more values"]);
    refuse("3 0 1 2", "-3 0 1 2", &["line 13", "-3"]);
    refuse("3 0 1 2", "1e300 0 1 2", &["line 13", "list"]);
    refuse("3 0 1 2\n", "2 0 1\n", &["no triangles"]);
    refuse("3 0 1 2\n", "\n", &["ends before row 0", "face"]);
    refuse("1 0 0", "1 nan 0", &["vertex 1", "position", "finite"]);
    refuse("1 0 0", "1 1e39 0", &["vertex 1", "finite"]);
    refuse("1 0 0", "1 0", &["line 11", "fewer"]);
    refuse("vertex 3", "vertex 9999999999999999", &["9999999999999999 rows", "left"]);
    refuse("vertex 3", "vertex 99999999999999999999999", &["line 3", "rows"]);
    refuse("vertex 3", "vertices 3", &["element \"vertex\""]);
    refuse("float y", "float w", &["x, y and z"]);
    refuse("float y", "list uchar float y", &["must not be a list"]);
    refuse("float y", "float x", &["line 5", "second property"]);
    refuse("float y", "quad y", &["line 5", "not a property"]);
    refuse("list uchar int", "int", &["must be a list"]);
    refuse("vertex_index", "vertices", &["vertex_indices"]);
    refuse("ascii 1.0", "ascii 2.0", &["line 2"]);
    refuse("ascii", "binary_middle_endian", &["line 2"]);
    refuse("end_header\n", "", &["line 9"]);
    refuse("format ascii 1.0\n", "", &["no format"]);
    folder.refused("a.ply", "plywood", &["line 1", "begins with"]);
    folder.refused("a.ply", format!("\u{feff}{TRIANGLE}"), &["line 1", "begins with"]);
    let colored = TRIANGLE
        .replace("float z\n", "float z\nproperty float red\nproperty float green\nproperty float blue\n")
        .replace("0 0 0\n1 0 0\n0 1 0\n", "0 0 0 0 0 0\n1 0 0 0 255 0\n0 1 0 0 0 0\n");
    folder.refused("a.ply", colored, &["vertex 1", "[0, 1]"]);
}

#[test]
fn empty_and_flat() {
    let folder = Folder::new();
    // A triangle without area is kept.
    assert_eq!(folder.primitive("a.ply", TRIANGLE.replace("3 0 1 2", "3 1 1 1")).triangles, [[1, 1, 1]]);
    // Rows of nothing, however many, take no time.
    let nothing = TRIANGLE.replace("element face", "element nothing 18446744073709551615\nelement face");
    assert_eq!(folder.primitive("a.ply", nothing).triangles.len(), 1);
}

#[test]
fn cut_short_anywhere() {
    let folder = Folder::new();
    for encoding in ["ascii", "binary_little_endian"] {
        let whole = everything(encoding, ["float", "uchar", "uchar", "int"]);
        // The last characters of text are a space and a line feed, before them the digit of an index.
        let end = if encoding == "ascii" { whole.len() - 3 } else { whole.len() };
        for length in 0..end {
            refused(folder.open("a.ply", &whole[..length]), "a.ply", &[]);
        }
    }
}

#[test]
fn bytes_behind_the_last_row_are_noted() {
    let folder = Folder::new();
    let notes = |file: &[u8], behind: &[u8]| folder.open("a.ply", [file, behind].concat()).unwrap().notes;
    let behind = |count: usize| Note::LeftOut(format!("{count} bytes behind the last row that is declared"));
    let binary = "binary_little_endian";
    let mesh = everything(binary, ["float", "uchar", "uchar", "int"]);
    assert_eq!(notes(&mesh, &[]), []);
    assert_eq!(notes(&mesh, &[0, 32]), [behind(2)]);
    // White space behind text is nothing.
    assert_eq!(notes(TRIANGLE.as_bytes(), b"\n \n"), []);
    assert_eq!(notes(TRIANGLE.as_bytes(), b"\n3 2 1 0\n"), [behind(7)]);
    let camera = || Note::LeftOut("1 rows of element \"camera\"".into());
    for encoding in ["ascii", "binary_big_endian"] {
        assert_eq!(notes(&points(encoding), b"123"), [behind(3), camera()]);
    }
    let plain = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
        element face 0\nproperty list uchar int vertex_indices\nend_header\n";
    assert_eq!(notes(plain.as_bytes(), &[0; 12]), []);
    assert_eq!(notes(plain.as_bytes(), &[0; 24]), [behind(12)]);
    for splats in [crate::splats::example(binary), crate::packed::example()] {
        assert_eq!(notes(&splats, &[]), []);
        assert_eq!(notes(&splats, &[7]), [behind(1)]);
    }
}

/// Two points with all that is read and a property that isn't.
pub(crate) fn points(encoding: &str) -> Vec<u8> {
    let header = format!(
        "ply\nformat {encoding} 1.0\nelement camera 1\nproperty uchar a\nelement vertex 2\nproperty double y\nproperty double x\n\
         property float z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nproperty list uchar short seen_by\nproperty float scalar_curvature\nproperty float scalar_Intensity\n\
         property float radius\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
    );
    if encoding == "ascii" {
        let rows =
            "7\n-20.5 1000000.25 3 0 0 2 255 128 0 2 1 2 5 0.75 0.5\n2 1000001 4 0 nan 2 0 0 255 0 5 8 nan\n";
        return (header + rows).into_bytes();
    }
    let mut bytes = header.into_bytes();
    bytes.push(7);
    let mut row = |place: [f64; 2], z_and_normal: [f32; 4], color: [u8; 3], list: &[u8], rest: [f32; 3]| {
        bytes.extend(place.iter().flat_map(|v| v.to_be_bytes()));
        bytes.extend(z_and_normal.iter().flat_map(|v| v.to_be_bytes()));
        bytes.extend(color);
        bytes.extend(list);
        bytes.extend(rest.iter().flat_map(|v| v.to_be_bytes()));
    };
    row([-20.5, 1_000_000.25], [3.0, 0.0, 0.0, 2.0], [255, 128, 0], &[2, 0, 1, 0, 2], [5.0, 0.75, 0.5]);
    row([2.0, 1_000_001.0], [4.0, 0.0, f32::NAN, 2.0], [0, 0, 255], &[0], [5.0, 8.0, f32::NAN]);
    bytes
}

#[test]
fn vertices_without_faces_are_points() {
    let folder = Folder::new();
    for encoding in ["ascii", "binary_big_endian"] {
        let opened = folder.open("a.ply", points(encoding)).unwrap();
        assert_eq!(opened.notes, [Note::LeftOut("1 rows of element \"camera\"".into())]);
        let cloud = crate::common::points(Ok(opened));
        assert_eq!(cloud.origin, dvec3(1_000_000.0, -20.0, 3.0));
        assert_eq!(cloud.positions, [vec3(0.25, -0.5, 0.0), vec3(1.0, 22.0, 1.0)]);
        assert_eq!(cloud.normals, Some(vec![vec3(0.0, 0.0, 2.0), Vec3::ZERO]));
        let orange = [1.0, 128.0 / 255.0, 0.0].map(srgb_to_linear);
        assert_eq!(cloud.colors, Some(vec![orange, [0.0, 0.0, 1.0]]));
        assert_eq!(cloud.intensities, Some(vec![0.75, 8.0]));
        assert_eq!(cloud.radii, Some(vec![0.5, 0.0]));
    }
    // Values of 8 bits in wider types, and names in capitals.
    for (kind, values, white) in [
        ("float", "255 128 0", 255.0),
        ("float", "1.5 0.5 0", 1.0),
        ("int", "255 128 0", 255.0),
        ("int", "65535 128 0", 65535.0),
        ("ushort", "255 128 0", 255.0),
        ("ushort", "65535 128 0", 65535.0),
        ("uchar", "20 10 0", 255.0),
    ] {
        let color = format!("property {kind} Red\nproperty {kind} Green\nproperty {kind} Blue\n");
        let head =
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
        let opened = folder.open("b.ply", format!("{head}{color}end_header\n0 0 0 {values}\n")).unwrap();
        let noted =
            (kind == "ushort" && white == 255.0) || kind == "int" || (kind, white) == ("float", 255.0);
        assert_eq!(opened.notes.len(), usize::from(noted), "{kind} {values}: {:?}", opened.notes);
        let wanted: Vec<f32> =
            values.split(' ').map(|v| srgb_to_linear(v.parse::<f32>().unwrap() / white)).collect();
        assert_eq!(crate::common::points(Ok(opened)).colors.unwrap()[0][..], wanted, "{kind} {values}");
    }
    let refuse = |from: &str, to: &str, parts: &[&str]| {
        let text = String::from_utf8(points("ascii")).unwrap();
        assert!(text.contains(from), "{from}");
        folder.refused("a.ply", text.replace(from, to), parts);
    };
    refuse("double x", "double w", &["x, y and z"]);
    refuse("vertex 2", "vertex 0", &["no points in it"]);
    refuse("vertex 2", "vertex 999999999", &["999999999 rows"]);
    refuse("double y", "list uchar uchar y", &["must not be a list"]);
    refuse("uchar green", "float green", &["of one type"]);
}
