//! Writes `.splat`, whose layout [`crate::splats::splat`] tells.
//!
//! Splats come by falling product of their σ with their opacity, as the format's own converter sorts them, so that what is
//! seen most is loaded first. Of the two quaternions of a rotation the one whose largest component is negative is written,
//! since a byte says −1 but not 1. Places and σ are exact; all else is rounded to the nearest of 256 steps.

use super::ExportError;
use super::records::{Records, Words, bound, bounded};
use crate::Note;
use crate::splats::Trained;
use crate::splats::splat::SIZE;
use oblate_engine::{Blend, Splats};
use std::io::Write;

/// Writes splats whose colours are meant to mix in `blend`.
///
/// # Errors
/// When they have no opacities, or `out` fails.
pub(crate) fn write(
    splats: &Splats,
    blend: Blend,
    out: &mut (impl Write + ?Sized),
) -> Result<Vec<Note>, ExportError> {
    let records = Records::new(splats)?;
    let weight = |index: usize| {
        let trained = records.get(index);
        let volume = trained.log_scales.iter().map(|s| f64::from(*s)).sum::<f64>().exp();
        (volume * f64::from(trained.opacity), index)
    };
    let mut order: Vec<(f64, usize)> = (0..records.count()).map(weight).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    let [mut cut_off, mut far] = [0, 0];
    for (_, index) in order {
        let mut trained = records.get(index);
        far += usize::from(bound(&mut trained));
        cut_off += usize::from(!trained.color.iter().all(|c| (0.0..=1.0).contains(c)));
        out.write_all(&row(&trained))?;
    }
    let mut notes = records.left_out(blend, &Words { compensated: false, linear: false });
    if records.per_splat > 0 {
        notes.push(Note::LeftOut("harmonics: colours don't change with the view any more".into()));
    }
    if cut_off > 0 {
        notes.push(Note::Rounded(format!("{cut_off} colours cut off at 0 or 1")));
    }
    notes.extend(bounded(far));
    notes.push(Note::Rounded("colours, opacities and rotations to 8 bits a number".into()));
    Ok(notes)
}

fn row(trained: &Trained) -> [u8; SIZE] {
    let mut row = [0; SIZE];
    let sigmas = trained.log_scales.map(|s| f64::from(s).exp() as f32);
    for (four, number) in row.as_chunks_mut().0.iter_mut().zip(trained.center.into_iter().chain(sigmas)) {
        *four = number.to_le_bytes();
    }
    let [r, g, b] = trained.color;
    row[24..28].copy_from_slice(&[r, g, b, trained.opacity].map(|share| (share * 255.0).round() as u8));
    let largest = trained.rotation.into_iter().fold(0.0, |a: f32, b| if b.abs() > a.abs() { b } else { a });
    let step = -128.0_f32.copysign(largest);
    row[28..].copy_from_slice(&trained.rotation.map(|c| (c * step + 128.0).round() as u8));
    row
}
