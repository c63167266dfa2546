use crate::common::{DIMS, Folder, assert_corner_marked, corner_marked, refused, volume};
use glam::{DMat3, DVec3};
use oblate_importers::{ImportError, Note, OpenOptions, Opened, open};
use oblate_volumes::Space;

const IMPLICIT: &str = "1.2.840.10008.1.2";
const EXPLICIT: &str = "1.2.840.10008.1.2.1";
const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
const BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";
const RLE: &str = "1.2.840.10008.1.2.5";
const JPEG: &str = "1.2.840.10008.1.2.4.50";

/// An element of a file: tag, type, value. Numbers of type US are little-endian here.
type Element = (u32, &'static str, Vec<u8>);

/// A file of one slice.
#[derive(Clone)]
pub(crate) struct Slice {
    syntax: &'static str,
    elements: Vec<Element>,
    /// Native samples, or fragments.
    pixels: Vec<Vec<u8>>,
}

fn text(tag: u32, kind: &'static str, value: &str) -> Element {
    (tag, kind, value.as_bytes().to_vec())
}

fn short(tag: u32, value: u16) -> Element {
    (tag, "US", value.to_le_bytes().to_vec())
}

impl Slice {
    /// Slice `k` of the corner-marked volume, as bytes; spacing 0.5 along rows, 2 down columns, 3 from slice to slice.
    fn of_corner_marked(k: usize) -> Self {
        let plane = DIMS[0] * DIMS[1];
        let elements = vec![
            text(0x0020_000e, "UI", "1.2.3"),
            text(0x0020_0013, "IS", &(k + 1).to_string()),
            text(0x0020_0032, "DS", &format!("-10\\20\\{}", 3 * k)),
            text(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0"),
            short(0x0028_0002, 1),
            text(0x0028_0004, "CS", "MONOCHROME2 "),
            short(0x0028_0010, DIMS[1] as u16),
            short(0x0028_0011, DIMS[0] as u16),
            text(0x0028_0030, "DS", "2\\0.5"),
            short(0x0028_0100, 8),
            short(0x0028_0101, 8),
            short(0x0028_0102, 7),
            short(0x0028_0103, 0),
        ];
        Self { syntax: EXPLICIT, elements, pixels: vec![corner_marked()[k * plane..][..plane].to_vec()] }
    }

    /// Files of one slice in several transfer syntaxes.
    pub(crate) fn seeds() -> Vec<Vec<u8>> {
        let slice = Self::of_corner_marked(0);
        let mut packed = slice.clone().written(RLE);
        packed.pixels = vec![rle(&packed.pixels)];
        let implicit = slice.clone().with(text(0x0028_1052, "DS", "-4")).written(IMPLICIT);
        [slice, packed, implicit].map(|slice| slice.file()).into()
    }

    /// The same with samples of 16 bits.
    fn wide(mut self, bits: u16, signed: bool, value: impl Fn(u8) -> u16) -> Self {
        self = self
            .with(short(0x0028_0100, 16))
            .with(short(0x0028_0101, bits))
            .with(short(0x0028_0102, bits - 1));
        self = self.with(short(0x0028_0103, signed.into()));
        self.pixels = vec![self.pixels[0].iter().flat_map(|byte| value(*byte).to_le_bytes()).collect()];
        self
    }

    fn with(mut self, element: Element) -> Self {
        self = self.without(element.0);
        self.elements.push(element);
        self.elements.sort_by_key(|element| element.0);
        self
    }

    fn without(mut self, tag: u32) -> Self {
        self.elements.retain(|element| element.0 != tag);
        self
    }

    fn written(self, syntax: &'static str) -> Self {
        Self { syntax, ..self }
    }

    fn file(&self) -> Vec<u8> {
        let (big, explicit) = (self.syntax == BIG_ENDIAN, self.syntax != IMPLICIT);
        let mut set = Vec::new();
        // A sequence of undefined length with an item of the same, which is passed over.
        if explicit && !big {
            set.extend(head(0x0008_1140, "SQ", u32::MAX, true, false));
            set.extend(head(0xfffe_e000, "", u32::MAX, false, false));
            set.extend(element(&text(0x0020_000e, "UI", "9.9.9\0"), true, false));
            set.extend(head(0xfffe_e00d, "", 0, false, false));
            set.extend(head(0xfffe_e0dd, "", 0, false, false));
        }
        for one in &self.elements {
            set.extend(element(one, explicit, big));
        }
        if matches!(self.syntax, RLE | JPEG) {
            set.extend(head(0x7fe0_0010, "OB", u32::MAX, true, false));
            for fragment in [&Vec::new()].into_iter().chain(&self.pixels) {
                set.extend(head(0xfffe_e000, "", fragment.len() as u32, false, false));
                set.extend(fragment);
            }
            set.extend(head(0xfffe_e0dd, "", 0, false, false));
        } else {
            let mut samples = self.pixels[0].clone();
            let wide = self.elements.contains(&short(0x0028_0100, 16));
            if big && wide {
                samples.chunks_mut(2).for_each(<[u8]>::reverse);
            }
            set.extend(element(&(0x7fe0_0010, if wide { "OW" } else { "OB" }, samples), explicit, big));
        }
        if self.syntax == DEFLATED {
            use std::io::Write;
            let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::default());
            encoder.write_all(&set).unwrap();
            set = encoder.finish().unwrap();
        }
        let syntax = element(&text(0x0002_0010, "UI", self.syntax), true, false);
        [&[0; 128][..], b"DICM", &syntax, &set].concat()
    }
}

fn head(tag: u32, kind: &str, length: u32, explicit: bool, big: bool) -> Vec<u8> {
    let ordered = |mut bytes: Vec<u8>| {
        if big {
            bytes.reverse();
        }
        bytes
    };
    let mut bytes = ordered(((tag >> 16) as u16).to_le_bytes().to_vec());
    bytes.extend(ordered((tag as u16).to_le_bytes().to_vec()));
    if explicit {
        bytes.extend(kind.bytes());
        if !matches!(kind, "OB" | "OW" | "SQ" | "UN") {
            bytes.extend(ordered((length as u16).to_le_bytes().to_vec()));
            return bytes;
        }
        bytes.extend([0, 0]);
    }
    bytes.extend(ordered(length.to_le_bytes().to_vec()));
    bytes
}

/// An element whose value is filled up to an even number of bytes.
fn element((tag, kind, value): &Element, explicit: bool, big: bool) -> Vec<u8> {
    let mut value = value.clone();
    if value.len() % 2 == 1 {
        value.push(if matches!(*kind, "UI" | "OB") { 0 } else { b' ' });
    }
    if big && *kind == "US" {
        value.reverse();
    }
    [head(*tag, kind, value.len() as u32, explicit, big), value].concat()
}

/// Writes files and opens their folder.
fn folder_of(slices: &[Slice]) -> (Folder, Result<Opened, ImportError>) {
    let folder = Folder::new();
    // Names in another order than places.
    for (index, slice) in slices.iter().enumerate() {
        folder.write(&format!("image{}", slices.len() - index), slice.file());
    }
    let opened = open(folder.path(), &OpenOptions::default());
    (folder, opened)
}

fn both() -> [Slice; 2] {
    [Slice::of_corner_marked(0), Slice::of_corner_marked(1)]
}

#[test]
fn a_folder_and_a_file_of_it_are_the_series() {
    let (folder, opened) = folder_of(&both());
    let opened = opened.unwrap();
    assert_eq!(opened.notes, []);
    let of_folder = volume(Ok(opened));
    assert_corner_marked(&of_folder);
    assert_eq!(of_folder.voxels().type_name(), "u8");
    let frame = of_folder.frame();
    assert_eq!((frame.spacing, frame.origin), (DVec3::new(0.5, 2.0, 3.0), DVec3::new(-10.0, 20.0, 0.0)));
    assert_eq!((frame.direction, frame.space), (DMat3::IDENTITY, Some(Space::Lps)));
    // The preamble may be that of a TIFF.
    let mut both_formats = Slice::of_corner_marked(0).file();
    both_formats[..4].copy_from_slice(b"II*\0");
    assert_eq!(Folder::new().volume("a", both_formats).frame().spacing, DVec3::new(0.5, 2.0, 1.0));
    // Of another series, of no image, and of no DICOM.
    let other = Slice::of_corner_marked(0).with(text(0x0020_000e, "UI", "1.2.4"));
    folder.write("other", other.file());
    folder.write("broken", &other.file()[..150]);
    folder.write("text", "no image");
    let opened = open(folder.path().join("image1"), &OpenOptions::default()).unwrap();
    assert!(matches!(&opened.notes[..], [Note::LeftOut(text)] if text.contains("1 DICOM files beside")));
    assert_eq!(volume(Ok(opened)), of_folder);
    std::fs::remove_file(folder.path().join("broken")).unwrap();
    let several = open(folder.path(), &OpenOptions::default());
    refused(several, "", &["2 series", "1.2.3 (\"\", 2 files)", "1.2.4 (\"\", 1 files)", "give a file"]);
    // A file alone is a volume of one slice.
    let alone = Slice::of_corner_marked(1).with(text(0x0018_0050, "DS", "4"));
    let opened = Folder::new().volume("a.dcm", alone.file());
    assert_eq!((opened.dims(), opened.frame().spacing), ([4, 3, 1], DVec3::new(0.5, 2.0, 4.0)));
    assert_eq!(opened.frame().origin, DVec3::new(-10.0, 20.0, 3.0));
}

/// Segments of bytes, highest first, with literals and a run.
fn rle(planes: &[Vec<u8>]) -> Vec<u8> {
    let packed = |plane: &Vec<u8>| {
        let (first, rest) = plane.split_at(2);
        // A run, where bytes are equal, and literals, in several packets with a byte that means nothing between.
        let mut bytes = if first[0] == first[1] { vec![255, first[0]] } else { vec![1, first[0], first[1]] };
        bytes.push(128);
        bytes.push(rest.len() as u8 - 1);
        bytes.extend(rest);
        bytes
    };
    let segments: Vec<Vec<u8>> = planes.iter().map(packed).collect();
    let mut starts = vec![segments.len() as u32];
    let mut at = 64;
    for segment in &segments {
        starts.push(at);
        at += segment.len() as u32;
    }
    starts.resize(16, 0);
    let head = starts.iter().flat_map(|start| start.to_le_bytes());
    head.chain(segments.concat()).collect()
}

#[test]
fn every_transfer_syntax() {
    for syntax in [IMPLICIT, EXPLICIT, DEFLATED, BIG_ENDIAN] {
        let (_, opened) = folder_of(&both().map(|slice| slice.written(syntax)));
        assert_corner_marked(&volume(opened));
        let (_, opened) = folder_of(&both().map(|slice| slice.wide(12, false, u16::from).written(syntax)));
        assert_eq!(assert_type(opened, "i16"), 1.0, "{syntax}");
    }
    let packed = both().map(|mut slice| {
        slice.pixels = vec![rle(&slice.pixels)];
        slice.written(RLE)
    });
    assert_corner_marked(&volume(folder_of(&packed).1));
    let packed = both().map(|slice| {
        let mut slice = slice.wide(16, false, |value| u16::from(value) + 0x0100).written(RLE);
        let high_and_low = [1, 0].map(|at| slice.pixels[0].iter().copied().skip(at).step_by(2).collect());
        slice.pixels = vec![rle(&high_and_low)];
        slice
    });
    let opened = volume(folder_of(&packed).1);
    assert_eq!((opened.value([0, 0, 0]), opened.value([3, 2, 1])), (257.0, 264.0));
    let refused_syntax = Slice::of_corner_marked(0).written("1.2.840.10008.1.2.4.90");
    Folder::new().refused("a.dcm", refused_syntax.file(), &["1.2.840.10008.1.2.4.90 (JPEG 2000)", "RLE"]);
}

/// The type of a folder's voxels and its first.
#[track_caller]
fn assert_type(opened: Result<Opened, ImportError>, name: &str) -> f32 {
    let volume = volume(opened);
    assert_eq!(volume.voxels().type_name(), name);
    volume.value([0, 0, 0])
}

#[test]
fn baseline_jpeg() {
    let mut jpeg = std::io::Cursor::new(Vec::new());
    let image = image::GrayImage::from_pixel(4, 3, image::Luma([200]));
    image.write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
    let mut slice = Slice::of_corner_marked(0).written(JPEG);
    let bytes = jpeg.into_inner();
    // In two fragments, as they may be.
    slice.pixels = vec![bytes[..100].to_vec(), bytes[100..].to_vec()];
    let opened = Folder::new().volume("a.dcm", slice.file());
    // A single colour is one number of the transform, which is rounded once.
    assert!((opened.value([3, 2, 0]) - 200.0).abs() <= 1.0);
    let wrong = slice.with(short(0x0028_0010, 4));
    Folder::new().refused("a.dcm", wrong.file(), &["PixelData", "JPEG of 4x3", "4x4 of L8"]);
}

#[test]
fn values_are_rescaled() {
    let rescaled = |slice: Slice, slope: &str, intercept: &str| {
        slice.with(text(0x0028_1052, "DS", intercept)).with(text(0x0028_1053, "DS", slope))
    };
    let of = |slices: [Slice; 2]| folder_of(&slices).1;
    let unsigned = |bits| both().map(|slice| slice.wide(bits, false, u16::from));
    assert_eq!(assert_type(of(unsigned(12).map(|s| rescaled(s, "1", "-1024"))), "i16"), -1023.0);
    assert_eq!(assert_type(of(unsigned(16).map(|s| rescaled(s, "1", "60000"))), "u16"), 60001.0);
    assert_eq!(assert_type(of(unsigned(16).map(|s| rescaled(s, "1", "100000"))), "f32"), 100_001.0);
    assert_eq!(assert_type(of(unsigned(16).map(|s| rescaled(s, "0.5", "0"))), "f32"), 0.5);
    assert_eq!(assert_type(of(both().map(|s| rescaled(s, "1", "0"))), "u8"), 1.0);
    // Signed numbers of 12 bits, with bits above that are none of theirs.
    let signed =
        both().map(|slice| slice.wide(12, true, |value| 0xa000 | (0u16.wrapping_sub(value.into()) & 0xfff)));
    assert_eq!(assert_type(of(signed), "i16"), -1.0);
    // Each slice has its own slope, as in PET.
    let [a, b] = both();
    let own = volume(of([rescaled(a, "2", "0"), rescaled(b, "3", "0")]));
    assert_eq!((own.value([0, 0, 0]), own.value([0, 0, 1])), (2.0, 15.0));
    let bad = Slice::of_corner_marked(0).with(text(0x0028_1053, "DS", "steep"));
    Folder::new().refused("a.dcm", bad.file(), &["RescaleSlope", "must be a number"]);
    let bad = Slice::of_corner_marked(0).with(text(0x0028_1053, "DS", "0"));
    Folder::new().refused("a.dcm", bad.file(), &["RescaleSlope", "makes all values one"]);
    let bad = Slice::of_corner_marked(0).with(text(0x0028_1053, "DS", "1e300"));
    Folder::new().refused("a.dcm", bad.file(), &["RescaleSlope", "single precision"]);
    let inverted = Slice::of_corner_marked(0).with(text(0x0028_0004, "CS", "MONOCHROME1"));
    let opened = Folder::new().open("a.dcm", inverted.file()).unwrap();
    assert!(matches!(&opened.notes[..], [Note::Assumed(text)] if text.contains("values are kept")));
    assert_eq!(volume(Ok(opened)).value([0, 0, 0]), 1.0);
}

/// A sagittal grid: rows to the back, columns to the feet, slices to the left.
#[test]
fn a_marked_corner_lands_where_the_file_says() {
    let slices = both().map(|slice| slice.with(text(0x0020_0037, "DS", "0\\1\\0\\0\\0\\-1")));
    let at = |slice: Slice, x: f64| slice.with(text(0x0020_0032, "DS", &format!("{x}\\5\\70")));
    let [a, b] = slices;
    // The normal, rows × columns, is −x.
    let opened = volume(folder_of(&[at(a.clone(), 8.0), at(b.clone(), 6.0)]).1);
    assert_corner_marked(&opened);
    let place = |index: [f64; 3]| opened.index_to_world().transform_point3(DVec3::from_array(index));
    assert_eq!(place([0.0; 3]), DVec3::new(8.0, 5.0, 70.0));
    // Three steps of 0.5 to the back, two of 2 to the feet, one of 2 along the normal.
    assert_eq!(place([3.0, 2.0, 1.0]), DVec3::new(6.0, 6.5, 66.0));
    // The other way round, slices change places, not samples theirs.
    let turned = volume(folder_of(&[at(a, 6.0), at(b, 8.0)]).1);
    assert_eq!(turned.value([0, 0, 0]), 5.0);
    let place = turned.index_to_world().transform_point3(DVec3::new(0.0, 0.0, 1.0));
    assert_eq!(place, DVec3::new(6.0, 5.0, 70.0));
}

#[test]
fn a_tilted_gantry_shears() {
    let at =
        |k: usize| Slice::of_corner_marked(k).with(text(0x0020_0032, "DS", &format!("0\\{}\\{}", k, 2 * k)));
    let opened = volume(folder_of(&[at(0), at(1)]).1);
    let place = opened.index_to_world().transform_point3(DVec3::new(0.0, 0.0, 1.0));
    assert!(place.abs_diff_eq(DVec3::new(0.0, 1.0, 2.0), 1e-12), "{place}");
}

#[test]
fn padding_gets_the_least_value() {
    // Slices of 12 signed bits with −2000 and −1999 in the first places, and −1 as the least elsewhere.
    let padded = |k: usize, limit: Option<i16>| {
        let mut slice = Slice::of_corner_marked(k).wide(12, true, |byte| (u16::from(byte)).wrapping_sub(3));
        slice.pixels[0][..4].copy_from_slice(&[0x30, 0xf8, 0x31, 0xf8]);
        slice = slice.with(short(0x0028_0120, (-2000_i16).cast_unsigned()));
        slice = slice.with(text(0x0028_1053, "DS", "2")).with(text(0x0028_1052, "DS", "-1024"));
        match limit {
            Some(limit) => slice.with(short(0x0028_0121, limit.cast_unsigned())),
            None => slice,
        }
    };
    for (limit, count, low) in [(None, 1, -1999.0), (Some(-1900), 2, -1.0), (Some(-2040), 1, -1999.0)] {
        for syntax in [EXPLICIT, IMPLICIT, BIG_ENDIAN] {
            let opened = folder_of(&[padded(0, limit).written(syntax)]).1.unwrap();
            let [Note::LeftOut(what)] = &opened.notes[..] else { panic!("{:?}", opened.notes) };
            assert!(what.contains(&format!("{count} samples of padding")), "{what}");
            let opened = volume(Ok(opened));
            let least = 2.0 * low - 1024.0;
            assert_eq!(opened.value_range().unwrap()[0], least);
            assert_eq!(opened.value([0; 3]), least);
        }
    }
    let mut all = padded(0, Some(2047));
    all.pixels[0].fill(0);
    refused(folder_of(&[all]).1, "", &["nothing but padding"]);
}

#[test]
fn slices_are_evenly_spaced() {
    let at = |z: f64| Slice::of_corner_marked(0).with(text(0x0020_0032, "DS", &format!("0\\0\\{z}")));
    let of = |places: &[f64]| folder_of(&places.iter().map(|z| at(*z)).collect::<Vec<_>>()).1;
    // Within a hundredth.
    let opened = volume(of(&[0.0, 1.005, 2.0, 3.0]));
    assert_eq!(opened.frame().spacing.z, 1.0);
    refused(
        of(&[0.0, 1.0, 2.0, 4.0, 5.0]),
        "",
        &["not evenly spaced", "2 apart", "others 1", "image3 and image2"],
    );
    // Places rounded to 0.01 leave steps of 0.32 and 0.33.
    assert!(of(&[0.0, 0.33, 0.65, 0.98]).is_ok());
    refused(of(&[0.0, 0.33, 0.65, 1.05]), "", &["not evenly spaced"]);
    let shifted = |x: f64, z: f64| at(z).with(text(0x0020_0032, "DS", &format!("{x}\\0\\{z}")));
    let (_, opened) =
        folder_of(&[shifted(0.0, 0.0), shifted(0.0, 2.0), shifted(5.0, 4.0), shifted(5.0, 6.0)]);
    refused(opened, "", &["not in line", "from image3 to image2", "by 5.000 in itself"]);
    refused(of(&[0.0, 1.0, 1.0, 2.0]), "", &["image2 and image3 are at one place"]);
    let unplaced =
        |k: usize| Slice::of_corner_marked(k).without(0x0020_0032).with(text(0x0018_0088, "DS", "7"));
    let (_, opened) = folder_of(&[unplaced(1), unplaced(0)]);
    let opened = opened.unwrap();
    assert!(matches!(&opened.notes[..], [Note::Assumed(text)] if text.contains("InstanceNumber")));
    let opened = volume(Ok(opened));
    assert_corner_marked(&opened);
    assert_eq!(opened.frame().spacing.z, 7.0);
    refused(folder_of(&[unplaced(0), unplaced(0)]).1, "", &["same InstanceNumber"]);
    refused(
        folder_of(&[unplaced(0), unplaced(1).without(0x0020_0013)]).1,
        "",
        &["neither a place nor an InstanceNumber"],
    );
}

#[test]
fn what_does_not_fit_is_named() {
    let refuse = |slice: Slice, parts: &[&str]| {
        Folder::new().refused("a.dcm", slice.file(), parts);
    };
    let one = || Slice::of_corner_marked(0);
    refuse(one().with(text(0x0028_0004, "CS", "RGB")).with(short(0x0028_0002, 3)), &["\"RGB\" of 3 samples"]);
    refuse(one().with(text(0x0028_0008, "IS", "12")), &["NumberOfFrames", "12 frames"]);
    refuse(one().with(short(0x0028_0100, 32)), &["BitsAllocated", "32 bits"]);
    refuse(one().with(short(0x0028_0102, 65535)), &["BitsStored", "up to bit 65535"]);
    refuse(one().with(short(0x0028_0103, 2)), &["PixelRepresentation"]);
    refuse(one().with(short(0x0028_0010, 0)), &["4x0 pixels"]);
    refuse(one().with(short(0x0028_0010, 4)), &["PixelData", "12 bytes", "need 16"]);
    refuse(one().without(0x0028_0011), &["Columns", "missing"]);
    refuse(one().with(text(0x0028_0030, "DS", "0\\1")), &["PixelSpacing", "above 0"]);
    refuse(one().with(text(0x0028_0030, "DS", "1")), &["PixelSpacing", "cannot be read"]);
    refuse(one().with(text(0x0020_0032, "DS", "1\\2")), &["ImagePositionPatient"]);
    refuse(one().with(text(0x0020_0037, "DS", "1\\0\\0\\1\\0\\0")), &["perpendicular unit vectors"]);
    let [a, b] = both();
    let (_, opened) = folder_of(&[a.clone(), b.with(text(0x0028_0030, "DS", "2\\0.6"))]);
    refused(opened, "", &["the slices differ", "spacing 2\\0.5", "spacing 2\\0.6", "image1"]);
    // 65535² pixels in a few bytes.
    let mut bomb = a.with(short(0x0028_0010, 65535)).with(short(0x0028_0011, 65535)).written(RLE);
    bomb.pixels = vec![rle(&bomb.pixels)];
    refuse(bomb, &["cannot hold 65535x65535"]);
    let options = OpenOptions { max_memory: 40, ..OpenOptions::default() };
    let deflated = one().written(DEFLATED).file();
    refused(Folder::new().open_with("a.dcm", deflated, &options), "a.dcm", &["more than 40 bytes"]);
    let (folder, _) = folder_of(&[one()]);
    let mut list = one();
    list.pixels = vec![Vec::new()];
    let mut bytes = list.file();
    // A file of no image, such as a DICOMDIR: without pixel data and what comes after.
    bytes.truncate(bytes.len() - 12);
    folder.write("DICOMDIR", &bytes);
    let opened = open(folder.path(), &OpenOptions::default()).unwrap();
    assert!(
        matches!(&opened.notes[..], [Note::LeftOut(text)] if text.contains("1 DICOM files of the folder"))
    );
    Folder::new().refused("a.dcm", &bytes, &["PixelData", "no image"]);
    Folder::new().refused("a.dcm", &bytes[132..], &["byte 128", "DICM is not there"]);
    Folder::new().refused("a.dcm", [&[0; 128][..], b"DICM"].concat(), &["byte 132", "no transfer syntax"]);
}
