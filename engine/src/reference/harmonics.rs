//! Real spherical harmonics by the recurrence of the associated Legendre functions.
//!
//! DLMF, *NIST Digital Library of Mathematical Functions*, 14.10.3 (recurrence) and 14.30.1 (normalisation): with
//! their Condon–Shortley phase in it, the real functions have the signs that trained scenes are stored with.

use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_1_PI, SQRT_2};

/// Σ coefficient · Y over degrees from 1 on and, in each, orders from −l to l, for a unit vector.
pub(super) fn sum(direction: DVec3, coefficients: impl Iterator<Item = [f32; 3]>) -> DVec3 {
    let functions = (1_u32..).flat_map(|degree| {
        let orders = -(degree as i32)..=degree as i32;
        orders.map(move |order| function(degree, order, direction))
    });
    let color = |c: [f32; 3]| DVec3::from(c.map(f64::from));
    coefficients.zip(functions).map(|(coefficient, value)| color(coefficient) * value).sum()
}

/// The real spherical harmonic of a degree and an order.
fn function(degree: u32, order: i32, direction: DVec3) -> f64 {
    let m = order.unsigned_abs();
    // sin^m θ (cos mφ, sin mφ).
    let around = (0..m).fold(DVec2::X, |power, _| power.rotate(direction.truncate()));
    let azimuthal = match order {
        0 => 1.0,
        1.. => SQRT_2 * around.x,
        _ => SQRT_2 * around.y,
    };
    let factorials: f64 = (degree - m + 1..=degree + m).map(f64::from).product();
    let normalization = (f64::from(2 * degree + 1) * 0.25 * FRAC_1_PI / factorials).sqrt();
    normalization * legendre(degree, m, direction.z) * azimuthal
}

/// P_l^m(z) / sin^m θ.
fn legendre(l: u32, m: u32, z: f64) -> f64 {
    let (mut before, mut value) = (0.0, (0..m).map(|k| -f64::from(2 * k + 1)).product());
    for n in m + 1..=l {
        let next = (z * f64::from(2 * n - 1) * value - f64::from(n + m - 1) * before) / f64::from(n - m);
        (before, value) = (value, next);
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn they_are_those_in_books() {
        // Unsöld's theorem: the squares of a degree sum to (2l + 1)/4π everywhere; and values by hand.
        let p = DVec3::new(2.0, -3.0, 6.0) / 7.0;
        for degree in 1..=3 {
            let l = degree as i32;
            let squares: f64 = (-l..=l).map(|m| function(degree, m, p).powi(2)).sum();
            assert!((squares - f64::from(2 * degree + 1) / (2.0 * TAU)).abs() < 1e-14);
        }
        let by_hand = [
            (1, -1, -(3.0 / (2.0 * TAU)).sqrt() * p.y),
            (1, 0, (3.0 / (2.0 * TAU)).sqrt() * p.z),
            (2, -2, (15.0 / (2.0 * TAU)).sqrt() * p.x * p.y),
            (2, 0, (5.0 / (8.0 * TAU)).sqrt() * (3.0 * p.z * p.z - 1.0)),
            (3, 0, (7.0 / (8.0 * TAU)).sqrt() * (5.0 * p.z.powi(3) - 3.0 * p.z)),
            (3, 2, (105.0 / (8.0 * TAU)).sqrt() * p.z * (p.x * p.x - p.y * p.y)),
        ];
        for (degree, order, value) in by_hand {
            assert!((function(degree, order, p) - value).abs() < 1e-14, "{degree}, {order}");
        }
    }
}
