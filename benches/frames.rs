//! Whole frames, drawn by one renderer that keeps its buffers, as a program that turns the camera does.
//!
//! `cargo bench --bench frames`, or `cargo bench --bench frames -- "T3 opacity/auto"` for one of them. Some need data
//! (`OBLATE_DATA`, else `../shared/data`) and are skipped where it is missing.

mod common;

use common::volumes::{ENGINE, data, engine_surface, volume};
use criterion::{Criterion, criterion_group, criterion_main};
use oblate::engine::Renderer;
use std::cell::LazyCell;

fn frames(criterion: &mut Criterion) {
    for work in common::works().into_iter().filter(common::Work::is_available) {
        // Made when the first of its frames is not filtered out.
        let scene = LazyCell::new(work.scene);
        let mut group = criterion.benchmark_group(work.name);
        group.sample_size(10);
        for frame in &work.frames {
            group.bench_function(frame.name, |bencher| {
                let mut renderer = Renderer::new();
                let mut draw = || {
                    renderer.render(&scene, &frame.camera, &frame.settings, &()).expect("it can be drawn");
                };
                draw();
                bencher.iter(draw);
            });
        }
        group.finish();
    }
}

fn extraction(criterion: &mut Criterion) {
    if !data(ENGINE).is_file() {
        return;
    }
    let volume = volume(ENGINE);
    let mut group = criterion.benchmark_group("T2");
    group.sample_size(10).bench_function("extract", |bencher| bencher.iter(|| engine_surface(&volume)));
    group.finish();
}

criterion_group!(benches, frames, extraction);
criterion_main!(benches);
