//! How far two pictures are apart.

use rayon::prelude::*;
use thiserror::Error;

/// A value of a picture's channel.
pub trait Channel: Copy + Sync {
    /// The full range, white: 1 for f32, 255 for u8.
    const PEAK: f64;
    /// The value as f64, unscaled.
    fn value(self) -> f64;
}

impl Channel for f32 {
    const PEAK: f64 = 1.0;
    fn value(self) -> f64 {
        f64::from(self)
    }
}

impl Channel for u8 {
    const PEAK: f64 = 255.0;
    fn value(self) -> f64 {
        f64::from(self)
    }
}

/// A picture to compare: rows from top to bottom, channels interleaved.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a, T = f32> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Channels of a pixel, from 1 to 4. All count alike; leave alpha out where it should not.
    pub channels: usize,
    /// `width * height * channels` values, finite.
    pub values: &'a [T],
}

/// Differences of two pictures. Errors are in the pictures' unit: linear values for f32, levels for u8.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metrics {
    /// Peak signal-to-noise ratio 10 log₁₀(peak²/MSE) over all channels; infinity for equal pictures.
    pub psnr_db: f64,
    /// Structural similarity, the mean over channels and windows; 1 for equal pictures.
    pub ssim: f64,
    /// The largest absolute difference.
    pub max_error: f64,
    /// The smallest error that 99.9 % of the pixels do not exceed; a pixel's error is its largest channel's.
    pub p999_error: f64,
    /// The mean over the pixels of their largest channel's error.
    pub mean_error: f64,
}

/// Why two pictures cannot be compared.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum MetricsError {
    /// They differ in size or channels.
    #[error("the pictures are {a:?} and {b:?} (width, height, channels); they must be alike")]
    Shape {
        /// Width, height, channels of the first.
        a: [usize; 3],
        /// Width, height, channels of the second.
        b: [usize; 3],
    },
    /// A picture without pixels, or with too few or too many channels.
    #[error("a picture of {width}×{height} with {channels} channels; sides from 1, channels from 1 to 4")]
    Empty {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Channels.
        channels: usize,
    },
    /// The values are not as many as the size says.
    #[error("{found} values where width × height × channels is {expected}")]
    Length {
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A value that has no difference to others.
    #[error("pixel ({column}, {row}), channel {channel}, is {value}; it must be finite")]
    NotFinite {
        /// Column from the left, from 0.
        column: usize,
        /// Row from the top, from 0.
        row: usize,
        /// Channel, from 0.
        channel: usize,
        /// The value.
        value: f64,
    },
}

/// Compares two pictures of one size.
///
/// SSIM is that of Wang, Bovik, Sheikh, Simoncelli, *Image Quality Assessment: From Error Visibility to
/// Structural Similarity*, 2004, eq. 13: windows of 11×11 weighted by a Gaussian of σ = 1.5, K₁ = 0.01,
/// K₂ = 0.03, dynamic range [`Channel::PEAK`], only windows that lie inside the picture, without downsampling.
/// It is taken on every channel as it stands and averaged. A side shorter than 11 pixels has one window as
/// long as the side, so that a picture of any size has a figure.
///
/// # Errors
/// When sizes differ, a picture is empty, or a value is not finite.
pub fn compare<T: Channel>(a: Pixels<'_, T>, b: Pixels<'_, T>) -> Result<Metrics, MetricsError> {
    validate(&a)?;
    validate(&b)?;
    if a.shape() != b.shape() {
        return Err(MetricsError::Shape { a: a.shape(), b: b.shape() });
    }
    let mut squares = 0.0;
    let mut errors: Vec<f64> = Vec::with_capacity(a.width * a.height);
    for (p, q) in a.values.chunks_exact(a.channels).zip(b.values.chunks_exact(a.channels)) {
        let differences = p.iter().zip(q).map(|(p, q)| (p.value() - q.value()).abs());
        squares += differences.clone().map(|d| d * d).sum::<f64>();
        errors.push(differences.fold(0.0, f64::max));
    }
    let mean_square = squares / a.values.len() as f64;
    let mean_error = errors.iter().sum::<f64>() / errors.len() as f64;
    let rank = (errors.len() as f64 * 0.999).ceil() as usize - 1;
    let (_, &mut p999_error, above) = errors.select_nth_unstable_by(rank, f64::total_cmp);
    let max_error = above.iter().copied().fold(p999_error, f64::max);
    let ssim = (0..a.channels).map(|channel| ssim(&a, &b, channel)).sum::<f64>() / a.channels as f64;
    let psnr_db = 10.0 * (T::PEAK * T::PEAK / mean_square).log10();
    Ok(Metrics { psnr_db, ssim, max_error, p999_error, mean_error })
}

impl<T> Pixels<'_, T> {
    fn shape(&self) -> [usize; 3] {
        [self.width, self.height, self.channels]
    }
}

fn validate<T: Channel>(picture: &Pixels<'_, T>) -> Result<(), MetricsError> {
    let [width, height, channels] = picture.shape();
    if width == 0 || height == 0 || !(1..=4).contains(&channels) {
        return Err(MetricsError::Empty { width, height, channels });
    }
    let (found, expected) = (picture.values.len(), width.saturating_mul(height).saturating_mul(channels));
    if found != expected {
        return Err(MetricsError::Length { found, expected });
    }
    match picture.values.iter().position(|v| !v.value().is_finite()) {
        None => Ok(()),
        Some(at) => Err(MetricsError::NotFinite {
            column: at / channels % width,
            row: at / channels / width,
            channel: at % channels,
            value: picture.values[at].value(),
        }),
    }
}

/// Weights of a window along a side: 11 long or as long as the side.
fn window(side: usize) -> Vec<f64> {
    let length = side.min(11);
    let middle = (length as f64 - 1.0) / 2.0;
    let weights: Vec<f64> =
        (0..length).map(|i| (-(i as f64 - middle).powi(2) / (2.0 * 1.5 * 1.5)).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.into_iter().map(|w| w / total).collect()
}

fn ssim<T: Channel>(a: &Pixels<'_, T>, b: &Pixels<'_, T>, channel: usize) -> f64 {
    let [across, down] = [window(a.width), window(a.height)];
    let columns = a.width - across.len() + 1;
    // Weighted sums of p, q, p², q², pq: first along rows, then down columns.
    let rows: Vec<Vec<[f64; 5]>> = (0..a.height)
        .into_par_iter()
        .map(|row| {
            let value = |picture: &Pixels<'_, T>, column: usize| {
                picture.values[(row * a.width + column) * a.channels + channel].value()
            };
            let moments = |column: usize| {
                let (p, q) = (value(a, column), value(b, column));
                [p, q, p * p, q * q, p * q]
            };
            let values: Vec<[f64; 5]> = (0..a.width).map(moments).collect();
            (0..columns).map(|column| weighted(&across, |i| values[column + i])).collect()
        })
        .collect();
    let sums: Vec<f64> = (0..=a.height - down.len())
        .into_par_iter()
        .map(|row| {
            let at = |column: usize| similarity(weighted(&down, |i| rows[row + i][column]), T::PEAK);
            (0..columns).map(at).sum()
        })
        .collect();
    sums.iter().sum::<f64>() / (sums.len() * columns) as f64
}

fn weighted(weights: &[f64], moments: impl Fn(usize) -> [f64; 5]) -> [f64; 5] {
    let mut sums = [0.0; 5];
    for (i, weight) in weights.iter().enumerate() {
        for (sum, moment) in sums.iter_mut().zip(moments(i)) {
            *sum += weight * moment;
        }
    }
    sums
}

/// Eq. 13 of a window's moments.
fn similarity([p, q, pp, qq, pq]: [f64; 5], peak: f64) -> f64 {
    let [c1, c2] = [0.01, 0.03].map(|k: f64| (k * peak).powi(2));
    let (variances, covariance) = (pp - p * p + qq - q * q, pq - p * q);
    (2.0 * p * q + c1) * (2.0 * covariance + c2) / ((p * p + q * q + c1) * (variances + c2))
}
