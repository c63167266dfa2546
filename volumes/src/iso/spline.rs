//! Samples to coefficients of a tricubic B-spline.

use super::window::{STRIDES, Window};

/// The coefficients of the quasi-interpolant that keeps cubic polynomials, v − δ²v/6 along each axis in turn (de Boor, Fix, *Spline
/// Approximation by Quasiinterpolants*, 1973). Beside missing samples δ² is 0, as if the field went straight on.
#[inline(always)]
pub(super) fn coefficients(samples: &Window, [from, to]: [&mut Window; 2]) {
    to.copy_from(samples);
    for stride in [1, STRIDES[0], STRIDES[1]] {
        from.copy_from(to);
        let (from, to) = (from.numbers(), to.numbers_mut());
        let last = from.len() - stride;
        let neighbours = from[..last - stride].iter().zip(&from[2 * stride..]);
        for ((to, here), (before, after)) in
            to[stride..last].iter_mut().zip(&from[stride..last]).zip(neighbours)
        {
            let bend = (before - here) + (after - here);
            *to = here - if bend.is_finite() { bend * (1.0 / 6.0) } else { 0.0 };
        }
    }
}
