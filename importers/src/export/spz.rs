//! SPZ, version 3; the layout is told in [`crate::splats::spz`].
//!
//! Numbers are rounded as the reference does it:
//!
//! - positions to a power of ½ that all fit, 2⁻¹² where nothing speaks against it; finer ones for scenes of less than 16
//!   units, so that there are 2¹⁶ steps across them;
//! - log scales to 1/16, from −10 to 5.9375;
//! - rotations to 9 bits and a sign for each of three components;
//! - opacities to 8 bits; coefficients of the constant harmonic to 8 bits from −3.33 to 3.33;
//! - harmonics to 5 bits from −1 to 1 for degree 1, to 4 bits for degrees 2 and 3.

use super::ExportError;
use super::records::{Records, Words};
use crate::Note;
use crate::splats::spz::{ANTIALIASED, Axes, COLOR_SCALE, MAGIC};
use crate::splats::{Trained, constant};
use flate2::Compression;
use flate2::write::GzEncoder;
use oblate_engine::{Blend, OpacityFilter, Splats};
use std::f32::consts::SQRT_2;
use std::io::Write;

/// Fractional bits where nothing speaks against it.
const FRACTIONAL_BITS: i32 = 12;
/// The largest fixed-point number.
const LARGEST: f32 = 8_388_607.0;

/// Numbers beyond what the format can say.
#[derive(Default)]
struct CutOff {
    log_scales: usize,
    colors: usize,
    harmonics: usize,
}

/// Writes splats with opacities.
///
/// # Errors
/// When they have no opacities, a position is out of range, or `out` fails.
pub(crate) fn write(splats: &Splats, blend: Blend, out: &mut dyn Write) -> Result<Vec<Note>, ExportError> {
    let records = Records::new(splats)?;
    let unsuited = |problem: &str| ExportError::Unsuited(format!(".spz holds {problem}"));
    let count = records.count();
    let Ok(stated) = u32::try_from(count) else {
        return Err(unsuited("no more than 2³² − 1 splats"));
    };
    let bits =
        fractional_bits(splats).ok_or_else(|| unsuited("positions up to ±8388607; some here are beyond"))?;
    let degree = splats.harmonics.as_ref().map_or(0, |harmonics| harmonics.degree);
    let per_splat = records.per_splat;
    let antialiased = match records.filter {
        OpacityFilter::Classic => 0,
        OpacityFilter::Compensated => ANTIALIASED,
    };

    let (axes, mut cut_off) = (Axes::of_format(), CutOff::default());
    let mut columns: [Vec<u8>; 6] =
        [9, 1, 3, 3, 4, 3 * per_splat].map(|size| Vec::with_capacity(size * count));
    for index in 0..count {
        let mut splat = records.get(index);
        axes.apply(&mut splat);
        pack(&splat, (bits, per_splat), &mut columns, &mut cut_off);
    }
    let mut gzip = GzEncoder::new(out, Compression::default());
    gzip.write_all(MAGIC)?;
    gzip.write_all(&3_u32.to_le_bytes())?;
    gzip.write_all(&stated.to_le_bytes())?;
    gzip.write_all(&[degree, bits as u8, antialiased, 0])?;
    for column in &columns {
        gzip.write_all(column)?;
    }
    gzip.finish()?;
    let mut notes = records.left_out(blend, &Words { compensated: true, linear: false });
    notes.extend(rounded(per_splat, bits, &cut_off));
    Ok(notes)
}

/// As many bits as make sense and fit; `None` if no number does.
fn fractional_bits(splats: &Splats) -> Option<i32> {
    let centers = || splats.centers.iter().copied();
    let low = centers().reduce(glam::Vec3::min)?;
    let high = centers().reduce(glam::Vec3::max)?;
    let largest = low.abs().max(high.abs()).max_element();
    let wanted = 16 - (high - low).max_element().log2().ceil().clamp(-100.0, 4.0) as i32;
    (0..=wanted.clamp(FRACTIONAL_BITS, 24))
        .rev()
        .find(|bits| (largest * 2_f32.powi(*bits)).round() <= LARGEST)
}

fn pack(splat: &Trained, (bits, per_splat): (i32, usize), columns: &mut [Vec<u8>; 6], cut_off: &mut CutOff) {
    let [positions, alphas, colors, scales, rotations, harmonics] = columns;
    for coordinate in splat.center {
        let fixed = (coordinate * 2_f32.powi(bits)).round() as i32;
        positions.extend_from_slice(&fixed.to_le_bytes()[..3]);
    }
    alphas.push(byte(splat.opacity * 255.0));
    let packed = constant(splat.color).map(|coefficient| (COLOR_SCALE * coefficient + 0.5) * 255.0);
    cut_off.colors += usize::from(packed.iter().any(|value| is_beyond(*value)));
    colors.extend(packed.map(byte));
    let packed = splat.log_scales.map(|scale| (scale + 10.0) * 16.0);
    cut_off.log_scales += usize::from(packed.iter().any(|value| is_beyond(*value)));
    scales.extend(packed.map(byte));
    rotations.extend(smallest_three(splat.rotation).to_le_bytes());
    let mut beyond = false;
    for (number, color) in splat.harmonics[..per_splat].iter().enumerate() {
        let bucket = if number < 3 { 8 } else { 16 };
        for coefficient in color {
            let fine = (coefficient * 128.0).round() + 128.0;
            beyond |= is_beyond(fine);
            // The middles of buckets, of which 0 is one.
            let fine = fine.clamp(-1000.0, 1000.0) as i32;
            harmonics.push((fine + bucket / 2).div_euclid(bucket).saturating_mul(bucket).clamp(0, 255) as u8);
        }
    }
    cut_off.harmonics += usize::from(beyond);
}

fn byte(value: f32) -> u8 {
    value.round() as u8
}

fn is_beyond(value: f32) -> bool {
    !(-0.5..255.5).contains(&value)
}

/// A quaternion w x y z of length 1.
fn smallest_three([w, x, y, z]: [f32; 4]) -> u32 {
    let components = [x, y, z, w];
    let mut largest = 0;
    for (index, component) in components.iter().enumerate() {
        if component.abs() > components[largest].abs() {
            largest = index;
        }
    }
    let mut packed = largest as u32;
    for (_, component) in components.iter().enumerate().filter(|(index, _)| *index != largest) {
        let size = (511.0 * component.abs() * SQRT_2 + 0.5) as u32;
        // The largest is not negative: both signs are the same turn.
        let negative = component.is_sign_negative() != components[largest].is_sign_negative();
        packed = packed << 10 | u32::from(negative) << 9 | size.min(511);
    }
    packed
}

/// What was rounded, and how far.
fn rounded(per_splat: usize, bits: i32, cut_off: &CutOff) -> Vec<Note> {
    let mut notes = vec![Note::Rounded(format!(
        "positions to 2^-{bits}, log scales to 1/16, rotations to 10 bits, opacities and colours to 8 bits"
    ))];
    if per_splat > 0 {
        let what = "harmonics to 5 bits from −1 to 1 for degree 1, to 4 bits above";
        notes.push(Note::Rounded(what.into()));
    }
    let ranges = [
        (cut_off.log_scales, "log scales to those from −10 to 5.9375"),
        (cut_off.colors, "colours to what 8 bits can say"),
        (cut_off.harmonics, "harmonics to those from −1 to 1"),
    ];
    for (count, what) in ranges.into_iter().filter(|(count, _)| *count > 0) {
        notes.push(Note::Rounded(format!("{what}, of {count} splats")));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::File;
    use crate::splats::{spz, trained};
    use crate::{Content, OpenOptions, Opened};
    use glam::{Mat3, Quat, Vec3};
    use oblate_engine::{Harmonics, Material, Shapes, Strength};
    use proptest::prelude::*;

    fn splats(centers: Vec<Vec3>, factor: Mat3, peak: f32, harmonics: Option<Harmonics>) -> Splats {
        let count = centers.len();
        Splats {
            centers,
            shapes: Shapes::Each(vec![factor; count]),
            strength: Strength::Opacity {
                peaks: vec![peak; count],
                filter: OpacityFilter::Compensated,
                least: Strength::LEAST_OF_TRAINED,
            },
            colors: vec![[0.5, 0.1, 0.9]; count],
            harmonics,
            normals: None,
            material: Material::UNLIT,
        }
    }

    fn there_and_back(splats: &Splats) -> (Splats, Vec<Note>) {
        let mut bytes = Vec::new();
        let notes = write(splats, Blend::Display, &mut bytes).unwrap();
        let opened = spz::read(&File { path: "a.spz".into(), bytes }, &OpenOptions::default()).unwrap();
        let Opened { content: Content::Splats { splats, blend: Blend::Display, .. }, .. } = opened else {
            panic!()
        };
        (splats, notes)
    }

    proptest! {
        #[test]
        fn numbers_are_rounded_no_further_than_said(
            center in prop::array::uniform3(-2000.0..2000.0_f32),
            q in prop::array::uniform4(-1.0..1.0_f32),
            log_scales in prop::array::uniform3(-10.0..5.9_f32),
            peak in 0.0..=1.0_f32,
            degree in 0..=3_u8,
            coefficients in prop::array::uniform15(-0.9..0.9_f32),
        ) {
            prop_assume!(q.iter().map(|c| c * c).sum::<f32>() > 0.01);
            let turn = Quat::from_array(q).normalize();
            let factor = Mat3::from_quat(turn) * Mat3::from_diagonal(Vec3::from(log_scales).exp());
            let of_row = (usize::from(degree) + 1).pow(2) - 1;
            let harmonics = (degree > 0).then(|| Harmonics {
                degree,
                coefficients: coefficients[..of_row].iter().map(|c| [*c, 0.0, -c]).collect(),
            });
            let before = splats(vec![center.into()], factor, peak, harmonics);
            let (after, _) = there_and_back(&before);
            // A single position has no extent: as many bits as fit it, here at least 12.
            prop_assert!((after.centers[0] - before.centers[0]).abs().max_element() <= 0.5 / 4096.0);
            let (found, wanted) = (trained(&after, 0).unwrap(), trained(&before, 0).unwrap());
            for (a, b) in found.log_scales.iter().zip(wanted.log_scales) {
                prop_assert!((a - b).abs() <= 0.5 / 16.0 + 1e-5, "{} {}", a, b);
            }
            prop_assert!((found.opacity - peak).abs() <= 0.5 / 255.0 + 1e-6);
            for (a, b) in found.color.iter().zip(wanted.color) {
                // A step is 0.28209 / 0.15 / 255 = 0.00738.
                prop_assert!((a - b).abs() <= 0.0037 + 1e-4, "{} {}", a, b);
            }
            // Half-axes don't change order or sign beyond what mirrors of two do: compare Σ of unit half-axes, turned
            // by what three components off by half of √½/511 turn: (4 · 1.7) · 0.0007 for each.
            let unit = |splats: &Splats, record: &Trained| {
                let factor = splats.shapes.factor(0).as_dmat3();
                let lengths = record.log_scales.map(|s| f64::from(s).exp());
                let axes = [factor.x_axis, factor.y_axis, factor.z_axis];
                [0, 1, 2].map(|i| axes[i] / lengths[i])
            };
            for (a, b) in unit(&after, &found).iter().zip(unit(&before, &wanted)) {
                prop_assert!(a.dot(b).abs() > 1.0 - 2e-5, "{} {}", a, b);
            }
            let bucket = |number: usize| if number < 3 { 4.0 / 128.0 } else { 8.0 / 128.0 };
            for number in 0..of_row {
                let (a, b) = (found.harmonics[number], wanted.harmonics[number]);
                for channel in 0..3 {
                    // Half a bucket, and half of 1/128 that is rounded to before.
                    prop_assert!((a[channel] - b[channel]).abs() <= bucket(number) + 0.5 / 128.0 + 1e-5);
                }
            }
            let Strength::Opacity { filter, .. } = after.strength else { panic!() };
            prop_assert_eq!(filter, OpacityFilter::Compensated);
        }
    }

    #[test]
    fn positions_take_the_bits_that_fit() {
        let bits = |centers: &[f32]| {
            let centers = centers.iter().map(|c| Vec3::splat(*c)).collect();
            fractional_bits(&splats(centers, Mat3::IDENTITY, 1.0, None))
        };
        assert_eq!(bits(&[-100.0, 100.0]), Some(12));
        // 2⁻¹⁶ of a unit; the cube of an eighth.
        assert_eq!(bits(&[0.0, 1.0]), Some(16));
        assert_eq!(bits(&[0.0, 0.125]), Some(19));
        // Far away, what fits: 2²³ / 1000 is 2¹³.
        assert_eq!(bits(&[1000.0, 1001.0]), Some(13));
        assert_eq!(bits(&[-100_000.0, 0.0]), Some(6));
        assert_eq!(bits(&[8_388_607.0]), Some(0));
        assert_eq!(bits(&[8_388_608.0]), None);
        let (back, notes) = there_and_back(&splats(vec![Vec3::splat(-1e6)], Mat3::IDENTITY, 1.0, None));
        assert_eq!(back.centers, [Vec3::splat(-1e6)]);
        assert!(notes[0].to_string().contains("2^-3"), "{}", notes[0]);
    }

    #[test]
    fn what_is_cut_off_is_said() {
        let harmonics = Some(Harmonics { degree: 1, coefficients: vec![[2.0; 3]; 3] });
        let flat = Mat3::from_diagonal(Vec3::new(1.0, 1.0, 0.0));
        let mut before = splats(vec![Vec3::ZERO], flat, 1.0, harmonics);
        before.colors = vec![[1e6, 0.0, 0.0]];
        let (after, notes) = there_and_back(&before);
        let notes: Vec<String> = notes.iter().map(Note::to_string).collect();
        let said = |part: &str| assert!(notes.iter().any(|note| note.contains(part)), "{part}: {notes:?}");
        said("log scales to those from −10");
        said("colours to what 8 bits");
        said("harmonics to those from −1 to 1, of 1 splats");
        assert!((after.shapes.factor(0).z_axis.z.abs() - (-10_f32).exp()).abs() < 1e-8);
        // −128/128 to 127/128 on the format's axes, on which those odd in y or z are −2.
        let coefficients = [[1.0; 3], [1.0; 3], [127.0 / 128.0; 3]];
        assert_eq!(after.harmonics.unwrap().coefficients, coefficients);
    }

    #[test]
    fn surfels_are_refused() {
        let mut surfels = splats(vec![Vec3::ZERO], Mat3::IDENTITY, 1.0, None);
        surfels.strength = Strength::Extinction { masses: vec![1.0] };
        let error = write(&surfels, Blend::Display, &mut Vec::new()).unwrap_err();
        assert!(error.to_string().contains("peak opacities"), "{error}");
    }
}
