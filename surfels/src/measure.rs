//! What a mesh measures, and whether it can be sampled.

use crate::error::SampleError;
use crate::grading::side;
use crate::mesh::{Mesh, Primitive, Texture};
use crate::sight::Sight;
use glam::{DVec3, Vec3};
use oblate_engine::Closed;
use rayon::prelude::*;

/// Triangles that one task measures.
const TRIANGLES_PER_TASK: usize = 4096;

/// What triangles of a mesh, or parts of them, measure in mesh space; but areas and lengths in cells of their [`Grading`](crate::grading::Grading)'s levels, of which
/// those of the first level are as wide as a mesh unit.
#[derive(Clone, Copy)]
pub(crate) struct Extent {
    pub(crate) area: f64,
    /// The areas of the shadows along the axes, each triangle's by itself, in sum; from 1 to √3 times the area.
    pub(crate) shadows: f64,
    /// The smallest and largest corner.
    pub(crate) bounds: [DVec3; 2],
    /// The highest level.
    pub(crate) level: u32,
    /// How many triangles, and the lengths of their boxes along the axes, in sum.
    pub(crate) triangles: u64,
    lengths: f64,
}

impl Extent {
    /// Of what is seen, or of all, where cells are even; `None` where that is nothing. Triangles that name missing vertices don't count.
    pub(crate) fn of(mesh: &Mesh, sight: Option<&Sight>) -> Option<Self> {
        let of_part = |(level, part): (u32, Vec<DVec3>)| Self::of_polygon(&part, level);
        let of_triangle = |corners: [DVec3; 3]| match sight {
            None => Self::of_polygon(&corners, 0),
            Some(sight) => {
                sight.mean_grading.parts(sight.part(corners)).filter_map(of_part).reduce(Self::and)
            }
        };
        let of_some = |(part, some)| placed(part, some).filter_map(of_triangle).reduce(Self::and);
        // One after the other: sums are the same whoever made them.
        let parts: Vec<Option<Self>> = tasks(mesh).map(of_some).collect();
        parts.into_iter().flatten().reduce(Self::and)
    }

    fn of_polygon(polygon: &[DVec3], level: u32) -> Option<Self> {
        let [first, rest @ ..] = polygon else { return None };
        let double: DVec3 = rest.windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first)).sum();
        let bounds = rest.iter().fold([*first; 2], |[low, high], p| [low.min(*p), high.max(*p)]);
        let side = side(level);
        let lengths = (bounds[1] - bounds[0]).element_sum() / side;
        let [area, shadows] =
            [double.length(), double.abs().element_sum()].map(|double| double / (2.0 * side * side));
        Some(Self { area, shadows, bounds, level, triangles: 1, lengths })
    }

    fn and(self, other: Self) -> Self {
        let ([low, high], [other_low, other_high]) = (self.bounds, other.bounds);
        Self {
            area: self.area + other.area,
            shadows: self.shadows + other.shadows,
            bounds: [low.min(other_low), high.max(other_high)],
            level: self.level.max(other.level),
            triangles: self.triangles + other.triangles,
            lengths: self.lengths + other.lengths,
        }
    }

    /// How many pieces a lattice parts it into at most, up to chance: a triangle goes through as many cells as its shadows along
    /// the axes have areas, its box has lengths, and one, in the mean over all places of the lattice.
    pub(crate) fn pieces(&self, cell: f64) -> f64 {
        self.triangles as f64 + self.lengths / cell + self.shadows / (cell * cell)
    }
}

impl Mesh {
    /// Its area in squared mesh units: the sum over all triangles, as each primitive's transform places
    /// them. Triangles that name missing vertices count nothing.
    pub fn area(&self) -> f64 {
        Extent::of(self, None).map_or(0.0, |extent| extent.area)
    }

    /// The smallest and largest corner of all triangles in mesh space; `None` without triangles.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        Extent::of(self, None).map(|extent| extent.bounds)
    }

    /// Whether the surface is closed: every edge belongs to exactly two triangles that run along it in
    /// opposite directions, and each part that hangs together encloses a volume on the inner side of its triangles, so that nobody outside sees
    /// their backs. (The wall of a cavity by itself doesn't: a mesh with one is not closed.) Vertices at exactly one place count as one, whatever primitive they are of.
    pub fn is_closed(&self) -> bool {
        self.closed() == Closed::EVERYWHERE
    }

    /// [`Closed::EVERYWHERE`] where it is; [`Closed::Sided`] where its triangles face the same way as their neighbours, so far as is known of nine edges in
    /// ten: no two triangles that meet along an edge alone run along it in one direction, and of more than two that meet there not more than one in a
    /// thousand do; else [`Closed::Nowhere`].
    pub(crate) fn closed(&self) -> Closed {
        let bits = |primitive: &Primitive, p: &Vec3| {
            let placed = primitive.primitive_to_mesh.transform_point3(p.as_dvec3());
            (placed + DVec3::ZERO).to_array().map(f64::to_bits) // −0 is 0
        };
        let places: Vec<[u64; 3]> = self
            .primitives
            .par_iter()
            .flat_map(|primitive| primitive.positions.par_iter().map(move |p| bits(primitive, p)))
            .collect();
        if places.len() > u32::MAX as usize {
            return Closed::Nowhere;
        }
        let mut known = places.clone();
        known.par_sort_unstable();
        known.dedup();
        let weld = |place: &[u64; 3]| known.binary_search(place).unwrap_or_default() as u32;
        let welded: Vec<u32> = places.par_iter().map(weld).collect();

        let mut triangles: Vec<[u32; 3]> = Vec::new();
        let mut rest = &welded[..];
        for primitive in &self.primitives {
            let (vertices, others) = rest.split_at(primitive.positions.len());
            rest = others;
            // Its outside stays outside.
            let is_mirrored = primitive.primitive_to_mesh.matrix3.determinant() < 0.0;
            let of_triangle = |triangle: &[u32; 3]| {
                let [a, b, c] = triangle.map(|index| vertices.get(index as usize).copied());
                let [a, b, c] = [a?, b?, c?];
                (a != b && b != c && c != a).then_some(if is_mirrored { [a, c, b] } else { [a, b, c] })
            };
            triangles.par_extend(primitive.triangles.par_iter().filter_map(of_triangle));
        }
        if triangles.is_empty() {
            return Closed::Nowhere;
        }
        let mut edges: Vec<(u32, u32)> =
            triangles.par_iter().flat_map_iter(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
        edges.par_sort_unstable();
        let is_paired = |&(a, b): &(u32, u32)| edges.binary_search(&(b, a)).is_ok();
        let alone = edges.par_iter().filter(|edge| !is_paired(edge)).count();
        let repeated: Vec<(u32, u32)> =
            edges.par_windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| pair[0]).collect();
        if alone == 0 && repeated.is_empty() {
            let known: Vec<DVec3> = known.par_iter().map(|place| place.map(f64::from_bits).into()).collect();
            if enclose(&known, &triangles) {
                return Closed::EVERYWHERE;
            }
        }
        let is_known = 10 * alone <= edges.len() && 1000 * repeated.len() <= edges.len();
        if is_known && repeated.iter().all(is_paired) { Closed::Sided } else { Closed::Nowhere }
    }

    /// Whether nothing in it is double-sided.
    pub(crate) fn is_single_sided(&self) -> bool {
        self.primitives.iter().all(|part| part.triangles.is_empty() || !part.double_sided)
    }

    /// Whether all of it shows its colours as they are.
    pub(crate) fn is_unlit(&self) -> bool {
        self.primitives.iter().all(|part| part.triangles.is_empty() || part.unlit)
    }

    /// Whether nothing of it can be seen through: no alpha is below 1, and none of a texture's.
    pub(crate) fn is_opaque(&self) -> bool {
        let whole = |texture: &Texture| texture.texels.par_iter().all(|texel| texel[3] == u8::MAX);
        self.primitives.iter().all(|part| {
            part.material.factor.w >= 1.0
                && part.colors.iter().flatten().all(|color| color.w >= 1.0)
                && part.material.texture.as_deref().is_none_or(whole)
        })
    }

    /// Checks every number that sampling reads.
    pub(crate) fn check(&self) -> Result<(), SampleError> {
        let triangles: usize = self.primitives.iter().map(|p| p.triangles.len()).sum();
        if triangles == 0 {
            return Err(SampleError::Empty);
        }
        if triangles > i32::MAX as usize {
            return Err(SampleError::Triangles(triangles));
        }
        self.primitives.iter().enumerate().try_for_each(|(index, primitive)| check(index, primitive))
    }
}

/// Whether each part of closed triangles that hangs together encloses a volume, its corners counter-clockwise seen from outside.
fn enclose(places: &[DVec3], triangles: &[[u32; 3]]) -> bool {
    /// Places lead to others of their part; the last one, which stands for it, leads to itself.
    fn last_of(leads_to: &mut [u32], mut place: u32) -> u32 {
        while leads_to[place as usize] != place {
            leads_to[place as usize] = leads_to[leads_to[place as usize] as usize];
            place = leads_to[place as usize];
        }
        place
    }
    let mut leads_to: Vec<u32> = (0..places.len() as u32).collect();
    for [a, b, c] in triangles {
        let first = last_of(&mut leads_to, *a);
        for other in [b, c] {
            let last = last_of(&mut leads_to, *other);
            leads_to[last as usize] = first;
        }
    }
    // By the place that stands for a part; from there, so that what is far away is as exact.
    let mut volumes = vec![0.0; places.len()];
    for [a, b, c] in triangles {
        let part = last_of(&mut leads_to, *a) as usize;
        let [a, b, c] = [a, b, c].map(|corner| places[*corner as usize] - places[part]);
        volumes[part] += a.dot(b.cross(c)) / 6.0;
    }
    triangles.iter().all(|[a, ..]| volumes[last_of(&mut leads_to, *a) as usize] > 0.0)
}

/// The triangles of a mesh in parts for one task each, with the primitives that they are of.
pub(crate) fn tasks(mesh: &Mesh) -> impl ParallelIterator<Item = (&Primitive, &[[u32; 3]])> {
    mesh.primitives
        .par_iter()
        .flat_map(|part| part.triangles.par_chunks(TRIANGLES_PER_TASK).map(move |some| (part, some)))
}

/// The corners of triangles in mesh space, counter-clockwise seen from outside.
pub(crate) fn placed<'a>(
    primitive: &'a Primitive,
    triangles: &'a [[u32; 3]],
) -> impl Iterator<Item = [DVec3; 3]> + 'a {
    let to_mesh = primitive.primitive_to_mesh;
    let mirrored = to_mesh.matrix3.determinant() < 0.0;
    let place = move |index: u32| {
        let position = primitive.positions.get(index as usize)?;
        Some(to_mesh.transform_point3(position.as_dvec3()))
    };
    triangles.iter().filter_map(move |&[a, b, c]| {
        let [a, b, c] = [place(a)?, place(b)?, place(c)?];
        Some(if mirrored { [a, c, b] } else { [a, b, c] })
    })
}

fn check(primitive: usize, part: &Primitive) -> Result<(), SampleError> {
    let positions = part.positions.len();
    let finite = |what, bad: Option<usize>| {
        bad.map_or(Ok(()), |index| Err(SampleError::NotFinite { primitive, what, index }))
    };
    let length = |array, found: usize| {
        if found == positions {
            return Ok(());
        }
        Err(SampleError::Length { primitive, array, found, positions })
    };
    for (triangle, corners) in part.triangles.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|&&index| index as usize >= positions) {
            return Err(SampleError::Index { primitive, triangle, index, positions });
        }
    }
    finite("position", part.positions.iter().position(|p| !p.is_finite()))?;
    finite("transform", (!part.primitive_to_mesh.is_finite()).then_some(0))?;
    finite("base colour factor", (!part.material.factor.is_finite()).then_some(0))?;
    finite("alpha cut-off", part.alpha_cutoff.is_some_and(|cutoff| !cutoff.is_finite()).then_some(0))?;
    if let Some(normals) = &part.normals {
        length("normals", normals.len())?;
    }
    if let Some(tex_coords) = &part.tex_coords {
        length("texture coordinates", tex_coords.len())?;
        finite("texture coordinate", tex_coords.iter().position(|t| !t.is_finite()))?;
    }
    if let Some(colors) = &part.colors {
        length("colours", colors.len())?;
        finite("colour", colors.iter().position(|c| !c.is_finite()))?;
    }
    if let Some(texture) = &part.material.texture {
        let (width, height, found) = (texture.width, texture.height, texture.texels.len());
        if found == 0 || width.checked_mul(height) != Some(found) {
            return Err(SampleError::Texture { primitive, width, height, found });
        }
    }
    Ok(())
}
