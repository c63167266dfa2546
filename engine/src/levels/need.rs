//! From which pixel filter on a splat may stand for a family.

use super::family::{Family, eigenvalues, frobenius_squared, outer};
use crate::cloud::{Material, OpacityFilter};
use crate::columns::{CHILDREN, Columns, Kind};
use glam::{DMat3, DVec3};

/// What makes pictures of a family and of the splat that stands for it differ, by powers of the filter's σ.
#[derive(Debug)]
pub(super) struct Terms {
    own: f64,
    lateral: f64,
    depth: f64,
    coherent: [f64; 3],
    random: [f64; 5],
    factor: f64,
}

fn k(i: usize) -> f64 {
    const K: [f64; 11] = [0.3, 1.2, 0.71, 0.23, 0.107, 0.1, 0.17, 0.0, 3.3, 0.25, 0.0];
    K[i]
}

impl Terms {
    pub(super) fn new(
        columns: &Columns,
        family: &Family,
        (first, normals, strength): (usize, [DVec3; CHILDREN], f64),
    ) -> Self {
        let covariance = family.covariance();
        let is_surface = matches!(columns.kind, Kind::Surface(_));
        let [_, middle, least] = eigenvalues(family.within);
        let own = if is_surface { middle } else { least };
        let trace = |m: DMat3| m.x_axis.x + m.y_axis.y + m.z_axis.z;
        let lateral = trace(covariance) / if is_surface { 2.0 } else { 3.0 };
        let color = family.mean(|m| m.color);
        let normal: DVec3 = family.members().iter().zip(normals).map(|(m, n)| m.share * n).sum();
        let Material { emission, ambient, diffuse, specular, exponent } = columns.material;
        let lit = f64::from(emission + ambient + diffuse);
        let gloss = f64::from(specular) * f64::from(exponent).sqrt();
        let mut dipole = [DVec3::ZERO; 3];
        let mut turning = DMat3::ZERO;
        let mut spread = 0.0;
        let mut color_spread = DVec3::ZERO;
        let mut third = [0.0; 10];
        let mut widths = 0.0;
        for (m, n) in family.members().iter().zip(normals) {
            let away = m.center - family.center;
            let differs = m.color - color;
            for axis in 0..3 {
                dipole[axis] += m.share * lit * differs[axis] * away;
            }
            color_spread += m.share * differs * differs;
            turning += m.share * outer(n - normal, away);
            spread += m.share * (n - normal).length_squared();
            let wider = m.covariance - family.within;
            widths += m.share * frobenius_squared(wider);
            for (sum, [i, j, k]) in third.iter_mut().zip(TRIPLES) {
                let [x, y, z] = [away[i], away[j], away[k]];
                *sum +=
                    m.share * (x * y * z + x * wider.col(j)[k] + y * wider.col(i)[k] + z * wider.col(i)[j]);
            }
        }
        let dipole = dipole.iter().map(|d| d.length_squared()).fold(0.0, f64::max);
        let brightest = color.max_element();
        let radiance = (lit * brightest).max(1.0);
        let turning = frobenius_squared(turning).sqrt() * (f64::from(diffuse) * brightest + gloss) * k(1);
        let third: f64 = third.iter().zip(TRIPLES).map(|(t, triple)| times(triple) * t * t).sum();
        let fourth = 2.0 * frobenius_squared(family.between) + 3.0 * widths;
        let shading = k(7) * spread * (f64::from(diffuse) * brightest + gloss);
        let depth = match columns.kind {
            Kind::Extinction => strength / std::f64::consts::TAU,
            Kind::Opacity(_) => strength * lateral,
            Kind::Surface(_) => strength / std::f64::consts::TAU,
        };
        let bend = if is_surface {
            let lost = (1.0 - strength / family.weight.max(1e-300)).max(0.0);
            let distance = 2.0 * trace(family.between).sqrt();
            k(6) * distance * lost.sqrt()
        } else {
            0.0
        };
        let order = if is_surface { 0.0 } else { k(5) * color_spread.max_element().sqrt() * lit };
        let overlap = if matches!(columns.kind, Kind::Opacity(_)) { 0.5 } else { 0.0 };
        let _ = first;
        Self {
            own,
            lateral,
            depth,
            coherent: [overlap * k(10), bend, 0.0],
            random: [
                shading,
                k(2) * dipole.sqrt() + k(2) * turning,
                order,
                k(3) * third.sqrt() * radiance,
                k(4) * fourth * radiance,
            ],
            factor: if matches!(columns.kind, Kind::Opacity(OpacityFilter::Classic)) { 1e3 } else { 1.0 },
        }
    }

    fn error(&self, filter: f64) -> f64 {
        let h2 = filter * filter;
        let variance = self.own + h2;
        let sigma = variance.sqrt();
        let depth = self.depth / (self.lateral + h2);
        let [a0, a1, order, a3, a4] = self.random;
        let random = a0 + (a1 + (a3 + a4 / sigma) / variance) / sigma + order * depth;
        k(8) * random * (0.5 * depth).min(1.0).sqrt()
            + self.coherent[0] * depth * depth.min(1.0)
            + self.coherent[1] / sigma
    }

    pub(super) fn need(&self) -> f32 {
        let target = k(9) / 255.0;
        if self.error(0.0) <= target {
            return 0.0;
        }
        let mut high = self.lateral.sqrt().max(1e-30);
        while self.error(high) > target && high < 1e38 {
            high *= 2.0;
        }
        let mut low = 0.5 * high;
        while self.error(low) <= target {
            high = low;
            low *= 0.5;
        }
        for _ in 0..6 {
            let middle = (low * high).sqrt();
            if self.error(middle) > target { low = middle } else { high = middle }
        }
        (high * self.factor * k(0)).min(f64::from(f32::MAX)) as f32
    }
}

/// The distinct components of a symmetric tensor of the third order.
const TRIPLES: [[usize; 3]; 10] = [
    [0, 0, 0],
    [1, 1, 1],
    [2, 2, 2],
    [0, 0, 1],
    [0, 0, 2],
    [1, 1, 0],
    [1, 1, 2],
    [2, 2, 0],
    [2, 2, 1],
    [0, 1, 2],
];

/// How often a component occurs.
fn times([i, j, k]: [usize; 3]) -> f64 {
    if i == k && i == j {
        1.0
    } else if i == j || j == k || i == k {
        3.0
    } else {
        6.0
    }
}
