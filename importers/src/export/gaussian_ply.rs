//! Writes splats as PLY, the way programs that train them do; [`crate::ply`] tells the layout.
//!
//! All columns that other programs look for are there, whether splats need them or not: `x y z`, `nx ny nz` (zeros), `f_dc_*`,
//! `f_rest_*` up to the splats' degree, `opacity`, `scale_*` and `rot_*`, as little-endian floats. A header of splats that
//! were trained [with compensation](OpacityFilter::Compensated) says `SplatRenderMode: mip` and `antialiased 1`.
//!
//! All numbers are finite, since not every program reads others:
//! - Opacities become logits within ±88, which is as far as exponentials go in single precision: 1 comes back as 1, and
//!   0 as 6e-39.
//! - A half-axis of length 0 gets 2⁻²⁴ of the splat's longest one, which is less than the rounding of that one. One
//!   of a splat without any extent gets e⁻⁴⁰, and no logarithm is beyond ±40.

use super::ExportError;
use super::records::{Records, Words, bound, bounded};
use crate::Note;
use crate::splats::{LARGEST_LOG_SCALE, Trained, constant};
use oblate_engine::{Blend, OpacityFilter, Splats};
use std::io::Write;

/// The largest logit that is written.
const LARGEST_LOGIT: f64 = 88.0;

/// ln 2⁻²⁴: a flat half-axis against the longest.
const FLAT: f32 = -16.635_532;

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
    out.write_all(header(&records).as_bytes())?;
    let [mut certain, mut flat, mut far] = [0, 0, 0];
    let mut bytes = Vec::new();
    for index in 0..records.count() {
        let mut trained = records.get(index);
        let longest = trained.log_scales.into_iter().fold(f32::NEG_INFINITY, f32::max);
        certain += usize::from(trained.opacity == 0.0 || trained.opacity == 1.0);
        flat += usize::from(trained.log_scales.contains(&f32::NEG_INFINITY));
        far += usize::from(bound(&mut trained));
        let portable =
            |s: f32| if s == f32::NEG_INFINITY { (longest + FLAT).max(-LARGEST_LOG_SCALE) } else { s };
        trained.log_scales = trained.log_scales.map(portable);
        bytes.clear();
        let row = row(trained, records.per_splat);
        row.for_each(|number| bytes.extend(number.to_le_bytes()));
        out.write_all(&bytes)?;
    }
    let mut notes = records.left_out(blend, &Words { compensated: true, linear: false });
    if certain > 0 {
        notes.push(Note::Rounded(format!("{certain} opacities of 0 or 1, as logits of ±88")));
    }
    if flat > 0 {
        let what = "flat splats, whose half-axes of length 0 are written as 2⁻²⁴ of their longest";
        notes.push(Note::Rounded(format!("{flat} {what}")));
    }
    notes.extend(bounded(far));
    Ok(notes)
}

fn header(records: &Records<'_>) -> String {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    if records.filter == OpacityFilter::Compensated {
        header += "comment SplatRenderMode: mip\ncomment antialiased 1\n";
    }
    header += &format!("element vertex {}\n", records.count());
    let numbered = |name: &str, count: usize| (0..count).map(|i| format!("{name}_{i}")).collect::<Vec<_>>();
    let names = [
        ["x", "y", "z", "nx", "ny", "nz"].map(String::from).to_vec(),
        numbered("f_dc", 3),
        numbered("f_rest", 3 * records.per_splat),
        vec!["opacity".into()],
        numbered("scale", 3),
        numbered("rot", 4),
    ];
    names.concat().iter().for_each(|name| header += &format!("property float {name}\n"));
    header + "end_header\n"
}

/// The numbers of a splat, in the order of the header.
fn row(trained: Trained, per_splat: usize) -> impl Iterator<Item = f32> {
    let opacity = f64::from(trained.opacity);
    let logit = (opacity / (1.0 - opacity)).ln().clamp(-LARGEST_LOGIT, LARGEST_LOGIT) as f32;
    // All of a channel stand together in the file.
    let harmonics = trained.harmonics;
    let rest = (0..3).flat_map(move |channel| (0..per_splat).map(move |number| harmonics[number][channel]));
    let zeros = [0.0; 3];
    (trained.center.into_iter().chain(zeros).chain(constant(trained.color)).chain(rest))
        .chain([logit])
        .chain(trained.log_scales)
        .chain(trained.rotation)
}
