//! How far pictures with an alpha channel are apart.

use oblate_engine::{Metrics, MetricsError, Pixels, compare};

/// Compares pictures of one size (width, height): red, green, blue and alpha of each pixel, rows from top to bottom. Alpha is left out where both are opaque
/// everywhere: a channel that can't differ would only make the others' errors look smaller.
///
/// # Errors
/// When a picture is empty or of another size, or a value is not finite.
pub fn compare_rgba(size: [usize; 2], a: &[[f32; 4]], b: &[[f32; 4]]) -> Result<Metrics, MetricsError> {
    compare_channels(channels(a, b), size, a, b)
}

/// How many channels of a pixel count.
pub(crate) fn channels(a: &[[f32; 4]], b: &[[f32; 4]]) -> usize {
    let is_opaque = |pixels: &[[f32; 4]]| pixels.iter().all(|pixel| pixel[3] == 1.0);
    if is_opaque(a) && is_opaque(b) { 3 } else { 4 }
}

/// Compares the first so many channels.
pub(crate) fn compare_channels(
    channels: usize,
    [width, height]: [usize; 2],
    a: &[[f32; 4]],
    b: &[[f32; 4]],
) -> Result<Metrics, MetricsError> {
    let [a, b] = [a, b]
        .map(|pixels| -> Vec<f32> { pixels.iter().flat_map(|pixel| &pixel[..channels]).copied().collect() });
    compare(
        Pixels { width, height, channels, values: a.as_slice() },
        Pixels { width, height, channels, values: b.as_slice() },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alpha_counts_only_where_it_is_not_opaque() {
        let [grey, other, clear] =
            [[0.5, 0.5, 0.5, 1.0], [0.6, 0.5, 0.5, 1.0], [0.5, 0.5, 0.5, 0.9]].map(|pixel| [pixel; 6]);
        let db = |a: &[[f32; 4]], b: &[[f32; 4]]| compare_rgba([3, 2], a, b).unwrap().psnr_db;
        // One channel of three is off by a tenth; then one of four.
        assert!((db(&grey, &other) - 10.0 * 300f64.log10()).abs() < 1e-5);
        assert!((db(&grey, &clear) - 10.0 * 400f64.log10()).abs() < 1e-5);
    }
}
