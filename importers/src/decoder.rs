//! Decoders of PNG, JPEG and WebP that keep to a limit of memory; JPEGs must be whole.

use image::{ImageFormat, ImageReader, Limits};
use std::io::Cursor;

/// Of a file's bytes, for a decoder that allocates so many at most.
///
/// # Errors
/// What is wrong, as a sentence.
pub(crate) fn reader(
    bytes: &[u8],
    format: ImageFormat,
    most: u64,
) -> Result<ImageReader<Cursor<&[u8]>>, String> {
    // What is missing of a JPEG its decoder draws grey.
    if format == ImageFormat::Jpeg && !ends(bytes) {
        return Err("the JPEG is cut off: it has no end (EOI, ff d9)".into());
    }
    let mut limits = Limits::default();
    limits.max_alloc = Some(most);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits);
    Ok(reader)
}

/// Whether a JPEG goes on to its end (ITU-T T.81, B.1.1). Its segments are passed by their lengths: a picture in a picture has an end of
/// its own.
fn ends(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    loop {
        let Some(marker) = rest.iter().position(|byte| *byte == 0xff) else { return false };
        rest = &rest[marker + 1..];
        match rest {
            [0xd9, ..] => return true,
            // Fill, stuffed bytes, restarts and the beginning stand alone; so does what lies between.
            [0xff, ..] => {}
            [0x00 | 0x01 | 0xd0..=0xd8, ..] => rest = &rest[1..],
            [_, high, low, ..] => {
                let length = usize::from(u16::from_be_bytes([*high, *low]));
                rest = rest.get(1 + length..).unwrap_or_default();
            }
            _ => return false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jpegs_end_where_they_say_so() {
        let mut jpeg = Cursor::new(Vec::new());
        let picture = image::RgbImage::from_fn(40, 30, |x, y| image::Rgb([x as u8 * 6, y as u8 * 8, 99]));
        picture.write_to(&mut jpeg, ImageFormat::Jpeg).expect("it can be written");
        let jpeg = jpeg.into_inner();
        assert!(ends(&jpeg));
        for cut in 0..jpeg.len() {
            assert!(!ends(&jpeg[..cut]), "the first {cut} of {} bytes", jpeg.len());
        }
        // A thumbnail that ends, in a segment of an application.
        let thumbnail = [0xff, 0xe1, 0, 8, 0xff, 0xd8, 0, 0, 0xff, 0xd9];
        let within = [&jpeg[..2], &thumbnail, &jpeg[2..]].concat();
        assert!(ends(&within) && !ends(&within[..within.len() - 2]));
        // What follows doesn't matter.
        assert!(ends(&[&jpeg[..], &[0, 0, 0xff]].concat()));
    }
}
