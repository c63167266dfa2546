//! Points of scanners that sweep: dense along lines, sparse from line to line.

use super::surfels::offsets;
use super::tangent::{Spread, spread};
use glam::Vec3;
use oblate_engine::neighbors::{Found, Tree};
use std::f32::consts::PI;

/// How often the number of neighbours is doubled to find the lines beside: those up to some 30 spacings away.
const DOUBLINGS: u32 = 3;

/// Lines farther apart than so many spacings of their points are debris, of which ellipses would be needles.
const FARTHEST_LINE: f32 = 48.0;

/// The cosine of how far lines beside each other turn.
const PARALLEL: f32 = 0.7;

/// The sine of how far from a plane it goes through a point.
const THROUGH: f32 = 0.3;

/// A point whose nearest neighbours lie in a line, about which more lie in lines beside.
pub(crate) struct Lines {
    /// The unit direction of the line.
    along: Vec3,
    /// Of the plane that the lines are in.
    normal: Vec3,
    /// As many as it takes to meet the lines beside, from near to far.
    pub(crate) neighbors: Vec<Vec3>,
}

/// The lines about a place whose `count` nearest neighbours lie `along` one, if others are near, with as many points
/// beside: such that lie in a line, too, or in a plane through the place, which the ground under a wire is not.
pub(crate) fn lines(
    (tree, spreads): (&Tree, &[Spread]),
    (place, along): (usize, Vec3),
    count: usize,
    found: &mut Found,
) -> Option<Lines> {
    let is_fellow = |other: u32, offset: Vec3| match spreads[other as usize] {
        Spread::Line(direction) => direction.dot(along).abs() > PARALLEL,
        Spread::Plane(normal) => offset.dot(normal).abs() < THROUGH * offset.length(),
        Spread::Space(_) | Spread::Point => false,
    };
    // A line that bends stays ahead.
    let is_beside = |offset: &&Vec3| offset.reject_from_normalized(along).length() > offset.dot(along).abs();
    for wanted in (1..=DOUBLINGS).map(|doublings| count << doublings) {
        tree.nearest(place, wanted, found);
        let neighbors = offsets(tree, place, found.iter().map(|found| found.1));
        let with_numbers = found.iter().zip(&neighbors);
        let fellows = with_numbers.filter(|(found, offset)| is_fellow(found.1, **offset));
        let fellows: Vec<Vec3> = fellows.map(|(_, offset)| *offset).collect();
        // Noise along the line itself is about the nearest.
        let nearest = found.get(count - 1)?.0;
        let farther = fellows.iter().filter(|offset| offset.length_squared() > nearest);
        if farther.filter(is_beside).count() >= count
            && let Spread::Plane(normal) = spread(&fellows)
        {
            let lines = Lines { along, normal, neighbors };
            let [own, across] = lines.spacings(nearest.sqrt(), count);
            return (across <= FARTHEST_LINE * own).then_some(lines);
        }
        if found.len() < wanted {
            break;
        }
    }
    None
}

impl Lines {
    pub(crate) fn spread(&self) -> Spread {
        Spread::Plane(self.normal)
    }

    /// From point to point and from line to line, where `count` neighbours along the line are within `reach`.
    pub(crate) fn spacings(&self, reach: f32, count: usize) -> [f32; 2] {
        let along = 2.0 * reach / count as f32;
        let farthest = self.neighbors.last().map_or(0.0, |offset| offset.length_squared());
        // Each point has the area of a disc over the number of points in it.
        let area = PI * farthest / self.neighbors.len() as f32;
        [along, (area / along).max(along)]
    }

    /// The neighbours, nearer by `ratio` to the line, from near to far, and the direction of the line in the plane of this
    /// normal. Points are then about as far apart across as along, and noise about the line does not tilt their cells.
    pub(crate) fn squeezed(&self, normal: Vec3, ratio: f32) -> (Vec<Vec3>, Vec3) {
        let axis = self.along.reject_from_normalized(normal).try_normalize();
        let axis = axis.unwrap_or_else(|| normal.any_orthonormal_vector());
        let nearer = |offset: &Vec3| {
            let ahead = axis * offset.dot(axis);
            ahead + (*offset - ahead) / ratio
        };
        let mut squeezed: Vec<Vec3> = self.neighbors.iter().map(nearer).collect();
        squeezed.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        (squeezed, axis)
    }
}
