//! VTK's legacy format (`.vtk`), ascii and binary.
//!
//! Source: *VTK File Formats* (docs.vtk.org), simple legacy formats, versions 1 to 5; where it is silent, VTK's reader
//! (`vtkDataReader.cxx`): words in any case, binary numbers big-endian behind the end of their header's line, `long` of
//! 64 bits, `vtkIdType` of 32. Datasets `STRUCTURED_POINTS`, `RECTILINEAR_GRID`, `STRUCTURED_GRID`, and `UNSTRUCTURED_GRID` as scattered points. Of `SCALARS`,
//! `COLOR_SCALARS` and `FIELD` arrays the first of one component is taken, point data before cell data; vectors, normals,
//! texture coordinates, tensors, ids, lookup tables and metadata are passed over.

use super::grid::{Coordinates, Places, PointGrid, triples};
use crate::file::{File, quoted};
use crate::scalar::Scalar;
use crate::volumes::voxels::{Layout, Samples};
use crate::{Endian, ImportError, OpenOptions, Opened, Place};
use glam::{DMat3, DVec3};
use std::borrow::Cow;
use std::ops::Range;
use std::str::FromStr;

/// How legacy files begin.
pub(crate) const MAGIC: &[u8] = b"# vtk DataFile Version";

/// Bytes of a word that are looked at: no keyword, type or number is longer, and messages quote words.
const LONGEST: usize = 64;

/// Datasets that are volumes.
const KINDS: [&str; 4] = ["STRUCTURED_POINTS", "RECTILINEAR_GRID", "STRUCTURED_GRID", "UNSTRUCTURED_GRID"];

/// A place in the file, from which words and numbers are taken.
struct Reader<'a> {
    file: &'a File,
    at: usize,
    is_text: bool,
}

/// An array and where its numbers are.
#[derive(Clone)]
struct Array {
    scalar: Scalar,
    components: usize,
    tuples: usize,
    numbers: Range<usize>,
    /// Whether they are bytes as text, in shares of 255.
    in_shares: bool,
}

/// Reads a volume.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let mut reader = Reader { file, at: 0, is_text: false };
    reader.head()?;
    let grid = reader.dataset()?;
    let Some((array, on_cells)) = reader.scalars()? else {
        return Err(file.malformed(Place::Whole, "no SCALARS, COLOR_SCALARS or FIELD array of one component"));
    };
    let dims = grid.dims(on_cells).map_err(|problem| file.malformed(Place::Whole, problem))?;
    let layout = Layout { dims, scalar: array.scalar, endian: Endian::Big };
    if dims.iter().try_fold(1_usize, |product, &dim| product.checked_mul(dim)) != Some(array.tuples) {
        let [x, y, z] = dims;
        let problem = format!("an array of {} numbers; {x}x{y}x{z} are expected", array.tuples);
        return Err(file.malformed(reader.place(array.numbers.start), problem));
    }
    let voxels = layout.voxels(file, &reader.samples(&array)?)?;
    grid.volume((file, options), (&layout, voxels), on_cells)
}

impl<'a> Reader<'a> {
    fn rest(&self) -> &'a [u8] {
        &self.file.bytes[self.at..]
    }

    /// The line of a byte.
    fn place(&self, at: usize) -> Place {
        if self.is_text {
            Place::Line(1 + self.file.bytes[..at].iter().filter(|&&b| b == b'\n').count())
        } else {
            Place::Byte(at)
        }
    }

    fn malformed(&self, problem: impl Into<String>) -> ImportError {
        self.file.malformed(self.place(self.at), problem)
    }

    fn unsupported(&self, feature: impl Into<String>) -> ImportError {
        self.file.unsupported(self.place(self.at), feature)
    }

    /// What is left of the line, without its end.
    fn line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let end = rest.iter().position(|&b| b == b'\n');
        self.at += end.map_or(rest.len(), |end| end + 1);
        rest[..end.unwrap_or(rest.len())].trim_ascii()
    }

    /// The next word; `None` at the end of the file.
    fn next_word(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest();
        let start = rest.iter().position(|b| !b.is_ascii_whitespace())?;
        let length = rest[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - start);
        self.at += start + length;
        Some(&rest[start..start + length])
    }

    /// The beginning of the next word in capitals: keywords are written in any case. `None` at the end of the file.
    fn keyword(&mut self) -> Option<String> {
        let word = self.next_word()?;
        Some(String::from_utf8_lossy(&word[..word.len().min(LONGEST)]).to_ascii_uppercase())
    }

    fn word(&mut self, what: &str) -> Result<String, ImportError> {
        match self.next_word() {
            Some(word) => Ok(String::from_utf8_lossy(&word[..word.len().min(LONGEST)]).into_owned()),
            None => Err(self.malformed(format!("the file ends where {what} is expected"))),
        }
    }

    fn number<T: FromStr>(&mut self, what: &str) -> Result<T, ImportError> {
        let word = self.word(what)?;
        word.parse().map_err(|_| self.malformed(format!("{what}: {word:?} is no such number")))
    }

    fn three<T: FromStr + Copy>(&mut self, what: &str) -> Result<[T; 3], ImportError> {
        Ok([self.number(what)?, self.number(what)?, self.number(what)?])
    }

    /// The three lines at the beginning.
    fn head(&mut self) -> Result<(), ImportError> {
        if !self.rest().starts_with(MAGIC) {
            return Err(self.malformed("a VTK file begins with \"# vtk DataFile Version\" or <VTKFile"));
        }
        self.line();
        self.line();
        let encoding = self.line();
        self.is_text = encoding.eq_ignore_ascii_case(b"ASCII");
        if self.is_text || encoding.eq_ignore_ascii_case(b"BINARY") {
            Ok(())
        } else {
            let encoding = quoted(&String::from_utf8_lossy(encoding));
            let problem = format!("{encoding} must be ASCII or BINARY");
            Err(self.file.malformed(Place::Line(3), problem))
        }
    }

    /// The dataset's words, up to those of its arrays.
    fn dataset(&mut self) -> Result<PointGrid, ImportError> {
        let mut word = self.keyword().unwrap_or_default();
        while word == "FIELD" || word == "METADATA" {
            self.pass_over(&word, 0)?;
            word = self.keyword().unwrap_or_default();
        }
        if word != "DATASET" {
            return Err(self.malformed(format!("{word:?} stands where DATASET is expected")));
        }
        let kind = self.keyword().unwrap_or_default();
        if !KINDS.contains(&&kind[..]) {
            let feature = format!("DATASET {kind}; {} are supported as volumes", KINDS.join(", "));
            return Err(self.unsupported(feature));
        }
        let mut points = None;
        let (mut origin, mut spacing) = ([0.0; 3], [1.0; 3]);
        let mut axes = [None, None, None];
        let mut places = None;
        loop {
            let before = self.at;
            let Some(word) = self.keyword() else { break };
            match word.as_str() {
                "DIMENSIONS" => points = Some(self.three("DIMENSIONS")?),
                "ORIGIN" => origin = self.three("ORIGIN")?,
                "SPACING" | "ASPECT_RATIO" => spacing = self.three("SPACING")?,
                "X_COORDINATES" => axes[0] = Some(self.coordinates()?),
                "Y_COORDINATES" => axes[1] = Some(self.coordinates()?),
                "Z_COORDINATES" => axes[2] = Some(self.coordinates()?),
                "POINTS" => places = Some(self.points()?),
                "CELLS" => self.cells()?,
                "CELL_TYPES" => {
                    let count = self.number("a number of cells")?;
                    self.array(Scalar::I32, 1, count)?;
                }
                "FIELD" | "METADATA" => self.pass_over(&word, 0)?,
                "POINT_DATA" | "CELL_DATA" => {
                    self.at = before;
                    break;
                }
                _ => {
                    return Err(self.malformed(format!("{word:?} is no word of DATASET {kind}")));
                }
            }
        }
        if kind == "UNSTRUCTURED_GRID" {
            let Some(places) = places else { return Err(self.malformed("POINTS are missing")) };
            return Ok(PointGrid { points: [places.len(), 1, 1], places: Places::Scattered(places) });
        }
        let Some(points) = points else { return Err(self.malformed("DIMENSIONS are missing")) };
        if kind == "STRUCTURED_POINTS" {
            let edges = DMat3::from_diagonal(DVec3::from_array(spacing));
            let places = Places::Even { origin: DVec3::from_array(origin), edges };
            return Ok(PointGrid { points, places });
        }
        if kind == "STRUCTURED_GRID" {
            let Some(places) = places else { return Err(self.malformed("POINTS are missing")) };
            let [x, y, z] = points;
            if x.checked_mul(y).and_then(|n| n.checked_mul(z)) != Some(places.len()) {
                let problem = format!("{} points; DIMENSIONS are {points:?}", places.len());
                return Err(self.malformed(problem));
            }
            return Ok(PointGrid { points, places: Places::Each(places) });
        }
        let [Some(x), Some(y), Some(z)] = axes else {
            return Err(self.malformed("X_COORDINATES, Y_COORDINATES and Z_COORDINATES are needed"));
        };
        let axes = [x, y, z];
        let counts = axes.each_ref().map(|axis| axis.values.len());
        if counts != points {
            return Err(self.malformed(format!("{counts:?} coordinates; DIMENSIONS are {points:?}")));
        }
        PointGrid::rectilinear(axes).map_err(|problem| self.unsupported(problem))
    }

    /// `POINTS count type`, its word being taken.
    fn points(&mut self) -> Result<Vec<DVec3>, ImportError> {
        let count = self.number("a number of points")?;
        let kind = self.scalar()?;
        let array = self.array(kind, 3, count)?;
        let layout = Layout { dims: [count, 3, 1], scalar: kind, endian: Endian::Big };
        Ok(triples(&layout.numbers(self.file, &self.samples(&array)?)?))
    }

    /// `CELLS`, its word being taken: which points are corners of which cell is passed over. From version 5 on there are two arrays.
    fn cells(&mut self) -> Result<(), ImportError> {
        let [cells, numbers] = [self.number("a number of cells")?, self.number("a number of corners")?];
        let before = self.at;
        if self.keyword().is_none_or(|word| word != "OFFSETS") {
            self.at = before;
            return self.array(Scalar::I32, 1, numbers).map(drop);
        }
        let kind = self.scalar()?;
        self.array(kind, 1, cells)?;
        if self.keyword().is_none_or(|word| word != "CONNECTIVITY") {
            return Err(self.malformed("CONNECTIVITY is expected after OFFSETS"));
        }
        let kind = self.scalar()?;
        self.array(kind, 1, numbers).map(drop)
    }

    fn coordinates(&mut self) -> Result<Coordinates, ImportError> {
        let tuples = self.number("a number of coordinates")?;
        let kind = self.scalar()?;
        let array = self.array(kind, 1, tuples)?;
        let layout = Layout { dims: [tuples, 1, 1], scalar: kind, endian: Endian::Big };
        let values = layout.numbers(self.file, &self.samples(&array)?)?;
        Ok(Coordinates { values, rounding: kind.rounding() })
    }

    /// The first array of one component, and whether its values belong to cells.
    fn scalars(&mut self) -> Result<Option<(Array, bool)>, ImportError> {
        let mut of_cells = None;
        let mut on_cells = false;
        let mut tuples = 0;
        while let Some(word) = self.keyword() {
            let found = match word.as_str() {
                "POINT_DATA" | "CELL_DATA" => {
                    on_cells = word == "CELL_DATA";
                    tuples = self.number("a number of values")?;
                    None
                }
                "SCALARS" => self.scalar_array(tuples)?,
                "COLOR_SCALARS" => self.colors(tuples)?,
                "FIELD" => self.field()?,
                _ => {
                    self.pass_over(&word, tuples)?;
                    None
                }
            };
            match found {
                Some(array) if !on_cells => return Ok(Some((array, false))),
                Some(array) => _ = of_cells.get_or_insert((array, true)),
                None => {}
            }
        }
        Ok(of_cells)
    }

    /// `SCALARS name type [components] LOOKUP_TABLE name`, its word being taken.
    fn scalar_array(&mut self, tuples: usize) -> Result<Option<Array>, ImportError> {
        self.word("a name")?;
        let kind = self.scalar()?;
        let mut word = self.keyword().unwrap_or_default();
        let mut components = 1;
        if word != "LOOKUP_TABLE" {
            components = word.parse().unwrap_or(0);
            word = self.keyword().unwrap_or_default();
        }
        if components == 0 || word != "LOOKUP_TABLE" {
            let problem =
                "SCALARS must have a name, a type, a number of components or none, and a LOOKUP_TABLE";
            return Err(self.malformed(problem));
        }
        self.word("the name of a lookup table")?;
        let array = self.array(kind, components, tuples)?;
        Ok(Some(array).filter(|array| array.components == 1))
    }

    /// `COLOR_SCALARS name components`, its word being taken: bytes in binary files, and in text shares of 255. VTK writes so whatever scalars are
    /// bytes, those of a volume, too.
    fn colors(&mut self, tuples: usize) -> Result<Option<Array>, ImportError> {
        self.word("a name")?;
        let components = self.number("a number of components")?;
        let array = self.array(Scalar::U8, components, tuples)?;
        Ok(Some(Array { in_shares: self.is_text, ..array }).filter(|array| array.components == 1))
    }

    /// `FIELD name arrays`, its word being taken: the first array of one component.
    fn field(&mut self) -> Result<Option<Array>, ImportError> {
        self.word("a name")?;
        let count: usize = self.number("a number of arrays")?;
        let mut found = None;
        for _ in 0..count {
            let name = self.word("the name of an array")?;
            if name.eq_ignore_ascii_case("METADATA") {
                self.metadata();
                self.word("the name of an array")?;
            }
            let (components, tuples) = (self.number("components")?, self.number("tuples")?);
            let kind = self.scalar()?;
            let array = self.array(kind, components, tuples)?;
            if array.components == 1 && found.is_none() {
                found = Some(array);
            }
        }
        Ok(found)
    }

    /// An array that no volume is made of, its word being taken.
    fn pass_over(&mut self, word: &str, tuples: usize) -> Result<(), ImportError> {
        let fixed = match word {
            "VECTORS" | "NORMALS" => 3,
            "TENSORS" => 9,
            "TENSORS6" => 6,
            "GLOBAL_IDS" | "PEDIGREE_IDS" => 1,
            "TEXTURE_COORDINATES" => {
                self.word("a name")?;
                let components = self.number("a number of components")?;
                let kind = self.scalar()?;
                return self.array(kind, components, tuples).map(drop);
            }
            // As those of `COLOR_SCALARS`.
            "LOOKUP_TABLE" => {
                self.word("a name")?;
                let count = self.number("a number of values")?;
                return self.array(Scalar::U8, 4, count).map(drop);
            }
            "FIELD" => return self.field().map(drop),
            "METADATA" => {
                self.metadata();
                return Ok(());
            }
            _ => return Err(self.malformed(format!("{word:?} is no word of a VTK file that is known"))),
        };
        self.word("a name")?;
        let kind = self.scalar()?;
        self.array(kind, fixed, tuples).map(drop)
    }

    /// Lines up to an empty one.
    fn metadata(&mut self) {
        self.line();
        while self.at < self.file.bytes.len() && !self.line().is_empty() {}
    }

    /// The array whose numbers come next; the end of the line before binary ones is passed.
    fn array(&mut self, scalar: Scalar, components: usize, tuples: usize) -> Result<Array, ImportError> {
        let count = components.checked_mul(tuples);
        let missing = |reader: &Self| {
            reader
                .malformed(format!("{tuples} times {components} numbers are expected; the file ends before"))
        };
        let Some(count) = count.filter(|&count| count <= self.rest().len()) else {
            return Err(missing(self));
        };
        let start = if self.is_text {
            let start = self.at;
            for _ in 0..count {
                if self.next_word().is_none() {
                    return Err(missing(self));
                }
            }
            start
        } else {
            self.line();
            let start = self.at;
            if count > self.rest().len() / scalar.size() {
                return Err(missing(self));
            }
            self.at += count * scalar.size();
            start
        };
        Ok(Array { scalar, components, tuples, numbers: start..self.at, in_shares: false })
    }

    fn scalar(&mut self) -> Result<Scalar, ImportError> {
        let kind = self.word("a number type")?;
        Ok(match kind.to_ascii_lowercase().as_str() {
            "char" | "signed_char" => Scalar::I8,
            "unsigned_char" => Scalar::U8,
            "short" => Scalar::I16,
            "unsigned_short" => Scalar::U16,
            "int" | "vtkidtype" => Scalar::I32,
            "unsigned_int" => Scalar::U32,
            "long" | "vtktypeint64" => Scalar::I64,
            "unsigned_long" | "vtktypeuint64" => Scalar::U64,
            "float" => Scalar::F32,
            "double" => Scalar::F64,
            _ => {
                let feature = format!("type {kind:?} is no number type that is read");
                return Err(self.unsupported(feature));
            }
        })
    }

    /// An array's numbers.
    fn samples(&self, array: &Array) -> Result<Samples<'a>, ImportError> {
        let bytes = &self.file.bytes[array.numbers.clone()];
        if !self.is_text {
            return Ok(Samples::Binary(Cow::Borrowed(bytes)));
        }
        if !array.in_shares {
            return Ok(Samples::Text(Cow::Borrowed(bytes)));
        }
        let words = bytes.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        let byte = |word: &[u8]| {
            let share: Option<f64> = str::from_utf8(word).ok().and_then(|word| word.parse().ok());
            let share = share.filter(|share| (0.0..=1.0).contains(share));
            share.map(|share| (255.0 * share).round() as u8).ok_or_else(|| {
                let word = quoted(&String::from_utf8_lossy(&word[..word.len().min(LONGEST)]));
                let problem = format!("{word} in COLOR_SCALARS; they are from 0 to 1");
                self.file.malformed(self.place(array.numbers.start), problem)
            })
        };
        Ok(Samples::Binary(Cow::Owned(words.map(byte).collect::<Result<Vec<u8>, _>>()?)))
    }
}
