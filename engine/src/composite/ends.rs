//! Where lists end: they come in the order of centres, so that behind a tile's cuts a point comes from which on all kernels lie
//! behind them.

use super::Compositor;
use super::coming::Coming;
use crate::camera::Projection;
use crate::closing::Closing;
use crate::cull::VisibleRange;
use crate::cuts::Cuts;
use crate::footprint::Record;
use crate::raster::KERNEL_REACH;
use crate::scene::RenderSettings;
use crate::simd::*;
use crate::tile::{MAX_BLOCKS, Tile};
use glam::DVec2;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Centres are as many times as far away, along z, as their kernels reach, or nothing is said of where kernels begin.
const FAR: f64 = 10.0;

/// How much nearer than the point where a ray has the distance of their centre kernels that meet it begin, along z, at most; ∞
/// where some are nearer than that holds.
///
/// Let R be how far a kernel reaches with its filter, √c √(σ² + h²), z ≥ 10R its centre's depth, v and w the lengths of the centre's
/// ray and of another one that meets it, of those with z = 1; D = zv is the centre's distance.
/// - An affine footprint is no wider than R v/z at a depth of 1, so that |v − w| ≤ R v/z, and z ≥ (1 − R/z) D/w; with D/w ≤ 10/9 z
///   that is at least D/w − 10/9 R.
/// - In the exact form the ray meets the filtered ellipsoid, in a sphere of radius R, at an angle θ from the centre's ray with
///   sin θ ≤ R/D. With α its own angle to the axis, cos α = 1/w, z ≥ D cos(α + θ) ≥ D/w cos θ − R sin α ≥ D/w − R/10 − R.
///
/// Before the centre it reaches on by √c of what its slope adds to its spread and 5σ_z, together by √(c + 25) σ.
pub(crate) fn lead(ranges: &[VisibleRange], settings: &RenderSettings, projection: Projection) -> f32 {
    let reach = ranges.iter().map(|range| range.reach - range.radius).fold(0.0, f64::max);
    let nearest = |range: &VisibleRange| range.center_in_camera.z - range.radius;
    let is_far = |range| projection == Projection::Orthographic || nearest(range) >= FAR * reach;
    if !ranges.iter().all(is_far) {
        return f32::INFINITY;
    }
    let distances = ranges.iter().flat_map(|range| range.distances.map(|d| f64::from(d).abs()));
    let farthest = distances.fold(0.0, f64::max);
    let before_center = (1.0 + KERNEL_REACH * KERNEL_REACH / settings.farthest_end()).sqrt();
    // Distances in lists are equal that agree to 2⁻¹⁶ of their range.
    ((10.0 / 9.0 + before_center) * reach + 1e-4 * farthest) as f32
}

impl Compositor<'_> {
    /// For each block of a tile the distance of centres from which on kernels lie behind all its cuts; `None` if no block has any.
    pub(super) fn hidden_from(&self, tile: Tile, cuts: &Cuts) -> Option<[f32; MAX_BLOCKS]> {
        let longest_ray = self.longest_ray(tile);
        let distances = std::array::from_fn(|block| (cuts.block(block).hidden + self.lead) * longest_ray);
        distances.iter().any(|distance| *distance < f32::INFINITY).then_some(distances)
    }

    /// Of those through a tile, with z = 1.
    fn longest_ray(&self, tile: Tile) -> f32 {
        let corner = |x: usize, y: usize| {
            let pixel = [tile.origin[0] + x * tile.side, tile.origin[1] + y * tile.side];
            self.lens.lens.ray(DVec2::from_array(pixel.map(|p| p as f64))).length() as f32
        };
        corner(0, 0).max(corner(1, 0)).max(corner(0, 1)).max(corner(1, 1))
    }

    /// The blocks that may see something of what comes.
    #[inline(always)]
    pub(super) fn seeing<S: Simd>(
        &self,
        simd: S,
        (tile, list, coming): (Tile, &[AtomicU32], &Coming),
        hidden_from: Option<&[f32; MAX_BLOCKS]>,
    ) -> u64 {
        let next = list.first().filter(|_| !coming.has_pieces());
        let (Some(hidden_from), Some(next)) = (hidden_from, next) else { return u64::MAX };
        let distance = W::simd_from(simd, self.distance(tile, next.load(Relaxed)));
        (0..MAX_BLOCKS).step_by(16).fold(0, |set, first| {
            let is_hidden = distance.simd_gt(W::from_slice(simd, &hidden_from[first..first + 16]));
            set | (!is_hidden).to_bitmask() << first
        })
    }

    /// The least distance of the centres of a record and of those behind it in its list.
    fn distance(&self, tile: Tile, record: u32) -> f32 {
        let record = &self.records[record as usize];
        match &self.lens.closing {
            Closing::Slabs(slabs) => slabs.begin(record.amplitude_slope_or_slabs[0] as u32),
            Closing::Sheets(_) => f32::NEG_INFINITY,
            closing => self.center_distance(tile, record) - closing.alike(),
        }
    }

    /// The least distance of a kernel that comes after a record whatever else is listed.
    pub(super) fn reach(&self, tile: Tile, record: u32) -> f32 {
        let record = &self.records[record as usize];
        match &self.lens.closing {
            Closing::Slabs(slabs) => slabs.begin(record.amplitude_slope_or_slabs[0] as u32 + 1),
            Closing::Sheets(_) => f32::INFINITY,
            closing => self.center_distance(tile, record) - closing.alike(),
        }
    }

    fn center_distance(&self, tile: Tile, record: &Record) -> f32 {
        let lens = &self.lens.lens;
        let mean = DVec2::from_array(tile.among_pixels(record.mean).map(f64::from));
        match lens.projection {
            Projection::Perspective => lens.position(mean, f64::from(record.depth)).length() as f32,
            Projection::Orthographic => record.depth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Pose};
    use crate::cloud::{Cloud, Material, Shapes, Splats, Strength};
    use crate::cull::find_affordable;
    use crate::footprint::{Lens, Records, SceneProjector};
    use crate::raster::{KernelLens, Kernels};
    use crate::scene::{FootprintForm, Scene};
    use crate::shade::Lights;
    use crate::tile::pixels;
    use crate::view::SceneView;
    use glam::{DVec3, Mat3, Quat, Vec3};
    use proptest::prelude::*;

    const SIZE: [u32; 2] = [96, 64];
    const SIDE: usize = 16;

    /// A kernel before a camera that looks along z.
    fn kernel(center: Vec3, axes: Vec3, turn: Vec3) -> Scene {
        let factor = Mat3::from_quat(Quat::from_scaled_axis(turn)) * Mat3::from_diagonal(axes);
        let splats = Splats {
            centers: vec![center],
            shapes: Shapes::Shared(factor),
            strength: Strength::Extinction { masses: vec![axes.element_product() / axes.max_element()] },
            colors: vec![[0.5; 3]],
            harmonics: None,
            normals: None,
            material: Material::default(),
        };
        Scene { clouds: vec![Cloud::new(splats).unwrap()], lights: Vec::new() }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 4096, failure_persistence: None, ..ProptestConfig::default() })]

        /// No kernel that shows in a tile begins nearer than is said, in any form, at wide angles.
        #[test]
        fn kernels_begin_behind_their_lead(
            place in prop::array::uniform2(-1.3..1.3f64),
            (log_size, log_axes) in (-3.0..0.0f64, prop::array::uniform3(-4.0..0.0f32)),
            turn in prop::array::uniform3(-3.0..3.0f32),
            form in prop::sample::select(vec![FootprintForm::Point, FootprintForm::Affine, FootprintForm::Exact]),
            (angle, cutoff) in (0.5..2.2f64, prop::sample::select(vec![6.25, 9.0, 12.25])),
        ) {
            let pose = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y).unwrap();
            let camera = Camera::perspective(pose, angle, SIZE).unwrap();
            let settings = RenderSettings { footprint: form, cutoff, ..RenderSettings::default() };
            let lens = Lens::new(&camera, settings.low_pass);
            // A tenth of the depth is the largest that anything is said of.
            let z = 5.0;
            let size = log_size.exp() * z / FAR / settings.farthest_end().sqrt();
            let across = DVec2::from(place) * DVec2::from(SIZE.map(f64::from)) * 0.5 / lens.focal;
            let center = pose.world_to_camera.inverse().transform_point3(across.extend(1.0) * z);
            let axes = Vec3::from(log_axes.map(|log| (log - log_axes.into_iter().fold(f32::MIN, f32::max)).exp()));
            let scene = kernel(center.as_vec3(), axes * size as f32, Vec3::from(turn));
            let view = SceneView { scene: &scene, camera: &camera, settings: &settings };
            let mut visible = Vec::new();
            find_affordable(view, &mut visible);
            let lead = lead(&visible, &settings, Projection::Perspective);
            if visible.is_empty() || lead == f32::INFINITY {
                return Ok(());
            }
            let lights = Lights::new(&scene, &camera);
            let closing = Closing::Centers { alike: 0.0 };
            let level = Level::Baseline;
            let projector = SceneProjector { view, lights: &lights, closing, looked: None, tile_side: 16, level };
            let mut records = Records::default();
            records.append(&projector, &visible, &[0]);
            let count = records.len();
            let lens = KernelLens {
                lens,
                near: camera.near() as f32,
                cutoff: cutoff as f32,
                closing,
                is_taylor: false,
                reach_to_cuts: 4.0,
                narrowest: 0.0,
                highest_end: 0.0,
            };
            let compositor = Compositor { records: &records.records, rects: &records.rects, lens, least_transmittance: 0.0, lead, keeps_depth: false };
            for [column, row] in (0..24).map(|i| [i % 6, i / 6]) {
                let tile = Tile::new([column, row], SIDE, SIZE.map(|length| length as usize));
                // Cuts so far away that they would end the list before it.
                let hidden = compositor.distance(tile, 0) / compositor.longest_ray(tile) - lead;
                let mut kernels = Kernels::NONE;
                let shows = dispatch!(level, simd => {
                    let list: Vec<u32> = (0..count as u32).collect();
                    kernels.fill(simd, (tile, &compositor.lens, hidden), &list, (&records.records, &records.rects));
                    tile.visible_blocks().filter(|block| kernels.masks.of(*block) != 0).any(|block| {
                        let pixels = pixels(simd, tile.corner_pixel(block));
                        let fragments = kernels.fragments(simd, 0, pixels, (tile, &compositor.lens));
                        fragments.strength.simd_gt(W::simd_from(simd, 0.0)).any_true()
                    })
                });
                prop_assert!(!shows, "before {hidden}, in the tile {column}, {row}");
            }
        }
    }
}
