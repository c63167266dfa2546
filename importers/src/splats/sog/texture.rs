//! Bytes of splats, as lossless WebP images hold them.

use image_webp::WebPDecoder;
use std::io::Cursor;

/// Bytes that decoding takes for a texel: it with alpha, the same without, and what is kept.
const DECODING: u64 = 12;

/// An image whose header was read.
pub(super) struct Packed {
    name: String,
    decoder: WebPDecoder<Cursor<Vec<u8>>>,
    pub(super) width: usize,
    pub(super) height: usize,
}

/// Texels by rows, each of red, green, blue, alpha.
pub(super) struct Texture {
    pub(super) width: usize,
    pub(super) texels: Vec<[u8; 4]>,
}

impl Packed {
    /// An image of at least `least` texels, which it takes from what may be unpacked.
    pub(super) fn new(name: &str, bytes: Vec<u8>, least: usize, budget: &mut u64) -> Result<Self, String> {
        let wrong = |problem: String| format!("{name}: {problem}");
        let mut decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(|error| wrong(error.to_string()))?;
        if decoder.is_lossy() || decoder.is_animated() {
            return Err(wrong(
                "must be a lossless WebP image; other coding changes the numbers in it".into(),
            ));
        }
        let (width, height) = decoder.dimensions();
        let (width, height) = (width as usize, height as usize);
        if width * height < least {
            return Err(wrong(format!("has {width} × {height} texels, too few for {least} entries")));
        }
        let needed = DECODING * (width * height) as u64;
        let Some(left) = budget.checked_sub(needed) else {
            return Err(wrong(format!(
                "{width} × {height} texels take {needed} bytes; {budget} are left of the limit that is set"
            )));
        };
        *budget = left;
        Ok(Self { name: name.to_owned(), decoder, width, height })
    }

    pub(super) fn decode(mut self) -> Result<Texture, String> {
        let wrong = |problem: &dyn std::fmt::Display| format!("{}: {problem}", self.name);
        let size = self.decoder.output_buffer_size().ok_or_else(|| wrong(&"too large"))?;
        let mut bytes = vec![0; size];
        self.decoder.read_image(&mut bytes).map_err(|error| wrong(&error))?;
        let texels = if self.decoder.has_alpha() {
            bytes.as_chunks::<4>().0.to_vec()
        } else {
            bytes.as_chunks::<3>().0.iter().map(|&[red, green, blue]| [red, green, blue, 255]).collect()
        };
        Ok(Texture { width: self.width, texels })
    }
}
