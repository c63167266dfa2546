//! Splats to GLB with KHR_gaussian_splatting.
//!
//! Source: Khronos, *KHR_gaussian_splatting*, release candidate of 2026. Single precision throughout, one buffer, one view, in
//! which a splat's numbers stand together: centre, quaternion (x y z w), σ, opacity, harmonics from degree 0. Axes are
//! written as they are, so what is not +Y up in oblate isn't in the file. The extension has no word for
//! opacities that were trained with a compensated filter, and no harmonics that oblate could mean for linear colours.

use super::ExportError;
use super::records::{Records, Words};
use crate::Note;
use crate::splats::{Trained, constant};
use glam::{DQuat, DVec3, Vec3};
use gltf::json::serialize::to_vec;
use oblate_engine::{Blend, Splats};
use serde_json::json;
use std::io::Write;

const NAME: &str = "KHR_gaussian_splatting";

/// Splats that are written at a time.
const ROWS: usize = 4096;

/// Writes splats that have opacities, on the axes that they have, under a node that turns `up`, a unit vector, to +y.
pub(crate) fn write(
    splats: &Splats,
    (blend, up): (Blend, DVec3),
    out: &mut dyn Write,
) -> Result<Vec<Note>, ExportError> {
    let records = Records::new(splats)?;
    let mut notes = records.left_out(blend, &Words { compensated: false, linear: true });
    let harmonics = if blend == Blend::Display { records.per_splat } else { 0 };
    if harmonics < records.per_splat {
        let what = "harmonics: those of oblate are sums of display-encoded colours, the file's would be of linear ones";
        notes.push(Note::LeftOut(what.into()));
    }
    let (description, binary) = describe(splats, (blend, up), harmonics)?;
    let total = 12 + 8 + description.len() as u64 + 8 + binary;
    let too_large =
        |_| ExportError::Unsuited(format!("a GLB has at most 4 GiB; these splats need {total} bytes"));
    let total = u32::try_from(total).map_err(too_large)?;
    out.write_all(b"glTF")?;
    for number in [2, total, description.len() as u32] {
        out.write_all(&number.to_le_bytes())?;
    }
    out.write_all(b"JSON")?;
    out.write_all(&description)?;
    out.write_all(&(binary as u32).to_le_bytes())?;
    out.write_all(b"BIN\0")?;
    let count = records.count();
    for start in (0..count).step_by(ROWS) {
        let rows = start..count.min(start + ROWS);
        let numbers = rows.flat_map(|index| {
            let record = records.get(index);
            let color = if blend == Blend::Linear { splats.colors[index] } else { record.color };
            row(record, color, harmonics)
        });
        let bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
        out.write_all(&bytes)?;
    }
    Ok(notes)
}

/// The numbers of a splat.
fn row(record: Trained, color: [f32; 3], harmonics: usize) -> impl Iterator<Item = f32> {
    let [w, x, y, z] = record.rotation;
    let sigmas = record.log_scales.map(|log| f64::from(log).exp() as f32);
    let rest = record.harmonics.into_iter().take(harmonics).flatten();
    let numbers = record.center.into_iter().chain([x, y, z, w]).chain(sigmas).chain([record.opacity]);
    numbers.chain(constant(color)).chain(rest)
}

/// The JSON chunk, padded, and the length of the binary one.
fn describe(
    splats: &Splats,
    (blend, up): (Blend, DVec3),
    harmonics: usize,
) -> Result<(Vec<u8>, u64), ExportError> {
    let count = splats.centers.len();
    let low = splats.centers.iter().copied().reduce(Vec3::min);
    let high = splats.centers.iter().copied().reduce(Vec3::max);
    // There are splats: that was asked.
    let (low, high) = (low.unwrap_or_default(), high.unwrap_or_default());
    let own = |name: &str| format!("{NAME}:{name}");
    let mut columns = vec![
        ("POSITION".to_owned(), "VEC3", 3),
        (own("ROTATION"), "VEC4", 4),
        (own("SCALE"), "VEC3", 3),
        (own("OPACITY"), "SCALAR", 1),
        (own("SH_DEGREE_0_COEF_0"), "VEC3", 3),
    ];
    for number in 1..=harmonics {
        let degree = number.isqrt();
        let order = number - degree * degree;
        columns.push((own(&format!("SH_DEGREE_{degree}_COEF_{order}")), "VEC3", 3));
    }
    let mut stride = 0;
    let mut accessors = Vec::new();
    let mut attributes = serde_json::Map::new();
    for (name, kind, width) in columns {
        attributes.insert(name, json!(accessors.len()));
        let accessor = json!({ "bufferView": 0, "byteOffset": stride, "componentType": 5126, "count": count, "type": kind });
        accessors.push(accessor);
        stride += 4 * width;
    }
    accessors[0]["min"] = json!(low.to_array());
    accessors[0]["max"] = json!(high.to_array());
    let length = count as u64 * stride as u64;
    let space = if blend == Blend::Linear { "lin_rec709_display" } else { "srgb_rec709_display" };
    let description = json!({
        "asset": { "version": "2.0", "generator": "oblate" },
        "extensionsUsed": [NAME],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "rotation": upright(up).to_array() }],
        "meshes": [{ "primitives": [{
            "mode": 0,
            "attributes": attributes,
            "extensions": { NAME: { "kernel": "ellipse", "colorSpace": space } },
        }] }],
        "accessors": accessors,
        "bufferViews": [{ "buffer": 0, "byteLength": length, "byteStride": stride, "target": 34962 }],
        "buffers": [{ "byteLength": length }],
    });
    let mut text = to_vec(&description).map_err(std::io::Error::from)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    Ok((text, length))
}

/// What turns `up` to +y: about x from where y points down.
fn upright(up: DVec3) -> DQuat {
    if up.dot(DVec3::Y) < -0.999 {
        DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0)
    } else {
        DQuat::from_rotation_arc(up, DVec3::Y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::File;
    use crate::{Content, OpenOptions};
    use oblate_engine::{Harmonics, Material, OpacityFilter, Shapes, Strength};
    use std::path::PathBuf;

    /// Splats in Morton order, in which they come back.
    fn splats(degree: u8) -> Splats {
        use glam::{Mat3, Quat};
        let count = 3 * ROWS / 2;
        let number = |i: usize, k: usize| ((i * 31 + k * 17) % 101) as f32 / 101.0;
        let factor = |i: usize| {
            let turn = Quat::from_xyzw(number(i, 1) - 0.5, number(i, 2), number(i, 3) - 0.5, 0.3).normalize();
            Mat3::from_quat(turn)
                * Mat3::from_diagonal(Vec3::new(number(i, 4) + 0.02, 0.1 * number(i, 5) + 0.01, 0.003))
        };
        let per_splat = (usize::from(degree) + 1).pow(2) - 1;
        let coefficients =
            (0..count * per_splat).map(|i| [number(i, 6) - 0.5, number(i, 7), -number(i, 8)]).collect();
        Splats {
            centers: (0..count).map(|i| Vec3::new(number(i, 9), -7.0 * number(i, 10), i as f32)).collect(),
            shapes: Shapes::Each((0..count).map(factor).collect()),
            strength: Strength::Opacity {
                peaks: (0..count).map(|i| number(i, 11)).collect(),
                filter: OpacityFilter::Classic,
                least: Strength::LEAST_OF_TRAINED,
            },
            colors: (0..count).map(|i| [number(i, 12), number(i, 13), number(i, 14)]).collect(),
            harmonics: (degree > 0).then_some(Harmonics { degree, coefficients }),
            normals: None,
            material: Material::UNLIT,
        }
        .in_morton_order()
    }

    fn there_and_back(splats: &Splats, blend: Blend) -> (Vec<Note>, Splats, Blend) {
        let mut bytes = Vec::new();
        let notes = write(splats, (blend, DVec3::Y), &mut bytes).unwrap();
        assert_eq!(bytes.len() % 4, 0);
        let file = File { path: PathBuf::from("a.glb"), bytes };
        let opened = crate::gltf::read(&file, &OpenOptions::default()).unwrap();
        assert_eq!(opened.notes, []);
        let Content::Splats { splats, blend, .. } = opened.content else { panic!("splats are expected") };
        (notes, splats, blend)
    }

    #[test]
    fn splats_come_back() {
        for (degree, blend) in [
            (0, Blend::Display),
            (1, Blend::Display),
            (2, Blend::Display),
            (3, Blend::Display),
            (0, Blend::Linear),
        ] {
            let wanted = splats(degree);
            let (notes, found, found_blend) = there_and_back(&wanted, blend);
            assert_eq!((notes, found_blend), (vec![], blend));
            assert_eq!((&found.centers, &found.strength), (&wanted.centers, &wanted.strength));
            assert_eq!(found.harmonics, wanted.harmonics);
            for (found, wanted) in found.colors.as_flattened().iter().zip(wanted.colors.as_flattened()) {
                assert!((found - wanted).abs() < 1e-6, "{found} {wanted}");
            }
            for index in 0..wanted.centers.len() {
                // Axes may come back the other way around.
                let covariance = |splats: &Splats| {
                    let factor = splats.shapes.factor(index);
                    factor * factor.transpose()
                };
                // σ up to 1.
                assert!(covariance(&found).abs_diff_eq(covariance(&wanted), 1e-6), "{index}");
            }
        }
    }

    #[test]
    fn what_the_format_cannot_say_is_noted() {
        let mut splats = splats(1);
        let Strength::Opacity { filter, .. } = &mut splats.strength else { panic!() };
        *filter = OpacityFilter::Compensated;
        splats.normals = Some(vec![Vec3::Z; splats.centers.len()]);
        splats.material = Material::default();
        let (notes, found, _) = there_and_back(&splats, Blend::Linear);
        let parts = ["compensation", "normals", "light", "harmonics"];
        assert!(
            notes.len() == 4 && notes.iter().zip(parts).all(|(note, part)| note.to_string().contains(part)),
            "{notes:?}"
        );
        assert_eq!(found.harmonics, None);
        let masses = vec![1.0; splats.centers.len()];
        splats.strength = Strength::Extinction { masses };
        let error = write(&splats, (Blend::Linear, DVec3::Y), &mut Vec::new()).unwrap_err();
        assert!(error.to_string().contains("peak opacities"), "{error}");
    }
}
