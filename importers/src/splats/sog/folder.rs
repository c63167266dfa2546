//! Where the images of a scene are: beside `meta.json` or with it in a zip file.

use crate::file::File;
use crate::{ImportError, Place};
use std::io::{Cursor, Read};
use zip::ZipArchive;

pub(super) enum Folder<'a> {
    Beside(&'a File),
    Zip(&'a File, ZipArchive<Cursor<&'a [u8]>>),
}

impl<'a> Folder<'a> {
    pub(super) fn zip(file: &'a File) -> Result<Self, ImportError> {
        let archive = ZipArchive::new(Cursor::new(&file.bytes[..]));
        let wrong = |error| file.malformed(Place::Whole, format!("not a zip file to read: {error}"));
        Ok(Self::Zip(file, archive.map_err(wrong)?))
    }

    /// The bytes of the file `name`; what a zip file unpacks to is taken from the budget.
    pub(super) fn read(&mut self, name: &str, budget: &mut u64) -> Result<Vec<u8>, ImportError> {
        match self {
            Self::Beside(file) => file.read_named(Place::Part("files".into()), name).map(|named| named.bytes),
            Self::Zip(file, archive) => unzip(archive, name, budget)
                .map_err(|problem| file.malformed(Place::Part(name.to_owned()), problem)),
        }
    }
}

fn unzip(archive: &mut ZipArchive<Cursor<&[u8]>>, name: &str, budget: &mut u64) -> Result<Vec<u8>, String> {
    let entry = archive.by_name(name).map_err(|error| error.to_string())?;
    let size = entry.size();
    let Some(left) = budget.checked_sub(size) else {
        return Err(format!("unpacks to {size} bytes; {budget} are left of the limit that is set"));
    };
    let mut bytes = Vec::new();
    entry.take(size.saturating_add(1)).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 != size {
        return Err(format!("unpacks to {} bytes or more; {size} are expected", bytes.len()));
    }
    *budget = left;
    Ok(bytes)
}
