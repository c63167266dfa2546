//! Numbered slices: a folder is a volume when its files are numbered.
//!
//! A folder with DICOM files is read as [`super::dicom`] says. Otherwise, of the files whose names don't begin with a dot,
//! those with the most common extension (a number as extension, as in `CThead.12`, counts as one) are the slices; others
//! are left out and named. The names of slices are the same but for one number, which counts as a number: `2` comes
//! before `10`, `010` is 10. The numbers begin anywhere and go in equal steps; a gap is refused.
//!
//! Slices are images or raw samples, all of one size and type. Images are PNG and JPEG of 8 or 16 bits, PGM with its numbers
//! as they are, TIFF of one page; colour, palettes, transparency and fewer than 8 bits are refused. Of raw samples the caller's options say the layout, or names such as `head_012_256x256_u16be.raw`: dims are those
//! of a slice (`256x256`), or of all (`256x256x113`). The first slice has z 0, its first row y 0; spacing is 1 unless
//! the caller says otherwise.

use crate::file::File;
use crate::format;
use crate::grey::{self, Grey};
use crate::inflate;
use crate::volumes::voxels::Layout;
use crate::volumes::{dicom, raw};
use crate::{Content, ImportError, Note, OpenOptions, Opened, Place};
use oblate_volumes::GridFrame;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Files that a message lists at most.
const LISTED: usize = 5;

/// Reads the volume of a folder.
pub(crate) fn read(folder: &Path, options: &OpenOptions) -> Result<Opened, ImportError> {
    let files = files(folder)?;
    let dicom = dicom::of_folder(&files)?;
    if !dicom.is_empty() {
        return dicom::read_series(folder, &dicom, options);
    }
    // What speaks of the folder as a whole.
    let folder = File { path: folder.to_owned(), bytes: Vec::new() };
    let (names, mut notes) = of_one_kind(&folder, &files)?;
    let order = numbered(&folder, &names)?;
    let mut joined: Option<Grey> = None;
    let mut packed = 0;
    for &index in &order {
        let file = File::read(&folder.path.join(&names[index]))?;
        let slice = read_slice(&file, order.len(), options)?;
        packed += file.bytes.len();
        match &mut joined {
            None => {
                notes.extend(slice.notes.iter().cloned());
                joined = Some(slice);
            }
            Some(joined) => {
                let is = |slice: &Grey| (slice.layout.dims, slice.layout.scalar);
                if is(&slice) != is(joined) {
                    let kind = |slice: &Grey| {
                        let [x, y, _] = slice.layout.dims;
                        format!("{x}x{y} samples of {:?}", slice.layout.scalar)
                    };
                    let first = &names[order[0]];
                    let problem = format!(
                        "{}, but {first} has {}; all slices must be alike",
                        kind(&slice),
                        kind(joined)
                    );
                    return Err(file.malformed(Place::Whole, problem));
                }
                joined.bytes.extend_from_slice(&slice.bytes);
                let unpacked = joined.bytes.len();
                if unpacked > packed && unpacked as u64 > options.max_memory {
                    return Err(folder.malformed(Place::Whole, inflate::over_limit(options.max_memory)));
                }
            }
        }
    }
    let Some(Grey { layout, bytes, .. }) = joined else {
        return Err(folder.malformed(Place::Whole, "there are no slices in it"));
    };
    let [x, y, _] = layout.dims;
    let layout = Layout { dims: [x, y, order.len()], ..layout };
    let volume = layout.volume(&folder, &bytes, GridFrame::default(), options)?;
    Ok(Opened::noting(Content::Volume(volume), notes))
}

/// The folder's files that are not hidden, by name.
pub(super) fn files(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let unread = |source| ImportError::Read { path: folder.to_owned(), source };
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(unread)? {
        let entry = entry.map_err(unread)?;
        let hidden = entry.file_name().to_string_lossy().starts_with('.');
        if !hidden && entry.path().is_file() {
            files.push(entry.path());
        }
    }
    files.sort();
    Ok(files)
}

/// The names of the files with the most common extension, and what is to be said of the others.
fn of_one_kind(folder: &File, files: &[PathBuf]) -> Result<(Vec<String>, Vec<Note>), ImportError> {
    let mut kinds: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for path in files {
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
            let problem = format!("the name of {} is not UTF-8", path.display());
            return Err(folder.malformed(Place::Whole, problem));
        };
        let extension = name.rsplit_once('.').map_or("", |(_, extension)| extension).to_ascii_lowercase();
        let is_number = !extension.is_empty() && extension.bytes().all(|b| b.is_ascii_digit());
        kinds.entry(if is_number { "0".into() } else { extension }).or_default().push(name.to_owned());
    }
    let most = kinds.values().map(Vec::len).max().unwrap_or(0);
    let mut common: Vec<String> =
        kinds.iter().filter(|(_, names)| names.len() == most).map(|(kind, _)| kind.clone()).collect();
    let kind = match (common.pop(), common.is_empty()) {
        (None, _) => {
            return Err(folder.malformed(Place::Whole, "there are no files in it, which slices would be"));
        }
        (Some(kind), true) => kind,
        (Some(kind), false) => {
            let named: Vec<&str> = common.iter().chain([&kind]).map(|kind| &kinds[kind][0][..]).collect();
            let problem = format!(
                "there are as many files like {}; slices are the files of the most common extension",
                named.join(" as like ")
            );
            return Err(folder.malformed(Place::Whole, problem));
        }
    };
    let names = kinds.remove(&kind).unwrap_or_default();
    let others: Vec<String> = kinds.into_values().flatten().collect();
    let left_out = (!others.is_empty()).then(|| {
        let more = if others.len() > LISTED { ", …" } else { "" };
        let listed = others[..others.len().min(LISTED)].join(", ");
        Note::LeftOut(format!("{} files of the folder that are no slices: {listed}{more}", others.len()))
    });
    Ok((names, left_out.into_iter().collect()))
}

/// A name as what is between numbers, and numbers: texts at even places, digits at odd ones.
fn parts(name: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    let mut rest = name;
    loop {
        let text = rest.bytes().position(|b| b.is_ascii_digit()).unwrap_or(rest.len());
        parts.push(&rest[..text]);
        rest = &rest[text..];
        if rest.is_empty() {
            return parts;
        }
        let digits = rest.bytes().position(|b| !b.is_ascii_digit()).unwrap_or(rest.len());
        parts.push(&rest[..digits]);
        rest = &rest[digits..];
    }
}

/// The order of the names by their numbers.
fn numbered(folder: &File, names: &[String]) -> Result<Vec<usize>, ImportError> {
    let malformed = |problem: String| Err(folder.malformed(Place::Whole, problem));
    let split: Vec<Vec<&str>> = names.iter().map(|name| parts(name)).collect();
    let texts =
        |parts: &[&str]| parts.iter().step_by(2).map(|text| text.to_ascii_lowercase()).collect::<Vec<_>>();
    let first = texts(&split[0]);
    if let Some(index) = split.iter().position(|parts| parts.len() != split[0].len() || texts(parts) != first)
    {
        return malformed(format!(
            "{} and {} differ in more than a number; slices are numbered files of one name",
            names[0], names[index]
        ));
    }
    let mut varying =
        (1..split[0].len()).step_by(2).filter(|&at| split.iter().any(|parts| parts[at] != split[0][at]));
    // A single slice has its number where most have it: last.
    let last = (1..split[0].len()).step_by(2).next_back();
    let (at, second) = (varying.next().or(last), varying.next());
    let Some(at) = at else {
        return malformed(format!("{} has no number, as the name of a slice has", names[0]));
    };
    if second.is_some() {
        return malformed(format!(
            "two numbers in names such as {} change; slices have one that does",
            names[0]
        ));
    }
    let mut order = Vec::new();
    for (index, parts) in split.iter().enumerate() {
        match parts[at].parse::<u64>() {
            Ok(number) => order.push((number, index)),
            Err(_) => {
                return malformed(format!("the number in {} is too large for one of a slice", names[index]));
            }
        }
    }
    order.sort_unstable();
    let pairs = || order.windows(2).map(|pair| (pair[0], pair[1], pair[1].0 - pair[0].0));
    let step = pairs().map(|(.., step)| step).min().unwrap_or(1);
    for ((low, before), (_, after), found) in pairs() {
        if found == 0 {
            return malformed(format!("{} and {} have the same number", names[before], names[after]));
        }
        if found != step {
            return malformed(format!(
                "slice {} is missing: {} is followed by {}",
                low + step,
                names[before],
                names[after]
            ));
        }
    }
    Ok(order.into_iter().map(|(_, index)| index).collect())
}

/// A slice of any kind, one of `count`.
fn read_slice(file: &File, count: usize, options: &OpenOptions) -> Result<Grey, ImportError> {
    if let Some(slice) = grey::read(file, options.max_memory)? {
        return Ok(slice);
    }
    if let Some(format) = format::of_beginning(&file.bytes) {
        let feature = format!(
            "{}, which is no slice; a folder is read as numbered slices (PNG, JPEG, PGM, TIFF, DICOM or raw)",
            format.name
        );
        return Err(file.unsupported(Place::Whole, feature));
    }
    let mut layout = raw::layout(file, options)?;
    let [x, y, z] = layout.dims;
    if z != 1 && z != count {
        let problem = format!("dims {x}x{y}x{z} have {z} slices, but the folder has {count}");
        return Err(file.malformed(Place::Whole, problem));
    }
    layout.dims = [x, y, 1];
    let sample_type = layout.sample_type;
    let layout = Layout { dims: layout.dims, scalar: sample_type.scalar(), endian: layout.endian };
    let expected = layout.bytes(file)?;
    if file.bytes.len() != expected {
        let problem = format!(
            "{} bytes; a slice of {x}x{y} of {sample_type} has {expected}; check dims and type",
            file.bytes.len()
        );
        return Err(file.malformed(Place::Whole, problem));
    }
    Ok(Grey { layout, bytes: file.bytes.clone(), notes: Vec::new() })
}
