//! A renderer in a steady state allocates nothing that grows with splats or pixels.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::DVec3;
use oblate_engine::{Camera, Channels, RenderSettings, Renderer, Scene};
use scenes::*;

#[global_allocator]
static ALLOCATOR: dhat::Alloc = dhat::Alloc;

/// Shares of 512² pixels and of 275,000 splats are far beyond this: a byte for each would be 256 KiB.
const MOST_BYTES: u64 = 64 << 10;

fn view(step: f64) -> Camera {
    looking_from(DVec3::new(2.0 + 0.02 * step, 1.5, -4.0 - 0.01 * step), 512)
}

// One test in this program: the counters are the whole process's.
#[test]
fn a_third_frame_allocates_next_to_nothing() {
    let scene = Scene {
        clouds: vec![
            fog([60; 3], DVec3::splat(0.04), 0.5, [0.3, 0.5, 0.9]),
            sphere(50_000, 0.9, [0.9, 0.4, 0.1]),
            plane(100, 0.03, [0.8; 3]).transformed(tilted(50.0, DVec3::ZERO)),
        ],
        lights: Vec::new(),
    };
    let splats: usize = scene.clouds.iter().map(|cloud| cloud.len()).sum();
    assert!(splats >= 200_000, "{splats} splats");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    for channels in [Channels::Color, Channels::All] {
        let settings = RenderSettings { channels, ..RenderSettings::default() };
        let mut renderer = Renderer::new();
        // Buffers are as large as the largest frame so far: the views of the first two enclose the third's.
        for step in [0.0, 2.0] {
            pool.install(|| renderer.render(&scene, &view(step), &settings, &()).map(|_| ())).unwrap();
        }
        let camera = view(1.0);
        let profiler = dhat::Profiler::builder().testing().build();
        let alpha = pool.install(|| {
            let frame = renderer.render(&scene, &camera, &settings, &()).unwrap();
            frame.color[256 * 512 + 256][3]
        });
        let found = dhat::HeapStats::get();
        drop(profiler);
        println!("{channels:?}: {} bytes in {} blocks", found.total_bytes, found.total_blocks);
        assert!(alpha > 0.5, "the middle of the picture is empty");
        assert!(
            found.total_bytes <= MOST_BYTES,
            "{channels:?}: {} bytes in {} blocks",
            found.total_bytes,
            found.total_blocks
        );
    }
}
