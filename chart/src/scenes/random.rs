//! Numbers that look random and are the same everywhere.

use glam::Vec3;
use std::f32::consts::TAU;

/// Steele, Lea, Flood, *Fast Splittable Pseudorandom Number Generators*, 2014: SplitMix64.
pub struct Random(pub u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From `low` to `high`.
    pub fn uniform(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * (self.bits() >> 40) as f32 / (1_u64 << 24) as f32
    }

    /// Of variance 1 about 0 (Box, Muller, *A Note on the Generation of Random Normal Deviates*, 1958).
    pub fn normal(&mut self) -> f32 {
        let [radius, angle] = [self.uniform(1e-7, 1.0), self.uniform(0.0, TAU)];
        (-2.0 * radius.ln()).sqrt() * angle.cos()
    }

    /// Three of [`Self::normal`].
    pub fn normals(&mut self) -> Vec3 {
        Vec3::new(self.normal(), self.normal(), self.normal())
    }

    /// Any direction.
    pub fn direction(&mut self) -> Vec3 {
        self.normals().try_normalize().unwrap_or(Vec3::Z)
    }
}
