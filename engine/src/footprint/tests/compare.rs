//! How far the two projections of a splat may be from each other.

use super::setups::Setup;
use crate::camera::Projection;
use crate::columns::Kind;
use crate::footprint::scalar::{EVENLY_COVERED, Projector};
use crate::footprint::{CameraSplat, Footprint, Form, Lens, MOST_END, Projected};
use glam::{DVec3, Vec3};
use std::f64::consts::LN_2;

/// Roundings of single precision that one number goes through, at most, times their size.
const EPSILON: f64 = 16.0 * 6e-8;

/// How far single precision may be from double, for one splat.
struct Bounds {
    /// Camera-space lengths.
    position: f64,
    mean: f64,
    /// Half-axes in pixels.
    axis: f64,
    /// Relative, of b relative to a.
    root: [f64; 3],
    slope: f64,
    sigma: f64,
    /// Of the line integral, relative; of a filter's attenuation, in itself.
    integral: f64,
    attenuation: f64,
    /// Of its root, by which the coverage floor goes: the root of a surfel's that is seen edge-on is that of what rounding makes of it.
    root_of_attenuation: f64,
    /// Relative, of the squared longest half-axis and √|V|.
    curvature: f64,
    /// Of the estimate of a point's error.
    roundness: f64,
}

impl Bounds {
    /// With V = Σvvᵀ + h² the covariance in pixels, S = √|V|, T² its trace, Z the spread along z, and e the error of
    /// a component of v: S is the length of the vector (nᵢⱼ, h vᵢ, h²), hence off by at most 2√3 T e + √6 h e, and so
    /// on for each root of a sum of squares; V⁻¹s is off by what its numerator is, 2√3 Te·2TZ + 4SeZ + 2h²eZ, over S².
    fn new(splat: &CameraSplat, footprint: &Footprint, lens: &Lens, extent: f64) -> Self {
        let perspective = lens.projection == Projection::Perspective;
        let focal = lens.focal.x;
        let (ray, zeta, ratio) = if perspective {
            (footprint.center_ray.length(), splat.center.z.abs(), extent / splat.center.z.abs())
        } else {
            (0.0, 1.0, 1.0)
        };
        let h = lens.filter_sigma;
        let largest = (0..3).map(|i| splat.factor.col(i).length()).fold(0.0, f64::max);
        let spread = splat.factor.row(2).length();
        let e = EPSILON * largest * (1.0 + ray) * focal / zeta * ratio;
        let [a, b, c] = footprint.conic_root;
        let s = 1.0 / (a * c);
        let root_y = 1.0 / c;
        let t = (root_y * root_y + (b * b + c * c) * s * s).sqrt();
        let of_y = 2.0 * e / root_y + EPSILON;
        let of_s = e * (3.5 * t + 2.5 * h) / s + EPSILON;
        let numerator = spread * e * (7.0 * t * t + 4.0 * s + 2.0 * h * h);
        let slope = numerator / (s * s) + footprint.depth_slope.length() * (2.0 * of_s + EPSILON);
        let attenuation = footprint.filter_attenuation(splat, lens).max(0.0);
        let of_attenuation = 3.5 * t * e / s + of_s;
        let volume = spread * (3.5 * t * e + 4.0 * h * e + EPSILON * (h * h + s));
        Self {
            position: EPSILON * extent,
            mean: EPSILON * (focal * (1.0 + ray) * ratio * if perspective { 1.0 } else { extent } + 200.0),
            axis: 2.0 * e,
            root: [of_y + of_s, (2.5 * t * e * c / s) / a + (of_y + of_s) * (b / a).abs(), of_y],
            slope,
            sigma: volume / s + footprint.sigma_z * (of_s + EPSILON),
            integral: of_s + 2.0 * EPSILON * ratio * (1.0 + ray),
            attenuation: of_attenuation,
            root_of_attenuation: (attenuation + of_attenuation).sqrt() - attenuation.sqrt(),
            curvature: spread * t * slope / (zeta * zeta),
            roundness: 8.0 * (e / t + EPSILON),
        }
    }

    /// Of the logarithm of an opacity, kept as a fraction of [`MOST_END`], which is rounded twice.
    fn of_end(&self, projected: &Projected) -> f64 {
        let of_fraction = f64::from(MOST_END * f32::EPSILON);
        self.attenuation / (LN_2 * f64::from(projected.record.amplitude)) + of_fraction + EPSILON
    }
}

/// Names what differs by more than it may.
pub(super) fn compare(
    (setup, projector, splat, extent): &(&Setup, &Projector, CameraSplat, f64),
    index: usize,
    found: Option<&Projected>,
    expected: Option<&Projected>,
) -> Result<(), String> {
    let (lens, settings) = (&projector.view.lens, &setup.settings);
    let Some(footprint) = Footprint::new(splat, lens) else {
        return if found.is_none() { Ok(()) } else { Err("shows what has no area".to_owned()) };
    };
    let bounds = Bounds::new(splat, &footprint, lens, *extent);
    let perspective = lens.projection == Projection::Perspective;
    let (Some(a), Some(b)) = (found, expected) else {
        let Some(only) = found.or(expected) else { return Ok(()) };
        // One alone: where its rectangle is next to empty, it ends at the near plane, or it is seen edge-on.
        let is_slim = (0..2).any(|axis| only.rect.max[axis] - only.rect.min[axis] <= 1);
        let end = footprint.depth_range(settings.cutoff_of(&projector.columns.kind))[1]
            - projector.view.camera.near();
        let ends_at_near = end.abs() <= 2.0 * bounds.position + EPSILON * extent;
        let normal = (projector.normal_to_camera * scalar_normal(projector, index)).normalize_or_zero();
        let ray = if perspective { footprint.center_ray } else { DVec3::Z };
        let is_edge_on = setup.kind == 3
            && normal.dot(ray).abs()
                <= EPSILON * 2.0 * ray.length() * extent / splat.center.z.abs().min(*extent);
        let is_faint = setup.kind == 1 && f64::from(only.record.end()) <= bounds.of_end(only);
        let is_next_to_nothing = f64::from(only.record.amplitude).abs() < 1e-30;
        if is_slim || ends_at_near || is_edge_on || is_faint || is_next_to_nothing {
            return Ok(());
        }
        let side = if found.is_some() { "the wide" } else { "the scalar" };
        return Err(format!("only {side} projection shows {:?}, {:?}", only.record, only.rect));
    };
    let (x, y) = (&a.record, &b.record);
    if x.tag.form != y.tag.form {
        // Both forms are right where the estimate meets its share of the tolerance.
        let mut error = footprint.affine_error(setup.kind == 0, lens);
        let mut slack = 0.01 * error + 2.0 * bounds.curvature.sqrt() + bounds.curvature + EPSILON;
        if [x.tag.form, y.tag.form].contains(&Form::Point) {
            error += footprint.roundness_error();
            slack += 0.01 * error + bounds.roundness;
        }
        let off = (error - settings.tolerance / 4.0).abs();
        return if off <= slack {
            Ok(())
        } else {
            Err(format!("{:?} for {:?} at an error of {error:e}", x.tag, y.tag))
        };
    }
    let is_point = y.tag.form == Form::Point;
    let footprint = if is_point { footprint.round() } else { footprint };
    let close = |what: &str, x: f32, y: f32, bound: f64| {
        let error = (f64::from(x) - f64::from(y)).abs();
        let bound = bound + EPSILON * f64::from(y).abs();
        if error <= bound {
            Ok(())
        } else {
            Err(format!("{what}: {x:e} for {y:e}, off by {error:.2e}, bound {bound:.2e}"))
        }
    };
    for axis in 0..2 {
        close("mean", x.mean[axis], y.mean[axis], bounds.mean)?;
        close("depth slope", x.depth_slope[axis], y.depth_slope[axis], bounds.slope)?;
    }
    for i in 0..3 {
        let unit = if i == 1 { x.conic_root[0] } else { y.conic_root[i] };
        close("conic root", x.conic_root[i], y.conic_root[i], bounds.root[i] * f64::from(unit))?;
    }
    close("depth", x.depth, y.depth, bounds.position)?;
    close("σ_z", x.sigma_z, y.sigma_z, bounds.sigma)?;
    if setup.kind < 2 {
        // Surfels aren't sorted.
        close("distance", a.distance, b.distance, bounds.position)?;
    }
    if x.tag != y.tag {
        return Err(format!("{:?} for {:?}", x.tag, y.tag));
    }
    let coverage = f64::from(y.amplitude.abs()).max(
        f64::from(Vec3::from([y.amplitude_slope_or_slabs[0], y.amplitude_slope_or_slabs[1], 0.0]).length())
            * lens.focal.x,
    );
    let ratio = if perspective { extent / splat.center.z.abs() } else { 1.0 };
    let of_floor = match &projector.columns.kind {
        Kind::Surface(surface) => {
            let floor = f64::from(surface.coverage_floor);
            (EVENLY_COVERED - floor).max(0.0) / floor * bounds.root_of_attenuation
        }
        _ => 0.0,
    };
    let amplitude = match setup.kind {
        1 => bounds.attenuation + EPSILON,
        _ => coverage * (bounds.integral + of_floor + EPSILON * 2.0 * ratio * footprint.center_ray.length()),
    };
    close("amplitude", x.amplitude, y.amplitude, amplitude)?;
    if setup.kind == 1 {
        close("end", x.end(), y.end(), bounds.of_end(b))?;
    } else {
        for axis in 0..2 {
            close(
                "amplitude slope",
                x.amplitude_slope_or_slabs[axis],
                y.amplitude_slope_or_slabs[axis],
                amplitude / lens.focal.x,
            )?;
        }
    }
    compare_looks(setup, projector, (splat, index, *extent), (a, b))?;
    compare_rects(setup, (&footprint, &bounds, ratio), (a, b))
}

fn scalar_normal(projector: &Projector, index: usize) -> DVec3 {
    let factor = projector.columns.factor(index).as_dmat3();
    factor.x_axis.cross(factor.y_axis)
}

/// A direction is off by some roundings of what it is the difference of; a function of degree 3 changes by at most 6 a
/// unit, the curve of sRGB by at most 13, a highlight of exponent 20 by as much.
fn compare_looks(
    setup: &Setup,
    projector: &Projector,
    (splat, index, extent): (&CameraSplat, usize, f64),
    (a, b): (&Projected, &Projected),
) -> Result<(), String> {
    let normal = projector.columns.normal(index).as_dvec3();
    let normal = (projector.normal_to_camera * normal).normalize_or_zero();
    let own = (projector.normal_to_camera * scalar_normal(projector, index)).normalize_or_zero();
    let to_eye =
        if setup.projection == Projection::Perspective { -splat.center.normalize() } else { -DVec3::Z };
    let bound = 20.0 * EPSILON * (1.0 + 15.0 * 0.3) * extent / splat.center.length().min(extent);
    let turns = if setup.kind >= 2 { normal.dot(own) } else { normal.dot(to_eye) };
    if turns.abs() < 1e-4 && normal != DVec3::ZERO {
        // Either side may be the one that is seen.
        return Ok(());
    }
    for channel in 0..3 {
        let (x, y) = (a.record.color[channel], b.record.color[channel]);
        if f64::from((x - y).abs()) > bound * f64::from(1.0 + y.abs()) {
            return Err(format!("colour {:?} for {:?}, bound {bound:.2e}", a.record.color, b.record.color));
        }
    }
    if setup.kind < 2 {
        // Volumes have no samples.
        return Ok(());
    }
    let (x, y) = (Vec3::from(a.sample.normal), Vec3::from(b.sample.normal));
    if f64::from(x.distance(y)) > 4.0 * EPSILON || a.sample.opacity != b.sample.opacity {
        return Err(format!("{:?} for {:?}", a.sample, b.sample));
    }
    Ok(())
}

/// Rectangles differ by a pixel, or by what the exact form makes of rounding where the kernel nears the camera plane.
fn compare_rects(
    setup: &Setup,
    (footprint, bounds, ratio): (&Footprint, &Bounds, f64),
    (a, b): (&Projected, &Projected),
) -> Result<(), String> {
    let mut cutoff = if setup.kind >= 2 { setup.settings.outline } else { setup.settings.cutoff };
    if setup.kind == 1 {
        cutoff = cutoff.min(2.0 * LN_2 * f64::from(b.record.end()));
    }
    let exact = b.record.tag.form == Form::Exact;
    let [_, half] = footprint.bounds(cutoff, exact);
    if !half.is_finite() {
        return if a.rect == b.rect { Ok(()) } else { Err(format!("{:?} for {:?}", a.rect, b.rect)) };
    }
    let near = footprint.depth_range(cutoff);
    let reach = (near[1] - near[0]) * 0.5 * footprint.inverse_depth;
    let widening = if exact { 1.0 / (1.0 - reach * reach) } else { 1.0 };
    // A cut-off that nears 0 moves by as much as its peak does.
    let of_cutoff = if setup.kind == 1 { 2.0 * LN_2 * bounds.of_end(b) } else { 0.0 };
    for axis in 0..2 {
        let root = half[axis];
        let of_half = bounds.axis * cutoff.sqrt()
            + root * EPSILON
            + (half[axis].powi(2) * of_cutoff / cutoff.max(1e-9)).sqrt();
        let slack =
            bounds.mean + widening * (of_half + half[axis] * EPSILON * ratio * widening * (1.0 + reach));
        let slack = if exact { slack + widening * root.sqrt() * bounds.axis.sqrt() } else { slack };
        let allowed = 1 + slack.min(1e6) as i32;
        for (x, y) in [(a.rect.min, b.rect.min), (a.rect.max, b.rect.max)] {
            if (i32::from(x[axis]) - i32::from(y[axis])).abs() > allowed {
                return Err(format!("{:?} for {:?}, {allowed} pixels allowed", a.rect, b.rect));
            }
        }
    }
    Ok(())
}
