//! `oblate extract`: what is written is read again as it was, and is the picture that `render --iso` draws.

use crate::place::{Workplace, levels};

const BALL: &str = "ball_16x16x16_uint8.raw";

#[test]
fn surfels_are_written_and_drawn() {
    let place = Workplace::new();
    place.ball();
    let view =
        ["--eye", "30,20,50", "--target", "7.5,7.5,7.5", "--up", "0,0,1", "--size", "48x48", "--quiet"];
    place.run(&[&["render", BALL, "--iso", "100", "-o", "a.png"], &view[..]].concat());
    let drawn = levels(&place.path("a.png"));
    for options in [&[][..], &["--stream"], &["--threads", "1"]] {
        let [_, said] = place.run(&[&["extract", BALL, "--iso", "100", "-o", "a.ply"], options].concat());
        assert!(said.contains("wrote a.ply") && said.contains("closed"), "{said}");
        place.run(&[&["render", "a.ply", "-o", "b.png"], &view[..]].concat());
        // Numbers are written as they are.
        let found = levels(&place.path("b.png"));
        let most = drawn.iter().zip(found.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(most <= 1, "{options:?}: {most} levels");
    }
    let [out, _] = place.run(&["info", "a.ply"]);
    assert!(out.contains("area"), "{out}");
    place.run(&["extract", BALL, "--iso", "100", "-o", "c.ply", "--tricubic", "--quiet"]);
    assert_ne!(std::fs::read(place.path("a.ply")).unwrap(), std::fs::read(place.path("c.ply")).unwrap());
}

/// Fewer surfels give the same picture of a ball but for what the bounds allow, and say how far off they are.
#[test]
fn surfels_are_merged() {
    let place = Workplace::new();
    place.ball();
    let extract = |options: &[&str]| -> serde_json::Value {
        let args = ["extract", BALL, "--iso", "75", "-o", "a.ply", "--stats", "-", "--quiet"];
        let [out, _] = place.run(&[&args[..], options].concat());
        serde_json::from_str(&out).unwrap()
    };
    let whole = extract(&[]);
    assert!(whole["merging"].is_null());
    let merged = extract(&["--merge", "0.5,40"]);
    let merging = &merged["merging"];
    assert!(
        merging["surfels"].as_u64() < merged["surfels"].as_u64() && merging["merged"].as_u64() > Some(0),
        "{merged}"
    );
    assert!(
        merging["largest_distance"].as_f64() <= Some(0.5)
            && merging["largest_degrees"].as_f64() <= Some(40.0)
    );
    let [_, said] = place.run(&["extract", BALL, "--iso", "75", "-o", "a.ply", "--merge", "0.5,40"]);
    assert!(said.contains("merged") && said.contains("degrees"), "{said}");
    let none = extract(&["--merge", "0,0"]);
    assert_eq!(none["merging"]["surfels"], none["surfels"]);
}

#[test]
fn stats_say_what_it_took() {
    let place = Workplace::new();
    place.ball();
    let stats = |options: &[&str]| -> serde_json::Value {
        let args = ["extract", BALL, "--iso", "100", "-o", "a.ply", "--stats", "-", "--quiet"];
        let [out, err] = place.run(&[&args[..], options].concat());
        assert_eq!(err, "");
        serde_json::from_str(&out).unwrap()
    };
    let whole = stats(&["--repeat", "3", "--again", "150"]);
    for key in ["extract_ms", "hierarchy_ms", "again_ms", "area", "peak_mib"] {
        assert!(whole[key].as_f64().unwrap() > 0.0, "{key} of {whole}");
    }
    assert!(whole["extract_ms"].as_f64() >= whole["hierarchy_ms"].as_f64());
    // A smaller ball is inside.
    assert!(whole["again_surfels"].as_u64().unwrap() < whole["surfels"].as_u64().unwrap());
    let streamed = stats(&["--stream"]);
    assert_eq!(
        (&streamed["surfels"], &streamed["hierarchy_ms"]),
        (&whole["surfels"], &serde_json::Value::Null)
    );
    let areas = [&whole, &streamed].map(|stats| stats["area"].as_f64().unwrap());
    assert!((areas[0] - areas[1]).abs() < 1e-6 * areas[0], "{areas:?}");
}

#[test]
fn what_can_not_be_extracted_is_refused_and_leaves_no_file() {
    let place = Workplace::new();
    place.cube();
    place.ball();
    let before = place.files();
    for (args, says) in [
        (&["cube.obj", "--iso", "1", "-o", "a.ply"][..], "no volume"),
        (&[BALL, "--iso", "250", "-o", "a.ply"], "no splats"),
        (&[BALL, "--iso", "250", "-o", "a.ply"], "no surface is at 250; values "),
        (&[BALL, "--iso", "inf", "-o", "a.ply"], "--iso"),
        (&[BALL, "--iso", "100", "-o", "a.glb"], ".ply"),
        (&[BALL, "--iso", "100", "-o", "nowhere/a.ply"], "cannot write nowhere/a.ply"),
        (&[BALL, "--iso", "100", "-o", "a.ply", "--repeat", "0"], "--repeat"),
        (&[BALL, "--iso", "100", "-o", "a.ply", "--stream", "--repeat", "2"], "--repeat"),
        (&[BALL, "--iso", "100", "-o", "a.ply", "--stats", "a.ply"], "one file"),
        (&[BALL, "--iso", "100", "-o", "a.ply", "--stream", "--merge", "1"], "--merge"),
        (&[BALL, "--iso", "100", "-o", "a.ply", "--merge", "-1"], "--merge"),
        (
            &["cube.obj", "--iso", "100", "-o", "a.ply", "--stream"],
            "error: cube.obj: it is OBJ; only raw samples are read slice by slice (as which it is read where their dims",
        ),
        (&[BALL, "--iso", "100", "-o", "a.ply", "--stream", "--dims", "16x16x17"], "4096 bytes"),
        (&["missing.raw", "--iso", "100", "-o", "a.ply"], "missing.raw"),
    ] {
        let message = place.refusal(&[&["extract"], args].concat());
        assert!(message.contains(says), "{args:?}: {message}");
    }
    assert_eq!(place.files(), before);
}
