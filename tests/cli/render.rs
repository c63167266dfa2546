//! `oblate render`: pictures in their formats, statistics, what is left behind.

use crate::place::{Workplace, brightness, levels};
use exr::prelude::FlatSamples;
use serde_json::Value;

/// Draws the cube at 32² with these options besides.
fn draw(place: &Workplace, args: &[&str]) -> [String; 2] {
    place.run(&[&["render", "cube.obj", "--size", "32x32"], args].concat())
}

#[test]
fn the_built_in_scene_is_drawn_without_a_file() {
    let place = Workplace::new();
    let [out, err] = place.run(&["render", "--size", "64x48"]);
    assert_eq!(out, "");
    assert!(err.contains("wrote oblate.png, 64×48, "), "{err}");
    let picture = levels(&place.path("oblate.png"));
    assert_eq!(picture.dimensions(), (64, 48));
    let background = [0x20, 0x20, 0x20, 0xff];
    assert_eq!(picture.get_pixel(0, 0).0, background);
    // Framed: it fills the height and leaves a margin.
    let shown = |y: u32| (0..64).any(|x| picture.get_pixel(x, y).0 != background);
    assert!((6..42).all(shown));
}

#[test]
fn png_and_exr_hold_the_same_picture() {
    let place = Workplace::new();
    place.cube();
    let background = ["--background", "40608080"];
    draw(&place, &[&["-o", "p8.png"], &background[..]].concat());
    draw(&place, &[&["-o", "p16.png", "--bits", "16"], &background[..]].concat());
    draw(&place, &[&["-o", "e.exr"], &background[..]].concat());
    let fine = image::open(place.path("p16.png")).unwrap();
    assert_eq!(fine.color(), image::ColorType::Rgba16);
    let (coarse, fine) = (levels(&place.path("p8.png")), fine.into_rgba16());

    let file = exr::prelude::read_first_flat_layer_from_file(place.path("e.exr")).unwrap();
    let channels = &file.layer_data.channel_data.list;
    let named = |name: &str| -> Vec<f32> {
        let channel =
            channels.iter().find(|c| c.name == *name).unwrap_or_else(|| panic!("no channel {name}"));
        channel.sample_data.values_as_f32().collect()
    };
    let [r, a, z, nx, ny, nz] = ["R", "A", "Z", "N.X", "N.Y", "N.Z"].map(named);
    assert_eq!((named("G").len(), named("B").len()), (32 * 32, 32 * 32));
    let [expected, median] = ["expected.Z", "median.Z"].map(named);
    let id = &channels.iter().find(|c| c.name == *"id").unwrap().sample_data;
    let FlatSamples::U32(id) = id else { panic!("ids are {id:?}") };

    let encode = |c: f32| oblate::engine::color::linear_to_srgb(c) * 255.0;
    for (i, (c, f)) in coarse.pixels().zip(fine.pixels()).enumerate() {
        // Half a level of 8 bits, plus what 16 bits round.
        assert!((f32::from(c[0]) - f32::from(f[0]) / 257.0).abs() <= 0.51);
        assert!((encode(r[i] / a[i]) - f32::from(f[0]) / 257.0).abs() < 0.01, "pixel {i}");
        assert!((a[i] * 255.0 - f32::from(f[3]) / 257.0).abs() < 0.01);
        let length = (nx[i] * nx[i] + ny[i] * ny[i] + nz[i] * nz[i]).sqrt();
        if z[i].is_finite() {
            assert!((length - 1.0).abs() < 1e-5, "pixel {i}: normal of length {length}");
            assert!(id[i] != u32::MAX);
        } else {
            assert!(z[i] == f32::INFINITY && length == 0.0 && id[i] == u32::MAX);
            assert!(expected[i] == f32::INFINITY && median[i] == f32::INFINITY);
        }
    }
    assert_eq!(coarse.get_pixel(0, 0).0, [0x40, 0x60, 0x80, 0x80]);
    let middle = 16 * 32 + 16;
    assert!(z[middle].is_finite() && (a[middle] - 1.0).abs() < 1e-5);
    // One opaque surface: all depths are its.
    for (name, depth) in [("expected", expected[middle]), ("median", median[middle])] {
        assert!((depth - z[middle]).abs() < 1e-4, "{name}: {depth}, not {}", z[middle]);
    }
    let [same, _] = place.run(&["compare", "e.exr", "e.exr"]);
    assert!(same.contains("PSNR inf dB") && same.contains("largest error 0 linear"), "{same}");
}

#[test]
fn the_printed_camera_draws_the_same_picture() {
    let place = Workplace::new();
    place.cube();
    let [_, err] = draw(&place, &["-o", "a.png", "--surfels", "500"]);
    let camera = err.lines().find_map(|line| line.strip_prefix("camera: ")).unwrap();
    let pasted: Vec<&str> = camera.split(' ').collect();
    let [_, again] = draw(&place, &[&["-o", "b.png", "--surfels", "500"], &pasted[..]].concat());
    assert!(again.contains(camera));
    assert_eq!(std::fs::read(place.path("a.png")).unwrap(), std::fs::read(place.path("b.png")).unwrap());
    // Negative numbers are values, not options.
    draw(&place, &["--eye", "-5,-1,-2", "--target", "-0.5,0,0", "--up", "0,-1,0", "--surfels", "500"]);
}

#[test]
fn statistics_are_one_json_object() {
    let place = Workplace::new();
    place.cube();
    let args = ["--stats", "-", "--repeat", "3", "--threads", "2", "--surfels", "2000"];
    let [out, _] = draw(&place, &args);
    assert_eq!(out.lines().count(), 1);
    let stats: Value = serde_json::from_str(&out).unwrap();
    let number = |key: &str| stats[key].as_f64().unwrap_or_else(|| panic!("{key} in {out}"));
    assert!((number("splats") / 2000.0 - 1.0).abs() < 0.2, "{out}");
    // Floats: at least centres (3) and the columns of factors that aren't zero (6); at most areas (1), colours (3), normals (3),
    // opacities (1) and third columns (3) with them, a third more for levels, whose needs are one more, and as much for clusters.
    let bytes = number("splat_bytes") / number("splats");
    assert!((36.0..2.0 * 21.0 * 4.0 * 4.0 / 3.0).contains(&bytes), "{bytes}");
    assert!(number("visible") > 0.0 && number("visible") <= number("splats"));
    assert!(number("fragments") >= number("visible") / 2.0);
    assert_eq!((number("threads"), number("late")), (2.0, 0.0));
    // A whole cube, of which nothing stands for others.
    let forms = ["point", "affine", "exact"].map(|form| stats["forms"][form].as_f64().unwrap());
    assert_eq!(forms.iter().sum::<f64>(), number("visible"), "{out}");
    assert_eq!((number("culled"), number("merged")), (0.0, 0.0));
    assert!(number("occluded") < number("splats"));
    let stages = stats["stages_ms"].as_object().unwrap();
    let names = ["cull", "footprint", "order", "bin", "layers", "composite", "resolve"];
    assert!(stages.len() == names.len() && names.iter().all(|name| stages[*name].as_f64().unwrap() >= 0.0));
    assert!(number("frame_ms") > 0.0 && number("load_ms") > 0.0 && number("build_ms") > 0.0);
    if cfg!(target_os = "linux") {
        assert!(number("peak_mib") > 1.0);
    }

    draw(&place, &["--stats", "stats.json", "--surfels", "500"]);
    let _: Value = serde_json::from_slice(&std::fs::read(place.path("stats.json")).unwrap()).unwrap();
}

#[test]
fn forms_are_counted_and_shown() {
    let place = Workplace::new();
    place.ball();
    let ball = ["render", "ball_16x16x16_uint8.raw", "--transfer", "grey", "--size", "24x24", "--stats", "-"];
    let colors = ["--show", "forms", "--background", "000000"];
    for (number, form) in ["point", "affine", "exact"].into_iter().enumerate() {
        let [out, _] = place.run(&[&ball[..], &colors[..], &["--footprint", form]].concat());
        let stats: Value = serde_json::from_str(&out).unwrap();
        assert_eq!(stats["forms"][form], stats["visible"], "{stats}");
        // Points are red, affine splats green, exact ones blue.
        let picture = levels(&place.path("oblate.png"));
        let lit = picture.pixels().filter(|p| p[number] > 64).count();
        assert!(lit > 40, "{form}: {lit}");
        for other in (0..3).filter(|other| *other != number) {
            assert!(picture.pixels().all(|p| p[other] == 0), "{form}");
        }
    }
}

#[test]
fn statistics_say_where_the_window_was_too_small() {
    let place = Workplace::new();
    place.ball();
    let late = |order: &str| -> f64 {
        let options = ["--size", "48x48", "--transfer", "grey", "--order", order, "--stats", "-"];
        let [out, _] = place.run(&[&["render", "ball_16x16x16_uint8.raw"], &options[..]].concat());
        let stats: Value = serde_json::from_str(&out).unwrap();
        stats["late"].as_f64().unwrap() / stats["fragments"].as_f64().unwrap()
    };
    assert_eq!((late("centers"), late("slabs")), (0.0, 0.0));
    // Along a ray the centres' distances and the densest places of a lattice's kernels are in about one order.
    let found = late("per-pixel");
    println!("{found} of the pixels came late");
    assert!(found < 0.2, "{found}");
}

#[test]
fn surfels_by_themselves_are_at_most_16_a_pixel() {
    let place = Workplace::new();
    place.cube();
    let near = ["render", "cube.obj", "--eye", "0,0,1.01", "--stats", "-", "--size", "20x10"];
    // What is cut is made as a whole.
    let args = [&near[..], &["--clip-plane", "0,0,1,-0.99"]].concat();
    let stats: Value = serde_json::from_str(&place.run(&args)[0]).unwrap();
    // The face is 0.01 away: a pixel there is 0.0005 wide, and the cube has an area of 24. 256×256 pixels count at least.
    let found = stats["splats"].as_u64().unwrap();
    assert!(found <= 16 << 16 && found > 8 << 16, "{found}");
}

#[test]
fn small_pictures_close_to_a_wall_show_it_whole() {
    let place = Workplace::new();
    place.cube();
    let args = ["render", "cube.obj", "--size", "24x24", "--background", "00000000", "--fov", "60"];
    for (eye, target) in [("0.95,0,0", "0.95,0,5"), ("0.9999,0,0", "5,0,5"), ("0.9999,0,0", "0.9999,0,5")] {
        place.run(&[&args[..], &["--up", "0,1,0", "--eye", eye, "--target", target]].concat());
        let least = levels(&place.path("oblate.png")).pixels().map(|p| p[3]).min().unwrap();
        assert!(least >= 253, "{eye}: an alpha of {least}");
    }
}

#[test]
fn a_refused_place_is_called_by_the_users_name_for_it() {
    let place = Workplace::new();
    place.cube();
    let message = place.refusal(&["render", "cube.obj", "-o", "nowhere/a.png"]);
    assert!(message.contains("cannot write nowhere/a.png: ") && !message.contains(".oblate-"), "{message}");
    std::fs::create_dir(place.path("folder.png")).unwrap();
    let message = place.refusal(&["render", "cube.obj", "-o", "folder.png"]);
    assert!(message.contains("it is a folder"), "{message}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_program_that_is_ended_leaves_nothing() {
    let place = Workplace::new();
    place.cube();
    // A reference that takes long.
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin!("oblate"))
        .current_dir(place.path("."))
        .args(["render", "cube.obj", "--size", "2000x2000", "--reference", "r2", "--samples", "60000"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // The camera is said after the outputs were begun.
    let mut said = std::io::BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    std::io::BufRead::read_line(&mut said, &mut line).unwrap();
    assert!(line.contains("camera: "), "{line}");
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(place.files(), ["cube.obj"]);
}

#[test]
fn quiet_says_nothing() {
    let place = Workplace::new();
    place.cube();
    assert_eq!(draw(&place, &["--quiet", "--surfels", "500"]), ["", ""]);
}

#[test]
fn a_picture_appears_whole_or_not_at_all() {
    let place = Workplace::new();
    place.cube();
    place.write("kept.png", "something older");
    // Fails after the output's place was looked at.
    place.refusal(&["render", "missing.glb", "-o", "kept.png"]);
    assert_eq!(std::fs::read(place.path("kept.png")).unwrap(), b"something older");
    assert_eq!(place.files(), ["cube.obj", "kept.png"]);
    draw(&place, &["-o", "kept.png", "--surfels", "500"]);
    assert_eq!(levels(&place.path("kept.png")).dimensions(), (32, 32));
    assert_eq!(place.files(), ["cube.obj", "kept.png"]);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As open as any file that this process makes.
        let [picture, plain] =
            ["kept.png", "cube.obj"].map(|n| std::fs::metadata(place.path(n)).unwrap().permissions().mode());
        assert_eq!(picture, plain);
    }
}

#[test]
fn any_number_of_threads_draws_the_same_bytes() {
    let place = Workplace::new();
    place.cube();
    place.ball();
    place.write(
        "scene.toml",
        "version = 1\n[[volume]]\npath = 'ball_16x16x16_uint8.raw'\niso = [150]\ntransfer = 'grey'\n\
         [[mesh]]\npath = 'cube.obj'\nscale = 3\ntranslate = [9, 5, 8]\nsurfels = 3000\n",
    );
    let picture = |threads: &str| {
        place.run(&["render", "scene.toml", "--size", "48x48", "--threads", threads, "-o", "t.exr"]);
        std::fs::read(place.path("t.exr")).unwrap()
    };
    let one = picture("1");
    assert!(one == picture("2") && one == picture("5"));
}

#[test]
fn iso_and_transfer_each_draw() {
    let place = Workplace::new();
    place.ball();
    let draw = |name: &str, args: &[&str]| {
        let fixed = [
            "render",
            "ball_16x16x16_uint8.raw",
            "--size",
            "32x32",
            "--background",
            "000000",
            "--stats",
            "-",
        ];
        let eye = ["--eye", "7.5,-40,7.5", "--target", "7.5,7.5,7.5", "-o", name];
        let [stats, _] = place.run(&[&fixed[..], &eye[..], args].concat());
        let stats: Value = serde_json::from_str(&stats).unwrap();
        let bright = if name.ends_with(".png") { brightness(&place.path(name)) } else { f64::NAN };
        (stats["splats"].as_u64().unwrap(), bright)
    };
    let (iso, _) = draw("iso.png", &["--iso", "100"]);
    let (two, _) = draw("two.png", &["--iso", "100,150"]);
    let (inside, glow) = draw("inside.png", &["--transfer", "grey"]);
    let (both, _) = draw("both.png", &["--iso", "100", "--transfer", "grey"]);
    let (fitted, _) = draw("fitted.png", &[]);
    assert!(iso > 100 && two > iso && inside > 500 && fitted > 500);
    assert_eq!(both, iso + inside);
    assert!(glow > 1.0, "{glow}");
    // A surface of radius 4 in front of the middle: z = 47.5 − 4.
    draw("iso.exr", &["--iso", "100"]);
    let file = exr::prelude::read_first_flat_layer_from_file(place.path("iso.exr")).unwrap();
    let z = file.layer_data.channel_data.list.iter().find(|c| c.name == *"Z").unwrap();
    let middle = z.sample_data.value_by_flat_index(16 * 32 + 16).to_f32();
    // Pixels are 0.8 wide there, the pixel's centre is half a one off the axis: 4 − √(16 − 0.32) = 0.04; the
    // ball's values are cut to integers (1/25 voxel), its lattice is coarse (curvature: about 1/8 of 1/4 voxel).
    assert!((middle - 43.54).abs() < 0.15, "{middle}");
}

#[test]
fn an_invisible_volume_gives_a_message_and_the_background() {
    let place = Workplace::new();
    place.ball();
    let [_, err] =
        place.run(&["render", "ball_16x16x16_uint8.raw", "--size", "16x16", "--iso", "250", "-o", "n.png"]);
    assert!(err.contains("nothing in it is visible") && err.contains("0 to "), "{err}");
    assert!(levels(&place.path("n.png")).pixels().all(|p| p.0 == [0x20, 0x20, 0x20, 0xff]));
}

#[test]
fn references_draw_what_the_rasterizer_draws() {
    let place = Workplace::new();
    place.cube();
    let small = ["render", "cube.obj", "--size", "12x12", "--surfels", "300"];
    place.run(&[&small[..], &["-o", "fast.png"]].concat());
    let [stats, _] =
        place.run(&[&small[..], &["-o", "r1.png", "--reference", "r1", "--stats", "-"]].concat());
    let stats: Value = serde_json::from_str(&stats).unwrap();
    assert!(["culled", "occluded", "merged", "forms"].iter().all(|key| stats[key].is_null()), "{stats}");
    assert!(stats["visible"].is_null() && stats["stages_ms"].as_object().unwrap().is_empty(), "{stats}");
    place.run(&[&small[..], &["-o", "r2.png", "--reference", "r2", "--samples", "16"]].concat());
    let psnr = |b: &str| -> f64 {
        let [text, _] = place.run(&["compare", "fast.png", b]);
        text.lines().next().unwrap().split(' ').nth(1).unwrap().parse().unwrap()
    };
    // The engine's own tests hold tight bounds; here it is only that both are pictures of the same thing.
    assert!(psnr("r1.png") > 20.0, "{}", psnr("r1.png"));
    assert!(psnr("r2.png") > 20.0, "{}", psnr("r2.png"));
}

#[test]
fn slabs_come_closer_to_the_reference_than_centers() {
    let place = Workplace::new();
    place.ball();
    let draw = |name: &str, options: &[&str]| {
        let fixed = ["render", "ball_16x16x16_uint8.raw", "--transfer", "grey", "--size", "24x24"];
        place.run(&[&fixed[..], &["--shade", "off", "-o", name], options].concat());
    };
    draw("r1.exr", &["--reference", "r1"]);
    let figure = |options: &[&str], name: &str| -> f64 {
        draw("fast.exr", options);
        let [text, _] = place.run(&["compare", "fast.exr", "r1.exr"]);
        let found = text.lines().find_map(|line| line.strip_prefix(name)).unwrap();
        found.trim().split(' ').next().unwrap().parse().unwrap()
    };
    // The order alone, with exact footprints, and ends so far that they don't matter.
    let [centers, pixels, slabs, thick] = [
        &["--order", "centers"][..],
        &["--order", "per-pixel"],
        &["--order", "slabs"],
        &["--slab-thickness", "8"],
    ]
    .map(|options| {
        figure(&[options, &["--footprint", "exact", "--tolerance", "1/4096"]].concat(), "mean error ")
    });
    println!("centers {centers}, per pixel {pixels}, slabs {slabs}, thick slabs {thick}");
    // Kernels of 0.7 voxel are sorted along lines of sight either way: the depths at pixels change little.
    assert!(pixels < 2.0 * centers);
    assert!(slabs < 0.2 * centers && thick > 5.0 * slabs);
    // What is left open keeps to the tolerance, whichever it is.
    for (tolerance, most) in [("1/255", 1.0 / 255.0), ("0.5/255", 0.5 / 255.0)] {
        let auto = figure(&["--tolerance", tolerance, "--stats", "stats.json"], "99.9 % error ");
        let stats: Value = serde_json::from_slice(&std::fs::read(place.path("stats.json")).unwrap()).unwrap();
        println!("{tolerance}: {auto}, {}", stats["way"]);
        assert!(auto <= most, "{tolerance}: {auto}, {stats}");
        assert!(stats["way"].is_string() && stats["settle_ms"].is_number(), "{stats}");
    }
}

/// As /dev/null must: a file moved over it would take it from everybody.
#[cfg(unix)]
#[test]
fn a_pipe_stays_a_pipe_and_a_link_a_link() {
    use std::os::unix::fs::FileTypeExt;
    let place = Workplace::new();
    place.cube();
    place.write("kept.png", "");
    let [pipe, link] = ["stats.json", "link.png"].map(|name| place.path(name));
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    std::os::unix::fs::symlink("kept.png", &link).unwrap();
    let reader = {
        let pipe = pipe.clone();
        std::thread::spawn(move || std::fs::read_to_string(pipe).unwrap())
    };
    place.run(&["render", "cube.obj", "-o", "link.png", "--size", "16x16", "--stats", "stats.json"]);
    assert!(reader.join().unwrap().starts_with('{'));
    assert!(pipe.symlink_metadata().unwrap().file_type().is_fifo());
    assert!(link.symlink_metadata().unwrap().is_symlink());
    assert_eq!(levels(&place.path("kept.png")).dimensions(), (16, 16));
}
