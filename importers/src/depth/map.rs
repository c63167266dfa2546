//! Files to depths.

use super::{exr, pfm};
use crate::file::File;
use crate::format;
use crate::grey::{self, Grey};
use crate::inflate;
use crate::pnm;
use crate::scalar::Scalar;
use crate::{ImportError, Note, Place};
use std::path::Path;

/// How the numbers of a depth map say depths.
///
/// Unknown are, in all of them: 0, what is not a number or infinite, and what comes out at or below 0. With depths in units also the
/// largest number that an integer can be (255, 65535, 4294967295), which is where sensors saturate, and floating-point numbers from
/// 1e10 on, which Blender writes where nothing is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum DepthEncoding {
    /// Integers are millimetres where the world's unit is the metre, as with most sensors; floating-point numbers are depths as they stand.
    /// So it is `Units(0.001)` or `Units(1.0)`; that integers are millimetres is noted.
    #[default]
    Auto,
    /// A stored number times this is a depth: finite and above 0. 0.001 for millimetres; 1/5000 in TUM's RGB-D data set; 1/256 in KITTI's.
    Units(f64),
    /// Disparities of two rectified cameras: the depth is `baseline_focal` / (stored / `scale` + `offset`).
    ///
    /// Middlebury 2003 stores four times the disparity in pixels in its quarter-size pictures (`scale` 4, `offset` 0), Middlebury 2014
    /// disparities as PFM, with the distance of the principal points (`doffs`) as `offset`, and infinity where unknown.
    Disparity {
        /// The distance between the cameras in world units times the focal length in pixels; finite and above 0.
        baseline_focal: f64,
        /// What is added to a disparity, in pixels; finite.
        offset: f64,
        /// How many steps of the stored number are a pixel; finite and not 0.
        scale: f64,
    },
    /// SUN RGB-D: millimetres whose 16 bits are rotated to the left by three.
    SunRgbd,
    /// NYU Depth v2, raw: what a Kinect measures, 16 bits in the other byte order than PGM's. The depth in metres is
    /// 351.3 / (1092.5 − stored), as the data set's own toolbox has it.
    NyuRaw,
}

/// A depth for each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Columns and rows.
    pub size: [usize; 2],
    /// In world units, row by row from the top; 0 where unknown, otherwise finite and above 0.
    pub depths: Vec<f32>,
    /// What was assumed or left out.
    pub notes: Vec<Note>,
}

/// From here on floating-point numbers mean that nothing is there.
const NOTHING: f64 = 1e10;

/// Reads a depth map: PNG of 8 or 16 bits of grey; PGM (P2, P5), its numbers as they stand; TIFF of one greyscale page; PFM (`Pf`), whose
/// rows go from bottom to top; OpenEXR with the channel `Z`, else one called `depth.Z` or `depth` (in any layer, in small letters or not), else one channel
/// `Y` alone.
///
/// Whether depths are along the axis or along rays, no file says: see [`oblate_surfels::DepthKind`].
///
/// # Errors
/// When the file cannot be read, is malformed, holds colours, is compressed with loss as JPEG does (edges would be smeared), or is none of
/// the above; when it unpacks to more than `max_memory` bytes; when the numbers of `encoding` are out of their ranges or it needs integers of 16 bits
/// and the file has others.
pub fn read_depth(
    path: impl AsRef<Path>,
    encoding: &DepthEncoding,
    max_memory: u64,
) -> Result<DepthMap, ImportError> {
    let file = File::read(path.as_ref())?;
    let Grey { layout, bytes, mut notes } = numbers(&file, max_memory)?;
    let [width, height, _] = layout.dims;
    let mut rule = Rule::new(&file, encoding, layout.scalar)?;
    let pixels = width * height;
    inflate::within(pixels.saturating_mul(size_of::<f32>()), max_memory)
        .map_err(|problem| file.malformed(Place::Whole, problem))?;
    let mut depths = Vec::with_capacity(pixels);
    depths.extend(layout.scalar.all(&bytes, layout.endian).map(|stored| rule.depth(stored)));
    if matches!(encoding, DepthEncoding::Auto) && layout.scalar.integer_max().is_some() {
        notes.push(Note::Assumed("the depths are millimetres, and the world's unit is the metre".into()));
    }
    if rule.saturated > 0 {
        let what = format!("{} saturated depths: the largest number that the file can have", rule.saturated);
        notes.push(Note::LeftOut(what));
    }
    if rule.negative > 0 {
        notes.push(Note::LeftOut(format!("{} negative depths: they are along +z", rule.negative)));
    }
    if depths.iter().all(|depth| *depth == 0.0) {
        notes.push(Note::LeftOut("all pixels: no depth is known".into()));
    }
    Ok(DepthMap { size: [width, height], depths, notes })
}

/// What a file has stored.
fn numbers(file: &File, max_memory: u64) -> Result<Grey, ImportError> {
    let refused = |feature: &str| Err(file.unsupported(Place::Whole, feature));
    match &file.bytes[..] {
        bytes if pfm::begins(bytes) => pfm::read(file),
        bytes if exr::begins(bytes) => exr::depths(file, max_memory),
        [0xff, 0xd8, 0xff, ..] => {
            refused("JPEG smears depths at edges; depth maps are PNG, PGM, TIFF, PFM or OpenEXR")
        }
        [b'P', b'3' | b'6', ..] if pnm::begins(&file.bytes) => {
            refused("PPM holds colours; a depth map has one channel")
        }
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => {
            refused("WebP holds colours; a depth map has one channel")
        }
        bytes => match grey::read(file, max_memory)? {
            Some(grey) => Ok(grey),
            None => {
                let known = format::of_beginning(bytes);
                let is = known.map_or("not recognised".into(), |format| format!("{}, which is", format.name));
                refused(&format!("{is} no depth map; they are PNG, PGM, TIFF, PFM or OpenEXR"))
            }
        },
    }
}

/// How a stored number becomes a depth, and what came up on the way.
struct Rule {
    encoding: DepthEncoding,
    /// Where integers saturate.
    largest: Option<f64>,
    saturated: usize,
    negative: usize,
}

impl Rule {
    fn new(file: &File, encoding: &DepthEncoding, scalar: Scalar) -> Result<Self, ImportError> {
        let largest = scalar.integer_max();
        let refused = |feature: String| Err(file.unsupported(Place::Whole, feature));
        let encoding = match *encoding {
            DepthEncoding::Auto => DepthEncoding::Units(if largest.is_some() { 0.001 } else { 1.0 }),
            DepthEncoding::Units(unit) if !(unit.is_finite() && unit > 0.0) => {
                return refused(format!("depths in units of {unit}; a unit is finite and above 0"));
            }
            DepthEncoding::Disparity { baseline_focal, offset, scale }
                if !(baseline_focal.is_finite()
                    && baseline_focal > 0.0
                    && offset.is_finite()
                    && scale.is_finite()
                    && scale != 0.0) =>
            {
                return refused(format!(
                    "disparities with baseline × focal length {baseline_focal}, offset {offset}, scale {scale}; all must be finite, \
                     the first above 0, the last not 0"
                ));
            }
            DepthEncoding::SunRgbd | DepthEncoding::NyuRaw if scalar != Scalar::U16 => {
                return refused(format!(
                    "numbers of type {scalar:?}; {encoding:?} has unsigned ones of 16 bits"
                ));
            }
            encoding => encoding,
        };
        Ok(Self { encoding, largest, saturated: 0, negative: 0 })
    }

    /// 0 where it is unknown.
    fn depth(&mut self, stored: f64) -> f32 {
        let depth = match self.encoding {
            DepthEncoding::Auto => stored,
            DepthEncoding::Units(unit) => self.in_units(stored) * unit,
            // Whole numbers of 16 bits, as `new` has seen to.
            DepthEncoding::SunRgbd => f64::from((self.in_units(stored) as u16).rotate_right(3)) * 0.001,
            DepthEncoding::NyuRaw => 351.3 / (1092.5 - f64::from((stored as u16).swap_bytes())),
            DepthEncoding::Disparity { .. } if stored == 0.0 => 0.0,
            DepthEncoding::Disparity { baseline_focal, offset, scale } => {
                baseline_focal / (stored / scale + offset)
            }
        };
        let depth = depth as f32;
        if depth.is_finite() && depth > 0.0 { depth } else { 0.0 }
    }

    /// A number that grows with the depth.
    fn in_units(&mut self, stored: f64) -> f64 {
        if Some(stored) == self.largest {
            self.saturated += 1;
            return 0.0;
        }
        if stored < 0.0 {
            self.negative += 1;
        }
        if self.largest.is_none() && stored >= NOTHING { 0.0 } else { stored }
    }
}
