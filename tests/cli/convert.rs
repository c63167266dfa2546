//! `oblate convert`: what is written draws the same picture as what was read.

use crate::place::{Workplace, levels};

const PICTURE: [&str; 9] =
    ["--size", "48x48", "--eye", "3,2,-6", "--target", "0,0,0", "--up", "0,1,0", "--quiet"];

fn draw(place: &Workplace, file: &str, picture: &str) -> image::RgbaImage {
    place.run(&[&["render", file, "-o", picture], &PICTURE[..]].concat());
    levels(&place.path(picture))
}

/// The largest difference of two pictures in levels, of which at least one shows something.
fn difference(a: &image::RgbaImage, b: &image::RgbaImage) -> u8 {
    assert!(a.pixels().any(|pixel| pixel != a.get_pixel(0, 0)), "the picture is empty");
    a.iter().zip(b.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

/// A few dozen Gaussians of all sizes, turned in all directions, with harmonics of degree 1.
fn trained(place: &Workplace, name: &str) {
    let names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"];
    let names = names.map(str::to_owned).into_iter().chain((0..4).map(|i| format!("rot_{i}")));
    let names = names.chain((0..9).map(|i| format!("f_rest_{i}")));
    let mut file = "ply\nformat binary_little_endian 1.0\nelement vertex 40\n".to_owned();
    names.for_each(|name| file += &format!("property float {name}\n"));
    let mut file = (file + "end_header\n").into_bytes();
    for splat in 0..40_u32 {
        // Digits of an irrational number, from −1 to 1.
        let number = |column: u32| (f64::from(splat * 23 + column) * 0.618_033_988_75).fract() * 2.0 - 1.0;
        let value = |column: u32| match column {
            6 => 2.0 * number(column),
            7..10 => -2.0 + number(column),
            14.. => 0.2 * number(column),
            _ => number(column),
        };
        file.extend((0..23).flat_map(|column| (value(column) as f32).to_le_bytes()));
    }
    place.write(name, file);
}

#[test]
fn trained_splats_go_from_format_to_format() {
    let place = Workplace::new();
    trained(&place, "a.ply");
    let original = draw(&place, "a.ply", "a.png");
    // What was up in a.ply, −y, is +y in glTF and what is made of it: half a turn about x.
    let turned = ["--eye", "3,-2,6", "--target", "0,0,0", "--up", "0,-1,0", "--size", "48x48", "--quiet"];
    // Levels that the formats' own rounding may move a pixel by: .splat has 8 bits for colours, opacities and rotations
    // (a half level each, for about three splats one behind the other) and no harmonics.
    for (from, to, most) in [
        ("a.ply", "b.ply", 0),
        ("a.ply", "c.glb", 1),
        ("c.glb", "d.ply", 1),
        ("a.ply", "e.spz", 8),
        ("e.spz", "f.ply", 8),
    ] {
        let [_, said] = place.run(&["convert", from, to]);
        assert!(said.contains(&format!("wrote {to} as ")) && said.contains("40 splats"), "{said}");
        let view = if ["c.glb", "d.ply"].contains(&to) { &turned } else { &PICTURE };
        place.run(&[&["render", to, "-o", "b.png"], &view[..]].concat());
        let found = difference(&original, &levels(&place.path("b.png")));
        assert!(found <= most, "{from} to {to}: {found} levels");
    }
    // Framed by themselves they stand the same way.
    let framed = ["a.ply", "c.glb"].map(|file| {
        place.run(&["render", file, "-o", "b.png", "--size", "48x48", "--quiet"]);
        levels(&place.path("b.png"))
    });
    let found = difference(&framed[0], &framed[1]);
    assert!(found <= 2, "{found} levels");
    let [_, said] = place.run(&["convert", "a.ply", "g.splat"]);
    assert!(said.contains("left out") && said.contains("harmonics"), "{said}");
    place.run(&["convert", "g.splat", "h.ply"]);
    let found = difference(&draw(&place, "g.splat", "b.png"), &draw(&place, "h.ply", "b.png"));
    assert!(found == 0, "{found} levels");
}

#[test]
fn surfaces_become_surfels() {
    let place = Workplace::new();
    place.cube();
    place.ball();
    for (from, options) in [
        ("cube.obj", &["--surfels", "4000"][..]),
        ("ball_16x16x16_uint8.raw", &["--iso", "100"]),
        ("ball_16x16x16_uint8.raw", &["--transfer", "grey"]),
    ] {
        place.run(&[&["convert", from, "a.ply"], options].concat());
        let volume = ["--eye", "30,20,50", "--target", "7.5,7.5,7.5"];
        let view = if from.starts_with("cube") {
            &PICTURE[..]
        } else {
            &[&volume[..], &["--size", "48x48", "--quiet"]].concat()
        };
        let up = if from.starts_with("cube") { &[][..] } else { &["--up", "0,0,1"] };
        let pictures = [(from, options), ("a.ply", &[][..])].map(|(file, options)| {
            place.run(&[&["render", file, "-o", "a.png"], options, view, up].concat());
            levels(&place.path("a.png"))
        });
        let found = difference(&pictures[0], &pictures[1]);
        // Numbers are written as they are.
        assert!(found <= 1, "{from}: {found} levels");
    }
    let [out, _] = place.run(&["info", "a.ply"]);
    assert!(out.contains("mass"), "{out}");
}

#[test]
fn surfels_stand_where_they_stood() {
    let place = Workplace::new();
    place.ball();
    let ball = std::fs::read(place.path("ball_16x16x16_uint8.raw")).unwrap();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nencoding: raw\nspace dimension: 3\n\
        space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (100,-50,20)\n\n";
    place.write("a.nrrd", [header.as_bytes(), &ball].concat());
    let [_, said] = place.run(&["convert", "a.nrrd", "a.ply", "--iso", "100"]);
    assert!(!said.contains("place"), "{said}");
    assert!(said.contains("left out: that +z is up"), "{said}");
    let view = ["--eye", "130,-30,70", "--target", "107.5,-42.5,27.5", "--up", "0,0,1", "--size", "48x48"];
    let pictures = [&["a.nrrd", "--iso", "100"][..], &["a.ply"]].map(|file| {
        place.run(&[&["render", "-o", "a.png"], file, &view].concat());
        levels(&place.path("a.png"))
    });
    // Centres of up to 107 are rounded to 2⁻¹⁸, a hundred-thousandth of a voxel.
    let found = difference(&pictures[0], &pictures[1]);
    assert!(found <= 1, "{found} levels");
}

/// Of splats in oblate's own PLY what is up goes by what they are.
#[test]
fn what_is_up_is_said_where_programs_take_another_axis() {
    let place = Workplace::new();
    place.ball();
    place.run(&["convert", "ball_16x16x16_uint8.raw", "surfels.ply", "--iso", "100", "--quiet"]);
    place.run(&["convert", "surfels.ply", "trained.ply", "--as", "gaussian-ply", "--quiet"]);
    let [_, same] = place.run(&["convert", "trained.ply", "a.ply", "--as", "surfel-ply"]);
    assert!(!same.contains("is up"), "{same}");
    // Turned upright.
    place.run(&["convert", "trained.ply", "a.glb", "--quiet"]);
    let [_, other] = place.run(&["convert", "a.glb", "a.ply", "--as", "surfel-ply"]);
    assert!(other.contains("left out: that +y is up") && other.contains("take −y"), "{other}");
}

/// Half a unit is what single precision has five million units away.
#[test]
fn places_on_maps_are_kept() {
    let place = Workplace::new();
    place.ball();
    let points: String = (0..50).map(|i| format!("{} {} 7\n", 500_000 + i % 7, 5_000_000 + i / 7)).collect();
    place.write("a.xyz", points);
    let ball = std::fs::read(place.path("ball_16x16x16_uint8.raw")).unwrap();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nencoding: raw\nspace dimension: 3\n\
        space directions: (0.4,0,0) (0,0.4,0) (0,0,0.4)\nspace origin: (500000,5000000,4)\n\n";
    place.write("a.nrrd", [header.as_bytes(), &ball].concat());
    let view =
        ["--eye", "500003,5000003,30", "--target", "500003,5000003,7", "--up", "0,1,0", "--size", "48x48"];
    let picture = |file: &[&str]| {
        place.run(&[&["render", "-o", "a.png"], file, &view].concat());
        levels(&place.path("a.png"))
    };
    let iso: &[&str] = &["--iso", "100"];
    for (command, from, options) in
        [("convert", "a.xyz", &[][..]), ("convert", "a.nrrd", iso), ("extract", "a.nrrd", iso)]
    {
        let to: &[&str] = if command == "extract" { &["-o", "b.ply"] } else { &["b.ply"] };
        let [_, said] = place.run(&[&[command, from], to, options].concat());
        assert!(!said.contains("the place"), "{said}");
        // Numbers relative to the origin are as they were.
        let found = difference(&picture(&[&[from], options].concat()), &picture(&["b.ply"]));
        assert!(found <= 1, "{command} {from}: {found} levels");
        let [out, _] = place.run(&["info", "b.ply"]);
        assert!(out.contains("50000"), "{out}");
    }
    // Other formats have no room for it.
    let [_, said] = place.run(&["convert", "b.ply", "b.spz"]);
    assert!(said.contains("left out: the place 500000,5000000,4"), "{said}");
}

#[test]
fn volumes_go_from_format_to_format() {
    let place = Workplace::new();
    place.ball();
    place.run(&["convert", "ball_16x16x16_uint8.raw", "a.nrrd", "--spacing", "1,2,3"]);
    place.run(&["convert", "a.nrrd", "b.vti"]);
    place.run(&["convert", "b.vti", "c.nrrd"]);
    let told = ["a.nrrd", "b.vti", "c.nrrd"].map(|name| {
        let [json, _] = place.run(&["info", name, "--json"]);
        let mut value: serde_json::Value = serde_json::from_str(&json).unwrap();
        value.as_object_mut().unwrap().retain(|key, _| key != "file" && key != "format");
        value
    });
    assert_eq!(told[0]["spacing"], serde_json::json!([1.0, 2.0, 3.0]));
    assert!(told[0] == told[1] && told[1] == told[2], "{told:?}");
}

#[test]
fn names_of_spaces_are_kept_and_compared() {
    let place = Workplace::new();
    place.ball();
    place.run(&["convert", "ball_16x16x16_uint8.raw", "a.nrrd"]);
    let unnamed = std::fs::read(place.path("a.nrrd")).unwrap();
    let named = |name: &str| {
        let line = b"space dimension: 3\n";
        let at = unnamed.windows(line.len()).position(|part| part == line).unwrap();
        let line_of = format!("space: {name}\n");
        [&unnamed[..at], line_of.as_bytes(), &unnamed[at + line.len()..]].concat()
    };
    place.write("ras.nrrd", named("right-anterior-superior"));
    place.write("lps.nrrd", named("LPS"));
    place.run(&["convert", "ras.nrrd", "b.nrrd"]);
    assert_eq!(std::fs::read(place.path("b.nrrd")).unwrap(), named("right-anterior-superior"));
    let [told, _] = place.run(&["info", "lps.nrrd"]);
    assert!(told.contains("space       left-posterior-superior"), "{told}");
    let [_, said] = place.run(&["convert", "ras.nrrd", "b.vti"]);
    assert!(said.contains("left out: the name of the space, right-anterior-superior"), "{said}");
    let meet = "space named right-anterior-superior";
    let drawn = |args: &[&str]| place.run(&[&["render", "--size", "16x16"], args].concat())[1].contains(meet);
    assert!(drawn(&["ras.nrrd", "lps.nrrd"]) && !drawn(&["ras.nrrd", "a.nrrd", "b.nrrd"]));
    assert!(drawn(&["ras.nrrd", "--iso", "100", "--color-by", "lps.nrrd"]));
    let turned =
        "version = 1\n[[volume]]\npath = 'ras.nrrd'\n[[volume]]\npath = 'lps.nrrd'\nrotate = [0, 0, 180]\n";
    place.write("turned.toml", turned);
    assert!(!drawn(&["turned.toml"]));
}

#[test]
fn what_does_not_fit_is_refused_and_leaves_no_file() {
    let place = Workplace::new();
    place.cube();
    place.ball();
    trained(&place, "a.ply");
    let before = place.files();
    for (args, says) in [
        (&["cube.obj", "a.stl"][..], ".ply, .splat, .spz, .glb, .nrrd and .vti"),
        (&["cube.obj", "a"], ".ply, .splat"),
        (&["a.ply", "a.Compressed.ply"], "packed PLY is read, but not written"),
        (&["cube.obj", "a.nrrd"], "volume"),
        (&["a.ply", "a.vti"], "volume"),
        (&["ball_16x16x16_uint8.raw", "a.splat"], "--iso or --transfer"),
        (&["ball_16x16x16_uint8.raw", "b.ply", "--iso", "50,100"], "2 sets of splats"),
        (&["ball_16x16x16_uint8.raw", "b.spz", "--transfer", "grey"], "opacit"),
        (&["ball_16x16x16_uint8.raw", "b.ply", "--iso", "250"], "nothing"),
        (&["cube.obj", "b.ply", "--iso", "3"], "--iso is for volumes"),
        (&["cube.obj", "b.ply", "--as", "stl"], "formats are surfel-ply, gaussian-ply"),
        (&["ball_16x16x16_uint8.raw", "b.vti", "--iso", "50"], "holds a volume as it is"),
        (&["missing.obj", "b.ply"], "missing.obj"),
        (&["cube.obj", "nowhere/b.ply"], "cannot write nowhere/b.ply"),
    ] {
        let message = place.refusal(&[&["convert"], args].concat());
        assert!(message.contains(says), "{args:?}: {message}");
    }
    assert_eq!(place.files(), before);
}
