//! The rows of a PLY file, gathered into columns by name.

use super::behind_rows;
use super::header::{Element, Encoding, Header, Kind};
use super::table::too_short;
use crate::Endian;
use crate::file::{File, quoted};
use crate::scalar::{FromF64, Scalar};
use crate::{ImportError, Note, Place};

/// The values of one property in all rows of its element.
#[derive(Clone, Debug)]
pub(crate) struct Column<T> {
    pub(crate) values: Vec<T>,
    /// For a list property, where each row's values end; empty for a scalar one, which has a value a row.
    ends: Vec<usize>,
}

impl<T> Column<T> {
    /// The values of each row.
    pub(crate) fn rows(&self) -> impl Iterator<Item = &[T]> {
        let mut start = 0;
        self.ends.iter().map(move |&end| {
            let row = &self.values[start..end];
            start = end;
            row
        })
    }
}

impl Column<f64> {
    /// In single precision.
    pub(crate) fn rounded(self) -> Column<f32> {
        Column { values: self.values.into_iter().map(|value| value as f32).collect(), ends: self.ends }
    }
}

/// Reads elements in the order of the header.
#[derive(Clone)]
pub(crate) struct Body<'a> {
    file: &'a File,
    encoding: Encoding,
    at: usize,
    line: usize,
    /// The end of the present row in text.
    row_end: usize,
}

impl<'a> Body<'a> {
    /// At the rows of `wanted`, behind those before it.
    pub(crate) fn at(file: &'a File, header: &Header, wanted: &Element) -> Result<Self, ImportError> {
        let mut body = Self::new(file, header);
        for element in header.elements.iter().take_while(|element| element.name != wanted.name) {
            drop(body.gather::<f32>(element, &[])?);
        }
        body.check_size(wanted)?;
        Ok(body)
    }

    pub(crate) fn new(file: &'a File, header: &Header) -> Self {
        let (at, line) = header.body;
        Self { file, encoding: header.encoding, at, line: line.saturating_sub(1), row_end: at }
    }

    /// Reads the next element's rows and keeps the columns of these names; `None` for names it hasn't.
    pub(crate) fn gather<T: FromF64>(
        &mut self,
        element: &Element,
        names: &[&str],
    ) -> Result<Vec<Option<Column<T>>>, ImportError> {
        self.check_size(element)?;
        // A property's place among `names`.
        let wanted: Vec<(Kind, Option<usize>)> = element
            .properties
            .iter()
            .map(|property| (property.kind, names.iter().position(|name| *name == property.name)))
            .collect();
        let mut columns: Vec<Option<Column<T>>> = names
            .iter()
            .map(|name| element.kind(name).map(|_| Column { values: Vec::new(), ends: Vec::new() }))
            .collect();
        let rows = if wanted.is_empty() { 0 } else { element.rows };
        for row in 0..rows {
            self.begin_row(element, row)?;
            for &(kind, slot) in &wanted {
                let column = slot.and_then(|slot| columns[slot].as_mut());
                self.read(kind, column)?;
            }
            self.end_row(element, row)?;
        }
        Ok(columns)
    }

    /// Calls `each` with a record of the numbers of each of the next element's rows; there is a place in it, or none,
    /// for each property. A record's numbers that no property has stay as they are.
    pub(crate) fn records<T: FromF64>(
        &mut self,
        element: &Element,
        places: &[Option<usize>],
        record: &mut [T],
        mut each: impl FnMut(&[T]),
    ) -> Result<(), ImportError> {
        for row in 0..element.rows {
            self.begin_row(element, row)?;
            for (property, place) in element.properties.iter().zip(places) {
                match (property.kind, place) {
                    (Kind::Scalar(scalar), Some(place)) => record[*place] = T::from_f64(self.next(scalar)?),
                    (kind, _) => self.read::<f32>(kind, None)?,
                }
            }
            self.end_row(element, row)?;
            each(record);
        }
        Ok(())
    }

    /// What is said of bytes behind the last row that was read; in text white space doesn't count.
    pub(crate) fn rest(&self) -> Option<Note> {
        let rest = match self.encoding {
            Encoding::Ascii => self.file.bytes[self.row_end..].trim_ascii(),
            Encoding::Binary(_) => &self.file.bytes[self.at..],
        };
        behind_rows(rest.len())
    }

    fn read<T: FromF64>(&mut self, kind: Kind, column: Option<&mut Column<T>>) -> Result<(), ImportError> {
        match kind {
            Kind::Scalar(scalar) => {
                let value = self.next(scalar)?;
                if let Some(column) = column {
                    column.values.push(T::from_f64(value));
                }
            }
            Kind::List { count, item } => {
                let place = self.place();
                let length = self.next(count)?;
                // Each value takes at least a byte.
                if !(length >= 0.0 && length.fract() == 0.0 && length <= self.file.bytes.len() as f64) {
                    return Err(self.file.malformed(place, format!("a list cannot have {length} values")));
                }
                let mut dropped = Column { values: Vec::new(), ends: Vec::new() };
                let column = column.unwrap_or(&mut dropped);
                for _ in 0..length as usize {
                    column.values.push(T::from_f64(self.next(item)?));
                }
                column.ends.push(column.values.len());
            }
        }
        Ok(())
    }

    /// That the rest of the file can hold the rows.
    fn check_size(&self, element: &Element) -> Result<(), ImportError> {
        let smallest = element.properties.iter().map(|property| match (self.encoding, property.kind) {
            // A digit and what separates it.
            (Encoding::Ascii, _) => 2,
            (_, Kind::Scalar(scalar)) => scalar.size(),
            (_, Kind::List { count, .. }) => count.size(),
        });
        let row: usize = smallest.sum();
        // The last separator may be missing.
        let left = self.file.bytes.len() - self.at + 1;
        if element.rows.checked_mul(row).is_none_or(|needed| needed > left) {
            return Err(too_short(self.file, (self.at, left - 1), element, row));
        }
        Ok(())
    }

    /// Where the next value lies.
    fn place(&self) -> Place {
        match self.encoding {
            Encoding::Ascii => Place::Line(self.line),
            Encoding::Binary(_) => Place::Byte(self.at),
        }
    }

    fn next(&mut self, scalar: Scalar) -> Result<f64, ImportError> {
        match self.encoding {
            Encoding::Ascii => self.next_word(),
            Encoding::Binary(endian) => self.next_binary(scalar, endian),
        }
    }

    fn next_binary(&mut self, scalar: Scalar, endian: Endian) -> Result<f64, ImportError> {
        let Some(value) = scalar.first(&self.file.bytes[self.at..], endian) else {
            return Err(self.file.malformed(self.place(), "the file ends in the middle of its rows"));
        };
        self.at += scalar.size();
        Ok(value)
    }

    fn next_word(&mut self) -> Result<f64, ImportError> {
        let row = self.file.bytes[self.at..self.row_end].trim_ascii_start();
        let start = self.row_end - row.len();
        let length = row.iter().position(u8::is_ascii_whitespace).unwrap_or(row.len());
        let word = String::from_utf8_lossy(&row[..length]);
        self.at = start + length;
        if word.is_empty() {
            return Err(self.file.malformed(self.place(), "there are fewer values than properties"));
        }
        word.parse().map_err(|_| self.file.malformed(self.place(), format!("{} is no number", quoted(&word))))
    }

    /// In text a row is the next line that is not empty.
    fn begin_row(&mut self, element: &Element, row: usize) -> Result<(), ImportError> {
        if self.encoding != Encoding::Ascii {
            return Ok(());
        }
        self.at = self.row_end;
        while self.file.bytes[self.at..self.row_end].trim_ascii().is_empty() {
            self.at = self.row_end;
            let rest = &self.file.bytes[self.at..];
            if rest.is_empty() {
                let name = quoted(&element.name);
                let problem = format!("the file ends before row {row} of {} of element {name}", element.rows);
                return Err(self.file.malformed(self.place(), problem));
            }
            let end = rest.iter().position(|&b| b == b'\n' || b == b'\r').map_or(rest.len(), |at| at + 1);
            // A line feed after a carriage return begins no line of its own.
            let second_half = rest[0] == b'\n' && self.at > 0 && self.file.bytes[self.at - 1] == b'\r';
            self.line += usize::from(!second_half);
            self.row_end = self.at + end;
        }
        Ok(())
    }

    fn end_row(&mut self, element: &Element, row: usize) -> Result<(), ImportError> {
        let surplus = self.encoding == Encoding::Ascii
            && !self.file.bytes[self.at..self.row_end].trim_ascii().is_empty();
        if surplus {
            let name = quoted(&element.name);
            let problem = format!("row {row} of element {name} has more values than properties");
            return Err(self.file.malformed(self.place(), problem));
        }
        Ok(())
    }
}
