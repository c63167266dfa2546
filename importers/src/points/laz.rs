//! The compression of LAZ files: chunks of points, each by itself.
//!
//! Source: Isenburg, *LASzip: lossless compression of LiDAR data*, 2013, and its open source programs.
//!
//! The table of chunks is not used: pointwise chunks follow on each other, and layered ones say how long they are, which is
//! checked before anything is unpacked.

use super::las::{Header, RECORD_SIZES, number};
use crate::file::File;
use crate::inflate::over_limit;
use crate::scalar::Scalar;
use crate::{ImportError, OpenOptions, Place};
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{LazItem, LazItemRecordBuilder, LazItemType, LazVlr};
use rayon::prelude::*;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Bytes before the data of a variable-length record.
const RECORD_HEADER: usize = 54;

/// Bytes of the offset of the table of chunks, before the first chunk.
const TABLE_OFFSET: usize = 8;

/// Points that are unpacked before more memory is asked for.
const POINTS_AT_ONCE: usize = 4096;

/// Chunks of fewer points than this, in the mean, are taken for an attack where there are many: setting up the tables for
/// a chunk takes longer than unpacking a hundred points.
const LEAST_MEAN: u64 = 64;
const FEW_CHUNKS: usize = 1000;

/// Each extra byte of a point takes tables of 10 kB in each chunk that is being unpacked.
const MOST_EXTRA: usize = 1024;

/// How the points of a file are compressed.
struct Compression {
    items: Vec<LazItem>,
    organization: Organization,
    /// The most points of a pointwise chunk.
    chunk_size: usize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Organization {
    /// One chunk, without a table.
    Whole,
    Chunks,
    Layers,
}

/// The records of all points as an uncompressed file has them.
pub(super) fn unpack(file: &File, header: &Header, options: &OpenOptions) -> Result<Vec<u8>, ImportError> {
    let compression = Compression::find(file, header)?;
    let size = header.points_size().filter(|&size| size as u64 <= options.max_memory);
    let size = size.ok_or_else(|| file.malformed(Place::Whole, over_limit(options.max_memory)))?;
    let table = if compression.organization == Organization::Whole { 0 } else { TABLE_OFFSET };
    let begin = header.points + table;
    let bytes = file.bytes.get(begin..).unwrap_or_default();
    if compression.organization != Organization::Layers {
        let unpacked = compression.pointwise(bytes, header.record_size, size);
        return unpacked.map_err(|problem| file.malformed(Place::Byte(begin), problem));
    }
    let chunks = compression.layered_chunks(file, header, begin)?;
    let mut records = vec![0; size];
    let mut rest = &mut records[..];
    let mut tasks = Vec::with_capacity(chunks.len());
    for (place, count) in chunks {
        let (here, others) = std::mem::take(&mut rest).split_at_mut(count * header.record_size);
        tasks.push((place, here));
        rest = others;
    }
    let unpack = |(place, records): (usize, &mut [u8])| {
        let input = Cursor::new(&file.bytes[place..]);
        let mut decompressor = LayeredPointRecordDecompressor::new(input);
        let unpacked = compression.fill(&mut decompressor, header.record_size, records);
        unpacked.err().map(|problem| (place, problem))
    };
    match tasks.into_par_iter().find_map_first(unpack) {
        Some((place, problem)) => Err(file.malformed(Place::Byte(place), problem)),
        None => Ok(records),
    }
}

impl Compression {
    /// What the record of laszip says, which must fit the header.
    fn find(file: &File, header: &Header) -> Result<Self, ImportError> {
        let mut at = header.size;
        for _ in 0..header.records {
            let length = number(file, at + 20, Scalar::U16)? as usize;
            let id = number(file, at + 18, Scalar::U16)?;
            let begin = at + RECORD_HEADER;
            let Some(data) = file.bytes.get(begin..begin + length) else {
                let problem = format!("a record of {length} bytes is longer than what is left of the file");
                return Err(file.malformed(Place::Byte(at), problem));
            };
            if file.bytes[at + 2..at + 18].starts_with(b"laszip encoded") && id == 22204.0 {
                return Self::parse(data, header)
                    .map_err(|problem| file.malformed(Place::Byte(begin), problem));
            }
            at = begin + length;
        }
        let problem = "the points are compressed, but no record of laszip says how";
        Err(file.malformed(Place::Byte(header.size), problem))
    }

    fn parse(data: &[u8], header: &Header) -> Result<Self, String> {
        let record = LazVlr::from_buffer(data).map_err(|error| format!("the record of laszip: {error}"))?;
        let layers = header.format >= 6;
        let chunk_size = record.chunk_size() as usize;
        let organization = match data[0] {
            1 if !layers => Organization::Whole,
            2 if !layers && record.uses_variable_size_chunks() => {
                return Err(
                    "pointwise chunks of various sizes are not supported; those of one size are".into()
                );
            }
            2 if !layers => Organization::Chunks,
            3 if layers => Organization::Layers,
            other => {
                return Err(format!("point format {} cannot be compressed by method {other}", header.format));
            }
        };
        let extra = header.record_size - RECORD_SIZES[header.format];
        if extra > MOST_EXTRA {
            return Err(format!("{extra} extra bytes for each point; compressed ones may have {MOST_EXTRA}"));
        }
        let expected = LazItemRecordBuilder::default_for_point_format_id(header.format as u8, extra as u16)
            .map_err(|error| error.to_string())?;
        let versions = if layers { 3..=4 } else { 1..=2 };
        let fits = |(item, expected): (&LazItem, &LazItem)| {
            let (kind, size) = (item.item_type(), item.size());
            kind == expected.item_type() && size == expected.size() && versions.contains(&item.version())
        };
        let items = record.items().clone();
        if items.len() != expected.len() || !items.iter().zip(&expected).all(fits) {
            let described: Vec<String> = items
                .iter()
                .map(|item| format!("{:?} version {}", item.item_type(), item.version()))
                .collect();
            return Err(format!(
                "what is compressed, {}, is not what points of format {} with {extra} extra bytes are",
                described.join(", "),
                header.format
            ));
        }
        Ok(Self { items, organization, chunk_size })
    }

    fn pointwise(&self, bytes: &[u8], record_size: usize, size: usize) -> Result<Vec<u8>, String> {
        let chunk = match self.organization {
            Organization::Whole => size / record_size,
            _ => self.chunk_size,
        };
        let count = size / record_size;
        if (chunk as u64) < LEAST_MEAN && count / chunk.max(1) > FEW_CHUNKS {
            return Err(small_chunks(count / chunk.max(1), count));
        }
        let mut decompressor = SequentialPointRecordDecompressor::new(Cursor::new(bytes));
        let mut records = Vec::new();
        while records.len() < size {
            let end = size.min(records.len() + chunk * record_size);
            let mut begins = true;
            while records.len() < end {
                let begin = records.len();
                records.resize(end.min(begin + POINTS_AT_ONCE * record_size), 0);
                if begins {
                    self.fill(&mut decompressor, record_size, &mut records[begin..])?;
                } else {
                    run(&mut decompressor, record_size, &mut records[begin..])?;
                }
                begins = false;
            }
        }
        Ok(records)
    }

    /// Where the layered chunks begin and how many points each has: as many as the header says together, each with all its bytes in the
    /// file.
    fn layered_chunks(
        &self,
        file: &File,
        header: &Header,
        begin: usize,
    ) -> Result<Vec<(usize, usize)>, ImportError> {
        let of_item = |item: &LazItem| match item.item_type() {
            LazItemType::Point14 => 9,
            LazItemType::RGBNIR14 => 2,
            LazItemType::Byte14(size) => usize::from(size),
            _ => 1,
        };
        let layers: usize = self.items.iter().map(of_item).sum();
        let (mut chunks, mut at, mut left) = (Vec::new(), begin, header.count);
        while left > 0 {
            let short = |what: &str| {
                let problem = format!(
                    "{what} of the chunk of points that begins here, with {left} of {} points to come",
                    header.count
                );
                file.malformed(Place::Byte(at), problem)
            };
            let word = |number: usize| {
                let from = at + header.record_size + 4 * number;
                let bytes = file.bytes.get(from..)?.first_chunk::<4>()?;
                Some(u32::from_le_bytes(*bytes) as usize)
            };
            let sizes: Option<Vec<usize>> = (0..=layers).map(word).collect();
            let sizes = sizes.ok_or_else(|| short("the file ends in the middle"))?;
            let count = sizes[0] as u64;
            if count == 0 || count > left {
                return Err(short(&format!("{count} points are said to be the number")));
            }
            let length = sizes[1..]
                .iter()
                .fold(header.record_size + 4 * (layers + 1), |sum, &size| sum.saturating_add(size));
            if length > file.bytes.len() - at {
                return Err(short("the file ends in the middle"));
            }
            chunks.push((at, sizes[0]));
            at += length;
            left -= count;
        }
        if chunks.len() > FEW_CHUNKS && header.count / (chunks.len() as u64) < LEAST_MEAN {
            return Err(file.malformed(Place::Byte(begin), small_chunks(chunks.len(), header.count as usize)));
        }
        Ok(chunks)
    }

    /// Unpacks points from the beginning of a chunk.
    fn fill<'a>(
        &self,
        decompressor: &mut impl RecordDecompressor<Cursor<&'a [u8]>>,
        record_size: usize,
        records: &mut [u8],
    ) -> Result<(), String> {
        decompressor.reset();
        decompressor.set_fields_from(&self.items).map_err(|error| error.to_string())?;
        run(decompressor, record_size, records)
    }
}

fn small_chunks(chunks: usize, count: usize) -> String {
    format!(
        "{chunks} chunks for {count} points; chunks of fewer than {LEAST_MEAN} points are not read in such numbers"
    )
}

/// Unpacks points.
fn run<'a>(
    decompressor: &mut impl RecordDecompressor<Cursor<&'a [u8]>>,
    record_size: usize,
    records: &mut [u8],
) -> Result<(), String> {
    let mut unpacked = 0;
    // The decompressor's sums are meant to wrap, but it doesn't say so: what is broken overflows where overflows are checked.
    // Nothing of it is used after that.
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        records.chunks_exact_mut(record_size).try_for_each(|record| {
            decompressor.decompress_next(record)?;
            unpacked += 1;
            Ok::<_, std::io::Error>(())
        })
    }));
    match outcome {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => Err(format!("the compressed points break off: {error}")),
        Err(_) => Err(format!(
            "the compressed points are broken: the decompressor gave up at the one after {unpacked} others"
        )),
    }
}
