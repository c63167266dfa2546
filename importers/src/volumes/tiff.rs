//! TIFF stacks: the pages are slices, first to last along z; TIFF and BigTIFF in both byte orders.
//!
//! Read are pages of one size and number type: greyscale of one sample a pixel, integers of 8 to 64 bits and floating
//! point of 32 and 64, in strips or tiles, uncompressed or by LZW, deflate or PackBits. x grows along rows, y from the
//! first row on. Where white is 0 (`WhiteIsZero`) values are turned round, so that bright is high, and this is noted.
//! Smaller copies and masks of pages (`NewSubfileType`) are left out and counted.
//!
//! Refused by name: colour and palettes, several channels or times, other compressions, pages that differ from the first,
//! stacks of which the file has one page only.
//!
//! Spacing, in the file's own unit of length:
//! - **ImageJ** (an ImageDescription that begins with `ImageJ=`): z is `spacing`, else 1; x and y are 1/XResolution and
//!   1/YResolution, which count in `unit`, where both are there, else 1.
//!   Values are `c0` + `c1` · stored where `cf` is 0: signed numbers of 16 bits, which ImageJ stores as unsigned ones, are `i16`, others `f32`.
//! - **OME-TIFF** (XML as ImageDescription): `PhysicalSizeX`, `Y`, `Z` of `Pixels`, each 1 where it is missing. Their units
//!   must be the same.
//! - Otherwise it is 1: a resolution for printing says nothing of z.
//!
//! Sources: Adobe, *TIFF Revision 6.0*, 1992; `ij.io.FileSaver` of ImageJ; *OME-TIFF specification* and OME model 2016-06.

use crate::file::File;
use crate::grey::NATIVE;
use crate::inflate;
use crate::scalar::{Scalar, numbers};
use crate::volumes::tiff_pages::{EXPANSION_LIMIT, Page, pages};
use crate::volumes::voxels::Layout;
use crate::volumes::xml;
use crate::{Content, ImportError, Note, OpenOptions, Opened, Place};
use glam::DVec3;
use oblate_volumes::GridFrame;
use roxmltree::Node;
use std::io::Cursor;
use std::iter;
use tiff::decoder::{Decoder, Limits};

/// The samples of the pages, in this machine's byte order, and what was left out.
pub(crate) struct Stack {
    pub(crate) layout: Layout,
    pub(crate) bytes: Vec<u8>,
    pub(crate) notes: Vec<Note>,
}

/// What ImageJ's descriptions begin with.
const IMAGE_J: &str = "ImageJ=";

/// Bytes of a tile that is larger than its page, at most.
const LARGEST_TILE: usize = 1 << 24;

/// Reads a volume.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let all = pages(file)?;
    let slices = all.iter().filter(|page| !page.auxiliary).count();
    let (spacing, note) = spacing(file, &all[0], slices)?;
    let mut stack = decode(file, &all, options.max_memory)?;
    stack.notes.extend(note);
    let frame = GridFrame { spacing, ..GridFrame::default() };
    let volume = stack.layout.volume(file, &stack.bytes, frame, options)?;
    Ok(Opened::noting(Content::Volume(volume), stack.notes))
}

/// The pages of a file that is itself part of something.
pub(crate) fn stack(file: &File, max_memory: u64) -> Result<Stack, ImportError> {
    decode(file, &pages(file)?, max_memory)
}

fn decode(file: &File, pages: &[Page<'_>], max_memory: u64) -> Result<Stack, ImportError> {
    let place = |index: usize| Place::Part(format!("page {}", index + 1));
    let Some(first) = pages.iter().find(|page| !page.auxiliary) else {
        return Err(file.malformed(Place::Whole, "all its pages are smaller copies or masks of others"));
    };
    let slices = pages.iter().filter(|page| !page.auxiliary).count();
    for (index, page) in pages.iter().enumerate().filter(|(_, page)| !page.auxiliary) {
        let is = |page: &Page<'_>| (page.width, page.height, page.scalar, page.white_is_zero);
        if is(page) != is(first) {
            let kind = |page: &Page<'_>| {
                let white = if page.white_is_zero { " with white 0" } else { "" };
                format!("{}x{} samples of {:?}{white}", page.width, page.height, page.scalar)
            };
            let feature = format!("{}, but the first has {}; all must be alike", kind(page), kind(first));
            return Err(file.unsupported(place(index), feature));
        }
    }
    let layout = Layout {
        dims: [first.width as usize, first.height as usize, slices],
        scalar: first.scalar,
        endian: NATIVE,
    };
    let total = layout.bytes(file)?;
    let compressed = pages.iter().any(|page| page.compressed);
    if compressed && total as u64 > max_memory {
        return Err(file.malformed(Place::Whole, inflate::over_limit(max_memory)));
    }
    if !compressed && total > file.bytes.len() {
        let problem = format!("its pages need {total} bytes; the file has {}", file.bytes.len());
        return Err(file.malformed(Place::Whole, problem));
    }
    let page_bytes = total / slices;
    let mut limits = Limits::default();
    // Tables of short strips can be larger than a page: a number of two bytes takes 32 in memory.
    limits.decoding_buffer_size = page_bytes.max(file.bytes.len().saturating_mul(16));
    // A strip or tile as it is in the file, or unpacked with what is beyond the page's edge.
    let unpacked = page_bytes.saturating_mul(4).max(LARGEST_TILE);
    let possible = file.bytes.len().saturating_mul(EXPANSION_LIMIT as usize);
    limits.intermediate_buffer_size = unpacked.min(possible).max(file.bytes.len());
    let problem = |index: usize| {
        move |error: tiff::TiffError| {
            if pages[index].lzw_beyond {
                let feature = "LZW in tiles that reach beyond the page; LZW in strips and deflate are read";
                return file.unsupported(place(index), feature);
            }
            file.malformed(place(index), format!("it cannot be decoded: {error}"))
        }
    };
    let mut decoder = Decoder::new(Cursor::new(&file.bytes[..])).map_err(problem(0))?.with_limits(limits);
    let mut bytes = vec![0; total];
    let mut parts = bytes.chunks_mut(page_bytes);
    for (index, page) in pages.iter().enumerate() {
        if index > 0 {
            decoder.next_image().map_err(problem(index))?;
        }
        if page.auxiliary {
            continue;
        }
        if let Some(part) = parts.next() {
            decoder.read_image_bytes(part).map_err(problem(index))?;
        }
    }
    let mut notes = Vec::new();
    if slices < pages.len() {
        let left_out = pages.len() - slices;
        notes.push(Note::LeftOut(format!("{left_out} pages that are smaller copies or masks of others")));
    }
    if first.turned {
        let order = "rows and columns in the order in which they are stored, which Orientation would turn";
        notes.push(Note::Assumed(order.into()));
    }
    if first.white_is_zero {
        let bright = "white is 0 in this file: values are turned round, so that bright is high";
        notes.push(Note::Assumed(bright.into()));
    }
    calibrated((file, first), Stack { layout, bytes, notes }, max_memory)
}

/// What ImageJ adds to signed numbers of 16 bits, which it stores as unsigned ones.
const SIGNED: f64 = -32768.0;

/// A stack whose values are those that ImageJ's calibration makes of the stored ones, if the description says one.
fn calibrated(
    (file, first): (&File, &Page<'_>),
    mut stack: Stack,
    max_memory: u64,
) -> Result<Stack, ImportError> {
    let description = text(first.description);
    let number = |key| image_j_value(&description, key).and_then(|value| value.parse::<f64>().ok());
    let (Some(function), true) = (number("cf"), description.starts_with(IMAGE_J)) else { return Ok(stack) };
    let scalar = stack.layout.scalar;
    match (function, number("c0"), number("c1")) {
        (0.0, Some(0.0), Some(1.0)) => {}
        (0.0, Some(SIGNED), Some(1.0)) if scalar == Scalar::U16 && !first.white_is_zero => {
            // Turns the highest bit over.
            let signed = |stored: u16| (stored ^ 0x8000).cast_signed();
            stack.bytes = numbers(&stack.bytes, NATIVE, u16::from_le_bytes)
                .flat_map(|v| signed(v).to_ne_bytes())
                .collect();
            stack.layout.scalar = Scalar::I16;
        }
        (0.0, Some(c0), Some(c1))
            if c0.is_finite() && c1.is_finite() && c1 != 0.0 && !first.white_is_zero =>
        {
            let size = stack.layout.dims.iter().product::<usize>().saturating_mul(size_of::<f32>());
            if size as u64 > max_memory {
                return Err(file.malformed(Place::Whole, inflate::over_limit(max_memory)));
            }
            let mut bytes = Vec::with_capacity(size);
            for stored in scalar.all(&stack.bytes, NATIVE) {
                let value = (c0 + c1 * stored) as f32;
                if stored.is_finite() && !value.is_finite() {
                    let problem = format!("c0={c0} and c1={c1} make {value} of a sample of {stored}");
                    return Err(file.malformed(Place::Part("ImageDescription".into()), problem));
                }
                bytes.extend(value.to_ne_bytes());
            }
            (stack.bytes, stack.layout.scalar) = (bytes, Scalar::F32);
        }
        _ => {
            let what = format!("ImageJ's calibration (cf={function}): values are as they are stored");
            stack.notes.push(Note::LeftOut(what));
        }
    }
    Ok(stack)
}

/// Text of a field, which ends with a zero: UTF-8, else Latin-1, in which ImageJ writes `µm`.
fn text(bytes: &[u8]) -> String {
    let bytes = bytes.split(|&b| b == 0).next().unwrap_or_default();
    match str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    }
}

fn spacing(file: &File, first: &Page<'_>, slices: usize) -> Result<(DVec3, Option<Note>), ImportError> {
    let description = text(first.description);
    if description.starts_with(IMAGE_J) {
        image_j(file, first, &description, slices)
    } else if description.trim_start().starts_with('<') && description.contains("<OME") {
        ome(file, &description, slices).map(|spacing| (spacing, None))
    } else {
        Ok((DVec3::ONE, None))
    }
}

/// What ImageJ's description says of a key.
fn image_j_value<'a>(description: &'a str, key: &str) -> Option<&'a str> {
    let mut lines = description.lines().filter_map(|line| line.split_once('='));
    lines.find(|(name, _)| name.trim() == key).map(|(_, value)| value.trim())
}

fn image_j(
    file: &File,
    first: &Page<'_>,
    description: &str,
    slices: usize,
) -> Result<(DVec3, Option<Note>), ImportError> {
    let value = |key: &str| image_j_value(description, key);
    let count = |key: &str| value(key).and_then(|value| value.parse::<u64>().ok()).unwrap_or(1);
    for (key, name) in [("channels", "channels"), ("frames", "times")] {
        if count(key) > 1 {
            let feature = format!("an ImageJ stack of {} {name}; one is read", count(key));
            return Err(file.unsupported(Place::Part("ImageDescription".into()), feature));
        }
    }
    let images = count("images");
    if images > 1 && slices == 1 {
        let feature = format!(
            "an ImageJ stack of {images} images behind one page, as ImageJ writes beyond 4 GB; save it as BigTIFF or raw"
        );
        return Err(file.unsupported(Place::Part("ImageDescription".into()), feature));
    }
    let note = (images != slices as u64 && value("images").is_some()).then(|| {
        Note::Assumed(format!("the description speaks of {images} images; the {slices} pages are taken"))
    });
    let positive = |value: f64| Some(value.abs()).filter(|value| value.is_finite() && *value > 0.0);
    let z = value("spacing").and_then(|value| value.parse().ok()).and_then(positive).unwrap_or(1.0);
    let [x, y] = match first.resolution {
        [Some(x), Some(y)] => [x.recip(), y.recip()],
        _ => [1.0; 2],
    };
    Ok((DVec3::new(x, y, z), note))
}

fn ome(file: &File, description: &str, slices: usize) -> Result<DVec3, ImportError> {
    let place = || Place::Part("ImageDescription".into());
    let malformed = |problem: String| file.malformed(place(), format!("OME: {problem}"));
    let unsupported = |feature: String| file.unsupported(place(), format!("OME: {feature}"));
    let document = xml::document(description, file.bytes.len()).map_err(|(_, problem)| malformed(problem))?;
    let named = |name: &'static str| {
        document.descendants().filter(move |node| node.is_element() && node.tag_name().name() == name)
    };
    let pixels: Vec<Node<'_, '_>> = named("Pixels").collect();
    let pixels = match pixels[..] {
        [pixels] => pixels,
        [] => return Err(malformed("it has no Pixels".into())),
        _ => return Err(unsupported(format!("{} images in one file; one is read", pixels.len()))),
    };
    let count = |node: Node<'_, '_>, name: &str, missing: u64| match node.attribute(name) {
        None => Ok(missing),
        Some(text) => text.parse::<u64>().map_err(|_| malformed(format!("{name} is {text:?}, no number"))),
    };
    for (name, what) in [("SizeC", "channels"), ("SizeT", "times")] {
        let found = count(pixels, name, 1)?;
        if found > 1 {
            return Err(unsupported(format!("{found} {what} ({name}); one is read")));
        }
    }
    let z = count(pixels, "SizeZ", slices as u64)?;
    if z != slices as u64 {
        return Err(unsupported(format!(
            "SizeZ is {z}, but this file has {slices} pages; volumes in several files are not read"
        )));
    }
    for data in named("TiffData") {
        if count(data, "IFD", 0)? != count(data, "FirstZ", 0)? {
            return Err(unsupported("slices in another order than pages are not read".into()));
        }
    }
    let mut units = ["X", "Y", "Z"].map(|axis| {
        let given = pixels.attribute(format!("PhysicalSize{axis}").as_str()).is_some();
        given.then(|| pixels.attribute(format!("PhysicalSize{axis}Unit").as_str()).unwrap_or("µm"))
    });
    units.sort_unstable();
    let given: Vec<&str> = units.into_iter().flatten().collect();
    if given.first() != given.last() {
        return Err(unsupported(format!("sizes in different units, {}", given.join(" and "))));
    }
    let mut spacing = DVec3::ONE;
    for (axis, name) in iter::zip(0..3, ["PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ"]) {
        if let Some(text) = pixels.attribute(name) {
            let size = text.parse().ok().filter(|size: &f64| size.is_finite() && *size > 0.0);
            spacing[axis] =
                size.ok_or_else(|| malformed(format!("{name} is {text:?}; it must be a number above 0")))?;
        }
    }
    Ok(spacing)
}
