//! Gaussian splats in PLY.

use crate::common::{Folder, splats};
use crate::ply::bytes;
use glam::{Mat3, Vec3};
use oblate_engine::{Material, OpacityFilter, Splats, Strength};
use oblate_importers::Note;
use proptest::prelude::*;

/// Columns of a file by name, with their types.
pub(crate) struct Table {
    pub(crate) encoding: &'static str,
    pub(crate) columns: Vec<(String, &'static str)>,
    pub(crate) rows: Vec<Vec<f64>>,
    pub(crate) comments: &'static [&'static str],
}

const PLAIN: [&str; 17] = [
    "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
    "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
];

impl Table {
    /// Columns as training writes them, `rest` of them harmonics, with one splat at the origin: grey, half opaque,
    /// round with σ = 1.
    pub(crate) fn plain(rest: usize) -> Self {
        let rest = (0..rest).map(|i| format!("f_rest_{i}"));
        let columns = PLAIN.iter().map(|name| (*name).to_owned()).chain(rest).map(|name| (name, "float"));
        let mut table = Self {
            encoding: "binary_little_endian",
            columns: columns.collect(),
            rows: Vec::new(),
            comments: &[],
        };
        table.rows.push(vec![0.0; table.columns.len()]);
        table.set(0, "rot_0", 1.0);
        table
    }

    pub(crate) fn at(&self, name: &str) -> usize {
        self.columns.iter().position(|(column, _)| column == name).unwrap()
    }

    pub(crate) fn set(&mut self, row: usize, name: &str, value: f64) {
        let at = self.at(name);
        self.rows[row][at] = value;
    }

    pub(crate) fn with(mut self, values: &[(&str, f64)]) -> Self {
        values.iter().for_each(|(name, value)| self.set(0, name, *value));
        self
    }

    /// A copy of the first row, changed.
    pub(crate) fn and(mut self, values: &[(&str, f64)]) -> Self {
        self.rows.push(self.rows[0].clone());
        let last = self.rows.len() - 1;
        values.iter().for_each(|(name, value)| self.set(last, name, *value));
        self
    }

    pub(crate) fn without(mut self, name: &str) -> Self {
        let at = self.at(name);
        self.columns.remove(at);
        for row in &mut self.rows {
            row.remove(at);
        }
        self
    }

    pub(crate) fn renamed(mut self, name: &str, new: &str) -> Self {
        let at = self.at(name);
        self.columns[at].0 = new.to_owned();
        self
    }

    pub(crate) fn file(&self) -> Vec<u8> {
        let mut header = format!("ply\nformat {} 1.0\n", self.encoding);
        self.comments.iter().for_each(|comment| header += &format!("comment {comment}\n"));
        header += &format!("element vertex {}\n", self.rows.len());
        self.columns.iter().for_each(|(name, kind)| header += &format!("property {kind} {name}\n"));
        let mut out = (header + "end_header\n").into_bytes();
        for row in &self.rows {
            if self.encoding == "ascii" {
                let words: Vec<String> = row.iter().map(f64::to_string).collect();
                out.extend((words.join(" ") + "\n").into_bytes());
            } else {
                let big = self.encoding == "binary_big_endian";
                let cells = row.iter().zip(&self.columns);
                cells.for_each(|(value, (_, kind))| out.extend(bytes(kind, *value, big)));
            }
        }
        out
    }

    pub(crate) fn open(&self) -> Splats {
        splats(Folder::new().open("a.ply", self.file()))
    }

    pub(crate) fn notes(&self) -> Vec<Note> {
        Folder::new().open("a.ply", self.file()).unwrap().notes
    }

    #[track_caller]
    pub(crate) fn refused(&self, parts: &[&str]) {
        Folder::new().refused("a.ply", self.file(), parts);
    }
}

/// A small file with harmonics of degree 1.
pub(crate) fn example(encoding: &'static str) -> Vec<u8> {
    let mut table =
        Table::plain(9).and(&[("x", 1.0), ("f_rest_4", 0.25)]).and(&[("y", -2.0), ("rot_2", 0.5)]);
    table.encoding = encoding;
    table.file()
}

fn peaks(splats: &Splats) -> &[f32] {
    let Strength::Opacity { peaks, .. } = &splats.strength else { panic!("opacities are expected") };
    peaks
}

fn filter(splats: &Splats) -> OpacityFilter {
    let Strength::Opacity { filter, .. } = &splats.strength else { panic!("opacities are expected") };
    *filter
}

fn close(found: Mat3, expected: Mat3) {
    let largest = expected.to_cols_array().iter().fold(0.0, |a: f32, b| a.max(b.abs()));
    // Activation is in double precision; single precision holds seven digits.
    assert!(found.abs_diff_eq(expected, 2e-7 * largest), "{found} is not {expected}");
}

#[test]
fn numbers_are_activated() {
    let turn = std::f64::consts::FRAC_1_SQRT_2;
    let splats = Table::plain(0)
        .with(&[("x", 1.5), ("y", -2.0), ("z", 3.0), ("nx", 9.0), ("opacity", 3f64.ln())])
        .with(&[("scale_0", 2f64.ln()), ("scale_1", 0.5f64.ln()), ("scale_2", 0.1f64.ln())])
        // 90° about z, twice as long as a unit quaternion.
        .with(&[("rot_0", 2.0 * turn), ("rot_3", 2.0 * turn)])
        // Display values 1, 0.5 and, cut off at 0, −0.5.
        .with(&[("f_dc_0", 0.5 / 0.28209479177387814), ("f_dc_2", -1.0 / 0.28209479177387814)])
        .open();
    assert_eq!(splats.centers, [Vec3::new(1.5, -2.0, 3.0)]);
    // logit⁻¹(ln 3) = 3/4.
    assert!((peaks(&splats)[0] - 0.75).abs() < 1e-7);
    // The first half-axis, of length 2, points along y, the second, 0.5, along −x, the third, 0.1, along z.
    close(splats.shapes.factor(0), Mat3::from_cols(Vec3::Y * 2.0, Vec3::X * -0.5, Vec3::Z * 0.1));
    let [r, g, b] = splats.colors[0];
    // sRGB's 0.5 is 0.21404 in linear light.
    assert!((r - 1.0).abs() < 1e-6 && (g - 0.214_041).abs() < 1e-6 && b == 0.0, "{r} {g} {b}");
    assert_eq!((splats.harmonics, splats.normals, splats.material), (None, None, Material::UNLIT));
}

#[test]
fn quaternions_begin_with_w() {
    // 90° about x takes y to z: half-axes are (e_x, 2 e_z, −3 e_y).
    let turned = Table::plain(0)
        .with(&[("rot_0", 1.0), ("rot_1", 1.0)])
        .with(&[("scale_1", 2f64.ln()), ("scale_2", 3f64.ln())])
        .open();
    close(turned.shapes.factor(0), Mat3::from_cols(Vec3::X, Vec3::Z * 2.0, Vec3::Y * -3.0));
}

#[test]
fn harmonics_are_stored_by_channel() {
    for (degree, count) in [(1, 3), (2, 8), (3, 15)] {
        let mut table = Table::plain(3 * count).and(&[("x", 1.0)]);
        for i in 0..3 * count {
            table.set(1, &format!("f_rest_{i}"), i as f64);
        }
        // With harmonics it is the sum that is cut off, not the constant part: −0.5 stays, as −0.21404.
        table.set(1, "f_dc_1", -1.0 / 0.28209479177387814);
        let splats = table.open();
        let harmonics = splats.harmonics.as_ref().unwrap();
        assert_eq!((harmonics.degree, harmonics.coefficients.len()), (degree, 2 * count));
        assert_eq!(harmonics.coefficients[..count], vec![[0.0; 3]; count]);
        for i in 0..count {
            assert_eq!(harmonics.coefficients[count + i], [i, count + i, 2 * count + i].map(|n| n as f32));
        }
        assert!((splats.colors[1][1] + 0.214_041).abs() < 1e-6);
    }
}

#[test]
fn columns_come_in_any_order_type_and_encoding() {
    let expected = splats(Folder::new().open("a.ply", example("binary_little_endian")));
    assert_eq!(expected.centers.len(), 3);
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for kinds in [["float", "double", "float"], ["double", "float", "double"]] {
            let mut table = Table::plain(9)
                .and(&[("x", 1.0), ("f_rest_4", 0.25)])
                .and(&[("y", -2.0), ("rot_2", 0.5)])
                .without("nx");
            table.encoding = encoding;
            table.columns.iter_mut().enumerate().for_each(|(i, column)| column.1 = kinds[i % 3]);
            table.columns.reverse();
            table.rows.iter_mut().for_each(|row| row.reverse());
            assert_eq!(table.open(), expected, "{encoding}");
        }
    }
    // Elements before and behind, and a list beside, which makes rows differ in length.
    let text = String::from_utf8(example("ascii")).unwrap();
    let text = text
        .replace("element vertex", "element junk 1\nproperty int n\nelement vertex")
        .replace("property float x\n", "property list uchar int more\nproperty float x\n")
        .replace("end_header\n", "element face 0\nproperty list uchar int vertex_indices\nend_header\n7\n");
    let (header, rows) = text.split_at(text.find("end_header\n7\n").unwrap() + 13);
    let rows: String = rows.lines().map(|row| format!("2 8 9 {row}\n")).collect();
    assert_eq!(splats(Folder::new().open("a.ply", header.to_owned() + &rows)), expected);
}

#[test]
fn neighbours_come_together() {
    let mut table = Table::plain(0);
    for i in 0..3 {
        table = table.and(&[("x", [9.0, 0.1, 9.1][i]), ("y", [9.0, 0.1, 9.1][i]), ("opacity", i as f64)]);
    }
    let splats = table.open();
    let x: Vec<f32> = splats.centers.iter().map(|p| p.x).collect();
    assert_eq!(x, [0.0, 0.1, 9.0, 9.1]);
    // logit⁻¹(1) of the second one added.
    assert!((peaks(&splats)[1] - 0.731_058_6).abs() < 1e-6);
}

#[test]
fn many_rows_are_read_in_parts() {
    // More than are read at a time, and not a multiple of it.
    let mut table = Table::plain(9);
    let count = 40_001;
    table.rows = (0..count)
        .map(|i| {
            let mut row = table.rows[0].clone();
            row[0] = i as f64;
            row[6] = (i % 7) as f64;
            row[17] = i as f64 / 8.0;
            row
        })
        .collect();
    let check = |splats: &Splats, left_out: usize| {
        let places = (0..count).filter(|i| *i != left_out);
        let harmonics = splats.harmonics.as_ref().unwrap();
        let mut found = 0;
        for (at, i) in places.enumerate() {
            assert_eq!(splats.centers[at].x, i as f32);
            assert_eq!(harmonics.coefficients[3 * at][0], i as f32 / 8.0);
            found += 1;
        }
        assert_eq!((splats.centers.len(), harmonics.coefficients.len()), (found, 3 * found));
    };
    check(&table.open(), usize::MAX);
    // A row of zeros is no splat.
    table.rows[30_000].fill(0.0);
    check(&table.open(), 30_000);
    // Of each kind the first is told, whichever is found first.
    table.set(39_000, "z", f64::NAN);
    table.set(17_000, "opacity", f64::NAN);
    let said = [
        "3 of 40001 splats: 2 with a number that is NaN, infinite or out of its range (the first is splat 17000), \
         1 with a quaternion of zeros (the first is splat 30000)",
    ];
    assert_eq!(table.notes(), said.map(|said| Note::LeftOut(said.into())));
}

#[test]
fn the_3d_filter_widens_and_dims() {
    let mut table = Table::plain(0).with(&[("scale_1", 2f64.ln()), ("scale_2", f64::NEG_INFINITY)]);
    table.columns.push(("filter_3D".into(), "float"));
    table.rows[0].push(0.0);
    let bare = table.open();
    assert_eq!(peaks(&bare), [0.5]);
    close(bare.shapes.factor(0), Mat3::from_diagonal(Vec3::new(1.0, 2.0, 0.0)));
    let table = table.with(&[("scale_2", 3f64.ln()), ("filter_3D", 4.0)]);
    let filtered = table.open();
    let [a, b, c] = [17f32.sqrt(), 20f32.sqrt(), 5.0];
    close(filtered.shapes.factor(0), Mat3::from_diagonal(Vec3::new(a, b, c)));
    assert!((peaks(&filtered)[0] - 0.5 * 6.0 / (a * b * c)).abs() < 1e-7);
}

#[test]
fn the_3d_filter_tells_how_opacities_were_trained() {
    let mut table = Table::plain(9).and(&[("x", 1.0)]);
    assert_eq!(filter(&table.open()), OpacityFilter::Classic);
    // Wherever the column stands, and though nothing is filtered.
    table.columns.insert(3, ("filter_3D".into(), "float"));
    table.rows.iter_mut().for_each(|row| row.insert(3, 0.0));
    assert_eq!(filter(&table.open()), OpacityFilter::Compensated);
    assert_eq!(filter(&table.renamed("filter_3D", "filter_2D").open()), OpacityFilter::Classic);
}

#[test]
fn comments_tell_how_opacities_were_trained() {
    use OpacityFilter::{Classic, Compensated};
    let mut plain = Table::plain(0);
    let mut filtered = Table::plain(0);
    filtered.columns.push(("filter_3D".into(), "float"));
    filtered.rows[0].push(0.0);
    for (comments, [of_plain, of_filtered]) in [
        (&["made by hand", "antialiased", "SplatRenderMode: other"][..], [Classic, Compensated]),
        (&["splatrendermode: 2DGS"], [Classic; 2]),
        (&["SplatRenderMode: mip"], [Compensated; 2]),
        (&["SplatRenderMode: default"], [Classic; 2]),
        (&["antialiased 1", "made by hand"], [Compensated; 2]),
        (&["antialiased 1", "antialiased 0"], [Classic; 2]),
    ] {
        for (table, expected) in [(&mut plain, of_plain), (&mut filtered, of_filtered)] {
            table.comments = comments;
            assert_eq!(filter(&table.open()), expected, "{comments:?}");
        }
    }
}

#[test]
fn extreme_splats_are_splats() {
    let table = Table::plain(9)
        .with(&[("opacity", f64::INFINITY), ("scale_0", 40.0), ("scale_1", -40.0), ("x", 3e38)])
        .and(&[("opacity", f64::NEG_INFINITY), ("scale_2", f64::NEG_INFINITY), ("f_rest_8", -1e12)])
        .and(&[("opacity", -1e30), ("rot_0", 1e-38), ("x", -3e38), ("f_dc_0", 1e12)]);
    let splats = table.open();
    assert!(oblate_engine::Cloud::new(splats.clone()).is_ok());
    let mut found = peaks(&splats).to_vec();
    found.sort_by(f32::total_cmp);
    assert_eq!(found, [0.0, 0.0, 1.0]);
}

#[test]
fn what_is_no_splat_is_left_out() {
    let (number, color) = ("with a number that is NaN", "with a colour beyond");
    for (name, value, reason) in [
        ("x", f64::NAN, number),
        ("y", f64::INFINITY, number),
        ("opacity", f64::NAN, number),
        ("scale_1", f64::INFINITY, number),
        ("scale_2", 40.1, "with a log scale beyond"),
        ("scale_2", -40.1, "with a log scale beyond"),
        ("scale_0", f64::NAN, number),
        ("rot_3", f64::NEG_INFINITY, number),
        ("f_dc_1", 1e13, color),
        ("f_rest_7", f64::NAN, number),
        ("f_rest_7", -1e13, color),
    ] {
        let table = Table::plain(9).and(&[("y", 1.0)]).and(&[(name, value)]);
        let [Note::LeftOut(said)] = &table.notes()[..] else { panic!("{name}: nothing is said") };
        assert!(said.starts_with(&format!("1 of 3 splats: 1 {reason}")), "{name} {value}: {said}");
        assert!(said.ends_with("(the first is splat 2)"), "{said}");
        assert_eq!(table.open().centers.len(), 2);
    }
}

#[test]
fn what_is_wrong_is_said() {
    for name in PLAIN.iter().filter(|name| !name.starts_with('n') && **name != "scale_2") {
        // Without all that tells splats from meshes it would be a mesh without faces.
        Table::plain(9).without(name).refused(&[&format!("no property {name};"), "rot_0..3"]);
    }
    for count in [1, 8, 10, 44, 46, 72] {
        Table::plain(count).refused(&[&format!("{count} properties f_rest_*"), "9, 24 or 45"]);
    }
    Table::plain(9).renamed("f_rest_3", "f_rest_9").refused(&["no f_rest_3", "f_rest_0 to f_rest_8"]);
    let mut list = Table::plain(0);
    list.columns[11].1 = "list uchar float";
    list.rows.clear();
    list.refused(&["\"scale_1\" must not be a list"]);
    let mut none = Table::plain(0);
    none.rows.clear();
    none.refused(&["no splats", "0 rows"]);
    Table::plain(0)
        .with(&[("rot_0", 0.0)])
        .refused(&["no splats", "1 of 1 splats: 1 with a quaternion of zeros"]);
    let file = Table::plain(45).and(&[]).file();
    for length in 0..file.len() {
        Folder::new().refused("a.ply", &file[..length], &[]);
    }
}

proptest! {
    #[test]
    fn shapes_are_rotated_lengths(
        q in prop::array::uniform4(-1.0..1.0f64),
        log_scales in prop::array::uniform3(-8.0..3.0f64),
        logit in -20.0..20.0f64,
    ) {
        prop_assume!(q.iter().map(|c| c * c).sum::<f64>() > 0.01);
        let names = ["rot_0", "rot_1", "rot_2", "rot_3"];
        let values: Vec<(&str, f64)> = names.into_iter().zip(q).collect();
        let scales = [("scale_0", log_scales[0]), ("scale_1", log_scales[1]), ("scale_2", log_scales[2])];
        let splats = Table::plain(0).with(&values).with(&scales).with(&[("opacity", logit)]).open();
        let factor = splats.shapes.factor(0).as_dmat3();
        // Numbers pass through the file in single precision: 8 · 2⁻²⁴ in a logarithm, as much again in F.
        let lengths = [factor.x_axis, factor.y_axis, factor.z_axis].map(glam::DVec3::length);
        for (length, log_scale) in lengths.into_iter().zip(log_scales) {
            prop_assert!((length.ln() - log_scale).abs() < 2e-6);
        }
        // Turned, not mirrored, and at right angles.
        let volume = lengths.iter().product::<f64>();
        prop_assert!((factor.determinant() / volume - 1.0).abs() < 1e-5);
        // A vector turned by the quaternion, by its own formula: v + 2w (q × v) + 2 q × (q × v).
        let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
        let (w, axis) = (q[0] / norm, glam::DVec3::new(q[1], q[2], q[3]) / norm);
        let turned = glam::DVec3::Z + 2.0 * w * axis.cross(glam::DVec3::Z) + 2.0 * axis.cross(axis.cross(glam::DVec3::Z));
        prop_assert!((factor.z_axis / lengths[2] - turned).length() < 2e-6);
        let peak = f64::from(peaks(&splats)[0]);
        prop_assert!((peak - 1.0 / (1.0 + (-logit).exp())).abs() < 1e-6);
    }
}

#[test]
fn a_mesh_with_such_columns_is_a_mesh() {
    let mut table = Table::plain(0).and(&[("x", 1.0)]).and(&[("y", 1.0)]);
    table.encoding = "ascii";
    let text = String::from_utf8(table.file()).unwrap();
    let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let mesh = Folder::new().mesh("a.ply", text.replace("end_header\n", faces) + "3 0 1 2\n");
    assert_eq!(mesh.primitives[0].triangles, [[0, 1, 2]]);
}
