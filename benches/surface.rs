//! From a volume to the picture of its surface: the engine at 100, at 1024² and 400².
//!
//! `cargo bench --bench surface` on two threads. `whole` is extraction, cloud and picture, as when a user moves the value; what is kept
//! from one time to the next is the hierarchy, the memory of the surfels and of the cloud, and the renderer's buffers. Then each part
//! by itself, and the stages of drawing: of those that tiles go through the share of one thread. Drawn in the way that is settled for
//! the surface once, as `oblate render` does.

mod common;
#[path = "../src/stats.rs"]
#[expect(dead_code, unused_imports, reason = "the program's report says more, and has tests")]
mod stats;

use common::volumes::{ENGINE, ENGINE_ISO, volume};
use criterion::{Criterion, criterion_group, criterion_main};
use oblate::engine::{Cloud, Renderer, Scene, Stage, settle};
use oblate::volumes::{Interpolation, IsoExtractor, IsoSettings, IsoSurfels, Volume};
use rayon::ThreadPoolBuilder;
use stats::{FrameTimes, StageClock};
use std::time::{Duration, Instant};

const THREADS: usize = 2;

/// What is kept from one value to the next.
struct Viewer<'a> {
    extractor: IsoExtractor<&'a Volume>,
    surfels: IsoSurfels,
    scene: Scene,
    renderer: Renderer,
}

impl Viewer<'_> {
    fn extract(&mut self) {
        let made = self.extractor.extract_into(ENGINE_ISO, Interpolation::Trilinear, &mut self.surfels);
        made.expect("the value is finite");
    }

    fn renew_cloud(&mut self) {
        let cloud = &mut self.scene.clouds[0];
        self.surfels.renew_cloud(cloud, &IsoSettings::default()).expect("surfels are finite");
    }

    fn draw(&mut self, frame: &common::Frame) -> FrameTimes {
        let (clock, begun) = (StageClock::default(), Instant::now());
        self.renderer.render(&self.scene, &frame.camera, &frame.settings, &clock).expect("it can be drawn");
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
    let scene = Scene { clouds: vec![Cloud::default()], lights: Vec::new() };
    let mut viewer = Viewer { extractor, surfels, scene, renderer: Renderer::new() };
    pool.install(|| {
        viewer.extract();
        viewer.renew_cloud();
    });
    assert!(viewer.scene.clouds == (work.scene)().clouds, "it is not T2 that is made");
    let mut group = criterion.benchmark_group("surface");
    group.sample_size(10);
    group.bench_function("extraction", |bencher| bencher.iter(|| pool.install(|| viewer.extract())));
    group.bench_function("cloud", |bencher| bencher.iter(|| pool.install(|| viewer.renew_cloud())));
    for frame in work.frames {
        let settled = settle(&viewer.scene, &frame.camera, &frame.settings).expect("it can be drawn");
        let frame = &common::Frame { settings: settled, ..frame };
        let name = |part: &str| format!("{} {part}", frame.name);
        group.bench_function(name("whole"), |bencher| {
            bencher.iter(|| {
                pool.install(|| {
                    viewer.extract();
                    viewer.renew_cloud();
                    viewer.draw(frame);
                });
            });
        });
        group.bench_function(name("picture"), |bencher| {
            bencher.iter(|| pool.install(|| viewer.draw(frame)));
        });
        for stage in [Stage::Cull, Stage::Footprint, Stage::Bin, Stage::Layers, Stage::Resolve] {
            group.bench_function(name(stage.name()), |bencher| {
                bencher.iter_custom(|frames| {
                    let of_stage = |_| {
                        let times = pool.install(|| viewer.draw(frame));
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
