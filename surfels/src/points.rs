//! The surface as a dense set of points that each stand for a small piece of it.
//!
//! A triangle is halved across its longest edge, in proportion, until every piece has one point: pieces of
//! one triangle have one area, and are as round as the triangle. Slivers are first cut across until they
//! aren't any. So no area is lost, however large or small the triangles are.

use crate::facets::{Facet, Facets};
use crate::grid::Grid;
use glam::Vec3;
use rayon::prelude::*;

/// Points for each surfel, at least: enough that what a sample owns measures its area.
const POINTS_PER_SURFEL: f32 = 8.0;

/// The longest edge of a piece, in spacings: neighbouring pieces leave no gap that a sample misses.
const LONGEST_EDGE: f32 = 0.5;

/// Facets that one task turns to points.
const FACETS_PER_TASK: usize = 1024;

/// Points that a task halves no further.
const POINTS_PER_TASK: usize = 8192;

/// The points, sorted by grid cell.
pub(crate) struct Points {
    /// In spacings.
    pub(crate) positions: Vec<Vec3>,
    /// What each stands for, in squared spacings.
    pub(crate) areas: Vec<f32>,
    /// The facet of each.
    pub(crate) facets: Vec<u32>,
    /// The cells they lie in.
    pub(crate) grid: Grid,
    /// Outward unit normals of the facets.
    normals: Vec<Vec3>,
}

/// A point before it is sorted: position, area, facet.
type Point = (Vec3, f32, u32);

impl Points {
    /// How many points a facet becomes.
    pub(crate) fn count(facets: &Facets, facet: &Facet) -> usize {
        let mut count = 0;
        cut(facets.corners(facet), facet.area, &mut |_, _, points| count += points);
        count
    }

    /// Spreads points over the facets; `counts` holds [`Self::count`] for each, below 2³² in sum.
    pub(crate) fn new(facets: &Facets, counts: &[usize]) -> Self {
        let mut points: Vec<Point> = vec![Default::default(); counts.iter().sum()];
        let mut tasks = Vec::new();
        let mut rest = &mut points[..];
        for (task, counts) in counts.chunks(FACETS_PER_TASK).enumerate() {
            let (here, others) = rest.split_at_mut(counts.iter().sum());
            tasks.push((task * FACETS_PER_TASK, counts.len(), here));
            rest = others;
        }
        tasks.into_par_iter().for_each(|(first, count, mut rest)| {
            for (index, facet) in facets.facets.iter().enumerate().skip(first).take(count) {
                cut(facets.corners(facet), facet.area, &mut |corners, area, count| {
                    let (here, others) = std::mem::take(&mut rest).split_at_mut(count);
                    halve(corners, (area / count as f32, index as u32), here);
                    rest = others;
                });
            }
        });

        let (grid, order) = Grid::new(points.par_iter().map(|point| point.0));
        let in_order = || order.par_iter().map(|&i| points[i as usize]);
        Self {
            positions: in_order().map(|point| point.0).collect(),
            areas: in_order().map(|point| point.1).collect(),
            facets: in_order().map(|point| point.2).collect(),
            grid,
            normals: facets.facets.par_iter().map(|facet| facet.normal).collect(),
        }
    }

    /// The outward unit normal at a point.
    pub(crate) fn normal(&self, point: usize) -> Vec3 {
        self.normals[self.facets[point] as usize]
    }
}

/// Cuts a sliver across until its pieces aren't any, and visits each: corners, area, number of points.
fn cut(corners: [Vec3; 3], area: f32, visit: &mut impl FnMut([Vec3; 3], f32, usize)) {
    let by_area = (area * POINTS_PER_SURFEL).ceil().max(1.0);
    let [a, b, c] = longest_first(corners);
    let edge = (b - a).length();
    if edge <= LONGEST_EDGE * by_area {
        return visit(corners, area, by_area as usize);
    }
    let middle = a.midpoint(b);
    cut([a, middle, c], area / 2.0, visit);
    cut([middle, b, c], area / 2.0, visit);
}

/// Puts a point into the middle of each of `points.len()` parts of a triangle, all of one area.
fn halve(corners: [Vec3; 3], (area, facet): (f32, u32), points: &mut [Point]) {
    let [a, b, c] = corners;
    if let [point] = points {
        *point = ((a + b + c) / 3.0, area, facet);
        return;
    }
    let count = points.len();
    let half = count / 2;
    let [a, b, c] = longest_first(corners);
    let middle = a.lerp(b, half as f32 / count as f32);
    let (left, right) = points.split_at_mut(half);
    let mut left = || halve([a, middle, c], (area, facet), left);
    let mut right = || halve([middle, b, c], (area, facet), right);
    if count > POINTS_PER_TASK {
        rayon::join(left, right);
    } else {
        left();
        right();
    }
}

/// The same corners in the same sense of rotation, with the longest edge between the first two.
fn longest_first([a, b, c]: [Vec3; 3]) -> [Vec3; 3] {
    let (ab, bc, ca) = (a.distance_squared(b), b.distance_squared(c), c.distance_squared(a));
    if ab >= bc && ab >= ca {
        [a, b, c]
    } else if bc >= ca {
        [b, c, a]
    } else {
        [c, a, b]
    }
}
