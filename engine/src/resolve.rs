//! Stage `resolve`: a tile's cuts and runs to shaded pixels of the frame.

use crate::color::linear_to_srgb;
use crate::columns::Lanes;
use crate::composite::Runs;
use crate::cuts::{Cut, Cuts};
use crate::footprint::{Lens, Record, SurfaceSample};
use crate::frame::{Channels, Frame, FrameRows};
use crate::scene::{Blend, RenderSettings};
use crate::shade::Shader;
use crate::simd::*;
use crate::tile::Tile;
use glam::DMat3;

/// Finishes pixels.
pub(crate) struct Resolver<'a> {
    /// One a cloud.
    pub(crate) shaders: &'a [Shader],
    /// Of surfaces.
    pub(crate) records: &'a [Record],
    pub(crate) samples: &'a [SurfaceSample],
    pub(crate) settings: &'a RenderSettings,
    pub(crate) lens: Lens,
    pub(crate) camera_to_world: DMat3,
}

/// What a stretch of eight rays sends towards the camera and lets through.
#[derive(Clone, Copy)]
struct Seen<S: Simd> {
    color: V3<S>,
    depth: V<S>,
    opacity: V<S>,
}

impl<S: Simd> Seen<S> {
    /// (C, T)∘(C', T') = (C + T·C', T·T').
    #[inline(always)]
    fn over(self, simd: S, behind: Self) -> Self {
        let through = splat(simd, 1.0) - self.opacity;
        Self {
            color: [0, 1, 2].each(
                #[inline(always)]
                |i| behind.color[i].mul_add(through, self.color[i]),
            ),
            depth: behind.depth.mul_add(through, self.depth),
            opacity: behind.opacity.mul_add(through, self.opacity),
        }
    }

    #[inline(always)]
    fn layer(color: V3<S>, depth: V<S>, alpha: V<S>) -> Self {
        Self {
            color: color.each(
                #[inline(always)]
                |c| c * alpha,
            ),
            depth: depth * alpha,
            opacity: alpha,
        }
    }
}

impl Resolver<'_> {
    /// Finishes a tile and writes it into the rows of the frame that it belongs to. Without a list there are no
    /// `runs`.
    #[inline(always)]
    pub(crate) fn tile<S: Simd>(
        &self,
        simd: S,
        tile: Tile,
        (cuts, runs): (&Cuts, Option<&Runs>),
        rows: &mut FrameRows,
    ) {
        let background = self.background(simd);
        for block in tile.visible_blocks() {
            let [columns, height] = tile.visible(block);
            let [left, top] = tile.corner(block);
            for row in 0..height {
                let seen = self.row(simd, tile, (block, row), (cuts, runs));
                let place = rows.place(tile.origin[0] + left, top + row);
                self.store_color(simd, seen, background, &mut rows.color[place..place + columns]);
                if rows.channels == Channels::All {
                    let first = cuts.layers(block).next().unwrap_or(&Cut::NONE);
                    self.store_rest(seen, (first, row), columns, (place, rows));
                }
            }
        }
    }

    /// run₀ ∘ cut₁ ∘ run₁ ∘ … ∘ run_K.
    #[inline(always)]
    fn row<S: Simd>(
        &self,
        simd: S,
        tile: Tile,
        (block, row): (usize, usize),
        (cuts, runs): (&Cuts, Option<&Runs>),
    ) -> Seen<S> {
        let read = |lanes: Lanes| V::simd_from(simd, lanes);
        let run = |segment: usize| {
            let block = runs.map_or(&crate::composite::Seen::CLEAR, |runs| runs.block(segment, block));
            Seen {
                color: block.color.each(
                    #[inline(always)]
                    |plane| read(plane[row]),
                ),
                depth: read(block.depth[row]),
                opacity: read(block.opacity[row]),
            }
        };
        let segments = if runs.is_some() { cuts.block(block).segments } else { 1 };
        let mut seen = run(0);
        for (layer, cut) in cuts.layers(block).enumerate() {
            let alpha = read(cut.alpha[row]);
            let found = alpha.simd_gt(splat(simd, 0.0));
            if found.any_true() {
                let depth = keep(simd, found, read(cut.depth[row]));
                let color = self.shade(simd, (tile, block), (cut, row), depth);
                seen = seen.over(simd, Seen::layer(color, depth, alpha));
            }
            if layer + 1 < segments {
                seen = seen.over(simd, run(layer + 1));
            }
        }
        seen
    }

    /// Light on a layer, by the materials of its clouds.
    #[inline(always)]
    fn shade<S: Simd>(
        &self,
        simd: S,
        (tile, block): (Tile, usize),
        (cut, row): (&Cut, usize),
        depth: V<S>,
    ) -> V3<S> {
        let base = cut.color.each(
            #[inline(always)]
            |plane| V::simd_from(simd, plane[row]),
        );
        if !self.settings.shade {
            return base;
        }
        let first = tile.first_center(block, row);
        let position = self.lens.positions(simd, lane_numbers(simd) + first.x as f32, first.y as f32, depth);
        let normal = cut.normal.each(
            #[inline(always)]
            |plane| V::simd_from(simd, plane[row]),
        );
        let cloud_of = |record: u32| match record {
            Cut::NO_RECORD => None,
            index => Some(self.records[index as usize].tag.cloud),
        };
        let clouds = cut.record[row].each(cloud_of);
        let mut color = splat3(simd, [0.0; 3]);
        for (lane, cloud) in clouds.iter().enumerate() {
            let Some(cloud) = *cloud else { continue };
            if clouds[..lane].contains(&Some(cloud)) {
                continue;
            }
            let own = clouds.each(
                #[inline(always)]
                |other| if other == Some(cloud) { -1 } else { 0 },
            );
            let own = i32x8::simd_from(simd, own).simd_lt(i32x8::simd_from(simd, 0));
            let shaded = self.shaders[cloud as usize].shade_wide(simd, base, normal, position);
            color = [0, 1, 2].each(
                #[inline(always)]
                |i| own.select(shaded[i], color[i]),
            );
        }
        color
    }

    /// The background in the space of blending.
    #[inline(always)]
    fn background<S: Simd>(&self, simd: S) -> Seen<S> {
        let [red, green, blue, alpha] = self.settings.background;
        let mut color = [red, green, blue];
        if self.settings.blend == Blend::Display {
            color = color.map(linear_to_srgb);
        }
        Seen::layer(splat3(simd, color), splat(simd, 0.0), splat(simd, alpha))
    }

    /// Linear, premultiplied colours over the background.
    #[inline(always)]
    fn store_color<S: Simd>(&self, simd: S, seen: Seen<S>, background: Seen<S>, pixels: &mut [[f32; 4]]) {
        let all = seen.over(simd, background);
        let mut color = all.color;
        if self.settings.blend == Blend::Display {
            let zero = splat(simd, 0.0);
            let some = all.opacity.simd_gt(zero);
            let inverse = keep(simd, some, splat(simd, 1.0) / all.opacity);
            color = color.each(
                #[inline(always)]
                |c| some.select(srgb_to_linear(simd, c * inverse) * all.opacity, c),
            );
        }
        let [red, green, blue, alpha]: [Lanes; 4] = [color[0], color[1], color[2], all.opacity].each(
            #[inline(always)]
            |v| v.into(),
        );
        for (lane, pixel) in pixels.iter_mut().enumerate() {
            *pixel = [red[lane], green[lane], blue[lane], alpha[lane]];
        }
    }

    #[inline(always)]
    fn store_rest<S: Simd>(
        &self,
        seen: Seen<S>,
        (first, row): (&Cut, usize),
        columns: usize,
        (place, rows): (usize, &mut FrameRows),
    ) {
        let (depth, opacity): (Lanes, Lanes) = (seen.depth.into(), seen.opacity.into());
        for lane in 0..columns {
            let place = place + lane;
            rows.expected_depth[place] =
                if opacity[lane] > 0.0 { depth[lane] / opacity[lane] } else { f32::INFINITY };
            rows.depth[place] = first.depth[row][lane];
            let normal = glam::Vec3::from(first.normal.map(|plane| plane[row][lane]));
            rows.normal[place] = (self.camera_to_world * normal.as_dvec3()).as_vec3().to_array();
            rows.id[place] = match first.record[row][lane] {
                Cut::NO_RECORD => Frame::NO_ID,
                index => self.samples[index as usize].id,
            };
        }
    }
}
