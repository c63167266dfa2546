//! Scene files through the binary.

use crate::place::{Workplace, levels};
use std::path::Path;

#[test]
fn mistakes_show_their_line() {
    let place = Workplace::new();
    place.cube();
    place.ball();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n";
    image::RgbImage::from_pixel(2, 2, image::Rgb([255, 0, 0])).save(place.path("red.png")).unwrap();
    place.write("v.nrrd", [header.as_bytes(), &[0; 8]].concat());
    let mesh = "version = 1\n[[mesh]]\npath = 'cube.obj'\n";
    for (text, says) in [
        (format!("{mesh}colour = 3\n"), "line 4, column 1 (`colour = 3`): unknown field `colour`"),
        (format!("{mesh}[render]\nlow_pass = 1\n"), "line 5"),
        (format!("{mesh}[[light]]\nkind = 'sun'\n"), "line 5"),
        (format!("{mesh}[[light]]\nkind = 'point'\n"), "`position`"),
        (format!("{mesh}scale = 0\n"), "above 0"),
        (format!("{mesh}scale = [1, 2]\n"), "one number or three"),
        (format!("{mesh}[camera]\neye = [1, 2]\n"), "line 5"),
        (
            format!("{mesh}[camera]\neye = [nan, 0, 1]\n"),
            "scene.toml, line 5, column 1 (`eye = [nan, 0, 1]`): eye is NaN",
        ),
        (format!("{mesh}[camera]\nfov = 30\northographic = 2\n"), "line 6, column 1"),
        (
            format!("{mesh}[render]\nshade = true\n low-pass = -3\n"),
            "line 6, column 2 (`low-pass = -3`): low-pass is -3",
        ),
        (format!("{mesh}[render]\nsamples = 3\n"), "reference"),
        (format!("{mesh}[render]\norder = 'axis-sheets'\n"), "line 5"),
        (
            format!("{mesh}[render]\norder = 'centers'\nslab-thickness = 2\n"),
            "line 6, column 1 (`slab-thickness = 2`): slab-thickness is for order = \"slabs\"",
        ),
        (format!("{mesh}[render]\nslab-thickness = 0\n"), "line 5, column 1"),
        (format!("{mesh}[render]\ntolerance = '5%'\n"), "line 5, column 13"),
        (format!("{mesh}[render]\ntolerance = [1]\n"), "\"2/255\" or 0.01"),
        (format!("{mesh}[render]\ntolerance = 2\n"), "line 5, column 1 (`tolerance = 2`): tolerance is 2"),
        (
            format!("{mesh}[render]\nbudget = 5\nlevel-of-detail = false\n"),
            "line 5, column 1 (`budget = 5`): budget is kept by level-of-detail = true",
        ),
        (
            format!("{mesh}instances = [\n  {{ scale = 2 }},\n  {{ scale = -2 }},\n]\n"),
            "line 6, column 3 (`{ scale = -2 },`): scale is",
        ),
        (format!("{mesh}instances = []\n"), "line 4, column 13 (`instances = []`): instances is empty"),
        (format!("{mesh}instances = [{{ place = 1 }}]\n"), "line 4"),
        (format!("{mesh}scale = 1e300\n"), "line 4, column 1 (`scale = 1e300`)"),
        (format!("{mesh}surfels = 9\nsurfel-spacing = 1\n"), "line 5, column 1"),
        (format!("{mesh}surfels = 0\n"), "line 4, column 1"),
        (format!("{mesh}texture = 'red.png'\n"), "texture is used by no part"),
        (
            "version = 1\n[[volume]]\npath = 'a.raw'\niso = []\n".into(),
            "line 4, column 1 (`iso = []`): iso is empty",
        ),
        (
            "version = 1\n[[volume]]\npath = 'v.nrrd'\ndims = [2, 2, 2]\n".into(),
            "v.nrrd: dims is for raw files",
        ),
        ("version = 3\n".into(), "reads version 1"),
        ("[[mesh]]\npath = 'cube.obj'\n".into(), "missing field `version`"),
        ("version = 1\n[[mesh]\n".into(), "line 2"),
        ("version = 1\n[[mesh]]\npath = 'ball_16x16x16_uint8.raw'\n".into(), "list it under [[volume]]"),
        ("version = 1\n[[volume]]\npath = 'cube.obj'\n".into(), "list it under [[mesh]]"),
        ("version = 1\n[[mesh]]\npath = 'gone.obj'\n".into(), "gone.obj"),
    ] {
        place.write("scene.toml", &text);
        let message = place.refusal(&["render", "scene.toml", "--size", "8x8"]);
        assert!(message.contains(says), "{text} gives {message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    }
}

#[test]
fn options_stand_over_the_file() {
    let place = Workplace::new();
    place.cube();
    place.write(
        "scene.toml",
        "version = 1\n[camera]\neye = [0, 0, 9]\nfov = 40\n[[mesh]]\npath = 'cube.obj'\nsurfels = 800\n\
         [render]\nsize = [20, 10]\nbackground = '00ff00'\nshade = false\n",
    );
    let [_, err] = place.run(&["render", "scene.toml", "--fov", "25", "--background", "0000ff80"]);
    assert!(err.contains("--eye 0,0,9 ") && err.contains("--fov 25"), "{err}");
    let picture = levels(&place.path("oblate.png"));
    assert_eq!(picture.dimensions(), (20, 10));
    assert_eq!(picture.get_pixel(0, 0).0, [0, 0, 255, 0x80]);
    // Unlit, the light grey of meshes without a colour: linear 0.6 is 255 (1.055 · 0.6^(1/2.4) − 0.055) = 203.4.
    assert_eq!(picture.get_pixel(10, 5).0, [203, 203, 203, 255]);
}

#[test]
fn paths_are_relative_to_the_file() {
    let place = Workplace::new();
    std::fs::create_dir(place.path("scenes")).unwrap();
    std::fs::rename(place.cube(), place.path("scenes/cube.obj")).unwrap();
    std::fs::rename(place.ball(), place.path("scenes/ball_16x16x16_uint8.raw")).unwrap();
    place.write("scenes/pale.tf", "transfer 1\nstrength extinction\ncolor srgb\n0 0 0 0 0\n200 1 1 1 0.2\n");
    place.write(
        "scenes/s.toml",
        "version = 1\n[[mesh]]\npath = 'cube.obj'\nsurfels = 100\n\
         [[volume]]\npath = 'ball_16x16x16_uint8.raw'\ntransfer = 'pale.tf'\n",
    );
    place.run(&["render", "scenes/s.toml", "--size", "16x16"]);
}

#[test]
fn placed_and_lit_things_are_where_the_file_says() {
    let place = Workplace::new();
    place.cube();
    // A cube of side 2 in the right half of an orthographic view of height 8; red light from the front.
    place.write(
        "scene.toml",
        "version = 1\n[camera]\neye = [0, 0, 20]\ntarget = [0, 0, 0]\nup = [0, 1, 0]\northographic = 8\n\
         [[mesh]]\npath = 'cube.obj'\nscale = [1, 0.5, 1]\nrotate = [0, 0, 90]\ntranslate = [2, 0, 0]\nsurfels = 4000\n\
         [[light]]\nkind = 'directional'\ntowards = [0, 0, 1]\ncolor = 'ff0000'\n\
         [render]\nsize = [64, 64]\nbackground = '000000'\n",
    );
    place.run(&["render", "scene.toml"]);
    let picture = levels(&place.path("oblate.png"));
    let lit = |x: u32, y: u32| picture.get_pixel(x, y)[0] > 128;
    // 8 pixels a unit: scaled and turned it spans x from 1.5 to 2.5 and y from −1 to 1.
    assert!(lit(48, 32) && lit(45, 32) && lit(50, 32) && lit(48, 26) && lit(48, 37));
    assert!(!lit(48, 20) && !lit(41, 32) && !lit(54, 32) && !lit(16, 32));
    assert_eq!(picture.get_pixel(48, 32)[1], picture.get_pixel(48, 32)[2]);
}

/// The example scenes are true to the format and draw; those of scanned data where it is.
#[test]
fn examples_are_drawn() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let shared = std::env::var_os("OBLATE_DATA").map_or(root.join("../shared/data"), Into::into);
    let place = Workplace::new();
    let mut scenes = Vec::new();
    for entry in std::fs::read_dir(root.join("examples/scenes")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        std::fs::copy(&path, place.path(&name)).unwrap();
        if name.ends_with(".toml") {
            scenes.push(name);
        }
    }
    assert!(scenes.len() >= 2, "{scenes:?}");
    for name in scenes {
        let mut text = std::fs::read_to_string(place.path(&name)).unwrap();
        if text.contains("engine.vti") && !shared.is_dir() {
            assert!(std::env::var_os("OBLATE_REQUIRE_DATA").is_none(), "{} is missing", shared.display());
            eprintln!("{name} is skipped: {} is missing", shared.display());
            continue;
        }
        for (folder, file) in [("volumes", "engine.vti"), ("meshes", "DamagedHelmet.glb")] {
            let there = shared.join(folder).join(file);
            text = text.replace(&format!("path = \"{file}\""), &format!("path = {there:?}"));
        }
        place.write(&name, text);
        // Few surfels: how many there are by themselves is tested elsewhere.
        place.run(&["render", &name, "--size", "64x48", "-o", "example.png", "--surfels", "2000"]);
        let picture = levels(&place.path("example.png"));
        let colors: std::collections::HashSet<_> = picture.pixels().map(|p| p.0).collect();
        assert!(colors.len() > 100, "{name} shows {} colours", colors.len());
    }
}
