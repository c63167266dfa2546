//! Stage `resolve`: a tile's cuts and runs to shaded pixels of the frame.

use crate::color::{linear_to_srgb, srgb_to_linear};
use crate::composite::{Cut, Run, Runs};
use crate::footprint::Lens;
use crate::frame::Frame;
use crate::layers::Cuts;
use crate::raster::Tile;
use crate::scene::{Blend, RenderSettings};
use crate::shade::Shader;
use glam::{DMat3, DVec2, Vec3};

/// One finished pixel.
#[derive(Clone, Copy)]
pub(crate) struct Pixel {
    color: [f32; 4],
    depth: f32,
    expected_depth: f32,
    normal: [f32; 3],
    id: u32,
}

/// Finishes pixels.
pub(crate) struct Resolver<'a> {
    /// One a cloud.
    pub(crate) shaders: Vec<Shader>,
    pub(crate) settings: &'a RenderSettings,
    pub(crate) lens: Lens,
    pub(crate) camera_to_world: DMat3,
}

impl Resolver<'_> {
    /// The pixels of a tile, row by row.
    pub(crate) fn tile(&self, tile: Tile, cuts: &Cuts, runs: &Runs) -> Vec<Pixel> {
        tile.pixels().map(|pixel| self.pixel(tile.center(pixel), cuts.of(pixel), runs.of(pixel))).collect()
    }

    /// run₀ ∘ cut₁ ∘ run₁ ∘ … ∘ run_K ∘ background.
    fn pixel(&self, place: DVec2, cuts: &[Cut], runs: &[Run]) -> Pixel {
        let mut all = runs[0];
        for (cut, run) in cuts.iter().zip(&runs[1..]) {
            all = all.over(Run::layer(self.shade(place, cut), cut.depth, cut.alpha)).over(*run);
        }
        let alpha = all.opacity;
        let expected_depth = if alpha > 0.0 { all.color_and_depth.w / alpha } else { f32::INFINITY };
        let first = cuts.first();
        let normal = first
            .map_or(Vec3::ZERO, |cut| (self.camera_to_world * Vec3::from(cut.normal).as_dvec3()).as_vec3());
        Pixel {
            color: self.over_background(all),
            depth: first.map_or(f32::INFINITY, |cut| cut.depth),
            expected_depth,
            normal: normal.to_array(),
            id: first.map_or(Frame::NO_ID, |cut| cut.id),
        }
    }

    fn shade(&self, place: DVec2, cut: &Cut) -> [f32; 3] {
        if !self.settings.shade {
            return cut.color;
        }
        let position = self.lens.position(place, f64::from(cut.depth)).as_vec3();
        self.shaders[cut.cloud as usize].shade(cut.color, Vec3::from(cut.normal), position)
    }

    fn over_background(&self, run: Run) -> [f32; 4] {
        let [red, green, blue, background_alpha] = self.settings.background;
        let mut background = [red, green, blue];
        if self.settings.blend == Blend::Display {
            background = background.map(linear_to_srgb);
        }
        let all = run.over(Run::layer(background, 0.0, background_alpha));
        let alpha = all.opacity;
        let [mut red, mut green, mut blue] = all.color_and_depth.truncate().to_array();
        if self.settings.blend == Blend::Display && alpha > 0.0 {
            [red, green, blue] = [red, green, blue].map(|c| srgb_to_linear(c / alpha) * alpha);
        }
        [red, green, blue, alpha]
    }
}

/// Writes a tile's pixels into the frame.
pub(crate) fn store(frame: &mut Frame, tile: Tile, pixels: &[Pixel]) {
    for (y, row) in pixels.chunks_exact(tile.size[0]).enumerate() {
        let start = (tile.origin[1] + y) * frame.width + tile.origin[0];
        for (x, pixel) in row.iter().enumerate() {
            frame.color[start + x] = pixel.color;
            frame.depth[start + x] = pixel.depth;
            frame.expected_depth[start + x] = pixel.expected_depth;
            frame.normal[start + x] = pixel.normal;
            frame.id[start + x] = pixel.id;
        }
    }
}
