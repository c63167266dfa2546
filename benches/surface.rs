//! From a volume to the picture of its surface: the engine at 100, at 1024² and 400².
//!
//! `cargo bench --bench surface` on two threads. `whole` is extraction, cloud and picture, as when a user moves the value; what is kept
//! from one time to the next is the hierarchy, the memory of the surfels and the renderer's buffers. Then each part by itself,
//! and the stages of drawing: of those that tiles go through the share of one thread.

mod common;
#[path = "../src/stats.rs"]
#[expect(dead_code, unused_imports, reason = "the program's report says more, and has tests")]
mod stats;

use common::volumes::{ENGINE, ENGINE_ISO, volume};
use criterion::{Criterion, criterion_group, criterion_main};
use oblate::engine::{Cloud, Renderer, Scene, Stage};
use oblate::volumes::{Interpolation, IsoExtractor, IsoSettings, IsoSurfels, Volume};
use rayon::ThreadPoolBuilder;
use stats::{FrameTimes, StageClock};
use std::time::{Duration, Instant};

const THREADS: usize = 2;

/// What is kept from one value to the next.
struct Viewer<'a> {
    extractor: IsoExtractor<&'a Volume>,
    surfels: IsoSurfels,
    renderer: Renderer,
}

impl Viewer<'_> {
    fn extract(&mut self) {
        let made = self.extractor.extract_into(ENGINE_ISO, Interpolation::Trilinear, &mut self.surfels);
        made.expect("the value is finite");
    }

    fn scene(&self) -> Scene {
        let cloud: Cloud = self.surfels.cloud(&IsoSettings::default()).expect("surfels are finite");
        Scene { clouds: vec![cloud], lights: Vec::new() }
    }

    fn draw(&mut self, scene: &Scene, frame: &common::Frame) -> FrameTimes {
        let (clock, begun) = (StageClock::default(), Instant::now());
        self.renderer.render(scene, &frame.camera, &frame.settings, &clock).expect("it can be drawn");
        clock.finish(begun.elapsed(), THREADS)
    }
}

fn surface(criterion: &mut Criterion) {
    let work =
        common::works().into_iter().find(|work| work.name == "T2").expect("T2 is the engine's surface");
    if !work.is_available() {
        return;
    }
    let pool = ThreadPoolBuilder::new().num_threads(THREADS).build().expect("two threads can be had");
    let volume = volume(ENGINE);
    let (extractor, surfels) = (IsoExtractor::new(&volume), IsoSurfels::default());
    let mut viewer = Viewer { extractor, surfels, renderer: Renderer::new() };
    pool.install(|| viewer.extract());
    let mut group = criterion.benchmark_group("surface");
    group.sample_size(10);
    group.bench_function("extraction", |bencher| bencher.iter(|| pool.install(|| viewer.extract())));
    group.bench_function("cloud", |bencher| bencher.iter(|| pool.install(|| viewer.scene())));
    let scene = pool.install(work.scene);
    for frame in &work.frames {
        let name = |part: &str| format!("{} {part}", frame.name);
        group.bench_function(name("whole"), |bencher| {
            bencher.iter(|| {
                pool.install(|| {
                    viewer.extract();
                    let scene = viewer.scene();
                    viewer.draw(&scene, frame);
                });
            });
        });
        group.bench_function(name("picture"), |bencher| {
            bencher.iter(|| pool.install(|| viewer.draw(&scene, frame)));
        });
        for stage in [Stage::Cull, Stage::Footprint, Stage::Bin, Stage::Layers, Stage::Resolve] {
            group.bench_function(name(stage.name()), |bencher| {
                bencher.iter_custom(|frames| {
                    let of_stage = |_| {
                        let times = pool.install(|| viewer.draw(&scene, frame));
                        Duration::from_secs_f64(times.stages_ms[stage as usize] / 1e3)
                    };
                    (0..frames).map(of_stage).sum()
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, surface);
criterion_main!(benches);
