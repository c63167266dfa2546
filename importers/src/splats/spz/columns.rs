//! Numbers of single splats.

use super::Header;
use crate::splats::packed::le;
use crate::splats::{Trained, color};
use std::f32::consts::FRAC_1_SQRT_2;

/// A file's streams, unpacked, as long as its header says.
pub(super) struct Columns<'a> {
    pub(super) header: &'a Header,
    pub(super) positions: &'a [u8],
    pub(super) alphas: &'a [u8],
    pub(super) colors: &'a [u8],
    pub(super) scales: &'a [u8],
    pub(super) rotations: &'a [u8],
    pub(super) harmonics: &'a [u8],
}

/// Coefficients of the constant harmonic are packed as 0.5 + this · coefficient.
pub(crate) const COLOR_SCALE: f32 = 0.15;

impl Columns<'_> {
    /// Splat `index` on the file's axes, the first `per_splat` harmonics of it.
    pub(super) fn splat(&self, index: usize, per_splat: usize) -> Trained {
        let of = |column: &[u8]| {
            let three = &column[3 * index..][..3];
            [three[0], three[1], three[2]].map(f32::from)
        };
        let mut splat = Trained {
            center: self.center(index),
            log_scales: of(self.scales).map(|scale| scale / 16.0 - 10.0),
            rotation: self.rotation(index),
            opacity: f32::from(self.alphas[index]) / 255.0,
            color: color(of(self.colors).map(|value| (value / 255.0 - 0.5) / COLOR_SCALE)),
            ..Trained::default()
        };
        let stride = 3 * self.header.harmonics();
        let (colors, _) = self.harmonics[stride * index..][..3 * per_splat].as_chunks::<3>();
        for (harmonic, packed) in splat.harmonics.iter_mut().zip(colors) {
            *harmonic = packed.map(|value| (f32::from(value) - 128.0) / 128.0);
        }
        splat
    }

    fn center(&self, index: usize) -> [f32; 3] {
        if self.header.version == 1 {
            let (halves, _) = self.positions[6 * index..][..6].as_chunks::<2>();
            return [0, 1, 2].map(|axis| half::f16::from_le_bytes(halves[axis]).to_f32());
        }
        let (fixed, _) = self.positions[9 * index..][..9].as_chunks::<3>();
        let step = 0.5_f32.powi(self.header.fractional_bits.into());
        // The sign is the highest of 24 bits.
        [0, 1, 2].map(|axis| {
            let [low, middle, high] = fixed[axis];
            (i32::from_le_bytes([0, low, middle, high]) >> 8) as f32 * step
        })
    }

    /// w x y z.
    fn rotation(&self, index: usize) -> [f32; 4] {
        if self.header.version < 3 {
            let packed = &self.rotations[3 * index..][..3];
            let [x, y, z] = [packed[0], packed[1], packed[2]].map(|c| f32::from(c) / 127.5 - 1.0);
            return [(1.0 - (x * x + y * y + z * z)).max(0.0).sqrt(), x, y, z];
        }
        let mut packed = le(self.rotations, 4 * index, u32::from_le_bytes).unwrap_or_default();
        let largest = (packed >> 30) as usize;
        let mut xyzw = [0.0_f32; 4];
        let mut squares = 0.0;
        for component in (0..4).rev().filter(|component| *component != largest) {
            let size = FRAC_1_SQRT_2 * (packed & 511) as f32 / 511.0;
            xyzw[component] = if packed & 512 == 0 { size } else { -size };
            squares += size * size;
            packed >>= 10;
        }
        xyzw[largest] = (1.0 - squares).max(0.0).sqrt();
        let [x, y, z, w] = xyzw;
        [w, x, y, z]
    }
}
