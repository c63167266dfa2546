//! Leaving out what is hidden changes nothing that is seen.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod ends;
mod mixed;
mod random;
#[path = "../scenes/mod.rs"]
mod scenes;
mod surfaces;

use oblate_engine::{Camera, Cloud, Counts, Frame, RenderSettings, Scene, render};
use scenes::Counter;

fn counted(clouds: &[Cloud], camera: &Camera, settings: &RenderSettings) -> (Frame, Counts) {
    let counter = Counter::default();
    let scene = Scene { clouds: clouds.to_vec(), lights: Vec::new() };
    let frame = render(&scene, camera, settings, &counter).unwrap();
    (frame, counter.0.into_inner().unwrap())
}

/// Draws a scene with and without occlusion, checks that both are alike, and gives the picture and the counts of both.
fn alike(clouds: &[Cloud], camera: &Camera, settings: &RenderSettings) -> (Frame, [Counts; 2]) {
    let (without, all) = counted(clouds, camera, &RenderSettings { occlusion: false, ..*settings });
    let (with, rest) = counted(clouds, camera, &RenderSettings { occlusion: true, ..*settings });
    assert_eq!(all.occluded, 0, "nothing is left out where that isn't asked for");
    assert!(rest.visible <= all.visible && rest.visible + rest.occluded >= all.visible);
    // A layer's samples are summed batch by batch, and what is left out moves the batches' ends: sums of up to a hundred
    // terms differ by as many roundings, 2⁻²⁴ of the sum each, more where layers take from each other.
    let are_near = |frame: &Frame, other: &Frame, place: usize| {
        let colors = frame.color[place].iter().zip(&other.color[place]);
        let normals = frame.normal[place].iter().zip(&other.normal[place]);
        colors.chain(normals).all(|(a, b)| (a - b).abs() <= 1e-4)
    };
    for place in 0..without.color.len() {
        let pixel = [place % without.width, place / without.width];
        let (color, other) = (without.color[place], with.color[place]);
        assert!(are_near(&without, &with, place), "pixel {pixel:?} is {other:?}, not {color:?}");
        let (depth, other) = (without.depth[place], with.depth[place]);
        let is_near = depth == other || (depth - other).abs() <= 1e-5 * depth.abs();
        assert!(is_near, "pixel {pixel:?} is {other} away, not {depth}");
    }
    assert_eq!(without.id, with.id);
    (with, [all, rest])
}

/// The same splats, neighbours in space together: so clusters are small.
fn in_order(cloud: &Cloud) -> Cloud {
    Cloud::new(cloud.splats().in_morton_order()).unwrap().transformed(cloud.cloud_to_world())
}
