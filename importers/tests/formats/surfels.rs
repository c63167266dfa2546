use crate::common::{Folder, refused, splats};
use glam::{Mat3, Vec3};
use oblate_engine::{Blend, Harmonics, Material, OpacityFilter, Shapes, Strength};
use oblate_importers::Content;

const SURFACE: &str = "strength surface depth_tolerance 0.25 coverage_floor 0.5 closed 1 shapes each normals own blend linear \
    emission 0 ambient 0.1 diffuse 0.2 specular 0.3 exponent 4";

const COLUMNS: &str =
    "x y z nx ny nz u_x u_y u_z v_x v_y v_z w_x w_y w_z linear_red linear_green linear_blue";

/// A text file of float columns, with columns of bytes before them.
pub(crate) fn file(comment: &str, columns: &str, rows: &[&str]) -> Vec<u8> {
    let mut text =
        format!("ply\nformat ascii 1.0\ncomment oblate surfels {comment}\nelement vertex {}\n", rows.len());
    for name in ["red", "green", "blue"] {
        text += &format!("property uchar {name}\n");
    }
    for name in columns.split_whitespace() {
        text += &format!("property float {name}\n");
    }
    text += "end_header\n";
    for row in rows {
        text += &format!("0 0 0 {row}\n");
    }
    text.into()
}

/// A surfel at (1, 2, 3) that faces y, and a second one.
pub(crate) fn example() -> Vec<u8> {
    let rows =
        ["1 2 3 0 1 0 0 0 2 0.5 0 0 0 0 0 0.1 0.2 0.3 7 0.5", "0 0 0 0 0 0 1 0 0 0 1 0 0 0 0 1 1 1 0 1"];
    file(&format!("1 {SURFACE}"), &format!("{COLUMNS} area opacity"), &rows)
}

#[test]
fn surfels_are_what_the_columns_say() {
    let found = splats(Folder::new().open("a.ply", example()));
    assert_eq!(found.centers, [Vec3::new(1.0, 2.0, 3.0), Vec3::ZERO]);
    let Shapes::Each(factors) = &found.shapes else { panic!("each has its shape") };
    assert_eq!(factors[0], Mat3::from_cols(Vec3::Z * 2.0, Vec3::X * 0.5, Vec3::ZERO));
    assert_eq!(found.normals, Some(vec![Vec3::Y, Vec3::ZERO]));
    assert_eq!(found.colors[0], [0.1, 0.2, 0.3]);
    let Strength::Surface(surface) = &found.strength else { panic!("a surface is expected") };
    assert_eq!((&surface.areas[..], &surface.opacities), (&[7.0, 0.0][..], &Some(vec![0.5, 1.0])));
    assert_eq!((surface.depth_tolerance, surface.coverage_floor), (0.25, 0.5));
    assert!(surface.closed.is_everywhere());
    let material = Material { emission: 0.0, ambient: 0.1, diffuse: 0.2, specular: 0.3, exponent: 4.0 };
    assert_eq!(found.material, material);
}

#[test]
fn kernels_are_what_the_columns_say() {
    let rest = "normals shape blend display emission 1 ambient 0 diffuse 0 specular 0 exponent 1";
    let row = "1 2 3 0 0 0 1 0 0 0 2 0 0 0 3 0 0 0 0.5";
    let mass = format!("1 strength extinction shapes shared {rest}");
    let found = splats(Folder::new().open("a.ply", file(&mass, &format!("{COLUMNS} mass"), &[row, row])));
    assert_eq!(found.shapes, Shapes::Shared(Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0))));
    assert_eq!((found.strength, found.normals), (Strength::Extinction { masses: vec![0.5; 2] }, None));
    let peak = format!("1 strength opacity filter compensated shapes each {rest}");
    let harmonics: Vec<String> =
        (0..3).flat_map(|i| ["red", "green", "blue"].map(|channel| format!("h{i}_{channel}"))).collect();
    let columns = format!("{COLUMNS} peak {}", harmonics.join(" "));
    let bytes = file(&peak, &columns, &[&format!("{row} 1 2 3 4 5 6 7 8 9")]);
    let opened = Folder::new().open("a.ply", bytes).unwrap();
    assert!(matches!(opened.content, Content::Splats { blend: Blend::Display, .. }));
    let found = splats(Ok(opened));
    assert_eq!(
        found.strength,
        Strength::Opacity { peaks: vec![0.5], filter: OpacityFilter::Compensated, least: 0.0 }
    );
    let ended = peak.replace("compensated", "compensated least 0.25");
    let ended = splats(Folder::new().open("a.ply", file(&ended, &format!("{COLUMNS} peak"), &[row])));
    assert!(matches!(ended.strength, Strength::Opacity { least: 0.25, .. }), "{:?}", ended.strength);
    let coefficients = vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]];
    assert_eq!(found.harmonics, Some(Harmonics { degree: 1, coefficients }));
}

#[test]
fn what_is_wrong_is_named() {
    let row = "1 2 3 0 1 0 0 0 2 0.5 0 0 0 0 0 0.1 0.2 0.3";
    let columns = &format!("{COLUMNS} area");
    let refuse = |comment: &str, columns: &str, rows: &[&str], parts: &[&str]| {
        refused(Folder::new().open("a.ply", file(comment, columns, rows)), "a.ply", parts);
    };
    let surface = &format!("1 {SURFACE}");
    let good = &format!("{row} 1");
    refuse(&format!("2 {SURFACE}"), columns, &[good], &["line 3", "version \"2\""]);
    refuse(&format!("{surface} more"), columns, &[good], &["line 3", "alternate"]);
    refuse(&format!("{surface} more 1"), columns, &[good], &["\"more\" is no key"]);
    refuse(&format!("{surface} closed 1"), columns, &[good], &["each key once"]);
    refuse(&surface.replace("closed 1", "closed yes"), columns, &[good], &["closed is \"yes\"", "0 or 1"]);
    refuse(&surface.replace("closed 1 ", ""), columns, &[good], &["\"closed\" is missing"]);
    refuse(&surface.replace("floor 0.5", "floor 0"), columns, &[good], &["coverage_floor", "above 0"]);
    refuse(&surface.replace("exponent 4", "exponent inf"), columns, &[good], &["exponent is \"inf\""]);
    for least in ["-1", "1.5", "nan"] {
        let opacity = &format!("{surface} least {least}")
            .replace("surface depth_tolerance 0.25 coverage_floor 0.5 closed 1", "opacity filter classic");
        refuse(opacity, columns, &[good], &["line 3", "least is", "from 0 to 1"]);
    }
    refuse(surface, COLUMNS, &[row], &["no property area"]);
    refuse(surface, columns, &[good, &format!("{row} -1")], &["vertex 1", "area is -1"]);
    refuse(surface, columns, &[&good.replace("0.5", "NaN")], &["vertex 0", "v_x is NaN"]);
    refuse(
        surface,
        &format!("{columns} opacity"),
        &[&format!("{good} 1.5")],
        &["opacity is 1.5", "from 0 to 1"],
    );
    refuse(
        surface,
        &format!("{columns} h0_red"),
        &[&format!("{good} 1")],
        &["1 harmonics", "none, 3, 8 or 15"],
    );
    refuse(surface, columns, &[], &["no surfels in it"]);
    let shared = surface.replace("shapes each", "shapes shared");
    refuse(&shared, columns, &[good, &good.replace("0 0 2", "0 0 3")], &["vertex 1", "shapes are shared"]);
    let twice = String::from_utf8(file(surface, columns, &[good])).unwrap();
    let twice = twice.replace("element vertex", "comment oblate surfels 1\nelement vertex");
    refused(Folder::new().open("a.ply", twice), "a.ply", &["line 4", "a second comment"]);
}
