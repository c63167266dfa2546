//! Case 2: beside the picture and through the camera plane.

use super::setups::*;
use super::{Case, Findings, Verdict};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DAffine3, DMat3, DVec2, DVec3};
use oblate_engine::footprint::{CameraSplat, Lens};
use oblate_engine::{Camera, OpacityFilter, Order, Pose, Projection, ReferenceKind, RenderSettings, Scene};

pub(super) const CASE: Case = Case {
    number: 2,
    title: "Beside the picture and through the camera plane",
    criterion: "Needles whose σ is 0.7 of their distance and a ball of 0.4 lie beside a picture of 90° and behind the camera, which turns by 0.05° a frame. Exact footprints are within 2e-3 of the truth, the default within its tolerance of 1/255; what is seen of a needle keeps its direction within 1°; no frame changes more than twice as much as the truth does.",
    run,
};

const SIDE: u32 = 24;
/// 3DGS cuts slopes off at 1.3 of the picture's half, whose tangent is 1.
const CLAMP: f64 = 1.3;
const STEP: f64 = 0.05;
/// Degrees between the view axis and the splat.
const PAN: [f64; 2] = [45.0, 110.0];
const PEAK: f64 = 0.95;

const METHODS: [(&str, Role); 5] = [
    ("default", Role::Default),
    ("exact", Role::Ours),
    ("tolerance 1/2550, cut-off 18", Role::Ours),
    ("3DGS: slopes cut off at 1.3", Role::Baseline),
    ("affine (EWA)", Role::Baseline),
];

/// What of the picture a frame's opacities show: how much, in pixels, and in which direction it is long, in degrees, if it is.
fn direction(alphas: &[f64]) -> (f64, Option<f64>) {
    let total: f64 = alphas.iter().sum();
    let seen = || alphas.iter().zip(pixel_centers(SIDE));
    let mean = seen().map(|(alpha, x)| x * *alpha).sum::<DVec2>() / total;
    let [xx, xy, yy] = seen().fold([0.0; 3], |[xx, xy, yy], (alpha, x)| {
        let d = x - mean;
        [xx + alpha * d.x * d.x, xy + alpha * d.x * d.y, yy + alpha * d.y * d.y]
    });
    let length = (xx - yy).hypot(2.0 * xy) / (xx + yy);
    (total, (length > 0.3).then(|| 0.5 * (2.0 * xy).atan2(xx - yy).to_degrees()))
}

/// What a pan shows of each method, frame by frame.
struct Pan {
    angles: Vec<f64>,
    /// Largest error of a pixel.
    errors: [Vec<f64>; 5],
    /// How far the direction is off, in degrees, where there is one.
    turned: [Vec<[f64; 2]>; 5],
    /// Largest change of a pixel since the last frame, over the largest of the truth.
    jumps: [f64; 5],
}

fn pan(factor: DMat3) -> Pan {
    let center = DVec3::new(0.0, -0.3, 1.0).normalize();
    let scene: Scene = scene(vec![kernel(center, factor.as_mat3(), PEAK as f32, OpacityFilter::Classic)]);
    let count = ((PAN[1] - PAN[0]) / STEP).round() as usize + 1;
    let angles: Vec<f64> = steps(count, PAN).collect();
    let (mut errors, mut turned): ([Vec<f64>; 5], [Vec<[f64; 2]>; 5]) = Default::default();
    let (mut largest_steps, mut last) = ([0.0_f64; 6], None::<[Vec<f64>; 6]>);
    for angle in &angles {
        let turn = DMat3::from_rotation_y(angle.to_radians());
        let pose = Pose { world_to_camera: DAffine3::from_mat3(turn) };
        let intrinsics = ahead(f64::from(SIDE) / 2.0, DVec2::splat(f64::from(SIDE) / 2.0), SIDE).intrinsics();
        let camera = Camera::from_intrinsics(pose, intrinsics, Projection::Perspective, [SIDE; 2])
            .expect("a turn is a pose");
        let splat = CameraSplat { center: turn * center, factor: turn * factor };
        let lens = Lens::new(&camera, 0.3);
        let others = [CLAMP, f64::INFINITY].map(|steepest| {
            linearized(&splat, &lens, steepest, SIDE)
                .into_iter()
                .map(|alpha| PEAK * alpha)
                .collect::<Vec<f64>>()
        });
        let [clamped, affine] = others;
        let drawn = |settings| alphas(&draw(&scene, &camera, &settings));
        let exact = nothing_but(Order::Centers);
        let finer = RenderSettings { tolerance: LEVEL / 10.0, cutoff: 18.0, ..unshaded() };
        let truth = alphas(&truth(&scene, &camera, &exact, ReferenceKind::R1));
        let pictures = [drawn(unshaded()), drawn(exact), drawn(finer), clamped, affine, truth];
        let (amount, true_direction) = direction(&pictures[5]);
        for k in 0..5 {
            errors[k].push(largest_difference(&pictures[k], &pictures[5]));
            let (_, found) = direction(&pictures[k]);
            if let (true, Some(found), Some(right)) = (amount > 5.0, found, true_direction) {
                let off = (found - right).rem_euclid(180.0);
                turned[k].push([*angle, off.min(180.0 - off)]);
            }
        }
        for (k, largest) in largest_steps.iter_mut().enumerate() {
            let step = last.as_ref().map_or(0.0, |last| largest_difference(&pictures[k], &last[k]));
            *largest = largest.max(step);
        }
        last = Some(pictures);
    }
    let jumps = [0, 1, 2, 3, 4].map(|k| largest_steps[k] / largest_steps[5]);
    Pan { angles, errors, turned, jumps }
}

/// Every so many of the points, so that a curve stays drawable, at least a little above 0.
fn thinned(points: impl Iterator<Item = [f64; 2]>, every: usize) -> Vec<[f64; 2]> {
    points.step_by(every).map(|[x, y]| [x, y.max(FLOOR)]).collect()
}

fn run() -> Findings {
    // Across the rays, and leaning towards the eye.
    let needle = |towards: DVec3| {
        let (side, up) = towards.normalize().any_orthonormal_pair();
        DMat3::from_cols(towards.normalize() * 0.7, side * 0.1, up * 0.1)
    };
    let across = pan(needle(DVec3::new(1.0, 0.4, 0.0)));
    let leaning = pan(needle(DVec3::new(1.0, -0.4, 0.8)));
    let ball = pan(DMat3::from_diagonal(DVec3::splat(0.4)));
    let named = [("needle across the rays", &across), ("leaning needle", &leaning), ("ball", &ball)];

    let x = || Axis::linear("angle between view axis and splat, degrees");
    let errors = |(name, pan): &(&str, &Pan)| Panel {
        title: format!("Beside a picture of 90°: {name}"),
        x: x(),
        y: Axis::log("largest error of opacity"),
        bound: Some(LEVEL),
        curves: (0..5)
            .map(|k| {
                let points = pan.angles.iter().zip(&pan.errors[k]).map(|(x, y)| [*x, *y]);
                Curve::new(METHODS[k].0, METHODS[k].1, thinned(points, 20))
            })
            .collect(),
    };
    let mut panels: Vec<Panel> = named.iter().map(errors).collect();
    panels.push(Panel {
        title: "Direction of what is seen of the leaning needle".into(),
        x: x(),
        y: Axis::log("degrees off"),
        bound: Some(1.0),
        curves: (0..5)
            .map(|k| {
                let points = leaning.turned[k].iter().copied();
                Curve::new(METHODS[k].0, METHODS[k].1, thinned(points, 15))
            })
            .collect(),
    });

    let pans = [&across, &leaning, &ball];
    let verdicts = |k: usize| -> [Verdict; 3] {
        let (method, role) = METHODS[k];
        let error_bound = if METHODS[k].1 == Role::Ours { 2e-3 } else { LEVEL };
        let error = largest(pans.iter().flat_map(|pan| pan.errors[k].iter().copied()));
        let turned = largest(pans[..2].iter().flat_map(|pan| pan.turned[k].iter().map(|[_, off]| *off)));
        let jump = largest(pans.iter().map(|pan| pan.jumps[k]));
        [
            at_most(role, method, "largest error of opacity", error, error_bound),
            at_most(role, method, "direction of needles, degrees off", turned, 1.0),
            at_most(role, method, "largest change in a frame over the truth's", jump, 2.0),
        ]
    };
    let ours = [0, 1, 2].into_iter().flat_map(verdicts);
    let others = [3, 4].into_iter().flat_map(verdicts).map(failing);
    Findings { panels, verdicts: ours.chain(others).collect() }
}
