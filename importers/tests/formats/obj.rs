use crate::common::{Folder, TEXELS, mesh, png, refused, tiny_png};
use glam::{DAffine3, Vec2, Vec3, Vec4};
use oblate_engine::color::srgb_to_linear;
use oblate_importers::{Note, OpenOptions};
use oblate_surfels::{BaseColor, Wrap};

#[test]
fn faces_of_all_kinds() {
    let folder = Folder::new();
    let text = "# caf\u{e9}\no thing\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0\nv 0 1 0\nv 0.5 2 0 # above\nvt 0 0\nvt 1 0.25 0\nvt 1 1\n\
        vn 0 0 2\ns off\nl 1 2\np 1\nf 1 2 3 4\nf 4 \\\n 3 5\nf 1/1 2/2 3/3\nf -5/-3/-1 2/2/1 3/3/1\nf 1//1 2//1 3//1\n";
    // A comment in Latin-1 is no UTF-8.
    let bytes: Vec<u8> = text.chars().map(|c| c as u8).collect();
    let opened = folder.mesh("a.obj", bytes);
    let [bare, textured, both, smooth] = &opened.primitives[..] else { panic!("four kinds of corners") };
    assert_eq!(
        bare.positions,
        [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0.5, 2., 0.]].map(Vec3::from_array)
    );
    assert_eq!(bare.triangles, [[0, 1, 2], [0, 2, 3], [3, 2, 4]]);
    assert!(bare.normals.is_none() && bare.tex_coords.is_none() && bare.colors.is_none());
    let uvs = [Vec2::new(0.0, 1.0), Vec2::new(1.0, 0.75), Vec2::new(1.0, 0.0)];
    assert_eq!(textured.tex_coords.as_deref(), Some(&uvs[..]));
    assert!(textured.normals.is_none());
    assert_eq!(both.tex_coords.as_deref(), Some(&uvs[..]));
    assert_eq!(both.normals.as_deref(), Some(&[Vec3::new(0.0, 0.0, 2.0); 3][..]));
    assert_eq!(both.positions, textured.positions);
    assert!(smooth.normals.is_some() && smooth.tex_coords.is_none());
}

#[test]
fn a_corner_is_a_position_once() {
    let text =
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 1/1 3/1 4/1\nf 1/2 3/1 4/1\n";
    let primitive = Folder::new().primitive("a.obj", text);
    assert_eq!(primitive.triangles, [[0, 1, 2], [0, 2, 3], [4, 2, 3]]);
    assert_eq!(primitive.positions[0], primitive.positions[4]);
}

#[test]
fn colours_of_vertices() {
    let text = "v 0 0 0\nv 1 0 0 1 0.5 0\nv 0 1 0\nf 1 2 3\n";
    let colors = Folder::new().primitive("a.obj", text).colors.unwrap();
    assert_eq!((colors[0], colors[2]), (Vec4::ONE, Vec4::ONE));
    assert!((colors[1] - Vec4::new(1.0, 0.2140, 0.0, 1.0)).abs().max_element() < 1e-4);
}

const TWO: &str = "mtllib my colours.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl red paint\nf 1/1 2/1 3/1\nusemtl skin\n\
    f 1/1 2/1 3/1\nusemtl red paint\nf 3/1 2/1 1/1\n";
const COLOURS: &str = "newmtl red paint\nKa 1 1 1\nKd 1 0 0.5\nd 0.25\nTr 1\n\nnewmtl skin\nKd 0 0 0\nmap_Kd -clamp on -s 1 1 1 a skin.png\n\
    newmtl grey\nKd 0.5\n";

#[test]
fn materials() {
    let folder = Folder::new();
    folder.write("my colours.mtl", COLOURS);
    folder.write("a skin.png", png());
    let opened = folder.mesh("a.obj", TWO);
    let [red, skin] = &opened.primitives[..] else { panic!("a primitive for each material") };
    assert_eq!(red.triangles.len(), 2);
    // Kd counts as sRGB-encoded.
    assert!((red.material.factor - Vec4::new(1.0, 0.0, 0.2140, 0.25)).abs().max_element() < 1e-4);
    // Beside a map a black Kd counts as white.
    assert_eq!(skin.material.factor, Vec4::ONE);
    let texture = skin.material.texture.as_ref().unwrap();
    assert_eq!((texture.width, texture.height, texture.wrap), (2, 2, [Wrap::Clamp; 2]));
    assert_eq!(texture.texels, TEXELS);
    // Names with the separator of Windows, several libraries in one line.
    std::fs::create_dir(folder.write("x", "").parent().unwrap().join("sub")).unwrap();
    folder.write("sub/one.mtl", "newmtl red paint\n");
    folder.write("two.mtl", "newmtl skin\n");
    let moved = TWO.replace("my colours.mtl", "sub\\one.mtl two.mtl");
    assert_eq!(folder.mesh("a.obj", moved).primitives.len(), 2);
    // The same name beside two libraries is two images.
    let two = "mtllib sub/one.mtl\nmtllib two.mtl\n".to_owned() + &TWO.replace("mtllib my colours.mtl\n", "");
    folder.write("sub/one.mtl", "newmtl red paint\nmap_Kd a.png\n");
    folder.write("two.mtl", "newmtl skin\nmap_Kd a.png\n");
    folder.write("sub/a.png", png());
    folder.write("a.png", tiny_png());
    let widths = folder.mesh("a.obj", two).primitives.into_iter().map(|p| p.material.texture.unwrap().width);
    assert_eq!(widths.collect::<Vec<_>>(), [2, 1]);
}

#[test]
fn maps_are_multiplied_by_kd() {
    let folder = Folder::new();
    folder.write("a.png", png());
    let read = |materials: &str| {
        folder.write("a.mtl", materials);
        let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n";
        let opened = folder.open("a.obj", text).unwrap();
        let notes = opened.notes.clone();
        (mesh(Ok(opened)).primitives.remove(0).material, notes)
    };
    let half = srgb_to_linear(0.5);
    let white = "white for Kd 0 0 0 of materials with map_Kd, by which the map would be black";
    for (kd, factor, said) in [
        ("Kd 1 0.5 0\n", Vec4::new(1.0, half, 0.0, 0.25), None),
        ("Kd 0.5\n", Vec4::new(half, half, half, 0.25), None),
        ("", Vec4::new(1.0, 1.0, 1.0, 0.25), None),
        ("Kd 0 0 0\n", Vec4::new(1.0, 1.0, 1.0, 0.25), Some(white)),
    ] {
        let said: Vec<Note> = said.map(|said| Note::Assumed(said.into())).into_iter().collect();
        // Whichever comes first, and once for all materials.
        let first = format!("newmtl b\n{kd}map_Kd a.png\nnewmtl a\nd 0.25\n{kd}map_Kd a.png\n");
        let last = format!("newmtl a\nmap_Kd a.png\n{kd}d 0.25\n");
        for materials in [first, last] {
            let (material, notes) = read(&materials);
            assert!(material.texture.is_some(), "{materials}");
            assert_eq!((material.factor, &notes), (factor, &said), "{materials}");
        }
    }
    // Without a map black is black.
    let (material, notes) = read("newmtl a\nKd 0 0 0\n");
    assert_eq!((material.factor, notes), (Vec4::W, vec![]));
}

/// Programs of Windows put it before texts.
#[test]
fn a_mark_of_utf_8_hides_nothing() {
    let folder = Folder::new();
    folder.write("a.mtl", "\u{feff}newmtl a\nKd 1 0 0\n");
    let rest = "v 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
    let library_first = format!("\u{feff}mtllib a.mtl\nv 5 0 0\n{rest}");
    let vertex_first = format!("\u{feff}v 5 0 0\nmtllib a.mtl\n{rest}");
    for text in [library_first, vertex_first] {
        for name in ["a.obj", "told by what it holds"] {
            let primitive = folder.primitive(name, &text);
            assert_eq!(primitive.positions, [Vec3::X * 5.0, Vec3::X, Vec3::Y], "{text}");
            assert_eq!(primitive.material.factor, Vec4::new(1.0, 0.0, 0.0, 1.0), "{text}");
        }
    }
}

#[test]
fn coordinates_of_maps_keep_their_digits() {
    let corners = [
        [500_000.125, 4_600_000.375, 12.5],
        [500_003.25, 4_600_001.0, 13.0],
        [500_001.0, 4_600_002.875, 12.0],
    ];
    let lines: String = corners.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let obj = lines.lines().map(|line| format!("v {line}\n")).collect::<String>() + "v 0 0 0\nf 1 2 3\n";
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n{lines}3 0 1 2\n"
    );
    for (name, text) in [("a.obj", obj), ("a.ply", ply)] {
        let primitive = Folder::new().primitive(name, text);
        for (position, corner) in primitive.positions.iter().zip(corners) {
            let place = primitive.primitive_to_mesh.transform_point3(position.as_dvec3());
            assert_eq!(place.to_array(), corner, "{name}");
        }
    }
    // What is near stays as it stands.
    let near = Folder::new().primitive("a.obj", "v 20 0 0\nv 21 0 0\nv 20 1 0\nf 1 2 3\n");
    assert_eq!((near.positions[0], near.primitive_to_mesh), (Vec3::new(20.0, 0.0, 0.0), DAffine3::IDENTITY));
}

#[test]
fn what_has_two_meanings_is_noted() {
    let folder = Folder::new();
    let noted = |materials: &str| {
        folder.write("a.mtl", materials);
        folder.open("a.obj", "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n").unwrap().notes
    };
    assert!(noted("newmtl a\nTr 0.25\n")[0].to_string().contains("Tr"));
    for clear in ["newmtl a\nTr 0\n", "newmtl a\nTr 1.0\n", "newmtl a\nTr 0.25\nd 0.75\n"] {
        assert!(noted(clear).is_empty(), "{clear}");
    }
}

#[test]
fn photographs_that_are_cut_off_are_refused() {
    let mut jpeg = std::io::Cursor::new(Vec::new());
    image::RgbImage::new(32, 32).write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
    let jpeg = jpeg.into_inner();
    let folder = Folder::new();
    folder.write("my colours.mtl", COLOURS);
    folder.write("a skin.png", &jpeg);
    folder.mesh("a.obj", TWO);
    folder.write("a skin.png", &jpeg[..jpeg.len() - 20]);
    refused(folder.open("a.obj", TWO), "a skin.png", &["JPEG", "cut off"]);
}

#[test]
fn what_is_named_must_be_there() {
    let folder = Folder::new();
    folder.refused("a.obj", TWO, &["line 1", "my", "cannot be read"]);
    folder.write("my colours.mtl", COLOURS);
    refused(folder.open("a.obj", TWO), "my colours.mtl", &["line 9", "a skin.png"]);
    folder.write("a skin.png", &png()[..40]);
    refused(folder.open("a.obj", TWO), "a skin.png", &["PNG, JPEG or WebP"]);
    folder.write("a skin.png", png());
    folder.refused("a.obj", TWO.replace("usemtl skin", "usemtl fur"), &["line 8", "\"fur\""]);
    // A library may be named after its materials are used.
    let late = TWO.replace("mtllib my colours.mtl\n", "") + "mtllib my colours.mtl\n";
    assert_eq!(folder.mesh("a.obj", late), folder.mesh("a.obj", TWO));
    // A small image that claims 30000 by 30000 texels is refused for that.
    let mut bomb = png();
    bomb[16..24].copy_from_slice(&[0, 0, 0x75, 0x30, 0, 0, 0x75, 0x30]);
    let mut checksum = flate2::Crc::new();
    checksum.update(&bomb[12..29]);
    bomb[29..33].copy_from_slice(&checksum.sum().to_be_bytes());
    folder.write("a skin.png", bomb);
    refused(folder.open("a.obj", TWO), "a skin.png", &["imit"]);
    folder.write("a skin.png", png());
    // Without a library there is the default material.
    let bare = TWO.replace("mtllib my colours.mtl\n", "");
    assert_eq!(folder.primitive("a.obj", &bare).material, BaseColor::UNSPECIFIED);
    // And the texture that the caller gives.
    let texture = Some(folder.write("given.png", png()));
    let options = OpenOptions { texture, ..OpenOptions::default() };
    let given = mesh(folder.open_with("a.obj", &bare, &options));
    assert!(given.primitives[0].material.texture.is_some());
    let options = OpenOptions { texture: Some("gone.png".into()), ..OpenOptions::default() };
    refused(folder.open_with("a.obj", &bare, &options), "gone.png", &[]);
    for (from, to, part) in [
        ("Kd 1 0 0.5", "Kd 1 0", "line 3"),
        ("Kd 1 0 0.5", "Kd", "line 3"),
        ("Kd 1 0 0.5", "Kd 200 0 0", "[0, 1]"),
        ("Kd 1 0 0.5", "Kd spectral a.rfl", "line 3"),
        ("d 0.25", "d nan", "line 4"),
        ("newmtl red paint\n", "", "before any newmtl"),
        ("-s 1 1 1", "-s 2 2 2", "not supported"),
        ("a skin.png", "", "names no image"),
    ] {
        folder.write("my colours.mtl", COLOURS.replace(from, to));
        refused(folder.open("a.obj", TWO), "my colours.mtl", &[part]);
    }
}

#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let good = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\n";
    folder.primitive("a.obj", good);
    for (from, to, parts) in [
        ("3/1/1", "4/1/1", ["line 6", "vertex 4"]),
        ("3/1/1", "0/1/1", ["line 6", "vertex 0"]),
        ("3/1/1", "-4/1/1", ["line 6", "vertex -4"]),
        ("3/1/1", "9223372036854775807/1/1", ["line 6", "vertex 9223372036854775807"]),
        ("3/1/1", "-9223372036854775808/1/1", ["line 6", "vertex -9223372036854775808"]),
        ("3/1/1", "3/0/1", ["line 6", "texture coordinate 0"]),
        ("3/1/1", "3/2/1", ["line 6", "texture coordinate 2"]),
        ("3/1/1", "3/1/7", ["line 6", "normal 7"]),
        ("3/1/1", "3/1/1/1", ["line 6", "v/vt/vn"]),
        ("3/1/1", "/1/1", ["line 6", "v/vt/vn"]),
        ("3/1/1", "x", ["line 6", "vertex x"]),
        (" 3/1/1", "", ["line 6", "three corners"]),
        ("v 1 0 0", "v 1 nan 0", ["line 2", "finite"]),
        ("v 1 0 0", "v 1 0 1e99", ["line 2", "finite"]),
        ("v 1 0 0", "v 1 0", ["line 2", "3, 4 or 6"]),
        ("v 1 0 0", "v 1 0 0 255 0 0", ["line 2", "[0, 1]"]),
        ("vn 0 0 1", "vn 0 nan 1", ["line 5", "finite"]),
        ("vt 0 0", "vt inf 0", ["line 4", "finite"]),
        ("vt 0 0", "vt", ["line 4", "one to three"]),
        ("f 1/1/1 2/1/1 3/1/1", "", ["no triangles", "at least one"]),
    ] {
        folder.refused("a.obj", good.replacen(from, to, 1), &parts);
    }
    folder.refused("empty.obj", "", &["no triangles"]);
    // A triangle without area is kept.
    assert_eq!(folder.primitive("a.obj", good.replace("3/1/1", "1/1/1")).triangles, [[0, 1, 0]]);
}

#[test]
fn cut_short_anywhere() {
    let folder = Folder::new();
    folder.write("my colours.mtl", COLOURS);
    folder.write("a skin.png", png());
    for length in 0..TWO.len() {
        // Text that ends early may still be whole: what opens must hold whole triangles.
        if let Ok(opened) = folder.open("a.obj", &TWO[..length]) {
            let triangles: usize = mesh(Ok(opened)).primitives.iter().map(|p| p.triangles.len()).sum();
            assert!((1..=3).contains(&triangles), "{length}");
        }
    }
    for length in 0..COLOURS.len() {
        folder.write("my colours.mtl", &COLOURS[..length]);
        if let Err(error) = folder.open("a.obj", TWO) {
            let _ = error.to_string();
        }
    }
}
