//! Levels of detail: splats that stand for four of the level below each, chosen where the picture can't tell.
//!
//! A splat of a level has the mass, the mean, the covariance and the colour of the four that it stands for, and knows from
//! which pixel filter on it may do so (`needs`). Four consecutive splats have one parent, and four consecutive clusters one
//! parent cluster: the tree is in the order, and a cut through it is a set of ranges. See `cull`.

mod family;
mod merge;
mod need;
mod order;
mod orientation;

use crate::columns::{CHILDREN, Column, Columns, Factors, LANES, Lanes};
use crate::cone::Cone;
use crate::cull::CLUSTER_SIZE;
use crate::simd::{self, *};
pub(crate) use family::eigenvalues;
use family::frobenius_squared;
use glam::Vec3;
use merge::coarser;
use order::make_compact;
pub(crate) use orientation::{LEAST_WIDTH, Orientation, Shown};
use rayon::prelude::*;
use std::ops::Range;

/// The splats of a cloud, or splats that stand for them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Level {
    pub(crate) columns: Columns,
    pub(crate) clusters: Vec<Cluster>,
    /// Corners of the box around the centres of its splats; `None` without any.
    pub(crate) bounds: Option<[Vec3; 2]>,
    /// See [`Columns::median_sigma`].
    pub(crate) median_sigma: Option<f32>,
    /// The least standard deviation of the pixel's filter, at a splat and in cloud space, for which it may stand for its
    /// children; at least that of each child. `None` of the cloud's own splats, which always may.
    pub(crate) needs: Option<Column<1>>,
    /// Which needs are for.
    pub(crate) tolerance: f64,
}

/// Consecutive splats of a level, and what lies below them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cluster {
    pub(crate) splats: Range<usize>,
    /// A sphere around the centres of all splats, and of those that they stand for, in cloud space.
    pub(crate) center: Vec3,
    pub(crate) radius: f32,
    /// Of all these splats, at least.
    pub(crate) largest_sigma: f32,
    /// Around the normals of all these splats.
    pub(crate) normals: Cone,
    /// Least and greatest need of the splats, and of their parents. Nothing is above the last level.
    pub(crate) needs: [f32; 2],
    pub(crate) parents_need: [f32; 2],
}

impl Level {
    /// The first level.
    pub(crate) fn of_splats(columns: Columns) -> Self {
        let (clusters, bounds) = clusters(&columns);
        let median_sigma = columns.median_sigma();
        Self { columns, clusters, bounds, median_sigma, needs: None, tolerance: 1.0 }
    }

    /// Needs of the splats 8 · block up to 8 · block + 7.
    #[inline(always)]
    pub(crate) fn needs(&self, block: usize) -> &Lanes {
        match &self.needs {
            Some(needs) => &needs.block(block)[0],
            None => &[0.0; LANES],
        }
    }

    /// Memory of the splats, their clusters and needs.
    pub(crate) fn bytes(&self) -> usize {
        self.columns.bytes() + size_of_val(&self.clusters[..]) + self.needs.as_ref().map_or(0, Column::bytes)
    }

    fn need(&self, index: usize) -> f32 {
        self.needs.as_ref().map_or(0.0, |needs| needs.row(index)[0])
    }
}

/// The factor by which filters count as larger at another tolerance than that which the needs of levels are for: what fades of errors fades
/// with 1/σ at least, and much of it with 1/σ³.
pub(crate) fn allowance(levels: &[Level], tolerance: f64) -> f64 {
    let ratio = levels.last().map_or(1.0, |level| tolerance / level.tolerance);
    if ratio > 1.0 { ratio.sqrt() } else { ratio }
}

/// Puts levels for a tolerance on a cloud's own splats, the last of which is a single cluster.
pub(crate) fn with_coarser(mut levels: Vec<Level>, tolerance: f64) -> Vec<Level> {
    if let [own] = &mut levels[..]
        && own.columns.len > CLUSTER_SIZE
    {
        make_compact(&mut own.columns);
        (own.clusters, own.bounds) = clusters(&own.columns);
    }
    while let Some(below) = levels.last().filter(|level| level.columns.len > CLUSTER_SIZE) {
        let above = coarser(below, tolerance);
        let below = levels.len() - 1;
        let (below, mut above) = (&mut levels[below], above);
        for (number, cluster) in below.clusters.iter_mut().enumerate() {
            let parents = cluster.splats.start / CHILDREN..cluster.splats.end.div_ceil(CHILDREN);
            cluster.parents_need = range_of(parents.map(|parent| above.need(parent)));
            let parent = &mut above.clusters[number / CHILDREN];
            // The sphere around both.
            let apart = parent.center.distance(cluster.center);
            if apart + cluster.radius > parent.radius {
                let radius = (0.5 * (parent.radius + cluster.radius + apart)).max(cluster.radius);
                if apart > 0.0 {
                    let along = ((radius - parent.radius) / apart).min(1.0);
                    parent.center = parent.center.lerp(cluster.center, along);
                }
                // Rounding must not leave anything outside.
                parent.radius = radius * (1.0 + 1e-5);
            }
            parent.largest_sigma = parent.largest_sigma.max(cluster.largest_sigma);
            parent.normals = parent.normals.and(&cluster.normals);
        }
        levels.push(above);
    }
    levels
}

fn range_of(values: impl Iterator<Item = f32>) -> [f32; 2] {
    values.fold([f32::INFINITY, 0.0], |[least, most], value| [least.min(value), most.max(value)])
}

/// Cuts a level into clusters of consecutive splats; gives the corners of the box around all centres, too.
fn clusters(columns: &Columns) -> (Vec<Cluster>, Option<[Vec3; 2]>) {
    let cluster = |number: usize| {
        let start = number * CLUSTER_SIZE;
        let splats = start..columns.len.min(start + CLUSTER_SIZE);
        let ([low, high], [radius, largest_sigma]) =
            dispatch!(simd::Level::best(), simd => extent(simd, columns, &splats));
        let center = low * 0.5 + high * 0.5;
        let normals = Cone::of(columns, &splats);
        let parents_need = [f32::INFINITY; 2];
        let cluster =
            Cluster { splats, center, radius, largest_sigma, normals, needs: [0.0; 2], parents_need };
        (cluster, [low, high])
    };
    let (clusters, boxes): (Vec<_>, Vec<_>) =
        (0..columns.len.div_ceil(CLUSTER_SIZE)).into_par_iter().map(cluster).unzip();
    (clusters, boxes.into_iter().reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]))
}

/// The corners of the box around the centres of splats, the first of which begins a block; the radius of a sphere around them with the
/// same middle, and their largest σ in any direction, at least.
#[inline(always)]
fn extent<S: Simd>(simd: S, columns: &Columns, splats: &Range<usize>) -> ([Vec3; 2], [f32; 2]) {
    // The last block is filled up with its last splat.
    let blocks = splats.start / LANES..splats.end.div_ceil(LANES);
    let (mut low, mut high) = (splat3(simd, [f32::INFINITY; 3]), splat3(simd, [f32::NEG_INFINITY; 3]));
    let mut largest_variance = splat(simd, 0.0);
    for block in blocks.clone() {
        for (axis, row) in centers(simd, columns, block).into_iter().enumerate() {
            (low[axis], high[axis]) = (row.min(low[axis]), row.max(high[axis]));
        }
        largest_variance = traces(simd, columns, block).max(largest_variance);
    }
    let low = low.each(
        #[inline(always)]
        |row| row.reduce_min(),
    );
    let high = high.each(
        #[inline(always)]
        |row| row.reduce_max(),
    );
    let middle = [0, 1, 2].each(
        #[inline(always)]
        |axis| low[axis] * 0.5 + high[axis] * 0.5,
    );
    let from: V3<S> = splat3(simd, middle);
    let mut farthest = splat(simd, 0.0);
    for block in blocks {
        let center = centers(simd, columns, block);
        let apart: V3<S> = [0, 1, 2].each(
            #[inline(always)]
            |axis| center[axis] - from[axis],
        );
        farthest = dot(apart, apart).max(farthest);
    }
    // More than what roundings of nine squares, their sum and its root come to, and than squares that vanish.
    let [radius, sigma] = [farthest, largest_variance].each(
        #[inline(always)]
        |squared| squared.reduce_max().sqrt() * (1.0 + 1e-6) + 1e-18,
    );
    ([low, high].map(Vec3::from), [radius, sigma])
}

/// The centres of splats 8 · block up to 8 · block + 7.
#[inline(always)]
fn centers<S: Simd>(simd: S, columns: &Columns, block: usize) -> V3<S> {
    columns.centers.block(block).each(
        #[inline(always)]
        |row| V::simd_from(simd, row),
    )
}

/// The traces of their covariances.
#[inline(always)]
fn traces<S: Simd>(simd: S, columns: &Columns, block: usize) -> V<S> {
    match &columns.factors {
        Factors::Shared(factor) => splat(simd, frobenius_squared(factor.as_dmat3()) as f32),
        Factors::Each { flat, through } => {
            let mut sum = splat(simd, 0.0);
            for row in flat.block(block).iter().chain(through.block(block)) {
                let row = V::simd_from(simd, *row);
                sum = row.mul_add(row, sum);
            }
            sum
        }
    }
}

#[cfg(test)]
mod tests;
