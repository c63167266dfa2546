//! Files to colours.

use super::exr;
use crate::decoder;
use crate::file::File;
use crate::grey::NATIVE;
use crate::inflate;
use crate::meshes::texture::EXPANSION_LIMIT;
use crate::pnm;
use crate::scalar::{Scalar, numbers};
use crate::{Endian, ImportError, Note, Place};
use image::{ImageDecoder, ImageFormat};
use oblate_engine::color::srgb_to_linear;
use std::path::Path;

/// A colour for each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorImage {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Linear Rec. 709, row by row from the top; finite.
    pub colors: Vec<[f32; 3]>,
    /// What was left out.
    pub notes: Vec<Note>,
}

/// Reads a photograph: PNG, JPEG, WebP, PGM and PPM (P2, P3, P5, P6), sRGB-encoded whatever profile they bring; OpenEXR with linear channels `R`,
/// `G` and `B`, or `Y`. Grey becomes a colour, opacities are left out, which is noted.
///
/// # Errors
/// When the file cannot be read, is malformed or none of the above; when it and its colours take more than `max_memory` bytes; when OpenEXR says
/// other primaries than those of Rec. 709, or has a colour that is not finite.
pub fn read_color(path: impl AsRef<Path>, max_memory: u64) -> Result<ColorImage, ImportError> {
    let file = File::read(path.as_ref())?;
    let format = match &file.bytes[..] {
        [0x89, b'P', b'N', b'G', ..] => ImageFormat::Png,
        [0xff, 0xd8, 0xff, ..] => ImageFormat::Jpeg,
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => ImageFormat::WebP,
        bytes if exr::begins(bytes) => return exr::colors(&file, max_memory),
        bytes if pnm::begins(bytes) => {
            let pnm::Map { layout, bytes, channels, white } = pnm::read(&file)?;
            let size = [layout.dims[0] / channels, layout.dims[1]];
            let samples = Samples { bytes, endian: layout.endian, scalar: layout.scalar, channels, white };
            within(&file, size, 0, max_memory)?;
            return samples.colors(&file, size);
        }
        _ => {
            let feature = "not recognised as a photograph; they are PNG, JPEG, WebP, PPM or OpenEXR";
            return Err(file.unsupported(Place::Whole, feature));
        }
    };
    let problem =
        |error: image::ImageError| file.malformed(Place::Whole, format!("it cannot be decoded: {error}"));
    let possible = EXPANSION_LIMIT * file.bytes.len() as u64;
    let reader = decoder::reader(&file.bytes, format, possible.min(max_memory))
        .map_err(|problem| file.malformed(Place::Whole, problem))?;
    let decoder = reader.into_decoder().map_err(problem)?;
    let (width, height) = decoder.dimensions();
    let (size, unpacked) = ([width as usize, height as usize], decoder.total_bytes());
    if unpacked > possible {
        let problem = format!("{} bytes cannot hold {width}x{height} pixels", file.bytes.len());
        return Err(file.malformed(Place::Whole, problem));
    }
    within(&file, size, unpacked, max_memory)?;
    let color = decoder.color_type();
    let channels = usize::from(color.channel_count());
    let (scalar, white) = match usize::from(color.bytes_per_pixel()) / channels.max(1) {
        1 => (Scalar::U8, 255),
        2 => (Scalar::U16, 65535),
        _ => {
            return Err(
                file.unsupported(Place::Whole, format!("samples are {color:?}; 8 or 16 bits are read"))
            );
        }
    };
    let mut bytes = vec![0; usize::try_from(unpacked).unwrap_or(usize::MAX)];
    decoder.read_image(&mut bytes).map_err(problem)?;
    Samples { bytes, endian: NATIVE, scalar, channels, white }.colors(&file, size)
}

/// That what is unpacked and its colours are within the limit that is set.
fn within(file: &File, size: [usize; 2], unpacked: u64, max_memory: u64) -> Result<(), ImportError> {
    let colors = (size[0] as u64).saturating_mul(size[1] as u64).saturating_mul(size_of::<[f32; 3]>() as u64);
    if colors.saturating_add(unpacked) > max_memory {
        return Err(file.malformed(Place::Whole, inflate::over_limit(max_memory)));
    }
    Ok(())
}

/// Whole numbers that are encoded as sRGB has it: 1 or 3 of colour for each pixel, and perhaps an opacity.
struct Samples {
    bytes: Vec<u8>,
    endian: Endian,
    scalar: Scalar,
    channels: usize,
    /// Which number is 1: 255 or 65535 at most, as the type has it.
    white: u32,
}

impl Samples {
    fn colors(&self, file: &File, size: [usize; 2]) -> Result<ColorImage, ImportError> {
        if size.contains(&0) {
            return Err(file.malformed(Place::Whole, "the picture has no pixels"));
        }
        match self.scalar {
            Scalar::U8 => self.decoded(file, size, self.bytes.iter().map(|&n| u32::from(n))),
            _ => {
                self.decoded(file, size, numbers(&self.bytes, self.endian, u16::from_le_bytes).map(u32::from))
            }
        }
    }

    fn decoded(
        &self,
        file: &File,
        size: [usize; 2],
        samples: impl Iterator<Item = u32>,
    ) -> Result<ColorImage, ImportError> {
        let linear: Vec<f32> =
            (0..=self.white).map(|n| srgb_to_linear(n as f32 / self.white as f32)).collect();
        let has_opacity = self.channels.is_multiple_of(2);
        let last = self.channels - 1;
        let (mut colors, mut translucent) = (Vec::with_capacity(size[0] * size[1]), 0_usize);
        let mut color = [0.0; 3];
        for (index, sample) in samples.enumerate() {
            let Some(&value) = linear.get(sample as usize) else {
                let place = Place::Part(format!("sample {index}"));
                let problem = format!("it is {sample}; white is {}", self.white);
                return Err(file.malformed(place, problem));
            };
            let channel = index % self.channels;
            match self.channels {
                _ if has_opacity && channel == last => translucent += usize::from(sample < self.white),
                1 | 2 => color = [value; 3],
                _ => color[channel] = value,
            }
            if channel == last {
                colors.push(color);
            }
        }
        if colors.len() != size[0] * size[1] {
            let problem = format!("it has {} of {}x{} pixels", colors.len(), size[0], size[1]);
            return Err(file.malformed(Place::Whole, problem));
        }
        let note = format!("the opacities of {translucent} pixels");
        let notes = if translucent > 0 { vec![Note::LeftOut(note)] } else { Vec::new() };
        Ok(ColorImage { size, colors, notes })
    }
}
