//! Metrics against numbers worked out by hand.

use oblate_engine::metrics::{MetricsError, Pixels, compare};
use proptest::prelude::*;

fn gray<T>(width: usize, height: usize, values: &[T]) -> Pixels<'_, T> {
    Pixels { width, height, channels: 1, values }
}

#[test]
fn equal_pictures_are_equal() {
    let values: Vec<f32> = (0..20 * 17 * 3).map(|i| (i * 37 % 101) as f32 / 100.0).collect();
    let picture = Pixels { width: 20, height: 17, channels: 3, values: &values };
    let metrics = compare(picture, picture).unwrap();
    assert_eq!(metrics.psnr_db, f64::INFINITY);
    assert!((metrics.ssim - 1.0).abs() < 1e-12);
    assert_eq!([metrics.max_error, metrics.p999_error, metrics.mean_error], [0.0; 3]);
}

#[test]
fn constant_offset_by_hand() {
    // Everywhere 0.5 against 0.6: MSE 0.01 is 20 dB; without variance SSIM is its luminance term
    // (2·0.5·0.6 + 1e-4)/(0.25 + 0.36 + 1e-4).
    let (a, b) = (vec![0.5f32; 400], vec![0.6f32; 400]);
    let metrics = compare(gray(20, 20, &a), gray(20, 20, &b)).unwrap();
    // 0.6 in f32 is 2.4e-8 too large; cancellation of variances in f64 is 1e-13 against C₂ = 9e-4.
    assert!((metrics.psnr_db - 20.0).abs() < 1e-5);
    assert!((metrics.ssim - 0.6001 / 0.6101).abs() < 1e-6);
    for error in [metrics.max_error, metrics.p999_error, metrics.mean_error] {
        assert!((error - 0.1).abs() < 1e-7);
    }
}

#[test]
fn two_pixels_by_hand() {
    // Means 1/2, variances 1/4, covariance −1/4: luminance term 1, structure (−1/2 + C₂)/(1/2 + C₂).
    let metrics = compare(gray(2, 1, &[0.0f32, 1.0]), gray(2, 1, &[1.0f32, 0.0])).unwrap();
    assert!((metrics.ssim - (-0.5 + 9e-4) / (0.5 + 9e-4)).abs() < 1e-12);
    assert!(metrics.psnr_db.abs() < 1e-12);
    assert_eq!(metrics.max_error, 1.0);
}

#[test]
fn bytes_are_measured_in_levels() {
    let a = [10u8, 20, 30, 40, 50, 60];
    let mut b = a;
    b[4] = 55;
    let picture = |values| Pixels { width: 2, height: 1, channels: 3, values };
    let metrics = compare(picture(&a), picture(&b)).unwrap();
    // One of six values is 5 off: MSE 25/6.
    assert!((metrics.psnr_db - 10.0 * (255.0f64 * 255.0 * 6.0 / 25.0).log10()).abs() < 1e-12);
    assert_eq!([metrics.max_error, metrics.p999_error, metrics.mean_error], [5.0, 5.0, 2.5]);
    // The same picture as f32 has the same PSNR and SSIM.
    let [fa, fb] = [a, b].map(|v| v.map(|level| f32::from(level) / 255.0));
    let float = |values| Pixels { width: 2, height: 1, channels: 3, values };
    let scaled = compare(float(&fa), float(&fb)).unwrap();
    assert!((scaled.psnr_db - metrics.psnr_db).abs() < 1e-5);
    assert!((scaled.ssim - metrics.ssim).abs() < 1e-6);
    assert!((scaled.max_error * 255.0 - 5.0).abs() < 1e-5);
}

#[test]
fn one_pixel_in_a_thousand_is_left_out() {
    // Of 2000 pixels errors 1, 2, 3 at three: 99.9 % are 1998 pixels, so the third largest error counts.
    let a = vec![0.0f32; 2000];
    let mut b = a.clone();
    (b[100], b[900], b[1500]) = (3.0, 1.0, 2.0);
    let metrics = compare(gray(40, 50, &a), gray(40, 50, &b)).unwrap();
    assert_eq!([metrics.p999_error, metrics.max_error], [1.0, 3.0]);
    assert!((metrics.mean_error - 6.0 / 2000.0).abs() < 1e-12);
}

#[test]
fn wrong_pictures_are_refused() {
    let values = [0.0f32; 6];
    let picture = |width, height, channels| Pixels { width, height, channels, values: &values };
    let shape = compare(picture(2, 3, 1), picture(3, 2, 1)).unwrap_err();
    assert_eq!(shape, MetricsError::Shape { a: [2, 3, 1], b: [3, 2, 1] });
    for empty in [picture(0, 3, 1), picture(6, 1, 0), picture(1, 1, 6)] {
        assert!(matches!(compare(empty, empty), Err(MetricsError::Empty { .. })));
    }
    for long in [picture(2, 2, 1), picture(usize::MAX, usize::MAX, 4)] {
        assert!(matches!(compare(long, long), Err(MetricsError::Length { .. })));
    }
    let mut broken = values;
    broken[5] = f32::NAN;
    let found = compare(picture(1, 3, 2), Pixels { width: 1, height: 3, channels: 2, values: &broken });
    assert!(matches!(found, Err(MetricsError::NotFinite { column: 0, row: 2, channel: 1, .. })));
}

/// SSIM as its definition reads: every window by a double sum.
fn ssim_by_definition(width: usize, height: usize, a: &[f32], b: &[f32]) -> f64 {
    let (w, h) = (width.min(11), height.min(11));
    let (mut total, mut windows) = (0.0, 0.0);
    for top in 0..=height - h {
        for left in 0..=width - w {
            let (mut weight, mut p, mut q) = (0.0, 0.0, 0.0);
            let mut entries = Vec::new();
            for y in 0..h {
                for x in 0..w {
                    let dx = x as f64 - (w as f64 - 1.0) / 2.0;
                    let dy = y as f64 - (h as f64 - 1.0) / 2.0;
                    let g = (-(dx * dx + dy * dy) / 4.5).exp();
                    let at = (top + y) * width + left + x;
                    let (u, v) = (f64::from(a[at]), f64::from(b[at]));
                    entries.push((g, u, v));
                    weight += g;
                    p += g * u;
                    q += g * v;
                }
            }
            (p, q) = (p / weight, q / weight);
            let (mut pp, mut qq, mut pq) = (0.0, 0.0, 0.0);
            for (g, u, v) in entries {
                pp += g / weight * (u - p) * (u - p);
                qq += g / weight * (v - q) * (v - q);
                pq += g / weight * (u - p) * (v - q);
            }
            let (c1, c2) = (1e-4, 9e-4);
            total += (2.0 * p * q + c1) * (2.0 * pq + c2) / ((p * p + q * q + c1) * (pp + qq + c2));
            windows += 1.0;
        }
    }
    total / windows
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn ssim_is_its_definition(
        (width, height, a, b) in (1usize..16, 1usize..16).prop_flat_map(|(w, h)| {
            let values = || prop::collection::vec(0.0..1.0f32, w * h);
            (Just(w), Just(h), values(), values())
        })
    ) {
        let metrics = compare(gray(width, height, &a), gray(width, height, &b)).unwrap();
        prop_assert!((metrics.ssim - ssim_by_definition(width, height, &a, &b)).abs() < 1e-10);
    }
}
