//! How often a volume's values occur, and what that says about its background and its surfaces.

use rayon::prelude::*;

use crate::volume::{Volume, Voxels};

/// Bins that fitting and proposing look at: one for each value of 8-bit data.
const FITTING_BINS: usize = 256;

/// Counts of a volume's finite values in bins of equal width.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    low: f64,
    width: f64,
    range: [f32; 2],
    counts: Vec<u64>,
    ignored: u64,
}

/// A histogram cut in two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Classes {
    /// The value that separates them.
    pub threshold: f32,
    /// Mean of the values below.
    pub low_mean: f32,
    /// Standard deviation of the values below.
    pub low_deviation: f32,
    /// Mean of the values above.
    pub high_mean: f32,
}

impl Volume {
    /// Counts the finite values in at most `bins` bins (at least 1) over their range; `None` if there are
    /// none. Bins of integers hold the same number of integers each, so that no bin is favoured.
    pub fn histogram(&self, bins: usize) -> Option<Histogram> {
        let range = self.value_range()?;
        let [low, high] = range.map(f64::from);
        let (low, width, bins) = if matches!(self.voxels(), Voxels::F32(_)) {
            let width = (high - low) / bins.max(1) as f64;
            if width > 0.0 { (low, width, bins.max(1)) } else { (low - 0.5, 1.0, 1) }
        } else {
            let width = ((high - low + 1.0) / bins.max(1) as f64).ceil();
            (low - 0.5, width, ((high - low + 1.0) / width).ceil() as usize)
        };
        let mut histogram = Histogram { low, width, range, counts: vec![0; bins], ignored: 0 };
        histogram.counts = match self.voxels() {
            Voxels::U8(v) => histogram.count(v),
            Voxels::U16(v) => histogram.count(v),
            Voxels::I16(v) => histogram.count(v),
            Voxels::F32(v) => histogram.count(v),
        };
        histogram.ignored = self.voxels().len() as u64 - histogram.total();
        Some(histogram)
    }
}

impl Histogram {
    fn count<T: Copy + Into<f64> + Sync>(&self, samples: &[T]) -> Vec<u64> {
        let bins = self.counts.len();
        let zero = || vec![0; bins];
        samples
            .par_chunks(1 << 18)
            .map(|chunk| {
                let mut counts = zero();
                for sample in chunk {
                    let value: f64 = (*sample).into();
                    if value.is_finite() {
                        counts[(((value - self.low) / self.width) as usize).min(bins - 1)] += 1;
                    }
                }
                counts
            })
            .reduce(zero, |a, b| a.iter().zip(&b).map(|(a, b)| a + b).collect())
    }

    /// Smallest and largest finite value.
    pub fn range(&self) -> [f32; 2] {
        self.range
    }

    /// Values in each bin, from the lowest bin up.
    pub fn counts(&self) -> &[u64] {
        &self.counts
    }

    /// The value in the middle of bin `bin`.
    pub fn center(&self, bin: usize) -> f32 {
        (self.low + (bin as f64 + 0.5) * self.width) as f32
    }

    /// Finite values counted.
    pub fn total(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Values left out because they are not finite.
    pub fn ignored(&self) -> u64 {
        self.ignored
    }

    /// The two classes with the largest variance between them (Otsu, *A Threshold Selection Method from
    /// Gray-Level Histograms*, 1979, eq. 14); `None` when fewer than two bins are filled.
    pub fn classes(&self) -> Option<Classes> {
        let filled: Vec<(usize, f64)> = self
            .counts
            .iter()
            .enumerate()
            .filter(|(_, n)| **n > 0)
            .map(|(bin, n)| (bin, *n as f64))
            .collect();
        let moments = |part: &[(usize, f64)]| {
            part.iter().fold([0.0; 3], |[n, sum, squares], &(bin, count)| {
                let value = bin as f64;
                [n + count, sum + count * value, squares + count * value * value]
            })
        };
        let [total, sum, _] = moments(&filled);
        let (mut n, mut below) = (0.0, 0.0);
        let mut best = (0.0, 0);
        for (split, &(bin, count)) in filled.iter().enumerate() {
            n += count;
            below += count * bin as f64;
            let between = n * (total - n) * (below / n - (sum - below) / (total - n)).powi(2);
            if between > best.0 {
                best = (between, split + 1);
            }
        }
        let (low, high) = filled.split_at(best.1);
        let (&(last, _), &(first, _)) = (low.last()?, high.first()?);
        let value = |bin: f64| self.low + (bin + 0.5) * self.width;
        let ([low_n, low_sum, low_squares], [high_n, high_sum, _]) = (moments(low), moments(high));
        let mean = low_sum / low_n;
        Some(Classes {
            threshold: value(0.5 * (last + first) as f64) as f32,
            low_mean: value(mean) as f32,
            low_deviation: (self.width * (low_squares / low_n - mean * mean).max(0.0).sqrt()) as f32,
            high_mean: value(high_sum / high_n) as f32,
        })
    }

    /// The value below which the share `quantile` of the counted values that are at least `floor` lies, to
    /// a bin; `floor` if there are none.
    pub fn quantile_above(&self, floor: f32, quantile: f64) -> f32 {
        let first =
            (0..self.counts.len()).find(|&bin| self.center(bin) >= floor).unwrap_or(self.counts.len());
        let above: u64 = self.counts[first..].iter().sum();
        let mut seen = 0;
        for bin in first..self.counts.len() {
            seen += self.counts[bin];
            if seen as f64 >= quantile * above as f64 && seen > 0 {
                return self.center(bin).min(self.range[1]);
            }
        }
        floor
    }
}

/// The histogram that fitting and proposing look at.
pub(crate) fn fitting_histogram(volume: &Volume) -> Option<Histogram> {
    volume.histogram(FITTING_BINS)
}

/// Proposes an iso-value: the threshold of [`Histogram::classes`], which parts the background from what the
/// volume shows. It looks at all samples alike, so it is steady under noise, where a largest mean gradient
/// is decided by a few samples. `None` when all values are equal or none is finite.
pub fn propose_iso(volume: &Volume) -> Option<f32> {
    Some(fitting_histogram(volume)?.classes()?.threshold)
}
