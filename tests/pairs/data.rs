//! Pairs of photographs with depths and poses.

use glam::{DAffine3, DVec2, DVec3};
use oblate::engine::{Intrinsics, Pose};
use oblate::importers::OpenOptions;
use oblate::importers::depth::{DepthEncoding, read_color, read_depth, read_poses};
use oblate::surfels::{DepthKind, RgbdImage};
use std::path::{Path, PathBuf};

/// An image, and what was seen elsewhere.
pub(crate) struct Pair {
    pub(crate) name: String,
    pub(crate) source: RgbdImage,
    pub(crate) target: RgbdImage,
}

/// The folder of images with depths; `None`, said, where it is missing and may be.
pub(crate) fn folder() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = std::env::var_os("OBLATE_DATA").map_or_else(beside, PathBuf::from).join("rgbd");
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var_os("OBLATE_REQUIRE_DATA").is_none(), "{} is missing", folder.display());
    println!("skipped: {} is missing", folder.display());
    None
}

fn image(
    [color, depth]: [PathBuf; 2],
    encoding: DepthEncoding,
    ([focal, x, y], pose): ([f64; 3], Pose),
) -> RgbdImage {
    let most = OpenOptions::MAX_MEMORY;
    let photograph = read_color(color, most).expect("a photograph");
    let map = read_depth(depth, &encoding, most).expect("depths");
    // Data sets count from the centre of the first pixel.
    let intrinsics = Intrinsics { focal: DVec2::splat(focal), center: DVec2::new(x, y) + 0.5 };
    let (size, colors, depths) = (photograph.size, photograph.colors, map.depths);
    RgbdImage { size, colors, depths, kind: DepthKind::AlongAxis, intrinsics, pose }
}

/// 7-Scenes, "red kitchen": a hand-held Kinect, 20, 60 and 100 frames apart.
pub(crate) fn kitchen(folder: &Path) -> Vec<Pair> {
    let seen = |frame: usize| {
        let file = |what: &str| folder.join(format!("7scenes/frame-{frame:06}.{what}"));
        let pose = read_poses(file("pose.txt")).expect("a pose")[0].pose;
        image([file("color.jpg"), file("depth.png")], DepthEncoding::Auto, ([585.0, 320.0, 240.0], pose))
    };
    let from = [0, 100, 220, 340, 460, 580, 700, 820, 880];
    let pair = |(frame, step): (usize, usize)| Pair {
        name: format!("kitchen {frame}, {}", frame + step),
        source: seen(frame),
        target: seen(frame + step),
    };
    from.into_iter().flat_map(|frame| [20, 60, 100].map(|step| (frame, step))).map(pair).collect()
}

/// A living room, without noise.
pub(crate) fn living_room(folder: &Path) -> Vec<Pair> {
    let folder = folder.join("open3d_livingroom");
    let poses = read_poses(folder.join("trajectory.log")).expect("poses");
    let seen = |frame: usize| {
        let file = |what: &str, ending: &str| folder.join(format!("{what}/{frame:05}.{ending}"));
        let camera = ([525.0, 319.5, 239.5], poses[frame].pose);
        image([file("color", "jpg"), file("depth", "png")], DepthEncoding::Auto, camera)
    };
    let pair =
        |[a, b]: [usize; 2]| Pair { name: format!("living room {a}, {b}"), source: seen(a), target: seen(b) };
    [[0, 1], [0, 4], [4, 0]].map(pair).into()
}

/// Middlebury 2003, "teddy", both ways. Neither focal length nor baseline is known: 900 px and 0.16 m make depths of 2.7 to 12 m, and the pictures
/// depend on neither.
pub(crate) fn teddy(folder: &Path) -> Vec<Pair> {
    let folder = folder.join("middlebury2003_teddy");
    let seen = |(name, x): (usize, f64)| {
        let files = [format!("im{name}.png"), format!("disp{name}.pgm")].map(|file| folder.join(file));
        let encoding = DepthEncoding::Disparity { baseline_focal: 900.0 * 0.16, offset: 0.0, scale: 4.0 };
        let pose = Pose { world_to_camera: DAffine3::from_translation(DVec3::new(-x, 0.0, 0.0)) };
        image(files, encoding, ([900.0, 224.5, 187.0], pose))
    };
    let (left, right) = ((2, 0.0), (6, 0.16));
    let pair = |[a, b]: [(usize, f64); 2]| Pair {
        name: format!("teddy {}, {}", a.0, b.0),
        source: seen(a),
        target: seen(b),
    };
    [[left, right], [right, left]].map(pair).into()
}
