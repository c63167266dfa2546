//! Harmonics of turned splats.
//!
//! A function on the sphere, turned, has coefficients of the same degree again: c' = D c with
//! D_mn = ∫ Y_m(d) Y_n(Qᵀd) dω. The products are polynomials of degree 6 at most; Gauss–Legendre heights times equal azimuths
//! integrate them exactly (Stroud, *Approximate Calculation of Multiple Integrals*, 1971), for mirrored axes as well, so there
//! is no recursion over degrees. Basis and signs are those of [`Harmonics`](oblate_engine::Harmonics).

use super::trained::MOST_HARMONICS;
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;
use std::ops::Range;

/// Where the functions of degree 1, 2 and 3 are among those without the constant one.
const DEGREES: [Range<usize>; 3] = [0..3, 3..8, 8..15];

/// Heights and weights of Gauss–Legendre with 4 points, exact up to degree 7.
const HEIGHTS: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
    (-0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
];

/// Equal azimuths, exact up to 7 turns.
const AZIMUTHS: usize = 8;

/// What turns coefficients.
#[derive(Clone, Debug)]
pub(crate) struct Turn {
    /// By row and column; zero between degrees.
    matrix: [[f64; MOST_HARMONICS]; MOST_HARMONICS],
}

impl Turn {
    /// For directions that `orthogonal`, a rotation or a mirrored one, takes elsewhere.
    pub(crate) fn new(orthogonal: DMat3) -> Self {
        let mut matrix = [[0.0; MOST_HARMONICS]; MOST_HARMONICS];
        for (height, weight) in HEIGHTS {
            for azimuth in 0..AZIMUTHS {
                let (sin, cos) = (TAU * azimuth as f64 / AZIMUTHS as f64).sin_cos();
                let across = (1.0 - height * height).sqrt();
                let direction = DVec3::new(across * cos, across * sin, height);
                let (to, from) = (basis(direction), basis(orthogonal.transpose() * direction));
                let weight = weight * TAU / AZIMUTHS as f64;
                for range in DEGREES {
                    for row in range.clone() {
                        for column in range.clone() {
                            matrix[row][column] += weight * to[row] * from[column];
                        }
                    }
                }
            }
        }
        Self { matrix }
    }

    /// Turns the coefficients of a splat.
    pub(crate) fn apply(&self, harmonics: &mut [[f32; 3]; MOST_HARMONICS]) {
        let old = harmonics.map(|color| color.map(f64::from));
        for range in DEGREES {
            for row in range.clone() {
                for channel in 0..3 {
                    let sum: f64 = range.clone().map(|n| self.matrix[row][n] * old[n][channel]).sum();
                    harmonics[row][channel] = sum as f32;
                }
            }
        }
    }
}

/// The functions of degree 1 to 3 of a unit vector.
fn basis(DVec3 { x, y, z }: DVec3) -> [f64; MOST_HARMONICS] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        -0.488_602_511_902_919_9 * y,
        0.488_602_511_902_919_9 * z,
        -0.488_602_511_902_919_9 * x,
        1.092_548_430_592_079 * x * y,
        -1.092_548_430_592_079 * y * z,
        0.315_391_565_252_520 * (2.0 * zz - xx - yy),
        -1.092_548_430_592_079 * x * z,
        0.546_274_215_296_039_5 * (xx - yy),
        -0.590_043_589_926_643_5 * y * (3.0 * xx - yy),
        2.890_611_442_640_554 * x * y * z,
        -0.457_045_799_464_465_7 * y * (4.0 * zz - xx - yy),
        0.373_176_332_590_115_4 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.457_045_799_464_465_7 * x * (4.0 * zz - xx - yy),
        1.445_305_721_320_277 * z * (xx - yy),
        -0.590_043_589_926_643_5 * x * (xx - 3.0 * yy),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    fn evaluate(harmonics: &[[f32; 3]; MOST_HARMONICS], direction: DVec3) -> [f64; 3] {
        let values = basis(direction);
        [0, 1, 2].map(|c| values.iter().zip(harmonics).map(|(value, h)| value * f64::from(h[c])).sum())
    }

    fn unit() -> impl Strategy<Value = DVec3> {
        let any = prop::array::uniform3(-1.0..1.0).prop_map(DVec3::from);
        any.prop_filter_map("a direction", |v| (v.length() > 0.1).then(|| v.normalize()))
    }

    proptest! {
        #[test]
        fn turned_functions_are_functions_of_directions_turned_back(
            axis in unit(),
            angle in -4.0..4.0f64,
            mirrored in any::<bool>(),
            direction in unit(),
            harmonics in prop::array::uniform15(prop::array::uniform3(-1.0..1.0f32)),
        ) {
            let mirror = if mirrored { DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)) } else { DMat3::IDENTITY };
            let orthogonal = DMat3::from_quat(DQuat::from_axis_angle(axis, angle)) * mirror;
            let mut turned = harmonics;
            Turn::new(orthogonal).apply(&mut turned);
            let wanted = evaluate(&harmonics, orthogonal.transpose() * direction);
            let found = evaluate(&turned, direction);
            // Fifteen coefficients of at most 2.6 (7 of 1 in one degree), each rounded to 2⁻²⁴ of itself, times functions of at
            // most 1.5 whose squares sum to 15/4π.
            for channel in 0..3 {
                prop_assert!((found[channel] - wanted[channel]).abs() < 1e-6, "{found:?} {wanted:?}");
            }
        }
    }

    #[test]
    fn a_quarter_turn_about_z() {
        // x becomes y: the function −x of order 1 becomes −y of order −1.
        let mut harmonics = [[0.0; 3]; MOST_HARMONICS];
        harmonics[2] = [1.0; 3];
        Turn::new(DMat3::from_rotation_z(TAU / 4.0)).apply(&mut harmonics);
        let expected = |n| if n == 0 { 1.0 } else { 0.0 };
        for (n, color) in harmonics.iter().enumerate() {
            assert!((color[1] - expected(n)).abs() < 1e-7, "{n} {color:?}");
        }
    }
}
