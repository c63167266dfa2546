//! Simple shapes as triangles, with normals and texture coordinates.

use crate::mesh::{BaseColor, Primitive};
use glam::{DAffine3, DVec3, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// A square of side 2 in the plane y = 0 around the origin, facing +Y, of `cells * cells` squares.
///
/// The texture's top left corner lies at (−1, 0, −1), u runs along x, v along z.
pub fn plane(cells: u32) -> Primitive {
    let at = |u: f64, v: f64| (DVec3::new(2.0 * u - 1.0, 0.0, 2.0 * v - 1.0), DVec3::Y);
    patch([cells, cells], [1.0, 1.0], [false, false], at)
}

/// A sphere of radius 1 around the origin: `segments` (at least 3) around +Y, half as many from pole to
/// pole. The texture goes once around it, its top row at +Y.
pub fn sphere(segments: u32) -> Primitive {
    let segments = segments.max(3);
    let at = |u: f64, v: f64| {
        let around = DVec3::new(turn(u).0, 0.0, turn(u).1);
        // sin π is 0 here, so that the pole is one place.
        let (sin, cos) = if v == 1.0 { (0.0, -1.0) } else { (PI * v).sin_cos() };
        let normal = around * sin + DVec3::Y * cos;
        (normal, normal)
    };
    patch([segments, (segments / 2).max(2)], [1.0, 1.0], [true, false], at)
}

/// A torus knot that winds `p` times around the +Y axis and `q` times around its own ring, on a ring of
/// radius 1 and thickness 0.4, its tube of radius `tube`; `segments` (at least 3) along the knot and around
/// the tube. With `q` = 0 and `p` = 1 it is a torus.
///
/// The texture is repeated along the knot so that it is about as long as it is wide.
pub fn torus_knot(p: u32, q: u32, tube: f64, segments: [u32; 2]) -> Primitive {
    let [p, q] = [p, q].map(f64::from);
    let curve = |t: f64| {
        let (around, along) = (p * t, q * t);
        let ring = if q == 0.0 { 1.0 } else { 1.0 + 0.4 * turn(along).1 };
        let height = if q == 0.0 { 0.0 } else { 0.4 * turn(along).0 };
        DVec3::new(ring * turn(around).1, height, ring * turn(around).0)
    };
    let tangent = |t: f64| (curve(t + 1e-5) - curve(t - 1e-5)).normalize();
    let segments = segments.map(|n| n.max(3));
    let steps = 4 * segments[0];
    let at_step = |i: u32| curve(f64::from(i) / f64::from(steps));
    let length: f64 = (0..steps).map(|i| at_step(i).distance(at_step(i + 1))).sum();
    let repeats = (length / (TAU * tube)).round().max(1.0);
    let at = |u: f64, v: f64| {
        // Away from the middle of the ring that the knot winds around: periodic, never along the tangent.
        let u = u.fract();
        let (center, forward) = (curve(u), tangent(u));
        let (sin, cos) = turn(p * u);
        let out = center - DVec3::new(cos, 0.0, sin);
        let out = if q == 0.0 { DVec3::Y } else { out };
        let out = out.reject_from_normalized(forward).normalize();
        let (sin, cos) = turn(v);
        let normal = out * cos + forward.cross(out) * sin;
        (center + normal * tube, normal)
    };
    patch(segments, [repeats, 1.0], [true, true], at)
}

/// Sine and cosine of a number of turns; whole turns give exactly the same.
fn turn(turns: f64) -> (f64, f64) {
    (TAU * turns.rem_euclid(1.0)).sin_cos()
}

/// A surface over (u, v) in [0, 1]² that gives position and normal, ∂u × ∂v inward; texture coordinates are
/// multiplied by `repeats`. Along a `wrapped` axis 1 is the same place as 0, with its own coordinates.
fn patch(
    [columns, rows]: [u32; 2],
    repeats: [f64; 2],
    wrapped: [bool; 2],
    at: impl Fn(f64, f64) -> (DVec3, DVec3),
) -> Primitive {
    let (columns, rows) = (columns.max(1), rows.max(1));
    let (mut positions, mut normals, mut tex_coords) = (Vec::new(), Vec::new(), Vec::new());
    for j in 0..=rows {
        for i in 0..=columns {
            let (u, v) = (f64::from(i) / f64::from(columns), f64::from(j) / f64::from(rows));
            let fold = |v: f64, wrapped: bool| if wrapped && v == 1.0 { 0.0 } else { v };
            let (position, normal) = at(fold(u, wrapped[0]), fold(v, wrapped[1]));
            positions.push(position.as_vec3());
            normals.push(normal.as_vec3());
            tex_coords.push(Vec2::new((u * repeats[0]) as f32, (v * repeats[1]) as f32));
        }
    }
    let mut triangles = Vec::new();
    for j in 0..rows {
        for i in 0..columns {
            let corner = j * (columns + 1) + i;
            let [a, b, c, d] = [corner, corner + 1, corner + columns + 1, corner + columns + 2];
            let degenerate = |t: &[u32; 3]| {
                let [a, b, c]: [Vec3; 3] = t.map(|vertex| positions[vertex as usize]);
                a == b || b == c || c == a
            };
            triangles.extend([[a, c, b], [b, c, d]].into_iter().filter(|t| !degenerate(t)));
        }
    }
    Primitive {
        positions,
        triangles,
        normals: Some(normals),
        tex_coords: Some(tex_coords),
        colors: None,
        material: BaseColor::default(),
        alpha_cutoff: None,
        unlit: false,
        double_sided: true,
        primitive_to_mesh: DAffine3::IDENTITY,
    }
}
