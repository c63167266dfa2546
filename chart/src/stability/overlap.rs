//! Case 5: through each other.

use super::setups::*;
use super::{Case, Findings};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{Camera, Cloud, Order, Pose, ReferenceKind, RenderSettings, Shapes, Strength, settle};

pub(super) const CASE: Case = Case {
    number: 5,
    title: "Through each other",
    criterion: "Two round splats, white and black, one 0 to 3σ behind the other, optical depths from 0.1 to 4: within 1/255 of the integral. Slabs of one σ and of half a σ keep that; the default, slabs of 2σ, up to optical depths of 0.2. At 4 it is off by 0.14, where sorting is by 0.48. In which order splats are given changes nothing, even if they are in one place.",
    run,
};

const SIDE: u32 = 5;

/// Parallel rays along z, a tenth of σ apart.
fn camera() -> Camera {
    let pose =
        Pose::look_at(DVec3::NEG_Z * 20.0, DVec3::ZERO, DVec3::Y).expect("the eye is not at the origin");
    Camera::orthographic(pose, 0.1 * f64::from(SIDE), [SIDE; 2]).expect("the size is in range")
}

/// A white kernel at `z` and a black one behind it.
fn pair(z: f64, separation: f64, depth: f64) -> Vec<(Vec3, [f32; 3], f32)> {
    let mass = mass_of(depth as f32, Mat3::IDENTITY);
    vec![(Vec3::Z * z as f32, [1.0; 3], mass), (Vec3::Z * (z + separation) as f32, [0.0; 3], mass)]
}

fn cloud(kernels: &[(Vec3, [f32; 3], f32)]) -> Cloud {
    let masses = kernels.iter().map(|k| k.2).collect();
    splats(
        kernels.iter().map(|k| k.0).collect(),
        Shapes::Shared(Mat3::IDENTITY),
        Strength::Extinction { masses },
        kernels.iter().map(|k| k.1).collect(),
    )
}

/// The error against R1 where slabs lie worst.
fn error(settings: &RenderSettings, separation: f64, depth: f64) -> f64 {
    let camera = camera();
    let integral = scene(vec![cloud(&pair(0.0, separation, depth))]);
    let truth = truth(&integral, &camera, &nothing_but(settings.order), ReferenceKind::R1);
    let places = (0..8).map(|i| f64::from(i) * thickness(settings.order) / 8.0);
    largest(places.map(|z| {
        let shifted = scene(vec![cloud(&pair(z, separation, depth))]);
        apart(&draw(&shifted, &camera, settings), &truth).max_error
    }))
}

fn thickness(order: Order) -> f64 {
    match order {
        Order::Slabs { thickness } => thickness,
        _ => Order::THICKNESS,
    }
}

/// The distribution of a normal variable.
fn phi(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

/// What compositing the white one whole before the black one errs by on the ray through both centres: 1 − e^{−τ} less the
/// integral of τ φ(x) exp(−τ Φ(x) − τ Φ(x − d)) over x, in σ, by the trapezoid rule.
fn sorted_error(separation: f64, depth: f64) -> f64 {
    const STEP: f64 = 0.01;
    let sum: f64 = (-800..=800)
        .map(|i| {
            let x = STEP * f64::from(i);
            let density = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
            depth * density * (-depth * (phi(x) + phi(x - separation))).exp() * STEP
        })
        .sum();
    1.0 - (-depth).exp() - sum
}

/// The same in closed form, exact at d = 0 and, to the second order of τ, everywhere: the size of a pop times the share of the one splat
/// that lies behind the other.
fn estimated(separation: f64, depth: f64) -> f64 {
    (-depth).exp_m1().powi(2) * phi(-separation * std::f64::consts::FRAC_1_SQRT_2)
}

/// By how much the picture changes when splats are given in the other order.
fn permuted(settings: &RenderSettings, separation: f64, depth: f64) -> f64 {
    let given = pair(0.3, separation, depth);
    let reversed: Vec<_> = given.iter().copied().rev().collect();
    let frames = [given, reversed].map(|kernels| draw(&scene(vec![cloud(&kernels)]), &camera(), settings));
    apart(&frames[0], &frames[1]).max_error
}

fn run() -> Findings {
    let slabs = |thickness| ordered(Order::Slabs { thickness });
    let methods = [
        ("default", Role::Default, unshaded()),
        ("slabs of σ", Role::Ours, slabs(1.0)),
        ("slabs of σ/2, exact", Role::Ours, nothing_but(Order::Slabs { thickness: 0.5 })),
        ("by depth in each pixel", Role::Baseline, ordered(Order::PerPixel)),
        ("sorted centres", Role::Baseline, ordered(Order::Centers)),
    ];
    let separations = || steps(31, [0.0, 3.0]);
    let panel = |depth: f64| {
        let curve = |(name, role, settings): &(&str, Role, RenderSettings)| {
            Curve::new(*name, *role, separations().map(|d| [d, error(settings, d, depth).max(FLOOR)]))
        };
        let integral = separations().map(|d| [d, sorted_error(d, depth)]);
        let estimate = separations().map(|d| [d, estimated(d, depth)]);
        let computed = [
            Curve::new("sorted, by the integral", Role::Truth, integral),
            Curve::new("(1 − e^{−τ})² Φ(−d/√2σ)", Role::Estimate, estimate),
        ];
        Panel {
            title: format!("Two splats through each other, optical depth {depth} each"),
            x: Axis::linear("distance of the centres, σ"),
            y: Axis::log("largest error of a channel"),
            bound: Some(LEVEL),
            curves: methods.iter().map(curve).chain(computed).collect(),
        }
    };
    let panels = [0.1, 0.5, 1.0, 4.0].map(panel).to_vec();

    let pairs = |depths: &[f64]| -> Vec<[f64; 2]> {
        let each = |depth: &f64| [0.0, 0.25, 0.5, 1.0, 2.0, 3.0].map(|d| [d, *depth]);
        depths.iter().flat_map(each).collect()
    };
    let worst =
        |settings, pairs: &[[f64; 2]]| largest(pairs.iter().map(|[d, depth]| error(settings, *d, *depth)));
    let [faint, all] = [&[0.1, 0.2][..], &[0.1, 0.5, 1.0, 2.0, 4.0]].map(pairs);
    let mut verdicts = Vec::new();
    let settled = largest(all.iter().map(|[d, depth]| {
        let given = scene(vec![cloud(&pair(0.0, *d, *depth))]);
        let settings = settle(&given, &camera(), &unshaded()).expect("settings of cases are in range");
        error(&settings, *d, *depth)
    }));
    verdicts.push(at_most(
        Role::Ours,
        "settled by trial",
        "largest error, optical depths to 4",
        settled,
        LEVEL,
    ));
    for (name, role, settings) in &methods {
        let figure = "largest error, optical depths to";
        if *role == Role::Default {
            verdicts.push(at_most(*role, name, &format!("{figure} 0.2"), worst(settings, &faint), LEVEL));
        }
        let verdict = at_most(*role, name, &format!("{figure} 4"), worst(settings, &all), LEVEL);
        verdicts.push(if *role == Role::Ours { verdict } else { failing(verdict) });
    }
    for (name, role, settings) in &methods {
        let apart =
            largest(all.iter().filter(|[d, _]| *d > 0.0).map(|[d, depth]| permuted(settings, *d, *depth)));
        let same = permuted(settings, 0.0, 1.0);
        verdicts.push(at_most(*role, name, "change by the order of input", apart, 1e-6));
        let one_place = at_most(*role, name, "the same, in one place", same, 1e-6);
        verdicts.push(if *role == Role::Baseline { failing(one_place) } else { one_place });
    }
    let on_axis = |of: fn(f64, f64) -> f64| {
        let off = |[d, depth]: &[f64; 2]| (error(&methods[4].2, *d, *depth) - of(*d, *depth)).abs();
        largest(all.iter().map(off))
    };
    verdicts.extend([
        at_most(Role::Truth, "1-D integral", "off the error of sorted centres", on_axis(sorted_error), 5e-3),
        at_most(Role::Estimate, "closed form", "off the error of sorted centres", on_axis(estimated), 0.1),
    ]);
    Findings { panels, verdicts }
}
