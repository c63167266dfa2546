//! What may be hidden, guessed before anything is drawn.
//!
//! Ranges come from near to far and cover the squares that they touch by as much as their splats would, were they spread evenly
//! over them. What comes behind covered squares is taken for hidden.

use super::bounds::{Bounds, Sight};
use super::facing::Facing;
use super::looked::{CELL, Looked, squares};
use crate::cloud::Cloud;
use crate::columns::{Kind, LANES};
use crate::cull::VisibleRange;
use crate::scene::Scene;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// A square that is covered as many times is taken for opaque: rectangles of patches are larger than they, and sheets are
/// uneven in this measure.
const COVERED: f32 = 0.4;

/// How far splats of a range are before and behind its middle, in its radius.
const DEEP: f32 = 0.75;

/// Volumes vary more from place to place.
const FILLED: f32 = 4.0;

/// Blocks of eight splats that speak for a range.
const SAMPLED: usize = 4;

/// How the squares of a picture are covered.
#[derive(Default)]
pub(super) struct Guess {
    side: usize,
    columns: [usize; 2],
    /// Of cells: how often they are covered, and the sum of the z where that is done, by how much. A few ranges reach far
    /// beyond most of their splats: the mean doesn't go by them.
    cells: Vec<[f32; 2]>,
    /// Of tiles: how often they are filled by volumes, and the z from which on all of their cells are covered.
    tiles: Vec<[f32; 2]>,
    /// By which each range adds to them, of surfaces and of volumes.
    coverages: [Vec<f32>; 2],
}

impl Guess {
    pub(super) fn begin(&mut self, looked: &Looked) {
        (self.side, self.columns) = (looked.side(), looked.columns());
        self.cells.clear();
        self.cells.resize(looked.cells(), [0.0; 2]);
        self.tiles.clear();
        self.tiles.resize(looked.tiles(), [0.0, f32::NEG_INFINITY]);
    }

    /// Whether a surface that is missing from some cells is to be drawn next: not while nearer ones cover all of these
    /// `enough` times.
    pub(super) fn admits(
        &mut self,
        rank: u32,
        cells: impl Iterator<Item = usize> + Clone,
        enough: f32,
    ) -> bool {
        if cells.clone().all(|cell| self.cells[cell][0] >= enough) {
            return false;
        }
        cells.for_each(|cell| self.cells[cell][0] += self.coverages[0][rank as usize]);
        true
    }

    /// The surfaces that seem to be hidden, of ranges from near to far.
    pub(super) fn hidden_surfaces(
        &mut self,
        (scene, sight, spent): (&Scene, &Sight, f64),
        ranges: &[VisibleRange],
        bounds: &mut [Bounds],
    ) -> Vec<u32> {
        let coverage = |(range, bounds): (&VisibleRange, &mut Bounds)| {
            let cloud = &scene.clouds[range.cloud];
            let area = surface_area(sight, cloud, range, spent);
            if area == 0.0 {
                bounds.near = Facing::new(sight, cloud, range).nearest(range);
            }
            (area / bounds.area.max(1.0)) as f32
        };
        let coverages = ranges.par_iter().zip(&mut *bounds).map(coverage);
        coverages.collect_into_vec(&mut self.coverages[0]);
        let mut hidden = Vec::new();
        for (rank, (coverage, bounds)) in self.coverages[0].iter().zip(bounds).enumerate() {
            let Bounds { pixels, near, middle, radius, .. } = &*bounds;
            let [front, back] = [middle - DEEP * radius, middle + DEEP * radius];
            let [columns, rows] = squares(pixels, CELL);
            let row = |row: usize| row * self.columns[0] + columns.start..row * self.columns[0] + columns.end;
            let hides = |[covered, depths]: &[f32; 2]| *covered >= COVERED && front * covered > *depths;
            let is_turned_away = *near == f32::INFINITY;
            if is_turned_away || rows.clone().all(|y| self.cells[row(y)].iter().all(hides)) {
                hidden.push(rank as u32);
                continue;
            }
            for y in rows {
                for [covered, depths] in &mut self.cells[row(y)] {
                    if *covered < COVERED {
                        *covered += coverage;
                        *depths += coverage * back;
                    }
                }
            }
        }
        hidden
    }

    /// The volumes that seem to be hidden by the surfaces, or by each other.
    pub(super) fn hidden_volumes(
        &mut self,
        (scene, sight, spent): (&Scene, &Sight, f64),
        ranges: &[VisibleRange],
        bounds: &[Bounds],
    ) -> Vec<u32> {
        if ranges.is_empty() {
            return Vec::new();
        }
        let (cells_a_tile, [cell_columns, tile_columns]) = (self.side / CELL, self.columns);
        for (place, [covered, depths]) in self.cells.iter().enumerate() {
            let [x, y] = [place % cell_columns / cells_a_tile, place / cell_columns / cells_a_tile];
            let behind = &mut self.tiles[y * tile_columns + x][1];
            *behind = behind.max(if *covered >= COVERED { depths / covered } else { f32::INFINITY });
        }
        let coverage = |(range, bounds): (&VisibleRange, &Bounds)| {
            let depth = optical_area(sight, &scene.clouds[range.cloud], range) / -spent.ln();
            (depth / bounds.area.max(1.0)) as f32
        };
        ranges.par_iter().zip(bounds).map(coverage).collect_into_vec(&mut self.coverages[1]);
        let mut order: Vec<u32> = (0..ranges.len() as u32).collect();
        order.par_sort_by(|a, b| {
            let distance = |rank: &u32| bounds[*rank as usize].distance;
            distance(a).total_cmp(&distance(b)).then(a.cmp(b))
        });
        let mut hidden = Vec::new();
        for rank in order {
            let Bounds { pixels, near, .. } = &bounds[rank as usize];
            let [columns, rows] = squares(pixels, self.side);
            let tiles = || rows.clone().flat_map(|y| columns.clone().map(move |x| y * tile_columns + x));
            let is_hidden = |[filled, behind]: [f32; 2]| filled >= FILLED || *near > behind;
            if tiles().all(|tile| is_hidden(self.tiles[tile])) {
                hidden.push(rank);
                continue;
            }
            for tile in tiles() {
                self.tiles[tile][0] += self.coverages[1][rank as usize];
            }
        }
        hidden.sort_unstable();
        hidden
    }
}

/// Some blocks of a range, evenly spread.
fn sampled(range: &VisibleRange) -> impl Iterator<Item = usize> + Clone {
    let blocks = range.splats.start / LANES..range.splats.end.div_ceil(LANES);
    let step = blocks.len().div_ceil(SAMPLED).max(1);
    blocks.skip(step / 2).step_by(step)
}

/// Pixels a squared world unit at the middle of a range.
fn pixels_at(sight: &Sight, center: DVec3) -> f64 {
    let scale = if sight.is_perspective() { center.z.max(1e-9).recip() } else { 1.0 };
    sight.lens.focal.element_product() * scale * scale
}

/// How many pixels a range of surfels covers; translucent ones by how much of the way to opaque they go.
fn surface_area(sight: &Sight, cloud: &Cloud, range: &VisibleRange, spent: f64) -> f64 {
    let facing = Facing::new(sight, cloud, range);
    let ray = sight.ray(range.center_in_camera);
    let opaque = |opacity: f32| ((-opacity).ln_1p() / spent.ln() as f32).min(1.0);
    let area: f64 = sampled(range).map(|block| facing.area(block, ray, opaque)).sum();
    let share = range.splats.len() as f64 / (LANES * sampled(range).count()).max(1) as f64;
    area * share * pixels_at(sight, range.center_in_camera)
}

/// The optical depth of a range, summed over pixels.
fn optical_area(sight: &Sight, cloud: &Cloud, range: &VisibleRange) -> f64 {
    let columns = &cloud.levels()[range.level].columns;
    let linear = sight.world_to_camera.matrix3 * cloud.cloud_to_world().matrix3;
    let ray = sight.ray(range.center_in_camera);
    let (mut sum, mut count) = (0.0, 0);
    let volume = linear.determinant().abs();
    for block in sampled(range) {
        for (lane, strength) in columns.strengths.block(block)[0].into_iter().enumerate() {
            let strength = f64::from(strength);
            count += 1;
            sum += match columns.kind {
                Kind::Opacity(_) => {
                    // ∫ of a Gaussian footprint over the picture: 2π √D₀.
                    let factor = columns.factor((block * LANES + lane).min(columns.len - 1));
                    let [a, b, c] = [factor.x_axis, factor.y_axis, factor.z_axis]
                        .map(|axis: Vec3| linear * axis.as_dvec3());
                    let across = [a.cross(b), b.cross(c), c.cross(a)].map(|n| ray.dot(n).powi(2));
                    let root = across.into_iter().sum::<f64>().sqrt();
                    std::f64::consts::TAU * root * -(-strength.min(1.0 - 1e-6)).ln_1p()
                }
                _ => strength * volume * ray.length(),
            };
        }
    }
    sum * pixels_at(sight, range.center_in_camera) * range.splats.len() as f64 / f64::from(count.max(1))
}
