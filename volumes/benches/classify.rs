//! The engine volume to kernels under T1's transfer function, once and again.
//!
//! Needs `OBLATE_DATA` (else `../shared/data`) and says so where the volume is missing.
//! `cargo bench -p oblate-volumes`

use std::io::Read;
use std::path::PathBuf;

use criterion::{Criterion, criterion_group, criterion_main};
use flate2::read::GzDecoder;
use oblate_volumes::{Classifier, GridFrame, KernelSettings, TransferFunction, Volume, Voxels, to_kernels};

/// Value, sRGB colour, opacity per unit length.
const TRANSFER: &str = include_str!("../../benches/common/glass.transfer");

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

fn classify(criterion: &mut Criterion) {
    let Some(volume) = engine() else { return };
    let transfer: TransferFunction = TRANSFER.parse().expect("the text above is a transfer function");
    let settings = KernelSettings::default();
    let mut group = criterion.benchmark_group("engine");
    group.sample_size(10);
    group.bench_function("to_kernels", |b| b.iter(|| to_kernels(&volume, &transfer, &settings)));
    let classifier = Classifier::new(&volume, settings);
    group.bench_function("classify", |b| b.iter(|| classifier.classify(&transfer)));
    group.finish();
}

criterion_group!(benches, classify);
criterion_main!(benches);
