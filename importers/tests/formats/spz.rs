//! SPZ of all versions.

use crate::common::{Folder, gzip, splats};
use glam::{Mat3, Vec3};
use oblate_engine::{OpacityFilter, Splats, Strength};
use oblate_importers::{Note, OpenOptions, Opened};

/// Columns of a file of version 2 or later, with its flags.
#[derive(Clone)]
pub(crate) struct Table {
    version: u32,
    degree: u8,
    bits: u8,
    flags: u8,
    count: u32,
    positions: Vec<u8>,
    alphas: Vec<u8>,
    colors: Vec<u8>,
    scales: Vec<u8>,
    rotations: Vec<u8>,
    harmonics: Vec<u8>,
    extensions: Vec<u8>,
}

impl Table {
    /// Splats at (1, 2, 3) and (−1, −2, −3) on the file's axes, with σ = 1 and no turn.
    fn new(version: u32, degree: u8) -> Self {
        let positions = match version {
            1 => [1.0, 2.0, 3.0, -1.0, -2.0, -3.0].iter().flat_map(|c| half(*c).to_le_bytes()).collect(),
            _ => [1, 2, 3, -1, -2, -3]
                .iter()
                .flat_map(|c: &i32| (c * 256).to_le_bytes()[..3].to_vec())
                .collect(),
        };
        let rotation: &[u8] = if version < 3 { &[128, 128, 128] } else { &[0, 0, 0, 0b1100_0000] };
        let harmonics = 6 * ((usize::from(degree) + 1).pow(2) - 1);
        Self {
            version,
            degree,
            bits: 8,
            flags: 0,
            count: 2,
            positions,
            alphas: vec![255, 51],
            colors: vec![128; 6],
            scales: vec![160; 6],
            rotations: rotation.repeat(2),
            harmonics: vec![128; harmonics],
            extensions: Vec::new(),
        }
    }

    fn columns(&self) -> [&[u8]; 6] {
        [&self.positions, &self.alphas, &self.colors, &self.scales, &self.rotations, &self.harmonics]
    }

    fn header(&self, streams: u8) -> Vec<u8> {
        let numbers = [self.version.to_le_bytes(), self.count.to_le_bytes()].concat();
        [b"NGSP", &numbers[..], &[self.degree, self.bits, self.flags, streams]].concat()
    }

    fn plain(&self) -> Vec<u8> {
        [self.header(0), self.columns().concat(), self.extensions.clone()].concat()
    }

    /// As version 4, whose streams `pack` makes frames of.
    fn container(&self, pack: fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
        let columns = self.columns();
        let streams: Vec<&&[u8]> = columns.iter().filter(|column| !column.is_empty()).collect();
        let frames: Vec<Vec<u8>> = streams.iter().map(|column| pack(column)).collect();
        let mut file = self.header(streams.len() as u8);
        file.extend((32 + self.extensions.len() as u32).to_le_bytes());
        file.extend([0; 12]);
        file.extend(&self.extensions);
        for (frame, column) in frames.iter().zip(&streams) {
            file.extend((frame.len() as u64).to_le_bytes());
            file.extend((column.len() as u64).to_le_bytes());
        }
        [file, frames.concat()].concat()
    }

    fn file(&self) -> Vec<u8> {
        if self.version == 4 { self.container(raw_frame) } else { gzip(&self.plain()) }
    }

    fn opened(&self) -> Opened {
        Folder::new().open("a.spz", self.file()).unwrap()
    }

    fn open(&self) -> Splats {
        splats(Folder::new().open("a.spz", self.file()))
    }
}

fn half(value: f32) -> u16 {
    // Of small whole numbers the upper bits, with the exponent's bias changed.
    let bits = value.to_bits();
    ((bits >> 16 & 0x8000) | ((bits >> 13 & 0x3ffff) - (112 << 10))) as u16
}

/// A Zstandard frame of one raw block.
fn raw_frame(bytes: &[u8]) -> Vec<u8> {
    let header = (bytes.len() as u32) << 3 | 1;
    [&[0x28, 0xb5, 0x2f, 0xfd, 0x20, bytes.len() as u8], &header.to_le_bytes()[..3], bytes].concat()
}

fn compressed_frame(bytes: &[u8]) -> Vec<u8> {
    ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest)
}

fn extension(kind: u32, payload: &[u8]) -> Vec<u8> {
    [&kind.to_le_bytes()[..], &(payload.len() as u32).to_le_bytes(), payload].concat()
}

fn coordinate_system(number: u32) -> Vec<u8> {
    extension(0xADBE_0003, &number.to_le_bytes())
}

/// Files of all versions, packings and extensions.
pub(crate) fn examples() -> Vec<Vec<u8>> {
    let mut extended = Table::new(4, 1);
    extended.flags = 2;
    extended.extensions = [extension(7, b"abc"), coordinate_system(6)].concat();
    let long = Table { count: 4, ..Table::new(4, 3) };
    let double = |bytes: &Vec<u8>| bytes.repeat(2);
    let long = Table {
        positions: double(&long.positions),
        alphas: double(&long.alphas),
        colors: double(&long.colors),
        scales: double(&long.scales),
        rotations: double(&long.rotations),
        harmonics: (0..180).map(|i| 100 + (i % 7) * 9).collect(),
        ..long
    };
    let mut legacy = extended.clone();
    legacy.version = 3;
    vec![
        Table::new(1, 0).file(),
        Table::new(2, 1).plain(),
        legacy.file(),
        extended.file(),
        long.container(compressed_frame),
    ]
}

fn sorted(splats: &Splats) -> Vec<Vec3> {
    let mut centers = splats.centers.clone();
    centers.sort_by(|a, b| b.x.total_cmp(&a.x));
    centers
}

#[test]
fn all_versions_in_the_same_place() {
    for version in 1..=4 {
        let table = Table::new(version, 0);
        let splats = table.open();
        // Right, up, back becomes right, down, ahead.
        assert_eq!(sorted(&splats), [Vec3::new(1.0, -2.0, -3.0), Vec3::new(-1.0, 2.0, 3.0)], "{version}");
        let Strength::Opacity { peaks, filter, .. } = &splats.strength else { panic!() };
        assert!(*filter == OpacityFilter::Classic && peaks.contains(&1.0) && peaks.contains(&0.2));
        // 128 of 255 is 1/255 of 3.33 harmonics of 0.282 beyond the middle, 0.5; decoded, as sRGB of 0.5037.
        assert!((splats.colors[0][0] - 0.2176).abs() < 1e-3, "{}", splats.colors[0][0]);
        for factor in [splats.shapes.factor(0), splats.shapes.factor(1)] {
            // 128 is 1/255 beyond no turn: three components of 1/255, twice in a matrix.
            assert!(factor.abs_diff_eq(Mat3::IDENTITY, if version < 3 { 0.017 } else { 1e-6 }), "{factor}");
        }
        assert_eq!(splats.harmonics, None);
    }
    let plain = splats(Folder::new().open("a", Table::new(2, 0).plain()));
    assert_eq!(plain, Table::new(2, 0).open());
    let packed = Table::new(4, 2).container(compressed_frame);
    assert_eq!(splats(Folder::new().open("a", packed)), Table::new(4, 2).open());
}

/// σ = 1 and e along the file's x and y, turned by `xyzw` as version 2 has it.
fn turned(xyz: [u8; 3]) -> Table {
    let mut table = Table::new(2, 0);
    table.count = 1;
    table.positions.truncate(9);
    table.alphas.truncate(1);
    table.colors.truncate(3);
    table.scales = vec![176, 160, 144];
    table.rotations = xyz.to_vec();
    table
}

#[test]
fn half_axes_turn_with_the_axes() {
    // 90° about x: (0.7071, 0, 0) is 217.6 of 255. x stays, y goes to z and z to −y; of right, up, back.
    let factor = turned([218, 127, 127]).open().shapes.factor(0).as_dmat3();
    let e = std::f64::consts::E;
    // Half-axes e, 1, 1/e: seen with y and z the other way the second points along ∓z, the third along y.
    let close = |found: f64, expected: f64| assert!((found - expected).abs() < 0.03, "{factor}");
    close(factor.x_axis.x.abs(), e);
    close(factor.y_axis.z.abs(), 1.0);
    close(factor.z_axis.y.abs(), 1.0 / e);
    // 45° about z in right, up: the first half-axis points right and up, which is −y.
    let factor = turned([127, 127, 176]).open().shapes.factor(0).as_dmat3();
    close(factor.x_axis.x * factor.x_axis.y, -e * e / 2.0);
    assert!(factor.determinant() > 0.0);
}

#[test]
fn three_smallest() {
    let mut table = turned([0; 3]);
    table.version = 3;
    // y is the largest; x = 0, z = −256/511/√2 = −0.3543, w = 0.3543: y² = 1 − 2 · 0.1255, 0.8654.
    let packed: u32 = 1 << 30 | (512 + 256) << 10 | 256;
    table.rotations = packed.to_le_bytes().to_vec();
    let factor = table.open().shapes.factor(0).as_dmat3();
    let (y, z, w) = (0.865_46, -0.354_25, 0.354_25);
    let turn = glam::DMat3::from_quat(glam::DQuat::from_xyzw(0.0, y, z, w));
    let flip = glam::DMat3::from_diagonal(glam::DVec3::new(1.0, -1.0, -1.0));
    // Mirrored half-axes are the same splat: compare covariances.
    let own = turn * glam::DMat3::from_diagonal(glam::DVec3::new(1.0, 0.0, -1.0).exp());
    let expected = flip * own * own.transpose() * flip;
    assert!((factor * factor.transpose()).abs_diff_eq(expected, 1e-3), "{factor}");
}

#[test]
fn harmonics_by_coefficient_then_channel() {
    let mut table = Table::new(3, 3);
    // Coefficient 3 of degree 1 (index 2) green, and the first of degree 3 (index 8) blue, of both splats.
    for splat in 0..2 {
        table.harmonics[45 * splat + 3 * 2 + 1] = 192;
        table.harmonics[45 * splat + 3 * 8 + 2] = 0;
    }
    let harmonics = table.open().harmonics.unwrap();
    assert_eq!(harmonics.degree, 3);
    let mut expected = [[0.0; 3]; 15];
    // Odd in x, which stays; odd in y, which does not.
    expected[2][1] = 0.5;
    expected[8][2] = 1.0;
    assert!(harmonics.coefficients.chunks(15).all(|row| row == expected), "{:?}", harmonics.coefficients);
}

#[test]
fn degree_4_is_left_out() {
    let mut table = Table::new(4, 4);
    table.count = 1;
    for column in [&mut table.positions, &mut table.alphas, &mut table.colors, &mut table.scales] {
        column.truncate(column.len() / 2);
    }
    table.rotations.truncate(4);
    table.harmonics.truncate(72);
    table.harmonics[0] = 64;
    let opened = table.opened();
    assert!(
        matches!(&opened.notes[..], [Note::LeftOut(what)] if what.contains("degree 4")),
        "{:?}",
        opened.notes
    );
    let harmonics = splats(Ok(opened)).harmonics.unwrap();
    assert_eq!((harmonics.degree, harmonics.coefficients.len()), (3, 15));
    assert_eq!(harmonics.coefficients[0], [0.5, 0.0, 0.0]);
}

#[test]
fn flags_and_extensions() {
    let mut table = Table::new(4, 0);
    table.flags = 1;
    let Strength::Opacity { filter, .. } = table.open().strength else { panic!() };
    assert_eq!(filter, OpacityFilter::Compensated);
    for version in [3, 4] {
        let mut table = Table::new(version, 0);
        table.flags = 2;
        // Right, down, front: as .ply has it. Others are skipped and said.
        table.extensions = [extension(0xADBE_0002, &[0; 12]), coordinate_system(6)].concat();
        let opened = table.opened();
        assert_eq!(opened.notes, [Note::LeftOut("the extension 0xadbe0002 (12 bytes)".into())]);
        assert_eq!(sorted(&splats(Ok(opened)))[0], Vec3::new(1.0, 2.0, 3.0));
        // Left, up, front.
        table.extensions = coordinate_system(7);
        assert_eq!(sorted(&table.open())[1], Vec3::new(-1.0, -2.0, 3.0));
        table.extensions = coordinate_system(0);
        assert!(matches!(&table.opened().notes[..], [Note::Assumed(_)]));
    }
}

#[test]
fn what_is_refused() {
    let folder = Folder::new();
    let refuse = |change: &dyn Fn(&mut Table), parts: &[&str]| {
        for version in [3, 4] {
            let mut table = Table::new(version, 1);
            change(&mut table);
            folder.refused("a.spz", table.file(), parts);
        }
    };
    refuse(&|table| table.degree = 5, &["byte 12", "degree 5", "0 to 4"]);
    refuse(&|table| table.bits = 25, &["byte 13", "25 fractional bits"]);
    refuse(&|table| table.count = u32::MAX, &[]);
    let plain = Table::new(3, 1).plain();
    folder.refused("a.spz", [&plain[..], &[0; 5]].concat(), &["5 bytes are left behind its splats"]);
    let system =
        |number| move |table: &mut Table| (table.flags, table.extensions) = (2, coordinate_system(number));
    refuse(&system(12), &["extensions", "coordinate system 12", "turned"]);
    refuse(&system(17), &["extensions", "1 to 16"]);
    refuse(&|table| (table.flags, table.extensions) = (2, vec![1; 7]), &["breaks off after 7 of 8"]);
    refuse(
        &|table| (table.flags, table.extensions) = (2, extension(1, &[0; 4])[..11].to_vec()),
        &["4 bytes", "there are 3"],
    );

    let none = Table { count: 0, ..Table::new(2, 0) };
    folder.refused("a.spz", none.header(0), &["no splats", "0 rows"]);
    folder.refused(
        "a.spz",
        Table { version: 5, ..Table::new(4, 0) }.plain(),
        &["byte 4", "version 5", "1 to 4"],
    );
    folder.refused("a.spz", "NGS", &["byte 0", "NGSP"]);
    folder.refused("a.spz", gzip(b"NGSX............"), &["byte 0", "NGSP"]);
    let plain = Table::new(2, 0).plain();
    folder.refused("a.spz", &plain[..plain.len() - 1], &["2 splats need 54 bytes", "there are 53"]);
    folder.refused("a.spz", gzip(&plain[..plain.len() - 1]), &["decompressed to 53 bytes; 54"]);
    folder.refused("a.spz", gzip(&[&plain[..], b"x"].concat()), &["more than the 54 bytes"]);
}

#[test]
fn containers_that_do_not_add_up() {
    let folder = Folder::new();
    let table = Table::new(4, 0);
    let whole = table.file();
    let refuse = |at: usize, byte: u8, parts: &[&str]| {
        let mut file = whole.clone();
        file[at] = byte;
        folder.refused("a.spz", file, parts);
    };
    refuse(15, 6, &["byte 15", "6 streams", "need 5"]);
    refuse(16, 31, &["byte 16", "table of streams is at byte 31"]);
    refuse(19, 255, &["byte 16", "within the file"]);
    refuse(40, 19, &["byte 40", "stream 0 unpacks to 19 bytes; these splats need 18"]);
    refuse(39, 255, &["byte 32", "stream 0 has"]);
    // Zstandard itself: its magic, and the size of the block, 18, by one more or less.
    refuse(112, 0, &["stream 0", "not a Zstandard frame"]);
    refuse(118, 17 << 3 | 1, &["stream 0"]);
    folder.refused("a.spz", [&whole[..], b"x"].concat(), &["1 bytes behind the last stream"]);
    let short = table.container(|bytes| raw_frame(&bytes[1..]));
    folder.refused("a.spz", short, &["stream 0", "decompressed to 17 bytes; 18 are expected"]);
    let long = table.container(|bytes| raw_frame(&[bytes, b"x"].concat()));
    folder.refused("a.spz", long, &["stream 0", "more than the 18 bytes"]);
    let two = table.container(|bytes| [raw_frame(bytes), raw_frame(b"")].concat());
    folder.refused("a.spz", two, &["left behind the Zstandard frame"]);
    let sum = table.container(|bytes| {
        let mut frame = raw_frame(bytes);
        frame[4] |= 4;
        [frame, vec![0; 4]].concat()
    });
    folder.refused("a.spz", sum, &["checksum"]);
}

#[test]
fn sizes_are_limited() {
    let folder = Folder::new();
    let options = OpenOptions { max_memory: 100, ..OpenOptions::default() };
    for version in 1..=4 {
        let refused = folder.open_with("a.spz", Table::new(version, 0).file(), &options);
        crate::common::refused(refused, "a.spz", &["2 splats", "the limit that is set is 100"]);
    }
    // A frame of 128 KiB of zeros in four bytes, as often as needed: 2³⁰ splats of nothing.
    let rle = |bytes: &[u8]| [raw_frame(bytes), vec![0; 4]].concat();
    let table = Table { count: 1 << 30, ..Table::new(4, 0) };
    folder.refused("a.spz", table.container(rle), &["limit"]);
    let no_limit = OpenOptions { max_memory: u64::MAX, ..OpenOptions::default() };
    let mut file = table.container(rle);
    for (stream, size) in [9_u64, 1, 3, 3, 4].into_iter().enumerate() {
        file[32 + 16 * stream + 8..][..8].copy_from_slice(&(size << 30).to_le_bytes());
    }
    let refused = folder.open_with("a.spz", file, &no_limit);
    crate::common::refused(refused, "a.spz", &["stream 0", "cannot hold the 9663676416 bytes"]);
    let mut plain = Table { count: 1 << 30, ..Table::new(2, 0) }.plain();
    let refused = folder.open_with("a.spz", gzip(&plain), &no_limit);
    crate::common::refused(refused, "a.spz", &["cannot hold"]);
    plain.truncate(40);
    let refused = folder.open_with("a.spz", plain, &no_limit);
    crate::common::refused(refused, "a.spz", &["1073741824 splats need"]);
}
