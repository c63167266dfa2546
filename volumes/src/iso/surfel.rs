//! Cells to surfels: normals and half-axes.

use glam::{DMat3, Mat3, Vec3};

use super::block::Block;
use super::descent::{onto_near_surface, onto_surface};
use super::interpolant::{Tricubic, Trilinear};
use super::lanes::*;
use super::polygon::{Geometry, Polygon, polygon};
use super::stencil::{Batch, REGISTERS, corners, differences};

/// Standard deviation, in steps of the grid, of the Gaussian that blurs the polygon that a surfel stands for.
///
/// The polygons tile the surface, so each one blurred by the same Gaussian would cover it evenly. A surfel has
/// the covariance of its blurred polygon; only third moments and above are lost. On planes summed coverage
/// stays within 11 % of 1, with a surfel's standard deviation near 0.49 steps on average: what varies is divided out of colours, and
/// opacities are whole from [`ISO_COVERAGE_FLOOR`](super::ISO_COVERAGE_FLOOR) on. A wider blur covers more evenly (0.65 within 1 %) and
/// shows a softer surface, slower.
pub const SURFEL_BLUR: f64 = 0.4;

/// A sample of an iso-surface, relative to the grid's sample (0, 0, 0) along the world's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IsoSurfel {
    /// Where it is, on the surface.
    pub center: Vec3,
    /// The half-axes of its Gaussian, which are standard deviations: the longer one first, orthogonal, and their cross
    /// product points to lower values.
    pub half_axes: [Vec3; 2],
    /// The area of the surface in its cell, in squared world units.
    pub area: f32,
}

/// Numbers of a surfel.
pub(super) const NUMBERS: usize = 10;

impl IsoSurfel {
    /// A surfel's numbers, in the order of its fields.
    #[inline(always)]
    pub(super) fn new([x, y, z, u_x, u_y, u_z, v_x, v_y, v_z, area]: [f32; NUMBERS]) -> Self {
        let half_axes = [Vec3::new(u_x, u_y, u_z), Vec3::new(v_x, v_y, v_z)];
        Self { center: Vec3::new(x, y, z), half_axes, area }
    }

    /// What [`Self::new`] takes.
    pub(super) fn numbers(self) -> [f32; NUMBERS] {
        let ([x, y, z], [u, v]) = (self.center.to_array(), self.half_axes);
        [x, y, z, u.x, u.y, u.z, v.x, v.y, v.z, self.area]
    }

    /// The unit normal of the surface, towards lower values.
    pub fn normal(&self) -> Vec3 {
        let [u, v] = self.half_axes;
        // Squares of short half-axes would vanish.
        (u / u.length()).cross(v / v.length())
    }

    /// The factor of its covariance, of a thickness that makes its radius so many times as long.
    pub(super) fn factor(&self, flattening: f32) -> Mat3 {
        let [u, v] = self.half_axes;
        let is_flat = flattening == f32::INFINITY;
        let w = if is_flat { Vec3::ZERO } else { self.normal() * (v.length() / flattening) };
        Mat3::from_cols(u, v, w)
    }
}

/// How a field continues between samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// The surface of the trilinear interpolant; normals from central differences, interpolated.
    #[default]
    Trilinear,
    /// The surface of a tricubic B-spline, and its own normals: errors of smooth fields fall with the fourth power of the step, where
    /// those of the trilinear ones fall with the square. Takes two to three times as long. Its coefficients are those of the
    /// quasi-interpolant that keeps cubic polynomials, v − δ²v/6 along each axis. Where a neighbour is missing, at the grid's
    /// border and beside values that are not finite, surfels are the trilinear interpolant's.
    Tricubic,
}

impl Geometry {
    /// Of a grid with these steps.
    pub(super) fn new(steps: DMat3) -> Self {
        let unit =
            [steps.x_axis, steps.y_axis, steps.z_axis].into_iter().fold(0.0, |a: f64, s| a.max(s.length()));
        let steps = steps * unit.recip();
        let inverse = steps.inverse();
        let gradients = inverse.transpose();
        let areas = gradients * steps.determinant().abs();
        let faces = [areas.x_axis, areas.y_axis, areas.z_axis];
        let least_face = faces.into_iter().fold(f64::INFINITY, |a, face| a.min(face.length()));
        let largest = gradients.to_cols_array().into_iter().fold(0.0, |a: f64, x| a.max(x.abs()));
        let gradients = gradients * largest.recip();
        let rows = |m: DMat3| m.transpose().as_mat3().to_cols_array_2d();
        Self {
            steps: rows(steps),
            areas: rows(areas),
            gradients: rows(gradients),
            descent: rows(gradients.transpose() * gradients),
            least_area: (1e-6 * least_face) as f32,
            unit: unit as f32,
        }
    }
}

/// Appends the surfels of a batch; sheets without an area have none. A function of its own, the same for all types of samples.
#[inline(never)]
pub(super) fn add_batch<S: Simd>(simd: S, batch: &Batch, look: (&Geometry, Interpolation), out: &mut Block) {
    simd.vectorize(
        #[inline(always)]
        || add_registers(simd, batch, look, out),
    );
}

/// A register of sheets on their way.
#[derive(Clone, Copy)]
struct Sheets<S: Simd> {
    /// Numbers of any size times this are numbers near 1.
    to_unit: F<S>,
    values: [F<S>; 8],
    polygon: Polygon<S>,
    position: F3<S>,
    /// The interpolant's gradient there, and the grid's.
    gradients: [F3<S>; 2],
    normal: F3<S>,
}

impl<S: Simd> Sheets<S> {
    /// Of nothing yet. (Made stage by stage in a closure that fills an array they are ten times slower: it isn't inlined.)
    #[inline(always)]
    fn new(simd: S) -> Self {
        let zero = splat(simd, 0.0);
        let nowhere = [zero; 3];
        Self {
            to_unit: zero,
            values: [zero; 8],
            polygon: Polygon::new(simd),
            position: nowhere,
            gradients: [nowhere; 2],
            normal: nowhere,
        }
    }
}

/// Stage by stage: what a stage does to one register takes longer than it has to do.
#[inline(always)]
fn add_registers<S: Simd>(
    simd: S,
    batch: &Batch,
    (geometry, interpolation): (&Geometry, Interpolation),
    out: &mut Block,
) {
    let n = F::<S>::LEN;
    let mut all = [Sheets::new(simd); REGISTERS];
    let all = &mut all[..batch.len.div_ceil(n).min(REGISTERS)];
    for (register, sheets) in all.iter_mut().enumerate() {
        sheets.values = corners(simd, batch, register);
        let mut largest = sheets.values[0].abs();
        for value in &sheets.values[1..] {
            largest = largest.max(value.abs());
        }
        sheets.to_unit = splat(simd, 1.0) / largest;
        for value in &mut sheets.values {
            *value *= sheets.to_unit;
        }
        let inside = S::u32s::from_slice(simd, &batch.sheets[n * register..][..n]);
        sheets.polygon = polygon(simd, geometry, &sheets.values, inside);
    }
    for sheets in all.iter_mut() {
        let field = Trilinear::new(&sheets.values);
        (sheets.position, sheets.gradients[0]) =
            onto_surface(simd, geometry, &field, &sheets.values, sheets.polygon.centroid);
    }
    for (register, sheets) in all.iter_mut().enumerate() {
        let gradient = differences(simd, batch, register, sheets.position);
        sheets.gradients[1] = scale::<S>(gradient, sheets.to_unit);
    }
    if interpolation == Interpolation::Tricubic {
        for (register, sheets) in all.iter_mut().enumerate() {
            let start = (sheets.position, sheets.gradients[1]);
            let spline = (register, sheets.to_unit);
            (sheets.position, sheets.gradients[1]) = onto_spline(simd, (batch, spline), geometry, start);
        }
    }
    for sheets in all.iter_mut() {
        sheets.normal = normal(simd, geometry, sheets);
    }
    for (register, sheets) in all.iter().enumerate() {
        let first = n * register;
        let axes = half_axes(simd, geometry, &sheets.polygon, sheets.normal);
        let is_there = sheets.polygon.area.simd_ge(splat(simd, geometry.least_area))
            & M::<S>::from_bitmask(simd, (1 << (batch.len - first).min(n)) - 1);
        let unit = splat(simd, geometry.unit);
        let in_grid = [
            corner(simd, &batch.cells[0][first..][..n]) + sheets.position[0],
            corner(simd, &batch.cells[1][first..][..n]) + sheets.position[1],
            corner(simd, &batch.cells[2][first..][..n]) + sheets.position[2],
        ];
        let [x, y, z] = scale::<S>(times(simd, &geometry.steps, in_grid), unit);
        let [u_x, u_y, u_z] = scale::<S>(axes[0], unit);
        let [v_x, v_y, v_z] = scale::<S>(axes[1], unit);
        let area = sheets.polygon.area * unit * unit;
        out.push::<S>(&[x, y, z, u_x, u_y, u_z, v_x, v_y, v_z, area], is_there);
    }
}

/// Differences can vanish, or point the wrong way, where the field varies from sample to sample; the interpolant's own gradient
/// and the polygon are the safe steps.
#[inline(always)]
fn normal<S: Simd>(simd: S, geometry: &Geometry, sheets: &Sheets<S>) -> F3<S> {
    let vector_area = sheets.polygon.vector_area;
    let [slope, gradient] = sheets.gradients;
    let (normal, is_right) = facing(simd, geometry, gradient, vector_area);
    if is_right.all_true() {
        return normal;
    }
    let (by_slope, is_slope_right) = facing(simd, geometry, slope, vector_area);
    let safe = select3::<S>(is_slope_right, by_slope, normalize(simd, vector_area));
    select3::<S>(is_right, normal, safe)
}

#[inline(always)]
fn corner<S: Simd>(simd: S, cells: &[u32]) -> F<S> {
    S::u32s::from_slice(simd, cells).to_float()
}

/// From the trilinear surface onto the spline's, and the gradient there; where it isn't near both stay as they are.
#[inline(never)]
fn onto_spline<S: Simd>(
    simd: S,
    (batch, (register, to_unit)): (&Batch, (usize, F<S>)),
    geometry: &Geometry,
    (position, gradient): (F3<S>, F3<S>),
) -> (F3<S>, F3<S>) {
    simd.vectorize(
        #[inline(always)]
        || {
            let spline = Tricubic::new(simd, batch, register, to_unit);
            let (near, slope, found) = onto_near_surface(simd, geometry, &spline, position);
            (near, select3::<S>(found, slope, gradient))
        },
    )
}

/// The unit normal down a gradient, given in cells, and whether it is on the side of a polygon's vector area.
#[inline(always)]
fn facing<S: Simd>(simd: S, geometry: &Geometry, gradient: F3<S>, side: F3<S>) -> (F3<S>, M<S>) {
    let down = scale::<S>(times(simd, &geometry.gradients, gradient), splat(simd, -1.0));
    let normal = normalize(simd, down);
    // Where nothing can be made of the gradient this is NaN.
    let is_right =
        dot::<S>(normal, side).simd_gt(splat(simd, 0.0)) & dot::<S>(normal, normal).simd_lt(splat(simd, 2.0));
    (normal, is_right)
}

/// The half-axes, longer one first, of the Gaussian in the plane across `normal` that has the covariance of the polygon blurred
/// by [`SURFEL_BLUR`]. The blur is even in steps of the grid.
#[inline(always)]
fn half_axes<S: Simd>(simd: S, geometry: &Geometry, polygon: &Polygon<S>, normal: F3<S>) -> [F3<S>; 2] {
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let [t1, t2] = tangents(simd, normal);
    // Directions of the world, as numbers of steps along them: by the transpose of what takes steps to the world.
    let (q1, q2) = (in_steps(simd, geometry, t1), in_steps(simd, geometry, t2));
    let across = normalize(simd, in_steps(simd, geometry, normal));
    let (p1, p2) =
        (covariance_times::<S>(&polygon.covariance, q1), covariance_times::<S>(&polygon.covariance, q2));
    let (a1, a2) = (dot::<S>(q1, across), dot::<S>(q2, across));
    let blur = (SURFEL_BLUR * SURFEL_BLUR) as f32;
    let c11 = dot::<S>(q1, p1) + (dot::<S>(q1, q1) - a1 * a1) * blur;
    let c12 = dot::<S>(q1, p2) + (dot::<S>(q1, q2) - a1 * a2) * blur;
    let c22 = dot::<S>(q2, p2) + (dot::<S>(q2, q2) - a2 * a2) * blur;
    let (mean, half) = ((c11 + c22) * 0.5, (c11 - c22) * 0.5);
    let spread = half.mul_add(half, c12 * c12).sqrt();
    let (a, b) = ((mean + spread).sqrt(), (mean - spread).max(zero).sqrt());
    // The angle of the longer axis is half of that of (half, c12); of a circle any will do.
    let is_circle = spread.simd_le(mean * 1e-6);
    let share = select::<S>(is_circle, one, half.abs() * reciprocal(simd, spread));
    let larger = share.mul_add(splat(simd, 0.5), splat(simd, 0.5)).sqrt();
    let smaller = select::<S>(is_circle, zero, c12 * reciprocal(simd, spread * larger * 2.0));
    let is_along = half.simd_ge(zero);
    let cosine = select::<S>(is_along, larger, smaller.abs());
    let sine = select::<S>(is_along, smaller, larger.copysign(smaller));
    let e1 = along::<S>(scale::<S>(t1, cosine), t2, sine);
    let e2 = along::<S>(scale::<S>(t2, cosine), t1, -sine);
    [scale::<S>(e1, a), scale::<S>(e2, b)]
}

/// The transpose of the steps times `v`.
#[inline(always)]
fn in_steps<S: Simd>(simd: S, geometry: &Geometry, v: F3<S>) -> F3<S> {
    let mut sum = [splat(simd, 0.0); 3];
    for (row, v) in geometry.steps.iter().zip(v) {
        for (sum, step) in sum.iter_mut().zip(row) {
            *sum = v.mul_add(splat(simd, *step), *sum);
        }
    }
    sum
}

/// A symmetric matrix xx, yy, zz, yz, zx, xy times `v`.
#[inline(always)]
fn covariance_times<S: Simd>(m: &[F<S>; 6], v: F3<S>) -> F3<S> {
    [dot::<S>([m[0], m[5], m[4]], v), dot::<S>([m[5], m[1], m[3]], v), dot::<S>([m[4], m[3], m[2]], v)]
}

/// Two unit vectors t₁, t₂ across unit normals, t₁ × t₂ = n. Duff, Burgess, Christensen, Hery, Kensler, Liani, Villemin, *Building an
/// Orthonormal Basis, Revisited*, 2017.
#[inline(always)]
fn tangents<S: Simd>(simd: S, [x, y, z]: F3<S>) -> [F3<S>; 2] {
    let one = splat(simd, 1.0);
    let sign = one.copysign(z);
    let a = -reciprocal(simd, sign + z);
    let b = x * y * a;
    [[(sign * x * x).mul_add(a, one), sign * b, -sign * x], [b, (y * y).mul_add(a, sign), -y]]
}
