//! From a depth image to its picture from elsewhere: a room of 640×480 pixels.
//!
//! `cargo bench --bench warp` on two threads. `whole` is surfels and picture, as for a video; what is kept from one image to the
//! next is memory: the renderer's, the sampler's and the cloud's. `anew` is the same with another cloud for each image. Then both by themselves, the stages of drawing (of those that tiles go through the share of one
//! thread), and in the same run what others do with depth images, each on one thread.

#[path = "../src/stats.rs"]
#[expect(dead_code, unused_imports, reason = "the program's report says more, and has tests")]
mod stats;

use criterion::{Criterion, criterion_group, criterion_main};
use oblate::chart::baselines::{mcmillan, nearest, softmax, supersampled, triangles};
use oblate::engine::{Blend, Camera, Channels, RenderSettings, Renderer, Scene, Stage};
use oblate::surfels::{
    DEPTH_LOW_PASS, DepthError, DepthSampler, DepthSettings, RgbdImage, Room, depth_surfels,
};
use rayon::ThreadPoolBuilder;
use stats::{FrameTimes, StageClock};
use std::hint::black_box;
use std::time::{Duration, Instant};

const THREADS: usize = 2;
const WIDTH: u32 = 640;

/// Neighbours whose depths differ by a larger share belong to different triangles.
const LARGEST_STEP: f32 = 0.05;

fn scene(image: &RgbdImage) -> Scene {
    let cloud = depth_surfels(image, &DepthSettings::default()).expect("the room has depths");
    Scene { clouds: vec![cloud], lights: Vec::new() }
}

fn draw(renderer: &mut Renderer, scene: &Scene, view: &Camera) -> FrameTimes {
    let settings = RenderSettings {
        low_pass: DEPTH_LOW_PASS,
        blend: Blend::Display,
        shade: false,
        channels: Channels::Color,
        ..RenderSettings::default()
    };
    let (clock, begun) = (StageClock::default(), Instant::now());
    renderer.render(scene, view, &settings, &clock).expect("it can be drawn");
    clock.finish(begun.elapsed(), THREADS)
}

fn warp(criterion: &mut Criterion) {
    let [camera, view] = [Room.camera(WIDTH), Room.other_camera(WIDTH)].map(|c| c.expect("it is a camera"));
    let image = Room.image(&camera);
    let pool = ThreadPoolBuilder::new().num_threads(THREADS).build().expect("two threads can be had");
    let mut renderer = Renderer::new();
    let mut group = criterion.benchmark_group("warp");
    group.sample_size(10);
    group.bench_function("surfels", |bencher| bencher.iter(|| pool.install(|| scene(&image))));
    let made = pool.install(|| scene(&image));
    group.bench_function("picture", |bencher| {
        bencher.iter(|| pool.install(|| draw(&mut renderer, &made, &view)));
    });
    group.bench_function("anew", |bencher| {
        bencher.iter(|| pool.install(|| draw(&mut renderer, &scene(&image), &view)));
    });
    group.bench_function("whole", |bencher| {
        let (mut sampler, mut kept) = (DepthSampler::default(), made.clone());
        bencher.iter(|| {
            pool.install(|| {
                let images = std::slice::from_ref(&image);
                sampler
                    .sample(&mut kept.clouds, images, &view, &DepthSettings::default())
                    .expect("the room has depths");
                draw(&mut renderer, &kept, &view)
            })
        });
    });
    for stage in [Stage::Cull, Stage::Footprint, Stage::Order, Stage::Bin, Stage::Layers, Stage::Resolve] {
        group.bench_function(stage.name(), |bencher| {
            bencher.iter_custom(|frames| {
                let of_stage = |_| {
                    let times = pool.install(|| draw(&mut renderer, &made, &view));
                    Duration::from_secs_f64(times.stages_ms[stage as usize] / 1e3)
                };
                (0..frames).map(of_stage).sum()
            });
        });
    }
    type Baseline = fn(&RgbdImage, &Camera) -> Result<oblate::engine::Frame, DepthError>;
    let baselines: [(&str, Baseline); 6] = [
        ("nearest", |image, view| nearest(image, view, 1)),
        ("nearest, 3×3", |image, view| nearest(image, view, 3)),
        ("McMillan", mcmillan),
        ("triangles", |image, view| triangles(image, view, LARGEST_STEP)),
        ("supersampled, 2×2", |image, view| supersampled(image, view, 2)),
        ("softmax", softmax),
    ];
    for (name, baseline) in baselines {
        group.bench_function(name, |bencher| {
            bencher.iter(|| black_box(baseline(&image, &view).expect("the image is one")));
        });
    }
    group.finish();
}

criterion_group!(benches, warp);
criterion_main!(benches);
