//! VTI (VTK ImageData in XML) of a volume, as [`crate::volumes::vtk::xml`] reads it: appended raw data of one piece, samples
//! at points, `Direction` as VTK 9 has it. Samples and origin are bit-equal when read again, spacing and direction to the last
//! digit or two of double precision.

use super::ExportError;
use super::samples::{PIECE, Packing, pieces, size};
use crate::Note;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::DVec3;
use oblate_volumes::{Space, Volume, Voxels};
use rayon::prelude::*;
use std::io::{self, Write};

/// Writes a volume. Deflated blocks wait in memory until all their sizes are known.
pub(crate) fn write(
    volume: &Volume,
    packing: Packing,
    out: &mut dyn Write,
) -> Result<Vec<Note>, ExportError> {
    let frame = volume.frame();
    let [x, y, z] = volume.dims().map(|count| count - 1);
    let extent = format!("0 {x} 0 {y} 0 {z}");
    let compressor = match packing {
        Packing::Raw => "",
        Packing::Deflated => " compressor=\"vtkZLibDataCompressor\"",
    };
    let rows = frame.direction.transpose();
    let direction = [rows.x_axis, rows.y_axis, rows.z_axis].map(numbers).join(" ");
    writeln!(out, "<?xml version=\"1.0\"?>")?;
    writeln!(
        out,
        "<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\"{compressor}>"
    )?;
    writeln!(
        out,
        "<ImageData WholeExtent=\"{extent}\" Origin=\"{}\" Spacing=\"{}\" Direction=\"{direction}\">",
        numbers(frame.origin),
        numbers(frame.spacing)
    )?;
    writeln!(out, "<Piece Extent=\"{extent}\">\n<PointData Scalars=\"values\">")?;
    writeln!(
        out,
        "<DataArray type=\"{}\" Name=\"values\" NumberOfComponents=\"1\" format=\"appended\" offset=\"0\"/>",
        type_name(volume.voxels())
    )?;
    write!(out, "</PointData>\n</Piece>\n</ImageData>\n<AppendedData encoding=\"raw\">\n_")?;
    let bytes = volume.voxels().len() * size(volume.voxels());
    let count = bytes.div_ceil(PIECE);
    let piece = pieces(volume.voxels());
    match packing {
        Packing::Raw => {
            header(out, &[bytes])?;
            (0..count).try_for_each(|number| out.write_all(&piece(number)))?;
        }
        Packing::Deflated => {
            let blocks: Vec<Vec<u8>> = (0..count)
                .into_par_iter()
                .map(|number| deflated(&piece(number)))
                .collect::<Result<_, _>>()?;
            // Blocks, their size, and that of the last where it is shorter.
            header(out, &[count, PIECE, bytes % PIECE])?;
            header(out, &blocks.iter().map(Vec::len).collect::<Vec<_>>())?;
            blocks.iter().try_for_each(|block| out.write_all(block))?;
        }
    }
    writeln!(out, "\n</AppendedData>\n</VTKFile>")?;
    let unnamed = |space: Space| Note::LeftOut(format!("the name of the space, {}", space.name()));
    Ok(frame.space.map(unnamed).into_iter().collect())
}

fn header(out: &mut dyn Write, numbers: &[usize]) -> io::Result<()> {
    numbers.iter().try_for_each(|&number| out.write_all(&(number as u64).to_le_bytes()))
}

fn deflated(bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// Numbers whose digits give back their bits.
fn numbers(v: DVec3) -> String {
    format!("{:?} {:?} {:?}", v.x, v.y, v.z)
}

fn type_name(voxels: &Voxels) -> &'static str {
    match voxels {
        Voxels::U8(_) => "UInt8",
        Voxels::U16(_) => "UInt16",
        Voxels::I16(_) => "Int16",
        Voxels::F32(_) => "Float32",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::samples::tests::{close, frame, volumes};
    use crate::file::File;
    use crate::volumes::vtk::xml::read;
    use crate::{Content, OpenOptions};
    use oblate_volumes::GridFrame;
    use proptest::prelude::*;

    fn there_and_back(volume: &Volume, packing: Packing) -> Volume {
        let mut bytes = Vec::new();
        assert_eq!(write(volume, packing, &mut bytes).unwrap(), []);
        let opened = read(&File { path: "a.vti".into(), bytes }, &OpenOptions::default());
        let Content::Volume(volume) = opened.unwrap().content else { panic!("a volume is expected") };
        volume
    }

    #[test]
    fn samples_come_back_in_several_blocks() {
        for volume in volumes(GridFrame::default(), true) {
            for packing in [Packing::Raw, Packing::Deflated] {
                assert!(there_and_back(&volume, packing) == volume, "{}", volume.voxels().type_name());
            }
        }
    }

    #[test]
    fn the_name_of_a_space_is_left_out() {
        let frame = GridFrame { space: Some(Space::Ras), ..GridFrame::default() };
        let left_out = Note::LeftOut("the name of the space, right-anterior-superior".into());
        for volume in volumes(frame, false) {
            assert_eq!(
                write(&volume, Packing::Raw, &mut Vec::new()).unwrap(),
                std::slice::from_ref(&left_out)
            );
        }
    }

    proptest! {
        #[test]
        fn turned_frames_come_back_to_the_last_digits(frame in frame()) {
            for volume in volumes(frame, false) {
                let back = there_and_back(&volume, Packing::Deflated);
                prop_assert_eq!(back.voxels(), volume.voxels());
                close(back.frame(), frame)?;
            }
        }
    }
}
