//! e^x as the rasterizer needs it: inlined, without a call or a branch.

/// e^x for −87 ≤ x ≤ 87, within (4 + 1.2 |x|) 1e-7 of itself; outside it is e^{±87}.
///
/// 2^f by a minimax polynomial of degree 5 on [−½, ½] (relative error 2.1e-7) times a power of two put into
/// the exponent's bits.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    /// Adding it rounds to an integer, which then stands in the low bits.
    const ROUND: f32 = 12_582_912.0;
    let t = x.clamp(-87.0, 87.0) * std::f32::consts::LOG2_E;
    let shifted = t + ROUND;
    let f = t - (shifted - ROUND);
    let p = 0.001_327_647_2 * f + 0.009_675_541;
    let p = (p * f + 0.055_507_13) * f + 0.240_221_2;
    let p = (p * f + 0.693_146_94) * f + 1.000_000_1;
    let power = f32::from_bits(shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23);
    p * power
}

/// The opacity 1 − e^{−τ} of an optical depth τ ≥ 0, within 1e-6 of itself however small τ is.
#[inline(always)]
pub(crate) fn opacity(optical_depth: f32) -> f32 {
    let t = optical_depth;
    // 1 − e^{−t} loses all digits at t = 0; the series to t⁷ errs by t⁷/40320, 2e-7 at ½.
    let series = 1.0 - t / 7.0;
    let series = 1.0 - t / 6.0 * series;
    let series = 1.0 - t / 5.0 * series;
    let series = 1.0 - t / 4.0 * series;
    let series = 1.0 - t / 3.0 * series;
    let series = t * (1.0 - t / 2.0 * series);
    if t < 0.5 { series } else { 1.0 - exp(-t) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_keeps_its_error() {
        for i in -86_000..=86_000 {
            let x = i as f32 / 1000.0;
            let expected = f64::from(x).exp();
            let error = (f64::from(exp(x)) / expected - 1.0).abs();
            // The argument's rounding is |x| 6e-8 of e^x.
            assert!(error < 4e-7 + 1.2e-7 * f64::from(x.abs()), "e^{x} is off by {error:e}");
        }
        assert!(exp(-1000.0) > 0.0 && exp(-1000.0) < 1e-37);
    }

    #[test]
    fn opacity_keeps_its_error() {
        for i in 0..=4000 {
            let t = 10f32.powf(i as f32 / 400.0 - 8.0);
            let expected = -(-f64::from(t)).exp_m1();
            let error = (f64::from(opacity(t)) / expected - 1.0).abs();
            assert!(error < 1e-6, "1 − e^−{t} is off by {error:e}");
        }
        assert_eq!(opacity(0.0), 0.0);
    }
}
