//! Images on surfaces: PNG, JPEG and WebP.

use crate::decoder;
use crate::file::File;
use crate::{ImportError, Place};
use oblate_surfels::{Filter, Texture, Wrap};
use std::path::Path;
use std::sync::Arc;

/// Decoded bytes for each byte of a file, at most: PNG (deflate, 1032) and JPEG reach about a thousand with
/// blank images, WebP more; RGBA from one channel of one bit adds up to 32.
pub(crate) const EXPANSION_LIMIT: u64 = 32 * 1032;
const MEMORY_LIMIT: u64 = 1 << 30;

/// Decodes an image; what is wrong comes back as a sentence.
pub(crate) fn decode(bytes: &[u8], wrap: [Wrap; 2]) -> Result<Texture, String> {
    let problem = |error: image::ImageError| {
        format!("the image cannot be decoded (PNG, JPEG or WebP is needed): {error}")
    };
    let format = image::guess_format(bytes).map_err(problem)?;
    let most = MEMORY_LIMIT.min(EXPANSION_LIMIT * bytes.len() as u64);
    let image = decoder::reader(bytes, format, most)?.decode().map_err(problem)?.into_rgba8();
    let (width, height) = (image.width() as usize, image.height() as usize);
    if width == 0 || height == 0 {
        return Err("the image has no texels".into());
    }
    let texels = image.as_raw().as_chunks::<4>().0.to_vec();
    Ok(Texture { width, height, texels, wrap, filter: Filter::Linear })
}

/// The image that `file` names at `place`.
pub(crate) fn read_named(
    file: &File,
    place: Place,
    name: &str,
    wrap: [Wrap; 2],
) -> Result<Arc<Texture>, ImportError> {
    let image = file.read_named(place, name)?;
    let texture = decode(&image.bytes, wrap).map_err(|problem| image.malformed(Place::Whole, problem))?;
    Ok(Arc::new(texture))
}

/// The image at `path`.
pub(crate) fn read(path: &Path) -> Result<Arc<Texture>, ImportError> {
    let image = File::read(path)?;
    let texture = decode(&image.bytes, [Wrap::Repeat; 2]);
    texture.map(Arc::new).map_err(|problem| image.malformed(Place::Whole, problem))
}
