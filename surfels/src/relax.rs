//! Evenly spread samples: a maximal Poisson-disk choice among the points, then Lloyd's relaxation.
//!
//! Distances are measured in position and normal together, |p − q|² + ½ |n − m|² with lengths in spacings
//! (the embedding of Lévy, Bonneel, *Variational Anisotropic Surface Meshing with Voronoi Parallel Linear
//! Enumeration*, 2013). So the two sides of a thin wall or of a crease are apart, without a rule for either.

use crate::grid::Rows;
use crate::points::Points;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Squared distance in squared spacings at which a plane gets one sample for each squared spacing: balls of
/// half that diameter, dropped at random until none fits, cover 0.547 of it.
const SEPARATION2: f32 = 0.697;

/// How much less of that there is for a choice among points of area 1: 0.883 of the samples fit on points
/// of area 1/8, 0.94 on 1/16, 0.97 on 1/32.
const COARSENESS: f32 = 0.9;

/// Steps of Lloyd's relaxation. On a plane Σw is within 0.920–1.092 after one, 0.916–1.085 after three and
/// 0.916–1.078 after five: what is left comes from how finely points measure areas.
const RELAXATIONS: usize = 1;

/// A surface sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// In spacings.
    pub(crate) position: Vec3,
    /// Outward unit normal: the mean over what it owns.
    pub(crate) normal: Vec3,
    /// The point nearest to it; says which grid cell it is in.
    anchor: u32,
}

/// Samples, each with the points that are nearest to it.
pub(crate) struct Voronoi {
    pub(crate) samples: Vec<Sample>,
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl Voronoi {
    /// The points that a sample owns, in ascending order.
    pub(crate) fn members(&self, sample: usize) -> &[u32] {
        &self.members[self.starts[sample] as usize..self.starts[sample + 1] as usize]
    }
}

/// Relaxes samples that [`scatter`] has chosen.
pub(crate) fn relax(points: &Points, chosen: &[u32]) -> Voronoi {
    let at = |&anchor: &u32| Sample {
        position: points.positions[anchor as usize],
        normal: points.normal(anchor as usize),
        anchor,
    };
    let mut samples: Vec<Sample> = chosen.par_iter().map(at).collect();
    let mut owners = vec![0; points.positions.len()];
    let (mut starts, mut members) = (Vec::new(), Vec::new());
    for _ in 0..=RELAXATIONS {
        assign(points, &samples, &mut owners);
        (starts, members) = group(&owners, samples.len());
        let owned = |i: usize| &members[starts[i] as usize..starts[i + 1] as usize];
        let moved = samples.par_iter().enumerate().map(|(i, &sample)| sample.moved(points, owned(i)));
        samples = moved.collect();
    }
    Voronoi { samples, starts, members }
}

fn distance2((p, n): (Vec3, Vec3), (q, m): (Vec3, Vec3)) -> f32 {
    p.distance_squared(q) + (1.0 - n.dot(m)) // ½ |n − m|² of unit vectors
}

/// Chooses points such that none is nearer than the separation to another and none could be added.
/// Cells of one colour don't see each other: they choose in parallel, the same whatever the threads.
pub(crate) fn scatter(points: &Points) -> Vec<u32> {
    let grid = &points.grid;
    let mut taken = vec![false; points.positions.len()];
    let tasks = grid.tasks();
    for color in 0..8 {
        let choose = |cells: &std::ops::Range<usize>| {
            let mut chosen = Vec::new();
            let mut near = Vec::new();
            let colored = cells.clone().filter(|&cell| grid.color(cell) == color);
            grid.sweep(colored, |cell, rows| {
                near.clear();
                for row in rows {
                    let range = grid.points(row.clone());
                    let start = range.start;
                    let found = taken[range].iter().enumerate().filter(|(_, taken)| **taken);
                    near.extend(found.map(|(i, _)| place(points, start + i)));
                }
                for point in grid.points(cell..cell + 1) {
                    let here = place(points, point);
                    let separation2 = SEPARATION2 * (1.0 - COARSENESS * points.areas[point]);
                    if near.iter().all(|&there| distance2(here, there) >= separation2) {
                        near.push(here);
                        chosen.push(point as u32);
                    }
                }
            });
            chosen
        };
        let chosen: Vec<Vec<u32>> = tasks.par_iter().map(choose).collect();
        for point in chosen.into_iter().flatten() {
            taken[point as usize] = true;
        }
    }
    (0..taken.len() as u32).into_par_iter().filter(|&i| taken[i as usize]).collect()
}

fn place(points: &Points, point: usize) -> (Vec3, Vec3) {
    (points.positions[point], points.normal(point))
}

/// Gives each point to the nearest sample of its cell's neighbourhood; without one there it stays.
fn assign(points: &Points, samples: &[Sample], owners: &mut [u32]) {
    let grid = &points.grid;
    let mut sorted: Vec<u32> = (0..samples.len() as u32).collect();
    sorted.par_sort_unstable_by_key(|&i| (samples[i as usize].anchor, i));
    let mut starts = Vec::with_capacity(grid.len() + 1);
    let mut next = 0;
    for cell in 0..=grid.len() {
        let begin = if cell == grid.len() { usize::MAX } else { grid.points(cell..cell + 1).start };
        while next < sorted.len() && (samples[sorted[next] as usize].anchor as usize) < begin {
            next += 1;
        }
        starts.push(next);
    }

    let mut tasks = Vec::new();
    let mut rest = owners;
    for cells in grid.tasks() {
        let (mine, others) = rest.split_at_mut(grid.points(cells.clone()).len());
        tasks.push((cells, mine));
        rest = others;
    }
    tasks.into_par_iter().for_each(|(cells, owners)| {
        let first = grid.points(cells.clone()).start;
        let mut near: Vec<(Vec3, Vec3, u32)> = Vec::new();
        grid.sweep(cells, |cell, rows: &Rows| {
            near.clear();
            for row in rows {
                let ids = &sorted[starts[row.start]..starts[row.end]];
                near.extend(ids.iter().map(|&id| {
                    let sample = &samples[id as usize];
                    (sample.position, sample.normal, id)
                }));
            }
            for point in grid.points(cell..cell + 1) {
                let here = place(points, point);
                let (mut least, mut owner) = (f32::INFINITY, owners[point - first]);
                for &(position, normal, id) in &near {
                    let distance2 = distance2(here, (position, normal));
                    if distance2 < least {
                        (least, owner) = (distance2, id);
                    }
                }
                owners[point - first] = owner;
            }
        });
    });
}

/// The points of each sample, as one list with the place where each sample's begin.
fn group(owners: &[u32], samples: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0; samples + 1];
    for &owner in owners {
        starts[owner as usize + 1] += 1;
    }
    for i in 0..samples {
        starts[i + 1] += starts[i];
    }
    let mut ends = starts.clone();
    let mut members = vec![0; owners.len()];
    for (point, &owner) in owners.iter().enumerate() {
        let end = &mut ends[owner as usize];
        members[*end as usize] = point as u32;
        *end += 1;
    }
    (starts, members)
}

impl Sample {
    /// At the centroid of the points it owns, brought back to the surface along the normal of the nearest of
    /// them; where it was if it owns nothing.
    fn moved(self, points: &Points, members: &[u32]) -> Self {
        let (mut area, mut position, mut normal) = (0.0, DVec3::ZERO, DVec3::ZERO);
        for &member in members {
            let (there, up) = place(points, member as usize);
            let share = f64::from(points.areas[member as usize]);
            area += share;
            position += share * there.as_dvec3();
            normal += share * up.as_dvec3();
        }
        let centroid = (position / area).as_vec3();
        let distance2 = |point: &u32| points.positions[*point as usize].distance_squared(centroid);
        let nearest = members.iter().copied().min_by(|a, b| distance2(a).total_cmp(&distance2(b)));
        let Some(anchor) = nearest else { return self };
        let (there, up) = place(points, anchor as usize);
        let position = centroid - up * (centroid - there).dot(up);
        Self { position, normal: normal.try_normalize().map_or(up, DVec3::as_vec3), anchor }
    }
}
