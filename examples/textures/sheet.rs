//! Pictures side by side as a PNG, and their numbers as a row of Markdown.

use crate::view::{Picture, halves};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use oblate::engine::MetricsError;
use oblate::engine::color::linear_to_srgb;
use std::path::Path;

/// White pixels between panels.
const GAP: usize = 4;

/// Writes panels of one size, so many a row.
pub(crate) fn save(path: &Path, panels: &[&Picture], columns: usize) -> image::ImageResult<()> {
    let [width, height] = panels.first().map_or([0; 2], |panel| panel.size);
    let side = |count: usize, length: usize| (count * (length + GAP) - GAP) as u32;
    let rows = panels.len().div_ceil(columns);
    let white = image::Rgb([255; 3]);
    let mut sheet = image::RgbImage::from_pixel(side(columns, width), side(rows, height), white);
    for (number, panel) in panels.iter().enumerate() {
        let (left, top) = (number % columns * (width + GAP), number / columns * (height + GAP));
        for (i, color) in panel.colors.iter().enumerate() {
            let byte = |c: f32| (linear_to_srgb(c).clamp(0.0, 1.0) * 255.0).round() as u8;
            let (x, y) = ((left + i % width) as u32, (top + i / width) as u32);
            sheet.put_pixel(x, y, image::Rgb(color.map(byte)));
        }
    }
    let file = std::io::BufWriter::new(std::fs::File::create(path)?);
    sheet.write_with_encoder(PngEncoder::new_with_quality(file, CompressionType::Best, FilterType::Adaptive))
}

/// What the columns of [`row`] are.
pub(crate) const HEAD: &str = "\
| texture | drawn as | far: PSNR | 99.9 % | SSIM | near: PSNR | 99.9 % | SSIM | kernels, far | near | ms |
|---|---|---|---|---|---|---|---|---|---|---|";

/// Numbers of a picture, far half and near half: against the texture, and against what the texels' kernels make of it.
pub(crate) fn row(
    [texture, name]: [&str; 2],
    drawn: &Picture,
    [exact, by_kernels]: [&Picture; 2],
    seconds: f64,
) -> Result<String, MetricsError> {
    let cells = halves(drawn, exact)?
        .map(|half| format!("{:.1} dB | {:.3} | {:.3}", half.psnr_db, half.p999_error, half.ssim));
    let kernels = halves(drawn, by_kernels)?.map(|half| format!("{:.1} dB", half.psnr_db));
    let (cells, kernels, time) = (cells.join(" | "), kernels.join(" | "), 1e3 * seconds);
    Ok(format!("| {texture} | {name} | {cells} | {kernels} | {time:.0} |"))
}
