//! Primitives of meshes.

use super::accessor::{Accessors, Integers};
use super::buffers::Buffers;
use super::material::Materials;
use crate::file::File;
use crate::meshes::geometry::first_not_finite;
use crate::{ImportError, Place};
use ::gltf::json::mesh::{Mode, Primitive as JsonPrimitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index, Mesh, Root};
use glam::{DAffine3, Vec2, Vec3, Vec4};
use oblate_surfels::Primitive;

/// Reads meshes.
pub(crate) struct Reader<'a, 'b> {
    pub(crate) file: &'a File,
    pub(crate) root: &'a Root,
    pub(crate) buffers: &'a Buffers<'a>,
    pub(crate) materials: &'b mut Materials<'a>,
}

impl Reader<'_, '_> {
    /// The triangles of a mesh.
    pub(crate) fn mesh(
        &mut self,
        index: Index<Mesh>,
        to_world: DAffine3,
    ) -> Result<Vec<Primitive>, ImportError> {
        let name = format!("mesh {}", index.value());
        let Some(mesh) = self.root.get(index) else {
            return Err(self.file.malformed(Place::Part(name), "is named, but not there"));
        };
        if mesh.weights.iter().flatten().any(|&weight| weight != 0.0) {
            return Err(self.file.unsupported(Place::Part(name), super::MORPHED));
        }
        let mut primitives = Vec::new();
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            let name = format!("{name}, primitive {i}");
            match primitive.mode {
                Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => {
                    primitives.push(self.primitive(primitive, mode, to_world, name)?);
                }
                Checked::Valid(_) => {}
                Checked::Invalid => {
                    return Err(self.file.malformed(Place::Part(name), "mode must be 0 to 6"));
                }
            }
        }
        Ok(primitives)
    }

    fn primitive(
        &mut self,
        primitive: &JsonPrimitive,
        mode: Mode,
        primitive_to_mesh: DAffine3,
        name: String,
    ) -> Result<Primitive, ImportError> {
        let accessor = |semantic: Semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let place = || Place::Part(name.clone());
        let Some(position) = accessor(Semantic::Positions) else {
            return Err(self.file.malformed(place(), "has no POSITION"));
        };
        let positions: Vec<[f32; 3]> = self.vectors(position, "POSITION", None)?;
        let count = Some(positions.len());
        let normals =
            accessor(Semantic::Normals).map(|a| self.vectors::<3>(a, "NORMAL", count)).transpose()?;
        let look = self.materials.look(primitive.material, self.buffers)?;
        let tex_coords = match look.tex_coords {
            None => None,
            Some((set, transform)) => {
                let Some(accessor) = accessor(Semantic::TexCoords(set)) else {
                    let problem = format!("its texture needs TEXCOORD_{set}, which it has not");
                    return Err(self.file.malformed(place(), problem));
                };
                let uvs = self.vectors::<2>(accessor, "TEXCOORD", count)?;
                Some(uvs.into_iter().map(|uv| transform.apply(Vec2::from_array(uv))).collect())
            }
        };
        let colors = accessor(Semantic::Colors(0)).map(|a| self.colors(a, count, look.opaque)).transpose()?;
        let corners = self.corners(primitive.indices, positions.len(), place())?;
        Ok(Primitive {
            triangles: triangles(&corners, mode).map_err(|problem| self.file.malformed(place(), problem))?,
            positions: positions.into_iter().map(Vec3::from_array).collect(),
            normals: normals.map(|normals| normals.into_iter().map(Vec3::from_array).collect()),
            tex_coords,
            colors,
            material: look.color,
            alpha_cutoff: look.alpha_cutoff,
            double_sided: look.double_sided,
            primitive_to_mesh,
        })
    }

    fn accessors(&self) -> Accessors<'_> {
        Accessors { file: self.file, root: self.root, buffers: self.buffers }
    }

    /// Finite vectors, `count` of them if that is given.
    fn vectors<const N: usize>(
        &self,
        accessor: Index<Accessor>,
        what: &str,
        count: Option<usize>,
    ) -> Result<Vec<[f32; N]>, ImportError> {
        let (_, values) = self.accessors().read::<f32>(accessor, &[N], Integers::AsMarked)?;
        let vectors = values.as_chunks::<N>().0.to_vec();
        self.check(accessor, what, &vectors, count)?;
        Ok(vectors)
    }

    fn check<const N: usize>(
        &self,
        accessor: Index<Accessor>,
        what: &str,
        vectors: &[[f32; N]],
        count: Option<usize>,
    ) -> Result<(), ImportError> {
        let problem = if let Some(count) = count.filter(|&count| count != vectors.len()) {
            format!("{what} has {} elements, but there are {count} positions", vectors.len())
        } else if let Some(index) = first_not_finite(vectors) {
            format!("{what} {index} is {:?}; it must be finite", vectors[index])
        } else {
            return Ok(());
        };
        Err(self.file.malformed(Place::Part(format!("accessor {}", accessor.value())), problem))
    }

    /// Linear colours, which integers give as shares.
    fn colors(
        &self,
        accessor: Index<Accessor>,
        count: Option<usize>,
        opaque: bool,
    ) -> Result<Vec<Vec4>, ImportError> {
        let (width, values) = self.accessors().read::<f32>(accessor, &[3, 4], Integers::Normalized)?;
        let color = |c: &[f32]| [c[0], c[1], c[2], c.get(3).copied().filter(|_| !opaque).unwrap_or(1.0)];
        let colors: Vec<[f32; 4]> = values.chunks_exact(width).map(color).collect();
        self.check(accessor, "COLOR_0", &colors, count)?;
        Ok(colors.into_iter().map(|color| Vec4::from_array(color).clamp(Vec4::ZERO, Vec4::ONE)).collect())
    }

    /// The corners in the file's order, each below `positions`.
    fn corners(
        &self,
        indices: Option<Index<Accessor>>,
        positions: usize,
        place: Place,
    ) -> Result<Vec<u32>, ImportError> {
        let Ok(limit) = u32::try_from(positions) else {
            return Err(self.file.malformed(place, "has more than 2^32 positions"));
        };
        let Some(accessor) = indices else { return Ok((0..limit).collect()) };
        let (_, indices) = self.accessors().read::<f64>(accessor, &[1], Integers::AsMarked)?;
        let fits = |index: &f64| *index >= 0.0 && *index < f64::from(limit) && index.fract() == 0.0;
        match indices.iter().position(|index| !fits(index)) {
            Some(at) => {
                let problem =
                    format!("index {at} is {}; it must be a whole number below {limit}", indices[at]);
                Err(self.file.malformed(Place::Part(format!("accessor {}", accessor.value())), problem))
            }
            None => Ok(indices.into_iter().map(|index| index as u32).collect()),
        }
    }
}

/// Triangles as glTF 2.0, 3.7.2.1 orders their corners.
fn triangles(corners: &[u32], mode: Mode) -> Result<Vec<[u32; 3]>, String> {
    Ok(match mode {
        Mode::TriangleStrip => {
            let in_order =
                |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
            corners.windows(3).enumerate().map(in_order).collect()
        }
        Mode::TriangleFan => crate::meshes::geometry::fan(corners).collect(),
        _ => match corners.as_chunks::<3>() {
            (triangles, []) => triangles.to_vec(),
            (_, rest) => return Err(format!("{} corners too many for whole triangles", rest.len())),
        },
    })
}
