//! Case 3: through a splat.

use super::setups::*;
use super::{Case, Findings};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DMat3, DVec2, DVec3, Mat3};
use oblate_engine::footprint::{CameraSplat, Footprint, Lens};
use oblate_engine::{Camera, Cloud, OpacityFilter, Order, ReferenceKind};

pub(super) const CASE: Case = Case {
    number: 3,
    title: "Through a splat",
    criterion: "The camera goes through a splat of σ = 1 in 200 steps, from 5σ before its centre to 5σ behind. Every pixel is finite; a frame changes at most twice as much as the truth does and is within the tolerance of 1/255 of it, with a near plane too; the picture never flashes: its mean opacity is within 1/255 of the truth's.",
    run,
};

const SIDE: u32 = 16;
const FRAMES: usize = 201;
/// Where rays through the centre get the opacity 1 − e⁻².
const DEPTH: f32 = 2.0;

/// The picture is 60° wide.
fn camera() -> Camera {
    let focal = f64::from(SIDE) / 2.0 / 30f64.to_radians().tan();
    ahead(focal, DVec2::splat(f64::from(SIDE) / 2.0), SIDE)
}

/// What is gone through, by its distance, and how others draw it.
struct Splat {
    name: &'static str,
    cloud: fn(DVec3) -> Cloud,
    other: &'static str,
    others: fn(&CameraSplat, &Lens) -> Vec<f64>,
}

/// The affine form alone: the kernel as large as at its centre, and gone when that is behind the camera.
fn affine(splat: &CameraSplat, lens: &Lens) -> Vec<f64> {
    let seen = Footprint::new(splat, lens).filter(|_| splat.center.z > 0.0);
    let Some(footprint) = seen else { return vec![0.0; (SIDE * SIDE) as usize] };
    let mass = f64::from(mass_of(DEPTH, Mat3::IDENTITY));
    let peak = mass * footprint.unit_integral * footprint.center_ray.length();
    let opacity = |pixel| 1.0 - (-peak * (-0.5 * footprint.affine(pixel - footprint.mean).r).exp()).exp();
    pixel_centers(SIDE).map(opacity).collect()
}

fn trained(splat: &CameraSplat, lens: &Lens) -> Vec<f64> {
    let peak = f64::from(1.0 - (-DEPTH).exp());
    let steepest = 1.3 * 30f64.to_radians().tan();
    linearized(splat, lens, steepest, SIDE).into_iter().map(|alpha| peak * alpha).collect()
}

const SPLATS: [Splat; 2] = [
    Splat {
        name: "volume kernel",
        cloud: |center| {
            let mass = mass_of(DEPTH, Mat3::IDENTITY);
            kernels(vec![center.as_vec3()], Mat3::IDENTITY, mass, [1.0; 3])
        },
        other: "affine (EWA), by its centre",
        others: affine,
    },
    Splat {
        name: "trained Gaussian",
        cloud: |center| kernel(center, Mat3::IDENTITY, 1.0 - (-DEPTH).exp(), OpacityFilter::Classic),
        other: "3DGS",
        others: trained,
    },
];

/// What a method shows on the way through, beside the truth.
struct Way {
    /// Mean opacity of each frame.
    means: Vec<f64>,
    errors: Vec<f64>,
    steps: Vec<f64>,
    /// Frames with a pixel that isn't finite.
    broken: usize,
}

impl Way {
    fn new(frames: &[Vec<f64>], truth: &[Vec<f64>]) -> Self {
        Self {
            means: frames.iter().map(|frame| frame.iter().sum::<f64>() / frame.len() as f64).collect(),
            errors: frames.iter().zip(truth).map(|(a, b)| largest_difference(a, b)).collect(),
            steps: frames.windows(2).map(|pair| largest_difference(&pair[0], &pair[1])).collect(),
            broken: frames.iter().filter(|frame| frame.iter().any(|x| !x.is_finite())).count(),
        }
    }
}

fn run() -> Findings {
    let mut findings = Findings::default();
    let distances: Vec<f64> = steps(FRAMES, [5.0, -5.0]).collect();
    let places: Vec<DVec3> = distances.iter().map(|z| DVec3::new(0.3, 0.2, *z)).collect();
    for splat in &SPLATS {
        let frames = |frame: &dyn Fn(DVec3) -> Vec<f64>| places.iter().map(|p| frame(*p)).collect::<Vec<_>>();
        let exact = nothing_but(Order::Auto);
        let drawn = |camera: Camera, settings| {
            frames(&|p| alphas(&draw(&scene(vec![(splat.cloud)(p)]), &camera, &settings)))
        };
        let right = |camera: Camera| {
            frames(&|p| alphas(&truth(&scene(vec![(splat.cloud)(p)]), &camera, &exact, ReferenceKind::R1)))
        };
        let [true_frames, default] = [right(camera()), drawn(camera(), unshaded())];
        let near = camera().with_near(1.0).expect("a distance before the eye");
        let cut = Way::new(&drawn(near, unshaded()), &right(near));
        let lens = Lens::new(&camera(), 0.3);
        let other = frames(&|center| (splat.others)(&CameraSplat { center, factor: DMat3::IDENTITY }, &lens));
        let truth = Way::new(&true_frames, &true_frames);
        let ways = [
            ("default", Role::Default, Way::new(&default, &true_frames)),
            ("exact", Role::Ours, Way::new(&drawn(camera(), exact), &true_frames)),
            (splat.other, Role::Baseline, Way::new(&other, &true_frames)),
        ];

        // Curves go by ascending distance: from behind.
        let curve = |name: &str, role, values: &[f64]| {
            let points = distances.iter().zip(values).map(|(x, y)| [*x, y.max(FLOOR)]);
            Curve::new(name, role, points.rev().step_by(4))
        };
        let panel = |what: &str, y, bound, values: fn(&Way) -> &[f64]| Panel {
            title: format!("Through a {}: {what}", splat.name),
            x: Axis::linear("distance of the centre before the eye, σ"),
            y,
            bound,
            curves: ways.iter().map(|(name, role, way)| curve(name, *role, values(way))).collect(),
        };
        let mut means = panel("brightness", Axis::linear("mean opacity of the picture"), None, |w| &w.means);
        means.curves.insert(0, curve("truth", Role::Truth, &truth.means));
        let errors = Axis::log("largest error of opacity");
        findings.panels.extend([means, panel("error", errors, Some(LEVEL), |w| &w.errors)]);

        let truth_step = largest(truth.steps.iter().copied());
        for (name, role, way) in &ways {
            let method = format!("{name}, {}", splat.name);
            let flash = largest(way.means.iter().zip(&truth.means).map(|(a, b)| (a - b).abs()));
            let step = largest(way.steps.iter().copied()) / truth_step;
            let error = largest(way.errors.iter().copied());
            let verdicts = [
                at_most(*role, &method, "largest change in a frame over the truth's", step, 2.0),
                at_most(*role, &method, "largest error of opacity", error, LEVEL),
                at_most(*role, &method, "flash: mean opacity off by", flash, LEVEL),
            ];
            let fails = |verdict| if *role == Role::Baseline { failing(verdict) } else { verdict };
            findings.verdicts.extend(verdicts.map(fails));
            findings.verdicts.push(at_most(
                *role,
                &method,
                "frames that are not finite",
                way.broken as f64,
                0.0,
            ));
        }
        let method = format!("default, {}", splat.name);
        let error = largest(cut.errors.iter().copied());
        findings.verdicts.push(at_most(
            Role::Default,
            &method,
            "largest error of opacity, near plane at σ",
            error,
            LEVEL,
        ));
    }
    findings
}
