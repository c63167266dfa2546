//! Points as text.

use crate::common::{Folder, points};
use glam::{dvec3, vec3};
use oblate_engine::color::srgb_to_linear;
use oblate_importers::Note;

#[test]
fn columns_tell_what_they_mean() {
    let folder = Folder::new();
    let read = |name: &str, text: &str| points(folder.open(name, text));
    let plain = read("a.xyz", "\u{feff}0.5 0.25 -3\n\n# a remark\n  1\t2 3e0 \r\n");
    assert_eq!(plain.origin, dvec3(0.0, 0.0, -3.0));
    assert_eq!(plain.positions, [vec3(0.5, 0.25, 0.0), vec3(1.0, 2.0, 6.0)]);
    assert!(plain.colors.is_none() && plain.intensities.is_none() && plain.normals.is_none());

    let far = read("a.asc", "//X;Y;Z;I\n4500000.125;5500000.5;300.25;7\n4500001;5500001;301;9\n");
    assert_eq!(far.origin, dvec3(4_500_000.0, 5_500_000.0, 300.0));
    assert_eq!(far.positions, [vec3(0.125, 0.5, 0.25), vec3(1.0, 1.0, 1.0)]);
    assert_eq!(far.intensities, Some(vec![7.0, 9.0]));

    assert_eq!(read("b.csv", "1, 2, 3\n1,2,-3\n").positions[1], vec3(0.0, 0.0, -6.0));

    let colors = |values: [f32; 3]| Some(vec![values.map(srgb_to_linear)]);
    let bytes = [1.0, 128.0 / 255.0, 2.0 / 255.0];
    assert_eq!(read("a.csv", "x,y,z,r,g,b\n0,0,0,255,128,2\n").colors, colors(bytes));
    assert_eq!(read("a.xyzrgb", "0 0 0 1 0.5 0.25").colors, colors([1.0, 0.5, 0.25]));
    assert_eq!(read("a.txt", "0 0 0 65535 256 0").colors, colors([1.0, 256.0 / 65535.0, 0.0]));
    assert_eq!(
        read("a.xyzn", "0 0 0 0 0 1\n1 0 0 0.6 -0.8 0").normals,
        Some(vec![vec3(0.0, 0.0, 1.0), vec3(0.6, -0.8, 0.0)])
    );

    assert_eq!(read("b.xyzn", "0 0 0 0 0 1").normals, Some(vec![vec3(0.0, 0.0, 1.0)]));

    let pts = read("a.pts", "1\n1 2 3 -500 255 128 2\n");
    assert_eq!((pts.colors, pts.intensities), (colors(bytes), Some(vec![-500.0])));
    // Scalars behind colours: as named, or as numbers show.
    let named = "//X Y Z R G B Scalar_field\n1 2 3 255 128 2 77\n";
    for text in [named, "1 2 3 255 128 2 -0.5\n4 5 6 0 0 0 8\n", "X;Y;Z;Rf;Gf;Bf;S\n1;2;3;0.5;0;1;9\n"] {
        let read = read("a.asc", text);
        let first = text.split([' ', ';', '\n']).filter_map(|word| word.parse().ok()).nth(6);
        assert_eq!(read.intensities.unwrap().first().copied(), first, "{text}");
        assert!(text.contains("Rf") || read.colors.unwrap()[0] == bytes.map(srgb_to_linear), "{text}");
    }
    let before = read("a.asc", "# x y z scalar r g b\n1 2 3 9 8 7 0.5\n");
    assert_eq!(before.intensities, Some(vec![9.0]));
    let all = read("a.txt", "1 2 3 255 128 2 0 0 -1\n");
    assert_eq!((all.colors, all.normals), (colors(bytes), Some(vec![vec3(0.0, 0.0, -1.0)])));
}

#[test]
fn what_is_assumed_is_said() {
    let notes = |text: &str| Folder::new().open("a.xyz", text).unwrap().notes;
    assert_eq!(notes("0 0 0 9 0 0"), [Note::Assumed("colours go up to 255".into())]);
    let seven = |order: &str, white: u8| {
        let taken = format!("seven columns are x y z {order}");
        [taken, format!("colours go up to {white}")].map(Note::Assumed)
    };
    assert_eq!(notes("0 0 0 9 8 7 6"), seven("intensity red green blue", 255));
    assert_eq!(notes("0 0 0 9 8 7 6.5"), seven("red green blue intensity", 255));
    assert_eq!(notes("1\n0 0 0 9 8 7 6.5").len(), 1);
    assert!(matches!(&notes("0 0 0 0 0 -1")[..], [Note::Assumed(what)] if what.contains("normals")));
    assert_eq!(
        notes("0 0 0\nnan 0 0"),
        [Note::LeftOut("1 of 2 points, with numbers that are not finite".into())]
    );
}

#[test]
fn what_is_refused() {
    let folder = Folder::new();
    for (text, parts) in [
        ("", &["no points in it"][..]),
        ("# nothing\nx y z\n", &["no points in it"]),
        ("nan 0 0\n", &["no points in it", "1 of 1"]),
        ("0 0\n", &["line 1", "2 columns; lines of 3, 4, 6, 7 and 9"]),
        ("0 0 0 0 0 0 0 0 0 0\n", &["line 1", "10 columns"]),
        ("0 0 0\n1 1 1 1\n", &["line 2", "4 values; the first point has 3"]),
        ("0 0 0\n1 1 a\n", &["line 2", "\"a\" is no number"]),
        ("x y z\na b c\n0 0 0", &["line 2", "\"a\" is no number"]),
        ("0 0 a\n", &["line 1", "\"a\" is no number"]),
        ("3\n0 0 0\n1 1 1\n", &["line 1", "3 points are said to follow; 2 do"]),
        ("3\n", &["line 1", "3 points are said to follow; none does"]),
        ("1\n0 0 0\n1\n0 0 1\n", &["line 3", "one number", "several scans"]),
        ("0 0 0 70000 0 0\n", &["a colour is 70000"]),
        ("0 0 0\n4500000,125;5500000,5;300,25\n", &["line 2", "commas between digits"]),
        ("1,5 2,5 3,5\n", &["line 1", "commas between digits"]),
        ("0 0 0 1 0 -0.5 0\n", &["a colour is -0.5", "x y z intensity r g b"]),
        ("0 0 0 0 -1 0 9 9 9\n", &["a colour is -1", "x y z r g b and a normal"]),
    ] {
        folder.refused("a.xyz", text, parts);
    }
}

#[test]
fn a_first_point_far_from_the_others_is_told() {
    let folder = Folder::new();
    let grid = |first: &str| {
        let row = |i: u32| {
            format!("{} {} 7\n", 500_000.0 + f64::from(i % 30) / 50.0, 4e6 + f64::from(i / 30) / 50.0)
        };
        folder.open("a.xyz", first.to_owned() + &(0..900).map(row).collect::<String>()).unwrap().notes
    };
    assert_eq!(grid(""), []);
    // Distances of four million are rounded to a quarter, of points a fiftieth apart.
    let [Note::Rounded(said)] = &grid("0 0 0\n")[..] else { panic!("nothing is said") };
    assert!(said.contains("about 2.0e-2 apart") || said.contains("about 1.9e-2 apart"), "{said}");
}
