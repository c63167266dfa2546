//! PLOT3D: a curvilinear grid in two files, of points and of the flow at these.
//!
//! Source: Walatka, Buning, Pierce, Elson, *PLOT3D User's Manual*, NASA TM 101067, 1990, chapter 8. The points' file has the counts along the grid's
//! axes, all x, all y, all z, and maybe a mark for each point, which is 0 where it is blanked; the flow's has the same counts, four numbers (Mach
//! number, angle of attack, Reynolds number, time), then density, three of momentum, energy for all points each. Integers have 32 bits; reals 32 or 64;
//! bytes are in either order; files may begin with a number of grids, and each list may be a Fortran record, between its length in bytes. Nothing in a
//! file says which of these it is, but one alone fits its size.

use crate::file::File;
use crate::scalar::Scalar;
use crate::source::Source;
use crate::volumes::voxels::{Layout, Samples};
use crate::volumes::vtk::grid::{Places, PointGrid};
use crate::{Endian, ImportError, Note, OpenOptions, Opened, Place};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// Files are padded to this many bytes on some tapes.
const BLOCK: usize = 512;

/// Grids that a file may say to have.
const MOST_GRIDS: usize = 1024;

/// What a file is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// With marks of blanked points, or without.
    Points {
        marks: bool,
    },
    Flow,
}

/// How a file is written.
#[derive(Clone, Debug)]
struct Header {
    part: Part,
    dims: Vec<[usize; 3]>,
    real: Scalar,
    endian: Endian,
    /// Where the first of the numbers at points is.
    begin: usize,
    /// Bytes that belong to it.
    size: usize,
}

/// All ways to write numbers.
const WAYS: [(Endian, bool, bool); 8] = {
    let [big, little] = [Endian::Big, Endian::Little];
    [
        (big, false, false),
        (little, false, false),
        (big, true, false),
        (little, true, false),
        (big, false, true),
        (little, false, true),
        (big, true, true),
        (little, true, true),
    ]
};

impl Header {
    /// The way to write numbers in which a file of `size` bytes that begins with `bytes` is one of PLOT3D.
    fn of(bytes: &[u8], size: usize) -> Option<Self> {
        WAYS.iter().find_map(|way| Self::written(bytes, size, *way))
    }

    fn written(bytes: &[u8], size: usize, (endian, records, counted): (Endian, bool, bool)) -> Option<Self> {
        let mut at = 0;
        let mut word = || {
            let number = Scalar::U32.first(bytes.get(at..)?, endian)? as usize;
            at += 4;
            Some(number)
        };
        // The length of a record, where there are records.
        let mut grids = 1;
        if counted {
            let [before, count, after] = if records { [word()?, word()?, word()?] } else { [4, word()?, 4] };
            if [before, after] != [4; 2] || !(1..=MOST_GRIDS).contains(&count) {
                return None;
            }
            grids = count;
        }
        let before = if records { word()? } else { 12 * grids };
        let mut dims = Vec::new();
        for _ in 0..grids {
            dims.push([word()?, word()?, word()?]);
        }
        let after = if records { word()? } else { before };
        let fits = dims.iter().flatten().all(|count| (2..1 << 24).contains(count));
        if [before, after] != [12 * grids; 2] || !fits {
            return None;
        }
        let points = dims.iter().try_fold(0_usize, |sum, [x, y, z]| {
            x.checked_mul(*y).and_then(|n| n.checked_mul(*z)).and_then(|n| n.checked_add(sum))
        })?;
        let around = if records { 4 } else { 0 };
        let head = at;
        for real in [Scalar::F32, Scalar::F64] {
            for part in [Part::Points { marks: false }, Part::Points { marks: true }, Part::Flow] {
                let (at_each, at_grid) = match part {
                    Part::Points { marks } => (3 * real.size() + if marks { 4 } else { 0 }, 0),
                    // Conditions of the flow, in a record of their own.
                    Part::Flow => (5 * real.size(), 4 * real.size() + 2 * around),
                };
                let of_grids = grids.checked_mul(at_grid + 2 * around)?;
                let whole = at_each.checked_mul(points)?.checked_add(of_grids)?.checked_add(head)?;
                let is_padded = points > BLOCK && whole.next_multiple_of(BLOCK) == size;
                if whole == size || is_padded {
                    return Some(Self {
                        part,
                        dims,
                        real,
                        endian,
                        begin: head + at_grid + around,
                        size: whole,
                    });
                }
            }
        }
        None
    }

    /// One of the lists of numbers at the points of the only grid.
    fn list<'a>(&self, file: &'a File, (number, scalar): (usize, Scalar)) -> (Layout, &'a [u8]) {
        let layout = Layout { dims: self.dims[0], scalar, endian: self.endian };
        let count: usize = self.dims[0].iter().product();
        // Lists are of reals, but for the last.
        let begin = self.begin + number * count * self.real.size();
        (layout, &file.bytes[begin..begin + count * scalar.size()])
    }
}

/// Whether a file of `size` bytes that begins with `bytes` is a half of PLOT3D's.
pub(crate) fn is_plot3d(bytes: &[u8], size: usize) -> bool {
    Header::of(bytes, size).is_some()
}

/// Reads a volume, of density, from either of its files.
pub(crate) fn read(source: Source, options: &OpenOptions) -> Result<Opened, ImportError> {
    let given = source.into_file()?;
    let header = header(&given)?;
    let is_flow = header.part == Part::Flow;
    if is_flow && options.flow.is_some() {
        let problem = "it is a file of the flow itself; give the points' file with another";
        return Err(given.malformed(Place::Whole, problem));
    }
    let other = File::read(&partner(&given, is_flow, options)?)?;
    let of_other = self::header(&other)?;
    if (of_other.part == Part::Flow) == is_flow || of_other.dims != header.dims {
        let problem =
            format!("{}: it should be of {} at the same points", sizes(&of_other), halves(!is_flow));
        return Err(other.malformed(Place::Whole, problem));
    }
    let [points, flow] = if is_flow {
        [(&other, &of_other), (&given, &header)]
    } else {
        [(&given, &header), (&other, &of_other)]
    };
    volume(points, flow, options)
}

fn volume(
    (points_file, of_points): (&File, &Header),
    (flow_file, of_flow): (&File, &Header),
    options: &OpenOptions,
) -> Result<Opened, ImportError> {
    let numbers = |list| {
        let (layout, bytes) = of_points.list(points_file, list);
        layout.numbers(points_file, &Samples::Binary(bytes.into()))
    };
    let mut points = Vec::new();
    for axis in 0..3 {
        let coordinates = numbers((axis, of_points.real))?;
        points.resize(coordinates.len(), DVec3::ZERO);
        points.iter_mut().zip(coordinates).for_each(|(point, coordinate)| point[axis] = coordinate);
    }
    if of_points.part == (Part::Points { marks: true }) {
        let marks = numbers((3, Scalar::I32))?;
        let blanked = points.iter_mut().zip(marks).filter(|(_, mark)| *mark == 0.0);
        blanked.for_each(|(point, _)| *point = DVec3::NAN);
    }
    let (layout, bytes) = of_flow.list(flow_file, (0, of_flow.real));
    let densities = layout.voxels(flow_file, &Samples::Binary(bytes.into()))?;
    let grid = PointGrid { points: layout.dims, places: Places::Each(points) };
    let mut opened = grid.volume((points_file, options), (&layout, densities), false)?;
    opened.notes.push(Note::LeftOut("momentum and energy: values are densities".into()));
    for (file, header) in [(points_file, of_points), (flow_file, of_flow)] {
        let rest = file.bytes.len() - header.size;
        if rest > 0 {
            let text = format!("{rest} bytes at the end of {}", file.path.display());
            opened.notes.push(Note::LeftOut(text));
        }
    }
    Ok(opened)
}

/// How a file of one grid is written.
fn header(file: &File) -> Result<Header, ImportError> {
    let Some(header) = Header::of(&file.bytes, file.bytes.len()) else {
        let problem = format!(
            "{} bytes that fit no PLOT3D file of points or flow: counts along the axes, then lists of 32- or 64-bit reals, \
             each as long as these say",
            file.bytes.len()
        );
        return Err(file.malformed(Place::Whole, problem));
    };
    if header.dims.len() > 1 {
        let feature = format!("{} grids; one is supported: write them to a file each", header.dims.len());
        return Err(file.unsupported(Place::Whole, feature));
    }
    Ok(header)
}

fn halves(is_flow: bool) -> &'static str {
    if is_flow { "the flow" } else { "the points" }
}

fn sizes(header: &Header) -> String {
    let [x, y, z] = header.dims[0];
    format!("{} of {x}x{y}x{z} points", if header.part == Part::Flow { "the flow" } else { "a grid" })
}

/// The file that is asked for; else the one beside this whose name says so.
fn partner(given: &File, is_flow: bool, options: &OpenOptions) -> Result<PathBuf, ImportError> {
    if let Some(flow) = &options.flow {
        return Ok(flow.clone());
    }
    let candidates = partners(&given.path, is_flow);
    if let Some(found) = candidates.iter().find(|path| path.is_file() && **path != given.path) {
        return Ok(found.clone());
    }
    let names: Vec<String> =
        candidates.iter().filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned())).collect();
    let problem = format!(
        "these are {} of a PLOT3D grid; the file of {} must lie beside it, as {}, or be named",
        halves(is_flow),
        halves(!is_flow),
        names.join(" or ")
    );
    Err(given.malformed(Place::Whole, problem))
}

/// Names that go with one: `bluntfinq.bin` with `bluntfinxyz.bin`, `fin.q` with `fin.x`, `fin.xyz` and `fin.g`.
fn partners(path: &Path, is_flow: bool) -> Vec<PathBuf> {
    let part =
        |part: Option<&std::ffi::OsStr>| part.map(|p| p.to_string_lossy().into_owned()).unwrap_or_default();
    let (stem, extension) = (part(path.file_stem()), part(path.extension()));
    let (own, others): (&str, &[&str]) = if is_flow { ("q", &["xyz", "x", "g"]) } else { ("xyz", &["q"]) };
    let mut names = Vec::new();
    for (own, other) in
        [(own.to_owned(), others[0].to_owned()), (own.to_uppercase(), others[0].to_uppercase())]
    {
        if let Some(at) = stem.rfind(&own) {
            let renamed = format!("{}{other}{}", &stem[..at], &stem[at + own.len()..]);
            names.push(if extension.is_empty() { renamed } else { format!("{renamed}.{extension}") });
        }
    }
    names.extend(others.iter().map(|other| format!("{stem}.{other}")));
    names.iter().map(|name| path.with_file_name(name)).collect()
}
