//! The summed coverage of a cloud of surfels by brute force, sharing nothing with the sampler or the engine.

#![allow(dead_code, unreachable_pub, reason = "each test is a crate and uses its part")]

use glam::{DAffine3, DVec3};
use oblate_engine::Cloud;
use oblate_engine::cloud::{Strength, Surface};
use oblate_surfels::{Mesh, Primitive};
use std::collections::HashMap;

/// One primitive as a mesh, moved by a transform.
pub fn mesh_of(primitive: Primitive, transform: DAffine3) -> Mesh {
    Mesh { primitives: vec![Primitive { primitive_to_mesh: transform, ..primitive }] }
}

pub fn surface(cloud: &Cloud) -> Surface {
    match cloud.splats().strength {
        Strength::Surface(surface) => surface,
        other => panic!("not a surface: {other:?}"),
    }
}

pub fn total_area(cloud: &Cloud) -> f64 {
    surface(cloud).areas.iter().map(|&area| f64::from(area)).sum()
}

/// Surfel centres in the world.
pub fn centers(cloud: &Cloud) -> Vec<DVec3> {
    let place = |p: &glam::Vec3| cloud.cloud_to_world().transform_point3(p.as_dvec3());
    cloud.splats().centers.iter().map(place).collect()
}

/// e₁ × e₂ of each surfel's factor, normalised.
pub fn outward(cloud: &Cloud) -> Vec<DVec3> {
    let normal = |i| {
        let factor = cloud.factor(i);
        factor.x_axis.as_dvec3().cross(factor.y_axis.as_dvec3()).normalize()
    };
    (0..cloud.len()).map(normal).collect()
}

/// Finds surfels near a place.
pub struct Finder<'a> {
    cloud: &'a Cloud,
    pub centers: Vec<DVec3>,
    pub normals: Vec<DVec3>,
    cells: HashMap<[i64; 3], Vec<usize>>,
    reach: f64,
}

impl<'a> Finder<'a> {
    /// `reach`: how far a kernel is looked for.
    pub fn new(cloud: &'a Cloud, reach: f64) -> Self {
        let centers = centers(cloud);
        let mut cells: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        for (i, center) in centers.iter().enumerate() {
            cells.entry(cell(*center, reach)).or_default().push(i);
        }
        Self { cloud, centers, normals: outward(cloud), cells, reach }
    }

    pub fn near(&self, at: DVec3) -> impl Iterator<Item = usize> + '_ {
        let [x, y, z] = cell(at, self.reach);
        (0..27)
            .map(move |i| [x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1])
            .filter_map(|cell| self.cells.get(&cell))
            .flatten()
            .copied()
            .filter(move |&i| self.centers[i].distance(at) <= self.reach)
    }

    /// Σw of the front faces of one layer, seen along −`normal` at `at` by parallel rays.
    pub fn coverage(&self, at: DVec3, normal: DVec3) -> f64 {
        let surface = surface(self.cloud);
        let thickness = f64::from(surface.depth_tolerance) / 4.0;
        let weight = |i: usize| {
            let facing = self.normals[i].dot(normal);
            if facing < 1e-3 {
                return 0.0;
            }
            // Where the ray meets the surfel's plane, in units of its half-axes.
            let along = (self.centers[i] - at).dot(self.normals[i]) / facing;
            if along.abs() > thickness {
                return 0.0;
            }
            let factor = self.cloud.factor(i);
            let (a, b) = (factor.x_axis.as_dvec3(), factor.y_axis.as_dvec3());
            let n = a.cross(b);
            let d = at + along * normal - self.centers[i];
            let (u, v) = (d.cross(b).dot(n) / n.length_squared(), a.cross(d).dot(n) / n.length_squared());
            let peak = f64::from(surface.areas[i]) / (std::f64::consts::TAU * n.length());
            peak * (-0.5 * (u * u + v * v)).exp()
        };
        self.near(at).map(weight).sum()
    }
}

fn cell(at: DVec3, size: f64) -> [i64; 3] {
    (at / size).floor().to_array().map(|v| v as i64)
}

/// Evenly distributed numbers in [0, 1) without a pattern (Roberts, *The Unreasonable Effectiveness of
/// Quasirandom Sequences*, 2018).
pub fn quasirandom(i: usize) -> [f64; 2] {
    let i = i as f64 + 0.5;
    [(i * 0.754_877_666_246_692_7).fract(), (i * 0.569_840_290_998_053_3).fract()]
}
