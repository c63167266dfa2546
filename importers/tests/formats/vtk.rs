use crate::common::{
    DIMS, Folder, as_text, assert_corner_marked, assert_corners_at, corner_marked, irregular, refused,
    volume, written,
};
use glam::DVec3;
use oblate_importers::OpenOptions;
use oblate_volumes::Arrangement;

const POINTS: &str =
    "DATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nORIGIN 1 2 3\nSPACING 0.5 1 -2\nPOINT_DATA 24\n";
const SCALARS: &str = "SCALARS density unsigned_char\nLOOKUP_TABLE default\n";
const STEPS: [[f64; 3]; 3] = [[0.5, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -2.0]];

/// A legacy file: its second line, what follows, samples.
fn file(encoding: &str, rest: &str, samples: &[u8]) -> Vec<u8> {
    [format!("# vtk DataFile Version 3.0\na title\n{encoding}\n{rest}").as_bytes(), samples, b"\n"].concat()
}

/// Structured points with scalars.
pub(crate) fn legacy(encoding: &str, samples: &[u8]) -> Vec<u8> {
    file(encoding, &format!("{POINTS}{SCALARS}"), samples)
}

/// A rectilinear grid with cell data in a field.
pub(crate) fn rectilinear_legacy() -> Vec<u8> {
    file(
        "ASCII",
        "DATASET RECTILINEAR_GRID\nDIMENSIONS 5 4 3\nX_COORDINATES 5 float\n0 1 2 3 4\nY_COORDINATES 4 int\n\
         6 4 2 0\nZ_COORDINATES 3 double\n-1 -0.5 0\nCELL_DATA 24\nFIELD FieldData 1\ndensity 1 24 short\n",
        as_text().as_bytes(),
    )
}

/// A rectilinear grid in XML, with ascii arrays.
pub(crate) fn rectilinear_xml() -> String {
    xml(["0 2 4 6", "1 0.5 0", "10 13"])
}

fn xml(coordinates: [&str; 3]) -> String {
    let coordinates: String = coordinates
        .map(|text| format!("<DataArray type=\"Float32\" format=\"ascii\">{text}</DataArray>"))
        .concat();
    format!(
        "<VTKFile type=\"RectilinearGrid\"><RectilinearGrid WholeExtent=\"0 3 0 2 0 1\"><Piece Extent=\"0 3 0 2 0 1\">\
         <PointData><DataArray type=\"UInt8\" format=\"ascii\">{}</DataArray></PointData><Coordinates>{coordinates}\
         </Coordinates></Piece></RectilinearGrid></VTKFile>",
        as_text()
    )
}

/// Where the points of test grids are: no two steps are alike.
pub(crate) fn place(index: [usize; 3]) -> DVec3 {
    let [i, j, k] = index.map(|i| i as f64);
    DVec3::new(i + 0.25 * i * i + 0.125 * k, 2.0 * j + 0.25 * i, 0.5 * k + 0.25 * k * k + 0.125 * j)
}

/// All of a grid, the first axis the fastest.
pub(crate) fn places([nx, ny, nz]: [usize; 3]) -> Vec<DVec3> {
    let index = |n: usize| [n % nx, n / nx % ny, n / (nx * ny)];
    (0..nx * ny * nz).map(|n| place(index(n))).collect()
}

/// A curvilinear grid with the corner-marked samples.
pub(crate) fn structured_legacy(encoding: &str) -> Vec<u8> {
    let coordinates = places(DIMS).into_iter().flat_map(|point| point.to_array());
    let (numbers, samples) = if encoding == "BINARY" {
        (coordinates.flat_map(|c| (c as f32).to_be_bytes()).collect(), corner_marked())
    } else {
        (coordinates.map(|c| format!("{c} ")).collect::<String>().into_bytes(), as_text().into_bytes())
    };
    let head = b"DATASET STRUCTURED_GRID\nDIMENSIONS 4 3 2\nPOINTS 24 float\n".as_slice();
    let rest = [head, &numbers, format!("\nPOINT_DATA 24\n{SCALARS}").as_bytes(), &samples].concat();
    let whole = file(encoding, "", b"");
    [&whole[..whole.len() - 1], &rest].concat()
}

/// The same in XML.
pub(crate) fn structured_xml() -> String {
    let coordinates: String =
        places(DIMS).iter().map(|point| format!("{} {} {} ", point.x, point.y, point.z)).collect();
    format!(
        "<VTKFile type=\"StructuredGrid\"><StructuredGrid WholeExtent=\"0 3 0 2 0 1\"><Piece Extent=\"0 3 0 2 0 1\">\
         <PointData><DataArray type=\"UInt8\" format=\"ascii\">{}</DataArray></PointData>\
         <Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">{coordinates}</DataArray></Points>\
         </Piece></StructuredGrid></VTKFile>",
        as_text()
    )
}

fn type_name(rust: &str) -> &'static str {
    match rust {
        "u8" => "unsigned_char",
        "i8" => "char",
        "u16" => "unsigned_short",
        "i16" => "short",
        "i32" => "int",
        "u32" => "unsigned_int",
        "i64" => "long",
        "u64" => "vtktypeuint64",
        "f32" => "float",
        _ => "double",
    }
}

#[test]
fn every_type_in_both_encodings() {
    let folder = Folder::new();
    for written in written() {
        let scalars = SCALARS.replace("unsigned_char", type_name(written.name));
        let field = format!("field f 1\ndensity 1 24 {}\n", type_name(written.name));
        for arrays in [&scalars, &scalars.replace("\nLOOK", " 1\nLOOK"), &field] {
            for (encoding, samples) in [("BINARY", written.big.clone()), ("ASCII", as_text().into_bytes())] {
                let opened = folder.volume("a.vtk", file(encoding, &format!("{POINTS}{arrays}"), &samples));
                assert_corners_at(&opened, [1.0, 2.0, 3.0], STEPS);
                assert_eq!(opened.voxels().type_name(), written.voxel_type);
            }
        }
    }
    assert_corner_marked(&folder.volume("a", legacy("binary\r", &corner_marked())));
    let options = OpenOptions { spacing: Some(DVec3::ONE), ..OpenOptions::default() };
    let opened = volume(folder.open_with("a.vtk", legacy("BINARY", &corner_marked()), &options));
    assert_eq!(opened.frame().spacing, DVec3::ONE);
}

#[test]
fn bytes_may_be_colors_of_one_component() {
    let folder = Folder::new();
    let head = format!("{POINTS}COLOR_SCALARS c 1\n");
    // Six digits, as VTK writes them.
    let shares: Vec<String> =
        corner_marked().iter().map(|byte| format!("{:.6}", f64::from(*byte) / 255.0)).collect();
    for (encoding, samples) in [("BINARY", corner_marked()), ("ASCII", shares.join(" ").into_bytes())] {
        let opened = folder.volume("a.vtk", file(encoding, &head, &samples));
        assert_corner_marked(&opened);
        assert_eq!(opened.voxels().type_name(), "u8");
    }
    let wrong = shares.join(" ").replacen("0.0", "7.0", 1);
    folder.refused("a.vtk", file("ASCII", &head, wrong.as_bytes()), &["they are from 0 to 1"]);
}

#[test]
fn other_arrays_are_passed_over() {
    let zeros = |count: usize, size: usize| vec![0; count * size];
    let mut others = Vec::new();
    for (head, count, size) in [
        ("VECTORS v float\n", 72, 4),
        ("NORMALS n double\n", 72, 8),
        ("TEXTURE_COORDINATES t 2 float\n", 48, 4),
        ("TENSORS t short\n", 216, 2),
        ("GLOBAL_IDS g vtkIdType\n", 24, 4),
        ("COLOR_SCALARS c 3\n", 72, 1),
        ("SCALARS rgb unsigned_char 3\nLOOKUP_TABLE default\n", 72, 1),
        ("LOOKUP_TABLE default 5\n", 20, 1),
        ("FIELD f 1\nv 3 24 float\n", 72, 4),
    ] {
        others.extend_from_slice(head.as_bytes());
        others.extend(zeros(count, size));
        others.extend_from_slice(b"\nMETADATA\nINFORMATION 1\nNAME a LOCATION b\nDATA 1 2\n\n");
    }
    let meta = "METADATA\nINFORMATION 0\n\n";
    let fields = [
        b"FIELD two 2\nv 2 24 unsigned_char\n".as_slice(),
        &zeros(48, 1),
        b"\n",
        meta.as_bytes(),
        b"density 1 24 unsigned_char\n",
        &corner_marked(),
        b"\n",
        meta.as_bytes(),
    ]
    .concat();
    let time = "FIELD FieldData 1\nTIME 1 1 double\n\0\0\0\0\0\0\0\0\n";
    let points = POINTS.replace("DIMENSIONS", &format!("{time}DIMENSIONS"));
    let cells =
        [b"CELL_DATA 6\nSCALARS c unsigned_char\nLOOKUP_TABLE default\n".as_slice(), &[7; 6], b"\n"].concat();
    let (grid, point_data) = points.split_at(points.len() - "POINT_DATA 24\n".len());
    let rest = [grid.as_bytes(), &cells, point_data.as_bytes(), &others, &fields].concat();
    let head = file("BINARY", "", b"");
    let opened = Folder::new().volume("a.vtk", [&head[..head.len() - 1], &rest].concat());
    assert_corners_at(&opened, [1.0, 2.0, 3.0], STEPS);
}

#[test]
fn rectilinear_grids_with_equal_steps() {
    let folder = Folder::new();
    // The centres of cells: half a step from the first points.
    let cells = folder.volume("a.vtk", rectilinear_legacy());
    assert_corners_at(&cells, [0.5, 5.0, -0.75], [[1.0, 0.0, 0.0], [0.0, -2.0, 0.0], [0.0, 0.0, 0.5]]);
    let points = folder.volume("a.vtr", rectilinear_xml());
    assert_corners_at(&points, [0.0, 1.0, 10.0], [[2.0, 0.0, 0.0], [0.0, -0.5, 0.0], [0.0, 0.0, 3.0]]);
    // Binary coordinates, and points.
    let coordinates = |name: &str, values: &[f32]| {
        let numbers: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        [format!("{name}_COORDINATES {} float\n", values.len()).as_bytes(), &numbers, b"\n"].concat()
    };
    // Coordinates far from 0 are as even as f32 can write them: their distance there is 2^-7.
    let far: Vec<f32> = (0..4).map(|i| 100_000.0 + 0.3 * i as f32).collect();
    let parts = [
        b"# vtk DataFile Version 5.1\n\nBINARY\nDATASET RECTILINEAR_GRID\nDIMENSIONS 4 3 2\n".to_vec(),
        coordinates("X", &far),
        coordinates("Y", &[0.0, 0.1, 0.2]),
        coordinates("Z", &[1.0, -1.0]),
        format!("POINT_DATA 24\n{SCALARS}").into_bytes(),
        corner_marked(),
    ];
    let opened = folder.volume("a.vtk", parts.concat());
    assert_corner_marked(&opened);
    assert_eq!(opened.frame().origin, DVec3::new(f64::from(far[0]), 0.0, 1.0));
    assert!((opened.frame().spacing.x - 0.3).abs() < 2.0_f64.powi(-7));
    assert_eq!(opened.frame().direction.z_axis, -DVec3::Z);
}

#[test]
fn structured_grids_keep_their_points() {
    let folder = Folder::new();
    for (name, bytes) in [
        ("a.vtk", structured_legacy("BINARY")),
        ("a.vtk", structured_legacy("ASCII")),
        ("a.vts", structured_xml().into_bytes()),
    ] {
        let volume = irregular(folder.open(name, bytes));
        // All coordinates are eighths, which single precision and text keep.
        assert_eq!(volume.points(), places(DIMS));
        assert_corner_marked(&volume.samples().clone().with_frame(Default::default()).unwrap());
    }
    // Of cells: the middles of corners.
    let text = String::from_utf8(structured_legacy("ASCII")).unwrap();
    let of_cells = "CELL_DATA 6\nSCALARS a short\nLOOKUP_TABLE default\n1 2 3 4 5 6\n";
    let refused = text.split("POINT_DATA").next().unwrap().to_owned() + of_cells;
    // One layer of cells has no neighbours along z.
    folder.refused("a.vtk", refused, &["3x2x1 points", "two or more"]);
    let points: String = places([3, 3, 3]).iter().map(|p| format!("{} {} {}\n", p.x, p.y, p.z)).collect();
    let values = (1..9).map(|i| i.to_string()).collect::<Vec<_>>().join(" ");
    let text = format!(
        "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_GRID\nDIMENSIONS 3 3 3\nPOINTS 27 double\n{points}\
         CELL_DATA 8\nSCALARS a short\nLOOKUP_TABLE default\n{values}\n"
    );
    let volume = irregular(folder.open("a.vtk", text));
    let corners = |bits: usize| place([1 + (bits & 1), bits >> 1 & 1, bits >> 2]);
    let middle = (0..8).map(corners).sum::<DVec3>() / 8.0;
    assert_eq!((volume.points()[1], volume.samples().value([1, 0, 0])), (middle, 2.0));
}

/// Tetrahedra of which only the corners count, as versions before 5 and from there on write them.
pub(crate) fn unstructured(version: &str) -> String {
    let points: String = places(DIMS).iter().map(|p| format!("{} {} {}\n", p.x, p.y, p.z)).collect();
    let cells = match version {
        "5.1" => "CELLS 3 8\nOFFSETS vtktypeint64\n0 4 8\nCONNECTIVITY vtktypeint64\n0 1 4 12 1 2 5 13\n",
        _ => "CELLS 2 10\n4 0 1 4 12\n4 1 2 5 13\n",
    };
    format!(
        "# vtk DataFile Version {version}\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 24 float\n{points}{cells}\
         CELL_TYPES 2\n10 10\nPOINT_DATA 24\n{SCALARS}{}\n",
        as_text()
    )
}

#[test]
fn unstructured_grids_are_scattered_points() {
    let folder = Folder::new();
    for version in ["3.0", "5.1"] {
        let volume = irregular(folder.open("a.vtk", unstructured(version)));
        assert_eq!(volume.arrangement(), Arrangement::Scattered);
        assert_eq!(volume.points(), places(DIMS));
        assert_eq!(volume.samples().value([3, 0, 0]), 2.0);
    }
    folder.refused("a.vtk", unstructured("5.1").replace("CONNECT", "CONECT"), &["CONNECTIVITY is expected"]);
    folder.refused("a.vtk", unstructured("3.0").replace("POINTS 24", "POINTS 23"), &["is no word"]);
    let head = unstructured("3.0").split("POINT_DATA").next().unwrap().to_owned();
    let of_cells = head + "CELL_DATA 2\nSCALARS a short\nLOOKUP_TABLE default\n1 2\n";
    folder.refused("a.vtk", of_cells, &["cell data"]);
}

#[test]
fn broken_structured_grids_are_refused() {
    let folder = Folder::new();
    let text = String::from_utf8(structured_legacy("ASCII")).unwrap();
    let refuse = |from: &str, to: &str, parts: &[&str]| {
        assert!(text.contains(from), "{from}");
        folder.refused("a.vtk", text.replacen(from, to, 1), parts);
    };
    refuse("DIMENSIONS 4 3 2", "DIMENSIONS 4 3 3", &["24 points", "[4, 3, 3]"]);
    refuse("DIMENSIONS 4 3 2", "DIMENSIONS 24 1 1", &["24x1x1 points", "two or more"]);
    refuse("DIMENSIONS 4 3 2\n", "", &["DIMENSIONS are missing"]);
    refuse("POINTS 24", "POINTS 23", &["is no word"]);
    refuse("POINTS 24", "POINTS 25", &["is no number"]);
    refuse("POINTS 24", "POINTS 6148914691236517206", &["ends before"]);
    let binary = structured_legacy("BINARY");
    folder.refused("a.vtk", &binary[..200], &["24 times 3", "ends before"]);
    let flat = places(DIMS).iter().map(|p| format!("{} {} 0 ", p.x, p.y)).collect::<String>();
    let head = text.split("float\n").next().unwrap().to_owned();
    let tail = &text[text.find("POINT_DATA").unwrap()..];
    folder.refused("a.vtk", format!("{head}float\n{flat}\n{tail}"), &["no volume"]);
    let xml = structured_xml();
    folder.refused("a.vts", xml.replace("\"3\"", "\"1\""), &["1 components", "three"]);
    folder.refused(
        "a.vts",
        xml.replace("<Points>", "<Pints>").replace("</Points>", "</Pints>"),
        &["no Points"],
    );
    folder.refused("a.vts", xml.replacen("0 3 0 2 0 1", "0 3 0 2 0 2", 1), &["Extent"]);
    let spaced = OpenOptions { spacing: Some(DVec3::ONE), ..OpenOptions::default() };
    let opened = folder.open_with("a.vtk", structured_legacy("BINARY"), &spaced).unwrap();
    assert!(opened.notes[0].to_string().contains("spacing"), "{:?}", opened.notes);
}

#[test]
fn rectilinear_grids_keep_unequal_steps() {
    let folder = Folder::new();
    let volume = irregular(folder.open("a.vtr", xml(["0 1 3 4", "5 3 2", "0 1"])));
    assert_corner_marked(&volume.samples().clone().with_frame(Default::default()).unwrap());
    assert_eq!(volume.points()[2], DVec3::new(3.0, 5.0, 0.0));
    assert_eq!(volume.points()[23], DVec3::new(4.0, 2.0, 1.0));
    assert_eq!(volume.bounds(), [DVec3::new(0.0, 2.0, 0.0), DVec3::new(4.0, 5.0, 1.0)]);
    irregular(folder.open("a.vtr", xml(["0 1 2 3", "0 1 2.001", "0 1"])));
    let legacy = String::from_utf8(rectilinear_legacy()).unwrap();
    // The middles of 0 1 2 3 5.
    let cells = irregular(folder.open("a.vtk", legacy.replace("0 1 2 3 4\n", "0 1 2 3 5\n")));
    assert_eq!(cells.points()[3], DVec3::new(4.0, 5.0, -0.75));
}

#[test]
fn coordinates_that_are_no_grid_are_refused() {
    let folder = Folder::new();
    let refuse = |coordinates: [&str; 3], parts: &[&str]| {
        folder.refused("a.vtr", xml(coordinates), parts);
    };
    refuse(["0 1 2 3", "0 1 1", "0 1"], &["y coordinates", "1 follows 1"]);
    refuse(["0 1 2 3", "0 1 2", "3 3"], &["z coordinates", "rise or fall"]);
    refuse(["0 1 inf 3", "0 1 2", "0 1"], &["x coordinates", "coordinate 2 is inf"]);
    refuse(["0 1 2", "0 1 2", "0 1"], &["5 bytes of text cannot write 4 numbers"]);
    refuse(["0 1    2", "0 1 2", "0 1"], &["only 3"]);
    // Within 1e-4 of a step.
    assert_corner_marked(&folder.volume("a.vtr", xml(["0 1 2 3", "0 1 2.0001", "0 1"])));
    let two = xml(["0 1 2 3", "0 1 2", "0 1"]).replacen("<Coordinates><DataArray", "<Coordinates><Other", 1);
    folder.refused("a.vtr", two.replacen("3</DataArray>", "3</Other>", 1), &["three arrays"]);
    let vectors = rectilinear_xml().replace("\"Float32\"", "\"Float32\" NumberOfComponents=\"3\"");
    folder.refused("a.vtr", vectors, &["coordinates of 3 components"]);
}

#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let text = String::from_utf8(legacy("ASCII", as_text().as_bytes())).unwrap();
    let refuse = |from: &str, to: &str, parts: &[&str]| {
        assert!(text.contains(from), "{from}");
        folder.refused("a.vtk", text.replace(from, to), parts);
    };
    for other in ["POLYDATA", "FIELD"] {
        refuse("STRUCTURED_POINTS", other, &["line 4", &format!("DATASET {other};"), "RECTILINEAR_GRID"]);
    }
    refuse("# vtk DataFile", "\u{feff}# vtk DataFile", &["begins with \"# vtk DataFile Version\""]);
    refuse("ASCII", "EBCDIC", &["line 3", "EBCDIC", "ASCII or BINARY"]);
    refuse("DIMENSIONS 4 3 2", "DIMENSIONS 4 3 3", &["line 10", "24 numbers; 4x3x3 are expected"]);
    refuse("DIMENSIONS 4 3 2", "DIMENSIONS 4 3 -2", &["line 5", "-2"]);
    refuse("DIMENSIONS 4 3 2", "DIMENSIONS 4 3 0", &["points along each axis"]);
    refuse("DIMENSIONS 4 3 2\n", "", &["DIMENSIONS are missing"]);
    refuse("DIMENSIONS 4 3 2", "EXTENT 0 3 0 2 0 1", &["line 5", "EXTENT"]);
    refuse("SPACING 0.5 1 -2", "SPACING 0.5 0 -2", &["spacing", "above 0"]);
    refuse("ORIGIN 1 2 3", "ORIGIN 1 inf 3", &["origin", "finite"]);
    refuse("POINT_DATA 24", "POINT_DATA 25", &["25 times 1", "ends before"]);
    refuse("POINT_DATA 24", "POINT_DATA 18446744073709551615", &["ends before"]);
    refuse("POINT_DATA 24", "CELL_DATA 24", &["24 numbers; 3x2x1"]);
    refuse(
        "DIMENSIONS 4 3 2\nORIGIN 1 2 3\nSPACING 0.5 1 -2\nPOINT_DATA",
        "DIMENSIONS 4 3 1\nCELL_DATA",
        &["cells along each axis"],
    );
    refuse("unsigned_char", "bit", &["line 9", "\"bit\""]);
    refuse("density unsigned_char", "density unsigned_char 3", &["24 times 3", "ends before"]);
    refuse("LOOKUP_TABLE", "LOOK_UP", &["SCALARS must have"]);
    refuse("SCALARS density", "SCALAR density", &["SCALAR\" is no word"]);
    refuse(" 11 ", " 256 ", &["sample", "256"]);
    refuse("POINT_DATA 24", "", &["SCALARS"]);
    let none = text.split("SCALARS").next().unwrap();
    folder.refused("a.vtk", none, &["no SCALARS, COLOR_SCALARS or FIELD array of one component"]);
    folder.refused("a.vtk", "something else", &["begins with"]);
    let binary = legacy("BINARY", &corner_marked());
    folder.refused("a.vtk", &binary[..binary.len() - 2], &["byte", "24 times 1"]);
    let vtr = rectilinear_xml().replace("RectilinearGrid", "UnstructuredGrid");
    folder.refused("a.vtr", vtr, &["UnstructuredGrid", "RectilinearGrid, StructuredGrid are supported"]);
    for compressor in ["vtkLZ4DataCompressor", "vtkLZMADataCompressor"] {
        let vtr = rectilinear_xml().replace("<VTKFile", &format!("<VTKFile compressor=\"{compressor}\""));
        let vtr = vtr.replace("\"ascii\"", "\"binary\"");
        folder.refused(
            "a.vtr",
            vtr.replace("0 2 4 6", "AAAA"),
            &[compressor, "vtkZLibDataCompressor or none"],
        );
    }
    assert_eq!(DIMS.iter().product::<usize>(), 24);
    let limit = OpenOptions { max_memory: 3, ..OpenOptions::default() };
    let vtr = rectilinear_xml().replace("<VTKFile", "<VTKFile compressor=\"vtkZLibDataCompressor\"");
    let vtr = vtr.replace("\"ascii\"", "\"binary\"").replace("0 2 4 6", "AAAA");
    refused(folder.open_with("a.vtr", vtr, &limit), "a.vtr", &["more than 3 bytes"]);
}
