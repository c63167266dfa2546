//! Case 9: single precision.

use super::setups::*;
use super::{Case, Findings};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DMat3, DQuat, DVec2, DVec3, Mat3, Vec3};
use oblate_engine::{
    Camera, FootprintForm, Intrinsics, OpacityFilter, Pose, Projection, ReferenceKind, RenderSettings,
};

pub(super) const CASE: Case = Case {
    number: 9,
    title: "Single precision",
    criterion: "One splat, 10² to 10⁵ of its σ away, flattened up to 1000 times, or up to 10⁶ of its σ from the origin of the world: 99 % of the pixels are within 0.005 of the true opacity, within 0.0005 where a splat is 10⁴ σ away and the engine is asked for its best, and no offset of the world costs more than 0.001.",
    run,
};

const SIDE: u32 = 32;
const SIGMA_PX: f64 = 4.0;
const PEAK: f32 = 0.9;
/// Splats for each point of a curve, each turned another way.
const SPLATS: usize = 10;

/// One splat of σ = 1 and a camera whose picture it fills, both a long way off.
#[derive(Clone, Copy)]
struct View {
    /// From the middle of the scene, in numbers that f32 has wherever the scene is.
    center: DVec3,
    factor: Mat3,
    eye: DVec3,
    /// Turns the world to camera space.
    turn: DMat3,
    /// Where the middle of the scene is.
    offset: DVec3,
    focal: f64,
    principal: DVec2,
}

/// A splat at a distance in σ, flattened so many times, with the scene so far from the origin.
fn view(index: usize, distance: f64, flattening: f64, offset: f64) -> View {
    let normal = direction(index + 17);
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let factor =
        DMat3::from_cols(tangent, bitangent * (0.4 + 0.6 * spread(index, 0.618)), normal / flattening);
    let turn = DMat3::from_quat(DQuat::from_axis_angle(direction(index), 1.0 + index as f64));
    // Off the axis by 20°, and at eighths.
    let toward = turn.transpose() * DVec3::new(0.3, -0.2, 1.0).normalize();
    let eye = -toward * distance + direction(index + 5) * 0.3;
    let center = (direction(index + 29) * 8.0).round() / 8.0;
    let seen = turn * (center - eye);
    let focal = SIGMA_PX * seen.z;
    let principal = DVec2::splat(f64::from(SIDE) / 2.0) - seen.truncate() / seen.z * focal;
    let offset = DVec3::new(1.0, -0.75, 0.5) * (offset * 8.0).round() / 8.0;
    View { center, factor: factor.as_mat3(), eye, turn, offset, focal, principal }
}

impl View {
    fn camera(&self) -> Camera {
        let shift = -(self.turn * (self.eye + self.offset));
        let world_to_camera = glam::DAffine3::from_mat3_translation(self.turn, shift);
        let intrinsics = Intrinsics { focal: DVec2::splat(self.focal), center: self.principal };
        Camera::from_intrinsics(Pose { world_to_camera }, intrinsics, Projection::Perspective, [SIDE; 2])
            .expect("focals are in range")
    }

    /// |Δα| at the pixels of a picture by the engine.
    fn engine(&self, settings: &RenderSettings) -> Vec<f64> {
        let splat = kernel(self.center, self.factor, PEAK, OpacityFilter::Classic);
        let (scene, camera) = (scene(vec![moved(splat, self.offset)]), self.camera());
        let true_alphas = alphas(&truth(&scene, &camera, settings, ReferenceKind::R1));
        alphas(&draw(&scene, &camera, settings)).iter().zip(true_alphas).map(|(a, b)| (a - b).abs()).collect()
    }

    /// Ray directions in camera space, by pixels.
    fn rays(&self) -> impl Iterator<Item = DVec3> {
        let places = (0..SIDE * SIDE).map(|i| DVec2::new(f64::from(i % SIDE), f64::from(i / SIDE)) + 0.5);
        places.map(|pixel| ((pixel - self.principal) / self.focal).extend(1.0).normalize())
    }

    /// |Δα| of squared distances that are found in f32 from whitened centre and ray.
    fn single(&self, form: fn(Vec3, Vec3) -> f32) -> Vec<f64> {
        let whiten = (self.turn * self.factor.as_dmat3()).inverse();
        let center = whiten * (self.turn * (self.center - self.eye));
        let error = |ray: DVec3| {
            let across = whiten * ray;
            let r = center.cross(across).length_squared() / across.length_squared();
            alpha_error(f64::from(form(center.as_vec3(), across.as_vec3())), r)
        };
        self.rays().map(error).collect()
    }

    /// |Δα| where the centre is taken to camera space in f32, by a matrix with the world's origin in it; all else is exact.
    fn moved_in_single(&self) -> Vec<f64> {
        let turn = self.turn.as_mat3();
        let shift = -(self.turn * (self.eye + self.offset));
        let found = (turn * (self.center + self.offset).as_vec3() + shift.as_vec3()).as_dvec3();
        let expected = self.turn * (self.center - self.eye);
        let whiten = (self.turn * self.factor.as_dmat3()).inverse();
        let r = |center: DVec3, ray: DVec3| {
            let (center, across) = (whiten * center, whiten * ray);
            center.cross(across).length_squared() / across.length_squared()
        };
        self.rays().map(|ray| alpha_error(r(found, ray), r(expected, ray))).collect()
    }
}

/// What is not a number counts as all wrong.
fn alpha_error(found: f64, expected: f64) -> f64 {
    let alpha = |r: f64| f64::from(PEAK) * (-0.5 * r.max(0.0)).exp();
    let error = (alpha(found) - alpha(expected)).abs();
    if error.is_finite() { error } else { 1.0 }
}

/// C − B²/A, as programs have it that keep a quadratic in t.
fn difference(center: Vec3, ray: Vec3) -> f32 {
    let (a, b, c) = (ray.dot(ray), center.dot(ray), center.dot(center));
    c - b * b / a
}

/// |c × d|²/|d|².
fn cross(center: Vec3, ray: Vec3) -> f32 {
    center.cross(ray).length_squared() / ray.length_squared()
}

/// What 99 % of the pixels of all splats keep to, for each method at each x.
fn curve(xs: &[f64], at: impl Fn(usize, f64) -> View, errors: impl Fn(&View) -> Vec<f64>) -> Vec<[f64; 2]> {
    let point = |x: &f64| {
        let mut all: Vec<f64> = (0..SPLATS).flat_map(|index| errors(&at(index, *x))).collect();
        all.sort_by(f64::total_cmp);
        [*x, all[all.len() * 99 / 100].max(FLOOR)]
    };
    xs.iter().map(point).collect()
}

fn run() -> Findings {
    // The default leaves out what is below its tolerance of 1/255, which is within 0.005; the best leaves out nothing.
    let best =
        RenderSettings { footprint: FootprintForm::Exact, tolerance: 1e-6, cutoff: 30.0, ..unshaded() };
    let far = |index, x| view(index, x, 1.0, 0.0);
    let flat = |index, x| view(index, 1e3, x, 0.0);
    let away = |index, x| view(index, 100.0, 1.0, x);
    let distances: Vec<f64> = ratios(22, [1e2, 1e5]).collect();
    let flattenings: Vec<f64> = ratios(22, [1.0, 1e3]).collect();
    let offsets: Vec<f64> = ratios(22, [1e2, 1e6]).collect();
    let rows = [("default", Role::Default, unshaded()), ("exact, tolerance 10⁻⁶", Role::Ours, best)];
    let drawn = |xs: &[f64], at: fn(usize, f64) -> View| -> Vec<Curve> {
        rows.iter()
            .map(|(name, role, settings)| {
                Curve::new(*name, *role, curve(xs, at, |view| view.engine(settings)))
            })
            .collect()
    };
    let baseline = |name: &str, points| Curve::new(name, Role::Baseline, points);
    let forms = |xs: &[f64], at: fn(usize, f64) -> View| {
        [("C − B²/A in f32", difference as fn(Vec3, Vec3) -> f32), ("cross product in f32", cross)]
            .map(|(name, form)| baseline(name, curve(xs, at, |view| view.single(form))))
    };
    let mut by_distance = drawn(&distances, far);
    by_distance.extend(forms(&distances, far));
    let mut by_flattening = drawn(&flattenings, flat);
    by_flattening.extend(forms(&flattenings, flat));
    let mut by_offset = drawn(&offsets, away);
    by_offset.push(baseline("world to camera in f32", curve(&offsets, away, View::moved_in_single)));

    let worst = |curve: &Curve| largest(curve.points.iter().map(|p| p[1]));
    let up_to = |curve: &Curve| largest(curve.points.iter().filter(|p| p[0] < 1.001e4).map(|p| p[1]));
    let of = |curve: &Curve, figure: &str, found: f64, bound: f64| {
        let verdict = at_most(curve.role, &curve.name, figure, found, bound);
        if curve.role == Role::Baseline && found > bound { failing(verdict) } else { verdict }
    };
    let mut verdicts = Vec::new();
    verdicts.extend(by_distance.iter().map(|c| of(c, "|Δα| at 99 %, 10² to 10⁵ σ away", worst(c), 5e-3)));
    let best = &by_distance[1];
    verdicts.push(of(best, "|Δα| at 99 %, up to 10⁴ σ away", up_to(best), 5e-4));
    verdicts
        .extend(by_flattening.iter().map(|c| of(c, "|Δα| at 99 %, flattened up to 1000", worst(c), 5e-3)));
    // What an offset adds to the default, since what its tolerance leaves out is there without any.
    let added = |c: &Curve| worst(c) - if c.role == Role::Baseline { 0.0 } else { c.points[0][1] };
    verdicts.extend(by_offset.iter().map(|c| of(c, "|Δα| that a far world adds", added(c), 1e-3)));

    let panel = |title: &str, x: &str, curves, bound| Panel {
        title: title.into(),
        x: Axis::log(x),
        y: Axis::log("|Δα| that 99 % of the pixels keep to"),
        bound: Some(bound),
        curves,
    };
    let panels = vec![
        panel("A splat far away through a long lens", "distance in σ", by_distance, 5e-3),
        panel("A flat splat, 1000 σ away", "radius over thickness", by_flattening, 5e-3),
        panel("The scene far from the world's origin", "distance of the origin in σ", by_offset, 1e-3),
    ];
    Findings { panels, verdicts }
}
