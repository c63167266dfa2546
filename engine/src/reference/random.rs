//! Numbers that look random and are the same in every run.

/// SplitMix64 of Steele, Lea, Flood, *Fast Splittable Pseudorandom Number Generators*, 2014.
pub(super) struct Random {
    state: u64,
}

/// Its finaliser: a bijection that leaves no trace of order.
fn mix(bits: u64) -> u64 {
    let bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// The sequence of a pixel: those of different pixels and seeds have nothing to do with each other.
    pub(super) fn of_pixel([column, row]: [usize; 2], seed: u64) -> Self {
        let pixel = (row as u64) << 32 | column as u64;
        Self::new(mix(Self::new(seed).bits() ^ pixel))
    }

    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.state)
    }

    /// Evenly spread over [0, 1).
    pub(super) fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequence_is_the_published_one() {
        let mut random = Random::new(1_234_567);
        let expected = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
        assert_eq!([(); 3].map(|()| random.bits()), expected);
    }

    #[test]
    fn pixels_and_seeds_have_sequences_of_their_own() {
        let mut firsts: Vec<u64> = (0..4)
            .flat_map(|seed| (0..4096).map(move |i| Random::of_pixel([i % 64, i / 64], seed).bits()))
            .collect();
        firsts.sort_unstable();
        firsts.dedup();
        assert_eq!(firsts.len(), 4 * 4096);
        let mean = firsts.iter().map(|bits| *bits as f64).sum::<f64>() / firsts.len() as f64;
        // σ of the mean of 16384 numbers is 1/√(12 · 16384) of the range, 0.0023.
        assert!((mean / u64::MAX as f64 - 0.5).abs() < 0.01);
    }
}
