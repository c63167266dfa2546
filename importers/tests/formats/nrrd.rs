use crate::common::{Folder, as_text, assert_corner_marked, corner_marked, gzip, refused, volume, written};
use glam::{DMat3, DVec3};
use oblate_importers::OpenOptions;
use oblate_volumes::Space;

const PLAIN: &str = "NRRD0004\n# corners\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n";

fn with(header: &str, body: &[u8]) -> Vec<u8> {
    [header.as_bytes(), b"\n", body].concat()
}

#[test]
fn every_type_order_and_encoding() {
    let folder = Folder::new();
    let name_of = |rust: &str| {
        match rust {
            "u8" => "unsigned char",
            "i8" => "signed char",
            "u16" => "ushort",
            "i16" => "short",
            "f32" => "float",
            "f64" => "double",
            other => return format!("{}int{}", if other.starts_with('u') { "u" } else { "" }, &other[1..]),
        }
        .to_owned()
    };
    for written in written() {
        for (order, bytes) in [("little", &written.little), ("big", &written.big)] {
            for (encoding, body) in
                [("raw", bytes.clone()), ("gzip", gzip(bytes)), ("ascii", as_text().into_bytes())]
            {
                let fields = format!(
                    "NRRD0005\r\nkey:=a: value\r\ntype: {}\r\ndimension: 3\r\nsizes: 4 3 2\r\n\
                     endian: {order}\r\nencoding: {encoding}\r\nkinds: domain domain domain\r\n",
                    name_of(written.name)
                );
                let attached = [fields.as_bytes(), b"\r\n", &body].concat();
                let attached = folder.volume("a.nrrd", attached);
                assert_corner_marked(&attached);
                assert_eq!(attached.voxels().type_name(), written.voxel_type);
                folder.write("a.data", &body);
                let detached = folder.volume("a.nhdr", format!("{fields}data file: a.data\r\n"));
                assert_eq!(detached, attached);
            }
        }
    }
}

#[test]
fn frames() {
    let folder = Folder::new();
    let frame =
        |fields: &str| folder.volume("a.nrrd", with(&format!("{PLAIN}{fields}"), &corner_marked())).frame();
    assert_eq!(frame("").spacing, DVec3::ONE);
    assert_eq!(frame("spacings: 0.5 1 NaN\n").spacing, DVec3::new(0.5, 1.0, 1.0));
    let oblique = frame(
        "space: left-posterior-superior\nspace directions: (0,2,0) (-3,0,0) (0,0,0.5)\nspace origin: (1, 2, -3)\n",
    );
    assert_eq!(oblique.spacing, DVec3::new(2.0, 3.0, 0.5));
    assert_eq!(oblique.direction, DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z));
    assert_eq!(oblique.origin, DVec3::new(1.0, 2.0, -3.0));
    assert_eq!((oblique.space, frame("").space), (Some(Space::Lps), None));
    for (name, space) in
        [("RAS", Some(Space::Ras)), ("Left-Anterior-Superior", Some(Space::Las)), ("own", None)]
    {
        assert_eq!(frame(&format!("space: {name}\n")).space, space);
    }
    // Four samples between 0 and 4 as cells are 1 apart from 0.5 on; as nodes between 0 and 3, from 0 on.
    let cells = frame("axis mins: 0 0 0\naxis maxs: 4 3 4\ncenters: cell cell cell\n");
    assert_eq!((cells.spacing, cells.origin), (DVec3::new(1.0, 1.0, 2.0), DVec3::new(0.5, 0.5, 1.0)));
    let nodes = frame("axis mins: 1 0 0\naxis maxs: 4 2 2\n");
    assert_eq!((nodes.spacing, nodes.origin), (DVec3::new(1.0, 1.0, 2.0), DVec3::new(1.0, 0.0, 0.0)));
    // Falling coordinates turn an axis, as negative directions do.
    let turned = frame("axis mins: 3 0 0\naxis maxs: 0 2 2\n");
    assert_eq!((turned.spacing, turned.origin.x), (DVec3::new(1.0, 1.0, 2.0), 3.0));
    assert_eq!(turned.direction.x_axis, -DVec3::X);
    let spacing = DVec3::splat(7.0);
    let options = OpenOptions { spacing: Some(spacing), ..OpenOptions::default() };
    let bytes = with(&format!("{PLAIN}spacings: 1 2 3\n"), &corner_marked());
    assert_eq!(volume(folder.open_with("a.nrrd", bytes, &options)).frame().spacing, spacing);
}

#[test]
fn a_fourth_axis_of_one_sample() {
    let folder = Folder::new();
    let header = "NRRD0005\ntype: uchar\ndimension: 4\nsizes: 1 4 3 2\nencoding: raw\nkinds: list domain domain domain\n\
        space directions: none (1,0,0) (0,2,0) (0,0,3)\n";
    let opened = folder.volume("a.nrrd", with(header, &corner_marked()));
    assert_corner_marked(&opened);
    assert_eq!(opened.frame().spacing, DVec3::new(1.0, 2.0, 3.0));
    folder.refused(
        "a.nrrd",
        with("NRRD0005\ntype: uchar\ndimension: 4\nsizes: 3 4 2 1\nencoding: raw\nkinds: RGB-color domain domain domain\n", &corner_marked()),
        &["RGB-color".to_lowercase().as_str()],
    );
    folder.refused(
        "a.nrrd",
        with("NRRD0005\ntype: uchar\ndimension: 4\nsizes: 2 2 3 2\nencoding: raw\n", &corner_marked()),
        &["line 3", "three axes"],
    );
    folder.refused(
        "a.nrrd",
        with("NRRD0005\ntype: uchar\ndimension: 2\nsizes: 4 6\nencoding: raw\n", &corner_marked()),
        &["three axes"],
    );
}

#[test]
fn skipped_lines_and_bytes() {
    let folder = Folder::new();
    let body = [b"two\nlines\n?".as_slice(), &corner_marked()].concat();
    for skip in ["line skip: 2\nbyte skip: 1\n", "byte skip: -1\n", "byteskip: 11\n"] {
        assert_corner_marked(&folder.volume("a.nrrd", with(&format!("{PLAIN}{skip}"), &body)));
    }
    let gzipped = PLAIN.replace("raw", "gzip") + "byte skip: 1\n";
    let marked = [b"?".as_slice(), &corner_marked()].concat();
    assert_corner_marked(&folder.volume("a.nrrd", with(&gzipped, &gzip(&marked))));
    folder.refused("a.nrrd", with(&format!("{PLAIN}line skip: 9\n"), &body), &["line 7", "9 lines"]);
    folder.refused("a.nrrd", with(&format!("{PLAIN}byte skip: 900\n"), &body), &["byte skip"]);
}

#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let samples = corner_marked();
    let refuse = |from: &str, to: &str, parts: &[&str]| {
        assert!(PLAIN.contains(from));
        folder.refused("a.nrrd", with(&PLAIN.replace(from, to), &samples), parts);
    };
    refuse("sizes: 4 3 2", "sizes: 4 3 3", &["24 bytes", "need 36"]);
    refuse("sizes: 4 3 2", "sizes: 4 3 1", &["24 bytes", "need 12"]);
    refuse("sizes: 4 3 2", "sizes: 4 3 0", &["above 0"]);
    refuse("sizes: 4 3 2", "sizes: 4 3", &["line 4", "dimension is 3"]);
    refuse("sizes: 4 3 2", "sizes: 4 3 -2", &["line 5", "must be numbers"]);
    refuse("sizes: 4 3 2", "sizes: 4000000000 4000000000 4000000000", &["more than memory"]);
    refuse("encoding: raw", "encoding: bzip2", &["line 6", "bzip2", "gzip"]);
    refuse("type: uchar", "type: block", &["line 3", "block"]);
    refuse("type: uchar", "type: short", &["endian"]);
    refuse("type: uchar\n", "", &["lacks \"type\""]);
    refuse("type: uchar\n", "type uchar\n", &["line 3", "field: value"]);
    refuse("raw", "raw\nspacings: 1 0 1", &["spacing", "above 0"]);
    refuse("raw", "raw\nspace directions: (1,0,0) (2,0,0) (0,0,1)", &["direction", "span"]);
    refuse("raw", "raw\nspace directions: (1,0) (2,0)", &["line 7", "(1,0,0)"]);
    refuse("raw", "raw\nspace directions: (1,0,0)", &["line 7", "each spatial axis"]);
    refuse("raw", "raw\ndata file: gone.raw", &["line 7", "gone.raw"]);
    refuse("raw", "raw\ndata file: LIST", &["line 7", "several files"]);
    refuse("raw", "raw\ndata file: LIST 2\na.raw\nb.raw", &["line 7", "several files"]);
    refuse("raw", "ascii", &["24 bytes of text cannot write 24 numbers"]);
    let text = |text: &str| with(&PLAIN.replace("raw", "ascii"), text.as_bytes());
    folder.refused("a.nrrd", text(&as_text().replace("20", "300")), &["\"300\"", "sample 10"]);
    folder.refused("a.nrrd", text(&format!("{} 1", as_text())), &["24", "more"]);
    folder.refused("a.nrrd", text(&as_text().replace("20", "ten")), &["\"ten\"", "sample 10", "no number"]);
    folder.refused("a.nrrd", text("1 2 3"), &["24 numbers"]);
    folder.refused("a.nrrd", text("1 2 3                                              "), &["only 3"]);
    folder.refused("a.nrrd", PLAIN, &["empty line"]);
    let fields: String = (0..150_000).map(|i| format!("f{i}: 1\n")).collect();
    folder.refused(
        "a.nrrd",
        with(&(PLAIN.to_owned() + &fields), &samples),
        &["header has more than 1048576"],
    );
    folder.refused("a.nrrd", "no nrrd", &["NRRD0001"]);
    let gzipped = with(&PLAIN.replace("raw", "gzip"), &gzip(&samples)[..20]);
    folder.refused("a.nrrd", gzipped, &["break off"]);
}

#[test]
fn numbers_that_f32_cannot_hold_are_refused() {
    let folder = Folder::new();
    let header = |kind: &str| {
        format!("NRRD0004\ntype: {kind}\ndimension: 3\nsizes: 2 1 1\nendian: little\nencoding: raw\n")
    };
    let ints: Vec<u8> = [1 << 24, (1 << 24) + 1].iter().flat_map(|v: &i32| v.to_le_bytes()).collect();
    folder.refused("a.nrrd", with(&header("int"), &ints), &["sample 1", "16777217"]);
    let doubles: Vec<u8> = [f64::NAN, 1e300].iter().flat_map(|v| v.to_le_bytes()).collect();
    folder.refused("a.nrrd", with(&header("double"), &doubles), &["sample 1", "rescale"]);
    let doubles: Vec<u8> = [f64::NAN, 0.1].iter().flat_map(|v| v.to_le_bytes()).collect();
    let opened = folder.volume("a.nrrd", with(&header("double"), &doubles));
    assert!(opened.value([0, 0, 0]).is_nan());
    assert_eq!(opened.value([1, 0, 0]), 0.1);
}

#[test]
fn cut_short_anywhere() {
    let folder = Folder::new();
    let whole = with(PLAIN, &corner_marked());
    for length in 0..whole.len() {
        let opened = folder.open("a.nrrd", &whole[..length]);
        refused(opened, "a.nrrd", &[]);
    }
}
