//! Wavefront OBJ with MTL materials and textures.
//!
//! Source: *Object Files (.obj)*, Wavefront Technologies, Advanced Visualizer manual, appendix B1.
//! Read are `v` (with the common extension `x y z r g b`, sRGB-encoded like textures), `vt`, `vn`, `f`,
//! `mtllib`, `usemtl`; what is no polygon is skipped. Polygons become fans. OBJ's v = 0 is a texture's
//! bottom, so v is flipped. There is one primitive for each material; where only some of a material's
//! corners have normals or texture coordinates, these are a primitive of their own.
//!
//! A material library, material or texture that is named must be there. A file that names no library has
//! the default material.

use crate::file::File;
use crate::meshes::geometry::{decoded, fan, mesh, near_zero};
use crate::meshes::mtl::Library;
use crate::meshes::texture;
use crate::{Content, ImportError, OpenOptions, Opened, Place};
use glam::{DVec3, Vec2, Vec3, Vec4};
use oblate_surfels::{BaseColor, Primitive};
use std::borrow::Cow;
use std::collections::HashMap;
use std::mem::take;

/// Reads a mesh.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let mut scene = Reader::new(file);
    // Libraries first: materials may be used before the line that names their library.
    for (number, line) in logical_lines(file.text()) {
        if let Some(names) =
            line.strip_prefix("mtllib").filter(|names| names.starts_with(char::is_whitespace))
        {
            scene.material_library(Place::Line(number), names.trim())?;
        }
    }
    for (number, line) in logical_lines(file.text()) {
        scene.line(number, line)?;
    }
    let notes = scene.library.as_mut().map(|library| take(&mut library.notes)).unwrap_or_default();
    let mut primitives = scene.primitives();
    if let Some(path) = &options.texture {
        let bare = |p: &&mut Primitive| p.tex_coords.is_some() && p.material.texture.is_none();
        let image = texture::read(path)?;
        for primitive in primitives.iter_mut().filter(bare) {
            let factor = Vec3::ONE.extend(primitive.material.factor.w);
            primitive.material = BaseColor { factor, texture: Some(image.clone()) };
        }
    }
    let colored = |p: &&mut Primitive| p.colors.is_some() && p.material == BaseColor::UNSPECIFIED;
    for primitive in primitives.iter_mut().filter(colored) {
        primitive.material = BaseColor::default();
    }
    Ok(Opened::noting(Content::Mesh(mesh(file, primitives)?), notes))
}

/// Lines with their numbers; a backslash at a line's end joins the next one to it.
fn logical_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = bytes.split(|&b| b == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (index, line) = lines.next()?;
        let mut text = String::from_utf8_lossy(line.trim_ascii());
        while let Some(joined) = text.strip_suffix('\\') {
            let next = lines.next().map(|(_, line)| String::from_utf8_lossy(line.trim_ascii()));
            text = Cow::Owned(format!("{joined} {}", next.unwrap_or_default()));
        }
        Some((index + 1, text))
    })
}

/// A corner: indices of position, texture coordinate and normal.
type Corner = (usize, Option<usize>, Option<usize>);

/// The faces of one material whose corners have the same attributes.
struct Group {
    material: BaseColor,
    corners: Vec<Corner>,
    /// Triangles of indices into `corners`.
    triangles: Vec<[u32; 3]>,
    index_of: HashMap<Corner, u32>,
}

struct Reader<'a> {
    file: &'a File,
    positions: Vec<DVec3>,
    /// A colour for each position, once one has been met.
    colors: Vec<Vec4>,
    tex_coords: Vec<Vec2>,
    normals: Vec<Vec3>,
    library: Option<Library>,
    material: (String, BaseColor),
    groups: Vec<Group>,
    /// By material and by which attributes corners have.
    group_of: HashMap<(String, bool, bool), usize>,
}

impl<'a> Reader<'a> {
    fn new(file: &'a File) -> Self {
        Self {
            file,
            positions: Vec::new(),
            colors: Vec::new(),
            tex_coords: Vec::new(),
            normals: Vec::new(),
            library: None,
            material: (String::new(), BaseColor::UNSPECIFIED),
            groups: Vec::new(),
            group_of: HashMap::new(),
        }
    }

    fn line(&mut self, number: usize, text: Cow<'_, str>) -> Result<(), ImportError> {
        let place = Place::Line(number);
        // Names may have a # in them, numbers not.
        let values = || text.split('#').next().unwrap_or_default().split_whitespace().skip(1);
        let named = || text.split_once(char::is_whitespace).map_or("", |(_, name)| name.trim());
        let wrong = |problem: String| self.file.malformed(place.clone(), problem);
        match text.split_whitespace().next() {
            Some("v") => {
                let (position, color) = vertex(values()).map_err(wrong)?;
                if color.is_some() || !self.colors.is_empty() {
                    self.colors.resize(self.positions.len(), Vec4::ONE);
                    self.colors.push(color.unwrap_or(Vec4::ONE));
                }
                self.positions.push(position);
            }
            Some("vt") => {
                let numbers = numbers(values()).filter(|n| !n.is_empty());
                let numbers = numbers
                    .ok_or_else(|| wrong(format!("{text:?} must have one to three finite numbers")))?;
                self.tex_coords.push(Vec2::new(numbers[0], 1.0 - numbers.get(1).copied().unwrap_or(0.0)));
            }
            Some("vn") => {
                let normal = numbers(values()).and_then(|n| <[f32; 3]>::try_from(n).ok());
                let normal =
                    normal.ok_or_else(|| wrong(format!("{text:?} must have three finite numbers")))?;
                self.normals.push(Vec3::from_array(normal));
            }
            Some("f") => self.face(values()).map_err(|problem| self.file.malformed(place, problem))?,
            Some("usemtl") => self.use_material(place, named())?,
            _ => {}
        }
        Ok(())
    }

    fn material_library(&mut self, place: Place, names: &str) -> Result<(), ImportError> {
        let library = self.library.get_or_insert_default();
        // A name may have spaces, and a line may have several names: the whole is tried first.
        match self.file.read_named(place.clone(), names) {
            Ok(file) => library.add(&file),
            Err(missing) if !names.contains(char::is_whitespace) => Err(missing),
            Err(_) => names
                .split_whitespace()
                .try_for_each(|name| library.add(&self.file.read_named(place.clone(), name)?)),
        }
    }

    fn use_material(&mut self, place: Place, name: &str) -> Result<(), ImportError> {
        let Some(library) = &self.library else { return Ok(()) };
        let Some(material) = library.materials.get(name) else {
            let problem = format!("material {name:?} is in none of the material libraries");
            return Err(self.file.malformed(place, problem));
        };
        self.material = (name.to_owned(), material.clone());
        Ok(())
    }

    fn face<'w>(&mut self, words: impl Iterator<Item = &'w str>) -> Result<(), String> {
        let corners: Vec<Corner> = words.map(|word| self.corner(word)).collect::<Result<_, _>>()?;
        if corners.len() < 3 {
            return Err(format!("a face needs three corners or more; it has {}", corners.len()));
        }
        let complete = |has: fn(&Corner) -> bool| corners.iter().all(has);
        let (textured, smooth) = (complete(|c| c.1.is_some()), complete(|c| c.2.is_some()));
        let key = (self.material.0.clone(), textured, smooth);
        let group = *self.group_of.entry(key).or_insert(self.groups.len());
        if group == self.groups.len() {
            let material = self.material.1.clone();
            self.groups.push(Group {
                material,
                corners: Vec::new(),
                triangles: Vec::new(),
                index_of: HashMap::new(),
            });
        }
        let group = &mut self.groups[group];
        let mut indices = Vec::with_capacity(corners.len());
        for (position, tex_coord, normal) in corners {
            let corner = (position, tex_coord.filter(|_| textured), normal.filter(|_| smooth));
            let next = u32::try_from(group.corners.len()).map_err(|_| "there are more than 2^32 corners")?;
            let index = *group.index_of.entry(corner).or_insert(next);
            if index == next {
                group.corners.push(corner);
            }
            indices.push(index);
        }
        group.triangles.extend(fan(&indices));
        Ok(())
    }

    /// Reads `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, word: &str) -> Result<Corner, String> {
        let mut parts = word.split('/');
        let mut index = |count: usize, what: &str| {
            match parts.next() {
            None | Some("") => Ok(None),
            Some(part) => resolve(part, count).map(Some).ok_or_else(|| {
                format!("{word:?}: {what} {part} is not there; {count} came before, counted from 1 or back from -1")
            }),
        }
        };
        let position = index(self.positions.len(), "vertex")?;
        let tex_coord = index(self.tex_coords.len(), "texture coordinate")?;
        let normal = index(self.normals.len(), "normal")?;
        match (position, parts.next()) {
            (Some(position), None) => Ok((position, tex_coord, normal)),
            _ => Err(format!("{word:?} must be v, v/vt, v//vn or v/vt/vn")),
        }
    }

    fn primitives(self) -> Vec<Primitive> {
        let mut colors = self.colors;
        if !colors.is_empty() {
            colors.resize(self.positions.len(), Vec4::ONE);
        }
        let corners = self.groups.iter().flat_map(|group| &group.corners);
        let used = corners.map(|corner| &self.positions[corner.0]);
        let (positions, primitive_to_mesh) = near_zero(&self.positions, used);
        let primitive = |group: Group| {
            let corners = group.corners.iter();
            Primitive {
                positions: corners.clone().map(|c| positions[c.0]).collect(),
                triangles: group.triangles,
                tex_coords: corners.clone().map(|c| Some(self.tex_coords[c.1?])).collect(),
                normals: corners.clone().map(|c| Some(self.normals[c.2?])).collect(),
                colors: corners.map(|c| colors.get(c.0).copied()).collect(),
                material: group.material,
                alpha_cutoff: None,
                unlit: false,
                double_sided: true,
                primitive_to_mesh,
            }
        };
        self.groups.into_iter().map(primitive).collect()
    }
}

/// An index counted from 1, or back from -1, as one from 0.
fn resolve(text: &str, count: usize) -> Option<usize> {
    let given: i64 = text.parse().ok()?;
    let index = if given < 0 { given.checked_add_unsigned(count as u64)? } else { given - 1 };
    usize::try_from(index).ok().filter(|&index| index < count)
}

fn numbers<'w>(words: impl Iterator<Item = &'w str>) -> Option<Vec<f32>> {
    words.map(|word| word.parse().ok().filter(|n: &f32| n.is_finite())).collect()
}

/// As [`numbers`], which are as exact as they stand.
fn exact_numbers<'w>(words: impl Iterator<Item = &'w str>) -> Option<Vec<f64>> {
    words.map(|word| word.parse().ok().filter(|n: &f64| (*n as f32).is_finite())).collect()
}

/// `x y z`, then nothing, a weight (which polygons don't heed), or a colour.
fn vertex<'w>(words: impl Iterator<Item = &'w str>) -> Result<(DVec3, Option<Vec4>), String> {
    let numbers = exact_numbers(words).ok_or("a vertex must have finite numbers")?;
    let (position, color) = match numbers[..] {
        [x, y, z] | [x, y, z, _] => ([x, y, z], None),
        [x, y, z, r, g, b] => ([x, y, z], Some([r as f32, g as f32, b as f32, 1.0])),
        _ => {
            return Err(format!(
                "a vertex must have 3, 4 or 6 numbers (x y z, w or r g b); it has {}",
                numbers.len()
            ));
        }
    };
    if let Some(color) = color.filter(|color| !color.iter().all(|c| (0.0..=1.0).contains(c))) {
        return Err(format!("vertex colour {:?} must lie in [0, 1]", &color[..3]));
    }
    Ok((DVec3::from_array(position), color.map(|color| Vec4::from_array(decoded(color)))))
}
