//! OpenEXR: channels by their names, from the first part that has them.
//!
//! Parts under B44 and DWA are refused: both smear edges as JPEG does, and B44's decoder overflows on broken chunks.
//!
//! Source: Kainz, Bogart, Stanczyk, Hillman, *Technical Introduction to OpenEXR*, 2013, openexr.com.

use super::ColorImage;
use crate::file::File;
use crate::grey::{Grey, NATIVE};
use crate::inflate;
use crate::meshes::texture::EXPANSION_LIMIT;
use crate::scalar::Scalar;
use crate::volumes::voxels::Layout;
use crate::{ImportError, Note, Place};
use ::exr::block::UncompressedBlock;
use ::exr::block::reader::ChunksReader;
use ::exr::error::{Error, UnitResult};
use ::exr::meta::attribute::SampleType;
use ::exr::meta::header::Header;
use ::exr::meta::{BlockDescription, MetaData};
use ::exr::prelude::{Compression, Vec2};
use half::f16;
use std::collections::HashSet;
use std::io::Cursor;

/// The side of a tile, at most.
const LARGEST_TILE: usize = 1 << 16;

/// x and y of red, green, blue and white of Rec. 709.
const REC_709: [[f32; 2]; 4] = [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3127, 0.329]];

/// Whether bytes begin as those of such a file.
pub(super) fn begins(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

/// The numbers of the one channel of depths.
pub(super) fn depths(file: &File, max_memory: u64) -> Result<Grey, ImportError> {
    let find = |names: &[String]| depth_channel(names).map(|index| vec![index]);
    let part = Part::find(file, find, "one channel Z, depth.Z, depth, or Y alone, has depths")?;
    let (mut planes, scalars) = (part.read(max_memory)?, part.scalars());
    let layout = Layout { dims: [part.size[0], part.size[1], 1], scalar: scalars[0], endian: NATIVE };
    Ok(Grey { layout, bytes: planes.swap_remove(0), notes: Vec::new() })
}

/// Which channel has depths; `None` where several may.
fn depth_channel(names: &[String]) -> Option<usize> {
    let one = |is: &dyn Fn(&str) -> bool| {
        let mut found = (0..names.len()).filter(|&index| is(&names[index]));
        found.next().filter(|_| found.next().is_none())
    };
    // Names are layer.layer.channel.
    let ends = |name: &str, end: &str| format!(".{}", name.to_ascii_lowercase()).ends_with(end);
    one(&|name| name == "Z")
        .or_else(|| one(&|name| ends(name, ".depth.z")))
        .or_else(|| one(&|name| ends(name, ".depth")))
        .or_else(|| one(&|name| name == "Y" && names.len() == 1))
}

/// Linear colours.
pub(super) fn colors(file: &File, max_memory: u64) -> Result<ColorImage, ImportError> {
    let find = |names: &[String]| {
        let called = |wanted: &str| names.iter().position(|name| name == wanted);
        let color = called("R").zip(called("G")).zip(called("B")).map(|((r, g), b)| vec![r, g, b]);
        color.or_else(|| {
            called("Y").filter(|_| called("RY").is_none() && called("BY").is_none()).map(|y| vec![y])
        })
    };
    let part = Part::find(file, find, "channels R, G and B, or Y, have colours")?;
    part.check_primaries()?;
    let opacities = part.header.channels.list.iter().any(|channel| channel.name.eq("A"));
    let (planes, scalars) = (part.read(max_memory)?, part.scalars());
    let pixels = part.size[0] * part.size[1];
    let bytes = pixels.saturating_mul(size_of::<[f32; 3]>());
    inflate::within(bytes, max_memory).map_err(|problem| file.malformed(Place::Whole, problem))?;
    let mut colors = vec![[0.0; 3]; pixels];
    for channel in 0..3 {
        let plane = channel.min(planes.len() - 1);
        for (color, value) in colors.iter_mut().zip(scalars[plane].all(&planes[plane], NATIVE)) {
            color[channel] = value as f32;
        }
    }
    if let Some(pixel) = colors.iter().position(|color| color.iter().any(|c| !c.is_finite())) {
        let place = Place::Part(format!("pixel ({}, {})", pixel % part.size[0], pixel / part.size[0]));
        return Err(file.malformed(place, format!("its colour is {:?}; it must be finite", colors[pixel])));
    }
    let note = opacities.then(|| Note::LeftOut("the opacities of its pixels (A)".into()));
    Ok(ColorImage { size: part.size, colors, notes: note.into_iter().collect() })
}

/// A part of a file, and which of its channels are wanted.
struct Part<'a> {
    file: &'a File,
    index: usize,
    header: Header,
    channels: Vec<usize>,
    size: [usize; 2],
}

impl<'a> Part<'a> {
    /// The first part in whose channels `find` finds what is wanted.
    fn find(
        file: &'a File,
        find: impl Fn(&[String]) -> Option<Vec<usize>>,
        wanted: &str,
    ) -> Result<Self, ImportError> {
        let whole = |problem: String| file.malformed(Place::Whole, problem);
        let meta = MetaData::read_from_buffered(Cursor::new(&file.bytes[..]), false);
        let meta = meta.map_err(|error| whole(format!("not an OpenEXR file: {error}")))?;
        let mut all = Vec::new();
        let mut found = None;
        for (index, header) in meta.headers.iter().enumerate() {
            // A table says where each chunk is.
            if header.chunk_count.saturating_mul(8) > file.bytes.len() {
                let Vec2(width, height) = header.layer_size;
                return Err(whole(format!("{} bytes cannot hold {width}x{height} pixels", file.bytes.len())));
            }
            if let BlockDescription::Tiles(tiles) = header.blocks
                && (tiles.tile_size.0 > LARGEST_TILE || tiles.tile_size.1 > LARGEST_TILE)
            {
                return Err(whole(format!(
                    "a tile may have {LARGEST_TILE} pixels a side, not {:?}",
                    tiles.tile_size
                )));
            }
            let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
            if found.is_none() && !header.deep {
                found = find(&names).map(|channels| (index, header.clone(), channels));
            }
            all.extend(names);
        }
        let Some((index, header, channels)) = found else {
            all.truncate(32);
            let feature = format!("its channels are {}; {wanted}", all.join(", "));
            return Err(file.unsupported(Place::Whole, feature));
        };
        let size = [header.layer_size.0, header.layer_size.1];
        let shown = header.shared_attributes.display_window;
        if shown != header.data_window() {
            let feature = format!(
                "its data are {}x{} of {}x{} pixels; cropped pictures are not read",
                size[0], size[1], shown.size.0, shown.size.1
            );
            return Err(file.unsupported(Place::Whole, feature));
        }
        if header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
            let feature = "a channel has fewer samples than there are pixels; each needs one for each pixel";
            return Err(file.unsupported(Place::Whole, feature));
        }
        Ok(Self { file, index, header, channels, size })
    }

    fn sample_type(&self, plane: usize) -> SampleType {
        self.header.channels.list[self.channels[plane]].sample_type
    }

    /// Of what type the planes that are read are.
    fn scalars(&self) -> Vec<Scalar> {
        let scalar =
            |plane| if self.sample_type(plane) == SampleType::U32 { Scalar::U32 } else { Scalar::F32 };
        (0..self.channels.len()).map(scalar).collect()
    }

    /// The wanted channels' numbers, a plane of bytes for each, halves as single precision.
    fn read(&self, max_memory: u64) -> Result<Vec<Vec<u8>>, ImportError> {
        let whole = |problem: String| self.file.malformed(Place::Whole, problem);
        let [width, height] = self.size;
        let pixels =
            Layout { dims: [width, height, 1], scalar: Scalar::U8, endian: NATIVE }.bytes(self.file)?;
        let stored = pixels.saturating_mul(self.header.channels.bytes_per_pixel);
        use Compression::{PIZ, PXR24, RLE, Uncompressed, ZIP1, ZIP16};
        if !matches!(self.header.compression, Uncompressed | RLE | ZIP1 | ZIP16 | PIZ | PXR24) {
            let feature = format!(
                "{} is not read; save it under ZIP, PIZ, RLE, PXR24 or none",
                self.header.compression
            );
            return Err(self.file.unsupported(Place::Whole, feature));
        }
        let length = self.file.bytes.len();
        let uncompressed = self.header.compression == Uncompressed;
        let most = if uncompressed { length } else { length.saturating_mul(EXPANSION_LIMIT as usize) };
        if stored > most {
            return Err(whole(format!("{length} bytes cannot hold {width}x{height} pixels")));
        }
        let planes = pixels.saturating_mul(size_of::<f32>() * self.channels.len());
        inflate::within(stored.saturating_add(planes), max_memory).map_err(whole)?;
        let mut planes = Planes {
            bytes: vec![vec![0; pixels * size_of::<f32>()]; self.channels.len()],
            part: self,
            places: HashSet::new(),
            pixels: 0,
        };
        let decoded = ::exr::block::read(Cursor::new(&self.file.bytes[..]), false)
            .and_then(|reader| {
                reader.filter_chunks(false, |_, _, block| {
                    block.layer == self.index && block.level == Vec2(0, 0)
                })
            })
            .and_then(|chunks| chunks.decompress_sequential(false, |_, block| planes.put(&block)));
        decoded.map_err(|error| whole(format!("it cannot be decoded: {error}")))?;
        if planes.pixels != pixels {
            return Err(whole(format!("it has {} of {pixels} pixels", planes.pixels)));
        }
        Ok(planes.bytes)
    }

    /// Refuses colours that other primaries than Rec. 709's add up to.
    fn check_primaries(&self) -> Result<(), ImportError> {
        let Some(said) = self.header.shared_attributes.chromaticities else { return Ok(()) };
        let said = [said.red, said.green, said.blue, said.white].map(|Vec2(x, y)| [x, y]);
        let mut apart = said.iter().flatten().zip(REC_709.iter().flatten()).map(|(a, b)| (a - b).abs());
        // NaN is not near.
        if apart.all(|apart| apart < 1e-3) {
            return Ok(());
        }
        let feature =
            format!("its primaries and white are at {said:?}; those of Rec. 709 are needed, {REC_709:?}");
        Err(self.file.unsupported(Place::Part("chromaticities".into()), feature))
    }
}

/// Planes, as blocks of pixels are put into them.
struct Planes<'a> {
    part: &'a Part<'a>,
    bytes: Vec<Vec<u8>>,
    /// Where blocks were: a file may have one twice, and another not at all.
    places: HashSet<[usize; 2]>,
    /// How many were put.
    pixels: usize,
}

impl Planes<'_> {
    fn put(&mut self, block: &UncompressedBlock) -> UnitResult {
        let Vec2(x, y) = block.index.pixel_position;
        let is_other = block.index.layer != self.part.index || block.index.level != Vec2(0, 0);
        if is_other || !self.places.insert([x, y]) {
            return Err(Error::Invalid("the table says twice where a chunk is".into()));
        }
        self.pixels += block.index.pixel_size.area();
        for line in block.lines(&self.part.header.channels) {
            let Some(plane) = self.part.channels.iter().position(|&c| c == line.location.channel) else {
                continue;
            };
            let Vec2(x, y) = line.location.position;
            let at = (y * self.part.size[0] + x) * size_of::<f32>();
            let places = self.bytes[plane].get_mut(at..at + line.location.sample_count * size_of::<f32>());
            let Some(places) = places else {
                return Err(Error::Invalid("a chunk lies beyond the picture".into()));
            };
            if self.part.sample_type(plane) == SampleType::F16 {
                for (place, half) in
                    places.as_chunks_mut::<4>().0.iter_mut().zip(line.value.as_chunks::<2>().0)
                {
                    *place = f16::from_ne_bytes(*half).to_f32().to_ne_bytes();
                }
            } else if places.len() == line.value.len() {
                places.copy_from_slice(line.value);
            } else {
                return Err(Error::Invalid("a chunk has another number of samples than pixels".into()));
            }
        }
        Ok(())
    }
}
