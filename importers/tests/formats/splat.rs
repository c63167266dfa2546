//! Splats in `.splat`.

use crate::common::{Folder, splats};
use glam::{Mat3, Vec3};
use oblate_engine::{Material, OpacityFilter, Splats, Strength};
use oblate_importers::Note;

/// Centre and σ, then bytes of colour, opacity and rotation.
fn row(numbers: [f32; 6], bytes: [u8; 8]) -> Vec<u8> {
    [numbers.iter().flat_map(|number| number.to_le_bytes()).collect(), bytes.to_vec()].concat()
}

const UNTURNED: [u8; 8] = [255, 128, 0, 51, 255, 128, 128, 128];

/// Three splats.
pub(crate) fn example() -> Vec<u8> {
    [
        row([0.0, 0.0, 0.0, 1.0, 2.0, 3.0], UNTURNED),
        row([1.0, -2.0, 3.0, 0.5, 0.25, 0.0], [1, 2, 3, 255, 0, 128, 128, 128]),
        row([1e30, 0.0, 0.0, 1.0, 1.0, 1.0], [0, 0, 0, 0, 128, 128, 0, 255]),
    ]
    .concat()
}

fn open(bytes: Vec<u8>) -> Splats {
    splats(Folder::new().open("a.splat", bytes))
}

#[test]
fn rows_are_splats() {
    let splats = open(row([1.5, -2.0, 3.0, 1.0, 2.0, 0.0], UNTURNED));
    assert_eq!(splats.centers, [Vec3::new(1.5, -2.0, 3.0)]);
    // Through a logarithm and back, in double precision but for its storage: ln 2 · 2⁻²⁴.
    let factor = splats.shapes.factor(0);
    assert!(factor.abs_diff_eq(Mat3::from_diagonal(Vec3::new(1.0, 2.0, 0.0)), 2e-7), "{factor}");
    assert_eq!(factor.z_axis, Vec3::ZERO);
    let Strength::Opacity { peaks, filter, least } = &splats.strength else {
        panic!("opacities are expected")
    };
    assert_eq!((&peaks[..], *filter), (&[0.2][..], OpacityFilter::Classic));
    assert_eq!(*least, Strength::LEAST_OF_TRAINED);
    // sRGB's 128/255.
    let [r, g, b] = splats.colors[0];
    assert!(r == 1.0 && (g - 0.215_861).abs() < 1e-6 && b == 0.0, "{r} {g} {b}");
    assert_eq!((splats.harmonics, splats.normals, splats.material), (None, None, Material::UNLIT));
}

#[test]
fn quaternions_begin_with_w() {
    // 90° about x: w = x, here as −64/128 each; half-axes are (e_x, 2 e_z, −3 e_y).
    let splats = open(row([0.0, 0.0, 0.0, 1.0, 2.0, 3.0], [0, 0, 0, 255, 64, 64, 128, 128]));
    let expected = Mat3::from_cols(Vec3::X, Vec3::Z * 2.0, Vec3::Y * -3.0);
    assert!(splats.shapes.factor(0).abs_diff_eq(expected, 1e-6));
}

#[test]
fn what_is_no_splat_is_left_out() {
    let good = row([0.0, 0.0, 0.0, 1.0, 1.0, 1.0], UNTURNED);
    for (numbers, bytes, reason) in [
        ([0.0; 6], [128; 8], "with a quaternion of zeros"),
        ([0.0, 0.0, 0.0, 1.0, -1.0, 1.0], UNTURNED, "with a number that is NaN"),
        ([f32::INFINITY, 0.0, 0.0, 1.0, 1.0, 1.0], UNTURNED, "with a number that is NaN"),
        ([0.0, 0.0, 0.0, 1.0, 1.0, 1e30], UNTURNED, "with a log scale"),
    ] {
        let opened = Folder::new().open("a.SPLAT", [good.clone(), row(numbers, bytes)].concat()).unwrap();
        let [Note::LeftOut(said)] = &opened.notes[..] else { panic!("nothing is said of {reason}") };
        assert!(said.starts_with(&format!("1 of 2 splats: 1 {reason}")), "{said}");
        Folder::new().refused("a.splat", row(numbers, bytes), &["no splats in it", reason]);
    }
}

#[test]
fn many_rows_are_read_in_parts() {
    // More than are read at a time, and not a multiple of it.
    let count = (1 << 14) + 5;
    let rows = (0..count).flat_map(|i| row([i as f32, 0.0, 0.0, 1.0, 1.0, 1.0], UNTURNED)).collect();
    let splats = open(rows);
    assert!(splats.centers.iter().enumerate().all(|(i, center)| center.x == i as f32));
    assert_eq!(splats.centers.len(), count);
}

#[test]
fn sizes_are_checked() {
    Folder::new().refused("a.splat", [0; 33], &["33 bytes", "32 for each splat"]);
    Folder::new().refused("a.splat", [], &["no splats", "0 rows"]);
}
