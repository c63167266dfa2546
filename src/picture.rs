//! Pictures as files: PNG (sRGB, 8 or 16 bits) and OpenEXR (linear, with depth and normals).

mod exr;
mod png;

use crate::output::WriteSeek;
use anyhow::{Context, Result, bail};
use oblate::engine::{Channels, Frame};
use std::path::Path;

/// How a picture is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    /// sRGB-encoded, alpha not premultiplied.
    Png8,
    /// The same with 16 bits a channel.
    Png16,
    /// Linear, premultiplied, 32-bit floating point.
    Exr,
}

impl Format {
    /// The format that a file's name asks for.
    pub(crate) fn of(path: &Path, bits: Option<u8>) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match (extension.as_deref(), bits) {
            (Some("png"), None | Some(8)) => Ok(Self::Png8),
            (Some("png"), Some(_)) => Ok(Self::Png16),
            (Some("exr"), None) => Ok(Self::Exr),
            (Some("exr"), Some(_)) => bail!("--bits is for PNG; {} has 32 a channel", path.display()),
            _ => bail!("{}: pictures are written as .png or .exr", path.display()),
        }
    }

    /// What it holds of a frame.
    pub(crate) fn channels(self) -> Channels {
        if self == Self::Exr { Channels::All } else { Channels::Color }
    }

    /// Writes a frame.
    pub(crate) fn write(self, frame: &Frame, file: &mut dyn WriteSeek) -> Result<()> {
        match self {
            Self::Png8 => png::write_8(frame, file),
            Self::Png16 => png::write_16(frame, file),
            Self::Exr => exr::write(frame, file),
        }
    }
}

/// Writes frames of one size as an animated PNG that goes on and on: size, number of frames and frames a second.
pub(crate) fn write_animation(
    (size, count, rate): ([u32; 2], usize, u16),
    frames: &mut dyn Iterator<Item = Result<Frame>>,
    file: &mut dyn WriteSeek,
) -> Result<()> {
    png::write_animation((size, count, rate), frames, file)
}

/// The unit of a picture's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unit {
    /// Display levels, shown as 0 to 255.
    Levels,
    /// Linear light.
    Linear,
}

/// A picture read back for comparing.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Red, green, blue and alpha of each pixel as the file has them, white being 1; rows from top to bottom.
    pub(crate) values: Vec<[f32; 4]>,
    pub(crate) unit: Unit,
}

impl Picture {
    /// Reads a PNG or EXR file, told apart by its first bytes.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let failed = || path.display().to_string();
        let bytes = std::fs::read(path).with_context(failed)?;
        let picture = match bytes.get(..4) {
            Some([0x89, b'P', b'N', b'G']) => png::read(&bytes).with_context(failed),
            Some([0x76, 0x2f, 0x31, 0x01]) => exr::read_picture(&bytes).with_context(failed),
            _ => bail!("{}: neither a PNG nor an EXR picture", path.display()),
        }?;
        if let Some(i) = picture.values.iter().position(|v| !v.iter().all(|c| c.is_finite())) {
            let (x, y) = (i % picture.width, i / picture.width);
            bail!("{}: the pixel at {x},{y} is not finite and cannot be compared", path.display());
        }
        Ok(picture)
    }
}

/// Writes values from 0 to 255 as an opaque PNG.
pub(crate) fn write_levels(size: [usize; 2], levels: &[[u8; 3]], file: &mut dyn WriteSeek) -> Result<()> {
    png::write_rgb_8(size, levels, file)
}
