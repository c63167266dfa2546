//! Buffers, buffer views and URIs.

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
    read: Vec<OnceCell<Vec<u8>>>,
}

impl<'a> Buffers<'a> {
    pub(crate) fn new(file: &'a File, root: &'a Root, binary: Option<&'a [u8]>) -> Self {
        let read = root.buffers.iter().map(|_| OnceCell::new()).collect();
        Self { file, root, binary, read }
    }

    /// The bytes of a view, and the distance of its elements if it gives one.
    pub(crate) fn view(&self, index: Index<buffer::View>) -> Result<(&[u8], Option<usize>), ImportError> {
        let place = || Place::Part(format!("bufferView {}", index.value()));
        let view =
            self.root.get(index).ok_or_else(|| self.file.malformed(place(), "is named, but not there"))?;
        let bytes = self.buffer(view.buffer)?;
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        match slice(bytes, start, view.byte_length.0) {
            Some(bytes) => Ok((bytes, view.byte_stride.map(|stride| stride.0).filter(|&stride| stride > 0))),
            None => {
                let problem = format!(
                    "{} bytes from byte {start} go beyond buffer {} of {} bytes",
                    view.byte_length.0,
                    view.buffer.value(),
                    bytes.len()
                );
                Err(self.file.malformed(place(), problem))
            }
        }
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
