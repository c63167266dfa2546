//! Textures in linear light, filtered over an extent by a pyramid of means.

use crate::mesh::{Filter, Texture, Wrap};
use glam::{Vec2, Vec4};
use oblate_engine::color::srgb_to_linear;
use rayon::prelude::*;

/// A texture and its means over ever larger boxes: linear, premultiplied.
pub(crate) struct Pyramid<'a> {
    texture: &'a Texture,
    /// Of a mask, the least alpha of texels that are in the means.
    least: Option<u16>,
    to_linear: [f32; 256],
    /// Levels 1 and up; level 0 is the texture itself.
    means: Vec<Level>,
}

/// The least alpha, 0 to 255, that times a factor is at least a mask's cut-off; 256 where none is. Texels of it or more are there and
/// opaque, others are not.
pub(crate) fn least_alpha(factor: f32, cutoff: f32) -> u16 {
    let is_there = |alpha: &u16| f32::from(*alpha) / 255.0 * factor >= cutoff;
    // As it is but for rounding.
    let near = (255.0 * cutoff / factor).ceil().clamp(0.0, 256.0) as u16;
    (near.saturating_sub(1)..near + 2).find(is_there).map_or(256, |alpha| alpha.min(256))
}

struct Level {
    width: usize,
    height: usize,
    texels: Vec<Vec4>,
}

impl<'a> Pyramid<'a> {
    /// Averages a texture whose texels fill its rows, down to one texel; of a mask, those of at least an alpha.
    pub(crate) fn new(texture: &'a Texture, least: Option<u16>) -> Self {
        let to_linear = std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0));
        let mut pyramid = Self { texture, least, to_linear, means: Vec::new() };
        let (mut width, mut height) = (texture.width, texture.height);
        while width > 1 || height > 1 {
            let level = pyramid.means.len();
            let narrow = (width / 2).max(1);
            let low = (height / 2).max(1);
            let mut texels = vec![Vec4::ZERO; narrow * low];
            texels.par_chunks_mut(narrow).enumerate().for_each(|(y, row)| {
                for (x, mean) in row.iter_mut().enumerate() {
                    for (j, weight_y) in shares(y, height, low) {
                        for (i, weight_x) in shares(x, width, narrow) {
                            *mean += weight_x * weight_y * pyramid.texel((level, least), i, j);
                        }
                    }
                }
            });
            pyramid.means.push(Level { width: narrow, height: low, texels });
            (width, height) = (narrow, low);
        }
        pyramid
    }

    /// The mean colour around `at` over about `area` squared texels: linear, premultiplied. The levels
    /// are interpolated trilinearly. A mask, whose own texels are those of at least an alpha, is as sharp as the area, however large
    /// its texels are; so is everything between texels that are not interpolated.
    pub(crate) fn sample(&self, at: Vec2, area: f32, least: Option<u16>) -> Vec4 {
        let level = (0.5 * area.max(1.0).log2()).min(self.means.len() as f32);
        let fine = level as usize;
        // Between two texels values go from one to the other on the length of a texel; here on that of the area.
        let width = area.sqrt().clamp(1e-6, 1.0);
        let narrow = |share: f32| ((share - 0.5) / width + 0.5).clamp(0.0, 1.0);
        if self.texture.filter == Filter::Nearest && width < 1.0 {
            return self.bilinear((0, least), at, narrow);
        }
        let here = self.bilinear((fine, least), at, |share| share);
        if level > fine as f32 {
            return here.lerp(self.bilinear((fine + 1, least), at, |share| share), level - fine as f32);
        }
        if least.is_none() || here.w == 0.0 {
            return here;
        }
        here * (narrow(here.w) / here.w)
    }

    /// Of those of a mask, the one whose means have about this least alpha.
    pub(crate) fn nearest(of: &[Self], least: Option<u16>) -> Option<&Self> {
        of.iter().min_by_key(|pyramid| pyramid.least.zip(least).map(|(own, wanted)| own.abs_diff(wanted)))
    }

    /// Whether nothing of it can be seen through, but for a ten-thousandth at most.
    pub(crate) fn is_opaque(&self) -> bool {
        self.texel((self.means.len(), self.least), 0, 0).w > 0.9999
    }

    /// Width and height in texels.
    pub(crate) fn size(&self) -> Vec2 {
        Vec2::new(self.texture.width as f32, self.texture.height as f32)
    }

    fn bilinear(
        &self,
        (level, least): (usize, Option<u16>),
        at: Vec2,
        toward_next: impl Fn(f32) -> f32,
    ) -> Vec4 {
        let (width, height) =
            if level == 0 { (self.texture.width, self.texture.height) } else { self.means[level - 1].size() };
        let ([x0, x1], right) = neighbors(at.x, width, self.texture.wrap[0]);
        let ([y0, y1], down) = neighbors(at.y, height, self.texture.wrap[1]);
        let texel = |x: usize, y: usize| self.texel((level, least), x, y);
        let [right, down] = [right, down].map(toward_next);
        texel(x0, y0).lerp(texel(x1, y0), right).lerp(texel(x0, y1).lerp(texel(x1, y1), right), down)
    }

    fn texel(&self, (level, least): (usize, Option<u16>), x: usize, y: usize) -> Vec4 {
        if level > 0 {
            let mean = &self.means[level - 1];
            return mean.texels[y * mean.width + x];
        }
        let [r, g, b, a] = self.texture.texels[y * self.texture.width + x];
        let alpha = least.map_or(f32::from(a) / 255.0, |least| f32::from(u16::from(a) >= least));
        let linear = |v: u8| self.to_linear[usize::from(v)] * alpha;
        Vec4::new(linear(r), linear(g), linear(b), alpha)
    }
}

impl Level {
    fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }
}

/// The texels out of `from` that texel `index` out of `to` covers, each with its share of the mean; a side
/// that doesn't divide evenly is shared exactly.
fn shares(index: usize, from: usize, to: usize) -> impl Iterator<Item = (usize, f32)> {
    // Lengths in units of 1/to of a texel: texel i is [i·to, (i + 1)·to], the mean [index·from, …].
    let (begin, end) = (index * from, (index + 1) * from);
    (begin / to..end.div_ceil(to)).map(move |i| {
        let overlap = end.min((i + 1) * to) - begin.max(i * to);
        (i, overlap as f32 / from as f32)
    })
}

/// The two texels around a coordinate along one axis, and how far it is from the first to the second.
fn neighbors(at: f32, size: usize, wrap: Wrap) -> ([usize; 2], f32) {
    let period = if wrap == Wrap::Mirror { 2.0 } else { 1.0 };
    // Folded first: far from 0 a coordinate has no digits left for texels.
    let at = match wrap {
        Wrap::Clamp => at.clamp(0.0, 1.0),
        _ if (0.0..period).contains(&at) => at,
        _ => at - period * (at / period).floor(),
    };
    // At least −0.5, where the one before is −1.
    let texel = at * size as f32 - 0.5;
    let next = (texel + 1.0) as usize;
    let fold = |i: Option<usize>| match wrap {
        Wrap::Repeat => i.map_or(size - 1, |i| if i < size { i } else { i - size }),
        Wrap::Clamp => i.map_or(0, |i| i.min(size - 1)),
        Wrap::Mirror => i.map_or(0, |i| if i < size { i } else { (2 * size).saturating_sub(i + 1) }),
    };
    ([fold(next.checked_sub(1)), fold(Some(next))], texel + 1.0 - next as f32)
}
