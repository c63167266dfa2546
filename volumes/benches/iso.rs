//! The engine volume to iso-surfels: at 100 with and without the making of the hierarchy, at a sparse second value, as a cloud.
//!
//! Needs `OBLATE_DATA` (else `../shared/data`) and says so where the volume is missing.
//! `cargo bench -p oblate-volumes --bench iso`

use std::io::Read;
use std::path::PathBuf;

use criterion::{Criterion, criterion_group, criterion_main};
use flate2::read::GzDecoder;
use oblate_volumes::{GridFrame, Interpolation, IsoExtractor, IsoSettings, IsoSurfels, Volume, Voxels};

fn engine() -> Option<Volume> {
    let root = std::env::var_os("OBLATE_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")),
        PathBuf::from,
    );
    let path = root.join("volumes/engine_256x256x128_uint8.raw.gz");
    let Ok(file) = std::fs::File::open(&path) else {
        eprintln!("skipped: {} is missing", path.display());
        return None;
    };
    let mut bytes = Vec::new();
    GzDecoder::new(file).read_to_end(&mut bytes).expect("the file is whole");
    Some(Volume::new([256, 256, 128], Voxels::U8(bytes), GridFrame::default()).expect("the sizes fit"))
}

fn iso(criterion: &mut Criterion) {
    let Some(volume) = engine() else { return };
    let mut group = criterion.benchmark_group("engine");
    group.sample_size(20);
    group.bench_function("hierarchy", |b| b.iter(|| IsoExtractor::new(&volume)));
    let mut kept = IsoSurfels::default();
    group.bench_function("hierarchy and 100", |b| {
        b.iter(|| IsoExtractor::new(&volume).extract_into(100.0, Interpolation::Trilinear, &mut kept));
    });
    let extractor = IsoExtractor::new(&volume);
    for (name, value, interpolation) in [
        ("100", 100.0, Interpolation::Trilinear),
        ("230", 230.0, Interpolation::Trilinear),
        ("100 tricubic", 100.0, Interpolation::Tricubic),
    ] {
        let mut kept = IsoSurfels::default();
        group.bench_function(name, |b| {
            b.iter(|| extractor.extract_into(value, interpolation, &mut kept));
        });
    }
    group.bench_function("100 to new memory", |b| {
        b.iter(|| extractor.extract(100.0, Interpolation::Trilinear));
    });
    group.bench_function("surfels to a cloud", |b| b.iter(|| kept.cloud(&IsoSettings::default())));
    group.finish();
}

criterion_group!(benches, iso);
criterion_main!(benches);
