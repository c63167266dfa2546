//! Evenly spread samples: a maximal Poisson-disk choice among the points, then Lloyd's relaxation.
//!
//! Distances are measured in position and normal together, |p − q|² + ½ |n − m|² with lengths in spacings
//! (the embedding of Lévy, Bonneel, *Variational Anisotropic Surface Meshing with Voronoi Parallel Linear
//! Enumeration*, 2013). So the two sides of a thin wall or of a crease are apart, without a rule for either.

use crate::grid::Rows;
use crate::points::Points;
use glam::{DVec3, Vec3};
use oblate_engine::simd::{Level, dispatch};
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
    let level = Level::best();
    tasks.into_par_iter().for_each(|(cells, owners)| {
        let first = grid.points(cells.clone()).start;
        let mut near = Near::default();
        grid.sweep(cells, |cell, rows: &Rows| {
            near.clear();
            for row in rows {
                let ids = &sorted[starts[row.start]..starts[row.end]];
                ids.iter().for_each(|&id| near.push(&samples[id as usize], id));
            }
            dispatch!(level, _simd => {
                for point in grid.points(cell..cell + 1) {
                    if let Some(owner) = near.nearest(place(points, point)) {
                        owners[point - first] = owner;
                    }
                }
            });
        });
    });
}

/// Numbers of as many samples as are compared at once.
const LANES: usize = 8;

/// Samples around a cell, each number of eight of them in a row; places behind the last sample are infinitely far.
#[derive(Default)]
struct Near {
    /// Positions and normals.
    blocks: Vec<[[f32; LANES]; 6]>,
    ids: Vec<u32>,
}

impl Near {
    fn clear(&mut self) {
        self.blocks.clear();
        self.ids.clear();
    }

    fn push(&mut self, sample: &Sample, id: u32) {
        let lane = self.ids.len() % LANES;
        if lane == 0 {
            let mut block = [[0.0; LANES]; 6];
            block[0] = [f32::INFINITY; LANES];
            self.blocks.push(block);
        }
        let numbers = [sample.position.to_array(), sample.normal.to_array()];
        if let Some(block) = self.blocks.last_mut() {
            block.iter_mut().zip(numbers.as_flattened()).for_each(|(row, number)| row[lane] = *number);
        }
        self.ids.push(id);
    }

    /// The nearest sample, the first of several. As [`distance2`] says, operation by operation, so that it is the same on every
    /// processor.
    #[inline(always)]
    fn nearest(&self, (position, normal): (Vec3, Vec3)) -> Option<u32> {
        let (mut least, mut nearest) = ([f32::INFINITY; LANES], [u32::MAX; LANES]);
        for (number, [x, y, z, u, v, w]) in self.blocks.iter().enumerate() {
            for lane in 0..LANES {
                let [x, y, z] = [position.x - x[lane], position.y - y[lane], position.z - z[lane]];
                let cosine = normal.x * u[lane] + normal.y * v[lane] + normal.z * w[lane];
                let distance2 = (x * x + y * y + z * z) + (1.0 - cosine);
                let is_nearer = distance2 < least[lane];
                least[lane] = if is_nearer { distance2 } else { least[lane] };
                nearest[lane] = if is_nearer { number as u32 } else { nearest[lane] };
            }
        }
        let place = |lane: usize| (least[lane], nearest[lane] as usize * LANES + lane);
        let found = (0..LANES).filter(|&lane| least[lane] < f32::INFINITY).map(place);
        let first = found.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))?;
        self.ids.get(first.1).copied()
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight at a time give what one after the other does, ties included: places and normals are few, so that many samples are alike.
    #[test]
    fn the_nearest_is_the_first_of_the_nearest() {
        let mut state = 7_u32;
        let mut next = |choices: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) % choices
        };
        for count in (0..40).chain([100]) {
            let mut sample = || {
                let position = Vec3::from([0; 3].map(|_| next(3) as f32 * 0.37));
                let normal = Vec3::from([0; 3].map(|_| next(2) as f32 + 0.5)).normalize();
                Sample { position, normal, anchor: 0 }
            };
            let samples: Vec<Sample> = (0..count).map(|_| sample()).collect();
            let mut near = Near::default();
            samples.iter().zip(100..).for_each(|(sample, id)| near.push(sample, id));
            for _ in 0..20 {
                let Sample { position, normal, .. } = sample();
                let here = (position, normal);
                let distance2 = |i: &usize| distance2(here, (samples[*i].position, samples[*i].normal));
                // The first of equals.
                let expected = (0..count).min_by(|a, b| distance2(a).total_cmp(&distance2(b)));
                for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
                    let found = dispatch!(level, _simd => near.nearest(here));
                    assert_eq!(found, expected.map(|i| i as u32 + 100), "{level:?}, {count} samples");
                }
            }
        }
    }
}
