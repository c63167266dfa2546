use crate::common::{Folder, mesh};
use glam::Vec3;
use oblate_importers::{Content, Note};

/// A tetrahedron, its corners counter-clockwise seen from outside.
const CORNERS: [Vec3; 4] = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.0, 0.0, 2.0)];
const FACETS: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

fn normal(facet: [usize; 3]) -> Vec3 {
    let [a, b, c] = facet.map(|corner| CORNERS[corner]);
    (b - a).cross(c - a).normalize()
}

fn binary_with(header: &[u8], attribute: [u8; 2]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend(4_u32.to_le_bytes());
    for facet in FACETS {
        for vector in [normal(facet)].into_iter().chain(facet.map(|corner| CORNERS[corner])) {
            bytes.extend(vector.to_array().iter().flat_map(|c| c.to_le_bytes()));
        }
        bytes.extend(attribute);
    }
    bytes
}

pub(crate) fn binary() -> Vec<u8> {
    binary_with(b"a tetrahedron", [0; 2])
}

pub(crate) fn ascii() -> String {
    let mut text = "solid a name of words\n".to_owned();
    for facet in FACETS {
        let n = normal(facet);
        text += &format!("facet normal {:e} {} {}\n outer loop\n", n.x, n.y, n.z);
        for Vec3 { x, y, z } in facet.map(|corner| CORNERS[corner]) {
            text += &format!("  vertex {x:e} {y} {z}\n");
        }
        text += " endloop\nendfacet\n";
    }
    text + "endsolid a name of words\n"
}

#[test]
fn both_encodings_are_the_same_closed_surface() {
    let folder = Folder::new();
    let opened = folder.open("a.stl", binary()).unwrap();
    assert_eq!(opened.notes, []);
    let from_binary = mesh(Ok(opened));
    let primitive = &from_binary.primitives[0];
    assert_eq!(primitive.triangles, [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]]);
    assert_eq!(primitive.positions[3..6], [CORNERS[0], CORNERS[1], CORNERS[3]]);
    assert!(primitive.double_sided && primitive.normals.is_none());
    assert!(from_binary.is_closed());
    // ½ + 1 + 1 + ½ √(2² + 2² + 1²).
    assert!((from_binary.area() - 4.0).abs() < 1e-6, "{}", from_binary.area());
    assert_eq!(folder.mesh("a.stl", ascii()), from_binary);
    // Content tells, not the name; words in any case, lines of Windows, several solids.
    assert_eq!(folder.mesh("b", binary()), from_binary);
    assert_eq!(
        folder.mesh(
            "b",
            ascii()
                .to_uppercase()
                .replace("NAME", "\r\n")
                .replace('\n', "\r\n")
                .replace("\r\r\n OF WORDS", "")
        ),
        from_binary
    );
    assert_eq!(folder.mesh("b", format!("\u{feff}{}", ascii())), from_binary);
    let twice = folder.mesh("b", ascii() + &ascii());
    assert_eq!(twice.primitives[0].triangles.len(), 8);
}

#[test]
fn binary_files_may_begin_with_solid() {
    let folder = Folder::new();
    let wanted = folder.mesh("a.stl", binary());
    // Text only, but for the number of facets: the size tells.
    assert_eq!(folder.mesh("a.stl", binary_with(b"solid of facet normals", [0; 2])), wanted);
    // With a name that ends in zeros it is no text either.
    let mut longer = binary_with(b"solid \0\0", [0; 2]);
    longer.extend([1, 2, 3]);
    let opened = folder.open("a.stl", &longer).unwrap();
    assert_eq!(opened.notes, [Note::LeftOut("3 bytes behind the 4 facets that are declared".into())]);
    assert_eq!(mesh(Ok(opened)), wanted);
}

#[test]
fn what_is_not_taken_is_noted() {
    let folder = Folder::new();
    let opened = folder.open("a.stl", binary_with(b"COLOR=....", [0, 0x80])).unwrap();
    assert_eq!(opened.notes, [Note::LeftOut("attribute bytes (colours, perhaps) of 4 facets".into())]);
    let mut bytes = binary();
    // The first facet's normal is −z.
    bytes[84 + 8..84 + 12].copy_from_slice(&1_f32.to_le_bytes());
    let opened = folder.open("a.stl", &bytes).unwrap();
    let note = opened.notes[0].to_string();
    assert!(matches!(&opened.notes[..], [Note::Assumed(_)]) && note.contains("for 1 facets"), "{note}");
    let Content::Mesh(found) = opened.content else { panic!("a mesh is expected") };
    assert_eq!(found, folder.mesh("a.stl", binary()));
}

#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let refuse = |bytes: &[u8], parts: &[&str]| drop(folder.refused("a.stl", bytes, parts));
    refuse(&binary()[..283], &["byte 80", "4 facets are declared", "for 3"]);
    refuse(&binary()[..80], &["begins with 84 bytes", "there are 80"]);
    refuse(b"", &["begins with 84 bytes"]);
    let declares = |count: u32| [&binary()[..80], &count.to_le_bytes(), &binary()[84..]].concat();
    refuse(&declares(u32::MAX), &["byte 80", "4294967295 facets", "bytes for 4"]);
    refuse(&declares(0), &["no triangles"]);
    let mut bytes = binary();
    bytes[84 + 50 + 24..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    refuse(&bytes, &["byte 158", "corner 1 of facet 1", "finite"]);

    let changed = |from: &str, to: &str| ascii().replacen(from, to, 1).into_bytes();
    refuse(&changed("  vertex 0e0 0 0\n", ""), &["line 7", "fewer than three"]);
    refuse(&changed(" endloop", "vertex 1 2 3\n endloop"), &["line 7", "three corners"]);
    refuse(&changed("vertex 0e0 0 0", "vertex 0e0 0"), &["line 4", "three finite numbers"]);
    refuse(&changed("vertex 0e0 0 0", "vertex 0e0 0 0 1"), &["line 4", "three finite numbers"]);
    refuse(&changed("vertex 0e0 0 0", "vertex 0e0 nan 0"), &["line 4", "three finite numbers"]);
    refuse(&changed("vertex 0e0 0 0", "vertex 0e0 x 0"), &["line 4", "three finite numbers"]);
    refuse(&changed("endfacet", ""), &["line 9", "\"facet\" is not expected"]);
    refuse(&changed("outer loop", "loops"), &["line 3", "\"loops\" is not expected"]);
    refuse(&changed("endsolid a name of words", ""), &["before its endsolid"]);
    refuse(b"solid a\nendsolid a\n", &["no triangles"]);
    let text = ascii();
    for length in 0..text.len() - "endsolid a name of words\n".len() {
        refuse(&text.as_bytes()[..length], &[]);
    }
}
