use crate::common::{
    Folder, as_text, assert_corner_marked, assert_corners_at, corner_marked, gzip, refused, volume, written,
    zlib,
};
use oblate_importers::{Note, OpenOptions, Opened};

/// A header with lines before the last one.
fn header(rest: &str, data: &str) -> String {
    format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nDimSize = 4 3 2\n{rest}ElementType = MET_UCHAR\n\
         ElementDataFile = {data}\n"
    )
}

fn local(rest: &str) -> Vec<u8> {
    [header(rest, "LOCAL").into_bytes(), corner_marked()].concat()
}

fn element_type(rust: &str) -> &'static str {
    match rust {
        "u8" => "MET_UCHAR",
        "i8" => "MET_CHAR",
        "u16" => "MET_USHORT",
        "i16" => "MET_SHORT",
        "i32" => "MET_INT",
        "u32" => "MET_ULONG",
        "i64" => "MET_LONG_LONG",
        "u64" => "MET_ULONG_LONG",
        "f32" => "MET_FLOAT",
        _ => "MET_DOUBLE",
    }
}

#[track_caller]
fn noted(opened: &Opened) -> String {
    assert_eq!(opened.notes.len(), 1, "{:?}", opened.notes);
    opened.notes[0].to_string()
}

#[test]
fn every_type_order_and_encoding() {
    let folder = Folder::new();
    for written in written() {
        for (order, samples) in [("False", &written.little), ("True", &written.big)] {
            for name in ["BinaryDataByteOrderMSB", "ElementByteOrderMSB"] {
                let with = |rest: &str, data: &str| {
                    header(&format!("{name} = {order}\n{rest}"), data)
                        .replace("MET_UCHAR", element_type(written.name))
                        .into_bytes()
                };
                let packed = zlib(samples);
                folder.write("a.raw", [b"head".as_slice(), samples].concat());
                folder.write("a.zraw", gzip(samples));
                let size = format!("CompressedData = True\nCompressedDataSize = {}\n", packed.len());
                let text = with("", "LOCAL");
                let text =
                    String::from_utf8(text).unwrap().replace("BinaryData = True", "BinaryData = False");
                let files = [
                    [with("", "LOCAL"), samples.clone()].concat(),
                    [with(&size, "LOCAL"), packed.clone(), b"and more".to_vec()].concat(),
                    [with("CompressedData = True\n", "local"), packed].concat(),
                    with("HeaderSize = 4\n", "a.raw"),
                    with("HeaderSize = -1\n", "a.raw"),
                    with("CompressedData = True\n", "a.zraw"),
                    (text + &as_text()).into_bytes(),
                ];
                for (i, file) in files.iter().enumerate() {
                    let opened = folder.open("a.mha", file);
                    let opened =
                        volume(opened.inspect_err(|_| println!("{} {order} file {i}", written.name)));
                    assert_corner_marked(&opened);
                    assert_eq!(opened.voxels().type_name(), written.voxel_type);
                }
            }
        }
    }
}

#[test]
fn corners_lie_where_the_header_says() {
    let folder = Folder::new();
    let corners = |rest: &str, origin, steps| {
        assert_corners_at(&folder.volume("a.mha", local(rest)), origin, steps);
    };
    corners("", [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    corners(
        "Position = 10 -20 30\nElementSize = 0.7 2 3\n",
        [10.0, -20.0, 30.0],
        [[0.7, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]],
    );
    // ElementSpacing rules over ElementSize; a negative one turns its axis.
    corners(
        "Origin = 1 2 3\nElementSpacing = 1 -2 3\nElementSize = 9 9 9\nCenterOfRotation = 5 5 5\n",
        [1.0, 2.0, 3.0],
        [[1.0, 0.0, 0.0], [0.0, -2.0, 0.0], [0.0, 0.0, 3.0]],
    );
    // Three numbers after three are the axes' directions: with ITK, index (1, 0, 0) of such a file is at (10, 21, 30), (0, 1, 0) at
    // (10, 20, 28) and (0, 0, 1) at (13, 20, 30).
    for name in ["TransformMatrix", "Rotation", "Orientation"] {
        corners(
            &format!("Offset = 10 20 30\nElementSpacing = 1 -2 3\n{name} = 0 1 0 0 0 1 1 0 0\n"),
            [10.0, 20.0, 30.0],
            [[0.0, 1.0, 0.0], [0.0, 0.0, -2.0], [3.0, 0.0, 0.0]],
        );
    }
    // An oblique frame, left-handed.
    corners(
        "Offset = 1 0 0\nElementSpacing = 2 2 5\nTransformMatrix = 0.6 0.8 0 -0.8 0.6 0 0 0 -1\n",
        [1.0, 0.0, 0.0],
        [[1.2, 1.6, 0.0], [-1.6, 1.2, 0.0], [0.0, 0.0, -5.0]],
    );
    // Of four axes the first three.
    let four =
        "Offset = 1 2 3 9\nElementSpacing = 2 3 4 9\nTransformMatrix = 0 1 0 0 1 0 0 0 0 0 1 0 0 0 0 1\n";
    let file = String::from_utf8_lossy(&local(four)).replace("NDims = 3", "NDims = 4");
    assert_corners_at(
        &folder.volume("a.mha", file.replace("4 3 2\n", "4 3 2 1\n")),
        [1.0, 2.0, 3.0],
        [[0.0, 2.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 4.0]],
    );
    let options = OpenOptions { spacing: Some(glam::DVec3::splat(7.0)), ..OpenOptions::default() };
    let opened = volume(folder.open_with("a.mha", local("ElementSpacing = 1 -2 3\n"), &options));
    assert_eq!(opened.frame().spacing, glam::DVec3::splat(7.0));
    assert_eq!(opened.frame().space, Some(oblate_volumes::Space::Lps));
}

#[test]
fn slices_of_a_list() {
    let folder = Folder::new();
    let samples = corner_marked();
    folder.write("1.raw", &samples[..12]);
    folder.write("2.raw", &samples[12..]);
    for list in ["LIST", "LIST 2", "LIST 2D"] {
        let file = header("", list) + "1.raw\r\n2.raw\n";
        assert_corner_marked(&folder.volume("a.mhd", file));
    }
    let rows: String = (0..6).map(|row| format!("row{row}\n")).collect();
    for (row, bytes) in samples.chunks(4).enumerate() {
        folder.write(&format!("row{row}"), bytes);
    }
    assert_corner_marked(&folder.volume("a.mhd", header("", "LIST 1") + &rows));
    folder.refused("a.mhd", header("", "LIST") + "1.raw\n", &["line 6", "names 1 files; DimSize needs 2"]);
    folder.refused("a.mhd", header("", "LIST 3") + "1.raw\n", &["line 6", "1 to 2 axes"]);
    folder.refused("a.mhd", header("", "LIST") + "1.raw\n3.raw\n", &["line 8", "3.raw", "cannot be read"]);
    folder.write("2.raw", &samples[13..]);
    let short = folder.open("a.mhd", header("", "LIST") + "1.raw\n2.raw\n");
    refused(short, "2.raw", &["11 bytes of samples; 12 are expected"]);
    let limit = OpenOptions { max_memory: 23, ..OpenOptions::default() };
    let much = folder.open_with("a.mhd", header("", "LIST") + "1.raw\n1.raw\n", &limit);
    refused(much, "a.mhd", &["more than 23 bytes"]);
    // What is read of files of which little is used counts too.
    folder.write("1.raw", [0; 900]);
    let limit = OpenOptions { max_memory: 1000, ..OpenOptions::default() };
    let often = folder.open_with("a.mhd", header("", "LIST") + "1.raw\n1.raw\n", &limit);
    refused(often, "a.mhd", &["line 8", "more than 1000 bytes"]);
}

#[test]
fn what_is_not_taken_as_it_stands_is_noted() {
    let folder = Folder::new();
    let long = folder.open("a.mha", [local(""), vec![0; 3]].concat()).unwrap();
    assert_eq!(noted(&long), "left out: 3 bytes after the samples");
    let slope = "ElementToIntensityFunctionSlope = 2\nElementToIntensityFunctionOffset = 0\n";
    let sloped = folder.open("a.mha", local(slope)).unwrap();
    assert!(noted(&sloped).contains("ElementToIntensityFunctionSlope 2"));
    let shorts = String::from_utf8(local("")).unwrap().replace("MET_UCHAR", "MET_SHORT") + &"\0".repeat(24);
    let orderless = folder.open("a.mha", shorts).unwrap();
    assert!(matches!(&orderless.notes[..], [Note::Assumed(what)] if what.contains("little-endian")));
}

#[test]
fn told_by_its_beginning() {
    let folder = Folder::new();
    assert_corner_marked(&folder.volume("a", local("")));
    let file = String::from_utf8(local("")).unwrap().replace("ObjectType = Image\n", "");
    assert_corner_marked(&folder.volume("b", file.replace(" = ", ": ")));
}

#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let refuse = |from: &str, to: &str, parts: &[&str]| {
        let file = String::from_utf8(local("Offset = 1 2 3\nElementNumberOfChannels = 1\n")).unwrap();
        assert!(file.contains(from), "{from}");
        folder.refused("a.mha", file.replace(from, to), parts);
    };
    refuse("DimSize = 4 3 2", "DimSize = 4 3 3", &["24 bytes of samples; 36 are expected"]);
    refuse("DimSize = 4 3 2", "DimSize = 4 3", &["line 4", "NDims = 3 numbers"]);
    refuse("DimSize = 4 3 2", "DimSize = 4 3 0", &["4x3x0", "above 0"]);
    refuse("DimSize = 4 3 2", "DimSize = 4294967296 4294967296 4294967296", &["more than memory"]);
    refuse("DimSize = 4 3 2", "DimSize = 65536 65536 65536", &["24 bytes of samples"]);
    refuse("NDims = 3\nBinaryData = True\nDimSize = 4 3 2", "NDims = 2\nDimSize = 4 6", &["three axes"]);
    refuse(
        "NDims = 3\nBinaryData = True\nDimSize = 4 3 2",
        "NDims = 4\nDimSize = 4 3 1 2",
        &["line 2", "last has one"],
    );
    refuse("NDims = 3\n", "", &["lacks NDims"]);
    refuse("= Image", "= Tube", &["line 1", "Tube"]);
    refuse("MET_UCHAR", "MET_UCHAR_ARRAY", &["line 7", "MET_UCHAR_ARRAY"]);
    refuse("Channels = 1", "Channels = 3", &["line 6", "3; 1 is supported"]);
    refuse("Offset = 1 2 3", "Offset = 1 2", &["line 5", "must be 3 numbers"]);
    refuse("Offset = 1 2 3", "Offset = 1 nan 3", &["origin", "finite"]);
    refuse("Offset = 1 2 3", "ElementSpacing = 1 0 3", &["spacing", "above 0"]);
    refuse("Offset = 1 2 3", "TransformMatrix = 1 0 0 1 0 0 0 0 1", &["direction", "span space"]);
    refuse("Offset = 1 2 3", "Offset", &["line 5", "Field = value"]);
    refuse("BinaryData = True", "BinaryData = perhaps", &["line 3", "True or False"]);
    refuse("BinaryData = True", "HeaderSize = -2", &["line 3", "number of bytes"]);
    refuse("BinaryData = True", "HeaderSize = 9999", &["0 bytes of samples"]);
    refuse("BinaryData = True", "HeaderSize = -1\nCompressedData = True", &["line 3", "compressed"]);
    refuse(
        "BinaryData = True",
        "CompressedData = True\nCompressedDataSize = 25",
        &["is 25; there are 24 bytes"],
    );
    refuse("BinaryData = True", "CompressedData = True", &["compressed data break off"]);
    refuse("LOCAL", "a%03d.raw 1 2 1", &["line 8", "LIST"]);
    refuse("LOCAL", "nowhere.raw", &["line 8", "nowhere.raw", "cannot be read"]);
    refuse("ElementDataFile = LOCAL", "", &["line 9", "Field = value"]);
    refuse("ElementDataFile = LOCAL", &"\u{1}".repeat(5000), &["line 8", "text of at most 4096 bytes"]);
    // A mark of UTF-8 hides no field.
    let mark = "\u{feff}".as_bytes();
    assert_corner_marked(&folder.volume("told by what it holds", [mark, &local("")].concat()));
    let scene = String::from_utf8(local("")).unwrap().replace("= Image", "= Scene");
    folder.refused("a.mha", format!("\u{feff}{scene}"), &["line 1", "ObjectType \"Scene\""]);
    folder.refused("a.mha", "NDims = 3\n", &["lacks ElementDataFile"]);
    let fields: String = (0..150_000).map(|i| format!("f{i} = 1\n")).collect();
    folder.refused("a.mha", header(&fields, "LOCAL"), &["header has more than 1048576 bytes"]);
    let bomb = [header("CompressedData = True\n", "LOCAL").into_bytes(), zlib(&vec![0; 1_000_000])].concat();
    folder.refused("a.mha", bomb, &["more than the 24 bytes"]);
    let packed = [header("CompressedData = True\n", "LOCAL").into_bytes(), zlib(&corner_marked())].concat();
    let limit = OpenOptions { max_memory: 23, ..OpenOptions::default() };
    refused(folder.open_with("a.mha", packed, &limit), "a.mha", &["more than 23 bytes"]);
}
