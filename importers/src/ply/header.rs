//! What a PLY file says that it holds.
//!
//! Source: Turk, *The PLY Polygon File Format*, 1994.

use crate::Endian;
use crate::file::{File, quoted};
use crate::scalar::Scalar;
use crate::{ImportError, Place};

/// How values are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    Ascii,
    Binary(Endian),
}

/// What a row has under a property's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

/// A column.
#[derive(Clone, Debug)]
pub(crate) struct Property {
    pub(crate) name: String,
    pub(crate) kind: Kind,
}

/// A table.
#[derive(Clone, Debug)]
pub(crate) struct Element {
    pub(crate) name: String,
    pub(crate) rows: usize,
    pub(crate) properties: Vec<Property>,
}

/// A file's header.
#[derive(Clone, Debug)]
pub(crate) struct Header {
    pub(crate) encoding: Encoding,
    pub(crate) elements: Vec<Element>,
    /// Comments, each with its line.
    pub(crate) comments: Vec<(usize, String)>,
    /// Where the rows begin: byte and line.
    pub(crate) body: (usize, usize),
}

/// Properties that an element may have: names are looked up one by one.
const MOST_PROPERTIES: usize = 4096;

impl Element {
    /// The property of this name and what it is.
    pub(crate) fn kind(&self, name: &str) -> Option<Kind> {
        self.properties.iter().find(|property| property.name == name).map(|property| property.kind)
    }

    /// Bytes of a binary row; `None` where lists make them differ.
    pub(crate) fn row_size(&self) -> Option<usize> {
        self.properties.iter().try_fold(0, |size, property| match property.kind {
            Kind::Scalar(scalar) => Some(size + scalar.size()),
            Kind::List { .. } => None,
        })
    }
}

impl Header {
    /// The first element of this name.
    pub(crate) fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|element| element.name == name)
    }

    /// Where the last row ends, where that can be told without reading rows: in binary files without lists.
    pub(crate) fn end(&self) -> Option<usize> {
        if self.encoding == Encoding::Ascii {
            return None;
        }
        let mut with_rows = self.elements.iter().filter(|element| element.rows > 0);
        with_rows.try_fold(self.body.0, |start, element| {
            start.checked_add(element.rows.checked_mul(element.row_size()?)?)
        })
    }

    pub(crate) fn parse(file: &File) -> Result<Self, ImportError> {
        let mut encoding = None;
        let mut header =
            Self { encoding: Encoding::Ascii, elements: Vec::new(), comments: Vec::new(), body: (0, 0) };
        let mut at = 0;
        for (index, line) in lines(&file.bytes).enumerate() {
            at += line.len();
            let text = String::from_utf8_lossy(line.trim_ascii());
            let words: Vec<&str> = text.split_whitespace().collect();
            let malformed = |problem: &str| {
                file.malformed(Place::Line(index + 1), format!("{problem}: {}", quoted(&text)))
            };
            match words.as_slice() {
                ["ply"] if index == 0 => {}
                _ if index == 0 => return Err(malformed("a PLY begins with a line \"ply\"")),
                ["end_header"] => {
                    header.body = (at, index + 2);
                    let missing = || file.malformed(Place::Whole, "the header has no format line");
                    header.encoding = encoding.ok_or_else(missing)?;
                    return Ok(header);
                }
                ["format", word, "1.0"] => {
                    encoding = Some(match *word {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::Binary(Endian::Little),
                        "binary_big_endian" => Encoding::Binary(Endian::Big),
                        _ => return Err(malformed("not an encoding of PLY")),
                    });
                }
                ["comment", ..] => {
                    header.comments.push((index + 1, text["comment".len()..].trim().to_owned()))
                }
                ["obj_info", ..] | [] => {}
                ["element", name, rows] => {
                    let rows = rows.parse().map_err(|_| malformed("not a number of rows"))?;
                    header.elements.push(Element { name: (*name).to_owned(), rows, properties: Vec::new() });
                }
                ["property", rest @ .., name] => {
                    let kind = kind(rest).ok_or_else(|| malformed("not a property of PLY"))?;
                    let Some(element) = header.elements.last_mut() else {
                        return Err(malformed("a property before any element"));
                    };
                    if element.properties.len() == MOST_PROPERTIES {
                        return Err(malformed("an element of more than 4096 properties"));
                    }
                    if element.kind(name).is_some() {
                        return Err(malformed("a second property of this name"));
                    }
                    element.properties.push(Property { name: (*name).to_owned(), kind });
                }
                _ => return Err(malformed("not a line of a PLY header")),
            }
        }
        let problem = format!("the header has no end_header line in the first {} bytes", file.bytes.len());
        Err(file.malformed(Place::Whole, problem))
    }
}

/// Lines with what ends them: a line feed, a carriage return or both.
fn lines(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = bytes;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let end = match rest.iter().position(|&b| b == b'\n' || b == b'\r') {
            Some(at) if rest[at..].starts_with(b"\r\n") => at + 2,
            Some(at) => at + 1,
            None => rest.len(),
        };
        let (line, after) = rest.split_at(end);
        rest = after;
        Some(line)
    })
}

fn kind(words: &[&str]) -> Option<Kind> {
    match words {
        [word] => scalar(word).map(Kind::Scalar),
        ["list", count, item] => Some(Kind::List { count: scalar(count)?, item: scalar(item)? }),
        _ => None,
    }
}

fn scalar(word: &str) -> Option<Scalar> {
    Some(match word {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return None,
    })
}
