//! `oblate compare` on pictures whose differences are known.

use crate::place::{Workplace, levels};
use image::{Rgb, RgbImage, Rgba, RgbaImage};

fn grey(place: &Workplace, name: &str, size: u32, level: u8) {
    RgbImage::from_pixel(size, size, Rgb([level; 3])).save(place.path(name)).unwrap();
}

#[test]
fn numbers_are_those_of_the_formulas() {
    let place = Workplace::new();
    grey(&place, "a.png", 20, 100);
    grey(&place, "b.png", 20, 110);
    let [text, _] = place.run(&["compare", "a.png", "b.png"]);
    // 20 log10(255 / 10) = 28.1308 dB.
    assert!(text.starts_with("PSNR 28.13 dB\nSSIM "), "{text}");
    for says in ["largest error 10 levels", "99.9 % error 10 levels", "mean error 10 levels"] {
        assert!(text.contains(says), "{text}");
    }
    // Constant pictures: SSIM = (2ab + c) / (a² + b² + c) with c = (0.01 · 255)² = 6.5025.
    let ssim: f64 = text.lines().nth(1).unwrap().trim_start_matches("SSIM ").parse().unwrap();
    let wanted = (2.0 * 100.0 * 110.0 + 6.5025) / (100.0f64.powi(2) + 110.0f64.powi(2) + 6.5025);
    // Printed with six decimals; the values are f32.
    assert!((ssim - wanted).abs() < 2e-6, "{ssim}, not {wanted}");

    let [same, _] = place.run(&["compare", "a.png", "a.png", "--max", "0"]);
    assert!(same.starts_with("PSNR inf dB\nSSIM 1.000000\nlargest error 0 levels"), "{same}");
}

#[test]
fn beyond_max_the_exit_code_is_1() {
    let place = Workplace::new();
    grey(&place, "a.png", 20, 100);
    grey(&place, "b.png", 20, 110);
    place.run(&["compare", "a.png", "b.png", "--max", "10"]);
    let output = place.oblate(&["compare", "a.png", "b.png", "--max", "9.5"]).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stderr).unwrap().contains("beyond 9.5"));
    assert!(String::from_utf8(output.stdout).unwrap().contains("PSNR"));
}

#[test]
fn alpha_counts_where_it_is_not_opaque() {
    let place = Workplace::new();
    for (name, alpha) in [("a.png", 255), ("b.png", 205)] {
        RgbaImage::from_pixel(12, 12, Rgba([7, 7, 7, alpha])).save(place.path(name)).unwrap();
    }
    let [text, _] = place.run(&["compare", "a.png", "b.png"]);
    assert!(text.contains("largest error 50 levels"), "{text}");
}

#[test]
fn the_difference_is_a_picture() {
    let place = Workplace::new();
    grey(&place, "a.png", 16, 50);
    let mut other = RgbImage::from_pixel(16, 16, Rgb([50; 3]));
    other.put_pixel(3, 5, Rgb([90, 50, 50]));
    other.put_pixel(4, 5, Rgb([50, 30, 50]));
    other.save(place.path("b.png")).unwrap();
    place.run(&["compare", "a.png", "b.png", "--diff", "d.png"]);
    let difference = levels(&place.path("d.png"));
    // Scaled so that the largest, 40, is white: 20 is 127.5.
    assert_eq!(difference.get_pixel(3, 5).0, [255, 0, 0, 255]);
    assert!(difference.get_pixel(4, 5)[1].abs_diff(127) <= 1);
    assert_eq!(difference.get_pixel(0, 0).0, [0, 0, 0, 255]);
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let place = Workplace::new();
    grey(&place, "a.png", 16, 50);
    grey(&place, "b.png", 17, 50);
    place.write("text.png", "no picture");
    std::fs::write(place.path("short.png"), &std::fs::read(place.path("a.png")).unwrap()[..40]).unwrap();
    place.cube();
    place.run(&["render", "cube.obj", "--size", "16x16", "-o", "c.exr", "--surfels", "100"]);
    for (b, says) in [
        ("b.png", "16×16 and 17×17"),
        ("text.png", "text.png: neither a PNG nor an EXR"),
        ("short.png", "short.png"),
        ("missing.png", "missing.png"),
        ("c.exr", "like with like"),
    ] {
        let message = place.refusal(&["compare", "a.png", b]);
        assert!(message.contains(says), "{b}: {message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    }
    let message = place.refusal(&["compare", "a.png", "a.png", "--max", "-1"]);
    assert!(message.contains("--max is -1; it must be at least 0"), "{message}");
    let pixel = |x: usize, y: usize| (if (x, y) == (1, 2) { f32::NAN } else { 0.5 }, 0.5_f32, 0.5_f32);
    exr::prelude::write_rgb_file(place.path("nan.exr"), 16, 16, pixel).unwrap();
    let message = place.refusal(&["compare", "c.exr", "nan.exr"]);
    assert!(message.contains("nan.exr: the pixel at 1,2 is not finite"), "{message}");
    let message = place.refusal(&["compare", "a.png", "a.png", "--diff", "d.exr"]);
    assert!(message.contains(".png"), "{message}");
}
