//! NRRD of a volume, attached, as [`crate::volumes::nrrd`] reads it.
//!
//! Samples are bit-equal when read again, and so is the origin. The format has no spacing beside `space directions`,
//! the edges of a voxel: spacing and direction are bit-equal where the grid's axes are the world's (in any order, of
//! either sign), else to the last digit or two of double precision.

use super::ExportError;
use super::samples::{PIECE, Packing, pieces, size};
use crate::Note;
use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use oblate_volumes::{Volume, Voxels};
use std::io::Write;

/// Writes a volume.
pub(crate) fn write(
    volume: &Volume,
    packing: Packing,
    out: &mut dyn Write,
) -> Result<Vec<Note>, ExportError> {
    let [x, y, z] = volume.dims();
    let frame = volume.frame();
    let edges = [0, 1, 2].map(|axis| vector(frame.direction.col(axis) * frame.spacing[axis]));
    writeln!(out, "NRRD0005")?;
    writeln!(out, "type: {}", type_name(volume.voxels()))?;
    match frame.space {
        Some(space) => writeln!(out, "dimension: 3\nspace: {}\nsizes: {x} {y} {z}", space.name())?,
        None => writeln!(out, "dimension: 3\nspace dimension: 3\nsizes: {x} {y} {z}")?,
    }
    writeln!(out, "space directions: {}\nspace origin: {}", edges.join(" "), vector(frame.origin))?;
    writeln!(out, "kinds: domain domain domain\nendian: little")?;
    writeln!(out, "encoding: {}\n", if packing == Packing::Raw { "raw" } else { "gzip" })?;
    let piece = pieces(volume.voxels());
    let count = (volume.voxels().len() * size(volume.voxels())).div_ceil(PIECE);
    match packing {
        Packing::Raw => (0..count).try_for_each(|number| out.write_all(&piece(number)))?,
        Packing::Deflated => {
            let mut encoder = GzEncoder::new(out, Compression::default());
            (0..count).try_for_each(|number| encoder.write_all(&piece(number)))?;
            encoder.finish()?;
        }
    }
    Ok(Vec::new())
}

/// A vector whose digits give back its bits.
fn vector(v: DVec3) -> String {
    format!("({:?},{:?},{:?})", v.x, v.y, v.z)
}

fn type_name(voxels: &Voxels) -> &'static str {
    match voxels {
        Voxels::U8(_) => "unsigned char",
        Voxels::U16(_) => "unsigned short",
        Voxels::I16(_) => "short",
        Voxels::F32(_) => "float",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::OpenOptions;
    use crate::export::samples::tests::{close, frame, volumes};
    use crate::file::File;
    use crate::volumes::nrrd::read;
    use glam::DMat3;
    use oblate_volumes::{GridFrame, Space};
    use proptest::prelude::*;

    fn there_and_back(volume: &Volume, packing: Packing) -> Volume {
        let mut bytes = Vec::new();
        assert_eq!(write(volume, packing, &mut bytes).unwrap(), []);
        read(&File { path: "a.nrrd".into(), bytes }, &OpenOptions::default()).unwrap()
    }

    #[test]
    fn volumes_along_the_axes_come_back_as_they_were() {
        let mut axes = vec![DMat3::IDENTITY];
        axes.push(DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z));
        axes.push(DMat3::from_cols(-DVec3::Z, DVec3::X, -DVec3::Y));
        for (direction, large) in axes.into_iter().zip([true, false, false]) {
            let (spacing, origin) = (DVec3::new(0.1, 49.0, 1e-7), DVec3::new(-1e-3, 2.0 / 3.0, 1e20));
            for volume in volumes(GridFrame { spacing, origin, direction, space: None }, large) {
                for packing in [Packing::Raw, Packing::Deflated] {
                    assert!(there_and_back(&volume, packing) == volume, "{}", volume.voxels().type_name());
                }
            }
        }
    }

    #[test]
    fn spaces_keep_their_names() {
        for space in Space::ALL.map(Some).into_iter().chain([None]) {
            for volume in volumes(GridFrame { space, ..GridFrame::default() }, false) {
                assert_eq!(there_and_back(&volume, Packing::Raw).frame(), volume.frame());
            }
        }
    }

    proptest! {
        #[test]
        fn turned_frames_come_back_to_the_last_digits(frame in frame()) {
            for volume in volumes(frame, false) {
                let back = there_and_back(&volume, Packing::Raw);
                prop_assert_eq!(back.voxels(), volume.voxels());
                close(back.frame(), frame)?;
            }
        }
    }
}
