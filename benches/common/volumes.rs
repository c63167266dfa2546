//! Volumes from files and made ones, and their transfer functions.

use oblate::engine::Cloud;
use oblate::importers::{Content, OpenOptions, Opened, open};
use oblate::volumes::{
    GridFrame, IsoSettings, KernelSettings, TransferFunction, Volume, Voxels, iso_surfels, to_kernels,
};
use std::path::PathBuf;

pub(crate) const ENGINE: &str = "volumes/engine.vti";
pub(crate) const ANEURISM: &str = "volumes/aneurism_256x256x256_uint8.raw.gz";

/// The value of the engine's surface.
pub(crate) const ENGINE_ISO: f32 = 100.0;

/// The engine, semi-transparent. Value, sRGB colour, opacity per unit length.
pub(crate) const GLASS: &str = include_str!("glass.transfer");

/// The engine from 71 on: 1,160,038 voxels.
pub(crate) const ENGINE_FROM_71: &str = "transfer 1
strength opacity_per_unit
color srgb
70   0.5  0.5  0.45  0
71   0.5  0.5  0.45  0.015
80   0.55 0.45 0.35  0.02
140  0.75 0.65 0.5   0.05
180  0.9  0.85 0.8   0.08
220  0.95 0.4  0.2   0.6
255  1.0  0.5  0.2   0.8
";

/// The aneurism from 25 on: 114,695 voxels.
pub(crate) const ANEURISM_FROM_25: &str = "transfer 1
strength opacity_per_unit
color srgb
24   0.6  0.2  0.15  0
25   0.6  0.2  0.15  0.05
120  0.9  0.4  0.3   0.4
255  1.0  0.8  0.7   0.8
";

/// Both colours of [`checker_box`].
pub(crate) const CHECKERS: &str = "transfer 1
strength opacity_per_unit
color srgb
1  0.9  0.85 0.7   0.05
2  0.2  0.3  0.6   0.05
";

/// Where a file of the data lies: under `OBLATE_DATA`, else beside the repository.
pub(crate) fn data(file: &str) -> PathBuf {
    let beside = || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data"));
    std::env::var_os("OBLATE_DATA").map_or_else(beside, PathBuf::from).join(file)
}

pub(crate) fn volume(file: &str) -> Volume {
    match open(data(file), &OpenOptions::default()) {
        Ok(Opened { content: Content::Volume(volume), .. }) => volume,
        other => panic!("{file} is no volume: {:?}", other.err()),
    }
}

/// 100³ voxels in cubes of 10³ that alternate between 1 and 2.
pub(crate) fn checker_box() -> Volume {
    let value = |i: usize| 1 + ((i / 10 % 10 + i / 1_000 % 10 + i / 100_000) % 2) as u8;
    let voxels = Voxels::U8((0..1_000_000).map(value).collect());
    Volume::new([100; 3], voxels, GridFrame::default()).expect("a hundred cubed is a million")
}

pub(crate) fn kernels(volume: &Volume, transfer: &str) -> Cloud {
    let transfer: TransferFunction = transfer.parse().expect("it is a transfer function");
    to_kernels(volume, &transfer, &KernelSettings::default()).expect("the volume is finite")
}

pub(crate) fn engine_surface(volume: &Volume) -> Cloud {
    iso_surfels(volume, ENGINE_ISO, &IsoSettings::default()).expect("the value is finite")
}
