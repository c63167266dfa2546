//! Trained splats through the binary.

use crate::place::{Workplace, levels};

const CONSTANT: f64 = 0.282_094_791_773_878_14;

/// A file of round splats with σ = 1 and harmonics of degree 1: centre, logit of the opacity, display-encoded
/// grey, and what red gains along z.
fn write(place: &Workplace, name: &str, splats: &[([f64; 3], f64, f64, f64)]) {
    let names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"];
    let names = names.map(str::to_owned).into_iter().chain((0..4).map(|i| format!("rot_{i}")));
    let names = names.chain((0..9).map(|i| format!("f_rest_{i}")));
    let mut file = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", splats.len());
    names.for_each(|name| file += &format!("property float {name}\n"));
    let mut file = (file + "end_header\n").into_bytes();
    for ([x, y, z], logit, grey, along_z) in splats {
        let dc = (grey - 0.5) / CONSTANT;
        let mut row = vec![*x, *y, *z, dc, dc, dc, *logit, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        row.extend([0.0, *along_z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        file.extend(row.iter().flat_map(|v| (*v as f32).to_le_bytes()));
    }
    place.write(name, file);
}

/// The pixel in the middle, whose ray passes the origin.
fn middle(place: &Workplace, files: &[&str], options: &[&str]) -> ([u8; 4], String) {
    let picture = ["--size", "33x33", "--low-pass", "0", "--target", "0,0,0", "--background", "000000"];
    let [_, err] = place.run(&[&["render"], files, &picture[..], options].concat());
    (levels(&place.path("oblate.png")).get_pixel(16, 16).0, err)
}

#[test]
fn colours_change_with_the_view() {
    let place = Workplace::new();
    write(&place, "a.ply", &[([0.0; 3], f64::INFINITY, 0.5, 0.5)]);
    // Display value 0.5 ± 0.5 √(3/4π): levels 189.8, 65.2; the others stay at 127.5.
    for (eye, red) in [("0,0,-5", 190), ("0,0,5", 65), ("5,0,0", 128)] {
        for lens in [["--fov", "40"], ["--orthographic", "4"]] {
            for reference in ["off", "r1"] {
                let options = ["--eye", eye, "--up", "0,1,0", "--reference", reference, lens[0], lens[1]];
                let ([r, g, b, a], _) = middle(&place, &["a.ply"], &options);
                assert!(r.abs_diff(red) <= 1 && g.abs_diff(128) <= 1 && b == g, "{eye}: {r} {g} {b}");
                assert_eq!(a, 255);
            }
        }
    }
}

#[test]
fn trained_splats_alone_are_blended_where_they_were_trained() {
    let place = Workplace::new();
    place.cube();
    write(&place, "a.ply", &[([0.0; 3], 0.0, 1.0, 0.0)]);
    let eye = ["--eye", "0,0,-5", "--repeat", "2"];
    let said = |err: &str| err.matches("blended in").count();
    // Half of white over black is level 127.5 in display space, 187.5 in linear light.
    let ([r, ..], err) = middle(&place, &["a.ply"], &eye);
    assert!(r.abs_diff(128) <= 1, "{r}");
    assert!(
        said(&err) == 1 && err.contains("blended in display space, where these splats were trained"),
        "{err}"
    );
    for (blend, level) in [("linear", 188), ("display", 128)] {
        let ([r, ..], err) = middle(&place, &["a.ply"], &[&eye[..], &["--blend", blend]].concat());
        assert!(r.abs_diff(level) <= 1 && said(&err) == 0, "{r} {err}");
    }
    let (_, err) = middle(&place, &["a.ply", "cube.obj"], &eye);
    assert!(said(&err) == 1 && err.contains("blended in linear light"), "{err}");
    let [_, err] = place.run(&["render", "cube.obj", "--size", "8x8"]);
    assert_eq!(said(&err), 0, "{err}");
}

#[test]
fn a_scene_file_places_them() {
    let place = Workplace::new();
    place.cube();
    write(&place, "a.ply", &[([0.0; 3], f64::INFINITY, 1.0, 0.0)]);
    place.write(
        "scene.toml",
        "version = 1\n[camera]\neye = [0, 0, -50]\ntarget = [0, 0, 0]\nup = [0, 1, 0]\northographic = 33\n[[splats]]\npath = 'a.ply'\n\
         scale = [0.1, 0.1, 4]\nrotate = [0, 90, 0]\ntranslate = [0, 8, 0]\n[render]\nsize = [33, 33]\nbackground = '000000'\n",
    );
    place.run(&["render", "scene.toml"]);
    let picture = levels(&place.path("oblate.png"));
    // A pixel is a unit: a rod of σ = 4 along x at y = 8.
    assert!(picture.get_pixel(16, 8)[0] > 30 && picture.get_pixel(20, 8)[0] > 10);
    assert!(picture.get_pixel(16, 5)[0] == 0 && picture.get_pixel(16, 16)[0] == 0);

    for (text, says) in [
        ("[[mesh]]\npath = 'a.ply'\n", "a.ply: it holds splats; list it under [[splats]]"),
        ("[[splats]]\npath = 'cube.obj'\n", "cube.obj: it is a mesh; list it under [[mesh]]"),
        ("[[splats]]\npath = 'a.ply'\nsurfels = 3\n", "unknown field `surfels`"),
        ("[[splats]]\npath = 'a.ply'\nscale = 0\n", "line 4"),
    ] {
        place.write("wrong.toml", format!("version = 1\n{text}"));
        let message = place.refusal(&["render", "wrong.toml", "--size", "8x8"]);
        assert!(message.contains(says), "{message}");
    }
    assert!(place.refusal(&["render", "a.ply", "--iso", "3"]).contains("is for volumes; none is given"));
    assert!(place.refusal(&["render", "a.ply", "--surfels", "3"]).contains("is for meshes; none is given"));
}

#[test]
fn what_is_left_out_is_said() {
    let place = Workplace::new();
    write(&place, "a.ply", &[([0.0; 3], 0.0, 1.0, 0.0), ([f64::NAN; 3], 0.0, 1.0, 0.0)]);
    let note = "left out: 1 of 2 splats: 1 with a number that is NaN, infinite or out of its range (the first is splat 1)";
    let [_, err] = place.run(&["render", "a.ply", "--size", "8x8"]);
    assert!(err.contains(&format!("a.ply: {note}\n")), "{err}");
    let [_, err] = place.run(&["render", "a.ply", "--size", "8x8", "--quiet"]);
    assert!(err.is_empty(), "{err}");
    let [out, _] = place.run(&["info", "a.ply"]);
    assert!(out.contains(&format!("note        {note}\n")), "{out}");
    let [json, err] = place.run(&["info", "a.ply", "--json"]);
    let found: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(
        (&found["kind"], &found["count"], &found["notes"][0]),
        (&"splats".into(), &1.into(), &note.into())
    );
    assert!(err.is_empty());
}

#[test]
fn they_are_framed() {
    let place = Workplace::new();
    write(&place, "a.ply", &[([99.0, 0.0, 0.0], 5.0, 1.0, 0.0), ([101.0, 0.0, 0.0], 5.0, 1.0, 0.0)]);
    let [_, err] = place.run(&["render", "a.ply", "--size", "33x33", "--background", "000000"]);
    assert!(err.contains("--target 100"), "{err}");
    assert!(levels(&place.path("oblate.png")).get_pixel(16, 16)[0] > 200);
}

#[test]
fn info_says_what_is_in_it() {
    let place = Workplace::new();
    write(&place, "a.ply", &[([1.0, -2.0, 3.0], 0.0, 1.0, 0.0), ([2.5, -2.0, 0.0], f64::INFINITY, 1.0, 0.0)]);
    let [out, _] = place.run(&["info", "a.ply"]);
    for line in [
        "format      PLY",
        "splats      2",
        "harmonics   degree 1: 3 colours a splat beside the constant one",
        "opacity     0.5 to 1",
        "filter      classic",
        "blending    display",
        "bounds      1, -2, 0 to 2.5, -2, 3",
    ] {
        assert!(out.lines().any(|l| l == line), "{line} in {out}");
    }
    write(&place, "b.ply", &[([f64::NAN; 3], 0.0, 1.0, 0.0)]);
    let message = place.refusal(&["info", "b.ply"]);
    assert!(message.contains("b.ply: there are no splats in it"), "{message}");
}
