//! Splats written and read again.

use super::{ExportError, gaussian_ply, gltf, splat, spz};
use crate::{Content, Note, OpenOptions, open};
use glam::{Mat3, Quat, Vec3};
use oblate_engine::color::linear_to_srgb;
use oblate_engine::{Blend, Harmonics, Material, OpacityFilter, Shapes, Splats, Strength};
use proptest::prelude::*;

fn read(name: &str, bytes: &[u8]) -> (Splats, Vec<Note>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let opened = open(path, &OpenOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    let Content::Splats { splats, blend: Blend::Display, .. } = opened.content else {
        panic!("splats are expected")
    };
    (splats, opened.notes)
}

fn ply(splats: &Splats) -> (Vec<u8>, Vec<Note>) {
    let mut bytes = Vec::new();
    let notes = gaussian_ply::write(splats, Blend::Display, &mut bytes).unwrap();
    (bytes, notes)
}

fn dot_splat(splats: &Splats) -> (Vec<u8>, Vec<Note>) {
    let mut bytes = Vec::new();
    let notes = splat::write(splats, Blend::Display, &mut bytes).unwrap();
    (bytes, notes)
}

fn peaks(splats: &Splats) -> &[f32] {
    let Strength::Opacity { peaks, .. } = &splats.strength else { panic!("opacities are expected") };
    peaks
}

/// Numbers of one splat.
#[derive(Clone, Debug)]
struct One {
    center: [f32; 3],
    q: [f32; 4],
    log_scales: [f32; 3],
    peak: f32,
    color: [f32; 3],
    harmonics: [f32; 9],
}

fn one() -> impl Strategy<Value = One> {
    let three = || prop::array::uniform3(-100.0..100.0_f32);
    let q = prop::array::uniform4(-1.0..1.0_f32)
        .prop_filter("a rotation", |q| q.iter().map(|c| c * c).sum::<f32>() > 0.01);
    let peak = prop_oneof![4 => 0.0..1.0_f32, 1 => Just(0.0), 1 => Just(1.0)];
    let numbers = (three(), q, prop::array::uniform3(-8.0..3.0_f32), peak);
    (numbers, prop::array::uniform3(0.0..2.0_f32), prop::array::uniform9(-3.0..3.0_f32)).prop_map(
        |((center, q, log_scales, peak), color, harmonics)| One {
            center,
            q,
            log_scales,
            peak,
            color,
            harmonics,
        },
    )
}

fn splats(all: &[One], degree: u8, filter: OpacityFilter) -> Splats {
    let factor = |one: &One| {
        let [w, x, y, z] = one.q;
        let rotation = Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize());
        rotation * Mat3::from_diagonal(Vec3::from(one.log_scales).exp())
    };
    let count = (usize::from(degree) + 1).pow(2) - 1;
    let coefficients =
        |one: &One| (0..count).map(|i| [0, 1, 2].map(|c| one.harmonics[(i + 3 * c) % 9])).collect();
    Splats {
        centers: all.iter().map(|one| Vec3::from(one.center)).collect(),
        shapes: Shapes::Each(all.iter().map(factor).collect()),
        strength: Strength::Opacity {
            peaks: all.iter().map(|one| one.peak).collect(),
            filter,
            least: Strength::LEAST_OF_TRAINED,
        },
        colors: all.iter().map(|one| one.color).collect(),
        harmonics: (degree > 0).then(|| Harmonics {
            degree,
            coefficients: all.iter().flat_map(|one| -> Vec<[f32; 3]> { coefficients(one) }).collect(),
        }),
        normals: None,
        material: Material::UNLIT,
    }
    .in_morton_order()
}

fn plain() -> One {
    One {
        center: [1.0, -2.0, 3.0],
        q: [1.0, 0.0, 0.0, 0.0],
        log_scales: [0.0, -1.0, -2.0],
        peak: 0.5,
        color: [0.5; 3],
        harmonics: [0.25; 9],
    }
}

proptest! {
    #[test]
    fn ply_there_and_back(all in prop::collection::vec(one(), 1..20), degree in 0..=3_u8, compensated: bool) {
        let filter = if compensated { OpacityFilter::Compensated } else { OpacityFilter::Classic };
        let before = splats(&all, degree, filter);
        let (after, notes) = read("a.ply", &ply(&before).0);
        prop_assert_eq!(notes, vec![]);
        prop_assert_eq!(&after.centers, &before.centers);
        prop_assert_eq!(&after.harmonics, &before.harmonics);
        let Strength::Opacity { filter: found, .. } = after.strength else { panic!("opacities are expected") };
        prop_assert_eq!(found, filter);
        for i in 0..before.centers.len() {
            let (a, b) = (peaks(&before)[i], peaks(&after)[i]);
            // A logit x is rounded to 2⁻²⁴ x; times the slope of its inverse that is at most 0.224 · 2⁻²⁴. Then the
            // opacity is rounded to 2⁻²⁵.
            prop_assert!((a - b).abs() <= 5e-8, "{} {}", a, b);
            for channel in 0..3 {
                // What the engine's sRGB curve keeps there and back, and the rounding of a coefficient up to 4: 2⁻²³,
                // times 0.28 and the curve's slope of up to 3.
                let (a, b) = (before.colors[i][channel], after.colors[i][channel]);
                prop_assert!((a - b).abs() <= 1e-5 * a.max(0.1) + 2e-7, "{} {}", a, b);
            }
            // As in the records' own test.
            let (a, b) = (before.shapes.factor(i), after.shapes.factor(i));
            let largest = a.x_axis.length().max(a.y_axis.length()).max(a.z_axis.length());
            prop_assert!(a.abs_diff_eq(b, 2e-6 * largest), "{} {}", a, b);
        }
    }

    #[test]
    fn splat_there_and_back(all in prop::collection::vec(one(), 1..20)) {
        let before = splats(&all, 0, OpacityFilter::Classic);
        let (after, _) = read("a.splat", &dot_splat(&before).0);
        prop_assert_eq!(&after.centers, &before.centers);
        for i in 0..before.centers.len() {
            // Half a step of 255.
            prop_assert!((peaks(&before)[i] - peaks(&after)[i]).abs() <= 0.5 / 255.0 + 1e-7);
            for channel in 0..3 {
                let [a, b] = [&before, &after].map(|splats| linear_to_srgb(splats.colors[i][channel]));
                prop_assert!((a.min(1.0) - b).abs() <= 0.5 / 255.0 + 1e-5);
            }
            let [a, b] = [&before, &after].map(|splats| splats.shapes.factor(i).as_dmat3());
            for axis in 0..3 {
                let [long, short] = [a.col(axis).length(), b.col(axis).length()];
                // The logarithm of at most 8 is rounded to 2⁻²².
                prop_assert!((long / short - 1.0).abs() < 1e-6);
                // Half a step of 128 in each of four numbers: 1/128 in all, twice that as an angle.
                prop_assert!((a.col(axis) / long - b.col(axis) / short).length() <= 2.0 / 128.0);
            }
        }
    }
}

#[test]
fn certain_opacities_are_finite_logits() {
    let all = [0.0, 1.0, 1e-40, 1.0 - f32::EPSILON / 2.0];
    let all: Vec<One> = all
        .iter()
        .enumerate()
        .map(|(i, peak)| One { peak: *peak, center: [i as f32, 0.0, 0.0], ..plain() })
        .collect();
    let before = splats(&all, 0, OpacityFilter::Classic);
    let (bytes, notes) = ply(&before);
    assert_eq!(notes, [Note::Rounded("2 opacities of 0 or 1, as logits of ±88".into())]);
    let (after, _) = read("a.ply", &bytes);
    let [zero, one, little, nearly] = peaks(&after) else { panic!("four are expected") };
    assert!(*zero < 1e-38 && *one == 1.0 && *little < 1e-38 && (*nearly - 1.0).abs() <= f32::EPSILON);
    let numbers = &bytes[bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11..];
    let (numbers, []) = numbers.as_chunks() else { panic!("whole numbers are expected") };
    assert_eq!(numbers.len(), 4 * 17);
    assert!(numbers.iter().all(|number| f32::from_le_bytes(*number).is_finite()));
}

#[test]
fn flat_splats_stay_next_to_flat() {
    let flat = f32::NEG_INFINITY;
    let all = [[0.0, flat, -1.0], [flat, 2.0, flat], [flat; 3], [-50.0, -1.0, -1.0]];
    let at = |(i, log_scales): (usize, [f32; 3])| One { log_scales, center: [i as f32, 0.0, 0.0], ..plain() };
    let all: Vec<One> = all.into_iter().enumerate().map(at).collect();
    let before = splats(&all, 1, OpacityFilter::Classic);
    let (bytes, notes) = ply(&before);
    let said = [
        "3 flat splats, whose half-axes of length 0 are written as 2⁻²⁴ of their longest",
        "1 splats with lengths beyond e^±40, cut off there",
    ];
    assert_eq!(notes, said.map(|said| Note::Rounded(said.into())));
    let (after, notes) = read("a.ply", &bytes);
    assert_eq!(notes, []);
    for i in 0..4 {
        let (a, b) = (before.shapes.factor(i), after.shapes.factor(i));
        let largest = a.x_axis.length().max(a.y_axis.length()).max(a.z_axis.length());
        assert!(a.abs_diff_eq(b, 2e-6 * largest + 5e-18), "{a} {b}");
    }
    // A .splat says 0.
    let (after, _) = read("a.splat", &dot_splat(&before).0);
    let flat_axes = |splats: &Splats| {
        (0..4)
            .map(|i| [0, 1, 2].map(|axis| splats.shapes.factor(i).col(axis) == Vec3::ZERO))
            .collect::<Vec<_>>()
    };
    assert_eq!(flat_axes(&after)[..3], flat_axes(&before)[..3]);
}

#[test]
fn columns_are_those_that_others_look_for() {
    for (degree, rest) in [(0, 0), (1, 9), (3, 45)] {
        let (bytes, _) = ply(&splats(&[plain()], degree, OpacityFilter::Compensated));
        let header = String::from_utf8_lossy(&bytes);
        let names: Vec<&str> =
            header.lines().filter_map(|line| line.strip_prefix("property float ")).collect();
        let rest: Vec<String> = (0..rest).map(|i| format!("f_rest_{i}")).collect();
        let mut expected = vec!["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"];
        expected.extend(rest.iter().map(String::as_str));
        expected.extend(["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]);
        assert_eq!(names, expected);
        assert!(header.starts_with(
            "ply\nformat binary_little_endian 1.0\ncomment SplatRenderMode: mip\ncomment antialiased 1\nelement vertex 1\n"
        ));
    }
    let (bytes, _) = ply(&splats(&[plain()], 0, OpacityFilter::Classic));
    assert!(!String::from_utf8_lossy(&bytes).contains("comment"));
}

#[test]
fn what_is_seen_most_comes_first() {
    // σ³ · opacity: 1/8 · 1, 1 · 1/2, 1 · 1/4.
    let half = [-std::f32::consts::LN_2; 3];
    let all: Vec<One> = [(half, 1.0), ([0.0; 3], 0.5), ([0.0; 3], 0.25)]
        .into_iter()
        .enumerate()
        .map(|(i, (log_scales, peak))| One {
            center: [i as f32, 0.0, 0.0],
            log_scales,
            peak,
            color: [1.5, 0.5, 0.5],
            ..plain()
        })
        .collect();
    let (bytes, notes) = dot_splat(&splats(&all, 1, OpacityFilter::Compensated));
    let order: Vec<u8> = bytes.chunks(32).map(|row| row[27]).collect();
    assert_eq!(order, [128, 64, 255]);
    // Light of 1.5 is cut off; 0.5 is 187.5 of 255.
    assert_eq!(bytes[24..27], [255, 188, 188]);
    // The identity, as −1 0 0 0.
    assert_eq!(bytes[28..32], [0, 128, 128, 128]);
    let said: Vec<String> = notes.iter().map(Note::to_string).collect();
    assert!(
        said[0].starts_with("left out: that opacities") && said[1].starts_with("left out: harmonics"),
        "{said:?}"
    );
    assert_eq!(said[2], "rounded: 3 colours cut off at 0 or 1");
    assert_eq!(said.len(), 4);
}

#[test]
fn ends_that_readers_do_not_know_are_noted() {
    let mut whole = splats(&[plain()], 0, OpacityFilter::Classic);
    let said = |splats: &Splats| dot_splat(splats).1.iter().map(Note::to_string).collect::<String>();
    assert!(!said(&whole).contains("end"), "{}", said(&whole));
    if let Strength::Opacity { least, .. } = &mut whole.strength {
        *least = 0.0;
    }
    assert!(said(&whole).contains("left out: where opacities end"), "{}", said(&whole));
}

#[test]
fn what_is_not_held_is_refused() {
    let good = splats(&[plain()], 1, OpacityFilter::Classic);
    let masses = Splats { strength: Strength::Extinction { masses: vec![1.0] }, ..good.clone() };
    let longer = Splats { colors: vec![[0.5; 3]; 2], ..good.clone() };
    let harmonics = Some(Harmonics { degree: 2, coefficients: vec![[0.0; 3]; 3] });
    let fewer = Splats { harmonics, ..good.clone() };
    let none = Splats {
        centers: Vec::new(),
        shapes: Shapes::Each(Vec::new()),
        strength: Strength::Opacity {
            peaks: Vec::new(),
            filter: OpacityFilter::Classic,
            least: Strength::LEAST_OF_TRAINED,
        },
        colors: Vec::new(),
        harmonics: None,
        ..good.clone()
    };
    let harmonics = Some(Harmonics { degree: 200, coefficients: Vec::new() });
    let beyond = Splats { harmonics, ..good };
    for (wrong, said) in [
        (masses, "peak opacities"),
        (longer, "one length"),
        (none, "no splats"),
        (fewer, "one length"),
        (beyond, "degree from 1 to 3"),
    ] {
        for error in [
            gaussian_ply::write(&wrong, Blend::Display, &mut Vec::new()).unwrap_err(),
            splat::write(&wrong, Blend::Display, &mut Vec::new()).unwrap_err(),
            spz::write(&wrong, Blend::Display, &mut Vec::new()).unwrap_err(),
            gltf::write(&wrong, (Blend::Display, glam::DVec3::Y), &mut Vec::new()).unwrap_err(),
        ] {
            assert!(matches!(&error, ExportError::Unsuited(what) if what.contains(said)), "{error}");
        }
    }
}

#[test]
fn linear_blending_is_lost() {
    let splats = splats(&[plain()], 0, OpacityFilter::Classic);
    for notes in [
        gaussian_ply::write(&splats, Blend::Linear, &mut Vec::new()).unwrap(),
        splat::write(&splats, Blend::Linear, &mut Vec::new()).unwrap(),
        spz::write(&splats, Blend::Linear, &mut Vec::new()).unwrap(),
    ] {
        assert!(matches!(&notes[0], Note::LeftOut(what) if what.contains("linear light")), "{notes:?}");
    }
}
