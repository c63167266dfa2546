//! Photographs warped to where another one was taken, beside that one and beside what other methods make of them. Without `OBLATE_DATA` or
//! `../shared/data` the test skips, unless `OBLATE_REQUIRE_DATA=1`.
//!
//! `cargo test --release --test pairs -- --nocapture` prints the table of docs/depth.md.

mod data;

use data::Pair;
use glam::DVec2;
use oblate::chart::baselines;
use oblate::engine::color::linear_to_srgb;
use oblate::engine::{Blend, Camera, Frame, RenderSettings, Scene, render};
use oblate::surfels::{DEPTH_LOW_PASS, DepthSettings, RgbdImage, depth_surfels};

const METHODS: [&str; 8] =
    ["oblate", "nearest", "3×3", "McMillan", "triangles", "sheets", "texels 3×3", "softmax"];

/// Display-encoded pictures, in the order of [`METHODS`], black where nothing is.
fn pictures(source: &RgbdImage, view: &Camera) -> [Vec<[f32; 4]>; 8] {
    let cloud = depth_surfels(source, &DepthSettings::default()).expect("the image is right");
    let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
    let settings = RenderSettings {
        low_pass: DEPTH_LOW_PASS,
        blend: Blend::Display,
        shade: false,
        ..RenderSettings::default()
    };
    let ours = render(&scene, view, &settings, &()).expect("the scene is right");
    let encode = |[r, g, b, a]: [f32; 4]| [linear_to_srgb(r), linear_to_srgb(g), linear_to_srgb(b), a];
    // Others resample what is stored.
    let colors = source.colors.iter().map(|color| color.map(linear_to_srgb)).collect();
    let stored = RgbdImage { colors, ..source.clone() };
    let drawn = |frame: Result<Frame, _>| frame.expect("the image is right").color;
    [
        ours.color.iter().map(|pixel| encode(*pixel)).collect(),
        drawn(baselines::nearest(&stored, view, 1)),
        drawn(baselines::nearest(&stored, view, 3)),
        drawn(baselines::mcmillan(&stored, view)),
        drawn(baselines::triangles(&stored, view, 0.05)),
        drawn(baselines::triangles(&stored, view, f32::INFINITY)),
        drawn(baselines::supersampled(&stored, view, 3)),
        drawn(baselines::softmax(&stored, view)),
    ]
}

/// Which pixels of the target the source sees, by the target's own depths: those whose place is as far as the source says, within 3 %.
/// And those whose place lies within a surface there: the nearest 7 × 7 pixels agree within 1 %. A step of a Kinect's depths at 3 m is
/// that much, and moves what is seen from a metre beside by 2 px, which opens edges, but no surface.
fn seen_by_both(Pair { source, target, .. }: &Pair) -> Vec<[bool; 2]> {
    let to_source = source.pose.world_to_camera * target.pose.world_to_camera.inverse();
    let [width, height] = source.size.map(|side| side as i64);
    let seen = |(at, depth): (usize, &f32)| {
        if *depth <= 0.0 {
            return [false; 2];
        }
        let place = DVec2::new((at % target.size[0]) as f64, (at / target.size[0]) as f64) + 0.5;
        let there = to_source.transform_point3(target.ray(place) * f64::from(*depth));
        let pixel = source.intrinsics.focal * there.truncate() / there.z + source.intrinsics.center;
        let agrees = |dx: i64, dy: i64, share: f64| {
            let [x, y] = [pixel.x.floor() as i64 + dx, pixel.y.floor() as i64 + dy];
            let is_inside = there.z > 0.0 && (0..width).contains(&x) && (0..height).contains(&y);
            is_inside && (f64::from(source.depths[(y * width + x) as usize]) / there.z - 1.0).abs() <= share
        };
        [agrees(0, 0, 0.03), (-3..=3).all(|dy| (-3..=3).all(|dx| agrees(dx, dy, 0.01)))]
    };
    target.depths.iter().enumerate().map(seen).collect()
}

struct Score {
    /// Over what both see; holes count as black.
    psnr_db: f64,
    /// Pixels of less than half opacity among them, and within surfaces.
    holes: [usize; 2],
}

fn score(picture: &[[f32; 4]], target: &RgbdImage, seen: &[[bool; 2]]) -> Score {
    let (mut squares, mut count, mut holes) = (0.0, 0.0, [0; 2]);
    for ((pixel, color), [seen, within]) in
        picture.iter().zip(&target.colors).zip(seen).filter(|(_, seen)| seen[0])
    {
        for (drawn, taken) in pixel.iter().zip(color) {
            let level = (drawn.clamp(0.0, 1.0) * 255.0).round() / 255.0;
            squares += f64::from(level - linear_to_srgb(*taken)).powi(2);
            count += 1.0;
        }
        let is_hole = pixel[3] < 0.5;
        holes[0] += usize::from(is_hole && *seen);
        holes[1] += usize::from(is_hole && *within);
    }
    Score { psnr_db: 10.0 * f64::log10(count / squares), holes }
}

#[test]
fn warped_photographs_are_those_taken_there() {
    let Some(folder) = data::folder() else { return };
    let sets = [data::kitchen(&folder), data::living_room(&folder), data::teddy(&folder)];
    let pairs: Vec<Pair> = sets.into_iter().flatten().collect();
    let mut sums = [0.0; METHODS.len()];
    let (mut behind, mut open) = (Vec::new(), 0);
    println!(
        "| pair | {} | holes, within surfaces |\n|---|{}---|",
        METHODS.join(" | "),
        "---|".repeat(METHODS.len())
    );
    for pair in &pairs {
        let view = pair.target.camera().expect("a camera");
        let seen = seen_by_both(pair);
        let scores = pictures(&pair.source, &view).map(|picture| score(&picture, &pair.target, &seen));
        let dbs = scores.each_ref().map(|score| score.psnr_db);
        sums = std::array::from_fn(|i| sums[i] + dbs[i]);
        let row = dbs.map(|db| format!("{db:.2}")).join(" | ");
        let [holes, within] = scores[0].holes;
        println!("| {} | {row} | {holes}, {within} |", pair.name);
        let best = dbs[1..].iter().copied().fold(0.0, f64::max);
        if dbs[0] < best - 0.1 {
            behind.push(format!("{}: {:.3} of {best:.3} dB", pair.name, dbs[0]));
        }
        open += within;
    }
    let means = sums.map(|sum| sum / pairs.len() as f64);
    println!("| mean | {} | |", means.map(|db| format!("{db:.2}")).join(" | "));
    assert_eq!(open, 0, "holes within surfaces");
    assert!(behind.is_empty(), "behind the best by more than 0.1 dB: {behind:?}");
    assert!(means[1..].iter().all(|other| means[0] > *other), "{means:?}");
}
