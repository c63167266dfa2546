//! DICOM series: files of one slice each, as CT and MR write them.
//!
//! A folder is read as its one series; a file, as the series in its folder that it belongs to. Several series in a folder are
//! refused and listed: a file of one of them opens it.
//!
//! Read are files with a preamble and `DICM`, of one frame and one sample a pixel (MONOCHROME1, MONOCHROME2), 8 or 16 bits
//! allocated, signed or not; implicit and explicit little-endian, explicit big-endian, deflated, RLE, and baseline JPEG of
//! 8 bits. Refused by name: other transfer syntaxes, several frames in a file, colour, slices that differ in size, place of
//! rows or spacing of pixels.
//!
//! - **Frame**: the patient's, as in the file: +x to the left, +y to the back, +z to the head, millimetres. The grid's x runs
//!   along rows (ImageOrientationPatient's first vector, PixelSpacing's second number), y down columns, z from slice to slice;
//!   ImagePositionPatient is the centre of the first voxel.
//! - **Order**: by position along the normal of the rows, ascending. Steps between positions must be equal within 1 % of the
//!   step and the rounding of places; a missing slice or two slices at one place are refused. A tilted gantry gives a sheared grid. Where slices have no
//!   position they follow InstanceNumber, SpacingBetweenSlices (else SliceThickness, else 1) apart, and this is noted.
//! - **Values**: RescaleSlope · stored + RescaleIntercept. They are `u8` where 8 bits unsigned are stored and not rescaled,
//!   else the first of `i16`, `u16` that holds all of them where the slope is 1 and the intercept an integer, else `f32`.
//!   Padding (PixelPaddingValue, up to PixelPaddingRangeLimit) gets the least value of the other samples, which is noted.
//!   MONOCHROME1 says that low values are shown bright; values are kept and this is noted.
//!
//! Source: NEMA PS3.3 (C.7.6.2, C.7.6.3, C.11.1), PS3.5 (7.5, A.4, annex G), PS3.10, 2024.

use crate::file::File;
use crate::inflate;
use crate::volumes::dicom_data_set::{DataSet, Packing, is_dicom};
use crate::volumes::dicom_pixels::{self, Pixels};
use crate::volumes::frame;
use crate::volumes::slices;
use crate::{Content, ImportError, Note, OpenOptions, Opened, Place};
use glam::{DMat3, DVec3};
use oblate_volumes::{GridFrame, Space, Volume, Voxels};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

const SERIES: u32 = 0x0020_000e;
const SERIES_DESCRIPTION: u32 = 0x0008_103e;
const INSTANCE: u32 = 0x0020_0013;
const POSITION: u32 = 0x0020_0032;
const ORIENTATION: u32 = 0x0020_0037;
const PIXEL_SPACING: u32 = 0x0028_0030;
const SLICE_THICKNESS: u32 = 0x0018_0050;
const BETWEEN_SLICES: u32 = 0x0018_0088;
const RESCALE_INTERCEPT: u32 = 0x0028_1052;
const RESCALE_SLOPE: u32 = 0x0028_1053;

/// Steps between slices are equal within this share of a step.
const STEP_TOLERANCE: f64 = 0.01;

/// And within this, in millimetres, and a tenth of a step: thin slices' places are rounded to 0.01.
const PLACE_TOLERANCE: f64 = 0.03;

/// Directions, and spacings of pixels relative to themselves, are equal within this: files write six digits.
const SAME: f64 = 1e-4;

/// A file's slice.
struct Slice {
    path: PathBuf,
    pixels: Pixels,
    compressed: bool,
    /// Values after rescaling; NaN where they are padding.
    values: Vec<f32>,
    /// Whether rescaling keeps integers.
    integral: bool,
    rescaled: bool,
    instance: Option<i64>,
    position: Option<DVec3>,
    /// Directions along rows and down columns.
    axes: Option<[DVec3; 2]>,
    /// Along rows and down columns.
    spacing: Option<[f64; 2]>,
    /// From slice to slice, where the file says so.
    step: Option<f64>,
}

/// Those of `files` that are DICOM.
pub(super) fn of_folder(files: &[PathBuf]) -> Result<Vec<PathBuf>, ImportError> {
    let mut found = Vec::new();
    for path in files {
        let unread = |source| ImportError::Read { path: path.clone(), source };
        let mut beginning = Vec::new();
        let file = std::fs::File::open(path).map_err(unread)?;
        file.take(132).read_to_end(&mut beginning).map_err(unread)?;
        if is_dicom(&beginning) {
            found.push(path.clone());
        }
    }
    Ok(found)
}

/// Reads the series that a file belongs to.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let set = DataSet::parse(file, options.max_memory)?;
    let series = set.text(SERIES).unwrap_or_default();
    let folder = match file.path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let mut slices = vec![Slice::new(file, &set)?];
    drop(set);
    let mut unread = 0;
    // A file that names no series is one by itself.
    if !series.is_empty() {
        let name = file.path.file_name();
        for path in of_folder(&slices::files(folder)?)?.iter().filter(|path| path.file_name() != name) {
            let other = File::read(path)?;
            // Of what cannot be read nobody knows whether it belongs to the series.
            let Ok(set) = DataSet::parse(&other, options.max_memory) else {
                unread += 1;
                continue;
            };
            if set.text(SERIES).as_deref() != Some(&series) {
                continue;
            }
            if set.pixels.is_empty() {
                unread += 1;
            } else {
                slices.push(Slice::new(&other, &set)?);
                check_size(file, &slices, options)?;
            }
        }
    }
    let note =
        || Note::LeftOut(format!("{unread} DICOM files beside it that cannot be read or hold no image"));
    join(file, slices, (unread > 0).then(note).into_iter().collect(), options)
}

/// Reads the series of a folder, of which these are the DICOM files.
pub(super) fn read_series(
    folder: &Path,
    files: &[PathBuf],
    options: &OpenOptions,
) -> Result<Opened, ImportError> {
    let mut slices = Vec::new();
    let mut others = 0;
    // Number and description of each series.
    let mut series: BTreeMap<String, (usize, String)> = BTreeMap::new();
    for path in files {
        let file = File::read(path)?;
        let set = DataSet::parse(&file, options.max_memory)?;
        if set.pixels.is_empty() {
            // A list of files, or a report.
            others += 1;
            continue;
        }
        let description = set.text(SERIES_DESCRIPTION).unwrap_or_default();
        series.entry(set.text(SERIES).unwrap_or_default()).or_insert((0, description)).0 += 1;
        if series.len() == 1 {
            slices.push(Slice::new(&file, &set)?);
            check_size(&file, &slices, options)?;
        } else {
            slices.clear();
        }
    }
    let folder = File { path: folder.to_owned(), bytes: Vec::new() };
    if series.len() > 1 {
        let listed: Vec<String> = series
            .iter()
            .map(|(uid, (count, description))| format!("{uid} ({description:?}, {count} files)"))
            .collect();
        let feature =
            format!("{} series: {}; give a file of the one to open", series.len(), listed.join(", "));
        return Err(folder.unsupported(Place::Whole, feature));
    }
    let note = || Note::LeftOut(format!("{others} DICOM files of the folder that hold no image"));
    join(&folder, slices, (others > 0).then(note).into_iter().collect(), options)
}

/// That values of compressed pixels are within the limit; others take no more than a few times their files.
fn check_size(file: &File, slices: &[Slice], options: &OpenOptions) -> Result<(), ImportError> {
    let compressed = slices.iter().filter(|slice| slice.compressed);
    let bytes: usize = compressed.map(|slice| size_of_val(&slice.values[..])).sum();
    if bytes as u64 <= options.max_memory {
        return Ok(());
    }
    Err(file.malformed(Place::Whole, inflate::over_limit(options.max_memory)))
}

impl Slice {
    fn new(file: &File, set: &DataSet) -> Result<Self, ImportError> {
        let rescale = |tag, name: &str, missing| match (set.has(tag), set.decimals::<1>(tag)) {
            (_, Some([number])) => Ok(number),
            (true, None) if set.text(tag).is_some() => {
                Err(file.malformed(Place::Part(name.into()), "it must be a number"))
            }
            _ => Ok(missing),
        };
        let slope = rescale(RESCALE_SLOPE, "RescaleSlope", 1.0)?;
        if slope == 0.0 {
            let problem = "it is 0, which makes all values one";
            return Err(file.malformed(Place::Part("RescaleSlope".into()), problem));
        }
        let intercept = rescale(RESCALE_INTERCEPT, "RescaleIntercept", 0.0)?;
        let (pixels, values) =
            dicom_pixels::read(file, set, |stored| (slope * f64::from(stored) + intercept) as f32)?;
        if values.iter().any(|value| value.is_infinite()) {
            let problem = format!("slope {slope} and intercept {intercept} lead out of single precision");
            return Err(file.malformed(Place::Part("RescaleSlope".into()), problem));
        }
        let required = |tag, name: &str| {
            // Where there is a value it is one.
            let wrong = || file.malformed(Place::Part(name.into()), "its numbers cannot be read");
            if set.text(tag).is_some() { Err(wrong()) } else { Ok(()) }
        };
        let position = set.decimals::<3>(POSITION).map(DVec3::from_array);
        if position.is_none() {
            required(POSITION, "ImagePositionPatient")?;
        }
        let axes = match set.decimals::<6>(ORIENTATION) {
            None => {
                required(ORIENTATION, "ImageOrientationPatient")?;
                None
            }
            Some([a, b, c, d, e, f]) => {
                let (x, y) = (DVec3::new(a, b, c), DVec3::new(d, e, f));
                let off = (x.length() - 1.0).abs().max((y.length() - 1.0).abs()).max(x.dot(y).abs());
                if off > 0.01 {
                    let problem = format!("{x} and {y} must be perpendicular unit vectors");
                    return Err(file.malformed(Place::Part("ImageOrientationPatient".into()), problem));
                }
                Some([x.normalize(), y.normalize()])
            }
        };
        let spacing = match set.decimals::<2>(PIXEL_SPACING) {
            Some([row, column]) if row > 0.0 && column > 0.0 => Some([column, row]),
            Some(_) => {
                let problem = "both numbers must be above 0";
                return Err(file.malformed(Place::Part("PixelSpacing".into()), problem));
            }
            None => {
                required(PIXEL_SPACING, "PixelSpacing")?;
                None
            }
        };
        let length = |tag| set.decimals::<1>(tag).map(|[length]| length.abs()).filter(|length| *length > 0.0);
        Ok(Self {
            path: file.path.clone(),
            pixels,
            compressed: set.packing != Packing::Native,
            values,
            // Stored numbers have 16 bits, so that sums this small are exact.
            integral: slope == 1.0 && intercept.fract() == 0.0 && intercept.abs() < 1e6,
            rescaled: slope != 1.0 || intercept != 0.0,
            instance: set.text(INSTANCE).and_then(|text| text.parse().ok()),
            position,
            axes,
            spacing,
            step: length(BETWEEN_SLICES).or_else(|| length(SLICE_THICKNESS)),
        })
    }

    fn name(&self) -> String {
        self.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    }
}

/// Slices of one series to a volume.
fn join(
    file: &File,
    mut slices: Vec<Slice>,
    mut notes: Vec<Note>,
    options: &OpenOptions,
) -> Result<Opened, ImportError> {
    let Some(first) = slices.first() else {
        return Err(file.malformed(Place::Whole, "none of its DICOM files holds an image"));
    };
    if let Some(other) = slices.iter().find(|other| !alike(first, other)) {
        let kind = |slice: &Slice| {
            let Pixels { columns, rows, .. } = slice.pixels;
            let spacing = slice.spacing.map_or("none".into(), |[x, y]| format!("{y}\\{x}"));
            let axes = slice.axes.map_or("none".into(), |[x, y]| format!("{x} {y}"));
            format!("{columns}x{rows} pixels, spacing {spacing}, orientation {axes}")
        };
        let feature = format!(
            "the slices differ: {} has {}, {} has {}",
            first.name(),
            kind(first),
            other.name(),
            kind(other)
        );
        return Err(file.unsupported(Place::Whole, feature));
    }
    if first.pixels.inverted {
        let kept = "MONOCHROME1: low values are meant to be shown bright; values are kept";
        notes.push(Note::Assumed(kept.into()));
    }
    let [x, y] = first.spacing.unwrap_or_else(|| {
        notes.push(Note::Assumed("a spacing of pixels of 1, since PixelSpacing is missing".into()));
        [1.0; 2]
    });
    let axes = first.axes.unwrap_or([DVec3::X, DVec3::Y]);
    let normal = axes[0].cross(axes[1]);
    let placed = first.axes.is_some() && slices.iter().all(|slice| slice.position.is_some());
    let step = if placed {
        sort_by_position(file, &mut slices, normal)?
    } else if slices.len() > 1 {
        notes.push(Note::Assumed("slices in the order of InstanceNumber, since they have no place".into()));
        sort_by_instance(file, &mut slices)?;
        None
    } else {
        None
    };
    let step = step.unwrap_or_else(|| normal * slices[0].step.unwrap_or(1.0));
    let origin = slices[0].position.filter(|_| placed).unwrap_or(DVec3::ZERO);
    let frame = frame::of_edges(origin, DMat3::from_cols(axes[0] * x, axes[1] * y, step));
    // Without directions nobody knows where the patient's are.
    let space = slices[0].axes.map(|_| Space::Lps);
    let frame = GridFrame { spacing: options.spacing.unwrap_or(frame.spacing), space, ..frame };
    let Pixels { columns, rows, .. } = slices[0].pixels;
    let dims = [usize::from(columns), usize::from(rows), slices.len()];
    notes.extend(replace_padding(file, &mut slices)?);
    let volume = Volume::new(dims, voxels(slices), frame)
        .map_err(|source| ImportError::Volume { path: file.path.clone(), source })?;
    Ok(Opened::noting(Content::Volume(volume), notes))
}

fn alike(first: &Slice, other: &Slice) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= SAME * a.abs().max(b.abs());
    let spacing = match (first.spacing, other.spacing) {
        (Some(a), Some(b)) => near(a[0], b[0]) && near(a[1], b[1]),
        (a, b) => a.is_none() && b.is_none(),
    };
    let axes = match (first.axes, other.axes) {
        (Some(a), Some(b)) => a[0].abs_diff_eq(b[0], SAME) && a[1].abs_diff_eq(b[1], SAME),
        (a, b) => a.is_none() && b.is_none(),
    };
    first.pixels == other.pixels && spacing && axes
}

/// Sorts along the normal; the step from slice to slice, if there are several.
fn sort_by_position(file: &File, slices: &mut [Slice], normal: DVec3) -> Result<Option<DVec3>, ImportError> {
    let position = |slice: &Slice| slice.position.unwrap_or(DVec3::ZERO);
    let along = |slice: &Slice| normal.dot(position(slice));
    slices.sort_by(|a, b| along(a).total_cmp(&along(b)).then_with(|| a.path.cmp(&b.path)));
    let Some(count) = slices.len().checked_sub(1).filter(|count| *count > 0) else { return Ok(None) };
    let steps: Vec<DVec3> = slices.windows(2).map(|pair| position(&pair[1]) - position(&pair[0])).collect();
    // The usual step, which neither a gap nor a shift changes.
    let median = |mut numbers: Vec<f64>| {
        numbers.sort_by(f64::total_cmp);
        numbers[count / 2]
    };
    let found: Vec<f64> = slices.windows(2).map(|pair| along(&pair[1]) - along(&pair[0])).collect();
    let usual = median(found.clone());
    let usual_step = DVec3::from([0, 1, 2].map(|axis| median(steps.iter().map(|step| step[axis]).collect())));
    for (index, (step, length)) in steps.iter().zip(&found).enumerate() {
        let (before, after) = (slices[index].name(), slices[index + 1].name());
        if *length <= 0.0 {
            let feature = format!("{before} and {after} are at one place; slices of one time are read");
            return Err(file.unsupported(Place::Whole, feature));
        }
        let off = *step - usual_step;
        if off.length() > STEP_TOLERANCE * usual + PLACE_TOLERANCE.min(0.1 * usual) {
            let (along, across) = ((length - usual).abs(), off.reject_from(normal).length());
            let feature = if along >= across {
                format!(
                    "slices are not evenly spaced: {before} and {after} are {length} apart along the normal, others {usual}"
                )
            } else {
                format!(
                    "slices are not in line: from {before} to {after} their plane moves by {across:.3} in itself, against others"
                )
            };
            return Err(file.unsupported(Place::Whole, feature));
        }
    }
    let across = position(&slices[count]) - position(&slices[0]);
    Ok(Some(across / count as f64))
}

fn sort_by_instance(file: &File, slices: &mut [Slice]) -> Result<(), ImportError> {
    if let Some(slice) = slices.iter().find(|slice| slice.instance.is_none()) {
        let feature = format!("{} has neither a place nor an InstanceNumber", slice.name());
        return Err(file.unsupported(Place::Whole, feature));
    }
    slices.sort_by(|a, b| a.instance.cmp(&b.instance).then_with(|| a.path.cmp(&b.path)));
    match slices.windows(2).find(|pair| pair[0].instance == pair[1].instance) {
        None => Ok(()),
        Some(pair) => {
            let feature = format!("{} and {} have the same InstanceNumber", pair[0].name(), pair[1].name());
            Err(file.unsupported(Place::Whole, feature))
        }
    }
}

/// Gives padding the least of the other values.
fn replace_padding(file: &File, slices: &mut [Slice]) -> Result<Option<Note>, ImportError> {
    let all = || slices.iter().flat_map(|slice| &slice.values);
    let count = all().filter(|value| value.is_nan()).count();
    if count == 0 {
        return Ok(None);
    }
    let least = all().copied().reduce(f32::min).filter(|least| !least.is_nan());
    let Some(least) = least else {
        return Err(file.unsupported(Place::Whole, "nothing but padding (PixelPaddingValue)"));
    };
    for value in slices.iter_mut().flat_map(|slice| &mut slice.values).filter(|value| value.is_nan()) {
        *value = least;
    }
    let what =
        format!("{count} samples of padding (PixelPaddingValue), which get the least of the others, {least}");
    Ok(Some(Note::LeftOut(what)))
}

/// The values of all slices in the type that fits.
fn voxels(slices: Vec<Slice>) -> Voxels {
    let all = |right: &dyn Fn(&Slice) -> bool| slices.iter().all(right);
    let integral = all(&|slice| slice.integral);
    let within = |low: f32, high: f32| {
        integral && slices.iter().flat_map(|slice| &slice.values).all(|value| (low..=high).contains(value))
    };
    let bytes = all(&|slice| !slice.rescaled && !slice.pixels.signed && slice.pixels.bits <= 8);
    let signed = within(f32::from(i16::MIN), f32::from(i16::MAX));
    let unsigned = within(0.0, f32::from(u16::MAX));
    if bytes {
        Voxels::U8(joined(slices, |value| value as u8))
    } else if signed {
        Voxels::I16(joined(slices, |value| value as i16))
    } else if unsigned {
        Voxels::U16(joined(slices, |value| value as u16))
    } else {
        Voxels::F32(joined(slices, |value| value))
    }
}

/// The values of all slices, each of which is dropped as soon as it is joined.
fn joined<T>(slices: Vec<Slice>, of: impl Fn(f32) -> T) -> Vec<T> {
    let mut all = Vec::with_capacity(slices.iter().map(|slice| slice.values.len()).sum());
    for slice in slices {
        all.extend(slice.values.iter().map(|&value| of(value)));
    }
    all
}
