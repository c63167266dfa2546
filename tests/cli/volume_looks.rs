//! What of a volume is drawn, and in which colours: several surfaces, a second volume, planes, flattened samples.

use crate::place::{Workplace, brightness, levels};
use image::RgbaImage;

const BALL: &str = "ball_16x16x16_uint8.raw";

/// Straight on from −z: x to the right, y down, 4 pixels a unit, so that the ball's middle is that of 48 pixels.
const VIEW: [&str; 10] = [
    "--eye",
    "7.5,7.5,-60",
    "--target",
    "7.5,7.5,7.5",
    "--up",
    "0,-1,0",
    "--orthographic",
    "12",
    "--size",
    "48x48",
];

fn draw(place: &Workplace, options: &[&str]) -> RgbaImage {
    place.run(
        &[&["render", BALL, "-o", "a.png", "--quiet", "--background", "000000"], &VIEW[..], options].concat(),
    );
    levels(&place.path("a.png"))
}

/// The inner surface is seen through the outer one in its colour, and each alone is as `--iso` draws it.
#[test]
fn each_surface_has_its_colour_and_opacity() {
    let place = Workplace::new();
    place.ball();
    let both = draw(&place, &["--iso", "75,150", "--iso-color", "ff000060,0000ff"]);
    let [middle, side] = [both.get_pixel(24, 24).0, both.get_pixel(24, 8).0];
    assert!(middle[2] > 60 && middle[0] > 20, "{middle:?}: blue through red");
    assert!(side[0] > 20 && side[2] < 20, "{side:?}: red alone");
    let one = draw(&place, &["--iso", "75", "--iso-color", "ff000060"]);
    // Half a ball's width from the middle nothing is behind the outer surface.
    assert_eq!(one.get_pixel(24, 8).0, side);
    let grey = draw(&place, &["--iso", "75,150", "--iso-color", "808080"]);
    let [r, g, b, _] = grey.get_pixel(24, 24).0;
    assert!(r == g && g == b && r > 40, "one colour for all");
}

/// A thing of which planes leave nothing is named, even if it is drawn in two ways; one of which they leave something is not.
#[test]
fn what_planes_leave_nothing_of_is_said() {
    let place = Workplace::new();
    place.ball();
    for (plane, expected) in [("1,0,0,99", 1), ("1,0,0,7.5", 0)] {
        let args = ["render", BALL, "--iso", "75,150", "--clip-plane", plane, "--size", "16x16"];
        let [_, said] = place.run(&args);
        assert_eq!(said.matches("the planes leave nothing of it").count(), expected, "{plane}: {said}");
    }
}

/// Columns of pixels from which on a splat is whole, or gone: a pixel is a quarter of a unit, 12 are four σ.
const REACH: i32 = 12;

/// Planes and boxes leave what is inside of them as it was, but for the rim, where a cut surface shows its back, too, and nothing of what
/// is outside.
#[test]
fn planes_cut_whatever_is_drawn() {
    let place = Workplace::new();
    place.ball();
    for look in [&["--iso", "75"][..], &["--transfer", "amber"]] {
        let whole = draw(&place, look);
        for (clip, left) in [
            (&["--clip-plane", "1,0,0,7.5"][..], 24..99),
            (&["--clip-plane", "-2,0,0,-15"], -99..24),
            (&["--clip-box", "6.5,-1,-1,8.5,17,17"], 20..28),
            (&["--clip-plane", "1,0,0,6.5", "--clip-plane", "-1,0,0,-8.5"], 20..28),
        ] {
            let cut = draw(&place, &[look, clip].concat());
            let (mut same, mut gone) = (0, 0);
            for (x, y, after) in cut.enumerate_pixels() {
                let (before, column) = (whole.get_pixel(x, y), x as i32);
                if column + REACH < left.start || column >= left.end + REACH {
                    gone += u32::from(before[0] > 0);
                    assert_eq!(after.0[..3], [0; 3], "{look:?} {clip:?} at {x}, {y}");
                } else if (left.start + REACH..left.end - REACH).contains(&column) {
                    let is_rim = x.abs_diff(24).pow(2) + y.abs_diff(24).pow(2) > 16 * 16;
                    same += u32::from(before[0] > 0 && !is_rim);
                    assert!(
                        is_rim || before[0].abs_diff(after[0]) <= 2,
                        "{look:?} {clip:?} at {x}, {y}: {before:?}, {after:?}"
                    );
                }
            }
            let is_half = left.len() > 8;
            assert!(gone > 20 && (same > 20 || !is_half), "{look:?} {clip:?}: {same} pixels stay, {gone} go");
        }
    }
    // Meshes, too, and in scene files.
    place.cube();
    for (offset, is_seen) in [(5, false), (-5, true)] {
        place.write(
            "scene.toml",
            format!("version = 1\n[[mesh]]\npath = \"cube.obj\"\nclip-plane = [[0, 0, 1, {offset}]]\n"),
        );
        place.run(&[
            "render",
            "scene.toml",
            "-o",
            "b.png",
            "--size",
            "32x32",
            "--background",
            "000000",
            "--quiet",
        ]);
        assert_eq!(brightness(&place.path("b.png")) > 0.0, is_seen);
    }
}

/// A field that is 0 on the left and 255 on the right, from blue to red, colours the surface so.
#[test]
fn a_second_volume_gives_colours() {
    let place = Workplace::new();
    place.ball();
    let field: Vec<u8> = (0..4096).map(|i| if i % 16 < 8 { 0 } else { 255 }).collect();
    place.write("heat_16x16x16_uint8.raw", field);
    place.write("heat.txt", "transfer 1\nstrength extinction\ncolor srgb\n0 0 0 1 0\n255 1 0 0 0\n");
    let options = ["--iso", "75", "--color-by", "heat_16x16x16_uint8.raw", "--color-transfer", "heat.txt"];
    let picture = draw(&place, &options);
    let [left, right] = [picture.get_pixel(12, 24).0, picture.get_pixel(36, 24).0];
    assert!(left[2] > 4 * left[0] && right[0] > 4 * right[2], "{left:?}, {right:?}");
    let scene = "version = 1\n[[volume]]\npath = \"ball_16x16x16_uint8.raw\"\niso = [75]\n\
                 color-by = \"heat_16x16x16_uint8.raw\"\ncolor-transfer = \"heat.txt\"\n";
    place.write("scene.toml", scene);
    let args = ["render", "scene.toml", "-o", "b.png", "--quiet", "--background", "000000"];
    place.run(&[&args[..], &VIEW].concat());
    assert!(levels(&place.path("b.png")) == picture);
}

/// Kernels that become flat have the mass that they had: brightness changes by little, the picture does; a ratio of 1 changes nothing.
#[test]
fn samples_are_flattened() {
    let place = Workplace::new();
    place.ball();
    let of = |flatten: &[&str]| {
        let picture = draw(&place, &[&["--transfer", "amber"], flatten].concat());
        (brightness(&place.path("a.png")), picture)
    };
    let (round, one, flat) = (of(&[]), of(&["--flatten", "100,0,1"]), of(&["--flatten", "100"]));
    let most = round.1.iter().zip(one.1.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    // Factors of their own are rounded otherwise than the one that they share.
    assert!(most <= 1, "{most}");
    assert!(flat.1 != round.1 && (flat.0 / round.0 - 1.0).abs() < 0.05, "{} of {}", flat.0, round.0);
    let (steep, _) = of(&["--flatten", "100,1000"]);
    assert!((steep - round.0).abs() < 0.01);
}

/// A layer of values that no sample has is seen between them.
#[test]
fn transfer_functions_see_what_is_between_samples() {
    let place = Workplace::new();
    let steps: Vec<u8> = (0..4096).map(|i| if i % 16 < 8 { 0 } else { 200 }).collect();
    place.write(BALL, steps);
    place.write(
        "layer.txt",
        "transfer 1\nstrength extinction\ncolor srgb\n60 1 1 1 0\n60 1 1 1 9\n140 1 1 1 9\n140 1 1 1 0\n",
    );
    let of = |options: &[&str]| {
        draw(&place, &[&["--transfer", "layer.txt"], options].concat());
        brightness(&place.path("a.png"))
    };
    assert_eq!(of(&[]), 0.0);
    assert!(of(&["--refine", "4"]) > 5.0);
}

#[test]
fn what_makes_no_sense_is_refused() {
    let place = Workplace::new();
    place.ball();
    place.cube();
    for (args, says) in [
        (&["--iso", "75,100", "--iso-color", "ff0000,00ff00,0000ff"][..], "3 colours for 2 values"),
        (&["--iso-color", "ff0000"], "iso-color"),
        (&["--iso", "75", "--flatten", "75"], "flatten"),
        (&["--flatten", "75,-1"], "--flatten"),
        (&["--iso", "75", "--refine", "2"], "refine"),
        (&["--refine", "0"], "--refine"),
        (&["--iso", "75", "--color-transfer", "amber"], "--color-by"),
        (&["--iso", "75", "--color-by", "cube.obj"], "no volume"),
        (&["--iso", "75", "--color-by", "missing.vti"], "missing.vti"),
        (&["--clip-box", "1,1,1,0,2,2"], "no box"),
        (&["--clip-plane", "0,0,0,1"], "no plane"),
        (&["--clip-plane", "0,0,1"], "4 numbers"),
    ] {
        let message = place.refusal(&[&["render", BALL, "-o", "a.png"], args].concat());
        assert!(message.contains(says), "{args:?}: {message}");
    }
    let message = place.refusal(&["render", "cube.obj", "-o", "a.png", "--color-by", BALL]);
    assert!(message.contains("color-by") && message.contains("volumes"), "{message}");
    for (keys, says) in [
        ("color-transfer = \"amber\"", "color-by"),
        ("clip-box = [0, 0, 0, 1, 1, -1]", "no box"),
        ("flatten = []", "0 numbers"),
        ("iso-color = 5", "iso-color"),
    ] {
        place.write("scene.toml", format!("version = 1\n[[volume]]\npath = \"{BALL}\"\n{keys}\n"));
        let message = place.refusal(&["render", "scene.toml", "-o", "a.png"]);
        assert!(message.contains(says) && message.contains("scene.toml, line 4"), "{keys}: {message}");
    }
}

/// What `render` cuts and paints `convert` writes so.
#[test]
fn looks_are_converted() {
    let place = Workplace::new();
    place.ball();
    let written = |options: &[&str]| {
        place.run(&[&["convert", BALL, "a.ply", "--iso", "75", "--quiet"], options].concat());
        std::fs::metadata(place.path("a.ply")).unwrap().len()
    };
    let [whole, half] = [written(&[]), written(&["--clip-plane", "1,0,0,7.5"])];
    // A few of the other half are cut, not gone.
    assert!(2 * half > whole && 10 * half < 8 * whole, "{half} of {whole} bytes");
    let [again, _] = place.run(&["info", "a.ply"]);
    assert!(again.contains("area"), "{again}");
    // Splats from a file, likewise.
    place.run(&["convert", "a.ply", "b.ply", "--clip-plane", "-1,0,0,-8.5", "--quiet"]);
    assert!(std::fs::metadata(place.path("b.ply")).unwrap().len() < half);
    assert!(place.refusal(&["convert", "a.ply", "c.ply", "--clip-plane", "1,0,0,99"]).contains("nothing"));
}
