//! Buffers, buffer views and URIs.

use super::budget::Budget;
use super::meshopt::{self, Packed};
use crate::file::File;
use crate::{ImportError, Place};
use ::gltf::json::{Index, Root, buffer};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::cell::OnceCell;

/// The bytes of a file's buffers, each read when it is first needed.
pub(crate) struct Buffers<'a> {
    file: &'a File,
    root: &'a Root,
    /// The binary chunk of a GLB.
    binary: Option<&'a [u8]>,
    budget: &'a Budget,
    read: Vec<OnceCell<Vec<u8>>>,
    /// The bytes of those views that are compressed.
    unpacked: Vec<OnceCell<Vec<u8>>>,
}

impl<'a> Buffers<'a> {
    pub(crate) fn new(file: &'a File, root: &'a Root, binary: Option<&'a [u8]>, budget: &'a Budget) -> Self {
        let read = root.buffers.iter().map(|_| OnceCell::new()).collect();
        let unpacked = root.buffer_views.iter().map(|_| OnceCell::new()).collect();
        Self { file, root, binary, budget, read, unpacked }
    }

    /// Memory that is left for what comes of them.
    pub(crate) fn budget(&self) -> &Budget {
        self.budget
    }

    /// The bytes of a view, and the distance of its elements if it gives one.
    pub(crate) fn view(&self, index: Index<buffer::View>) -> Result<(&[u8], Option<usize>), ImportError> {
        let place = || Place::Part(format!("bufferView {}", index.value()));
        let missing = || self.file.malformed(place(), "is named, but not there");
        let view = self.root.get(index).ok_or_else(missing)?;
        let stride = view.byte_stride.map(|stride| stride.0).filter(|&stride| stride > 0);
        let wrong = |problem: String| self.file.malformed(place(), problem);
        let packed = Packed::of(view).map_err(wrong)?;
        // Elements are as far apart as they were packed, whether or not the view says so too.
        let stride = packed.as_ref().map(|packed| packed.byte_stride).or(stride);
        // A program that can't unpack takes what lies there for it, if it does.
        if let Some(packed) = packed.filter(|_| meshopt::AVAILABLE || !self.is_there(view.buffer)) {
            if !meshopt::AVAILABLE {
                return Err(self
                    .file
                    .unsupported(place(), format!("is compressed; {}", meshopt::UNAVAILABLE)));
            }
            let cell = self.unpacked.get(index.value()).ok_or_else(missing)?;
            if let Some(bytes) = cell.get() {
                return Ok((bytes, stride));
            }
            let bytes = self.part((packed.buffer, packed.byte_offset, packed.byte_length), place)?;
            packed.check_ratio(bytes).map_err(wrong)?;
            // Once as elements and once as bytes.
            self.budget.take(self.file, place, (2 * packed.count, packed.byte_stride))?;
            let unpacked = packed.unpack(bytes).map_err(wrong)?;
            return Ok((cell.get_or_init(|| unpacked), stride));
        }
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        Ok((self.part((view.buffer, start, view.byte_length.0), place)?, stride))
    }

    /// A part of a buffer: its first byte and its length.
    fn part(
        &self,
        (buffer, start, length): (Index<buffer::Buffer>, u64, u64),
        place: impl FnOnce() -> Place,
    ) -> Result<&[u8], ImportError> {
        let bytes = self.buffer(buffer)?;
        slice(bytes, start, length).ok_or_else(|| {
            let problem = format!(
                "{length} bytes from byte {start} go beyond buffer {} of {} bytes",
                buffer.value(),
                bytes.len()
            );
            self.file.malformed(place(), problem)
        })
    }

    /// Whether a buffer has bytes, which fallbacks of compressed ones may lack.
    fn is_there(&self, index: Index<buffer::Buffer>) -> bool {
        let has_uri = self.root.get(index).is_some_and(|buffer| buffer.uri.is_some());
        has_uri || (index.value() == 0 && self.binary.is_some())
    }

    fn buffer(&self, index: Index<buffer::Buffer>) -> Result<&[u8], ImportError> {
        let place = || Place::Part(format!("buffer {}", index.value()));
        let missing = || self.file.malformed(place(), "is named, but not there");
        let buffer = self.root.get(index).ok_or_else(missing)?;
        let cell = self.read.get(index.value()).ok_or_else(missing)?;
        let bytes = match (&buffer.uri, self.binary) {
            (Some(uri), _) => match cell.get() {
                Some(bytes) => bytes,
                None => {
                    let bytes = resource(self.file, place(), uri)?;
                    // Many buffers may name one file.
                    self.budget.take(self.file, place, (bytes.len(), 1))?;
                    cell.get_or_init(|| bytes)
                }
            },
            (None, Some(binary)) if index.value() == 0 => binary,
            (None, _) => {
                let problem =
                    "has neither a uri nor a binary chunk (it may be a fallback of a compressed mesh)";
                return Err(self.file.malformed(place(), problem));
            }
        };
        slice(bytes, 0, buffer.byte_length.0).ok_or_else(|| {
            let problem =
                format!("byteLength is {}, but there are {} bytes", buffer.byte_length.0, bytes.len());
            self.file.malformed(place(), problem)
        })
    }
}

/// `length` bytes from `start`, if they are there.
pub(crate) fn slice(bytes: &[u8], start: u64, length: u64) -> Option<&[u8]> {
    let start = usize::try_from(start).ok()?;
    let end = start.checked_add(usize::try_from(length).ok()?)?;
    bytes.get(start..end)
}

/// What a URI names: base64 data within it, or a file beside this one.
pub(crate) fn resource(file: &File, place: Place, uri: &str) -> Result<Vec<u8>, ImportError> {
    if let Some(data) = uri.strip_prefix("data:") {
        let Some((_, text)) = data.split_once(";base64,") else {
            return Err(file.unsupported(place, "a data URI without base64 is not supported"));
        };
        return STANDARD.decode(text).map_err(|error| file.malformed(place, format!("data URI: {error}")));
    }
    if let Some((scheme, _)) = uri.split_once("://") {
        return Err(
            file.unsupported(place, format!("a URI of scheme {scheme:?}; files beside this one are read"))
        );
    }
    Ok(file.read_named(place, &percent_decoded(uri))?.bytes)
}

fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let code = after.get(..2).filter(|_| first == b'%').and_then(|code| str::from_utf8(code).ok());
        match code.and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &after[2..];
            }
            None => {
                bytes.push(first);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
