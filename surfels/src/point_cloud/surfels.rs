//! From points to a cloud of surfels.

use super::color::colors;
use super::lines::{Lines, lines};
use super::tangent::{Polygon, Spread, cell_area, spread};
use super::{PointCloud, PointError, PointSettings};
use glam::{DAffine3, DVec3, Mat3, Vec3};
use oblate_engine::cloud::{Shapes, Splats, Strength, Surface, oblate_factor};
use oblate_engine::neighbors::{Found, Leaf, Tree};
use oblate_engine::{Closed, Cloud};
use rayon::prelude::*;
use std::f32::consts::PI;

/// The radius of a surfel (σ of its Gaussian), as a share of the spacing about it.
///
/// Σw with 0.7, 0.8, 0.9 and 1 on a plane of points up to half a spacing from where a grid has them is from 0.65 to 1.22,
/// from 0.73 to 1.18, from 0.78 to 1.16 and from 0.82 to 1.14; it falls below 0.46, 0.54, 0.61 and 0.66 for a hundredth of
/// a plane of wholly random points. So this is the sharpest that keeps clear of the floor where points are spread at all
/// evenly.
const RADIUS: f32 = 0.8;

/// The floor w₀ of the summed coverage that [`point_surfels`] keeps three radii away from borders where no point is farther
/// than half a spacing from where an even grid would have it.
pub const POINT_COVERAGE_FLOOR: f32 = 0.5;

/// How much farther than that of its neighbours a point's reach may be: strays don't become large discs.
const FARTHEST: f32 = 1.5;

/// How much farther than the cloud's median a reach may be where the neighbours fill space: strays among strays don't become large
/// discs. Where a surface is seen from afar points are as far apart, but about a plane.
const STRAY: f32 = 4.0;

/// The least distance that single-precision positions resolve, as a share of the largest coordinate.
const RESOLUTION: f32 = 1e-7;

/// The largest scaled radius whose square has room in single precision, far beyond all points.
const WIDEST: f64 = 1e15;

/// Makes each point a surfel; those of exactly one place together are one, with the mean of their colours.
///
/// The cloud's space is that of the positions; `cloud_to_world` adds the origin. Surfels are flat discs, in no order that
/// has a meaning:
/// - the normal is the point's where it has one; else that of the plane that fits the point and its nearest neighbours best
///   (Hoppe, DeRose, Duchamp, McDonald, Stuetzle, *Surface reconstruction from unorganized points*, 1992, section 3.1),
///   toward the viewpoint, or [`PointSettings::up`] where there is none;
/// - the area is that of the point's Voronoi cell in that plane, no farther than half as far as the neighbours: on a plane
///   they sum to its area and half a spacing about it, where points stray off it, to more (a third more for 0.3 spacings);
/// - the radius is 0.8 of the spacing that the neighbours tell, or half of the point's own where it has one: that is the
///   standard deviation of a disc. Then the cell reaches as far as the point's radius, and the area is at most the disc's.
///
/// Spacings may differ by any factor, if they do so gradually. Strays do not become large discs: neighbours reach no farther than
/// 1.5 times what they do about them, where those that fill space and reach over 4 times the cloud's median count as that.
///
/// Where all neighbours lie in a line, as of scanners that sweep, up to 8 times as many are looked at for lines beside it.
/// Then the normal is that of the plane the lines are in, the surfel an ellipse, 0.8 of the spacing along the line and of that from
/// line to line, and its cell that of the plane with the lines moved as near as their points. A line of points by itself, as a
/// wire or of a single scan, faces the viewpoint (or up) as much as it can; a lone point has a radius of about a unit.
///
/// All surfels show both sides: which one is outside is a guess where nothing tells. The depth tolerance is two radii, of
/// ellipses the larger ones, in the median, the coverage floor [`POINT_COVERAGE_FLOOR`].
///
/// # Errors
/// When there are no points, arrays differ in length, a number is not finite, the wanted colour is not there, a setting is outside its
/// range, or sizes are beyond single precision.
pub fn point_surfels(points: &PointCloud, settings: &PointSettings) -> Result<Cloud, PointError> {
    points.check()?;
    settings.check()?;
    let colors = colors(points, settings)?;
    let estimator = Estimator::new(points, settings);
    let surfels: Vec<Surfel> = (0..estimator.tree.leaves.len())
        .into_par_iter()
        .map_init(Buffers::default, |buffers, place| estimator.surfel(place, &colors, buffers))
        .collect();

    let mut radii: Vec<f32> = surfels.par_iter().map(|surfel| surfel.radius).collect();
    let middle = radii.len() / 2;
    let median = *radii.select_nth_unstable_by(middle, f32::total_cmp).1;
    let beyond = |surfel: &&Surfel| !(surfel.area.is_finite() && surfel.radius.is_finite());
    if let Some(surfel) = surfels.iter().find(beyond) {
        return Err(PointError::Size(surfel.radius));
    }
    if !(median * median).is_normal() {
        return Err(PointError::Size(median));
    }
    let splats = Splats {
        centers: surfels.par_iter().map(|surfel| surfel.center).collect(),
        shapes: Shapes::Each(surfels.par_iter().map(|surfel| surfel.factor).collect()),
        strength: Strength::Surface(Surface {
            areas: surfels.par_iter().map(|surfel| surfel.area).collect(),
            opacities: None,
            depth_tolerance: 2.0 * median,
            coverage_floor: POINT_COVERAGE_FLOOR,
            closed: Closed::Nowhere,
        }),
        colors: surfels.par_iter().map(|surfel| surfel.color).collect(),
        harmonics: None,
        normals: None,
        material: settings.material,
    };
    Ok(Cloud::new(splats)?.transformed(DAffine3::from_translation(points.origin)))
}

/// A surfel in units of the positions.
struct Surfel {
    center: Vec3,
    factor: Mat3,
    /// The larger one.
    radius: f32,
    area: f32,
    color: [f32; 3],
}

/// Points of which several may be at exactly one place.
struct Places {
    /// Points, those of one place together.
    points: Vec<u32>,
    /// Where those of each place begin.
    starts: Vec<u32>,
}

impl Places {
    fn new(positions: &[Vec3]) -> Self {
        let bits = |p: &Vec3| (*p + Vec3::ZERO).to_array().map(f32::to_bits); // −0 is 0
        let mut entries: Vec<([u32; 3], u32)> =
            positions.par_iter().enumerate().map(|(i, p)| (bits(p), i as u32)).collect();
        entries.par_sort_unstable();
        let begins = |i: &usize| *i == 0 || entries[*i].0 != entries[*i - 1].0;
        let mut starts: Vec<u32> =
            (0..entries.len()).into_par_iter().filter(begins).map(|i| i as u32).collect();
        starts.push(entries.len() as u32);
        Self { points: entries.par_iter().map(|entry| entry.1).collect(), starts }
    }

    /// The points of a place, in ascending order.
    fn points(&self, place: usize) -> &[u32] {
        &self.points[self.starts[place] as usize..self.starts[place + 1] as usize]
    }
}

/// What estimates take memory for, used again.
#[derive(Default)]
struct Buffers {
    polygon: Polygon,
    found: Found,
}

/// What surfels are estimated from.
struct Estimator<'a> {
    points: &'a PointCloud,
    places: Places,
    /// Lengths are multiplied by it, a power of two, so that squares neither overflow nor vanish.
    scale: f64,
    /// Of the places, scaled.
    tree: Tree,
    /// How many neighbours each has.
    count: usize,
    /// Which, from near to far, by places in the tree's order.
    neighbors: Vec<u32>,
    /// The scaled distance of the farthest neighbour of each; without any, a unit.
    reaches: Vec<f32>,
    /// The median of the reaches.
    usual: f32,
    /// How the neighbours of each spread.
    spreads: Vec<Spread>,
    up: Vec3,
}

impl<'a> Estimator<'a> {
    fn new(points: &'a PointCloud, settings: &PointSettings) -> Self {
        let positions = &points.positions;
        let places = Places::new(positions);
        let largest = positions.par_iter().map(|p| p.abs().max_element()).reduce(|| 0.0, f32::max);
        let exponent = f64::from(largest).to_bits() & f64::INFINITY.to_bits();
        let scale = if largest > 0.0 { 1.0 / f64::from_bits(exponent) } else { 1.0 };
        let leaf = |place: usize| {
            let position = positions[places.points(place)[0] as usize];
            Leaf { position: (position.as_dvec3() * scale).as_vec3(), number: place as u32 }
        };
        let distinct = places.starts.len() - 1;
        let tree = Tree::new((0..distinct).into_par_iter().map(leaf).collect());
        let count = settings.neighbors.min(distinct - 1);
        let mut neighbors = vec![0; count * distinct];
        let mut reaches = vec![scale as f32; distinct];
        let mut spreads = vec![Spread::Point; distinct];
        if count > 0 {
            let tasks = neighbors.par_chunks_mut(count).zip(&mut reaches).zip(&mut spreads).enumerate();
            tasks.for_each_init(Found::new, |found, (place, ((neighbors, reach), directions))| {
                tree.nearest(place, count, found);
                for (neighbor, &(squared, other)) in neighbors.iter_mut().zip(&*found) {
                    *neighbor = other;
                    *reach = squared.sqrt().max(RESOLUTION);
                }
                *directions = spread(&offsets(&tree, place, found.iter().map(|found| found.1)));
            });
        }
        let mut sorted = reaches.clone();
        let usual = *sorted.select_nth_unstable_by(distinct / 2, f32::total_cmp).1;
        let up = settings.up.normalize();
        Self { points, places, scale, tree, count, neighbors, reaches, usual, spreads, up }
    }

    fn neighbors(&self, place: usize) -> &[u32] {
        &self.neighbors[self.count * place..self.count * (place + 1)]
    }

    /// The surfel of a place, by the tree's order.
    fn surfel(&self, place: usize, colors: &[[f32; 3]], buffers: &mut Buffers) -> Surfel {
        let points = self.places.points(self.tree.leaves[place].number as usize);
        let center = self.points.positions[points[0] as usize];
        let color = points.iter().map(|&point| Vec3::from(colors[point as usize]).as_dvec3()).sum::<DVec3>();
        let color = (color / points.len() as f64).as_vec3().to_array();
        let Buffers { polygon, found } = buffers;
        let lines = match self.spreads[place] {
            Spread::Line(along) => lines((&self.tree, &self.spreads), (place, along), self.count, found),
            _ => None,
        };
        let normal = self.normal(points, lines.as_ref().map_or(self.spreads[place], Lines::spread));
        let given = self.given_radius(points);
        let (factor, radius, area) = match (lines, given) {
            (Some(lines), None) => self.ellipse((place, normal), &lines, polygon),
            (lines, given) => self.disc((place, normal), (lines, given), polygon),
        };
        let area = f64::from(area) / self.scale / self.scale;
        let area = given.map_or(area, |given| area.min(std::f64::consts::PI * given * given));
        Surfel { center, factor, radius, area: area as f32, color }
    }

    /// The factor, the radius and the scaled area of the cell, where points are about as far apart in all directions.
    fn disc(
        &self,
        (place, normal): (usize, Vec3),
        (lines, given): (Option<Lines>, Option<f64>),
        polygon: &mut Polygon,
    ) -> (Mat3, f32, f32) {
        let own = || offsets(&self.tree, place, self.neighbors(place).iter().copied());
        let neighbors = lines.map_or_else(own, |lines| lines.neighbors);
        let reach = self.reach(place);
        // Of k points in a disc of that radius; of fewer than 4, all are at the border of what there is.
        let spacing = reach * (PI / self.count.max(4) as f32).sqrt();
        let estimated = f64::from(RADIUS * spacing) / self.scale;
        let radius = given.map_or(estimated, |given| given / 2.0) as f32;
        let bound = given.map_or(0.0, |given| (given * self.scale).min(WIDEST) as f32).max(reach / 2.0);
        let area = cell_area(normal, bound, &neighbors, polygon);
        (oblate_factor(normal, radius, f32::INFINITY), radius, area)
    }

    /// The same where points are in lines.
    fn ellipse(
        &self,
        (place, normal): (usize, Vec3),
        lines: &Lines,
        polygon: &mut Polygon,
    ) -> (Mat3, f32, f32) {
        let [along, across] = lines.spacings(self.reach(place), self.count);
        let (squeezed, axis) = lines.squeezed(normal, across / along);
        let bound = along * (self.count as f32 / PI).sqrt() / 2.0;
        let area = cell_area(normal, bound, &squeezed, polygon) * across / along;
        let [a, b] = [along, across].map(|spacing| (f64::from(RADIUS * spacing) / self.scale) as f32);
        (Mat3::from_cols(axis * a, normal.cross(axis) * b, Vec3::ZERO), b, area)
    }

    /// The largest of the radii that points of one place have.
    fn given_radius(&self, points: &[u32]) -> Option<f64> {
        let radii = self.points.radii.as_ref()?;
        let largest = points.iter().map(|&point| radii[point as usize]).fold(0.0, f32::max);
        (largest > 0.0).then_some(f64::from(largest))
    }

    /// The unit normal, toward the side that is known or guessed to be outside.
    fn normal(&self, points: &[u32], spread: Spread) -> Vec3 {
        let given = self.points.normals.as_ref().map_or(Vec3::ZERO, |normals| {
            points.iter().map(|&point| normals[point as usize].normalize_or_zero()).sum()
        });
        if let Some(given) = given.try_normalize() {
            return given;
        }
        let center = self.points.positions[points[0] as usize].as_dvec3() + self.points.origin;
        let toward =
            self.points.viewpoint.map(|viewpoint| (viewpoint - center).normalize_or_zero().as_vec3());
        let toward = toward.filter(|toward| *toward != Vec3::ZERO).unwrap_or(self.up);
        let normal = match spread {
            Spread::Plane(normal) | Spread::Space(normal) => normal,
            Spread::Line(along) => {
                toward.reject_from_normalized(along).try_normalize().unwrap_or(along.any_orthonormal_vector())
            }
            Spread::Point => toward,
        };
        if normal.dot(toward) < 0.0 { -normal } else { normal }
    }

    /// How far the neighbours are that tell a point's extent.
    fn reach(&self, place: usize) -> f32 {
        let neighbors = self.neighbors(place);
        if neighbors.is_empty() {
            return self.reaches[place];
        }
        let told = |&other: &u32| {
            let reach = self.reaches[other as usize];
            let is_astray =
                matches!(self.spreads[other as usize], Spread::Space(_)) && reach > STRAY * self.usual;
            if is_astray { self.usual } else { reach }
        };
        let mut reaches: Vec<f32> = neighbors.iter().map(told).collect();
        let middle = reaches.len() / 2;
        let median = *reaches.select_nth_unstable_by(middle, f32::total_cmp).1;
        self.reaches[place].min(FARTHEST * median)
    }
}

/// From a place of the tree to others.
pub(crate) fn offsets(tree: &Tree, place: usize, others: impl Iterator<Item = u32>) -> Vec<Vec3> {
    let position = tree.leaves[place].position;
    others.map(|other| tree.leaves[other as usize].position - position).collect()
}
