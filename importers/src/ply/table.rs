//! Rows of one length, read block by block as they are wanted: a file may be larger than what is made of it.

use super::header::{Element, Encoding, Header};
use crate::file::{File, quoted};
use crate::scalar::{FromF64, Scalar};
use crate::source::Source;
use crate::{Endian, ImportError, Place};
use std::ops::Range;

/// Bytes that are read at a time: a few of them fit a core's cache.
const BLOCK: usize = 1 << 18;

/// A number of a row that is wanted.
struct Cell {
    /// Its byte in the row.
    offset: usize,
    scalar: Scalar,
    /// Its place in a record.
    place: usize,
}

/// The rows of an element of a binary file.
pub(crate) struct Table<'a> {
    source: &'a Source,
    endian: Endian,
    /// The first row's first byte.
    start: usize,
    row_size: usize,
    cells: Vec<Cell>,
    /// All wanted numbers are little-endian floats.
    plain: bool,
}

impl<'a> Table<'a> {
    /// The rows of `element`, whose properties have these places in a record, or none; `None` where only reading
    /// tells where a row begins. All rows are there.
    pub(crate) fn find(
        source: &'a Source,
        header: &Header,
        element: &Element,
        places: &[Option<usize>],
    ) -> Result<Option<Self>, ImportError> {
        let Encoding::Binary(endian) = header.encoding else { return Ok(None) };
        let before = header.elements.iter().take_while(|before| before.name != element.name);
        let Some(rows_before) = before
            .map(|element| Some((element.row_size()?, element)))
            .collect::<Option<Vec<(usize, &Element)>>>()
        else {
            return Ok(None);
        };
        let Some(row_size) = element.row_size() else { return Ok(None) };
        let mut start = header.body.0;
        for (size, element) in rows_before {
            start = end_of(&source.head, source.size, (start, size), element)?;
        }
        end_of(&source.head, source.size, (start, row_size), element)?;
        let (mut cells, mut offset) = (Vec::new(), 0);
        for (property, place) in element.properties.iter().zip(places) {
            let super::header::Kind::Scalar(scalar) = property.kind else { return Ok(None) };
            cells.extend(place.map(|place| Cell { offset, scalar, place }));
            offset += scalar.size();
        }
        let plain = endian == Endian::Little && cells.iter().all(|cell| cell.scalar == Scalar::F32);
        Ok(Some(Self { source, endian, start, row_size, cells, plain }))
    }

    /// Rows that are read at a time.
    pub(crate) fn block(&self) -> usize {
        (BLOCK / self.row_size.max(1)).max(1)
    }

    /// Calls `each` with the record of each row, in order. A record's numbers that no property has stay as they are.
    pub(crate) fn records<T: FromF64>(
        &self,
        rows: Range<usize>,
        record: &mut [T],
        mut each: impl FnMut(&[T]),
    ) -> Result<(), ImportError> {
        let bytes = self.source.bytes(self.start + rows.start * self.row_size, rows.len() * self.row_size)?;
        for row in bytes.chunks_exact(self.row_size) {
            for cell in &self.cells {
                let number = &row[cell.offset..];
                match number.first_chunk().filter(|_| self.plain) {
                    Some(float) => record[cell.place] = T::from_f32(f32::from_le_bytes(*float)),
                    None => {
                        // The row was cut to size.
                        if let Some(value) = cell.scalar.first(number, self.endian) {
                            record[cell.place] = T::from_f64(value);
                        }
                    }
                }
            }
            each(record);
        }
        Ok(())
    }
}

/// Where rows end that begin at a byte and have a size, if they are there.
fn end_of(
    file: &File,
    file_size: usize,
    (start, row_size): (usize, usize),
    element: &Element,
) -> Result<usize, ImportError> {
    let end = element.rows.checked_mul(row_size).and_then(|size| start.checked_add(size));
    end.filter(|end| *end <= file_size)
        .ok_or_else(|| too_short(file, (start, file_size.saturating_sub(start)), element, row_size))
}

/// That `left` bytes from byte `at` on cannot hold the rows.
pub(super) fn too_short(
    file: &File,
    (at, left): (usize, usize),
    element: &Element,
    row_size: usize,
) -> ImportError {
    let problem = format!(
        "{} rows of element {} need at least {row_size} bytes each, but only {left} bytes are left",
        element.rows,
        quoted(&element.name)
    );
    file.malformed(Place::Byte(at), problem)
}
