//! MetaImage: ITK's text header with its samples behind it (`.mha`) or in files of their own (`.mhd`).
//!
//! Source: *MetaIO*, the library of the format (github.com/Kitware/MetaIO; `metaObject.cxx`, `metaImage.cxx`), and
//! ITK's reader (`itkMetaImageIO.cxx`) for the matrix. Three axes, or four of which the last has one sample;
//! one channel; samples binary, zlib or gzip (`CompressedData`), or text, in the file itself (`LOCAL`), another,
//! or one for each slice (`LIST`). File names with `%` are refused.
//!
//! Index (i, j, k) lies at `Offset` + i sx c0 + j sy c1 + k sz c2, where s are the `ElementSpacing` (else the
//! `ElementSize`) and c0, c1, c2 the first, second and third three numbers of `TransformMatrix`: what looks like a row is the
//! direction of a grid axis. The frame is the file's own (ITK's left, posterior, superior); `CenterOfRotation` moves
//! nothing. `HeaderSize` counts from the beginning of the file that holds the samples; -1 means its last bytes.
//! `ElementToIntensityFunction…` is not applied, as in ITK, and said.

use crate::file::{File, unmarked};
use crate::inflate;
use crate::scalar::Scalar;
use crate::volumes::frame;
use crate::volumes::voxels::{Layout, Samples};
use crate::{Content, Endian, ImportError, Note, OpenOptions, Opened, Place};
use glam::{DMat3, DVec3};
use oblate_volumes::{GridFrame, Space};
use std::borrow::Cow;
use std::collections::HashMap;
use std::str::FromStr;

/// Bytes of a header line, at most.
const LINE: usize = 4096;

/// Bytes of a header, at most: what is kept of it takes more memory than it has bytes.
const HEADER: usize = 1 << 20;

/// The fields of a header by name (lower case), each with its line.
struct Header<'a> {
    file: &'a File,
    fields: HashMap<String, (usize, String)>,
    /// Where the samples of a `LOCAL` file or the names of a `LIST` begin.
    body: usize,
}

/// Whether a file that begins with `bytes` is a MetaImage: its header has no fixed beginning, but only these are usual.
pub(crate) fn begins(bytes: &[u8]) -> bool {
    let head = unmarked(&bytes[..bytes.len().min(1024)]);
    ["ObjectType", "NDims", "Comment"].iter().any(|field| head.starts_with(field.as_bytes()))
        && head.windows(5).any(|word| word == b"NDims")
}

/// Reads a volume.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let header = Header::parse(file)?;
    let mut notes = Vec::new();
    let dims = header.dims()?;
    let scalar = header.scalar()?;
    let layout = Layout { dims, scalar, endian: header.endian(scalar, &mut notes)? };
    let frame = header.frame()?;
    header.intensities(&mut notes)?;
    let expected = layout.bytes(file)?;
    let samples = if header.is_text()? {
        Samples::Text(header.text()?)
    } else {
        Samples::Binary(header.binary(expected, options.max_memory, &mut notes)?)
    };
    let volume = layout.placed(file, layout.voxels(file, &samples)?, frame, options)?;
    Ok(Opened::noting(Content::Volume(volume), notes))
}

impl<'a> Header<'a> {
    /// Fields up to `ElementDataFile`, which is the last.
    fn parse(file: &'a File) -> Result<Self, ImportError> {
        let mut header = Self { file, fields: HashMap::new(), body: 0 };
        for (index, line) in file.bytes.split_inclusive(|&b| b == b'\n').enumerate() {
            header.body += line.len();
            let number = index + 1;
            // Messages quote lines: samples where a header is expected must not become one.
            if header.body > HEADER {
                let problem = format!("the header has more than {HEADER} bytes");
                return Err(file.malformed(Place::Line(number), problem));
            }
            let Some(text) = str::from_utf8(line).ok().filter(|text| text.len() <= LINE) else {
                let problem = format!("a header line must be text of at most {LINE} bytes");
                return Err(file.malformed(Place::Line(number), problem));
            };
            // A mark of UTF-8 is no part of the first field's name.
            let text = text.strip_prefix('\u{feff}').filter(|_| index == 0).unwrap_or(text).trim();
            if text.is_empty() {
                continue;
            }
            let Some((name, value)) = text.split_once(['=', ':']) else {
                return Err(file.malformed(Place::Line(number), format!("{text:?} is not \"Field = value\"")));
            };
            let name = name.trim().to_ascii_lowercase();
            let is_last = name == "elementdatafile";
            header.fields.insert(name, (number, value.trim().to_owned()));
            if is_last {
                return header.of_an_image();
            }
        }
        Err(file.malformed(Place::Whole, "the header lacks ElementDataFile, with which it ends"))
    }

    fn of_an_image(self) -> Result<Self, ImportError> {
        if let Some((place, kind)) = self.get(&["ObjectType"])
            && !kind.eq_ignore_ascii_case("image")
        {
            return Err(self.file.unsupported(place, format!("ObjectType {kind:?}; Image is supported")));
        }
        match self.numbers(&["ElementNumberOfChannels"], 1)? {
            Some(channels) if channels != [1.0] => {
                let feature = format!("ElementNumberOfChannels is {}; 1 is supported", channels[0]);
                Err(self.file.unsupported(self.place("ElementNumberOfChannels"), feature))
            }
            _ => Ok(self),
        }
    }

    /// A field's line and value, by the first of its names that is there.
    fn get(&self, names: &[&str]) -> Option<(Place, &str)> {
        let (line, value) = names.iter().find_map(|name| self.fields.get(&name.to_ascii_lowercase()))?;
        Some((Place::Line(*line), value))
    }

    fn place(&self, name: &str) -> Place {
        self.get(&[name]).map_or(Place::Whole, |(place, _)| place)
    }

    fn required(&self, name: &str) -> Result<(Place, &str), ImportError> {
        let missing = || self.file.malformed(Place::Whole, format!("the header lacks {name}"));
        self.get(&[name]).ok_or_else(missing)
    }

    /// `count` numbers, if the field is there.
    fn numbers(&self, names: &[&str], count: usize) -> Result<Option<Vec<f64>>, ImportError> {
        let Some((place, text)) = self.get(names) else { return Ok(None) };
        match parsed(text) {
            Some(numbers) if numbers.len() == count => Ok(Some(numbers)),
            _ => Err(self
                .file
                .malformed(place, format!("{}: {text:?} must be {count} numbers", names.join("/")))),
        }
    }

    fn flag(&self, names: &[&str]) -> Result<Option<bool>, ImportError> {
        let Some((place, text)) = self.get(names) else { return Ok(None) };
        match text.as_bytes().first().map(u8::to_ascii_lowercase) {
            Some(b't' | b'1') => Ok(Some(true)),
            Some(b'f' | b'0') => Ok(Some(false)),
            _ => Err(self
                .file
                .malformed(place, format!("{}: {text:?} must be True or False", names.join("/")))),
        }
    }

    /// A size in bytes, 0 where it is not given; -1 has a meaning of its own for some.
    fn size(&self, name: &str) -> Result<Option<usize>, ImportError> {
        let Some((place, text)) = self.get(&[name]) else { return Ok(Some(0)) };
        match text.parse::<i64>() {
            Ok(-1) => Ok(None),
            Ok(size) if size >= 0 => Ok(usize::try_from(size).ok()),
            _ => Err(self.file.malformed(place, format!("{name}: {text:?} must be a number of bytes"))),
        }
    }

    /// Samples along all axes, three or four.
    fn sizes(&self) -> Result<Vec<usize>, ImportError> {
        let (place, count) = self.required("NDims")?;
        let (sizes_place, text) = self.required("DimSize")?;
        let sizes: Option<Vec<usize>> = parsed(text);
        let Some(sizes) = sizes.filter(|sizes| count.parse() == Ok(sizes.len())) else {
            let problem = format!("DimSize: {text:?} must be NDims = {count} numbers of samples");
            return Err(self.file.malformed(sizes_place, problem));
        };
        match sizes.as_slice() {
            [_, _, _] | [_, _, _, 1] => Ok(sizes),
            _ => {
                let feature = format!(
                    "DimSize {text}: three axes are supported, or four of which the last has one sample"
                );
                Err(self.file.unsupported(place, feature))
            }
        }
    }

    fn dims(&self) -> Result<[usize; 3], ImportError> {
        let sizes = self.sizes()?;
        Ok([sizes[0], sizes[1], sizes[2]])
    }

    fn scalar(&self) -> Result<Scalar, ImportError> {
        let (place, name) = self.required("ElementType")?;
        Ok(match name {
            "MET_CHAR" => Scalar::I8,
            "MET_UCHAR" => Scalar::U8,
            "MET_SHORT" => Scalar::I16,
            "MET_USHORT" => Scalar::U16,
            // A long has 32 bits in MetaIO, whatever the machine.
            "MET_INT" | "MET_LONG" => Scalar::I32,
            "MET_UINT" | "MET_ULONG" => Scalar::U32,
            "MET_LONG_LONG" => Scalar::I64,
            "MET_ULONG_LONG" => Scalar::U64,
            "MET_FLOAT" => Scalar::F32,
            "MET_DOUBLE" => Scalar::F64,
            _ => {
                let feature = format!("ElementType {name:?}; MET_UCHAR to MET_DOUBLE are supported");
                return Err(self.file.unsupported(place, feature));
            }
        })
    }

    fn is_text(&self) -> Result<bool, ImportError> {
        Ok(self.flag(&["BinaryData"])? == Some(false))
    }

    /// The order of the samples' bytes; text has none.
    fn endian(&self, scalar: Scalar, notes: &mut Vec<Note>) -> Result<Endian, ImportError> {
        let stated = self.flag(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"])?;
        if self.is_text()? {
            return Ok(Endian::Little);
        }
        if stated.is_none() && scalar.size() > 1 {
            notes.push(Note::Assumed("little-endian samples, as ElementByteOrderMSB is missing".into()));
        }
        Ok(if stated == Some(true) { Endian::Big } else { Endian::Little })
    }

    fn frame(&self) -> Result<GridFrame, ImportError> {
        let axes = self.sizes()?.len();
        let spacing = self.numbers(&["ElementSpacing", "ElementSize"], axes)?;
        // Where several are given the library takes the one that comes first here.
        let origin =
            self.numbers(&["ElementOrigin", "ImagePosition", "Origin", "Position", "Offset"], axes)?;
        let matrix = &["ElementDirection", "TransformMatrix", "Rotation", "Orientation"];
        let matrix = self.numbers(matrix, axes * axes)?;
        let first_three = |numbers: Option<Vec<f64>>, default: DVec3| {
            numbers.map_or(default, |n| DVec3::new(n[0], n[1], n[2]))
        };
        let directions = matrix.map_or(DMat3::IDENTITY, |m| {
            DMat3::from_cols_array_2d(&std::array::from_fn(|axis| {
                std::array::from_fn(|component| m[axis * axes + component])
            }))
        });
        let edges = directions * DMat3::from_diagonal(first_three(spacing, DVec3::ONE));
        let frame = frame::of_edges(first_three(origin, DVec3::ZERO), edges);
        Ok(GridFrame { space: Some(Space::Lps), ..frame })
    }

    fn intensities(&self, notes: &mut Vec<Note>) -> Result<(), ImportError> {
        for (name, none) in
            [("ElementToIntensityFunctionSlope", 1.0), ("ElementToIntensityFunctionOffset", 0.0)]
        {
            if let Some(value) = self.numbers(&[name], 1)?
                && value != [none]
            {
                notes.push(Note::LeftOut(format!("{name} {}: values are as stored", value[0])));
            }
        }
        Ok(())
    }

    /// The samples that are written as text.
    fn text(&self) -> Result<Cow<'a, [u8]>, ImportError> {
        let (place, name) = self.required("ElementDataFile")?;
        match Source::of(name) {
            Source::Local => Ok(Cow::Borrowed(&self.file.bytes[self.body..])),
            Source::File => Ok(Cow::Owned(self.file.read_named(place, name)?.bytes)),
            _ => Err(self.file.unsupported(
                place,
                format!("ElementDataFile {name:?} with text samples; one file is supported"),
            )),
        }
    }

    /// The samples, `expected` bytes in all.
    fn binary(
        &self,
        expected: usize,
        limit: u64,
        notes: &mut Vec<Note>,
    ) -> Result<Cow<'a, [u8]>, ImportError> {
        let (place, name) = self.required("ElementDataFile")?;
        match Source::of(name) {
            Source::Local => self.part(self.file, self.body, (expected, limit), notes),
            Source::File => {
                let data = self.file.read_named(place, name)?;
                Ok(Cow::Owned(self.part(&data, 0, (expected, limit), notes)?.into_owned()))
            }
            Source::List => {
                let mut bytes = Vec::new();
                let names = self.list(name)?;
                // One file may be named for every slice: the files' size is no bound.
                inflate::within(expected, limit).map_err(|problem| self.file.malformed(place, problem))?;
                let per_file = expected / names.len();
                let mut read = 0;
                for (line, name) in names {
                    let place = Place::Line(line);
                    let data = self.file.read_named(place.clone(), name)?;
                    // Nor is its number of samples a bound of a file that is read again and again.
                    read += data.bytes.len();
                    inflate::within(read, limit).map_err(|problem| self.file.malformed(place, problem))?;
                    bytes.extend_from_slice(&self.part(&data, 0, (per_file, limit), notes)?);
                }
                Ok(Cow::Owned(bytes))
            }
            Source::Pattern => {
                let feature = format!("ElementDataFile {name:?}: name the files in a LIST instead");
                Err(self.file.unsupported(place, feature))
            }
        }
    }

    /// The names of a list's files, as many as are needed, with their lines.
    fn list(&self, name: &str) -> Result<Vec<(usize, &'a str)>, ImportError> {
        let place = self.place("ElementDataFile");
        let sizes = self.sizes()?;
        let axes_per_file = match name.split_whitespace().nth(1) {
            None => sizes.len() - 1,
            Some(word) => word.trim_end_matches(['D', 'd']).parse().unwrap_or(0),
        };
        if !(1..sizes.len()).contains(&axes_per_file) {
            let problem = format!("ElementDataFile {name:?}: a file must have 1 to {} axes", sizes.len() - 1);
            return Err(self.file.malformed(place, problem));
        }
        // Not 0 and no overflow: the bytes of all samples are a number above 0.
        let count = sizes[axes_per_file..].iter().product();
        let Ok(text) = str::from_utf8(&self.file.bytes[self.body..]) else {
            return Err(self.file.malformed(place, "the list of files must be text"));
        };
        let first = 1 + self.file.bytes[..self.body].iter().filter(|&&b| b == b'\n').count();
        let lines = text.lines().enumerate().map(|(i, name)| (first + i, name.trim()));
        let names: Vec<_> = lines.filter(|(_, name)| !name.is_empty()).take(count).collect();
        if names.len() < count {
            let problem = format!("the list names {} files; DimSize needs {count}", names.len());
            return Err(self.file.malformed(place, problem));
        }
        Ok(names)
    }

    /// `expected` bytes of samples from one file, in which they begin at `start` if `HeaderSize` does not tell.
    fn part<'s>(
        &self,
        source: &'s File,
        start: usize,
        (expected, limit): (usize, u64),
        notes: &mut Vec<Note>,
    ) -> Result<Cow<'s, [u8]>, ImportError> {
        let is_compressed = self.flag(&["CompressedData"])? == Some(true);
        let start = match self.size("HeaderSize")? {
            Some(0) => Some(start),
            Some(size) => Some(size),
            None if is_compressed => {
                let feature = "HeaderSize -1 of compressed data, whose size the header does not tell";
                return Err(self.file.unsupported(self.place("HeaderSize"), feature));
            }
            None => source.bytes.len().checked_sub(expected),
        };
        let body = start.and_then(|start| source.bytes.get(start..)).unwrap_or_default();
        let malformed = |problem: String| source.malformed(Place::Whole, problem);
        if is_compressed {
            let body = match self.size("CompressedDataSize")? {
                Some(0) | None => body,
                Some(size) => body.get(..size).ok_or_else(|| {
                    malformed(format!("CompressedDataSize is {size}; there are {} bytes", body.len()))
                })?,
            };
            return unpacked(body, expected, limit).map(Cow::Owned).map_err(malformed);
        }
        if body.len() > expected {
            let note = Note::LeftOut(format!("{} bytes after the samples", body.len() - expected));
            // Slices of a list are alike: once is enough.
            if !notes.contains(&note) {
                notes.push(note);
            }
        }
        let samples = body.get(..expected);
        let short = || malformed(format!("{} bytes of samples; {expected} are expected", body.len()));
        samples.map(Cow::Borrowed).ok_or_else(short)
    }
}

/// Where samples are.
enum Source {
    Local,
    File,
    List,
    Pattern,
}

impl Source {
    fn of(name: &str) -> Self {
        match name {
            _ if name.eq_ignore_ascii_case("local") => Self::Local,
            _ if name.starts_with("LIST") => Self::List,
            _ if name.contains('%') => Self::Pattern,
            _ => Self::File,
        }
    }
}

fn parsed<T: FromStr>(text: &str) -> Option<Vec<T>> {
    text.split_whitespace().map(|word| word.parse().ok()).collect()
}

/// MetaIO writes zlib and reads gzip as well.
fn unpacked(body: &[u8], expected: usize, limit: u64) -> Result<Vec<u8>, String> {
    inflate::within(expected, limit)?;
    if body.starts_with(&inflate::GZIP) {
        inflate::gunzip(body, expected)
    } else {
        inflate::zlib(body, expected)
    }
}
