//! The one place of SIMD: which instructions are used, and functions of eight or sixteen numbers at once.
//!
//! Everything is written once for all levels; `dispatch!` chooses at run time. Levels differ by whether a·b + c is
//! rounded once or twice, and by the guesses from which reciprocals start.

pub use fearless_simd::Simd;
pub(crate) use fearless_simd::prelude::*;
pub(crate) use fearless_simd::{f32x8, f32x16, i32x8, mask32x8, mask32x16, u32x8, u32x16};

/// Sets of instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// What every processor of the architecture has: SSE2 on x86-64, NEON on 64-bit ARM, elsewhere no SIMD.
    Baseline,
    /// AVX2 and FMA on x86-64.
    Avx2,
    /// AVX-512 as of Ice Lake on x86-64.
    Avx512,
}

impl Level {
    /// All levels.
    pub const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// The fastest level of this processor.
    pub fn best() -> Self {
        let is_available = |level: &&Self| level.is_available();
        *Self::ALL.iter().rev().find(is_available).unwrap_or(&Self::Baseline)
    }

    /// Whether this processor has it.
    pub fn is_available(self) -> bool {
        self == Self::Baseline || !matches!(self.token(), Token::Baseline(_))
    }

    /// The proof that the processor has a level; of one that it lacks, the baseline's.
    pub fn token(self) -> Token {
        #[cfg(target_arch = "x86_64")]
        {
            let found = fearless_simd::Level::new();
            match self {
                Self::Baseline => None,
                Self::Avx2 => found.as_avx2().map(Token::Avx2),
                Self::Avx512 => found.as_avx512().map(Token::Avx512),
            }
            .unwrap_or_else(|| Token::Baseline(found.as_sse2().expect("x86-64 has SSE2")))
        }
        #[cfg(target_arch = "aarch64")]
        return Token::Baseline(fearless_simd::Level::new().as_neon().expect("64-bit ARM has NEON"));
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        Token::Baseline(fearless_simd::Fallback::new())
    }
}

#[cfg(target_arch = "x86_64")]
type Baseline = fearless_simd::Sse2;
#[cfg(target_arch = "aarch64")]
type Baseline = fearless_simd::Neon;
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
type Baseline = fearless_simd::Fallback;

/// See [`Level::token`].
#[derive(Clone, Copy, Debug)]
pub enum Token {
    /// Of [`Level::Baseline`].
    Baseline(Baseline),
    /// Of [`Level::Avx2`].
    #[cfg(target_arch = "x86_64")]
    Avx2(fearless_simd::Avx2),
    /// Of [`Level::Avx512`].
    #[cfg(target_arch = "x86_64")]
    Avx512(fearless_simd::Avx512),
}

/// Evaluates an expression with the instructions of a [`Level`](crate::simd::Level); `$simd` is its token. What it calls must
/// be `#[inline(always)]` to be compiled for the level.
#[macro_export]
macro_rules! dispatch {
    ($level:expr, $simd:ident => $op:expr) => {
        match $crate::simd::Level::token($level) {
            $crate::simd::Token::Baseline($simd) => $op,
            #[cfg(target_arch = "x86_64")]
            $crate::simd::Token::Avx2($simd) => $crate::simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $op,
            ),
            #[cfg(target_arch = "x86_64")]
            $crate::simd::Token::Avx512($simd) => $crate::simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $op,
            ),
        }
    };
}
pub use dispatch;

/// A part of a computation that becomes a function of its own: everything else is inlined, and what is long and rare
/// would make a compiler slow and the rest's registers few.
#[inline(never)]
pub(crate) fn apart<S: Simd, R>(simd: S, part: impl FnOnce() -> R) -> R {
    simd.vectorize(part)
}

/// Whether a register holds sixteen numbers, as with AVX-512, of which there are 32: twice as many as AVX2 has, for half as many numbers
/// each.
pub(crate) const fn holds_sixteen<S: Simd>() -> bool {
    size_of::<S::f32s>() >= 16 * size_of::<f32>()
}

/// As `array::map`, but inlined wherever it is used: SIMD that is called through a function is slow.
pub(crate) trait Each<T, const N: usize> {
    /// `f` of each element.
    fn each<U>(self, f: impl FnMut(T) -> U) -> [U; N];
}

macro_rules! impl_each {
    ($($n:literal: $($x:ident)*;)*) => {$(
        impl<T> Each<T, $n> for [T; $n] {
            #[inline(always)]
            fn each<U>(self, mut f: impl FnMut(T) -> U) -> [U; $n] {
                let [$($x),*] = self;
                [$(f($x)),*]
            }
        }
    )*};
}

impl_each! {
    2: a b;
    3: a b c;
    4: a b c d;
    5: a b c d e;
    8: a b c d e f0 g h;
    9: a b c d e f0 g h i;
    15: a b c d e f0 g h i j k l m n o;
    16: a b c d e f0 g h i j k l m n o p;
}

/// Eight numbers.
pub(crate) type V<S> = f32x8<S>;
/// Eight answers.
pub(crate) type M<S> = mask32x8<S>;
/// Sixteen numbers: one register where the processor has such, else two.
pub(crate) type W<S> = f32x16<S>;

/// Reads numbers, changes them and writes them back, `rounds` times: what blending does to memory, pixel by pixel, and
/// nothing else. On a buffer that fits into the first cache it is a yardstick for rasterization.
pub fn rewrite(level: Level, lanes: &mut [[f32; 8]], rounds: usize) {
    dispatch!(level, simd => {
        for _ in 0..rounds {
            for lanes in lanes.iter_mut() {
                *lanes = (V::simd_from(simd, *lanes) * 0.999).into();
            }
        }
    });
}

#[inline(always)]
pub(crate) fn splat<S: Simd>(simd: S, value: f32) -> V<S> {
    V::simd_from(simd, value)
}

/// Four numbers of each of eight splats, splat by splat.
#[inline(always)]
pub(crate) fn rows<S: Simd>(_: S, columns: [V<S>; 4]) -> [[f32; 4]; 8] {
    let [a, b, c, d] = columns;
    let (ac, bd) = ([a.zip_low(c), a.zip_high(c)], [b.zip_low(d), b.zip_high(d)]);
    let pairs = [ac[0].zip_low(bd[0]), ac[0].zip_high(bd[0]), ac[1].zip_low(bd[1]), ac[1].zip_high(bd[1])];
    let [p, q, r, s] = pairs.each(
        #[inline(always)]
        |pair| pair.split(),
    );
    [p.0, p.1, q.0, q.1, r.0, r.1, s.0, s.1].each(
        #[inline(always)]
        |row| row.into(),
    )
}

/// Any count of numbers at once.
pub trait Floats<S: Simd>: SimdFloat<S, Element = f32> {}

impl<S: Simd, F: SimdFloat<S, Element = f32>> Floats<S> for F {}

/// c₀ + x (c₁ + x (c₂ + …)).
#[inline(always)]
pub(crate) fn polynomial<S: Simd, F: Floats<S>, const N: usize>(simd: S, x: F, coefficients: [f32; N]) -> F {
    let mut sum = F::simd_from(simd, coefficients[N - 1]);
    for c in coefficients[..N - 1].iter().rev() {
        sum = sum.mul_add(x, F::simd_from(simd, *c));
    }
    sum
}

/// e^x for −86 ≤ x ≤ 87 within (4 + 1.2 |x|) 1e-7 of itself; outside e^{−86} or e^{87}.
#[inline(always)]
pub fn exp<S: Simd, F: Floats<S>>(simd: S, x: F) -> F {
    // Subnormal numbers take a processor a hundred times as long.
    let x = x.max(F::simd_from(simd, -86.0)).min(F::simd_from(simd, 87.0));
    exp2_within(simd, x * std::f32::consts::LOG2_E)
}

/// 2^t for −126 ≤ t ≤ 127, within 4e-7 of itself; outside any bits.
#[inline(always)]
pub(crate) fn exp2_within<S: Simd, F: Floats<S>>(simd: S, t: F) -> F {
    const COEFFICIENTS: [f32; 6] =
        [1.000_000_1, 0.693_146_94, 0.240_221_2, 0.055_507_13, 0.009_675_541, 0.001_327_647_2];
    F::from_bits(exp2_bits(simd, t, COEFFICIENTS))
}

/// 2^t for −126 ≤ t ≤ 127, within 3e-6 of itself; outside any bits.
#[inline(always)]
pub(crate) fn exp2_roughly<S: Simd, F: Floats<S>>(simd: S, t: F) -> F {
    const COEFFICIENTS: [f32; 5] = [0.999_999_3, 0.693_121_8, 0.240_247_44, 0.055_917_86, 0.009_570_102];
    F::from_bits(exp2_bits(simd, t, COEFFICIENTS))
}

/// As [`exp2_roughly`], but 0 below least, which is at least −126.
#[inline(always)]
pub(crate) fn exp2_from<S: Simd, F: Floats<S>>(simd: S, t: F, least: f32) -> F
where
    F::Mask: Select<F::Bits>,
{
    exp2_where(simd, t.simd_ge(F::simd_from(simd, least)), t)
}

/// As [`exp2_roughly`], but 0 elsewhere.
#[inline(always)]
pub(crate) fn exp2_where<S: Simd, F: Floats<S>>(simd: S, mask: F::Mask, t: F) -> F
where
    F::Mask: Select<F::Bits>,
{
    F::from_bits(mask.select(exp2_roughly(simd, t).to_bits(), F::Bits::simd_from(simd, 0)))
}

/// Added to, 1.5·2²³ rounds to whole numbers and holds them in its lowest bits.
const ROUND: f32 = 12_582_912.0;

/// The bits of 2^t, from a polynomial that is 2^x for |x| ≤ ½.
#[inline(always)]
fn exp2_bits<S: Simd, F: Floats<S>, const N: usize>(simd: S, t: F, coefficients: [f32; N]) -> F::Bits {
    let whole = t + ROUND;
    let p = polynomial(simd, t - (whole - ROUND), coefficients);
    p.to_bits() + (whole.to_bits() << 23)
}

/// 1/x within 3e-7 of itself, for 1e-37 < |x| < 1e37: division takes several times as long.
#[inline(always)]
pub(crate) fn reciprocal<S: Simd, F: Floats<S>>(simd: S, x: F) -> F {
    // The hardware's guess has eight correct bits at least; on x86 it is within 1.5 · 2⁻¹². Each step squares the error: (1.5 · 2⁻¹²)² is
    // 1.4e-7, and roundings add 1.5e-7.
    const STEPS: usize = if cfg!(any(target_arch = "x86", target_arch = "x86_64")) { 1 } else { 2 };
    let two = F::simd_from(simd, 2.0);
    let mut guess = x.approximate_recip();
    for _ in 0..STEPS {
        guess *= (-x).mul_add(guess, two);
    }
    guess
}

/// 1/√x within 3e-7 of itself, for 1e-37 < x < 1e37: a root and a division take several times as long.
#[inline(always)]
pub(crate) fn inverse_root<S: Simd, F: Floats<S>>(simd: S, x: F) -> F {
    // Half the exponent, turned round, is within 3.5 % (Lomont, *Fast inverse square root*, 2003); then Newton's steps.
    let mut guess = F::from_bits(F::Bits::simd_from(simd, 0x5f37_59df) - (x.to_bits() >> 1_u32));
    let (half, three_halves) = (x * -0.5, F::simd_from(simd, 1.5));
    for _ in 0..3 {
        guess *= (half * guess).mul_add(guess, three_halves);
    }
    guess
}

/// log₂ x for normal x > 0, within 2e-7 + 1e-7 |log₂ x|.
#[inline(always)]
pub(crate) fn log2<S: Simd, F: Floats<S>>(simd: S, x: F) -> F {
    // x = 2^n m with ½√2 ≤ m < √2; log m = 2 artanh((m − 1)/(m + 1)).
    const HALF_ROOT: u32 = 0x3f35_04f3;
    // n + 127 in the eight lowest bits of 2²³, which is a number then.
    let shifted = x.to_bits() + (0x3f80_0000 - HALF_ROOT);
    let exponent = F::from_bits((shifted >> 23_u32) | 0x4b00_0000) - (8_388_608.0 + 127.0);
    let m = F::from_bits((shifted & 0x007f_ffff) + HALF_ROOT);
    let s = (m - 1.0) / (m + 1.0);
    const TWO_OVER_LN2: f32 = 2.0 * std::f32::consts::LOG2_E;
    let odd = polynomial(
        simd,
        s * s,
        [TWO_OVER_LN2, TWO_OVER_LN2 / 3.0, TWO_OVER_LN2 / 5.0, TWO_OVER_LN2 / 7.0, TWO_OVER_LN2 / 9.0],
    );
    s.mul_add(odd, exponent)
}

/// x^e for x ≥ 0 and a finite e ≥ 0, within (4 + 4 e (1 + |log x|)) 1e-7 of itself; 0 for x < 1e-37 unless e is 0.
#[inline(always)]
pub(crate) fn pow<S: Simd, F: Floats<S>>(simd: S, x: F, e: f32) -> F {
    if e == 0.0 { F::simd_from(simd, 1.0) } else { pow_positive(simd, x, F::simd_from(simd, e)) }
}

/// As [`pow`], for exponents above 0.
#[inline(always)]
pub(crate) fn pow_positive<S: Simd, F: Floats<S>>(simd: S, x: F, e: F) -> F {
    let constant = |x: f32| F::simd_from(simd, x);
    let t = log2(simd, x.max(constant(1e-37))) * e;
    let inside = t.simd_gt(constant(-126.0)) & x.simd_ge(constant(1e-37));
    inside.select(exp2_within(simd, t.max(constant(-126.0)).min(constant(127.0))), constant(0.0))
}

/// The opacity 1 − e^{−τ} of an optical depth τ ≥ 0, within 1e-6 of itself however small τ is.
#[inline(always)]
pub(crate) fn opacity<S: Simd, F: Floats<S>>(simd: S, optical_depth: F) -> F {
    // (2^x − 1)/x for |x| ≤ ½, within 5e-7 of itself.
    const RISE: [f32; 5] =
        [std::f32::consts::LN_2, 0.240_223_51, 0.055_505_004, 0.009_666_245, 0.001_333_353_9];
    let t = (optical_depth * -std::f32::consts::LOG2_E).max(F::simd_from(simd, -126.0));
    let whole = t + ROUND;
    let x = t - (whole - ROUND);
    let power = F::from_bits((whole.to_bits() << 23_u32) + 1.0_f32.to_bits());
    // 1 − 2^n 2^x, of which nothing cancels.
    (x * polynomial(simd, x, RISE)).mul_add(-power, F::simd_from(simd, 1.0) - power)
}

/// The optical depth −ln(1 − α) of an opacity 0 ≤ α < 1, within 3e-7 + 3e-7 τ.
#[inline(always)]
pub(crate) fn optical_depth<S: Simd, F: Floats<S>>(simd: S, opacity: F) -> F {
    log2(simd, F::simd_from(simd, 1.0) - opacity) * -std::f32::consts::LN_2
}

/// Where [`normal_cdf`] is 0 and 1.
pub(crate) const NORMAL_END: f32 = 4.0;

/// Φ(x) by an odd polynomial and ½, within 3.3e-5; it never falls. From ±4 on it is 0 and 1 or beyond, by less than 1e-6: so
/// what is left of a whole that is not there is never light.
#[inline(always)]
pub(crate) fn normal_cdf<S: Simd, F: Floats<S>>(simd: S, x: F) -> F {
    const OVER_X: [f32; 8] = [
        0.398_805_74,
        -0.066_064_61,
        0.009_581_762,
        -0.001_021_162_5,
        7.620_863e-5,
        -3.711_155_9e-6,
        1.045_076_6e-7,
        -1.279_074_3e-9,
    ];
    let end = F::simd_from(simd, NORMAL_END);
    let x = x.max(-end).min(end);
    x.mul_add(polynomial(simd, x * x, OVER_X), F::simd_from(simd, 0.5))
}

/// As [`crate::color::linear_to_srgb`], within 2e-6.
#[inline(always)]
pub(crate) fn linear_to_srgb<S: Simd>(simd: S, linear: V<S>) -> V<S> {
    let magnitude = linear.abs();
    let curved = pow(simd, magnitude, 1.0 / 2.4).mul_add(splat(simd, 1.055), splat(simd, -0.055));
    let encoded = magnitude.simd_le(splat(simd, 0.003_130_8)).select(magnitude * 12.92, curved);
    encoded.copysign(linear)
}

/// As [`linear_to_srgb`] for the channels of colours, most of which are not above 1; within 2e-6.
#[inline(always)]
pub(crate) fn colors_to_srgb<S: Simd>(simd: S, linear: V3<S>) -> V3<S> {
    let [red, green, blue] = linear;
    let largest = red.abs().max(green.abs()).max(blue.abs());
    if largest.simd_gt(splat(simd, 1.0)).any_true() {
        return linear.each(
            #[inline(always)]
            |c| linear_to_srgb(simd, c),
        );
    }
    linear.each(
        #[inline(always)]
        |c| {
            // The curve over the fourth root, interpolated at the zeros of Chebyshev's polynomial.
            const CURVE: [f32; 8] = [
                -0.058_581_68,
                0.125_506_09,
                1.450_242,
                -1.120_849_3,
                1.146_515,
                -0.833_786_55,
                0.358_946_38,
                -0.067_992_26,
            ];
            let magnitude = c.abs();
            let curved = polynomial(simd, magnitude.sqrt().sqrt(), CURVE);
            let encoded = magnitude.simd_le(splat(simd, 0.003_130_8)).select(magnitude * 12.92, curved);
            encoded.copysign(c)
        },
    )
}

/// As [`crate::color::srgb_to_linear`] for the channels of colours, most of which are not above 1; within 2e-6 of themselves.
#[inline(always)]
pub(crate) fn colors_to_linear<S: Simd, F: Floats<S>>(simd: S, encoded: [F; 3]) -> [F; 3] {
    let [red, green, blue] = encoded;
    let largest = red.abs().max(green.abs()).max(blue.abs());
    let is_bright = largest.simd_gt(F::simd_from(simd, 1.0)).any_true();
    encoded.each(
        #[inline(always)]
        |c| {
            let magnitude = c.abs();
            let base = (magnitude + 0.055) * (1.0 / 1.055);
            let curved = if is_bright { pow(simd, base, 2.4) } else { curve_to_linear(simd, base) };
            let is_low = magnitude.simd_le(F::simd_from(simd, 0.040_45));
            is_low.select(magnitude * (1.0 / 12.92), curved).copysign(c)
        },
    )
}

/// x^2.4 from 0.09 to 1, within 1.3e-6 of itself: x² times s^0.8 of the root s, interpolated at the zeros of Chebyshev's polynomial.
#[inline(always)]
fn curve_to_linear<S: Simd, F: Floats<S>>(simd: S, x: F) -> F {
    const CURVE: [f32; 8] = [
        0.028_490_305,
        1.424_185_8,
        -1.237_914_9,
        1.906_292_1,
        -2.165_269_1,
        1.596_914_4,
        -0.678_194_6,
        0.125_496_22,
    ];
    x * x * polynomial(simd, x.sqrt(), CURVE)
}

/// Sixteen rows of sixteen numbers to their columns.
#[inline(always)]
pub(crate) fn columns<S: Simd>(rows: [W<S>; 16]) -> [W<S>; 16] {
    // Each step turns the bits of a number's row and column, one after the other, by one: after four they have changed places.
    let mut all = rows;
    for _ in 0..4 {
        let before = all;
        for half in 0..8 {
            (all[2 * half], all[2 * half + 1]) = before[half].interleave(before[half + 8]);
        }
    }
    all
}

/// Three numbers of each of eight.
pub(crate) type V3<S> = [V<S>; 3];

#[inline(always)]
pub(crate) fn dot<S: Simd, F: Floats<S>>(a: [F; 3], b: [F; 3]) -> F {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

#[inline(always)]
pub(crate) fn cross<S: Simd>(a: V3<S>, b: V3<S>) -> V3<S> {
    [a[1].mul_sub(b[2], a[2] * b[1]), a[2].mul_sub(b[0], a[0] * b[2]), a[0].mul_sub(b[1], a[1] * b[0])]
}

#[inline(always)]
pub(crate) fn splat3<S: Simd, F: Floats<S>>(simd: S, v: [f32; 3]) -> [F; 3] {
    v.each(
        #[inline(always)]
        |x| F::simd_from(simd, x),
    )
}

/// The unit vector along v; zero where v is next to nothing.
#[inline(always)]
pub(crate) fn normalize_or_zero<S: Simd, F: Floats<S>>(simd: S, v: [F; 3]) -> [F; 3] {
    let (zero, one) = (F::simd_from(simd, 0.0), F::simd_from(simd, 1.0));
    let squared = dot(v, v);
    let scale = squared.simd_gt(F::simd_from(simd, 1e-36)).select(one / squared.sqrt(), zero);
    v.each(
        #[inline(always)]
        |x| x * scale,
    )
}

/// The unit vector along v, however long that is up to 1e38; zero where v is.
#[inline(always)]
pub(crate) fn direction_or_zero<S: Simd, F: Floats<S>>(simd: S, v: [F; 3]) -> [F; 3] {
    const EXPONENT: u32 = 0x7f80_0000;
    let largest = v[0].abs().max(v[1].abs()).max(v[2].abs());
    // 1 over the power of two below it, by which nothing is rounded.
    let inverse = F::from_bits(
        F::Bits::simd_from(simd, 0x7f00_0000) - (largest.to_bits() & F::Bits::simd_from(simd, EXPONENT)),
    );
    normalize_or_zero(
        simd,
        v.each(
            #[inline(always)]
            |x| x * inverse,
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_those_of_vectors_of_any_length() {
        for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
            for length in [1e-37, 1e-30, 1e-18, 0.3, 1.0, 7.0, 1e18, 1e30, 1e38] {
                dispatch!(level, simd => {
                    let v = [0.48, -0.6, 0.64].map(|x: f32| V::simd_from(simd, x * length));
                    let found: [[f32; LANES_OF_V]; 3] = direction_or_zero(simd, v).map(|x| x.into());
                    for (found, expected) in found.iter().flatten().zip([0.48_f32, -0.6, 0.64].into_iter().flat_map(|x| [x; LANES_OF_V])) {
                        assert!((found - expected).abs() < 3e-7, "{level:?}: {found}, not {expected}, at {length:e}");
                    }
                });
            }
            dispatch!(level, simd => {
                let found: [[f32; LANES_OF_V]; 3] = direction_or_zero(simd, [V::simd_from(simd, 0.0); 3]).map(|x| x.into());
                assert_eq!(found, [[0.0; LANES_OF_V]; 3]);
            });
        }
    }

    const LANES_OF_V: usize = 8;

    /// Compares a function with f64 on every level: the error at x must stay within `bound`.
    macro_rules! check {
        ($name:literal, |$simd:ident, $v:ident| $function:expr, $expected:expr, $inputs:expr, $bound:expr) => {
            for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
                for chunk in $inputs.chunks_exact(8) {
                    let x: [f32; 8] = std::array::from_fn(|i| chunk[i]);
                    let found: [f32; 8] = dispatch!(level, $simd => {
                        let $v = f32x8::simd_from($simd, x);
                        $function.into()
                    });
                    for (x, found) in x.into_iter().map(f64::from).zip(found) {
                        let expected: f64 = $expected(x);
                        let error = (f64::from(found) - expected).abs();
                        assert!(error <= $bound(x, expected), "{level:?}: {}({x}) is off by {error:e}", $name);
                    }
                }
            }
        };
    }

    fn steps(from: f32, to: f32) -> Vec<f32> {
        (0..8000).map(|i| from + (to - from) * i as f32 / 7999.0).collect()
    }

    #[test]
    fn functions_keep_their_errors() {
        check!("exp", |simd, v| exp(simd, v), f64::exp, steps(-85.9, 86.9), |x: f64, y: f64| y
            * (4e-7 + 1.2e-7 * x.abs()));
        check!("exp2", |simd, v| exp2_from(simd, v, -126.0), f64::exp2, steps(-125.9, 126.9), |_, y: f64| y
            * 3e-6);
        let positive: Vec<f32> = steps(-36.0, 36.0).into_iter().map(|e| 10f32.powf(e)).collect();
        check!("1/x", |simd, v| reciprocal(simd, v), |x: f64| 1.0 / x, positive, |_, y: f64| 3e-7 * y);
        check!(
            "1/√x",
            |simd, v| inverse_root(simd, v),
            |x: f64| x.sqrt().recip(),
            positive,
            |_, y: f64| 3e-7 * y
        );
        let wide: Vec<f32> = steps(-37.0, 37.0).into_iter().map(|e| 10f32.powf(e)).collect();
        check!("log2", |simd, v| log2(simd, v), f64::log2, wide, |_, y: f64| 2e-7 + 1e-7 * y.abs());
        let thin: Vec<f32> = steps(-8.0, 2.0).into_iter().map(|e| 10f32.powf(e)).collect();
        check!("opacity", |simd, v| opacity(simd, v), |t: f64| -(-t).exp_m1(), thin, |_, y: f64| 1e-6 * y);
        check!(
            "optical depth",
            |simd, v| optical_depth(simd, v),
            |a: f64| -(-a).ln_1p(),
            steps(0.0, 0.99),
            |_, y: f64| 3e-7 + 3e-7 * y
        );
        let phi = |x: f64| 0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2);
        check!("Φ", |simd, v| normal_cdf(simd, v), phi, steps(-8.0, 8.0), |_, _| 3.3e-5);
        // Beyond its ends never less than all, nor more than nothing: of what is not there nothing may be left.
        let beyond = [steps(-8.0, -4.0), steps(4.0, 8.0)].concat();
        let all = |x: f64| if x > 0.0 { 1.0 } else { 0.0 };
        check!("Φ", |simd, v| normal_cdf(simd, v), all, beyond, |_, _| 1e-6);
        let half = |_: f64| 0.5;
        check!(
            "Φ from ½",
            |simd, v| (normal_cdf(simd, v) - 0.5).abs().min(splat(simd, 0.5)),
            half,
            beyond,
            |_, _| 0.0
        );
        for e in [1.0 / 2.4, 2.4, 20.0] {
            check!(
                "pow",
                |simd, v| pow(simd, v, e),
                |x: f64| x.powf(e.into()),
                steps(0.001, 2.0),
                |x: f64, y: f64| { y * (4.0 + 4.0 * f64::from(e) * (1.0 + x.ln().abs())) * 1e-7 + 1e-37 }
            );
        }
        let srgb = |x: f64| f64::from(crate::color::linear_to_srgb(x as f32));
        check!("linear_to_srgb", |simd, v| linear_to_srgb(simd, v), srgb, steps(-1.0, 3.0), |_, _| 2e-6);
        check!(
            "colors_to_srgb",
            |simd, v| colors_to_srgb(simd, [v; 3])[1],
            srgb,
            steps(-1.0, 3.0),
            |_, _| 2e-6
        );
        let linear = |x: f64| f64::from(crate::color::srgb_to_linear(x as f32));
        check!(
            "colors_to_linear",
            |simd, v| colors_to_linear(simd, [v; 3])[1],
            linear,
            [steps(-1.0, 1.0), steps(-2.0, 2.0)].concat(),
            |_, y: f64| 2e-6 * y.abs().max(0.1)
        );
    }

    #[test]
    fn columns_are_those_of_the_rows() {
        let rows: [[f32; 16]; 16] = std::array::from_fn(|row| std::array::from_fn(|i| (16 * row + i) as f32));
        for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
            let found: [[f32; 16]; 16] = dispatch!(level, simd => {
                columns(rows.each(#[inline(always)] |row| f32x16::simd_from(simd, row))).map(Into::into)
            });
            for (number, column) in found.iter().enumerate() {
                assert_eq!(*column, rows.map(|row| row[number]), "{level:?}, column {number}");
            }
        }
    }

    #[test]
    fn a_level_is_found() {
        assert!(Level::best().is_available() && Level::Baseline.is_available());
    }
}
