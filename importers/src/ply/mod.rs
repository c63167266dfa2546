//! PLY: meshes and trained Gaussian splats; ascii, binary little- and big-endian.
//!
//! Properties are found by their names, whatever their order and number types; other elements and properties
//! are skipped.
//!
//! **Splats** are vertices with `f_dc_0`, `scale_0` or `rot_0`, in a file without faces: Kerbl, Kopanas,
//! Leimkühler, Drettakis, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, 2023, as that paper's
//! programs write them.
//! - `x y z`: the centre. The axes stay the file's; scenes reconstructed from photographs are commonly y down.
//! - `opacity`: the logit of the peak opacity. It may be infinite: opacity 0 or 1.
//! - `scale_0..2`: logarithms of the half-axes' lengths (σ); −∞ is a flat splat.
//! - `rot_0..3`: the half-axes' rotation as a quaternion w x y z of any length but 0.
//! - `f_dc_0..2`: the colour, as (display-encoded value − ½)/0.28209479.
//! - `f_rest_*`: none, 9, 24 or 45 coefficients of spherical harmonics up to degree 1, 2 or 3: all of red, then
//!   all of green, then all of blue.
//! - `filter_3D` where given: the standard deviation of the filter of Yu, Chen, Huang, Sattler, Geiger,
//!   *Mip-Splatting*, 2024, eq. 7, which is taken into the splat's shape and opacity.
//! - Opacities were trained with a [filter of the pixel](oblate_engine::OpacityFilter) that is `Compensated` where
//!   `filter_3D` is given, `Classic` where it isn't. Comments `SplatRenderMode: default` or `mip`, `antialiased 0` or `1`
//!   say so too; the last one counts, before `filter_3D`.
//!
//! Rows that are no splats are left out: see [`crate::splats`]. The others come in Morton order, without normals,
//! unlit.
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

mod body;
mod header;
mod mesh;
mod mode;
mod packed;
mod seen;
mod splats;
pub(crate) mod surfels;
mod table;

use crate::source::Source;
use crate::{ImportError, OpenOptions, Opened};
use header::Header;
pub(crate) use splats::CONSTANT_HARMONIC;

/// Reads a mesh or splats.
pub(crate) fn read(source: Source, options: &OpenOptions) -> Result<Opened, ImportError> {
    let header = Header::parse(&source.head)?;
    let has_faces = header.element("face").is_some_and(|faces| faces.rows > 0);
    let vertex = header.element("vertex").filter(|_| !has_faces);
    let has = |name: &&str| vertex.is_some_and(|vertex| vertex.kind(name).is_some());
    if surfels::is_ours(&header) {
        return surfels::read(&source.into_file()?, &header);
    }
    match vertex {
        Some(vertex) if has(&"packed_position") => packed::read(&source, &header, vertex, options),
        Some(vertex) if ["f_dc_0", "scale_0", "rot_0"].iter().any(has) => {
            splats::read(source, &header, vertex)
        }
        _ => mesh::read(&source.into_file()?, &header, options).map(Opened::from),
    }
}
