//! Every file of the real data is drawn, or refused for a stated reason. Without `OBLATE_DATA` or `../shared/data` these tests
//! skip, unless `OBLATE_REQUIRE_DATA=1`.

use crate::place::{Workplace, levels};
use oblate::engine::color::srgb_to_linear;
use std::path::{Path, PathBuf};

/// What is drawn: ends of paths in the data where there is a dot in them, else beginnings.
const DRAWN: [&str; 23] = [
    "irregular/",
    "meshes/DamagedHelmet.glb",
    "meshes/Duck.glb",
    "meshes/armadillo.obj",
    "meshes/bunny.ply",
    "meshes/fuze_wood/fuze.obj",
    "meshes/fuze_wood/wood.obj",
    "meshes/lucy.ply",
    "meshes/spot/spot_control_mesh.obj",
    "meshes/spot/spot_quadrangulated.obj",
    "meshes/spot/spot_triangulated.obj",
    "pointclouds/",
    "splats/biker",
    "splats/fixtures/",
    "meta.json",
    "volumes/CThead",
    "volumes/LIDC2.vti",
    "volumes/aneurism",
    "volumes/bonsai",
    "volumes/engine",
    "volumes/tooth",
    "volumes/vtk_hydrogen",
    "volumes/mricron_ch2better.nii.gz",
];

/// Matrices of cameras: text with numbers in three or four columns, which are points for all that the files say.
const COLUMNS: [&str; 2] = ["camera-intrinsics.txt", ".pose.txt"];

/// What the refusal of another file says, by its ending.
fn reason(name: &str) -> &'static str {
    match Path::new(name).extension().and_then(|e| e.to_str()).unwrap_or_default() {
        // Text of that name could be points.
        "txt" => "is no number",
        _ => "not recognised as",
    }
}

/// The folder of the data, if it is there.
fn data() -> Option<PathBuf> {
    let beside = || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data"));
    let root = std::env::var_os("OBLATE_DATA").map_or_else(beside, PathBuf::from);
    if root.is_dir() {
        return Some(root);
    }
    let required = std::env::var_os("OBLATE_REQUIRE_DATA").is_some_and(|value| value == "1");
    assert!(!required, "{} is required", root.display());
    println!("skipped: {} is not there", root.display());
    None
}

/// All files under a folder, as paths relative to it.
fn files(root: &Path, folder: &Path, found: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(root, &path, found);
        } else {
            found.push(path.strip_prefix(root).unwrap().to_str().unwrap().replace('\\', "/"));
        }
    }
}

#[test]
fn every_file_is_drawn_or_refused_for_a_reason() {
    let Some(root) = data() else { return };
    let mut names = Vec::new();
    files(&root, &root, &mut names);
    names.sort();
    let place = Workplace::new();
    let mut drawn = 0;
    for name in &names {
        let path = root.join(name);
        let args = ["render", path.to_str().unwrap(), "--size", "32x32", "--quiet", "-o", "a.png"];
        let is_drawn =
            |part: &&str| if part.contains('.') { name.ends_with(part) } else { name.starts_with(part) };
        if COLUMNS.iter().any(|part| name.ends_with(part)) {
            place.run(&args);
        } else if DRAWN.iter().any(is_drawn) {
            place.run(&args);
            let picture = levels(&place.path("a.png"));
            let seen = picture.pixels().filter(|pixel| *pixel != &image::Rgba([32, 32, 32, 255])).count();
            // The least is a point cloud, flat and seen from aside.
            assert!(seen > 50, "{name}: {seen} pixels differ from the background");
            let [json, _] = place.run(&["info", path.to_str().unwrap(), "--json"]);
            let told: serde_json::Value = serde_json::from_str(&json).unwrap();
            assert!(told["kind"].is_string() && told["bounds"].is_array(), "{name}: {told}");
            drawn += 1;
        } else {
            let message = place.refusal(&args);
            assert!(message.contains(reason(name)) && message.lines().count() == 1, "{name}: {message}");
        }
    }
    assert!(drawn >= 41, "only {drawn} files are drawn");
}

/// Root of the mean squared difference of two pictures, in levels.
fn difference(a: &image::RgbaImage, b: &image::RgbaImage) -> f64 {
    let squares = a.iter().zip(b.iter()).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
    (squares.sum::<f64>() / a.len() as f64).sqrt()
}

#[test]
fn a_scene_looks_the_same_in_two_formats_and_much_the_same_in_all_its_levels() {
    let Some(splats) = data().map(|root| root.join("splats")) else { return };
    let place = Workplace::new();
    let draw = |name: &str, options: &[&str]| {
        let path = splats.join(name);
        let view = ["render", path.to_str().unwrap(), "--size", "128x128", "--quiet", "-o", "a.png"];
        place.run(&[&view[..], options].concat());
        levels(&place.path("a.png"))
    };
    let view = ["--eye", "-2,-3,-5", "--target", "0,-1.6,0"];
    let biker = ["biker.spz", "biker.compressed.ply"].map(|name| draw(name, &view));
    // Opacities and colours of 8 bits are off by half a level in each; dozens of splats, one behind the other, average out.
    let found = difference(&biker[0], &biker[1]);
    assert!(found < 0.5, "{found} levels");

    let view = ["--eye", "1.5,-1.5,-4", "--target", "0,-0.1,0"];
    let level = |number: &str| draw("playbot/lod-meta.json", &[&view[..], &["--level", number]].concat());
    let finest = level("0");
    let found = ["1", "2", "3", "4", "5", "6"].map(|number| difference(&level(number), &finest));
    // Coarser levels are other splats, trained to look alike from afar: half the number costs about 1.2 times the error. A level in a
    // wrong place, size or colour would be as far off as no scene at all, 35 levels.
    assert!(found.windows(2).all(|pair| pair[0] < pair[1] * 1.01) && found[5] < 20.0, "{found:?} levels");
}

/// In a scan a pixel's first sample decides which others are of its layer; families that reach through one are not merged.
#[test]
fn levels_of_a_scan_keep_the_tolerance() {
    let Some(root) = data() else { return };
    let scan = root.join("pointclouds/lone-star.laz");
    let place = Workplace::new();
    let draw = |levels_of_detail: &str, name: &str| {
        // Levels are made where many pictures are drawn.
        let view =
            ["render", scan.to_str().unwrap(), "--size", "64x64", "--tolerance", "2/255", "--repeat", "12"];
        place.run(&[&view[..], &["--quiet", "--level-of-detail", levels_of_detail, "-o", name]].concat());
        levels(&place.path(name))
    };
    let [on, off] = [draw("on", "on.png"), draw("off", "off.png")];
    let linear = |level: u8| 255.0 * srgb_to_linear(f32::from(level) / 255.0);
    let apart = |(a, b): (&image::Rgba<u8>, &image::Rgba<u8>)| {
        a.0.iter().zip(b.0).map(|(a, b)| (linear(*a) - linear(b)).abs()).fold(0.0, f32::max)
    };
    let mut errors: Vec<f32> = on.pixels().zip(off.pixels()).map(apart).collect();
    errors.sort_by(f32::total_cmp);
    // That something differs says that levels are drawn. The tolerance, and half a level each that is rounded, up to 2.3 in linear light.
    let found = errors[errors.len() * 999 / 1000];
    assert!(errors[errors.len() - 1] > 0.0 && found < 4.3, "{found} levels");
}

/// A quarter of the engine's surfels give its picture: at least 40 dB, and 99 % of the pixels within 4 levels.
#[test]
fn a_quarter_of_the_engine_is_enough() {
    let Some(root) = data() else { return };
    let engine = root.join("volumes/engine.vti");
    let (place, engine) = (Workplace::new(), engine.to_str().unwrap());
    let extract = |file: &str, options: &[&str]| -> serde_json::Value {
        let args = ["extract", engine, "--iso", "100", "-o", file, "--stats", "-", "--quiet"];
        let [out, _] = place.run(&[&args[..], options].concat());
        serde_json::from_str(&out).unwrap()
    };
    let whole = extract("whole.ply", &[])["surfels"].as_u64().unwrap();
    // With 0.6 steps a hundredth of the values are off by 5 levels.
    let merging = &extract("merged.ply", &["--merge", "0.5,20"])["merging"];
    assert!(4 * merging["surfels"].as_u64().unwrap() <= whole, "{merging} of {whole}");
    assert!(
        merging["largest_distance"].as_f64() <= Some(0.5)
            && merging["largest_degrees"].as_f64() <= Some(20.0)
    );
    let [whole, merged] = ["whole", "merged"].map(|name| {
        let (file, picture) = (format!("{name}.ply"), format!("{name}.png"));
        let view =
            ["--eye", "457.5,-285,352", "--target", "127.5,127.5,63.5", "--up", "0,0,1", "--size", "512x512"];
        place.run(
            &[&["render", &file, "-o", &picture, "--quiet", "--background", "000000"], &view[..]].concat(),
        );
        levels(&place.path(&picture))
    });
    let mut off: Vec<u8> = whole.iter().zip(merged.iter()).map(|(a, b)| a.abs_diff(*b)).collect();
    let mean = off.iter().map(|d| f64::from(*d).powi(2)).sum::<f64>() / off.len() as f64;
    let decibels = 20.0 * 255_f64.log10() - 10.0 * mean.log10();
    off.sort_unstable();
    let [most, worst] = [0.99, 0.999].map(|share| off[(share * off.len() as f64) as usize]);
    println!("{decibels:.1} dB, {most} levels at 99 % of the values, {worst} at 99.9 %");
    assert!(decibels >= 40.0 && most <= 4, "{decibels} dB, {most} levels at 99 %");
}
