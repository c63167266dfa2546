//! As many numbers at once as a register holds.
//!
//! What is here and what calls it is `#[inline(always)]` down from where the level of SIMD is chosen.

pub(super) use fearless_simd::prelude::*;
pub(super) use oblate_engine::simd::Simd;

/// The most numbers in a register on any level.
pub(super) const MOST_LANES: usize = 16;

/// Numbers of one register.
pub(super) type F<S> = <S as Simd>::f32s;
/// Answers.
pub(super) type M<S> = <S as Simd>::mask32s;
/// Vectors.
pub(super) type F3<S> = [F<S>; 3];

#[inline(always)]
pub(super) fn splat<S: Simd>(simd: S, value: f32) -> F<S> {
    F::<S>::splat(simd, value)
}

#[inline(always)]
pub(super) fn select<S: Simd>(mask: M<S>, yes: F<S>, no: F<S>) -> F<S> {
    mask.select(yes, no)
}

#[inline(always)]
pub(super) fn select3<S: Simd>(mask: M<S>, yes: F3<S>, no: F3<S>) -> F3<S> {
    [mask.select(yes[0], no[0]), mask.select(yes[1], no[1]), mask.select(yes[2], no[2])]
}

#[inline(always)]
pub(super) fn sub<S: Simd>(a: F3<S>, b: F3<S>) -> F3<S> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn scale<S: Simd>(a: F3<S>, by: F<S>) -> F3<S> {
    [a[0] * by, a[1] * by, a[2] * by]
}

/// a + b t.
#[inline(always)]
pub(super) fn along<S: Simd>(a: F3<S>, b: F3<S>, t: F<S>) -> F3<S> {
    [b[0].mul_add(t, a[0]), b[1].mul_add(t, a[1]), b[2].mul_add(t, a[2])]
}

#[inline(always)]
pub(super) fn dot<S: Simd>(a: F3<S>, b: F3<S>) -> F<S> {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// A matrix, by rows, times vectors.
#[inline(always)]
pub(super) fn times<S: Simd>(simd: S, m: &[[f32; 3]; 3], v: F3<S>) -> F3<S> {
    [row_times(simd, &m[0], v), row_times(simd, &m[1], v), row_times(simd, &m[2], v)]
}

#[inline(always)]
fn row_times<S: Simd>(simd: S, row: &[f32; 3], v: F3<S>) -> F<S> {
    let (a, b) = (splat(simd, row[0]), splat(simd, row[1]));
    v[0].mul_add(a, v[1].mul_add(b, v[2] * row[2]))
}

/// The unit vector along v; zero, infinite or NaN where v or its square is next to nothing or too large.
#[inline(always)]
pub(super) fn normalize<S: Simd>(simd: S, v: F3<S>) -> F3<S> {
    scale::<S>(v, reciprocal(simd, dot::<S>(v, v).sqrt()))
}

/// Newton's steps that make the hardware's guess of a reciprocal, of eleven correct bits on x86 and eight elsewhere, one of all.
const STEPS: usize = if cfg!(target_arch = "x86_64") { 1 } else { 2 };

/// 1/x within 3e-7 of itself, for 1e-37 < |x| < 1e37: division takes several times as long.
#[inline(always)]
pub(super) fn reciprocal<S: Simd>(simd: S, x: F<S>) -> F<S> {
    let two = splat(simd, 2.0);
    let mut guess = x.approximate_recip();
    for _ in 0..STEPS {
        guess *= (-x).mul_add(guess, two);
    }
    guess
}
