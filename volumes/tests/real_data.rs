//! Scanned volumes, where they are at hand: what is proposed and built for them is what a user would want.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use common::{real_bytes, real_engine, real_head};
use oblate_volumes::{
    GridFrame, IsoSettings, KernelSettings, PRESETS, Volume, Voxels, iso_surfels, propose_iso, to_kernels,
};

#[test]
fn engine() {
    let Some(volume) = real_engine() else { return };
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
    let Some(volume) = real_head() else { return };
    // Skin: between air (below 300) and soft tissue (around 1050).
    let iso = propose_iso(&volume).unwrap();
    assert!((300.0..1000.0).contains(&iso), "{iso}");
}

#[test]
fn aneurism() {
    let Some(bytes) = real_bytes("aneurism_256x256x256_uint8.raw.gz") else { return };
    let volume = Volume::new([256; 3], Voxels::U8(bytes), GridFrame::default()).unwrap();
    let transfer = PRESETS[0].fit(&volume).unwrap();
    // 99 % are empty; what is left must not be lost for being little.
    assert_eq!(transfer.at(0.0).extinction, 0.0);
    let vessel = transfer.at(255.0).extinction;
    assert!((0.05..0.5).contains(&vessel), "{vessel} a step");
}
