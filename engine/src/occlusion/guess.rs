//! What may be hidden, guessed before anything is drawn.
//!
//! Ranges come from near to far. Those of surfaces cover the squares where some of their surfels are, those of volumes fill the
//! squares that they touch by as much as their splats would, were they spread evenly over them. What comes behind squares that are
//! covered, or filled, by its own kind is taken for hidden.

use super::bounds::{Bounds, Sight};
use super::facing::Facing;
use super::looked::{CELL, Looked, squares};
use super::sheet::{Patch, Sheet, sampled};
use crate::cloud::Cloud;
use crate::columns::{Columns, Factors, Kind, LANES};
use crate::cull::VisibleRange;
use crate::pass::{Pass, PerPass};
use crate::scene::Scene;
use crate::simd::*;
use glam::Vec3;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::ops::Range;

/// A square that is covered as many times is taken for opaque: more than half, as at the edge of something, and less than
/// once, since the measure is uneven.
const COVERED: f32 = 0.55;

/// Volumes vary far more from place to place.
const FILLED: f32 = 16.0;

/// Blocks of eight splats that speak for a range of a volume.
const SAMPLED: usize = 4;

/// One range of as many is asked first, and how often squares must be covered or filled in the mean to ask the others.
const PROBED: usize = 8;
const DEEP: PerPass<f64> = PerPass { surfaces: 1.2, volumes: FILLED as f64 };

/// How the squares of a picture are covered.
#[derive(Default)]
pub(super) struct Guess {
    side: usize,
    columns: [usize; 2],
    /// Of cells: how often they are covered, and the sum of the z where that is done, by how much.
    cells: Vec<[f32; 2]>,
    /// How often tiles are filled by volumes.
    tiles: Vec<f32>,
    /// What ranges of surfaces cover, and by how much each of a volume fills its rectangle.
    sheets: Vec<Sheet>,
    fillings: Vec<f32>,
}

impl Guess {
    pub(super) fn begin(&mut self, looked: &Looked) {
        (self.side, self.columns) = (looked.side(), looked.columns());
        self.cells.clear();
        self.cells.resize(looked.cells(), [0.0; 2]);
        self.tiles.clear();
        self.tiles.resize(looked.tiles(), 0.0);
    }

    /// Whether much of a pass may be hidden, as a few of its ranges tell.
    pub(super) fn may_hide(
        &self,
        (scene, sight, least_transmittance): (&Scene, &Sight, f64),
        pass: Pass,
        ranges: &[VisibleRange],
    ) -> bool {
        let mut is_touched = vec![false; self.tiles.len()];
        let mut sum = 0.0;
        for range in ranges.iter().step_by(PROBED) {
            let cloud = &scene.clouds[range.cloud];
            sum += match pass {
                Pass::Surfaces => Facing::new(sight, cloud, range).area(range, least_transmittance),
                Pass::Volumes => optical_area(sight, cloud, range) / -least_transmittance.ln(),
            };
            let [columns, rows] = squares(&Bounds::new(sight, range).pixels, self.side);
            for row in rows {
                is_touched[row * self.columns[1]..][columns.clone()].fill(true);
            }
        }
        let touched = is_touched.into_iter().filter(|is_touched| *is_touched).count() * self.side * self.side;
        sum * PROBED as f64 >= DEEP[pass] * touched as f64
    }

    /// Whether a surface that is missing from some cells is to be drawn next: not while nearer ones cover all of these
    /// `enough` times.
    pub(super) fn admits(&mut self, rank: u32, cells: &[u32], enough: f32) -> bool {
        if cells.iter().all(|cell| self.cells[*cell as usize][0] >= enough) {
            return false;
        }
        let coverage = self.sheets[rank as usize].coverage;
        cells.iter().for_each(|cell| self.cells[*cell as usize][0] += coverage);
        true
    }

    /// Whether all surfels of a range face away.
    pub(super) fn is_turned_away(&self, rank: u32) -> bool {
        self.sheets[rank as usize].is_turned_away
    }

    /// The surfaces that seem to be hidden, of ranges from near to far; not those that are turned away.
    pub(super) fn hidden_surfaces(
        &mut self,
        (scene, sight, least_transmittance): (&Scene, &Sight, f64),
        ranges: &[VisibleRange],
    ) -> Vec<u32> {
        self.sheets.resize_with(ranges.len().max(self.sheets.len()), Sheet::default);
        self.sheets.par_iter_mut().zip(ranges).for_each(|(sheet, range)| {
            let facing = Facing::new(sight, &scene.clouds[range.cloud], range);
            sheet.spread(sight, &facing, (range, least_transmittance));
        });
        let size = (self.columns[0], self.cells.len());
        let cells = |patch: &Patch, border: f32| squares_around(patch, border, size);
        let row =
            |row: usize, columns: &Range<usize>| row * size.0 + columns.start..row * size.0 + columns.end;
        let mut hidden = Vec::new();
        for (rank, sheet) in self.sheets[..ranges.len()].iter().enumerate() {
            let is_hidden = |patch: &Patch| {
                let hides =
                    |[covered, depths]: &[f32; 2]| *covered >= COVERED && patch.depths[0] * covered > *depths;
                let [columns, mut rows] = cells(patch, sheet.reach);
                rows.all(|y| self.cells[row(y, &columns)].iter().all(hides))
            };
            if !sheet.patches.is_empty() && sheet.patches.iter().all(is_hidden) {
                hidden.push(rank as u32);
                continue;
            }
            for patch in &sheet.patches {
                let [columns, rows] = cells(patch, 0.0);
                for y in rows {
                    let down = within(patch, 1, y);
                    for (x, cell) in columns.clone().zip(&mut self.cells[row(y, &columns)]) {
                        let [covered, depths] = cell;
                        if *covered < COVERED {
                            let added = patch.covered * down * within(patch, 0, x);
                            *covered += added;
                            *depths += added * patch.depths[1];
                        }
                    }
                }
            }
        }
        hidden
    }

    /// The volumes that seem to be hidden by each other, of those that are chosen.
    pub(super) fn hidden_volumes(
        &mut self,
        (scene, sight, least_transmittance): (&Scene, &Sight, f64),
        (ranges, bounds, chosen): (&[VisibleRange], &[Bounds], &[u32]),
    ) -> Vec<u32> {
        let filling = |(range, bounds): (&VisibleRange, &Bounds)| {
            let depth = optical_area(sight, &scene.clouds[range.cloud], range) / -least_transmittance.ln();
            (depth / bounds.area.max(1.0)) as f32
        };
        ranges.par_iter().zip(bounds).map(filling).collect_into_vec(&mut self.fillings);
        let mut order = chosen.to_vec();
        order.par_sort_by(|a, b| {
            let distance = |rank: &u32| bounds[*rank as usize].distance;
            distance(a).total_cmp(&distance(b)).then(a.cmp(b))
        });
        let tile_columns = self.columns[1];
        let mut hidden = Vec::new();
        for rank in order {
            let [columns, rows] = squares(&bounds[rank as usize].pixels, self.side);
            let tiles = || rows.clone().flat_map(|y| columns.clone().map(move |x| y * tile_columns + x));
            if tiles().all(|tile| self.tiles[tile] >= FILLED) {
                hidden.push(rank);
                continue;
            }
            for tile in tiles() {
                self.tiles[tile] += self.fillings[rank as usize];
            }
        }
        hidden.sort_unstable();
        hidden
    }
}

/// Columns and rows of the cells, which are `count` in all, that a patch touches with a border around it.
fn squares_around(patch: &Patch, border: f32, (columns, count): (usize, usize)) -> [Range<usize>; 2] {
    let most = [columns, count / columns.max(1)];
    [0, 1].map(|axis| {
        let most = most[axis];
        let [from, to] = [-1.0, 1.0].map(|side| patch.center[axis] + side * (patch.half + border));
        let start = ((from / CELL as f32).floor() as usize).min(most);
        start..((to / CELL as f32).ceil() as usize).clamp(start, most)
    })
}

/// Which share of a cell lies within a patch, along an axis.
fn within(patch: &Patch, axis: usize, cell: usize) -> f32 {
    let from = (patch.center[axis] - patch.half).max((cell * CELL) as f32);
    let to = (patch.center[axis] + patch.half).min(((cell + 1) * CELL) as f32);
    (to - from).max(0.0) / CELL as f32
}

/// The optical depth of a range, summed over pixels.
fn optical_area(sight: &Sight, cloud: &Cloud, range: &VisibleRange) -> f64 {
    let columns = &cloud.levels()[range.level].columns;
    let linear = sight.world_to_camera.matrix3 * cloud.cloud_to_world().matrix3;
    let ray = sight.ray(range.center_in_camera);
    let blocks = sampled(range, SAMPLED);
    let count = blocks.clone().count() * LANES;
    let sum = dispatch!(Level::best(), simd => match columns.kind {
        Kind::Opacity { .. } => {
            // ∫ of a Gaussian footprint over the picture: 2π √D₀.
            // n·v₀ of a cross product of half-axes in camera space is that of the same in cloud space with another vector.
            let along = (linear.inverse() * ray * linear.determinant()).as_vec3();
            TAU * sum_of(simd, columns, blocks, #[inline(always)] |strength, block| {
                let most = strength.min(splat(simd, 1.0 - 1e-6));
                optical_depth(simd, most) * root_depth(simd, columns, block, along)
            })
        }
        _ => {
            let volume = linear.determinant().abs() * ray.length();
            volume * sum_of(simd, columns, blocks, #[inline(always)] |strength, _| strength)
        }
    });
    sum * sight.pixels_at(range.center_in_camera) * range.splats.len() as f64 / count.max(1) as f64
}

/// The sum over blocks of what is made of their strengths.
#[inline(always)]
fn sum_of<S: Simd>(
    simd: S,
    columns: &Columns,
    blocks: impl Iterator<Item = usize>,
    of: impl Fn(V<S>, usize) -> V<S>,
) -> f64 {
    let mut sum = splat(simd, 0.0);
    for block in blocks {
        let [strengths] = *columns.strengths.block(block, &mut Default::default());
        sum += of(V::simd_from(simd, strengths), block);
    }
    <[f32; LANES]>::from(sum).into_iter().map(f64::from).sum()
}

/// √D₀ of a block's splats, as if all were seen along one ray, of which this is the vector in cloud space.
#[inline(always)]
fn root_depth<S: Simd>(simd: S, columns: &Columns, block: usize, along: Vec3) -> V<S> {
    let along: V3<S> = splat3(simd, along.to_array());
    let [a, b, c] = match &columns.factors {
        Factors::Shared(factor) => [factor.x_axis, factor.y_axis, factor.z_axis].each(
            #[inline(always)]
            |axis| splat3(simd, axis.to_array()),
        ),
        Factors::Each { flat, through } => {
            let [a, b, c, d, e, f] = *flat.block(block);
            [[a, b, c], [d, e, f], *through.block(block)].each(
                #[inline(always)]
                |column| {
                    column.each(
                        #[inline(always)]
                        |row| V::simd_from(simd, row),
                    )
                },
            )
        }
    };
    let across = [cross(a, b), cross(b, c), cross(c, a)].each(
        #[inline(always)]
        |normal| dot(normal, along),
    );
    dot(across, across).sqrt()
}
