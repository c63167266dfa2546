//! PNG.

use super::{Picture, Unit};
use crate::output::WriteSeek;
use anyhow::Result;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageFormat, ImageReader};
use oblate::engine::Frame;
use oblate::engine::color::linear_to_srgb;
use rayon::prelude::*;
use std::io::Cursor;

/// Display-encoded, not premultiplied, each channel from 0 to 1.
fn display([r, g, b, a]: [f32; 4]) -> [f32; 4] {
    // Where nothing covers the pixel, light that was added (none today) would have no colour to divide.
    let alpha = a.clamp(0.0, 1.0);
    let channel = |c: f32| if alpha > 0.0 { linear_to_srgb(c / a).clamp(0.0, 1.0) } else { 0.0 };
    [channel(r), channel(g), channel(b), alpha]
}

fn levels_8(frame: &Frame) -> Vec<[u8; 4]> {
    frame.color.par_iter().map(|c| display(*c).map(|v| (v * 255.0).round() as u8)).collect()
}

pub(super) fn write_8(frame: &Frame, file: &mut dyn WriteSeek) -> Result<()> {
    encode(levels_8(frame).as_flattened(), [frame.width, frame.height], ExtendedColorType::Rgba8, file)
}

pub(super) fn write_16(frame: &Frame, file: &mut dyn WriteSeek) -> Result<()> {
    // The encoder wants the machine's own byte order.
    let level = |v: f32| ((v * 65_535.0).round() as u16).to_ne_bytes();
    let levels: Vec<[[u8; 2]; 4]> = frame.color.par_iter().map(|c| display(*c).map(level)).collect();
    encode(levels.as_flattened().as_flattened(), [frame.width, frame.height], ExtendedColorType::Rgba16, file)
}

pub(super) fn write_animation(
    (size, count, rate): ([u32; 2], usize, u16),
    frames: &mut dyn Iterator<Item = Result<Frame>>,
    file: &mut dyn WriteSeek,
) -> Result<()> {
    let mut encoder = ::png::Encoder::new(file, size[0], size[1]);
    encoder.set_color(::png::ColorType::Rgba);
    encoder.set_animated(u32::try_from(count)?, 0)?;
    encoder.set_frame_delay(1, rate)?;
    let mut writer = encoder.write_header()?;
    for frame in frames {
        writer.write_image_data(levels_8(&frame?).as_flattened())?;
    }
    writer.finish()?;
    Ok(())
}

pub(super) fn write_rgb_8(size: [usize; 2], levels: &[[u8; 3]], file: &mut dyn WriteSeek) -> Result<()> {
    encode(levels.as_flattened(), size, ExtendedColorType::Rgb8, file)
}

fn encode(bytes: &[u8], size: [usize; 2], color: ExtendedColorType, file: &mut dyn WriteSeek) -> Result<()> {
    let [width, height] = size.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
    PngEncoder::new(file).write_image(bytes, width, height, color)?;
    Ok(())
}

pub(super) fn read(bytes: &[u8]) -> Result<Picture> {
    let image = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png).decode()?.into_rgba16();
    // 8-bit levels are widened by 257, which is 65,535 / 255: they stay what they are.
    let values = image.pixels().map(|p| p.0.map(|v| f32::from(v) / 65_535.0)).collect();
    Ok(Picture { width: image.width() as usize, height: image.height() as usize, values, unit: Unit::Levels })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round_trip(write: fn(&Frame, &mut dyn WriteSeek) -> Result<()>, color: [f32; 4]) -> [f32; 4] {
        let mut frame = Frame::new(3, 2);
        frame.color[4] = color;
        let mut file = Cursor::new(Vec::new());
        write(&frame, &mut file).unwrap();
        let picture = read(file.get_ref()).unwrap();
        assert_eq!((picture.width, picture.height), (3, 2));
        assert_eq!(picture.values[0], [0.0; 4]);
        picture.values[4].map(|v| v * 255.0)
    }

    #[test]
    fn levels_come_back() {
        // Half covered by linear 0.21586 = display 128, by full red, and brighter than white.
        let [r, g, b, a] = round_trip(write_8, [0.107_93, 0.5, 2.0, 0.5]);
        assert_eq!([r, g, b, a].map(f32::round), [128.0, 255.0, 255.0, 128.0]);
        let fine = round_trip(write_16, [0.107_93, 0.5, 2.0, 0.5]);
        // 16 bits resolve 1/257 of a level; the written constant has five digits (2e-5 of 128).
        assert!((fine[0] - 128.0).abs() < 0.01 && (fine[3] - 127.5).abs() < 0.01, "{fine:?}");
    }
}
