//! Colour and shading normal of a piece of the surface.

use crate::facets::{Facet, Facets};
use crate::mesh::{Mesh, Primitive, Texture};
use crate::texture::{Mask, Pyramid};
use glam::{Vec2, Vec3, Vec4};
use std::collections::HashMap;
use std::sync::Arc;

/// The area of a piece over which a texture is looked at in one go, in squared cells: what of a texture is finer than an eighth of a
/// cell is lost to the kernel.
const TEXTURED_AREA: f32 = 0.125;

/// What pieces of a mesh look like.
pub(crate) struct Appearance<'a> {
    facets: &'a Facets<'a>,
    /// Of each part.
    textures: Vec<Option<&'a Pyramid<'a>>>,
}

/// The textures of a mesh, each once for each mask, ready to be sampled.
pub(crate) struct Textures<'a>(HashMap<Key, Pyramid<'a>>);

/// A texture, and the bits of its mask.
type Key = (*const Texture, Option<[u32; 2]>);

impl<'a> Textures<'a> {
    pub(crate) fn new(mesh: &'a Mesh) -> Self {
        let mut pyramids = HashMap::new();
        for part in &mesh.primitives {
            if let Some(texture) = texture(part) {
                pyramids.entry(key(part, texture)).or_insert_with(|| Pyramid::new(texture, mask(part)));
            }
        }
        Self(pyramids)
    }
}

/// The texture of a part that has coordinates for one.
fn texture(part: &Primitive) -> Option<&Arc<Texture>> {
    part.tex_coords.as_ref().and(part.material.texture.as_ref())
}

fn mask(part: &Primitive) -> Option<Mask> {
    let factor = part.material.factor.w;
    part.alpha_cutoff.map(|cutoff| Mask { factor, cutoff })
}

fn key(part: &Primitive, texture: &Arc<Texture>) -> Key {
    (Arc::as_ptr(texture), mask(part).map(|mask| [mask.factor, mask.cutoff].map(f32::to_bits)))
}

impl<'a> Appearance<'a> {
    pub(crate) fn new(facets: &'a Facets<'a>, textures: &'a Textures<'a>) -> Self {
        let find = |part: &Primitive| texture(part).and_then(|texture| textures.0.get(&key(part, texture)));
        Self { facets, textures: facets.parts.iter().map(|part| find(part.primitive)).collect() }
    }

    /// The largest pieces of a facet that one look is enough for, in squared cells: where what there is to see is not linear, it is
    /// looked at in parts.
    pub(crate) fn most_area(&self, facet: &Facet) -> f32 {
        let is_linear = self.textures[facet.part as usize].is_none()
            && self.facets.parts[facet.part as usize].primitive.alpha_cutoff.is_none();
        if is_linear { f32::INFINITY } else { TEXTURED_AREA }
    }

    /// Linear premultiplied colour and unit shading normal of a piece of a facet around a place, the colour over its area.
    pub(crate) fn at(&self, facet: &Facet, place: Vec3, area: f32) -> (Vec4, Vec3) {
        let part = &self.facets.parts[facet.part as usize];
        let pyramid = self.textures[facet.part as usize];
        let primitive = part.primitive;
        let mut color = primitive.material.factor;
        if pyramid.is_none() && primitive.colors.is_none() && part.normals.is_none() {
            return (visible(color, primitive.alpha_cutoff), facet.normal);
        }
        let vertices = part.vertices(facet.triangle);
        let shares = self.barycentric(facet, place);
        if let Some(colors) = &primitive.colors {
            color *= mix(vertices.map(|v| colors[v]), shares);
        }
        color = visible(color, primitive.alpha_cutoff);
        if let (Some(pyramid), Some(coords)) = (pyramid, &primitive.tex_coords) {
            let coords = vertices.map(|v| coords[v]);
            let share_of_facet = area.max(TEXTURED_AREA) / facet.area;
            let at = coords[0] * shares.x + coords[1] * shares.y + coords[2] * shares.z;
            color *= pyramid.sample(at, texels(coords, pyramid.size()) * share_of_facet);
        }
        let smooth = part.normals.as_ref().map_or(Vec3::ZERO, |normals| {
            let [a, b, c] = vertices.map(|v| normals[v]);
            (a * shares.x + b * shares.y + c * shares.z).normalize_or_zero()
        });
        (color, if smooth == Vec3::ZERO { facet.normal } else { smooth })
    }

    fn barycentric(&self, facet: &Facet, at: Vec3) -> Vec3 {
        let [a, b, c] = self.facets.corners(facet).map(|corner| corner.as_vec3());
        let double = 2.0 * facet.area;
        let share = |from: Vec3, to: Vec3| ((from - at).cross(to - at).dot(facet.normal) / double).max(0.0);
        let shares = Vec3::new(share(b, c), share(c, a), share(a, b));
        let sum = shares.element_sum();
        if sum > 0.0 { shares / sum } else { Vec3::splat(1.0 / 3.0) }
    }
}

/// What is to be seen of a colour, premultiplied: alpha is the opacity or, with a cut-off, says whether it is there.
fn visible(color: Vec4, cutoff: Option<f32>) -> Vec4 {
    let alpha = cutoff.map_or(color.w.clamp(0.0, 1.0), |cutoff| f32::from(color.w >= cutoff));
    (color.truncate() * alpha).extend(alpha)
}

fn mix(of_vertices: [Vec4; 3], shares: Vec3) -> Vec4 {
    of_vertices[0] * shares.x + of_vertices[1] * shares.y + of_vertices[2] * shares.z
}

/// The area of a triangle in squared texels.
fn texels([a, b, c]: [Vec2; 3], size: Vec2) -> f32 {
    ((b - a) * size).perp_dot((c - a) * size).abs() / 2.0
}
