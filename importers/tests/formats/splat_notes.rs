//! What is said of splats in PLY whose columns or header are unusual, and how far reading has come.

use crate::common::{Folder, splats};
use crate::splats::Table;
use glam::Vec3;
use oblate_engine::{OpacityFilter, Strength};
use oblate_importers::{Note, OpenOptions, Watch};
use std::sync::{Arc, Mutex};

/// That exactly one thing is assumed, and said with these words.
#[track_caller]
fn assumed(table: &Table, words: &str) {
    let notes = table.notes();
    assert!(
        matches!(&notes[..], [Note::Assumed(said)] if said.contains(words)),
        "{notes:?} is not {words:?}"
    );
}

#[track_caller]
fn nothing_said(table: &Table) {
    assert_eq!(table.notes(), []);
}

#[test]
fn without_a_third_scale_splats_are_flat() {
    let mut table = Table::plain(9).with(&[("scale_1", 2f64.ln())]).without("scale_2");
    let factor = table.open().shapes.factor(0);
    assert!(factor.abs_diff_eq(glam::Mat3::from_diagonal(Vec3::new(1.0, 2.0, 0.0)), 2e-7));
    assert_eq!(factor.z_axis, Vec3::ZERO);
    assumed(&table, "no scale_2: they are flat (2DGS)");
    table.comments = &["SplatRenderMode: 2dgs"];
    assumed(&table, "no scale_2: they are flat (2DGS)");
    table.comments = &["SplatRenderMode: mip"];
    assumed(&table, "though the header says that they aren't 2DGS");
    table.encoding = "ascii";
    table.comments = &[];
    assert_eq!(table.open().shapes.factor(0).z_axis, Vec3::ZERO);
}

#[test]
fn a_header_of_flat_splats_is_compared_with_them() {
    let mut table = Table::plain(0).and(&[("x", 1.0)]);
    table.comments = &["SplatRenderMode: 2dgs"];
    assumed(&table, "the header says 2DGS, but splats have a third half-axis");
    // One of them may be a needle: its longest counts. −∞ and a hundredth are flat.
    table.set(0, "scale_2", f64::NEG_INFINITY);
    table.set(1, "scale_2", -5.0);
    table.set(1, "scale_1", -20.0);
    nothing_said(&table);
    table.set(1, "scale_2", -4.0);
    assumed(&table, "third half-axis");
}

#[test]
fn colors_may_be_channels() {
    let coefficients = ["f_dc_0", "f_dc_1", "f_dc_2"];
    let mut table = Table::plain(9);
    for (name, channel) in coefficients.into_iter().zip(["red", "green", "blue"]) {
        table = table.renamed(name, channel);
    }
    table = table.with(&[("red", 255.0), ("green", 128.0)]);
    let mut wide = Table { columns: table.columns.clone(), rows: table.rows.clone(), ..Table::plain(0) };
    for column in table.columns.iter_mut().filter(|column| ["red", "green", "blue"].contains(&&column.0[..]))
    {
        column.1 = "uchar";
    }
    let [r, g, b] = table.open().colors[0];
    assert!((r - 1.0).abs() < 1e-6 && (g - 0.215_861).abs() < 1e-6 && b == 0.0, "{r} {g} {b}");
    assumed(&table, "red green blue are taken for their colours");
    for column in &mut wide.columns {
        column.1 = if column.1 == "float" && ["red", "green", "blue"].contains(&&column.0[..]) {
            "ushort"
        } else {
            "float"
        };
    }
    wide.set(0, "red", 65535.0);
    assert!((wide.open().colors[0][0] - 1.0).abs() < 1e-6);
    // Beside coefficients they aren't heeded.
    let mut both = Table::plain(0);
    both.columns.push(("red".into(), "uchar"));
    both.rows[0].push(200.0);
    nothing_said(&both);
    table.columns.iter_mut().for_each(|column| column.1 = "float");
    table.refused(&["red green blue of splats must be uchar or ushort"]);
    table.without("blue").refused(&["no property f_dc_0"]);
}

#[test]
fn contradictions_are_reported() {
    let mut table = Table::plain(0);
    for comments in [
        &["SplatRenderMode: mip", "antialiased 0"][..],
        &["antialiased 0", "antialiased 1"],
        &["SplatRenderMode: default", "SplatRenderMode: mip"],
    ] {
        table.comments = comments;
        assumed(&table, &format!("{:?} in line 4 is the last one and counts", comments[1]));
    }
    for comments in
        [&["SplatRenderMode: mip", "antialiased 1"][..], &["antialiased 0", "SplatRenderMode: default"]]
    {
        table.comments = comments;
        nothing_said(&table);
    }
    table.columns.push(("filter_3D".into(), "float"));
    table.rows[0].push(0.5);
    table.comments = &["antialiased 1"];
    nothing_said(&table);
    table.comments = &["antialiased 0"];
    assumed(&table, "though splats have filter_3D");
    assert!(matches!(table.open().strength, Strength::Opacity { filter: OpacityFilter::Classic, .. }));
}

/// So many splats, whose opacity and scale grow evenly from and to these numbers.
fn many(count: usize, [low, high]: [f64; 2], [least, most]: [f64; 2]) -> Table {
    let mut table = Table::plain(0);
    for i in 1..count {
        table = table.and(&[("x", i as f64)]);
    }
    for i in 0..count {
        let share = i as f64 / (count - 1) as f64;
        table.set(i, "opacity", low + (high - low) * share);
        ["scale_0", "scale_1", "scale_2"]
            .iter()
            .for_each(|name| table.set(i, name, least + (most - least) * share));
    }
    table
}

#[test]
fn numbers_that_look_activated_are_reported() {
    let (logits, logs) = ([-4.0, 8.0], [-7.0, 1.0]);
    nothing_said(&many(101, logits, logs));
    assumed(&many(101, [0.0, 1.0], logs), "opacities are logits");
    nothing_said(&many(100, [0.0, 1.0], logs));
    // Rows that are no splats hide nothing.
    let mut table = many(102, [0.0, 1.0], logs);
    table.rows[50].fill(0.0);
    table.set(50, "opacity", -3.0);
    assert_eq!(table.notes().len(), 2);
    for opacities in [[-0.01, 1.0], [0.0, 1.01], [0.5, 0.5]] {
        nothing_said(&many(101, opacities, logs));
    }
    assumed(&many(101, logits, [0.001, 0.7]), "scales are logarithms");
    nothing_said(&many(100, logits, [0.001, 0.7]));
    // Of a scene in small units.
    nothing_said(&many(101, logits, [0.06, 5.0]));
    nothing_said(&many(101, logits, [0.01, 0.01]));
    assert_eq!(many(101, [0.0, 1.0], [0.001, 0.7]).notes().len(), 2);
    // Drawn as it stands: σ = e^0.7.
    let factor = many(101, logits, [0.001, 0.7]).open().shapes.factor(100);
    assert!((factor.x_axis.x.ln() - 0.7).abs() < 1e-6);
}

#[test]
fn reading_is_watched() {
    let table = many(5000, [-4.0, 8.0], [-7.0, 1.0]);
    let mut text = many(10, [-4.0, 8.0], [-7.0, 1.0]);
    text.encoding = "ascii";
    let volume = ("a_4x3x2_u8.raw", crate::common::corner_marked());
    let splat = ("a.splat", crate::splat::example());
    for (name, file) in [("a.ply", table.file()), ("b.ply", text.file()), volume, splat] {
        let told = Arc::new(Mutex::new(Vec::new()));
        let teller = told.clone();
        let watch = Watch::new(move |done, total| teller.lock().unwrap().push((done, total)));
        let options = OpenOptions { watch: Some(watch), ..OpenOptions::default() };
        assert_eq!(options, options.clone());
        let size = file.len() as u64;
        Folder::new().open_with(name, file, &options).unwrap();
        let told = told.lock().unwrap();
        assert!(told.iter().all(|(done, total)| done <= total && *total == size), "{told:?}");
        assert_eq!(told.last(), Some(&(size, size)), "{name}");
    }
    let other = OpenOptions { watch: Some(Watch::new(|_, _| {})), ..OpenOptions::default() };
    assert_ne!(other, OpenOptions { watch: Some(Watch::new(|_, _| {})), ..OpenOptions::default() });
}

#[test]
fn large_files_are_read_in_parts() {
    // Beyond the beginning that is read first, in several blocks, with rows before that have another length.
    let count = 20_000;
    let table = many(count, [-4.0, 8.0], [-7.0, 1.0]);
    let file = table.file();
    let end = file.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(file[..end].to_vec()).unwrap();
    let before = "element before 3\nproperty uchar a\nproperty double b\nelement vertex";
    let header = header.replace("element vertex", before);
    let moved = [header.as_bytes(), &[7; 27], &file[end..]].concat();
    assert!(moved.len() > 1 << 20);
    let splats = splats(Folder::new().open("a.ply", moved));
    assert_eq!(splats.centers.len(), count);
    assert!(splats.centers.iter().enumerate().all(|(i, center)| center.x == i as f32));
    assert_eq!(splats, table.open());
    // A file that ends too early.
    let words =
        ["20000 rows of element \"vertex\" need at least 68 bytes each, but only 1359999 bytes are left"];
    Folder::new().refused("a.ply", &file[..file.len() - 1], &words);
}
