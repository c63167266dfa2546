//! The surface as a dense set of points that each stand for an equal share of their triangle.
//!
//! A triangle is halved across its longest edge, in proportion, until every leaf stands for one point.
//! So slivers are cut across and no area is lost, however large or small the triangles are.

use crate::facets::{Facet, Facets};
use crate::grid::Grid;
use glam::Vec3;
use rayon::prelude::*;

/// Points for each surfel, at least: enough that the points a cell owns measure its area.
const POINTS_PER_SURFEL: f32 = 8.0;

/// No leaf of a sliver is longer than about this, in spacings.
const LONGEST_LEAF: f32 = 0.5;

/// Facets that one task turns to points.
const FACETS_PER_TASK: usize = 1024;

/// The points, sorted by grid cell.
pub(crate) struct Points {
    /// In spacings.
    pub(crate) positions: Vec<Vec3>,
    /// The facet of each.
    pub(crate) facets: Vec<u32>,
    /// The cells they lie in.
    pub(crate) grid: Grid,
    /// For each facet its outward normal and the area of one of its points, in squared spacings.
    pub(crate) of_facet: Vec<(Vec3, f32)>,
}

impl Points {
    /// How many points a facet becomes.
    pub(crate) fn count(facets: &Facets, facet: &Facet) -> usize {
        let [a, b, c] = facets.corners(facet);
        let longest = (b - a).length().max((c - b).length()).max((a - c).length());
        let count = (facet.area * POINTS_PER_SURFEL).max(longest / LONGEST_LEAF);
        (count.ceil() as usize).max(1)
    }

    /// Spreads points over the facets; `counts` holds [`Self::count`] for each, below 2³² in sum.
    pub(crate) fn new(facets: &Facets, counts: &[usize]) -> Self {
        let total: usize = counts.iter().sum();
        let mut positions = vec![Vec3::ZERO; total];
        let mut owners = vec![0_u32; total];
        let mut tasks = Vec::new();
        let (mut points, mut ids) = (&mut positions[..], &mut owners[..]);
        for (task, counts) in counts.chunks(FACETS_PER_TASK).enumerate() {
            let here = counts.iter().sum();
            let (mine, rest) = std::mem::take(&mut points).split_at_mut(here);
            let (my_ids, rest_ids) = std::mem::take(&mut ids).split_at_mut(here);
            tasks.push((task * FACETS_PER_TASK, counts, mine, my_ids));
            (points, ids) = (rest, rest_ids);
        }
        tasks.into_par_iter().for_each(|(facet, counts, mut points, mut ids)| {
            for (offset, &count) in counts.iter().enumerate() {
                let (mine, rest) = std::mem::take(&mut points).split_at_mut(count);
                let (my_ids, rest_ids) = std::mem::take(&mut ids).split_at_mut(count);
                subdivide(facets.corners(&facets.facets[facet + offset]), mine);
                my_ids.fill((facet + offset) as u32);
                (points, ids) = (rest, rest_ids);
            }
        });

        let (grid, order) = Grid::new(&positions);
        let of_facet = |(facet, &count): (&Facet, &usize)| (facet.normal, facet.area / count as f32);
        Self {
            positions: order.par_iter().map(|&i| positions[i as usize]).collect(),
            facets: order.par_iter().map(|&i| owners[i as usize]).collect(),
            grid,
            of_facet: facets.facets.par_iter().zip(counts).map(of_facet).collect(),
        }
    }

    /// The outward normal at a point and the area that it stands for.
    pub(crate) fn normal_and_area(&self, point: usize) -> (Vec3, f32) {
        self.of_facet[self.facets[point] as usize]
    }
}

/// Puts a point into the middle of each of `points.len()` parts of a triangle, all of one area.
fn subdivide([a, b, c]: [Vec3; 3], points: &mut [Vec3]) {
    let count = points.len();
    if let [point] = points {
        *point = (a + b + c) / 3.0;
        return;
    }
    let (ab, bc, ca) = ((b - a).length_squared(), (c - b).length_squared(), (a - c).length_squared());
    let [a, b, c] = if ab >= bc && ab >= ca {
        [a, b, c]
    } else if bc >= ca {
        [b, c, a]
    } else {
        [c, a, b]
    };
    let half = count / 2;
    let middle = a.lerp(b, half as f32 / count as f32);
    let (left, right) = points.split_at_mut(half);
    let mut halves = [([a, middle, c], left), ([middle, b, c], right)];
    if count > 8192 {
        halves.into_par_iter().for_each(|(corners, points)| subdivide(corners, points));
    } else {
        for (corners, points) in &mut halves {
            subdivide(*corners, points);
        }
    }
}
