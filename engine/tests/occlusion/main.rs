//! Leaving out what is hidden changes nothing that is seen.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod mixed;
mod random;
#[path = "../scenes/mod.rs"]
mod scenes;
mod surfaces;

use oblate_engine::{Camera, Cloud, Counts, Frame, Observer, RenderSettings, Scene, Stage, render};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Keeps the counts of a frame, and in how many rounds it was drawn.
#[derive(Default)]
struct Counter(Mutex<Counts>, AtomicUsize);

impl Observer for Counter {
    fn begin(&self, stage: Stage) {
        self.1.fetch_add(usize::from(stage == Stage::Footprint), Relaxed);
    }

    fn counts(&self, counts: Counts) {
        *self.0.lock().unwrap() = counts;
    }
}

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
    for (place, (a, b)) in without.color.iter().zip(&with.color).enumerate() {
        let pixel = [place % without.width, place / without.width];
        let off = (0..4).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
        assert!(off <= 1e-4, "pixel {pixel:?} is {b:?}, not {a:?}");
    }
    assert_eq!(without.id, with.id);
    assert_eq!(without.depth, with.depth);
    assert_eq!(without.normal, with.normal);
    (with, [all, rest])
}

/// The same splats, neighbours in space together: so clusters are small.
fn in_order(cloud: &Cloud) -> Cloud {
    Cloud::new(cloud.splats().in_morton_order()).unwrap().transformed(cloud.cloud_to_world())
}
