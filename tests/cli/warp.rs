//! `oblate warp`.

use crate::place::{Workplace, levels};
use image::RgbaImage;
use serde_json::Value;

const SIZE: [usize; 2] = [64, 48];

/// A photograph of a checkered wall 2 m away and its depths in millimetres; poses at the origin and 0.1 m to the right, which moves the wall by
/// 3 px.
fn room() -> Workplace {
    let place = Workplace::new();
    let mut photograph = b"P6 64 48 255\n".to_vec();
    let mut depths = b"P5 64 48 65535\n".to_vec();
    for at in 0..SIZE[0] * SIZE[1] {
        let (x, y) = (at % SIZE[0], at / SIZE[0]);
        let bright = (x / 8 + y / 8).is_multiple_of(2);
        photograph.extend(if bright { [200, 150, 100] } else { [40, 60, 80] });
        depths.extend(2000_u16.to_be_bytes());
    }
    place.write("photo.ppm", photograph);
    place.write("depth.pgm", depths);
    place.write("here.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    place.write(
        "log.txt",
        "0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 1 0\n1 0 0 0.1\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
    );
    place
}

const WALL: [&str; 5] = ["warp", "photo.ppm", "depth.pgm", "--intrinsics", "60,60,31.5,23.5"];

fn with<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&WALL[..], more].concat()
}

/// Red, green, blue and alpha.
fn pixel(picture: &RgbaImage, x: u32, y: u32) -> [i32; 4] {
    picture.get_pixel(x, y).0.map(i32::from)
}

fn near(a: [i32; 4], b: [i32; 4]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 3)
}

#[test]
fn a_wall_moves_by_its_disparity() {
    let place = room();
    let [out, err] = place.run(&with(&["--to", "log.txt:1", "-o", "w.png", "--stats", "-"]));
    assert!(err.contains("wrote w.png, 64×48"), "{err}");
    let stats: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(stats["surfels"], 64 * 48);
    // Three columns have gone out at the left; at the right nothing is shown in three, of which the border may take one.
    let holes = stats["holes"].as_u64().unwrap();
    assert!((2 * 48..=3 * 48).contains(&holes), "{holes}");
    let shown = levels(&place.path("w.png"));
    for (x, y) in [(4, 4), (12, 20), (36, 36), (44, 28)] {
        // Middles of fields of eight pixels, moved to the left by three.
        let bright = (x / 8 + y / 8) % 2 == 0;
        let wanted = if bright { [200, 150, 100, 255] } else { [40, 60, 80, 255] };
        assert!(near(pixel(&shown, x - 3, y), wanted), "{x}, {y}: {:?}", pixel(&shown, x - 3, y));
    }
    assert_eq!(pixel(&shown, 63, 20)[3], 0);

    // Beside the photograph nothing is filled in.
    let [out, _] = place.run(&with(&["--to", "log.txt:1", "--fill", "-o", "f.png", "--stats", "-", "-q"]));
    let stats: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&stats["filled"], &stats["holes"]), (&0.into(), &holes.into()));
}

#[test]
fn what_a_box_hid_is_filled_from_the_wall() {
    let place = room();
    // A box of 16×16 pixels, 1 m away, moves by 6 px, the wall behind it by 3.
    let is_box = |at: usize| (24..40).contains(&(at % SIZE[0])) && (16..32).contains(&(at / SIZE[0]));
    let depth = |at: usize| if is_box(at) { 1000_u16 } else { 2000 };
    let depths = (0..SIZE[0] * SIZE[1]).flat_map(|at| depth(at).to_be_bytes());
    place.write("depth.pgm", b"P5 64 48 65535\n".iter().copied().chain(depths).collect::<Vec<u8>>());
    let mut stats = ["w.png", "f.png"].map(|name| {
        let fill: &[&str] = if name == "f.png" { &["--fill"] } else { &[] };
        let args = [&with(&["--to", "log.txt:1", "-o", name, "--stats", "-", "-q"])[..], fill].concat();
        serde_json::from_str::<Value>(&place.run(&args)[0]).unwrap()
    });
    let [open, filled] = stats.each_mut().map(|stats| [stats["holes"].take(), stats["filled"].take()]);
    assert_eq!(open[1], 0);
    // Three columns of sixteen rows; the rims of both may be seen through by half.
    let count = filled[1].as_u64().unwrap();
    assert!((16..=5 * 16).contains(&count), "{count}");
    assert_eq!(filled[0], open[0]);
    let [open, filled] = ["w.png", "f.png"].map(|name| levels(&place.path(name)));
    let hidden = |picture: &RgbaImage| (16..32).filter(|y| pixel(picture, 35, *y)[3] < 128).count();
    assert_eq!([hidden(&open), hidden(&filled)], [16, 0]);
}

#[test]
fn depths_are_read_as_they_are_meant() {
    let place = room();
    place.run(&with(&["--to", "log.txt:1", "-o", "a.exr"]));
    // 2 m as 1/5000 of it, and as a disparity of 60 · 0.1 m / 2 m = 3 px.
    let tenth: Vec<u8> = [b"P5 64 48 65535\n".to_vec(), 10_000_u16.to_be_bytes().repeat(64 * 48)].concat();
    place.write("tum.pgm", tenth);
    place.write("disparity.pgm", [b"P5 64 48 255\n".to_vec(), vec![12; 64 * 48]].concat());
    let others = [("tum.pgm", ["--depth-scale", "1/5000"]), ("disparity.pgm", ["--disparity", "6,0,4"])];
    for (depth, options) in others {
        let args =
            [&["warp", "photo.ppm", depth], &WALL[3..], &options[..], &["--to", "log.txt:1", "-o", "b.exr"]];
        place.run(&args.concat());
        let [out, _] = place.run(&["compare", "a.exr", "b.exr", "--max", "1e-5"]);
        assert!(out.contains("largest error"), "{out}");
    }
}

#[test]
fn two_photographs_show_more_than_one() {
    let place = room();
    let both =
        ["warp", "photo.ppm", "depth.pgm", "photo.ppm", "depth.pgm", "--intrinsics", "60,60,31.5,23.5"];
    let poses =
        ["--pose", "log.txt:0", "--pose", "log.txt:1", "--to", "log.txt:1", "-o", "w.png", "--stats", "-"];
    let [out, _] = place.run(&[&both[..], &poses[..]].concat());
    let stats: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&stats["surfels"], &stats["holes"]), (&(2 * 64 * 48).into(), &0.into()));
}

#[test]
fn a_sequence_is_an_animation_and_its_frames() {
    let place = room();
    let [_, said] = place.run(&with(&["--sequence", "log.txt", "--frames", "3", "-o", "way.png"]));
    assert!(said.contains("wrote way.png, 64×48, 3 frames, way-0000.png to way-0002.png"), "{said}");
    assert!(!said.contains("there before"), "{said}");
    let files = place.files();
    for name in ["way.png", "way-0000.png", "way-0001.png", "way-0002.png"] {
        assert!(files.iter().any(|file| file == name), "{files:?}");
    }
    let bytes = std::fs::read(place.path("way.png")).unwrap();
    let find = |name: &[u8]| bytes.windows(name.len()).filter(|window| *window == name).count();
    assert_eq!([find(b"acTL"), find(b"fcTL")], [1, 3]);
    // The last frame is what is seen from the last pose.
    place.run(&with(&["--to", "log.txt:1", "-o", "end.png", "-q"]));
    place.run(&["compare", "way-0002.png", "end.png", "--max", "0"]);
    let half = levels(&place.path("way-0001.png"));
    // One and a half columns are free, of which the border takes less than one.
    let [inside, outside] = [61, 63].map(|x| pixel(&half, x, 20)[3]);
    assert!(inside == 255 && outside < 64, "{inside} {outside}");
}

/// Frames that a shorter sequence doesn't write over are told, and left.
#[test]
fn frames_of_earlier_sequences_are_told() {
    let place = room();
    for (count, told) in [
        ("4", None),
        ("3", Some("way-0003.png was there before")),
        ("1", Some("way-0001.png to way-0003.png were there before")),
    ] {
        let [_, said] = place.run(&with(&["--sequence", "log.txt", "--frames", count, "-o", "way.png"]));
        assert!(told.map_or(!said.contains("there before"), |told| said.contains(told)), "{said}");
    }
    assert!(place.files().contains(&"way-0003.png".into()));
    // Nor is a frame written over what is read.
    image::RgbImage::new(64, 48).save(place.path("photo-0001.png")).unwrap();
    let args = ["warp", "photo-0001.png", "depth.pgm"];
    let said = place.refusal(&[&args, &WALL[3..], &["--sequence", "log.txt", "-o", "photo.png"]].concat());
    assert!(said.contains("would overwrite what is read as photo-0001.png"), "{said}");
    let said = place.refusal(&with(&["--to", "log.txt:1", "--stats", "log.txt"]));
    assert!(said.contains("would overwrite what is read as log.txt"), "{said}");
}

#[test]
fn what_is_wrong_is_said() {
    let place = room();
    place.write("small.pgm", b"P5 2 1 65535\n\0\x10\0\x10");
    place.write("none.pgm", [b"P5 64 48 65535\n".to_vec(), vec![0; 2 * 64 * 48]].concat());
    let pair = |depth: &'static str, more: &[&'static str]| {
        [&["warp", "photo.ppm", depth], &WALL[3..], &["--to", "here.txt"], more].concat()
    };
    let cases: [(Vec<&str>, &str); 15] = [
        (pair("small.pgm", &[]), "photo.ppm has 64×48 pixels and small.pgm 2×1; they must be registered"),
        (pair("none.pgm", &[]), "no pixel has a depth"),
        (pair("photo.ppm", &[]), "photo.ppm"),
        (pair("missing.png", &[]), "missing.png"),
        (pair("depth.pgm", &["--pose", "here.txt", "--pose", "here.txt"]), "1 photographs and 2 --pose"),
        (pair("depth.pgm", &["--depth-scale", "0"]), "no number above 0"),
        (pair("depth.pgm", &["-o", "w.jpg"]), "pictures are written as .png or .exr"),
        (with(&["--to", "log.txt"]), "2 poses; say which"),
        (with(&["--to", "log.txt:2"]), "there is no number 2"),
        (with(&["--sequence", "log.txt", "-o", "way.exr"]), "a sequence is written as .png"),
        (with(&["--to", "log.txt", "--frames", "3"]), "--frames"),
        (with(&["--to", "log.txt", "--rate", "3"]), "--rate"),
        (with(&["--sequence", "log.txt", "--frames", "4000000000"]), "it must be from 1 to 65535"),
        (with(&["--to", "here.txt", "--repeat", "3"]), "--stats"),
        (
            vec!["warp", "photo.ppm", "depth.pgm", "--intrinsics", "60,-60,31,23", "--to", "here.txt"],
            "focal length",
        ),
    ];
    for (args, wanted) in cases {
        let said = place.refusal(&args);
        assert!(said.contains(wanted), "{args:?}: {said}");
        assert_eq!(said.matches("error:").count(), 1, "{said}");
    }
    assert!(!place.files().iter().any(|file| file.ends_with("warp.png")));
}
