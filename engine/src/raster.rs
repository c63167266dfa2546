//! Stage `raster`: a tile's records to fragments and surface samples.

use crate::bin::TILE;
use crate::exponential::exp;
use crate::footprint::{Form, Kind, Lens, RecordHit, Records, Rect};
use glam::DVec2;

/// The pixels of a tile that lie in the picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tile {
    /// Column and row of its first pixel.
    pub(crate) origin: [usize; 2],
    /// Pixels in a row and rows; at most [`TILE`].
    pub(crate) size: [usize; 2],
}

impl Tile {
    /// Row · TILE + column of each pixel.
    pub(crate) fn pixels(self) -> impl Iterator<Item = usize> {
        let [width, height] = self.size;
        (0..height).flat_map(move |y| (0..width).map(move |x| y * TILE + x))
    }

    /// The centre of the pixel with this number, in the picture.
    pub(crate) fn center(self, pixel: usize) -> DVec2 {
        let [left, top] = self.origin;
        DVec2::new((left + pixel % TILE) as f64, (top + pixel / TILE) as f64) + 0.5
    }
}

/// A volume kernel at a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// z of the densest point.
    pub(crate) depth: f32,
    /// Spread in z.
    pub(crate) sigma_z: f32,
    /// Optical depth of the whole kernel there.
    pub(crate) optical_depth: f32,
    /// Row · TILE + column in the tile.
    pub(crate) pixel: u16,
}

/// Fragments of consecutive splats, front to back.
#[derive(Default)]
pub(crate) struct Fragments {
    pub(crate) fragments: Vec<Fragment>,
    /// For each splat, its record and where its fragments end.
    pub(crate) splats: Vec<(u32, usize)>,
}

impl Fragments {
    pub(crate) fn clear(&mut self) {
        self.fragments.clear();
        self.splats.clear();
    }
}

/// A surface at a pixel, seen by one splat.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// z of the densest point.
    pub(crate) depth: f32,
    /// The surfel's plane at the pixel lies this much deeper. Zero for a surfel that fills the pixel's
    /// filter; for a smaller one the filter sees it where it is, and its plane somewhere else.
    pub(crate) plane_offset: f32,
    /// Spread in z.
    pub(crate) sigma_z: f32,
    /// Coverage over the cloud's floor.
    pub(crate) weight: f32,
    /// The record.
    pub(crate) record: u32,
    /// Row · TILE + column in the tile.
    pub(crate) pixel: u16,
    /// Whether the splat shows its back.
    pub(crate) faces_away: bool,
}

impl Sample {
    /// The near end of its span.
    pub(crate) fn nearest(&self) -> f32 {
        self.depth + self.plane_offset.min(0.0)
    }

    /// The far end of its span.
    pub(crate) fn farthest(&self) -> f32 {
        self.depth + self.plane_offset.max(0.0)
    }
}

/// What rasterization needs besides the records.
pub(crate) struct Rasterizer<'a> {
    pub(crate) records: &'a Records,
    pub(crate) lens: Lens,
    pub(crate) cutoff: f32,
    pub(crate) near: f32,
}

impl Rasterizer<'_> {
    /// Calls `emit` with each pixel of the tile where r ≤ the cut-off.
    #[inline(always)]
    fn for_each_hit(&self, index: u32, tile: Tile, mut emit: impl FnMut(u16, [f32; 2], RecordHit)) {
        let record = &self.records.records[index as usize];
        let Rect { min, max } = self.records.rects[index as usize];
        let bound = |axis: usize| {
            let low = (min[axis] as usize).max(tile.origin[axis]);
            low..(max[axis] as usize).min(tile.origin[axis] + tile.size[axis])
        };
        for y in bound(1) {
            let v = y as f32 + 0.5 - record.mean[1];
            for x in bound(0) {
                let u = x as f32 + 0.5 - record.mean[0];
                let hit = record.hit(u, v);
                if hit.r <= self.cutoff {
                    let pixel = (y - tile.origin[1]) * TILE + x - tile.origin[0];
                    emit(pixel as u16, [u, v], hit);
                }
            }
        }
    }

    /// Adds the samples of a surface record.
    pub(crate) fn samples(&self, index: u32, tile: Tile, out: &mut Vec<Sample>) {
        let record = &self.records.records[index as usize];
        let [slope_x, slope_y] = record.amplitude_slope;
        let perspective = record.inverse_depth != 0.0;
        let zeta = if perspective { record.depth } else { 1.0 };
        let filter_reach = self.cutoff.sqrt() * (self.lens.low_pass / self.lens.focal.min_element()) as f32;
        let farthest_offset = STEEPEST * filter_reach * zeta.abs();
        self.for_each_hit(index, tile, |pixel, [x, y], hit| {
            // n·v at the pixel and at the centre, both times one factor.
            let change = slope_x * x + slope_y * y;
            let facing = record.amplitude + change;
            let used = if record.form == Form::Exact { facing } else { record.amplitude };
            let weight = used.abs() * hit.scale * exp(-0.5 * hit.r);
            if weight > 0.0 && hit.z > self.near {
                let rise = -zeta * change / if perspective { facing } else { record.amplitude };
                let plane_offset = record.depth + rise - hit.z;
                // Seen exactly edge-on a plane has no depth at the pixel; NaN becomes the near limit.
                let plane_offset = plane_offset.max(-farthest_offset).min(farthest_offset);
                out.push(Sample {
                    depth: hit.z,
                    plane_offset,
                    sigma_z: hit.sigma_z,
                    weight,
                    record: index,
                    pixel,
                    faces_away: used > 0.0,
                });
            }
        });
    }

    /// Adds the fragments of a volume record.
    pub(crate) fn fragments(&self, index: u32, tile: Tile, out: &mut Fragments) {
        let record = &self.records.records[index as usize];
        self.for_each_hit(index, tile, |pixel, _, hit| {
            let amplitude = record.amplitude * exp(-0.5 * hit.r);
            let optical_depth = match (record.kind, record.form) {
                (Kind::Opacity, _) => -(-amplitude.min(LARGEST_ALPHA)).ln_1p(),
                (_, Form::Affine) => amplitude,
                (_, Form::Exact) => {
                    let ray = self.lens.ray(tile.center(usize::from(pixel)));
                    amplitude * hit.scale * ray.length() as f32
                }
            };
            out.fragments.push(Fragment { depth: hit.z, sigma_z: hit.sigma_z, optical_depth, pixel });
        });
        out.splats.push((index, out.fragments.len()));
    }
}

/// The steepest slope dz/dx that a surfel's plane is followed along: 88°.
const STEEPEST: f32 = 30.0;

/// Keeps the optical depth of a kernel of opacity 1 finite; off by less than 1e-6 of a channel.
const LARGEST_ALPHA: f32 = 1.0 - 1e-6;
