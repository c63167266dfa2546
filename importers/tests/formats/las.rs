//! LAS and LAZ.

use crate::common::{Folder, points, refused};
use laz::{LazVlrBuilder, compress_buffer};
use oblate_engine::color::srgb_to_linear;
use oblate_importers::{Note, OpenOptions};
use std::io::Cursor;

/// Bytes of the records of each point format.
const SIZES: [usize; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];
const COLORS: [Option<usize>; 11] =
    [None, None, Some(20), Some(28), None, Some(28), None, Some(30), Some(30), None, Some(30)];

const SCALE: [f64; 3] = [0.01, 0.02, 0.5];
const OFFSET: [f64; 3] = [600_000.0, -4_000_000.0, 100.0];

/// A point before it is written.
#[derive(Clone, Copy)]
pub(crate) struct Written {
    place: [i32; 3],
    intensity: u16,
    class: u8,
    withheld: bool,
    color: [u16; 3],
}

const MARKED: Written = Written {
    place: [123, -456, 7],
    intensity: 4321,
    class: 2,
    withheld: false,
    color: [65535, 0x8000, 257],
};

/// Some points, the first of which is marked.
pub(crate) fn some(count: usize) -> Vec<Written> {
    let other = |i: usize| {
        let i = i as u16;
        let place = [i32::from(i) * 3, 1000 - i32::from(i), i32::from(i % 5)];
        Written { place, intensity: 7 * i, color: [300 * i, 65535 - i, 5000], ..MARKED }
    };
    (0..count).map(|i| if i == 0 { MARKED } else { other(i) }).collect()
}

fn record(format: usize, extra: usize, point: &Written) -> Vec<u8> {
    let mut bytes = vec![0; SIZES[format] + extra];
    for (axis, value) in point.place.into_iter().enumerate() {
        bytes[4 * axis..4 * axis + 4].copy_from_slice(&value.to_le_bytes());
    }
    bytes[12..14].copy_from_slice(&point.intensity.to_le_bytes());
    if format < 6 {
        bytes[14] = 0x09;
        bytes[15] = point.class | u8::from(point.withheld) << 7;
    } else {
        bytes[14] = 0x11;
        bytes[15] = u8::from(point.withheld) << 2;
        bytes[16] = point.class;
    }
    if let Some(at) = COLORS[format] {
        let color = point.color.map(u16::to_le_bytes).concat();
        bytes[at..at + 6].copy_from_slice(&color);
    }
    let end = bytes.len();
    bytes[end - extra..].fill(0xab);
    bytes
}

/// A file before it is put together.
pub(crate) struct File {
    pub(crate) minor: u8,
    pub(crate) format: usize,
    pub(crate) extra: usize,
    /// The points of a chunk; 0 is variable.
    pub(crate) chunk: Option<u32>,
    pub(crate) points: Vec<Written>,
}

impl File {
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let Self { minor, format, extra, chunk, points } = self;
        let size = [227, 227, 227, 235, 375][usize::from(*minor)];
        let mut header = vec![0; size];
        header[..4].copy_from_slice(b"LASF");
        header[24..26].copy_from_slice(&[1, *minor]);
        header[94..96].copy_from_slice(&(size as u16).to_le_bytes());
        header[104] = *format as u8;
        header[105..107].copy_from_slice(&((SIZES[*format] + extra) as u16).to_le_bytes());
        let count = points.len();
        if *minor == 4 {
            header[247..255].copy_from_slice(&(count as u64).to_le_bytes());
        } else {
            header[107..111].copy_from_slice(&(count as u32).to_le_bytes());
        }
        for axis in 0..3 {
            header[131 + 8 * axis..139 + 8 * axis].copy_from_slice(&SCALE[axis].to_le_bytes());
            header[155 + 8 * axis..163 + 8 * axis].copy_from_slice(&OFFSET[axis].to_le_bytes());
        }
        let records: Vec<u8> = points.iter().flat_map(|point| record(*format, *extra, point)).collect();
        let (mut between, body) = match chunk {
            None => (Vec::new(), records),
            Some(chunk) => {
                header[104] |= 0x80;
                header[100] = 1;
                let builder = LazVlrBuilder::default();
                let builder = builder.with_point_format(*format as u8, *extra as u16).unwrap();
                let vlr = builder.with_fixed_chunk_size(*chunk).build();
                let mut data = Vec::new();
                vlr.write_to(&mut data).unwrap();
                let mut between = vec![0; 54];
                between[2..16].copy_from_slice(b"laszip encoded");
                between[18..20].copy_from_slice(&22204_u16.to_le_bytes());
                between[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
                between.extend(data);
                let mut packed = Cursor::new(Vec::new());
                compress_buffer(&mut packed, &records, vlr).unwrap();
                (between, packed.into_inner())
            }
        };
        let begin = (header.len() + between.len()) as u32;
        header[96..100].copy_from_slice(&begin.to_le_bytes());
        header.append(&mut between);
        header.extend(body);
        header
    }
}

fn plain(minor: u8, format: usize) -> File {
    File { minor, format, extra: 0, chunk: None, points: some(30) }
}

/// Versions and point formats that go together.
fn kinds() -> impl Iterator<Item = (u8, usize)> {
    (0..11).map(|format| ([0, 1, 2, 2, 3, 3, 4, 4, 4, 4, 4][format], format))
}

#[test]
fn a_marked_point_lands_where_the_header_says() {
    let folder = Folder::new();
    for (minor, format) in kinds() {
        for extra in [0, 3] {
            let file = File { extra, ..plain(minor, format) };
            let cloud = points(folder.open("a.las", file.bytes()));
            assert_eq!(cloud.positions.len(), 30);
            let found = cloud.origin + cloud.positions[0].as_dvec3();
            // The place is within a unit of the origin, so it is rounded by 6e-8 at most.
            assert!((found - glam::dvec3(600_001.23, -4_000_009.12, 103.5)).length() < 1e-7, "{found}");
            assert_eq!(cloud.intensities.unwrap()[0], 4321.0);
            let color = COLORS[format].map(|_| [1.0, 32768.0 / 65535.0, 257.0 / 65535.0].map(srgb_to_linear));
            assert_eq!(cloud.colors.map(|colors| colors[0]), color, "format {format}");
            assert_eq!((cloud.normals, cloud.viewpoint), (None, None));
        }
    }
}

#[test]
fn compressed_points_are_those_of_the_plain_file() {
    let folder = Folder::new();
    for (minor, format) in kinds() {
        for (extra, chunk) in [(0, 100), (3, 8)] {
            let file = File { extra, chunk: Some(chunk), ..plain(minor, format) };
            let expected = folder.open("a.las", File { extra, ..plain(minor, format) }.bytes()).unwrap();
            assert_eq!(folder.open("a.laz", file.bytes()).unwrap(), expected, "format {format}");
        }
    }
}

#[test]
fn what_is_withheld_or_noise_is_left_out_and_counted() {
    let folder = Folder::new();
    for (minor, format) in [(2, 3), (4, 7)] {
        let mut points_ = some(10);
        points_[1].class = 7;
        points_[2].class = 18;
        points_[3].withheld = true;
        let opened = folder.open("a.las", File { points: points_, ..plain(minor, format) }.bytes()).unwrap();
        let noise = if format >= 6 { 2 } else { 1 };
        let notes = [
            Note::LeftOut("1 of 10 points, that are withheld".into()),
            Note::LeftOut(format!("{noise} of 10 points, that are classified as noise")),
        ];
        assert_eq!(opened.notes, notes);
        assert_eq!(points(Ok(opened)).positions.len(), 9 - noise);
    }
    let noise = some(2).into_iter().map(|point| Written { class: 7, ..point }).collect();
    let bytes = File { points: noise, ..plain(2, 2) }.bytes();
    folder.refused("a.las", bytes, &["no points in it", "2 of 2 points, that are classified as noise"]);
}

#[test]
fn eight_bit_colours_are_told_from_none() {
    let folder = Folder::new();
    let with = |color| {
        let points = some(4).into_iter().map(|point| Written { color, ..point }).collect();
        folder.open("a.las", File { points, ..plain(2, 2) }.bytes()).unwrap()
    };
    let eight = with([255, 128, 0]);
    assert!(matches!(&eight.notes[..], [Note::Assumed(what)] if what.contains("8-bit")));
    let expected = [1.0, 128.0 / 255.0, 0.0].map(srgb_to_linear);
    assert_eq!(points(Ok(eight)).colors.unwrap()[0], expected);
    assert_eq!(points(Ok(with([0; 3]))).colors, None);
}

#[test]
fn what_is_refused() {
    let folder = Folder::new();
    let refuse = |change: &dyn Fn(&mut Vec<u8>), file: &File, parts: &[&str]| {
        let mut bytes = file.bytes();
        change(&mut bytes);
        folder.refused("a.las", bytes, parts);
    };
    let put = |at: usize, value: &'static [u8]| {
        move |bytes: &mut Vec<u8>| bytes[at..at + value.len()].copy_from_slice(value)
    };
    let las = plain(2, 3);
    refuse(&put(0, b"LASX"), &las, &["byte 0", "begins with \"LASF\""]);
    refuse(&put(25, &[5]), &las, &["byte 24", "LAS 1.5 is not supported; 1.0 to 1.4 are"]);
    refuse(&put(94, &[226, 0]), &las, &["byte 94", "header of 226 bytes", "227 at least"]);
    refuse(&put(96, &[0, 0]), &las, &["byte 96", "begin at byte 0", "from 227"]);
    refuse(&put(104, &[11]), &las, &["byte 104", "point format 11 is not supported; 0 to 10 are"]);
    refuse(&put(105, &[33, 0]), &las, &["byte 105", "records of 33 bytes", "34 at least"]);
    refuse(&put(107, &[31, 0]), &las, &["byte 227", "31 points of 34 bytes", "1020 bytes that are left"]);
    refuse(&put(107, &[255; 4]), &las, &["4294967295 points"]);
    refuse(&put(107, &[0; 4]), &las, &["no points in it", "0 rows"]);
    refuse(&put(131, &[0; 8]), &las, &["byte 131", "scale", "not 0"]);
    refuse(&put(155, &[255; 8]), &las, &["byte 131", "finite"]);
    refuse(&|bytes| bytes.truncate(100), &las, &["byte 104", "middle of its header"]);
    refuse(&put(247, &[255; 8]), &plain(4, 6), &["18446744073709551615 points"]);

    let laz = File { chunk: Some(10), ..plain(2, 3) };
    refuse(&put(100, &[0]), &laz, &["byte 227", "no record of laszip"]);
    refuse(&put(247, &[255, 255]), &laz, &["byte 227", "record of 65535 bytes"]);
    refuse(&put(104, &[0x82]), &laz, &["byte 281", "is not what points of format 2 with 8 extra bytes are"]);
    refuse(&put(281, &[3]), &laz, &["byte 281", "point format 3 cannot be compressed by method 3"]);
    refuse(&put(293, &[255; 4]), &laz, &["chunks of various sizes are not supported"]);
    refuse(&put(315, &[99, 0]), &laz, &["byte 281", "record of laszip", "99"]);
    refuse(&|bytes| bytes.truncate(bytes.len() - 120), &laz, &["break off"]);
    let wide = File { extra: 1025, chunk: Some(10), points: some(1), ..plain(2, 3) };
    refuse(&|_| {}, &wide, &["byte 281", "1025 extra bytes for each point", "may have 1024"]);
    let layered = File { chunk: Some(10), ..plain(4, 7) };
    let begin = 375 + 54 + 34 + 6 * 2 + 8;
    refuse(&put(begin + 36, &[31, 0]), &layered, &["31 points are said", "30 points to come"]);
    refuse(&put(begin + 40, &[255; 4]), &layered, &["the file ends in the middle of the chunk", "30 of 30"]);
    refuse(&put(247, &[31]), &layered, &["the file ends in the middle of the chunk", "1 of 31"]);
    let few = OpenOptions { max_memory: 1000, ..OpenOptions::default() };
    refused(folder.open_with("a.laz", laz.bytes(), &few), "a.laz", &["more than 1000 bytes"]);
    let many = File { chunk: Some(1), points: some(1), ..plain(2, 3) };
    refuse(&put(107, &[0, 0, 1, 0]), &many, &["65536 chunks for 65536 points", "not read in such numbers"]);
}
