use crate::common::{DIMS, Folder, assert_corner_marked, corner_marked, gzip, refused, volume};
use crate::tiff::{LITTLE, fields};
use glam::DVec3;
use oblate_importers::{Endian, ImportError, Note, OpenOptions, Opened, RawLayout, SampleType, open};
use std::io::Cursor;

const PLANE: usize = DIMS[0] * DIMS[1];

/// The slices of the corner-marked volume, each made a file.
fn planes(file: impl Fn(&[u8]) -> Vec<u8>) -> Vec<Vec<u8>> {
    corner_marked().chunks(PLANE).map(file).collect()
}

fn folder_of(files: &[(&str, Vec<u8>)]) -> Folder {
    let folder = Folder::new();
    for (name, bytes) in files {
        folder.write(name, bytes);
    }
    folder
}

fn opened(files: &[(&str, Vec<u8>)]) -> Result<Opened, ImportError> {
    open(folder_of(files).path(), &OpenOptions::default())
}

fn with_dims(files: &[(&str, Vec<u8>)], dims: [usize; 3]) -> Result<Opened, ImportError> {
    let raw = Some(RawLayout { dims, sample_type: SampleType::U8, endian: Endian::Little });
    open(folder_of(files).path(), &OpenOptions { raw, ..OpenOptions::default() })
}

fn png(samples: &[u8], color: image::ExtendedColorType) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let (width, height) = (DIMS[0] as u32, DIMS[1] as u32);
    image::write_buffer_with_format(&mut bytes, samples, width, height, color, image::ImageFormat::Png)
        .unwrap();
    bytes.into_inner()
}

fn grey_png(samples: &[u8]) -> Vec<u8> {
    png(samples, image::ExtendedColorType::L8)
}

fn pgm(samples: &[u8]) -> Vec<u8> {
    [b"P5 # a comment\n4\n3 255\n", samples].concat()
}

/// `file` and what it should say.
fn tiff(samples: &[u8]) -> Vec<u8> {
    LITTLE.file(&[(fields([DIMS[0], DIMS[1]], 8, 1), samples.to_vec())], None)
}

#[test]
fn images_of_every_kind() {
    let text = |samples: &[u8]| {
        let words: Vec<String> = samples.iter().map(u8::to_string).collect();
        format!("P2\n4 3\n255\n{}\n", words.join("\n")).into_bytes()
    };
    for (extension, file) in
        [("png", grey_png as fn(&[u8]) -> Vec<u8>), ("pgm", pgm), ("pgm", text), ("tif", tiff)]
    {
        let slices = planes(file);
        let names = [format!("slice_009.{extension}"), format!("slice_10.{extension}")];
        let opened = opened(&[(&names[1], slices[1].clone()), (&names[0], slices[0].clone())]).unwrap();
        assert_eq!(opened.notes, [], "{extension}");
        let opened = volume(Ok(opened));
        assert_corner_marked(&opened);
        assert_eq!(opened.voxels().type_name(), "u8");
    }
    // 16 bits in the orders of the formats; a PGM's numbers stay what they are, whatever the largest may be.
    let wide = |samples: &[u8]| samples.iter().flat_map(|s| u16::from(*s).to_ne_bytes()).collect::<Vec<_>>();
    let png = planes(|samples| png(&wide(samples), image::ExtendedColorType::L16));
    let pgm = planes(|samples| {
        let samples: Vec<u8> = samples.iter().flat_map(|s| u16::from(*s).to_be_bytes()).collect();
        [b"P5\n4 3\n4095\n", &samples[..]].concat()
    });
    for slices in [png, pgm] {
        let opened = volume(opened(&[("0", slices[0].clone()), ("1", slices[1].clone())]));
        assert_corner_marked(&opened);
        assert_eq!(opened.voxels().type_name(), "u16");
    }
}

#[test]
fn raw_slices() {
    let slices = planes(<[u8]>::to_vec);
    let numbered = [("CThead.10", slices[1].clone()), ("CThead.9", slices[0].clone())];
    for depth in [1, 2] {
        let opened = with_dims(&numbered, [DIMS[0], DIMS[1], depth]);
        assert_corner_marked(&volume(opened));
    }
    refused(with_dims(&numbered, [4, 3, 3]), "CThead.9", &["dims 4x3x3 have 3 slices", "the folder has 2"]);
    refused(with_dims(&numbered, [4, 4, 1]), "CThead.9", &["12 bytes", "4x4 of u8 has 16"]);
    refused(opened(&numbered), "CThead.9", &["give their dims"]);
    // Names say the same, and a third number in them doesn't change.
    let named = [("head_0_4x3_u8.raw", slices[0].clone()), ("head_1_4x3_u8.raw", slices[1].clone())];
    let folder = folder_of(&named);
    let spacing = Some(DVec3::new(1.0, 1.0, 2.0));
    let opened = volume(open(folder.path(), &OpenOptions { spacing, ..OpenOptions::default() }));
    assert_corner_marked(&opened);
    assert_eq!(opened.frame().spacing.z, 2.0);
}

#[test]
fn other_files_of_the_folder_are_left_out() {
    let slices = planes(pgm);
    let files = [
        ("a1.pgm", slices[0].clone()),
        ("a2.pgm", slices[1].clone()),
        ("README.txt", b"two slices".to_vec()),
        (".hidden.pgm", Vec::new()),
    ];
    let opened = opened(&files).unwrap();
    assert!(
        matches!(&opened.notes[..], [Note::LeftOut(text)] if text.contains("1 files") && text.contains("README.txt"))
    );
    assert_corner_marked(&volume(Ok(opened)));
}

#[test]
fn numbers_go_in_equal_steps() {
    let slice = planes(pgm).remove(0);
    let of = |names: &[&str]| opened(&names.iter().map(|name| (*name, slice.clone())).collect::<Vec<_>>());
    assert_eq!(volume(of(&["a0.pgm", "a5.pgm", "a10.pgm"])).dims(), [4, 3, 3]);
    assert_eq!(volume(of(&["a7.pgm"])).dims(), [4, 3, 1]);
    assert_eq!(volume(of(&["a1.pgm", "A2.PGM"])).dims(), [4, 3, 2]);
    refused(of(&["a1.pgm", "a2.pgm", "a4.pgm"]), "", &["slice 3 is missing", "a2.pgm is followed by a4.pgm"]);
    refused(of(&["a1.pgm", "a01.pgm"]), "", &["a01.pgm and a1.pgm have the same number"]);
    refused(of(&["a1.pgm", "b2.pgm"]), "", &["a1.pgm and b2.pgm differ in more than a number"]);
    refused(of(&["a1_1.pgm", "a2_2.pgm"]), "", &["two numbers"]);
    refused(of(&["a.pgm"]), "", &["a.pgm has no number"]);
    refused(of(&["a1.pgm", "a99999999999999999999.pgm"]), "", &["too large"]);
    refused(of(&["a1.pgm", "a2.png"]), "", &["as many files like a1.pgm as like a2.png"]);
    refused(of(&[]), "", &["no files in it"]);
}

#[test]
fn slices_must_be_alike_and_grey() {
    let slice = planes(pgm).remove(0);
    let second = |bytes: &[u8], parts: &[&str]| {
        let opened = opened(&[("a1.pgm", slice.clone()), ("a2.pgm", bytes.to_vec())]);
        refused(opened, "a2.pgm", parts);
    };
    second(b"P5\n3 4\n255\n123456789012", &["3x4 samples of U8, but a1.pgm has 4x3"]);
    second(b"P5\n1 1\n256\n..", &["1x1 samples of U16"]);
    second(b"P5\n4 3\n255\n12345678901", &["11 bytes of samples", "need 12"]);
    second(b"P5\n4 3\n70000\n12345678901", &["70000", "at most 65535"]);
    second(b"P5\n4\n", &["height above 0"]);
    second(b"P2\n4 3\n255\n1 2 3 4 5 6 7 8 9 10 11 300", &["\"300\""]);
    second(b"P2\n90000 90000\n255\n1", &["cannot write"]);
    // A PNG of 4 bits, whose samples would be stretched: of the header the number of bits matters.
    let mut few = grey_png(&[9; 12]);
    few[24] = 4;
    second(&few, &["4 bits a sample", "8 or 16"]);
    second(&png(&[9; 36], image::ExtendedColorType::Rgb8), &["Rgb8", "greyscale of 8 or 16 bits"]);
    second(&png(&[9; 24], image::ExtendedColorType::La8), &["La8"]);
    second(&tiff(&[9; 12])[..40], &["bytes"]);
    let pages = [(fields([1, 1], 8, 1), vec![1]), (fields([1, 1], 8, 1), vec![1])];
    second(&LITTLE.file(&pages, None), &["2 pages, but a picture has one"]);
    second(b"ply\nformat ascii 1.0\n", &["PLY, which is no slice"]);
    second(&gzip(&[0; 12]), &["give their dims"]);
    // A PNG of 60000² pixels in a few bytes: its sizes are at byte 16.
    let mut bomb = grey_png(&[9; 12]);
    bomb.splice(16..24, [60_000_u32.to_be_bytes(), 60_000_u32.to_be_bytes()].concat());
    let opened = opened(&[("a1.png", bomb)]);
    refused(opened, "a1.png", &[]);
}

/// Slices cut at every byte and with every byte changed: any outcome but a panic.
#[test]
fn broken_slices() {
    let folder = Folder::new();
    folder.write("a1", pgm(&[7; PLANE]));
    for bytes in [pgm(&[9; PLANE]), grey_png(&[9; PLANE]), tiff(&[9; PLANE])] {
        folder.write("a2", &bytes);
        assert_eq!(volume(open(folder.path(), &OpenOptions::default())).dims(), [4, 3, 2]);
        let mut copy = bytes.clone();
        for at in 0..bytes.len() {
            for mask in [1 << (at % 8), 0xff] {
                copy[at] ^= mask;
                folder.write("a2", &copy);
                copy[at] = bytes[at];
                let _ = open(folder.path(), &OpenOptions::default());
            }
            folder.write("a2", &bytes[..at]);
            assert!(open(folder.path(), &OpenOptions::default()).is_err() || at + 8 > bytes.len());
        }
    }
}
