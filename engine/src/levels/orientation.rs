//! How the normals of a merged surfel are spread, and what is seen of it.
//!
//! Along a direction cosines of normals are taken to be even between c − w and c + w, c being that of their mean N and w²/3 their
//! variance, uᵀSu. Of those that face a viewer along u, a share h = (c + w)/2w between 0 and 1, the projected area is h²w, and its
//! gradient is the vector area of what is seen:
//!
//! ```text
//! f(u) = h c + h (1 − h) w        ∇f = h N + h (1 − h) ∇w        ∇w = 3 S u/w
//! ```
//!
//! For a cap of normals seen along its axis, and for a sphere, that is exact; other views of caps of any angle are off by 0.012 of their area at
//! most, by 0.024 of both sides together.

use super::CHILDREN;
use super::family::{Family, outer};
use crate::closed::Closed;
use glam::{DMat3, DVec3};

/// The mean of a surfel's normals by their areas, and the mean of what outer products of their deviations are.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Orientation {
    pub(crate) mean: DVec3,
    pub(crate) spread: DMat3,
}

/// What a viewer sees of a merged surfel that has an area of 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Side {
    /// Its vector area, towards the viewer where the front is seen.
    pub(crate) area: DVec3,
    /// The mean normal of what is seen, by projected area, is `kept` of the mean by area, and `shift`.
    pub(crate) kept: f64,
    pub(crate) shift: DVec3,
}

/// Which of the areas a viewer sees count as a merged surfel's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shown {
    /// Those of fronts: nobody sees backs.
    Fronts,
    /// Those of fronts, or those of backs if these are more: of a sheet that folds back, where one lies behind the other.
    OneSide,
    /// All: where normals turn to and fro sides tell nothing.
    Both,
}

impl Shown {
    pub(crate) fn of(closed: &Closed, hides_backs: bool) -> Self {
        if hides_backs {
            Self::Fronts
        } else if closed.has_sides() {
            Self::OneSide
        } else {
            Self::Both
        }
    }
}

/// The least w: where normals are alike, and where they are turned by less than this from a silhouette, nothing is to be told.
pub(crate) const LEAST_WIDTH: f64 = 1e-4;

impl Orientation {
    /// Of one normal.
    pub(super) fn of(normal: DVec3) -> Self {
        Self { mean: normal, spread: DMat3::ZERO }
    }

    /// Of a family whose members have these means: their own, or the opposite ones.
    pub(super) fn of_family(family: &Family, means: [DVec3; CHILDREN]) -> Self {
        let parts = || family.members().iter().zip(means);
        let mean: DVec3 = parts().map(|(m, mean)| m.share * mean).sum();
        let spread = parts().fold(DMat3::ZERO, |sum, (m, own)| {
            sum + m.share * (m.orientation.spread + outer(own - mean, own - mean))
        });
        Self { mean, spread }
    }

    /// N, and of S what lies on and above the diagonal, row by row.
    pub(super) fn numbers(&self) -> [f32; 9] {
        let Self { mean, spread } = self;
        let [x, y, z] = [spread.x_axis, spread.y_axis, spread.z_axis];
        [mean.x, mean.y, mean.z, x.x, y.x, z.x, y.y, z.y, z.z].map(|number| number as f32)
    }

    pub(crate) fn of_numbers(numbers: [f32; 9]) -> Self {
        let [x, y, z, xx, xy, xz, yy, yz, zz] = numbers.map(f64::from);
        let spread = DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz));
        Self { mean: DVec3::new(x, y, z), spread }
    }

    /// The projected area of what a viewer in the unit direction `u` is shown.
    pub(super) fn seen_from(&self, u: DVec3, shown: Shown) -> f64 {
        let (c, w) = (self.mean.dot(u), self.width(u));
        let h = share(c, w);
        let front = h * (c + (1.0 - h) * w);
        match shown {
            Shown::Fronts => front,
            Shown::OneSide => front.max(front - c),
            Shown::Both => 2.0 * front - c,
        }
    }

    fn width(&self, u: DVec3) -> f64 {
        (3.0 * u.dot(self.spread * u)).max(0.0).sqrt().max(LEAST_WIDTH)
    }

    /// What is seen along a unit vector from the eye.
    pub(crate) fn side(&self, seen_along: DVec3, shown: Shown) -> Side {
        let u = -seen_along;
        let (c, w) = (self.mean.dot(u), self.width(u));
        let gradient = self.spread * u * (3.0 / w);
        if shown != Shown::Both {
            // Seen from behind, backs are fronts whose normals are the opposite.
            let sign = if shown == Shown::OneSide && c < 0.0 { -1.0 } else { 1.0 };
            let h = share(sign * c, w);
            let q = (sign * c / w).max(-1.0);
            // E[x⁺x]/E[x⁺] − c over w.
            let moved = if q < 1.0 { (2.0 - q) / 3.0 } else { 1.0 / (3.0 * q) };
            let area = h * self.mean + sign * h * (1.0 - h) * gradient;
            return Side { area, kept: sign, shift: moved * gradient };
        }
        let h = share(c, w);
        let between = h * (1.0 - h);
        let q = (c / w).max(-1.0);
        let area = if q.abs() < 1.0 { 0.5 * w * (1.0 + q * q) } else { c.abs() };
        let front = if h < 0.5 { -1.0 } else { 1.0 };
        Side {
            area: front * ((2.0 * h - 1.0) * self.mean + 2.0 * between * gradient),
            kept: c / area,
            shift: gradient * (w / (3.0 * area)),
        }
    }
}

/// Of normals, how many face the viewer.
fn share(c: f64, w: f64) -> f64 {
    ((c + w) / (2.0 * w)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Even normals within an angle of z, by rings of equal area.
    fn cap(half_angle: f64) -> Vec<DVec3> {
        const RINGS: usize = 60;
        let z = |ring: usize| 1.0 - (ring as f64 + 0.5) / RINGS as f64 * (1.0 - half_angle.cos());
        let on_ring = |ring: usize| {
            (0..RINGS).map(move |i| {
                let (sin, cos) = ((i as f64 + 0.5) / RINGS as f64 * std::f64::consts::TAU).sin_cos();
                let across = (1.0 - z(ring) * z(ring)).sqrt();
                DVec3::new(across * cos, across * sin, z(ring))
            })
        };
        (0..RINGS).flat_map(on_ring).collect()
    }

    fn mean<T: std::iter::Sum<T>>(normals: &[DVec3], value: impl Fn(DVec3) -> T) -> T
    where
        f64: std::ops::Mul<T, Output = T>,
    {
        (1.0 / normals.len() as f64) * normals.iter().map(|n| value(*n)).sum::<T>()
    }

    fn orientation(normals: &[DVec3]) -> Orientation {
        let own: DVec3 = mean(normals, |n| n);
        let spread = normals.iter().fold(DMat3::ZERO, |sum, n| sum + outer(*n - own, *n - own));
        Orientation { mean: own, spread: spread * (1.0 / normals.len() as f64) }
    }

    /// Directions from the axis of a cap to the opposite one.
    fn directions() -> impl Iterator<Item = DVec3> {
        (0..=24).map(|i| {
            let (sin, cos) = (f64::from(i) / 24.0 * std::f64::consts::PI).sin_cos();
            DVec3::new(sin, 0.0, cos)
        })
    }

    #[test]
    fn caps_show_what_they_show() {
        for half_angle in [0.02, 0.2, 0.6, 1.2, 2.0, 2.6, std::f64::consts::PI] {
            let normals = cap(half_angle);
            let whole = orientation(&normals);
            for u in directions() {
                let front: f64 = mean(&normals, |n| n.dot(u).max(0.0));
                let both: f64 = mean(&normals, |n| n.dot(u).abs());
                let one = front.max(both - front);
                let all = [(Shown::Fronts, front), (Shown::OneSide, one), (Shown::Both, both)];
                for (which, shown) in all {
                    let seen = whole.seen_from(u, which);
                    // Cosines of a cap from beside are not even: half a right angle off a cap of 1.2 that is off by 0.012, and so are both sides.
                    let sides = if which == Shown::Both { 2.0 } else { 1.0 };
                    let allowed = 0.0125 * sides * half_angle.min(1.0);
                    assert!((seen - shown).abs() < allowed, "{half_angle}, {u}: {seen}, not {shown}");
                    // The gradient of a function of degree 1 tells the function.
                    let side = whole.side(-u, which);
                    let along = side.area.dot(u).abs();
                    assert!((along - seen).abs() < 1e-9, "{half_angle}, {u}: {along}, not {seen}");
                    // And so does a difference quotient: of f(u/|u|) |u|, which is another function's but for rounding. The larger side changes
                    // where both are alike.
                    if which == Shown::OneSide && whole.mean.dot(u).abs() < 1e-5 {
                        continue;
                    }
                    let step = DVec3::new(0.3, -0.2, 0.4) * 1e-6;
                    let of = |v: DVec3| whole.seen_from(v.normalize(), which) * v.length();
                    let slope = of(u + step) - of(u - step);
                    let sign = if side.area.dot(u) < 0.0 { -1.0 } else { 1.0 };
                    assert!(
                        (slope - 2.0 * sign * side.area.dot(step)).abs() < 1e-10,
                        "{half_angle}, {u}: {slope:e}"
                    );
                }
            }
        }
    }

    /// The mean normal of what is seen, by projected area.
    #[test]
    fn what_is_seen_of_a_cap_faces_as_it_does() {
        for half_angle in [0.2, 0.6, 1.2, 2.0, std::f64::consts::PI] {
            let normals = cap(half_angle);
            let whole = orientation(&normals);
            for u in directions() {
                let front: f64 = mean(&normals, |n| n.dot(u).max(0.0));
                let facing: DVec3 = mean(&normals, |n| n * n.dot(u).max(0.0));
                let both: f64 = mean(&normals, |n| n.dot(u).abs());
                let turned: DVec3 = mean(&normals, |n| n * n.dot(u));
                let behind = (both - front, turned - facing);
                // Where both are alike rounding decides, here as there.
                let (one, of_one) = if whole.mean.dot(u) < 0.0 { behind } else { (front, facing) };
                for (which, shown, expected) in [
                    (Shown::Fronts, front, facing),
                    (Shown::OneSide, one, of_one),
                    (Shown::Both, both, turned),
                ] {
                    let Side { kept, shift, .. } = whole.side(-u, which);
                    let found = kept * whole.mean + shift;
                    // By the area shown: a tenth of a cap of 2 radians seen from beneath is off by 0.022 of the whole.
                    let error = (shown * found - expected).length();
                    assert!(error < 0.023, "{half_angle}, {u}, {which:?}: {error}, {found}");
                }
            }
        }
    }

    #[test]
    fn a_flat_surfel_is_one_normal() {
        let normal = DVec3::new(0.6, 0.0, 0.8);
        let flat = Orientation::of(normal);
        for u in [DVec3::Z, DVec3::X, -DVec3::Z] {
            assert!((flat.seen_from(u, Shown::Both) - normal.dot(u).abs()).abs() < 1e-12);
            assert!((flat.seen_from(u, Shown::Fronts) - normal.dot(u).max(0.0)).abs() < 1e-12);
            for which in [Shown::OneSide, Shown::Both] {
                let side = flat.side(-u, which);
                assert!((side.area - normal).length().min((side.area + normal).length()) < 1e-12);
                assert!(((side.kept * normal + side.shift).length() - 1.0).abs() < 1e-12);
            }
        }
    }
}
