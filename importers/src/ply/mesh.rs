//! Meshes of PLY files.

use super::body::{Body, Column};
use super::header::{Element, Header, Kind};
use crate::file::File;
use crate::meshes::geometry::{decoded, fan, first_not_finite, mesh, near_zero};
use crate::meshes::texture;
use crate::scalar::Scalar;
use crate::{Content, ImportError, OpenOptions, Opened, Place};
use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};
use oblate_surfels::{BaseColor, Primitive, Wrap};

/// Reads a mesh.
pub(super) fn read(file: &File, header: &Header, options: &OpenOptions) -> Result<Opened, ImportError> {
    let mut body = Body::new(file, header);
    let mut vertices = None;
    let mut faces = None;
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" if vertices.is_none() => vertices = Some(Vertices::read(file, &mut body, element)?),
            "face" if faces.is_none() => faces = Some(Faces::read(file, &mut body, element)?),
            _ => drop(body.gather::<f32>(element, &[])?),
        }
    }
    let missing = |what: &str| file.malformed(Place::Whole, format!("a mesh needs an element {what}"));
    let mut vertices = vertices.ok_or_else(|| missing("\"vertex\""))?;
    let faces = faces.ok_or_else(|| missing("\"face\""))?;
    let mut triangles = faces.triangles(file, vertices.positions.len())?;
    if faces.tex_coords.is_some() {
        // Corners of one vertex may have several texture coordinates: each corner becomes a vertex.
        vertices = vertices.at_corners(&triangles);
        vertices.tex_coords = Some(faces.corner_tex_coords(file)?);
        let corners = (0..vertices.positions.len() as u32).collect::<Vec<_>>();
        triangles = corners.as_chunks::<3>().0.to_vec();
    }
    let mut texture = None;
    if vertices.tex_coords.is_some() {
        let named = header
            .comments
            .iter()
            .find_map(|(line, comment)| Some((*line, comment.strip_prefix("TextureFile ")?)));
        texture = match (named, &options.texture) {
            (Some((line, name)), _) => {
                Some(texture::read_named(file, Place::Line(line), name.trim(), [Wrap::Repeat; 2])?)
            }
            (None, Some(path)) => Some(texture::read(path)?),
            (None, None) => None,
        };
    }
    let material = if texture.is_none() && vertices.colors.is_none() {
        BaseColor::UNSPECIFIED
    } else {
        BaseColor { texture, ..BaseColor::default() }
    };
    let primitive = Primitive {
        positions: vertices.positions,
        triangles,
        normals: vertices.normals,
        tex_coords: vertices.tex_coords,
        colors: vertices.colors,
        material,
        alpha_cutoff: None,
        unlit: false,
        double_sided: true,
        primitive_to_mesh: vertices.to_mesh,
    };
    let notes = body.rest().into_iter().collect();
    Ok(Opened::noting(Content::Mesh(mesh(file, vec![primitive])?), notes))
}

/// What each vertex has.
struct Vertices {
    positions: Vec<Vec3>,
    /// Moves them to where they are.
    to_mesh: DAffine3,
    normals: Option<Vec<Vec3>>,
    tex_coords: Option<Vec<Vec2>>,
    colors: Option<Vec<Vec4>>,
}

impl Vertices {
    fn read(file: &File, body: &mut Body<'_>, element: &Element) -> Result<Self, ImportError> {
        const NAMES: [&str; 20] = [
            "x",
            "y",
            "z",
            "nx",
            "ny",
            "nz",
            "s",
            "t",
            "u",
            "v",
            "texture_u",
            "texture_v",
            "red",
            "green",
            "blue",
            "alpha",
            "diffuse_red",
            "diffuse_green",
            "diffuse_blue",
            "diffuse_alpha",
        ];
        let lists = |name: &&str| matches!(element.kind(name), Some(Kind::List { .. }));
        if let Some(name) = NAMES.iter().find(|name| lists(name)) {
            return Err(file.malformed(Place::Whole, format!("vertex property {name:?} must not be a list")));
        }
        let are_rounded = NAMES[..3].iter().all(|name| element.kind(name).is_none_or(is_single));
        let (columns, exact) = if are_rounded {
            (body.gather::<f32>(element, &NAMES)?, None)
        } else {
            let columns = body.gather::<f64>(element, &NAMES)?;
            let places = |[x, y, z]: [&Column<f64>; 3]| -> Vec<DVec3> {
                x.values
                    .iter()
                    .zip(&y.values)
                    .zip(&z.values)
                    .map(|((x, y), z)| DVec3::new(*x, *y, *z))
                    .collect()
            };
            let exact = match &columns[..3] {
                [Some(x), Some(y), Some(z)] => Some(places([x, y, z])),
                _ => None,
            };
            (columns.into_iter().map(|column| column.map(Column::rounded)).collect(), exact)
        };
        let Some(positions) = joined(file, &columns[0..3], "position")? else {
            return Err(file.malformed(Place::Whole, "element \"vertex\" must have properties x, y and z"));
        };
        let positions = positions.into_iter().map(Vec3::from_array);
        let (positions, to_mesh) = match exact {
            Some(places) => near_zero(&places, places.iter()),
            None => (positions.collect(), DAffine3::IDENTITY),
        };
        let normals = joined(file, &columns[3..6], "normal")?;
        let pairs = [&columns[6..8], &columns[8..10], &columns[10..12]];
        let pairs = pairs.into_iter().find(|pair| pair.iter().all(Option::is_some));
        let tex_coords = pairs.map(|pair| joined(file, pair, "texture coordinate")).transpose()?.flatten();
        let first_color = if columns[12].is_some() { 12 } else { 16 };
        let colors = colors(file, element, &NAMES[first_color..], &columns[first_color..first_color + 4])?;
        Ok(Self {
            positions,
            to_mesh,
            normals: normals.map(|normals| normals.into_iter().map(Vec3::from_array).collect()),
            tex_coords: tex_coords.map(|pairs| pairs.into_iter().map(flipped).collect()),
            colors,
        })
    }

    /// A vertex of its own for each corner.
    fn at_corners(&self, triangles: &[[u32; 3]]) -> Self {
        fn at<T: Copy>(values: &[T], triangles: &[[u32; 3]]) -> Vec<T> {
            triangles.iter().flatten().map(|&corner| values[corner as usize]).collect()
        }
        Self {
            positions: at(&self.positions, triangles),
            to_mesh: self.to_mesh,
            normals: self.normals.as_ref().map(|values| at(values, triangles)),
            tex_coords: None,
            colors: self.colors.as_ref().map(|values| at(values, triangles)),
        }
    }
}

/// Whether numbers of a kind are as exact in single precision.
fn is_single(kind: Kind) -> bool {
    use Scalar::{F32, I8, I16, U8, U16};
    matches!(kind, Kind::Scalar(F32 | I8 | I16 | U8 | U16))
}

/// With v downwards.
fn flipped([u, v]: [f32; 2]) -> Vec2 {
    Vec2::new(u, 1.0 - v)
}

/// `N` columns as vectors, which must be finite, if all are there.
fn joined<const N: usize>(
    file: &File,
    columns: &[Option<Column<f32>>],
    what: &str,
) -> Result<Option<Vec<[f32; N]>>, ImportError> {
    let columns: Option<Vec<&[f32]>> = columns.iter().map(|c| c.as_ref().map(|c| &c.values[..])).collect();
    let Some(columns) = columns else { return Ok(None) };
    let rows = columns.first().map_or(0, |column| column.len());
    let vectors: Vec<[f32; N]> = (0..rows).map(|row| std::array::from_fn(|c| columns[c][row])).collect();
    match first_not_finite(&vectors) {
        Some(row) => {
            let place = Place::Part(format!("vertex {row}"));
            Err(file.malformed(place, format!("{what} {:?} must be finite 32-bit numbers", vectors[row])))
        }
        None => Ok(Some(vectors)),
    }
}

/// Linear colours from red, green, blue and, where it is there, alpha.
fn colors(
    file: &File,
    element: &Element,
    names: &[&str],
    columns: &[Option<Column<f32>>],
) -> Result<Option<Vec<Vec4>>, ImportError> {
    let Some(rgb) = joined::<3>(file, &columns[..3], "colour")? else { return Ok(None) };
    let scale = |name: &str| match element.kind(name) {
        Some(Kind::Scalar(scalar)) => scalar.integer_max().unwrap_or(1.0) as f32,
        _ => 1.0,
    };
    let scales: Vec<f32> = names.iter().map(|name| scale(name)).collect();
    let alpha = columns[3].as_ref().map(|column| &column.values);
    let mut colors = Vec::with_capacity(rgb.len());
    for (row, [r, g, b]) in rgb.into_iter().enumerate() {
        let a = alpha.map_or(1.0, |alpha| alpha[row] / scales[3]);
        let color = [r / scales[0], g / scales[1], b / scales[2], a];
        if !color.iter().all(|c| (0.0..=1.0).contains(c)) {
            let problem = format!("colour {color:?} must lie in [0, 1] (or in the range of an integer type)");
            return Err(file.malformed(Place::Part(format!("vertex {row}")), problem));
        }
        colors.push(Vec4::from_array(decoded(color)));
    }
    Ok(Some(colors))
}

/// What each face has.
struct Faces {
    corners: Column<f64>,
    tex_coords: Option<Column<f64>>,
}

impl Faces {
    fn read(file: &File, body: &mut Body<'_>, element: &Element) -> Result<Self, ImportError> {
        let scalars = |name: &&str| matches!(element.kind(name), Some(Kind::Scalar(_)));
        const NAMES: [&str; 3] = ["vertex_indices", "vertex_index", "texcoord"];
        if let Some(name) = NAMES.iter().find(|name| scalars(name)) {
            return Err(file.malformed(Place::Whole, format!("face property {name:?} must be a list")));
        }
        let [indices, index, tex_coords] = {
            let columns = body.gather::<f64>(element, &NAMES)?;
            <[_; 3]>::try_from(columns).unwrap_or([None, None, None])
        };
        let Some(corners) = indices.or(index) else {
            return Err(file.malformed(Place::Whole, "element \"face\" must have a list vertex_indices"));
        };
        Ok(Self { corners, tex_coords })
    }

    fn triangles(&self, file: &File, vertices: usize) -> Result<Vec<[u32; 3]>, ImportError> {
        let limit = vertices.min(u32::MAX as usize) as f64;
        let mut triangles = Vec::new();
        for (face, corners) in self.corners.rows().enumerate() {
            if let Some(bad) = corners.iter().find(|&&c| !(c >= 0.0 && c < limit && c.fract() == 0.0)) {
                let problem = format!("vertex index {bad} must be a whole number below {vertices}");
                return Err(file.malformed(Place::Part(format!("face {face}")), problem));
            }
            triangles.extend(fan(corners).map(|triangle| triangle.map(|corner| corner as u32)));
        }
        Ok(triangles)
    }

    /// The texture coordinates of the corners of all triangles.
    fn corner_tex_coords(&self, file: &File) -> Result<Vec<Vec2>, ImportError> {
        let mut found = Vec::new();
        let rows = self.tex_coords.iter().flat_map(Column::rows);
        for (face, (corners, numbers)) in self.corners.rows().zip(rows).enumerate() {
            let place = || Place::Part(format!("face {face}"));
            if numbers.len() != 2 * corners.len() {
                let problem = format!(
                    "texcoord has {} numbers for {} corners; two each are needed",
                    numbers.len(),
                    corners.len()
                );
                return Err(file.malformed(place(), problem));
            }
            if let Some(bad) = numbers.iter().find(|number| !(**number as f32).is_finite()) {
                return Err(file.malformed(place(), format!("texture coordinate {bad} must be finite")));
            }
            let pairs: Vec<Vec2> =
                numbers.as_chunks().0.iter().map(|pair| flipped(pair.map(|n: f64| n as f32))).collect();
            found.extend(fan(&pairs).flatten());
        }
        Ok(found)
    }
}
