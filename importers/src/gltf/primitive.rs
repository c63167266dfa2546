//! Primitives of meshes.

use super::accessor::{Accessors, Integers};
use super::material::Materials;
use crate::meshes::geometry::first_not_finite;
use crate::scalar::Scalar;
use crate::{ImportError, Place};
use ::gltf::json::mesh::{Mode, Primitive as JsonPrimitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index, Mesh};
use glam::{DAffine3, Vec2, Vec3, Vec4};
use oblate_surfels::Primitive;

/// Reads meshes.
pub(crate) struct Reader<'a, 'b> {
    pub(crate) accessors: Accessors<'a>,
    pub(crate) materials: &'b mut Materials<'a>,
    /// Primitives of points and lines that were not read.
    pub(crate) skipped: usize,
}

impl Reader<'_, '_> {
    /// The triangles of a mesh.
    pub(crate) fn mesh(
        &mut self,
        index: Index<Mesh>,
        to_world: DAffine3,
    ) -> Result<Vec<Primitive>, ImportError> {
        let name = format!("mesh {}", index.value());
        let Some(mesh) = self.accessors.root.get(index) else {
            return Err(self.accessors.file.malformed(Place::Part(name), "is named, but not there"));
        };
        let mut primitives = Vec::new();
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            let name = format!("{name}, primitive {i}");
            // Meshes that many nodes use may have many small parts.
            self.accessors.buffers.budget().take(
                self.accessors.file,
                || Place::Part(name.clone()),
                (1, size_of::<Primitive>()),
            )?;
            match primitive.mode {
                Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => {
                    primitives.push(self.primitive(primitive, mode, to_world, name)?);
                }
                Checked::Valid(_) => self.skipped += 1,
                Checked::Invalid => {
                    return Err(self.accessors.file.malformed(Place::Part(name), "mode must be 0 to 6"));
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
            return Err(self.accessors.file.malformed(place(), "has no POSITION"));
        };
        let positions: Vec<[f32; 3]> = self.vectors(position, "POSITION", None)?;
        let count = Some(positions.len());
        let normals =
            accessor(Semantic::Normals).map(|a| self.vectors::<3>(a, "NORMAL", count)).transpose()?;
        let look = self.materials.look(primitive.material, self.accessors.buffers)?;
        let tex_coords = match look.tex_coords {
            None => None,
            Some((set, transform)) => {
                let Some(accessor) = accessor(Semantic::TexCoords(set)) else {
                    let problem = format!("its texture needs TEXCOORD_{set}, which it has not");
                    return Err(self.accessors.file.malformed(place(), problem));
                };
                let uvs = self.vectors::<2>(accessor, "TEXCOORD", count)?;
                Some(uvs.into_iter().map(|uv| transform.apply(Vec2::from_array(uv))).collect())
            }
        };
        let colors = accessor(Semantic::Colors(0)).map(|a| self.colors(a, count, look.opaque)).transpose()?;
        let corners = self.corners(primitive.indices, positions.len(), place())?;
        Ok(Primitive {
            triangles: triangles(&corners, mode)
                .map_err(|problem| self.accessors.file.malformed(place(), problem))?,
            positions: positions.into_iter().map(Vec3::from_array).collect(),
            normals: normals.map(|normals| normals.into_iter().map(Vec3::from_array).collect()),
            tex_coords,
            colors,
            material: look.color,
            alpha_cutoff: look.alpha_cutoff,
            unlit: look.unlit,
            double_sided: look.double_sided,
            primitive_to_mesh,
        })
    }

    /// Finite vectors, `count` of them if that is given.
    fn vectors<const N: usize>(
        &self,
        accessor: Index<Accessor>,
        what: &str,
        count: Option<usize>,
    ) -> Result<Vec<[f32; N]>, ImportError> {
        let column = self.accessors.column(accessor, &[N], Integers::AsMarked)?;
        self.take(accessor, (column.count, size_of::<[f32; N]>()))?;
        let vectors = column.values::<f32>().as_chunks::<N>().0.to_vec();
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
        Err(self.accessors.file.malformed(Place::Part(format!("accessor {}", accessor.value())), problem))
    }

    /// Linear colours, which integers give as shares.
    fn colors(
        &self,
        accessor: Index<Accessor>,
        count: Option<usize>,
        opaque: bool,
    ) -> Result<Vec<Vec4>, ImportError> {
        let column = self.accessors.column(accessor, &[3, 4], Integers::Normalized)?;
        self.take(accessor, (column.count, size_of::<[f32; 4]>()))?;
        let color = |c: &[f32]| [c[0], c[1], c[2], c.get(3).copied().filter(|_| !opaque).unwrap_or(1.0)];
        let colors: Vec<[f32; 4]> = column.values::<f32>().chunks_exact(column.width).map(color).collect();
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
            return Err(self.accessors.file.malformed(place, "has more than 2^32 positions"));
        };
        let Some(accessor) = indices else { return Ok((0..limit).collect()) };
        let column = self.accessors.column(accessor, &[1], Integers::AsMarked)?;
        let malformed = |problem: String| {
            self.accessors.file.malformed(Place::Part(format!("accessor {}", accessor.value())), problem)
        };
        if !matches!(column.scalar, Scalar::U8 | Scalar::U16 | Scalar::U32) {
            return Err(malformed(
                "indices must be unsigned integers (componentType 5121, 5123 or 5125)".into(),
            ));
        }
        // As corners and as triangles.
        self.take(accessor, (2 * column.count, size_of::<u32>()))?;
        let indices = column.values::<u32>();
        match indices.iter().position(|index| *index >= limit) {
            Some(at) => Err(malformed(format!("index {at} is {}; it must be below {limit}", indices[at]))),
            None => Ok(indices),
        }
    }

    /// Takes memory for an accessor's elements.
    fn take(&self, accessor: Index<Accessor>, bytes: (usize, usize)) -> Result<(), ImportError> {
        let place = || Place::Part(format!("accessor {}", accessor.value()));
        self.accessors.buffers.budget().take(self.accessors.file, place, bytes)
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
