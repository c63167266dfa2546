//! Colour and shading normal of a piece of the surface.

use crate::facets::{Facet, Facets, Part};
use crate::mesh::{Mesh, Primitive, Texture};
use crate::texture::{Pyramid, least_alpha};
use glam::{DVec3, Vec2, Vec3, Vec4};
use std::collections::HashMap;
use std::sync::Arc;

/// The area of a piece over which a texture is looked at in one go, in squared cells: of waves as long as a cell the kernel leaves
/// e^{−2π²(0.4² + 1/12)} = 0.8 %, and this is half of that long.
const TEXTURED_AREA: f32 = 0.25;

/// The same where a mask has edges, which no kernel makes even: a share of a piece is there or isn't.
const MASKED_AREA: f32 = 0.125;

/// Masks that a texture is averaged with, at most, where vertices make one of many.
const MASKS: u16 = 8;

/// What the facets of a mesh look like.
pub(crate) struct Appearance<'a> {
    facets: &'a Facets<'a>,
    /// Of each part; one, or of masks one or more.
    textures: Vec<&'a [Pyramid<'a>]>,
    /// Whether nothing of a part can be seen through, as it is drawn: few texels more or less don't tell, as they would of closed bodies.
    are_opaque: Vec<bool>,
}

/// The textures of a mesh, each once for each mask, ready to be sampled.
pub(crate) struct Textures<'a>(HashMap<Key, Vec<Pyramid<'a>>>);

/// A texture, and the ends of the least alphas of its masks.
type Key = (*const Texture, Option<[u16; 2]>);

impl<'a> Textures<'a> {
    pub(crate) fn new(mesh: &'a Mesh) -> Self {
        let mut pyramids = HashMap::new();
        for part in &mesh.primitives {
            if let Some(texture) = texture(part) {
                let key = key(part, texture);
                let masked = |least: Vec<u16>| {
                    least.into_iter().map(|least| Pyramid::new(texture, Some(least))).collect()
                };
                let new =
                    || key.1.map_or_else(|| vec![Pyramid::new(texture, None)], |ends| masked(steps(ends)));
                pyramids.entry(key).or_insert_with(new);
            }
        }
        Self(pyramids)
    }
}

/// The texture of a part that has coordinates for one.
fn texture(part: &Primitive) -> Option<&Arc<Texture>> {
    part.tex_coords.as_ref().and(part.material.texture.as_ref())
}

fn key(part: &Primitive, texture: &Arc<Texture>) -> Key {
    let masks = part.alpha_cutoff.map(|cutoff| {
        let alphas = part.colors.iter().flatten().map(|color| color.w);
        let ends = alphas.map(|alpha| [alpha; 2]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
        let [low, high] = ends.unwrap_or([1.0; 2]);
        [high, low].map(|alpha| least_alpha(part.material.factor.w * alpha, cutoff))
    });
    (Arc::as_ptr(texture), masks)
}

/// Evenly from one to the other, both among them.
fn steps([first, last]: [u16; 2]) -> Vec<u16> {
    let count = last.saturating_sub(first).min(MASKS - 1);
    (0..=count).map(|step| first + (last.saturating_sub(first)) * step / count.max(1)).collect()
}

impl<'a> Appearance<'a> {
    pub(crate) fn new(facets: &'a Facets<'a>, textures: &'a Textures<'a>) -> Self {
        let find = |part: &Primitive| texture(part).and_then(|texture| textures.0.get(&key(part, texture)));
        let of = |part: &Part| find(part.primitive).map_or(&[][..], Vec::as_slice);
        let textures: Vec<_> = facets.parts.iter().map(of).collect();
        let is_opaque = |(part, texture): (&Part, &&[Pyramid])| {
            let Primitive { material, colors, alpha_cutoff, .. } = part.primitive;
            let is_whole = |share: f32| material.factor.w * share >= alpha_cutoff.unwrap_or(1.0);
            let are_whole = match colors {
                Some(colors) => colors.iter().all(|color| is_whole(color.w)),
                None => is_whole(1.0),
            };
            are_whole && texture.iter().all(Pyramid::is_opaque)
        };
        let are_opaque = facets.parts.iter().zip(&textures).map(is_opaque).collect();
        Self { facets, textures, are_opaque }
    }

    /// Whether nothing of a facet's part can be seen through.
    pub(crate) fn is_opaque(&self, facet: &Facet) -> bool {
        self.are_opaque[facet.part as usize]
    }

    /// What a facet looks like, in cells of a side.
    pub(crate) fn of(&self, facet: &Facet, side: f64) -> Look<'a> {
        let part = &self.facets.parts[facet.part as usize];
        let primitive = part.primitive;
        let pyramids = self.textures[facet.part as usize];
        let vertices = part.vertices(facet.triangle);
        let [corner, b, c] = self.facets.corners(facet).map(|p| p / side);
        let area = facet.area / (side * side) as f32;
        let [b, c] = [b - corner, c - corner].map(|edge| edge.as_vec3());
        let double = 2.0 * area;
        // What is thinner than 1e-15 cells looks as its first corner does.
        let slope = |slope: Vec3| if slope.length_squared() < 1e30 { slope } else { Vec3::ZERO };
        let coords = primitive.tex_coords.as_ref().map(|coords| vertices.map(|v| coords[v]));
        Look {
            corner,
            shares: [c.cross(facet.normal), facet.normal.cross(b)].map(|v| slope(v / double)),
            factor: primitive.material.factor,
            cutoff: primitive.alpha_cutoff,
            colors: primitive.colors.as_ref().map(|colors| vertices.map(|v| colors[v])),
            texture: pyramids.first().zip(coords).map(|(first, coords)| {
                let texels = texels(coords, first.size()) / area;
                Textured { pyramids, coords, texels }
            }),
            normals: part.normals.as_ref().map(|normals| vertices.map(|v| normals[v])),
            normal: facet.normal,
        }
    }
}

/// What a facet looks like.
pub(crate) struct Look<'a> {
    corner: DVec3,
    /// From a place's offset from the first corner to the shares that the other two have there.
    shares: [Vec3; 2],
    factor: Vec4,
    cutoff: Option<f32>,
    colors: Option<[Vec4; 3]>,
    texture: Option<Textured<'a>>,
    normals: Option<[Vec3; 3]>,
    normal: Vec3,
}

struct Textured<'a> {
    /// One or more.
    pyramids: &'a [Pyramid<'a>],
    coords: [Vec2; 3],
    /// In a squared cell.
    texels: f32,
}

impl Look<'_> {
    /// The largest pieces that one look is enough for, in squared cells: where what there is to see is not linear, it is looked at
    /// in parts.
    pub(crate) fn most_area(&self) -> f32 {
        match (self.cutoff, &self.texture) {
            (Some(_), _) => MASKED_AREA,
            (None, Some(_)) => TEXTURED_AREA,
            (None, None) => f32::INFINITY,
        }
    }

    /// Linear premultiplied colour and unit shading normal of a piece around a place, the colour over its area.
    pub(crate) fn at(&self, place: DVec3, area: f32) -> (Vec4, Vec3) {
        let offset = (place - self.corner).as_vec3();
        let [b, c] = self.shares.map(|share| offset.dot(share).clamp(0.0, 1.0));
        let all = (b + c).max(1.0);
        let shares = Vec3::new(all - b - c, b, c) / all;
        let mut color = self.factor;
        if let Some(colors) = self.colors {
            color *= colors[0] * shares.x + colors[1] * shares.y + colors[2] * shares.z;
        }
        if let Some(Textured { pyramids, coords, texels }) = &self.texture {
            let at = coords[0] * shares.x + coords[1] * shares.y + coords[2] * shares.z;
            let least = self.cutoff.map(|cutoff| least_alpha(color.w, cutoff));
            let sample = |pyramid: &Pyramid| pyramid.sample(at, texels * area.max(self.most_area()), least);
            // A mask has its alpha from texels alone: they were compared with what is left of the cut-off.
            let shown = if least.is_some() { color.with_w(1.0) } else { visible(color, None) };
            color = shown * Pyramid::nearest(pyramids, least).map_or(Vec4::ZERO, sample);
        } else {
            color = visible(color, self.cutoff);
        }
        let smooth = self
            .normals
            .map_or(Vec3::ZERO, |[a, b, c]| (a * shares.x + b * shares.y + c * shares.z).normalize_or_zero());
        (color, if smooth == Vec3::ZERO { self.normal } else { smooth })
    }
}

/// What is to be seen of a colour, premultiplied: alpha is the opacity or, with a cut-off, says whether it is there.
fn visible(color: Vec4, cutoff: Option<f32>) -> Vec4 {
    let alpha = cutoff.map_or(color.w.clamp(0.0, 1.0), |cutoff| f32::from(color.w >= cutoff));
    (color.truncate() * alpha).extend(alpha)
}

/// The area of a triangle in squared texels.
fn texels([a, b, c]: [Vec2; 3], size: Vec2) -> f32 {
    ((b - a) * size).perp_dot((c - a) * size).abs() / 2.0
}
