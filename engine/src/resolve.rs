//! Stage `resolve`: a tile's cuts and runs to shaded pixels of the frame.

use crate::color::linear_to_srgb;
use crate::columns::LANES;
use crate::composite::{Runs, Seeing, Seen};
use crate::cuts::{Cut, Cuts};
use crate::footprint::{Lens, Octet};
use crate::frame::{BAND, Channels, Frame, FrameRows};
use crate::scene::{Blend, RenderSettings, Scene};
use crate::shade::Lights;
use crate::simd::*;
use crate::tile::{BLOCK_SIDE, PIXELS, Tile, pixels};
use glam::DMat3;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Finishes pixels.
pub(crate) struct Resolver<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) lights: &'a Lights,
    /// Of surfaces.
    pub(crate) octets: &'a [Octet],
    pub(crate) settings: &'a RenderSettings,
    pub(crate) lens: Lens,
    /// The z of the plane that depths are told from.
    pub(crate) plane: f32,
    pub(crate) camera_to_world: DMat3,
}

/// The pixels of a tile, before they are written.
#[derive(Default)]
pub(crate) struct Resolved {
    /// Linear and premultiplied, by rows: where the frame doesn't begin with a line of the cache, each row of a block lies in two lines,
    /// and a whole row fills all but its ends.
    colors: Vec<[f32; 4]>,
    /// All other channels by blocks, where they are asked for.
    rests: Vec<Rest>,
}

/// All channels of a block but the colour.
#[derive(Clone, Copy)]
struct Rest {
    expected_depth: [f32; PIXELS],
    median_depth: [f32; PIXELS],
    depth: [f32; PIXELS],
    /// Of the world.
    normals: [[f32; PIXELS]; 3],
    ids: [u32; PIXELS],
}

impl Resolver<'_> {
    /// Finishes a tile, then writes it into the frame from the band on in which it begins; others wait for a band only meanwhile.
    /// Without a list there are no `runs`.
    #[inline(always)]
    pub(crate) fn tile<S: Simd>(
        &self,
        simd: S,
        tile: Tile,
        (cuts, runs): (&Cuts, Option<&Runs>),
        (Resolved { colors, rests }, bands): (&mut Resolved, &[Mutex<FrameRows>]),
    ) {
        let background = self.background(simd);
        let empty = self.color(simd, Seeing::load(simd, &Seen::CLEAR), background);
        let has_rest = self.settings.channels == Channels::All;
        colors.resize(tile.side * tile.side, [0.0; 4]);
        rests.resize(if has_rest { tile.blocks() } else { 0 }, Rest::NONE);
        for block in tile.visible_blocks() {
            let seen = self.block(simd, tile, block, (cuts, runs));
            // Most blocks of many pictures show nothing.
            let is_empty = !seen.opacity.simd_gt(W::simd_from(simd, 0.0)).any_true();
            let pixels = if is_empty {
                empty
            } else {
                apart(
                    simd,
                    #[inline(always)]
                    || self.color(simd, seen, background),
                )
            };
            let [left, top] = tile.corner(block);
            for (row, pixels) in (top..).zip(pixels.as_chunks::<BLOCK_SIDE>().0) {
                colors[row * tile.side + left..][..BLOCK_SIDE].copy_from_slice(pixels);
            }
            if has_rest {
                rests[block] = self.rest(simd, seen, &cuts.first_shown(block));
            }
        }
        let [width, height] = tile.size;
        for (band, first) in bands.iter().zip((0..height).step_by(BAND)) {
            let mut rows = band.lock().unwrap_or_else(PoisonError::into_inner);
            for row in first..height.min(first + BAND) {
                let place = rows.place(tile.origin[0], row - first);
                rows.color[place..place + width].copy_from_slice(&colors[row * tile.side..][..width]);
                if !has_rest {
                    continue;
                }
                for left in (0..width).step_by(BLOCK_SIDE) {
                    let (columns, place) = (BLOCK_SIDE.min(width - left), place + left);
                    let pixels = row % BLOCK_SIDE * BLOCK_SIDE;
                    let block = left / BLOCK_SIDE * tile.blocks_a_side() + row / BLOCK_SIDE;
                    rests[block].write(pixels..pixels + columns, place..place + columns, &mut rows);
                }
            }
        }
    }

    /// run₀ ∘ cut₁ ∘ run₁ ∘ … ∘ run_K.
    #[inline(always)]
    fn block<S: Simd>(
        &self,
        simd: S,
        tile: Tile,
        block: usize,
        (cuts, runs): (&Cuts, Option<&Runs>),
    ) -> Seeing<S> {
        let segments = if runs.is_some() { cuts.block(block).segments } else { 1 };
        let mut seen = run(simd, runs, (0, block));
        for (layer, cut) in cuts.layers(block).enumerate() {
            let alpha = cut.alpha.load(simd);
            let zero = W::simd_from(simd, 0.0);
            let found = alpha.simd_gt(zero);
            if found.any_true() {
                let depth = found.select(cut.depth.load(simd), zero);
                let color = apart(
                    simd,
                    #[inline(always)]
                    || self.shade(simd, (tile, block), cut, depth),
                );
                seen = seen.over(simd, Seeing::layer(simd, color, depth, alpha));
            }
            if layer + 1 < segments {
                seen = seen.over(simd, run(simd, runs, (layer + 1, block)));
            }
        }
        seen
    }

    /// Light on a layer, by the materials of its clouds.
    #[inline(always)]
    fn shade<S: Simd>(&self, simd: S, (tile, block): (Tile, usize), cut: &Cut, depth: W<S>) -> [W<S>; 3] {
        let [base, normal] = [&cut.color, &cut.normal].each(
            #[inline(always)]
            |planes| {
                planes.each_ref().each(
                    #[inline(always)]
                    |plane| plane.load(simd),
                )
            },
        );
        if !self.settings.shade {
            return base;
        }
        let [x, y] = pixels(simd, tile.corner_pixel(block));
        let [left, top] = tile.origin.map(|pixel| pixel as f32 + 0.5);
        let position = self.lens.positions([x + left, y + top], depth);
        let clouds = u32x16::simd_from(simd, cut.cloud);
        let mut open = clouds.simd_ne(u32x16::simd_from(simd, Cut::NO_NUMBER)).to_bitmask();
        let mut color = [W::simd_from(simd, 0.0); 3];
        while open != 0 {
            let cloud = cut.cloud[open.trailing_zeros() as usize % PIXELS];
            let own = clouds.simd_eq(u32x16::simd_from(simd, cloud));
            open &= !own.to_bitmask();
            let shader = self.lights.on(self.scene.clouds[cloud as usize].material());
            let shaded = shader.shade_wide(simd, base, normal, position);
            color = [0, 1, 2].each(
                #[inline(always)]
                |i| own.select(shaded[i], color[i]),
            );
        }
        color
    }

    /// The background in the space of blending.
    #[inline(always)]
    fn background<S: Simd>(&self, simd: S) -> Seeing<S> {
        let [red, green, blue, alpha] = self.settings.background;
        let mut color = [red, green, blue];
        if self.settings.blend == Blend::Display {
            color = color.map(linear_to_srgb);
        }
        let color = color.each(
            #[inline(always)]
            |c| W::simd_from(simd, c),
        );
        Seeing::layer(simd, color, W::simd_from(simd, 0.0), W::simd_from(simd, alpha))
    }

    /// Linear, premultiplied colours over the background.
    #[inline(always)]
    fn color<S: Simd>(&self, simd: S, seen: Seeing<S>, background: Seeing<S>) -> [[f32; 4]; PIXELS] {
        let all = seen.over(simd, background);
        let mut color = all.color;
        if self.settings.blend == Blend::Display {
            let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
            let some = all.opacity.simd_gt(zero);
            let inverse = some.select(one / all.opacity, zero);
            let linear = colors_to_linear(
                simd,
                color.each(
                    #[inline(always)]
                    |c| c * inverse,
                ),
            );
            color = [0, 1, 2].each(
                #[inline(always)]
                |i| some.select(linear[i] * all.opacity, color[i]),
            );
        }
        let [red, green, blue] = color;
        by_pixel([red, green, blue, all.opacity])
    }

    /// All channels but the colour.
    #[inline(always)]
    fn rest<S: Simd>(&self, simd: S, seen: Seeing<S>, cut: &Cut) -> Rest {
        let (zero, infinity) = (W::simd_from(simd, 0.0), W::simd_from(simd, f32::INFINITY));
        let some = seen.opacity.simd_gt(zero);
        Rest {
            expected_depth: some.select(seen.depth / seen.opacity + self.plane, infinity).into(),
            median_depth: (seen.median + self.plane).into(),
            depth: (cut.depth.load(simd) + self.plane).into(),
            normals: self.in_world(simd, cut).each(
                #[inline(always)]
                |v| v.into(),
            ),
            ids: cut.record.map(|record| match record {
                Cut::NO_NUMBER => Frame::NO_ID,
                index => self.octets[index as usize / LANES].id(index as usize % LANES),
            }),
        }
    }

    /// Unit normals of a cut in the world; 0 where there are none.
    #[inline(always)]
    fn in_world<S: Simd>(&self, simd: S, cut: &Cut) -> [W<S>; 3] {
        let [x, y, z] = cut.normal.each_ref().each(
            #[inline(always)]
            |plane| plane.load(simd),
        );
        let rows = [0, 1, 2].map(|axis| self.camera_to_world.row(axis).as_vec3().to_array());
        let turned = rows.each(
            #[inline(always)]
            |[a, b, c]| x * a + y * b + z * c,
        );
        let [x, y, z] = turned;
        let squared = x.mul_add(x, y.mul_add(y, z * z));
        let inverse = W::simd_from(simd, 1.0) / squared.sqrt();
        let is_one = squared.simd_gt(W::simd_from(simd, 1e-30)) & squared.simd_lt(W::simd_from(simd, 1e30));
        turned.each(
            #[inline(always)]
            |v| is_one.select(v * inverse, W::simd_from(simd, 0.0)),
        )
    }
}

impl Rest {
    const NONE: Self = Self {
        expected_depth: [f32::INFINITY; PIXELS],
        median_depth: [f32::INFINITY; PIXELS],
        depth: [f32::INFINITY; PIXELS],
        normals: [[0.0; PIXELS]; 3],
        ids: [Frame::NO_ID; PIXELS],
    };

    /// Writes some of the pixels to as many places.
    fn write(&self, own: Range<usize>, places: Range<usize>, rows: &mut FrameRows) {
        rows.expected_depth[places.clone()].copy_from_slice(&self.expected_depth[own.clone()]);
        rows.median_depth[places.clone()].copy_from_slice(&self.median_depth[own.clone()]);
        rows.depth[places.clone()].copy_from_slice(&self.depth[own.clone()]);
        rows.id[places.clone()].copy_from_slice(&self.ids[own.clone()]);
        for (normal, pixel) in rows.normal[places].iter_mut().zip(own) {
            *normal = self.normals.map(|axis| axis[pixel]);
        }
    }
}

/// Four channels of a block, pixel by pixel.
#[inline(always)]
fn by_pixel<S: Simd>([red, green, blue, alpha]: [W<S>; 4]) -> [[f32; 4]; PIXELS] {
    let ((rb, rb_high), (ga, ga_high)) = (red.interleave(blue), green.interleave(alpha));
    let ((a, b), (c, d)) = (rb.interleave(ga), rb_high.interleave(ga_high));
    let mut pixels = [[0.0; 4]; PIXELS];
    let quarters = pixels.as_flattened_mut().as_chunks_mut().0;
    for (quarter, channels) in quarters.iter_mut().zip([a, b, c, d]) {
        let quarter: &mut [f32; PIXELS] = quarter;
        channels.store_slice(quarter);
    }
    pixels
}

/// What a block sees of a segment; nothing without runs.
#[inline(always)]
fn run<S: Simd>(simd: S, runs: Option<&Runs>, (segment, block): (usize, usize)) -> Seeing<S> {
    Seeing::load(simd, runs.map_or(&Seen::CLEAR, |runs| runs.block(segment, block)))
}
