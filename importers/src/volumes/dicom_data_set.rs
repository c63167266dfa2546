//! The elements of a DICOM file down to its pixel data.
//!
//! Source: NEMA PS3.10 (file format) and PS3.5 (data structures and encoding), 2024. Only elements of the top level are kept, of
//! the groups 0008, 0018, 0020 and 0028; sequences are passed over, whatever is in them.

use crate::Endian;
use crate::file::File;
use crate::inflate;
use crate::scalar::numbers;
use crate::{ImportError, Place};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Where a file begins after its preamble.
const PREAMBLE: usize = 128;
const UNDEFINED: u32 = u32::MAX;

pub(super) const PIXEL_DATA: u32 = 0x7fe0_0010;
const TRANSFER_SYNTAX: u32 = 0x0002_0010;
const ITEM: u32 = 0xfffe_e000;
const ITEM_END: u32 = 0xfffe_e00d;
const SEQUENCE_END: u32 = 0xfffe_e0dd;

/// The groups whose elements are kept.
const GROUPS: [u32; 4] = [0x0008, 0x0018, 0x0020, 0x0028];

/// How pixels are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    Native,
    Rle,
    /// Baseline JPEG.
    Jpeg,
}

/// A file's elements by tag, group above.
pub(super) struct DataSet {
    elements: BTreeMap<u32, Vec<u8>>,
    /// The one part of native pixel data, or the fragments of an encapsulated one; none without pixel data.
    pub(super) pixels: Vec<Vec<u8>>,
    pub(super) packing: Packing,
    pub(super) endian: Endian,
}

/// Whether bytes of a file's beginning are those of DICOM.
pub(crate) fn is_dicom(bytes: &[u8]) -> bool {
    bytes.get(PREAMBLE..PREAMBLE + 4) == Some(b"DICM")
}

/// How elements are written.
#[derive(Clone, Copy)]
struct Syntax {
    explicit: bool,
    endian: Endian,
}

/// Takes elements from the front.
struct Reader<'a> {
    file: &'a File,
    bytes: &'a [u8],
    at: usize,
    /// Where `bytes` begin in the file; `None` where they were unpacked.
    start: Option<usize>,
    syntax: Syntax,
}

struct Element {
    tag: u32,
    length: u32,
    /// Whether its content is written implicitly, whatever the file is.
    unknown: bool,
}

impl<'a> Reader<'a> {
    fn malformed(&self, problem: impl Into<String>) -> ImportError {
        let place = match self.start {
            Some(start) => Place::Byte(start + self.at),
            None => Place::Part(format!("byte {} of the deflated data set", self.at)),
        };
        self.file.malformed(place, problem)
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], ImportError> {
        let Some(found) = self.at.checked_add(count).and_then(|end| self.bytes.get(self.at..end)) else {
            let left = self.bytes.len() - self.at;
            return Err(self.malformed(format!("{count} bytes are to be here; the file has {left} more")));
        };
        self.at += count;
        Ok(found)
    }

    fn short(&mut self) -> Result<u16, ImportError> {
        let bytes = self.take(2)?;
        Ok(numbers(bytes, self.syntax.endian, u16::from_le_bytes).next().unwrap_or(0))
    }

    fn long(&mut self) -> Result<u32, ImportError> {
        let bytes = self.take(4)?;
        Ok(numbers(bytes, self.syntax.endian, u32::from_le_bytes).next().unwrap_or(0))
    }

    fn tag(&mut self) -> Result<u32, ImportError> {
        Ok(u32::from(self.short()?) << 16 | u32::from(self.short()?))
    }

    /// An element's head; its value comes next.
    fn element(&mut self) -> Result<Element, ImportError> {
        let tag = self.tag()?;
        // Items have neither type nor form.
        if !self.syntax.explicit || tag >> 16 == 0xfffe {
            return Ok(Element { tag, length: self.long()?, unknown: false });
        }
        let kind = self.take(2)?;
        let length = match kind {
            b"OB" | b"OD" | b"OF" | b"OL" | b"OV" | b"OW" | b"SQ" | b"SV" | b"UC" | b"UN" | b"UR" | b"UT"
            | b"UV" => {
                self.take(2)?;
                self.long()?
            }
            [b'A'..=b'Z', b'A'..=b'Z'] => u32::from(self.short()?),
            _ => {
                self.at -= 2;
                return Err(self.malformed("the type of an element is two capital letters"));
            }
        };
        Ok(Element { tag, length, unknown: kind == b"UN" })
    }

    /// Passes over what a sequence of undefined length holds, its end too.
    fn skip_sequence(&mut self, unknown: bool) -> Result<(), ImportError> {
        let outer = self.syntax;
        if unknown {
            // PS3.5, 6.2.2, note 2.
            self.syntax = Syntax { explicit: false, endian: Endian::Little };
        }
        let mut open = 1_usize;
        while open > 0 {
            let element = self.element()?;
            match (element.tag, element.length) {
                (ITEM_END | SEQUENCE_END, _) => open -= 1,
                (_, UNDEFINED) if element.unknown => {
                    return Err(self.malformed("an unknown element of undefined length within a sequence"));
                }
                (_, UNDEFINED) => open += 1,
                (_, length) => drop(self.take(length as usize)?),
            }
        }
        self.syntax = outer;
        Ok(())
    }

    /// The fragments of encapsulated pixel data, without the table of offsets before them.
    fn fragments(&mut self) -> Result<Vec<Vec<u8>>, ImportError> {
        let mut fragments = Vec::new();
        loop {
            let item = self.element()?;
            match (item.tag, item.length) {
                (SEQUENCE_END, _) => break,
                (ITEM, length) if length != UNDEFINED => fragments.push(self.take(length as usize)?),
                _ => return Err(self.malformed("fragments of pixel data are items of known length")),
            }
        }
        if fragments.is_empty() {
            return Err(self.malformed("encapsulated pixel data begin with a table of offsets"));
        }
        Ok(fragments[1..].iter().map(|fragment| fragment.to_vec()).collect())
    }
}

impl DataSet {
    /// Reads a file; what is deflated unpacks to at most `max_memory`.
    pub(super) fn parse(file: &File, max_memory: u64) -> Result<Self, ImportError> {
        if !is_dicom(&file.bytes) {
            let feature = "DICM is not there, which files of DICOM begin with after 128 bytes; data sets without it are not read";
            return Err(file.unsupported(Place::Byte(PREAMBLE), feature));
        }
        let explicit = Syntax { explicit: true, endian: Endian::Little };
        let body = PREAMBLE + 4;
        let bytes = file.bytes.get(body..).unwrap_or_default();
        let mut meta = Reader { file, bytes, at: 0, start: Some(body), syntax: explicit };
        let mut uid = None;
        // Group 2, always explicit and little-endian.
        while meta.bytes.get(meta.at..meta.at + 2) == Some(&[2, 0]) {
            let element = meta.element()?;
            let value = meta.take(element.length as usize)?;
            if element.tag == TRANSFER_SYNTAX {
                uid = Some(text(value));
            }
        }
        let uid =
            uid.ok_or_else(|| meta.malformed("the file's head names no transfer syntax (0002,0010)"))?;
        let (syntax, deflated, packing) = match uid.as_str() {
            "1.2.840.10008.1.2" => (Syntax { explicit: false, ..explicit }, false, Packing::Native),
            "1.2.840.10008.1.2.1" => (explicit, false, Packing::Native),
            "1.2.840.10008.1.2.1.99" => (explicit, true, Packing::Native),
            "1.2.840.10008.1.2.2" => (Syntax { endian: Endian::Big, ..explicit }, false, Packing::Native),
            "1.2.840.10008.1.2.4.50" => (explicit, false, Packing::Jpeg),
            "1.2.840.10008.1.2.5" => (explicit, false, Packing::Rle),
            _ => {
                let feature = format!(
                    "transfer syntax {uid} ({}); uncompressed ones, deflated, RLE and baseline JPEG are read",
                    name(&uid)
                );
                return Err(file.unsupported(Place::Whole, feature));
            }
        };
        let at = meta.at;
        let rest = if deflated {
            let unpacked = inflate::deflated_all(&bytes[at..], max_memory);
            Cow::Owned(unpacked.map_err(|problem| file.malformed(Place::Byte(body + at), problem))?)
        } else {
            Cow::Borrowed(&bytes[at..])
        };
        let start = (!deflated).then_some(body + at);
        let mut reader = Reader { file, bytes: &rest, at: 0, start, syntax };
        let mut set = Self { elements: BTreeMap::new(), pixels: Vec::new(), packing, endian: syntax.endian };
        while reader.at < reader.bytes.len() {
            let element = reader.element()?;
            match (element.tag, element.length) {
                (PIXEL_DATA, UNDEFINED) if packing == Packing::Native => {
                    return Err(reader.malformed("pixel data are encapsulated in a file of native ones"));
                }
                (PIXEL_DATA, UNDEFINED) => set.pixels = reader.fragments()?,
                (PIXEL_DATA, _) if packing != Packing::Native => {
                    return Err(reader.malformed("pixel data of this transfer syntax are encapsulated"));
                }
                (PIXEL_DATA, length) => set.pixels = vec![reader.take(length as usize)?.to_vec()],
                (_, UNDEFINED) => reader.skip_sequence(element.unknown)?,
                (tag, length) => {
                    let value = reader.take(length as usize)?;
                    // What is asked for is short, and of few groups: a file may have millions of elements.
                    if value.len() <= 1024 && GROUPS.contains(&(tag >> 16)) {
                        set.elements.insert(tag, value.to_vec());
                    }
                }
            }
            if element.tag == PIXEL_DATA {
                break;
            }
        }
        Ok(set)
    }

    /// The text of an element; `None` where there is none, or only white space.
    pub(super) fn text(&self, tag: u32) -> Option<String> {
        self.elements.get(&tag).map(|value| text(value)).filter(|text| !text.is_empty())
    }

    /// An element of 16-bit numbers' first.
    pub(super) fn short(&self, tag: u32) -> Option<u16> {
        numbers(self.elements.get(&tag)?, self.endian, u16::from_le_bytes).next()
    }

    /// `N` numbers written as text.
    pub(super) fn decimals<const N: usize>(&self, tag: u32) -> Option<[f64; N]> {
        let text = self.text(tag)?;
        let numbers: Option<Vec<f64>> = text.split('\\').map(|number| number.trim().parse().ok()).collect();
        numbers?.try_into().ok().filter(|numbers: &[f64; N]| numbers.iter().all(|number| number.is_finite()))
    }

    /// Whether there is such an element of the top level, of any value.
    pub(super) fn has(&self, tag: u32) -> bool {
        self.elements.contains_key(&tag)
    }
}

/// Text, padded with zeros or spaces.
fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).trim_matches(|c: char| c == '\0' || c.is_whitespace()).to_owned()
}

/// What a transfer syntax that is not read is called.
fn name(uid: &str) -> &'static str {
    match uid.strip_prefix("1.2.840.10008.1.2.4.").and_then(|last| last.parse().ok()) {
        Some(51) => "JPEG extended, 12 bits",
        Some(57 | 70) => "JPEG lossless",
        Some(80 | 81) => "JPEG-LS",
        Some(90..=93) => "JPEG 2000",
        Some(100..=108) => "video",
        Some(110..=112) => "JPEG XL",
        Some(201..=203) => "high-throughput JPEG 2000",
        _ => "which is unknown",
    }
}
