//! Packed splats in PLY.

use crate::common::{Folder, refused, splats};
use glam::{DVec3, Mat3, Quat, Vec3};
use oblate_engine::{OpacityFilter, Splats, Strength};
use oblate_importers::{Note, OpenOptions};
use proptest::prelude::*;

/// A file: ranges by chunk, four words for each splat, bytes of harmonics.
#[derive(Clone)]
struct Packed {
    comments: &'static str,
    with_colors: bool,
    /// As in the file: 12 numbers, and 6 more with colours.
    chunks: Vec<Vec<f32>>,
    vertices: Vec<[u32; 4]>,
    /// `sh` has as many properties as its rows are long.
    harmonics: Vec<Vec<u8>>,
}

const LOW: [f32; 6] = [-1.0, -2.0, -4.0, -3.0, -2.0, -1.0];
const HIGH: [f32; 6] = [1.0, 2.0, 4.0, -1.0, 0.0, 1.0];
/// The identity: w is the largest, the others are in the middle, which 10 bits have none of: 512/1023.
const UNTURNED: u32 = 512 << 20 | 512 << 10 | 512;

impl Packed {
    /// Splats between −(1, 2, 4) and (1, 2, 4).
    fn new(vertices: &[[u32; 4]]) -> Self {
        let chunk = [&LOW[..3], &HIGH[..3], &LOW[3..], &HIGH[3..]].concat();
        let chunks = vec![chunk; vertices.len().div_ceil(256)];
        Self { comments: "", with_colors: false, chunks, vertices: vertices.to_vec(), harmonics: Vec::new() }
    }

    fn header(&self) -> String {
        let mut header = format!("ply\nformat binary_little_endian 1.0\n{}", self.comments);
        header += &format!("element chunk {}\n", self.chunks.len());
        for kind in ["", "scale_"] {
            for end in ["min", "max"] {
                ["x", "y", "z"].iter().for_each(|c| header += &format!("property float {end}_{kind}{c}\n"));
            }
        }
        if self.with_colors {
            for end in ["min", "max"] {
                ["r", "g", "b"].iter().for_each(|c| header += &format!("property float {end}_{c}\n"));
            }
        }
        header += &format!("element vertex {}\n", self.vertices.len());
        for name in ["position", "rotation", "scale", "color"] {
            header += &format!("property uint packed_{name}\n");
        }
        if let Some(row) = self.harmonics.first() {
            header += &format!("element sh {}\n", self.harmonics.len());
            (0..row.len()).for_each(|i| header += &format!("property uchar f_rest_{i}\n"));
        }
        header + "end_header\n"
    }

    fn file(&self) -> Vec<u8> {
        let mut file = self.header().into_bytes();
        file.extend(self.chunks.iter().flatten().flat_map(|number| number.to_le_bytes()));
        file.extend(self.vertices.iter().flatten().flat_map(|word| word.to_le_bytes()));
        file.extend(self.harmonics.iter().flatten());
        file
    }

    fn open(&self) -> Splats {
        splats(Folder::new().open("a.compressed.ply", self.file()))
    }

    #[track_caller]
    fn refused(&self, parts: &[&str]) {
        Folder::new().refused("a.compressed.ply", self.file(), parts);
    }
}

/// Two splats with colours and harmonics of degree 1.
pub(crate) fn example() -> Vec<u8> {
    let mut packed = Packed::new(&[[0, UNTURNED, 0, 0x8040_20ff], [u32::MAX, UNTURNED | 3 << 30, 7, 1]]);
    packed.with_colors = true;
    packed.chunks[0].extend([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    packed.harmonics = vec![vec![128; 9], vec![0, 1, 2, 3, 4, 5, 6, 7, 255]];
    packed.file()
}

fn peaks(splats: &Splats) -> &[f32] {
    let Strength::Opacity { peaks, .. } = &splats.strength else { panic!("opacities are expected") };
    peaks
}

#[test]
fn numbers_are_between_those_of_their_chunk() {
    // x and z have 11 bits, y 10: 2047 is the most, 1023 the most.
    let position = 2047 << 21 | 2047;
    let scale = 1023 << 11 | 1024;
    let splats = Packed::new(&[[position, UNTURNED, scale, 0xff00_8040]]).open();
    assert_eq!(splats.centers, [Vec3::new(1.0, -2.0, 4.0)]);
    let factor = splats.shapes.factor(0);
    // z: −1 + 2 · 1024/2047.
    let expected = [(-3.0_f64).exp(), 1.0, (-1.0 + 2.0 * 1024.0 / 2047.0_f64).exp()];
    for (axis, length) in expected.into_iter().enumerate() {
        assert!((factor.col(axis).as_dvec3().length() / length - 1.0).abs() < 1e-6);
    }
    // The middle of 10 bits is half a step off: 0.5/1023 · √2 in each of x y z, twice that as an angle.
    let angle = 2.0 * 3.0_f32.sqrt() * 2.0_f32.sqrt() * 0.5 / 1023.0;
    let turned = factor.x_axis.angle_between(Vec3::X);
    assert!(turned <= angle * 1.001 && turned > 0.0, "{turned}");
    assert_eq!(peaks(&splats), [64.0 / 255.0]);
    let [r, g, b] = splats.colors[0];
    // sRGB's 128/255 is 0.21586.
    assert!(r == 1.0 && g == 0.0 && (b - 0.215_861).abs() < 1e-6, "{r} {g} {b}");
    assert!(splats.harmonics.is_none() && splats.normals.is_none());
}

#[test]
fn colors_may_have_a_range() {
    let mut packed = Packed::new(&[[0, UNTURNED, 0, 0xff00_66ff]]);
    packed.with_colors = true;
    packed.chunks[0].extend([-9.0, -1.0, 0.0, 0.5, 9.0, 2.5]);
    // 102/255 of 2.5 is 1, and −1 is cut off.
    let [r, g, b] = packed.open().colors[0];
    assert!((r - 0.214_041).abs() < 1e-6 && g == 0.0 && (b - 1.0).abs() < 1e-6, "{r} {g} {b}");
}

#[test]
fn the_largest_of_a_quaternion_is_left_out() {
    // ½ in each of the three that are stored is 0.5/√2 + 0.5 of 1023, about 873: what is left is about ½ too.
    for largest in 0..4_u32 {
        // The first stored one is negated.
        let word = largest << 30 | (1023 - 873) << 20 | 873 << 10 | 873;
        let factor = Packed::new(&[[0, word, 0, 255]]).open().shapes.factor(0);
        let mut q = [0.5_f32; 4];
        q[usize::from(largest == 0)] = -0.5;
        let [w, x, y, z] = q;
        let rotation = Mat3::from_quat(Quat::from_xyzw(x, y, z, w));
        let lengths = LOW.map(f32::exp);
        for axis in 0..3 {
            let direction = factor.col(axis) / lengths[3 + axis];
            // 873/1023 is 0.0002 from what ½ would be; three of them, √2 times, twice as an angle.
            assert!(direction.abs_diff_eq(rotation.col(axis), 2e-3), "{largest}: {direction}");
        }
    }
}

#[test]
fn each_256_splats_have_a_chunk() {
    // More than are read at a time, and not a multiple of it.
    let count = (1 << 14) + 300;
    let mut packed = Packed::new(&vec![[0, UNTURNED, 0, 255]; count]);
    packed.chunks.iter_mut().enumerate().for_each(|(i, chunk)| chunk[0] = i as f32);
    packed.harmonics = (0..count).map(|i| vec![(i / 256) as u8; 9]).collect();
    let splats = packed.open();
    let coefficients = &splats.harmonics.as_ref().unwrap().coefficients;
    let mut found = vec![0; packed.chunks.len()];
    for (index, center) in splats.centers.iter().enumerate() {
        found[center.x as usize] += 1;
        // Coefficients have come along: the middles of steps from −4 on, 1/32 wide.
        let expected = if center.x == 0.0 { -4.0 } else { (center.x + 0.5) / 32.0 - 4.0 };
        assert_eq!(coefficients[3 * index + 2], [expected; 3]);
    }
    assert_eq!(found.pop(), Some(300 - 256));
    assert!(found.iter().all(|splats| *splats == 256));
}

#[test]
fn harmonics_are_middles_of_steps_by_channel() {
    for (degree, count) in [(1, 3), (2, 8), (3, 15)] {
        let mut packed = Packed::new(&[[0, UNTURNED, 0, 255]]);
        packed.harmonics = vec![(0..3 * count).map(|i| (i * 5) as u8).collect()];
        packed.harmonics[0][3 * count - 1] = 255;
        let splats = packed.open();
        let harmonics = splats.harmonics.unwrap();
        assert_eq!((harmonics.degree, harmonics.coefficients.len()), (degree, count));
        // −4 and 4 at the ends; byte 128 would be 1/64.
        assert_eq!((harmonics.coefficients[0][0], harmonics.coefficients[count - 1][2]), (-4.0, 4.0));
        let green = (5.0 * count as f32 + 0.5) / 256.0;
        assert_eq!(harmonics.coefficients[0][1], (green - 0.5) * 8.0);
    }
}

#[test]
fn comments_count() {
    let mut packed = Packed::new(&[[0, UNTURNED, 0, 255]]);
    let filter = |packed: &Packed| match packed.open().strength {
        Strength::Opacity { filter, .. } => filter,
        _ => panic!("opacities are expected"),
    };
    assert_eq!(filter(&packed), OpacityFilter::Classic);
    packed.comments = "comment antialiased 1\n";
    assert_eq!(filter(&packed), OpacityFilter::Compensated);
    packed.comments = "comment SplatRenderMode: 2dgs\n";
    assert_eq!(packed.open().shapes.factor(0).z_axis, Vec3::ZERO);
    let notes = Folder::new().open("a.ply", packed.file()).unwrap().notes;
    assert!(matches!(&notes[..], [Note::Assumed(said)] if said.contains("2DGS")), "{notes:?}");
}

#[test]
fn what_is_wrong_is_said() {
    let right = Packed::new(&[[0, UNTURNED, 0, 255]; 2]);
    let mut wrong = right.clone();
    wrong.chunks.push(wrong.chunks[0].clone());
    wrong.refused(&["2 chunks for 2 splats; 1 are needed"]);
    wrong.chunks.clear();
    wrong.refused(&["0 chunks for 2 splats"]);
    let mut wrong = right.clone();
    wrong.chunks[0][0] = f32::NAN;
    wrong.refused(&["no splats", "2 with a number that is NaN"]);
    let mut wrong = right.clone();
    wrong.harmonics = vec![vec![0; 9]];
    wrong.refused(&["\"sh\" has 1 rows for 2 splats"]);
    wrong.harmonics = vec![vec![0; 10]; 2];
    wrong.refused(&["\"sh\" has 10 properties", "9, 24 or 45"]);
    Packed::new(&[]).refused(&["no splats"]);
    let text = right.header();
    for (from, to, said) in [
        ("element chunk", "element chunks", "an element \"chunk\""),
        ("float max_scale_y", "float max_scale", "max_scale_y of type float in element \"chunk\""),
        ("float max_scale_y", "double max_scale_y", "max_scale_y of type float"),
        ("uint packed_scale", "int packed_scale", "packed_scale of type uint in element \"vertex\""),
        ("binary_little_endian", "ascii", "must be in binary rows"),
        ("vertex 2", "vertex 255", "255 rows of element \"vertex\" need at least 16 bytes each, but only 32"),
        ("chunk 1\n", "chunk 1\nproperty float min_r\n", "min_g of type float"),
    ] {
        let file = [text.replace(from, to).as_bytes(), &right.file()[text.len()..]].concat();
        Folder::new().refused("a.ply", file, &[said]);
    }
    let options = OpenOptions { max_memory: 127, ..OpenOptions::default() };
    refused(
        Folder::new().open_with("a.ply", right.file(), &options),
        "a.ply",
        &["take 128 bytes; the limit that is set is 127"],
    );
    let options = OpenOptions { max_memory: 128, ..OpenOptions::default() };
    assert!(Folder::new().open_with("a.ply", right.file(), &options).is_ok());
}

proptest! {
    #[test]
    fn packed_and_unpacked(
        share in prop::array::uniform3(0.0..=1.0f64),
        scale in prop::array::uniform3(0.0..=1.0f64),
        q in prop::array::uniform4(-1.0..1.0f64),
    ) {
        let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
        prop_assume!(norm > 0.1);
        let q = q.map(|c| c / norm);
        let largest = (0..4).fold(0, |a, b| if q[b].abs() > q[a].abs() { b } else { a });
        let bits = |value: f64, most: u32| (value * f64::from(most)).round() as u32;
        let three = |[x, y, z]: [f64; 3]| bits(x, 2047) << 21 | bits(y, 1023) << 11 | bits(z, 2047);
        let rotation = (0..4).filter(|i| *i != largest).fold(largest as u32, |word, i| {
            word << 10 | bits(q[i] * q[largest].signum() / 2.0_f64.sqrt() + 0.5, 1023)
        });
        let splats = Packed::new(&[[three(share), rotation, three(scale), 255]]).open();
        let factor = splats.shapes.factor(0).as_dmat3();
        let turned = glam::DMat3::from_quat(glam::DQuat::from_xyzw(q[1], q[2], q[3], q[0]));
        let center = splats.centers[0].as_dvec3().to_array();
        for axis in 0..3 {
            let (low, high) = (f64::from(LOW[axis]), f64::from(HIGH[axis]));
            // Half a step of 10 bits, and the rounding to single precision.
            let half = 0.5 / 1023.0;
            let expected = low + (high - low) * share[axis];
            prop_assert!((center[axis] - expected).abs() <= (high - low) * half + 1e-6);
            let (low, high) = (f64::from(LOW[3 + axis]), f64::from(HIGH[3 + axis]));
            let expected = low + (high - low) * scale[axis];
            let length = factor.col(axis).length();
            prop_assert!((length.ln() - expected).abs() <= (high - low) * half + 1e-6);
            // Three of √2 · half a step, and what the largest makes of them (it is ½ at least, so thrice their sum at
            // most): 4 · √2 · √3 of half steps, twice that as an angle.
            let off = (factor.col(axis) / length - turned.col(axis)).length();
            prop_assert!(off <= 2.0 * 4.0 * 6.0_f64.sqrt() * half, "{off}");
            prop_assert!(DVec3::from(center).is_finite());
        }
    }
}
