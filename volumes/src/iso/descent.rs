//! From a point of a cell onto the surface.

use super::interpolant::{Interpolant, Trilinear};
use super::lanes::*;
use super::polygon::Geometry;

/// How far outside its cell a surfel may be moved along the gradient, in steps of the grid: beyond the cell the interpolant is
/// another.
const REACH: f32 = 1.0 / 1024.0;
/// The same for a field whose pieces continue each other smoothly.
const SMOOTH_REACH: f32 = 0.1;
/// A root is found when Newton's step is shorter than this, in steps of the grid: what is left is about its square.
const LAST_STEP: f32 = 1e-5;
/// So many halvings of a step of the grid reach the last digit of f32.
const MOST_STEPS: usize = 32;

/// Points to start from, with the field's value and gradient there, and the ways to go, up to where the field's sign is another.
struct Bracket<S: Simd> {
    start: F3<S>,
    way: F3<S>,
    value: F<S>,
    gradient: F3<S>,
}

/// Newton's steps without a bracket: enough for all but one cell in a hundred.
const FREE_STEPS: usize = 3;

/// Moves points inside cells, whose corners have these values, onto the zero of their interpolant: along the gradient (steepest in
/// the world) to the cell's border, or, if the zero is not there, towards the nearest corner on the other side, where it must be.
/// Gives the gradient there, too.
#[inline(always)]
pub(super) fn onto_surface<S: Simd>(
    simd: S,
    geometry: &Geometry,
    field: &Trilinear<S>,
    values: &[F<S>; 8],
    start: F3<S>,
) -> (F3<S>, F3<S>) {
    let first = field.at(simd, start);
    let way = times(simd, &geometry.descent, first.1);
    let (mut value, mut gradient) = first;
    let (mut t, mut position) = (splat(simd, 0.0), start);
    let mut moved = t;
    for _ in 0..FREE_STEPS {
        moved = value * reciprocal(simd, dot::<S>(gradient, way));
        t -= moved;
        position = along::<S>(start, way, t);
        (value, gradient) = field.at(simd, position);
    }
    let middle = splat(simd, 0.5);
    let farthest =
        (position[0] - middle).abs().max((position[1] - middle).abs()).max((position[2] - middle).abs());
    let length = way[0].abs().max(way[1].abs()).max(way[2].abs());
    let found = farthest.simd_le(0.5 + REACH) & (moved * length).abs().simd_le(LAST_STEP);
    if found.all_true() {
        return (position, gradient);
    }
    let (safe, at_safe) = within_bracket(simd, geometry, (field, values), (start, first));
    (select3::<S>(found, position, safe), select3::<S>(found, gradient, at_safe))
}

/// The same, however the field winds.
#[inline(never)]
fn within_bracket<S: Simd>(
    simd: S,
    geometry: &Geometry,
    (field, values): (&Trilinear<S>, &[F<S>; 8]),
    (start, (value, gradient)): (F3<S>, (F<S>, F3<S>)),
) -> (F3<S>, F3<S>) {
    simd.vectorize(
        #[inline(always)]
        || {
            let (way, found) = downhill(simd, geometry, (field, REACH), (start, value, gradient));
            let zero = splat(simd, 0.0);
            let is_inside = value.simd_ge(zero);
            let (mut nearest, mut to) = (splat(simd, f32::INFINITY), [zero; 3]);
            for (corner, at_corner) in values.iter().enumerate() {
                let upper = [corner & 1, corner >> 1 & 1, corner >> 2];
                let position = [
                    splat(simd, upper[0] as f32),
                    splat(simd, upper[1] as f32),
                    splat(simd, upper[2] as f32),
                ];
                let offset = sub::<S>(position, start);
                let distance = dot::<S>(offset, offset);
                let is_better = (at_corner.simd_ge(zero) ^ is_inside) & distance.simd_lt(nearest);
                nearest = select::<S>(is_better, distance, nearest);
                to = select3::<S>(is_better, offset, to);
            }
            let way = select3::<S>(found, way, to);
            root(simd, field, Bracket { start, way, value, gradient })
        },
    )
}

/// The same for a field that another field's surface is near to. Where the gradient does not lead to a zero points stay where
/// they are, and the third answer says so.
#[inline(always)]
pub(super) fn onto_near_surface<S: Simd>(
    simd: S,
    geometry: &Geometry,
    field: &impl Interpolant<S>,
    start: F3<S>,
) -> (F3<S>, F3<S>, M<S>) {
    let (value, gradient) = field.at(simd, start);
    let (way, found) = downhill(simd, geometry, (field, SMOOTH_REACH), (start, value, gradient));
    let way = select3::<S>(found, way, [splat(simd, 0.0); 3]);
    let (position, gradient) = root(simd, field, Bracket { start, way, value, gradient });
    (select3::<S>(found, position, start), gradient, found)
}

/// The way along the gradient to so far outside the cell, and whether the sign changes on it.
#[inline(always)]
fn downhill<S: Simd>(
    simd: S,
    geometry: &Geometry,
    (field, reach): (&impl Interpolant<S>, f32),
    (start, value, gradient): (F3<S>, F<S>, F3<S>),
) -> (F3<S>, M<S>) {
    let zero = splat(simd, 0.0);
    let steepest = times(simd, &geometry.descent, gradient);
    let direction = scale::<S>(steepest, splat(simd, -1.0).copysign(-value));
    // One over how often the way leads out of the cell.
    let mut share = zero;
    for (direction, start) in direction.into_iter().zip(start) {
        let room = select::<S>(direction.simd_gt(zero), splat(simd, 1.0 + reach) - start, start + reach);
        share = share.max(direction.abs() * reciprocal(simd, room));
    }
    let way = scale::<S>(direction, splat(simd, 1.0) / share);
    let (end, _) = field.at(simd, along::<S>(start, way, splat(simd, 1.0)));
    (way, (end * value).simd_le(zero))
}

/// A zero on the way, and the gradient there: Newton steps, bisection where they leave the bracket.
#[inline(always)]
fn root<S: Simd>(simd: S, field: &impl Interpolant<S>, bracket: Bracket<S>) -> (F3<S>, F3<S>) {
    let Bracket { start, way, mut value, mut gradient } = bracket;
    let zero = splat(simd, 0.0);
    let length = way[0].abs().max(way[1].abs()).max(way[2].abs());
    let was_inside = value.simd_ge(zero);
    let (mut low, mut high, mut t) = (zero, splat(simd, 1.0), zero);
    for _ in 0..MOST_STEPS {
        let newton = t - value * reciprocal(simd, dot::<S>(gradient, way));
        let is_within = newton.simd_gt(low) & newton.simd_lt(high);
        let halved = select::<S>(value.simd_eq(zero), t, (low + high) * 0.5);
        let following = select::<S>(is_within, newton, halved);
        let moved = (following - t).abs() * length;
        t = following;
        if !moved.simd_gt(splat(simd, LAST_STEP)).any_true() {
            break;
        }
        (value, gradient) = field.at(simd, along::<S>(start, way, t));
        let is_before = !(value.simd_ge(zero) ^ was_inside);
        low = select::<S>(is_before, t, low);
        high = select::<S>(is_before, high, t);
    }
    (along::<S>(start, way, t), gradient)
}
