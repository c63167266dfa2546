//! Scanned volumes, where they are at hand: what is proposed and built for them is what a user would want.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

use std::io::Read;
use std::path::PathBuf;

use flate2::read::GzDecoder;
use glam::DVec3;
use oblate_volumes::{
    GridFrame, IsoSettings, KernelSettings, PRESETS, Volume, Voxels, iso_surfels, propose_iso, to_kernels,
};

/// The bytes of a gzipped file of the test data; `None`, said aloud, if it is not there.
fn bytes(name: &str) -> Option<Vec<u8>> {
    let root = std::env::var_os("OBLATE_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")),
        PathBuf::from,
    );
    let path = root.join("volumes").join(name);
    let Ok(file) = std::fs::File::open(&path) else {
        assert!(
            std::env::var_os("OBLATE_REQUIRE_DATA").is_none_or(|v| v != "1"),
            "{} is missing",
            path.display()
        );
        println!("skipped: {} is missing", path.display());
        return None;
    };
    let mut bytes = Vec::new();
    GzDecoder::new(file).read_to_end(&mut bytes).unwrap();
    Some(bytes)
}

#[test]
fn engine() {
    let Some(bytes) = bytes("engine_256x256x128_uint8.raw.gz") else { return };
    let volume = Volume::new([256, 256, 128], Voxels::U8(bytes), GridFrame::default()).unwrap();
    // Between air (around 3) and aluminium (around 140).
    let iso = propose_iso(&volume).unwrap();
    assert!((60.0..150.0).contains(&iso), "{iso}");
    let surfels = iso_surfels(&volume, 100.0, &IsoSettings::default()).unwrap();
    println!("engine: iso {iso}, {} surfels at 100", surfels.len());
    assert!((250_000..350_000).contains(&surfels.len()));
    let kernels = to_kernels(&volume, &PRESETS[0].fit(&volume).unwrap(), &KernelSettings::default()).unwrap();
    println!("engine: {} kernels", kernels.len());
    // 77 % of the samples are below 8 and 6 % below 16: noise around the engine, which must not show.
    assert!((1_000_000..1_800_000).contains(&kernels.len()));
}

#[test]
fn head() {
    let Some(bytes) = bytes("CThead_256x256x113_uint16be.raw.gz") else { return };
    let values = bytes.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect();
    let frame = GridFrame { spacing: DVec3::new(1.0, 1.0, 2.0), ..GridFrame::default() };
    let volume = Volume::new([256, 256, 113], Voxels::U16(values), frame).unwrap();
    // Skin: between air (below 300) and soft tissue (around 1050).
    let iso = propose_iso(&volume).unwrap();
    assert!((300.0..1000.0).contains(&iso), "{iso}");
}

#[test]
fn aneurism() {
    let Some(bytes) = bytes("aneurism_256x256x256_uint8.raw.gz") else { return };
    let volume = Volume::new([256; 3], Voxels::U8(bytes), GridFrame::default()).unwrap();
    let transfer = PRESETS[0].fit(&volume).unwrap();
    // 99 % are empty; what is left must not be lost for being little.
    assert_eq!(transfer.at(0.0).extinction, 0.0);
    let vessel = transfer.at(255.0).extinction;
    assert!((0.05..0.5).contains(&vessel), "{vessel} a step");
}
