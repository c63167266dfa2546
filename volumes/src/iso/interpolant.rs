//! Fields between samples, in the coordinates of a cell.

use super::lanes::*;
use super::stencil::{Batch, columns};

/// A field in each lane.
pub(super) trait Interpolant<S: Simd> {
    /// Its value and gradient at `p`.
    fn at(&self, simd: S, p: F3<S>) -> (F<S>, F3<S>);
}

/// The trilinear interpolant of the values at a cell's corners, as the polynomial that it is: a constant, the factors of x, y, z,
/// of yz, zx, xy, and of xyz.
pub(super) struct Trilinear<S: Simd> {
    constant: F<S>,
    linear: F3<S>,
    pairs: F3<S>,
    triple: F<S>,
}

impl<S: Simd> Trilinear<S> {
    #[inline(always)]
    pub(super) fn new(v: &[F<S>; 8]) -> Self {
        let linear = [v[1] - v[0], v[2] - v[0], v[4] - v[0]];
        let pairs = [(v[6] - v[4]) - linear[1], (v[5] - v[1]) - linear[2], (v[3] - v[2]) - linear[0]];
        Self { constant: v[0], linear, pairs, triple: ((v[7] - v[6]) - (v[5] - v[4])) - pairs[2] }
    }
}

impl<S: Simd> Interpolant<S> for Trilinear<S> {
    #[inline(always)]
    fn at(&self, _: S, [x, y, z]: F3<S>) -> (F<S>, F3<S>) {
        let [l_x, l_y, l_z] = self.linear;
        let [yz, zx, xy] = self.pairs;
        // What multiplies xy, and y, where x is 0 or not.
        let of_xy = self.triple.mul_add(z, xy);
        let of_y = yz.mul_add(z, l_y);
        let d_x = of_xy.mul_add(y, zx.mul_add(z, l_x));
        let d_y = of_xy.mul_add(x, of_y);
        let d_z = self.triple.mul_add(x, yz).mul_add(y, zx.mul_add(x, l_z));
        (d_x.mul_add(x, of_y.mul_add(y, l_z.mul_add(z, self.constant))), [d_x, d_y, d_z])
    }
}

/// The tricubic B-spline around a cell.
pub(super) struct Tricubic<S: Simd> {
    /// Four along x, by y + 4 z.
    coefficients: [[F<S>; 4]; 16],
}

impl<S: Simd> Tricubic<S> {
    /// Of the coefficients of a register's cells times a factor.
    #[inline(always)]
    pub(super) fn new(simd: S, batch: &Batch, register: usize, factor: F<S>) -> Self {
        let mut coefficients = [[splat(simd, 0.0); 4]; 16];
        for (to, row) in coefficients.iter_mut().zip(&batch.coefficients) {
            *to = columns(simd, row, register);
            for coefficient in to {
                *coefficient *= factor;
            }
        }
        Self { coefficients }
    }
}

/// The weights of four coefficients at t from 0 to 1 between the middle two, and their derivatives.
#[inline(always)]
fn weights<S: Simd>(simd: S, t: F<S>) -> [[F<S>; 4]; 2] {
    let one = splat(simd, 1.0);
    let u = one - t;
    let (t2, u2) = (t * t, u * u);
    let (sixth, half) = (1.0 / 6.0, splat(simd, 0.5));
    let middle = splat(simd, 2.0 / 3.0);
    let values = [
        u2 * u * sixth,
        t2.mul_add(half * t - one, middle),
        u2.mul_add(half * u - one, middle),
        t2 * t * sixth,
    ];
    let slopes = [u2 * -0.5, t * (t * 1.5 - 2.0), -(u * (u * 1.5 - 2.0)), t2 * 0.5];
    [values, slopes]
}

#[inline(always)]
fn sum<S: Simd>(weights: &[F<S>; 4], of: &[F<S>; 4]) -> F<S> {
    let low = weights[0].mul_add(of[0], weights[1] * of[1]);
    weights[2].mul_add(of[2], weights[3].mul_add(of[3], low))
}

impl<S: Simd> Interpolant<S> for Tricubic<S> {
    #[inline(always)]
    fn at(&self, simd: S, [x, y, z]: F3<S>) -> (F<S>, F3<S>) {
        let ([w_x, s_x], [w_y, s_y], [w_z, s_z]) = (weights(simd, x), weights(simd, y), weights(simd, z));
        let zero = splat(simd, 0.0);
        let (mut value, mut slopes) = (zero, [zero; 3]);
        for k in 0..4 {
            let (mut v, mut d_x, mut d_y) = (zero, zero, zero);
            for j in 0..4 {
                let row = &self.coefficients[j + 4 * k];
                let along = sum::<S>(&w_x, row);
                v = w_y[j].mul_add(along, v);
                d_y = s_y[j].mul_add(along, d_y);
                d_x = w_y[j].mul_add(sum::<S>(&s_x, row), d_x);
            }
            value = w_z[k].mul_add(v, value);
            slopes[0] = w_z[k].mul_add(d_x, slopes[0]);
            slopes[1] = w_z[k].mul_add(d_y, slopes[1]);
            slopes[2] = s_z[k].mul_add(v, slopes[2]);
        }
        (value, slopes)
    }
}
