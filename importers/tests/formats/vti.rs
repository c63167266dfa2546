use crate::common::{
    Folder, as_text, assert_corner_marked, base64, corner_marked, refused, volume, written, zlib,
};
use glam::{DMat3, DVec3};
use oblate_importers::OpenOptions;

/// A file around one array.
fn image(root: &str, array: &str, appended: &[u8]) -> Vec<u8> {
    let head = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" {root}>\n\
         <ImageData WholeExtent=\"0 3 0 2 0 1\" Origin=\"1 2 3\" Spacing=\"0.5 1 2\">\n\
         <Piece Extent=\"0 3 0 2 0 1\">\n<PointData Scalars=\"density\">\n{array}\n</PointData>\n\
         <CellData/>\n</Piece>\n</ImageData>\n"
    );
    [head.as_bytes(), appended, b"</VTKFile>\n"].concat()
}

/// Numbers of a header type in a byte order.
fn header(numbers: &[usize], header_type: &str, big: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    for &number in numbers {
        let mut one = (number as u64).to_le_bytes()[..if header_type == "UInt64" { 8 } else { 4 }].to_vec();
        if big {
            one.reverse();
        }
        bytes.extend(one);
    }
    bytes
}

/// The parts that base64 pads apart: header and data of compressed samples, all of uncompressed ones.
fn encoded(samples: &[u8], header_type: &str, big: bool, compressed: bool) -> Vec<Vec<u8>> {
    if !compressed {
        return vec![[header(&[samples.len()], header_type, big), samples.to_vec()].concat()];
    }
    let size = 11;
    let blocks: Vec<Vec<u8>> = samples.chunks(size).map(zlib).collect();
    let mut numbers = vec![blocks.len(), size, samples.len() % size];
    numbers.extend(blocks.iter().map(Vec::len));
    vec![header(&numbers, header_type, big), blocks.concat()]
}

fn vtk_name(rust: &str) -> String {
    let kind = match &rust[..1] {
        "u" => "UInt",
        "i" => "Int",
        _ => "Float",
    };
    format!("{kind}{}", &rust[1..])
}

#[test]
fn every_type_order_header_and_encoding() {
    let folder = Folder::new();
    for written in written() {
        for (order, big, samples) in
            [("LittleEndian", false, &written.little), ("BigEndian", true, &written.big)]
        {
            for header_type in ["UInt32", "UInt64"] {
                for (compressor, compressed) in [("", false), ("compressor=\"vtkZLibDataCompressor\"", true)]
                {
                    let root = format!("byte_order=\"{order}\" header_type=\"{header_type}\" {compressor}");
                    let array = |rest: &str, body: &str| {
                        let kind = vtk_name(written.name);
                        format!("<DataArray type=\"{kind}\" Name=\"density\" {rest}>{body}</DataArray>")
                    };
                    let parts = encoded(samples, header_type, big, compressed);
                    let text: String = parts.iter().map(|part| base64(part)).collect();
                    let offset = "format=\"appended\" offset=\"8\"";
                    let raw = [
                        b"<AppendedData encoding=\"raw\">\n _skipped>".as_slice(),
                        &parts.concat(),
                        b"</AppendedData>",
                    ]
                    .concat();
                    let coded = format!(
                        "<AppendedData encoding=\"base64\">_{}{text}\n</AppendedData>",
                        base64(&[0; 6])
                    );
                    let files = [
                        image(&root, &array("format=\"ascii\"", &as_text()), b""),
                        image(&root, &array("format=\"binary\"", &format!("\n  {text}\n")), b""),
                        image(&root, &array(offset, ""), &raw),
                        image(&root, &array(offset, ""), coded.as_bytes()),
                    ];
                    for (i, file) in files.iter().enumerate() {
                        let opened = folder.open("a.vti", file);
                        let opened =
                            volume(opened.inspect_err(|_| println!("{} {root} file {i}", written.name)));
                        assert_corner_marked(&opened);
                        assert_eq!(opened.voxels().type_name(), written.voxel_type);
                        assert_eq!(opened.frame().origin, DVec3::new(1.0, 2.0, 3.0));
                        assert_eq!(opened.frame().spacing, DVec3::new(0.5, 1.0, 2.0));
                    }
                }
            }
        }
    }
}

fn ascii() -> String {
    let array =
        format!("<DataArray type=\"UInt8\" Name=\"density\" format=\"ascii\">{}</DataArray>", as_text());
    String::from_utf8(image("byte_order=\"LittleEndian\"", &array, b"")).unwrap()
}

#[test]
fn frames() {
    let folder = Folder::new();
    let moved = ascii().replace("\"0 3 0 2 0 1\"", "\"-1 2 5 7 10 11\"");
    let moved = moved.replace("<ImageData", "<ImageData Direction=\"0 -1 0 1 0 0 0 0 1\"");
    let opened = folder.volume("a.vti", moved);
    assert_corner_marked(&opened);
    // Rows as written: the grid's x axis is the world's y, its y axis the world's -x.
    assert_eq!(opened.frame().direction, DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z));
    // Index (-1, 5, 10) is -0.5, 5, 20 along these from the origin.
    assert_eq!(opened.frame().origin, DVec3::new(1.0 - 5.0, 2.0 - 0.5, 3.0 + 20.0));
    let options = OpenOptions { spacing: Some(DVec3::ONE), ..OpenOptions::default() };
    assert_eq!(volume(folder.open_with("a.vti", ascii(), &options)).frame().spacing, DVec3::ONE);
}

/// What programs write into an array beside its numbers is none of them.
#[test]
fn keys_and_comments_of_arrays_are_passed_over() {
    let key =
        "<InformationKey name=\"UNITS_LABEL\" location=\"vtkDataArray\">1 2</InformationKey>\n<!-- 7 -->";
    let file = ascii().replace("</DataArray>", &format!("{key}</DataArray>"));
    assert_corner_marked(&Folder::new().volume("a.vti", file));
    let packed = [&24_u32.to_le_bytes()[..], &corner_marked()].concat();
    let array = format!(
        "<DataArray type=\"UInt8\" Name=\"density\" format=\"binary\">{key}{}</DataArray>",
        base64(&packed)
    );
    assert_corner_marked(&Folder::new().volume("a.vti", image("", &array, b"")));
}

/// Documents that would come to many times the file, or take quadratic time.
#[test]
fn documents_are_bounded() {
    let folder = Folder::new();
    let with = |text: &str| ascii().replace("<CellData/>", &format!("<CellData>{text}</CellData>"));
    folder.refused("a.vti", with(&"<a/>".repeat(1_000_000)), &["line 1", "far more than a file of"]);
    let attributes: String = (0..300).map(|i| format!(" a{i}=\"\"")).collect();
    folder.refused("a.vti", with(&format!("<a{attributes}/>")), &["line 12", "more than 256 attributes"]);
    let few: String = (0..200).map(|i| format!(" a{i}=\"\"")).collect();
    assert_corner_marked(&folder.volume("a.vti", with(&format!("<a{few}/>"))));
}

#[test]
fn cell_data_lie_half_a_spacing_in() {
    let cells = ascii().replace("<CellData/>", "").replace("PointData", "CellData");
    let cells = cells.replace("\"0 3 0 2 0 1\"", "\"0 4 0 3 0 2\"");
    let opened = Folder::new().volume("a.vti", &cells);
    assert_corner_marked(&opened);
    assert_eq!(opened.frame().origin, DVec3::new(1.25, 2.5, 4.0));
    let flat = cells.replace("\"0 4 0 3 0 2\"", "\"0 4 0 3 0 0\"");
    Folder::new().refused("a.vti", flat, &["cells along each axis"]);
}

#[test]
fn the_active_array_is_taken() {
    let folder = Folder::new();
    let other = "<DataArray type=\"UInt8\" Name=\"other\" format=\"ascii\">".to_owned()
        + &"9 ".repeat(24)
        + "</DataArray>";
    let colors =
        "<DataArray type=\"UInt8\" NumberOfComponents=\"3\" Name=\"rgb\" format=\"ascii\">1</DataArray>";
    let file = ascii().replace("<DataArray", &format!("{colors}{other}<DataArray"));
    assert_corner_marked(&folder.volume("a.vti", &file));
    // Without a name for the active one, or with that of a vector, the first scalar.
    for first in
        [file.replace(" Scalars=\"density\"", ""), file.replace("Scalars=\"density\"", "Scalars=\"rgb\"")]
    {
        assert_eq!(folder.volume("a.vti", first).value([0, 0, 0]), 9.0);
    }
    let vectors = ascii().replace("<DataArray", "<DataArray NumberOfComponents=\"3\"");
    folder.refused("a.vti", vectors, &["line 4", "one component", "\"density\" of 3"]);
}

#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let refuse = |from: &str, to: &str, parts: &[&str]| {
        assert!(ascii().contains(from), "{from}");
        folder.refused("a.vti", ascii().replace(from, to), parts);
    };
    refuse("Extent=\"0 3 0 2 0 1\"", "Extent=\"0 3 0 2 0 2\"", &["36 numbers"]);
    refuse("Extent=\"0 3 0 2 0 1\"", "Extent=\"0 3 0 2\"", &["line 3", "6 numbers"]);
    refuse("Extent=\"0 3 0 2 0 1\"", "Extent=\"3 0 0 2 0 1\"", &["line 3", "first and last"]);
    refuse("Extent=\"0 3 0 2 0 1\"", "Extent=\"0 999999999 0 999999999 0 999999999\"", &["more than memory"]);
    refuse("Extent=\"0 3 0 2 0 1\"", "Extent=\"0 99999 0 99999 0 99999\"", &["cannot write"]);
    refuse("Piece Extent=\"0 3 0 2 0 1\"", "Piece Extent=\"0 1 0 2 0 1\"", &["line 4", "WholeExtent"]);
    refuse("</Piece>", "</Piece><Piece Extent=\"0 3 0 2 0 1\"/>", &["several pieces"]);
    refuse("type=\"ImageData\"", "type=\"PolyData\"", &["PolyData"]);
    refuse("UInt8", "String", &["line 6", "String"]);
    refuse("UInt8", "UInt9", &["UInt9"]);
    refuse("ascii", "hex", &["hex", "appended"]);
    refuse("format=\"ascii\"", "format=\"appended\" offset=\"0\"", &["no AppendedData"]);
    refuse("LittleEndian", "MiddleEndian", &["MiddleEndian"]);
    refuse("Spacing=\"0.5 1 2\"", "Spacing=\"0.5 0 2\"", &["spacing", "above 0"]);
    refuse("</ImageData>", "", &["XML"]);
    // One level more than any file needs: refused, not followed.
    folder.refused("a.vti", "<VTKFile>".repeat(100_000), &["XML"]);
    let binary = |root: &str, body: &str| {
        let array = format!("<DataArray type=\"UInt8\" Name=\"d\" format=\"binary\">{body}</DataArray>");
        image(root, &array, b"")
    };
    let samples = [header(&[24], "UInt32", false), corner_marked()].concat();
    folder.refused(
        "a.vti",
        binary("", &base64(&samples[..9])),
        &["line 6", "24 bytes are expected, 5 are left"],
    );
    folder.refused("a.vti", binary("", "!"), &["base64"]);
    folder.refused(
        "a.vti",
        binary("compressor=\"vtkLZ4DataCompressor\"", &base64(&samples)),
        &["vtkLZ4DataCompressor"],
    );
    let bombs = [
        header(&[usize::MAX, 24, 0], "UInt64", false),
        header(&[1 << 60, 0, 24], "UInt64", false),
        header(&[1, 24, 0, usize::MAX], "UInt64", false),
        header(&[0, 0, 24], "UInt64", false),
    ];
    for bomb in bombs {
        folder.refused(
            "a.vti",
            binary("header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"", &base64(&bomb)),
            &["line 6"],
        );
    }
    let block = zlib(&vec![0; 1_000_000]);
    let bomb = [header(&[1, 24, 0, block.len()], "UInt32", false), block].concat();
    folder.refused(
        "a.vti",
        binary("compressor=\"vtkZLibDataCompressor\"", &base64(&bomb)),
        &["more than the 24 bytes"],
    );
}

#[test]
fn cut_short_anywhere() {
    let folder = Folder::new();
    let parts = encoded(&corner_marked(), "UInt32", false, true).concat();
    let array = "<DataArray type=\"UInt8\" Name=\"d\" format=\"appended\" offset=\"0\"/>";
    let whole = image(
        "compressor=\"vtkZLibDataCompressor\"",
        array,
        &[b"<AppendedData encoding=\"raw\">_".as_slice(), &parts].concat(),
    );
    let end = whole.len() - "</VTKFile>\n".len();
    assert_corner_marked(&folder.volume("a.vti", &whole[..end]));
    for length in 0..end {
        refused(folder.open("a.vti", &whole[..length]), "a.vti", &[]);
    }
}
