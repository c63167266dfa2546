//! PCD.

use crate::common::{Folder, points, refused};
use glam::{DVec3, Vec3, dvec3, vec3};
use oblate_engine::color::srgb_to_linear;
use oblate_importers::{Note, OpenOptions};

/// Two points with all that is read and two fields that aren't; the second has no normal.
pub(crate) fn header(data: &str) -> String {
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x label y z rgb histogram normal_x normal_y normal_z intensity\n\
         SIZE 8 1 4 4 4 2 4 4 4 1\nTYPE F U F F F I F F F U\nCOUNT 1 1 1 1 1 3 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 1 2 3.5 1 0 0 0\n\
         POINTS 2\nDATA {data}\n"
    )
}

fn fields() -> [Vec<Vec<u8>>; 2] {
    let point = |x: f64, y: f32, z: f32, color: u32, normal: [f32; 3], intensity: u8| {
        let normal = normal.map(|c| c.to_le_bytes().to_vec());
        let [nx, ny, nz] = normal;
        let histogram = [1_i16, 2, 3].map(i16::to_le_bytes).concat();
        let (x, y, z) = (x.to_le_bytes().to_vec(), y.to_le_bytes().to_vec(), z.to_le_bytes().to_vec());
        vec![x, vec![9], y, z, color.to_le_bytes().to_vec(), histogram, nx, ny, nz, vec![intensity]]
    };
    [
        point(500_000.25, -2.0, 3.0, 0x00ff_8000, [0.0, 0.0, 1.0], 200),
        point(500_001.25, 4.0, 5.0, 0xff00_00ff, [f32::NAN; 3], 10),
    ]
}

pub(crate) fn ascii() -> String {
    let color = |bits: u32| f32::from_bits(bits);
    format!(
        "{}500000.25 9 -2 3 {:e} 1 2 3 0 0 1 200\n\n500001.25 9 4 5 {:e} 1 2 3 nan nan nan 10\n",
        header("ascii"),
        color(0x00ff_8000),
        color(0x0000_00ff)
    )
}

pub(crate) fn binary() -> Vec<u8> {
    [header("binary").into_bytes(), fields().concat().concat()].concat()
}

/// Only literals, as LZF allows.
pub(crate) fn compressed() -> Vec<u8> {
    let [first, second] = fields();
    let columns: Vec<u8> = first.into_iter().zip(second).flat_map(|(a, b)| [a, b].concat()).collect();
    let packed: Vec<u8> =
        columns.chunks(32).flat_map(|part| [&[part.len() as u8 - 1], part].concat()).collect();
    let sizes = [packed.len(), columns.len()].map(|size| (size as u32).to_le_bytes()).concat();
    [header("binary_compressed").into_bytes(), sizes, packed].concat()
}

#[test]
fn three_encodings() {
    let folder = Folder::new();
    for bytes in [ascii().into_bytes(), binary(), compressed()] {
        let cloud = points(folder.open("a.pcd", bytes));
        let place = |i: usize| cloud.origin + cloud.positions[i].as_dvec3();
        assert_eq!([place(0), place(1)], [dvec3(500_000.25, -2.0, 3.0), dvec3(500_001.25, 4.0, 5.0)]);
        let orange = [1.0, 128.0 / 255.0, 0.0].map(srgb_to_linear);
        assert_eq!(cloud.colors, Some(vec![orange, [0.0, 0.0, 1.0]]));
        assert_eq!(cloud.normals, Some(vec![Vec3::Z, Vec3::ZERO]));
        assert_eq!(cloud.intensities, Some(vec![200.0, 10.0]));
        assert_eq!((cloud.viewpoint, cloud.radii), (Some(dvec3(1.0, 2.0, 3.5)), None));
    }
}

#[test]
fn organised_clouds_have_holes() {
    let text = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 2\nDATA ascii\n\
        0.5 0 0\nnan nan nan\n1 2 3\n-1 -2 inf";
    let opened = Folder::new().open("a.pcd", text).unwrap();
    assert_eq!(opened.notes, [Note::LeftOut("2 of 4 points, with numbers that are not finite".into())]);
    let cloud = points(Ok(opened));
    assert_eq!((cloud.origin, cloud.viewpoint), (DVec3::ZERO, None));
    assert_eq!(cloud.positions, [vec3(0.5, 0.0, 0.0), vec3(1.0, 2.0, 3.0)]);
}

#[test]
fn what_is_refused() {
    let folder = Folder::new();
    let refuse = |from: &str, to: &str, parts: &[&str]| {
        let text = ascii();
        assert!(text.contains(from), "{from}");
        folder.refused("a.pcd", text.replace(from, to), parts);
    };
    refuse("DATA ascii", "DATA zip", &["line 11", "ascii, binary and binary_compressed are supported"]);
    refuse("VERSION", "NOISE", &["line 2", "\"NOISE\" is not a word of a PCD header"]);
    refuse("SIZE 8 1", "SIZE 1", &["line 11", "10 fields with 9 sizes, 10 types and 10 counts"]);
    refuse("SIZE 8", "SIZE 3", &["field x", "type F of 3 bytes"]);
    refuse("COUNT 1", "COUNT x", &["field x", "\"x\" is no number"]);
    refuse("FIELDS x", "FIELDS w", &["need the fields x, y and z"]);
    refuse("4 2 4", "8 2 4", &["rgb and rgba have 4 bytes"]);
    refuse("POINTS 2", "POINTS 3", &["line 11", "3 points, but width times height is 2"]);
    refuse("WIDTH 2", "WIDTH -2", &["line 7", "\"-2\" is no number"]);
    refuse("WIDTH 2", "WIDTH 2 2", &["line 7", "WIDTH has one number"]);
    refuse("VIEWPOINT 1", "VIEWPOINT", &["line 9", "seven numbers"]);
    refuse("SIZE 8 1 4 4 4 2 4 4 4 1\n", "", &["no SIZE before DATA"]);
    refuse("DATA ascii\n", "", &["line 11", "is not a word"]);
    refuse("-2 3", "-2", &["line 12", "11 values; each point has 12"]);
    refuse("-2 3", "-2 x", &["line 12", "no number"]);
    refuse("500001.25 9", "500001.25 9\n", &["line 14", "2 values"]);
    refuse("10\n", "10\n1 2 3\n", &["line 15", "more lines than 2 points"]);
    let counted = |count: &str| {
        ascii().replace("POINTS 2", &format!("POINTS {count}")).replace("WIDTH 2", &format!("WIDTH {count}"))
    };
    folder.refused("a.pcd", counted("3"), &["ends before point 2 of 3"]);
    folder.refused("a.pcd", counted("99999999999"), &["99999999999 points need at least 24 bytes each"]);
    folder.refused("a.pcd", "VERSION .7\nFIELDS x y z\n", &["no DATA line"]);
    let many = "FIELDS x ".to_owned() + &"a ".repeat(40_000);
    refuse("FIELDS x", &many, &["line 3", "text of at most 65536 bytes"]);
    let wide = ascii().replace("COUNT 1 1 1 1 1 3", "COUNT 1 1 1 1 1 70000") + &" 1".repeat(150_000);
    folder.refused("a.pcd", wide, &["70009 values of each point; at most 65536"]);

    let cut = |bytes: Vec<u8>, by: usize| bytes[..bytes.len() - by].to_vec();
    folder.refused("a.pcd", cut(binary(), 1), &["middle of point 1"]);
    folder.refused("a.pcd", cut(binary(), 2), &["2 points need at least 40 bytes each, but only 78"]);
    folder.refused("a.pcd", cut(compressed(), 1), &["83 compressed bytes, but only 82"]);
    let begin = header("binary_compressed").len();
    let mut bytes = compressed();
    bytes[begin + 4] = 81;
    folder.refused("a.pcd", &bytes, &["unpack to 81 bytes, but 2 points have 40 bytes each"]);
    let few = OpenOptions { max_memory: 50, ..OpenOptions::default() };
    refused(folder.open_with("a.pcd", compressed(), &few), "a.pcd", &["more than 50 bytes"]);
}
