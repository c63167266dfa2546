//! PLY: meshes, points and trained Gaussian splats; ascii, binary little- and big-endian.
//!
//! Properties are found by their names, whatever their order and number types; other elements and properties
//! are skipped.
//!
//! **Splats** are vertices with `f_dc_0`, `scale_0` or `rot_0`, in a file without faces: Kerbl, Kopanas,
//! Leimkühler, Drettakis, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, 2023, as that paper's
//! programs write them.
//! - `x y z`: the centre. The axes stay the file's; scenes reconstructed from photographs are commonly y down.
//! - `opacity`: the logit of the peak opacity. It may be infinite: opacity 0 or 1.
//! - `scale_0..2`: logarithms of the half-axes' lengths (σ); −∞ is a flat splat. Without `scale_2` all are flat, as
//!   Huang, Yu, Chen, Geiger, Gao, *2D Gaussian Splatting for Geometrically Accurate Radiance Fields*, 2024, has them.
//! - `rot_0..3`: the half-axes' rotation as a quaternion w x y z of any length but 0.
//! - `f_dc_0..2`: the colour, as (display-encoded value − ½)/0.28209479. A file without them may have
//!   `red green blue`, display-encoded, uchar or ushort, instead.
//! - `f_rest_*`: none, 9, 24 or 45 coefficients of spherical harmonics up to degree 1, 2 or 3: all of red, then
//!   all of green, then all of blue.
//! - `filter_3D` where given: the standard deviation of the filter of Yu, Chen, Huang, Sattler, Geiger,
//!   *Mip-Splatting*, 2024, eq. 7, which is taken into the splat's shape and opacity.
//! - Opacities were trained with a [filter of the pixel](oblate_engine::OpacityFilter) that is `Compensated` where
//!   `filter_3D` is given, `Classic` where it isn't. Comments `SplatRenderMode: default`, `mip` or `2dgs`,
//!   `antialiased 0` or `1` say so too; the last one counts, before `filter_3D`. (2DGS has a filter of its own, which keeps
//!   peaks: `Classic` is next to it.)
//!
//! All others are refused that lack one of these columns, normals and `f_rest_*` apart. Rows that are no splats are left out:
//! see [`crate::splats`]. The others come in Morton order, without normals, unlit.
//!
//! What is doubtful is drawn as it stands, and [noted](crate::Note::Assumed): comments that contradict one another,
//! `filter_3D`, or the third half-axis (2DGS: at most a hundredth of the longest). Of more than 100 splats also
//! - opacities that all lie in [0, 1], and differ: logits lie on both sides of 0; perhaps they are opacities already;
//! - scales that are all above 0, the least of them below 0.05, and differ: half-axes of nearly one unit would be the
//!   finest of the scene; perhaps they are lengths and no logarithms.
//!
//! Binary rows without lists are read block by block, so that a file is never in memory as a whole; others are.
//!
//! **Packed splats** (.compressed.ply), binary, have elements
//! - `chunk`, one for each 256 splats: floats `min_x` … `max_z` of centres, `min_scale_x` … `max_scale_z` of logarithms of
//!   σ and, where given, `min_r` … `max_b` of display-encoded colours, which are from 0 to 1 without them;
//! - `vertex`: uints `packed_position` and `packed_scale`, x y z in 11, 10 and 11 bits from the highest on, from the chunk's
//!   least to its most; `packed_color`, red, green, blue (from the chunk's least to its most) and peak opacity (from 0 to
//!   one) in 8 bits each; `packed_rotation`, in the highest 2 bits which of w x y z is the largest, then the others in 10 bits
//!   each, from −√½ to √½;
//! - `sh` where given: 9, 24 or 45 uchars `f_rest_*` from −4 to 4, in the middle of 256 steps, the first and last at the ends.
//!
//! Comments count as above; `SplatRenderMode: 2dgs` makes splats flat, since they all have a third scale. Files that
//! unpack to more than [`OpenOptions::max_memory`] are refused.
//!
//! Source: *SuperSplat* and *splat-transform* of PlayCanvas, whose format this is.
//!
//! **Surfels** as oblate writes them have a comment that begins with `oblate surfels`, and every number that splats have.
//!
//! **Meshes** have elements `vertex` and `face`:
//! - `x y z`, and `nx ny nz` where given.
//! - `red green blue` and `alpha` (also `diffuse_red` and so on): integers are scaled to [0, 1]; PLY has no
//!   defined colour space, so they count as sRGB-encoded, alpha as linear.
//! - `s t`, `u v` or `texture_u texture_v`, or a list `texcoord` in each face (two numbers a corner). Their
//!   v grows upwards, as in OBJ, and is flipped. `comment TextureFile NAME` names the image.
//! - `vertex_indices` or `vertex_index`: polygons become fans; faces of fewer than three corners are none.
//!   Colours of whole faces are not read.
//!
//! **Points** are the vertices of any other file without faces:
//! - `x y z`; `nx ny nz` or `normal_x normal_y normal_z`; `radius`.
//! - `red green blue` (also `diffuse_red` and so on, or `r g b`) as of meshes.
//! - `intensity`, `scalar_Intensity` or `scalar_intensity`, else the first property whose name begins with `scalar_`.
//!
//! See [`crate::points`]. What other elements with rows the file has is noted.
//!
//! Bytes behind the last row are noted where they are met: not with splats and surfels in text, nor in text where other rows follow
//! points, nor in binary where rows with lists are in the file and the points are not last.

mod body;
mod header;
mod mesh;
mod mode;
mod packed;
mod points;
mod seen;
mod splats;
pub(crate) mod surfels;
mod table;

use crate::source::Source;
use crate::{ImportError, Note, OpenOptions, Opened};
use header::Header;

/// Reads a mesh, points or splats.
pub(crate) fn read(source: Source, options: &OpenOptions) -> Result<Opened, ImportError> {
    let header = Header::parse(&source.head)?;
    let rest = header.end().and_then(|end| source.size.checked_sub(end));
    let mut opened = read_rows(source, &header, options)?;
    opened.notes.extend(behind_rows(rest.unwrap_or(0)));
    Ok(opened)
}

/// What is said of so many bytes behind the last row.
fn behind_rows(count: usize) -> Option<Note> {
    (count > 0).then(|| Note::LeftOut(format!("{count} bytes behind the last row that is declared")))
}

fn read_rows(source: Source, header: &Header, options: &OpenOptions) -> Result<Opened, ImportError> {
    let has_faces = header.element("face").is_some_and(|faces| faces.rows > 0);
    let vertex = header.element("vertex").filter(|_| !has_faces);
    let has = |name: &&str| vertex.is_some_and(|vertex| vertex.kind(name).is_some());
    if surfels::is_ours(header) {
        return surfels::read(&source.into_file()?, header);
    }
    match vertex {
        Some(vertex) if has(&"packed_position") => packed::read(&source, header, vertex, options),
        Some(vertex) if ["f_dc_0", "scale_0", "rot_0"].iter().any(has) => {
            splats::read(source, header, vertex)
        }
        Some(vertex) => points::read(&source.into_file()?, header, vertex),
        None => mesh::read(&source.into_file()?, header, options),
    }
}
