//! KSPLAT of all levels.

use crate::common::{Folder, splats};
use glam::{Mat3, Vec3};
use oblate_engine::{Splats, Strength};
use oblate_importers::Note;

/// A section, and the splats in it: a byte string each.
#[derive(Clone)]
struct Section {
    count: u32,
    room: u32,
    degree: u16,
    capacity: u32,
    full: u32,
    /// Sizes of buckets that are not full.
    partial: Vec<u32>,
    centers: Vec<[f32; 3]>,
    splats: Vec<Vec<u8>>,
}

fn file(level: u16, bounds: [f32; 2], sections: &[Section]) -> Vec<u8> {
    let mut file = vec![0; 4096];
    let count: u32 = sections.iter().map(|section| section.count).sum();
    file[1] = 1;
    file[4..8].copy_from_slice(&(sections.len() as u32).to_le_bytes());
    file[16..20].copy_from_slice(&count.to_le_bytes());
    file[20..22].copy_from_slice(&level.to_le_bytes());
    file[36..40].copy_from_slice(&bounds[0].to_le_bytes());
    file[40..44].copy_from_slice(&bounds[1].to_le_bytes());
    for section in sections {
        let mut header = vec![0; 1024];
        let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, &section.count.to_le_bytes());
        put(4, &section.room.to_le_bytes());
        put(8, &section.capacity.to_le_bytes());
        put(12, &(section.centers.len() as u32).to_le_bytes());
        // Blocks of 2 units, of which 1000 steps are half.
        put(16, &2_f32.to_le_bytes());
        put(20, &(if level == 0 { 0_u16 } else { 12 }).to_le_bytes());
        put(24, &1000_u32.to_le_bytes());
        put(32, &section.full.to_le_bytes());
        put(36, &(section.partial.len() as u32).to_le_bytes());
        put(40, &section.degree.to_le_bytes());
        file.extend(header);
    }
    for section in sections {
        file.extend(section.partial.iter().flat_map(|size| size.to_le_bytes()));
        file.extend(section.centers.iter().flatten().flat_map(|c| c.to_le_bytes()));
        file.extend(section.splats.concat());
    }
    file
}

fn singles(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn halves(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| half::f16::from_f32(*value).to_le_bytes()).collect()
}

const RGBA: [u8; 4] = [255, 0, 102, 51];

/// σ 2, 1, 0.5; a quarter turn about z: w = z = 1/√2.
const SHAPE: [f32; 7] =
    [2.0, 1.0, 0.5, std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2];

fn plain(center: [f32; 3], harmonics: &[f32]) -> Vec<u8> {
    [singles(&center), singles(&SHAPE), RGBA.to_vec(), singles(harmonics)].concat()
}

fn packed(steps: [u16; 3], harmonics: &[u8]) -> Vec<u8> {
    let steps: Vec<u8> = steps.iter().flat_map(|step| step.to_le_bytes()).collect();
    [steps, halves(&SHAPE), RGBA.to_vec(), harmonics.to_vec()].concat()
}

fn unpacked(degree: u16, splats: Vec<Vec<u8>>) -> Section {
    let count = splats.len() as u32;
    let (partial, centers) = (Vec::new(), Vec::new());
    Section { count, room: count, degree, capacity: 0, full: 0, partial, centers, splats }
}

/// A full bucket of two around (10, 0, 0), one of one around (20, 0, 0), one of two around (30, 0, 0).
fn bucketed(degree: u16, harmonics: &[u8]) -> Section {
    let steps =
        [[1000, 1000, 1000], [2000, 1000, 1000], [1000, 1500, 1000], [1000, 1000, 0], [500, 1000, 1000]];
    Section {
        count: 5,
        room: 5,
        degree,
        capacity: 2,
        full: 1,
        partial: vec![1, 2],
        centers: vec![[10.0, 0.0, 0.0], [20.0, 0.0, 0.0], [30.0, 0.0, 0.0]],
        splats: steps.iter().map(|steps| packed(*steps, harmonics)).collect(),
    }
}

pub(crate) fn example() -> Vec<u8> {
    file(2, [-1.0, 1.0], &[bucketed(1, &[128; 9])])
}

fn sorted(splats: &Splats) -> Vec<Vec3> {
    let mut centers = splats.centers.clone();
    centers.sort_by(|a, b| a.x.total_cmp(&b.x));
    centers
}

#[test]
fn splats_of_all_levels() {
    let folder = Folder::new();
    let plain = file(0, [0.0; 2], &[unpacked(0, vec![plain([1.0, 2.0, 3.0], &[])])]);
    let one = vec![packed([1000; 3], &[])];
    let section = Section { count: 1, room: 1, full: 0, partial: vec![1], splats: one, ..bucketed(0, &[]) };
    let packed = file(1, [0.0; 2], &[section]);
    for (file, center) in [(plain, Vec3::new(1.0, 2.0, 3.0)), (packed, Vec3::new(10.0, 0.0, 0.0))] {
        assert_eq!(folder.open("a.ksplat", &file).unwrap().notes, []);
        let opened = folder.open("a.ksplat", [&file[..], &[0; 3]].concat()).unwrap();
        assert_eq!(opened.notes, [Note::LeftOut("3 bytes behind the last section".into())]);
        let splats = splats(Ok(opened));
        assert_eq!(splats.centers, [center]);
        // x goes to y, y to −x; halves have 11 bits.
        let expected = Mat3::from_cols(Vec3::Y * 2.0, Vec3::NEG_X, Vec3::Z * 0.5);
        assert!(splats.shapes.factor(0).abs_diff_eq(expected, 2e-3), "{}", splats.shapes.factor(0));
        let Strength::Opacity { peaks, .. } = &splats.strength else { panic!() };
        assert_eq!(peaks, &[0.2]);
        // 0.4 as sRGB is 0.1329 in linear light.
        let [r, g, b] = splats.colors[0];
        assert!(r == 1.0 && g == 0.0 && (b - 0.1329).abs() < 1e-4, "{r} {g} {b}");
    }
}

#[test]
fn full_buckets_then_others() {
    for (level, harmonics) in [(1, 18), (2, 9)] {
        let section = bucketed(1, &vec![0; harmonics]);
        let all = [section.clone(), Section { degree: 0, ..bucketed(0, &[]) }];
        let splats = splats(Folder::new().open("a.ksplat", file(level, [-1.0, 1.0], &all)));
        // Steps of 1/1000; the third splat is alone, the fourth and fifth share a bucket. All twice.
        let once =
            [[10.0, 0.0, 0.0], [11.0, 0.0, 0.0], [20.0, 0.5, 0.0], [29.5, 0.0, 0.0], [30.0, 0.0, -1.0]];
        let twice: Vec<Vec3> = once.into_iter().flat_map(|center| [Vec3::from(center); 2]).collect();
        assert_eq!(sorted(&splats), twice);
        // The second section has no harmonics: they are 0.
        let harmonics = splats.harmonics.unwrap();
        assert_eq!((harmonics.degree, harmonics.coefficients.len()), (1, 30));
        let low = if level == 1 { 0.0 } else { -1.0 };
        assert_eq!(
            harmonics.coefficients.iter().filter(|c| **c == [low; 3]).count(),
            if level == 1 { 30 } else { 15 }
        );
    }
}

#[test]
fn harmonics_by_degree_then_channel() {
    // Numbers 0 to 23 over 32 in the order of the file.
    let values: Vec<f32> = (0..24).map(|number| number as f32 / 32.0).collect();
    let bytes: Vec<u8> = (0..24).collect();
    let files = [
        (file(0, [0.0; 2], &[unpacked(2, vec![plain([0.0; 3], &values)])]), 1.0 / 32.0),
        (
            file(
                1,
                [0.0; 2],
                &[Section { splats: vec![packed([0; 3], &halves(&values)); 5], ..bucketed(2, &[]) }],
            ),
            1.0 / 32.0,
        ),
        (
            file(2, [0.0, 0.0], &[Section { splats: vec![packed([0; 3], &bytes); 5], ..bucketed(2, &[]) }]),
            3.0 / 255.0,
        ),
    ];
    for (level, (file, step)) in files.into_iter().enumerate() {
        let harmonics = splats(Folder::new().open("a.ksplat", file)).harmonics.unwrap();
        // Bounds of 0 are those by default, ±1.5.
        let value = |number: u8| f32::from(number) * step - if level == 2 { 1.5 } else { 0.0 };
        let close = |found: [f32; 3], expected: [u8; 3]| {
            let all = found.iter().zip(expected).all(|(f, e)| (f - value(e)).abs() < 1e-6);
            assert!(all, "level {level}: {found:?} is not {expected:?}");
        };
        close(harmonics.coefficients[0], [0, 3, 6]);
        close(harmonics.coefficients[2], [2, 5, 8]);
        close(harmonics.coefficients[3], [9, 14, 19]);
        close(harmonics.coefficients[7], [13, 18, 23]);
    }
}

#[test]
fn places_that_are_not_filled() {
    let mut section = bucketed(0, &[]);
    section.count = 4;
    let opened = Folder::new().open("a.ksplat", file(1, [0.0; 2], &[section])).unwrap();
    assert!(
        matches!(&opened.notes[..], [Note::LeftOut(what)] if what.contains("1 of 5 places")),
        "{:?}",
        opened.notes
    );
    assert_eq!(splats(Ok(opened)).centers.len(), 4);
}

#[test]
fn what_is_refused() {
    let folder = Folder::new();
    let whole = example();
    let refuse = |at: usize, bytes: &[u8], parts: &[&str]| {
        let mut file = whole.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        folder.refused("a.ksplat", file, parts);
    };
    folder.refused("a.ksplat", &whole[..4095], &["4096 bytes", "there are 4095"]);
    refuse(0, &[1], &["version 1.1"]);
    refuse(1, &[0], &["version 0.0"]);
    refuse(20, &[3], &["byte 20", "level 3"]);
    refuse(16, &[6], &["byte 16", "should be 6 splats; the sections have 5"]);
    refuse(4, &[255; 4], &["byte 4", "4294967295 sections do not fit"]);
    refuse(4, &[0], &["should be 5 splats; the sections have 0"]);
    refuse(4096, &[6], &["section 0", "6 splats and room for 5"]);
    refuse(4096 + 4, &[255; 4], &["section 0", "bytes for splats", "are left"]);
    refuse(4096 + 12, &[255; 4], &["section 0", "bytes for buckets"]);
    refuse(4096 + 12, &[2], &["section 0", "1 full and 2 other buckets, in all 2"]);
    refuse(4096 + 20, &[8], &["section 0", "8 bytes, which must be 12"]);
    refuse(4096 + 36, &[255; 4], &["section 0", "sizes of buckets"]);
    refuse(4096 + 8, &[1], &["section 0", "5 splats; its buckets hold 4"]);
    refuse(4096 + 40, &[3], &["section 0", "degree 3", "0 to 2"]);
    folder.refused("a.ksplat", &whole[..whole.len() - 1], &["section 0", "bytes for splats"]);
    folder.refused("a.ksplat", file(0, [0.0; 2], &[]), &["no splats"]);
}
