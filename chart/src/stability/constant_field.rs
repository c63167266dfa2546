//! Case 8: a constant field.

use super::setups::*;
use super::{Case, Findings};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DMat3, DVec3, Vec3};
use oblate_engine::{
    Camera, Cloud, FootprintForm, Frame, Order, Pose, ReferenceKind, RenderSettings, Shapes,
};
use oblate_volumes::{
    ColorSpace, ControlPoint, GridFrame, KernelSettings, StrengthKind, TransferFunction, Volume, Voxels,
    to_kernels,
};
use std::f64::consts::PI;

pub(super) const CASE: Case = Case {
    number: 8,
    title: "A constant field",
    criterion: "A grid of equal voxels seen from 0 to 90°, also where axes are stretched, is even: its optical depth ripples by at most 1 % from peak to peak and its mean opacity is within 0.5 % of 1 − e^(−τL). Turning past 45°, no pixel jumps by more than 2/255 beyond what the true picture changes. A marked voxel lies where the file's axes say, within 0.02 of its shortest step.",
    run,
};

const VOXELS: usize = 16;
const SIDE: u32 = 24;
/// Per voxel.
const EXTINCTION: f64 = 0.05;

/// Where the lattice's kernels have a σ of their own, in voxels.
fn field(spacing: DVec3, sigma: f64) -> Cloud {
    let mut splats = fog([VOXELS; 3], spacing, EXTINCTION, [1.0; 3]).splats();
    splats.shapes = Shapes::Shared(glam::Mat3::from_diagonal((spacing * sigma).as_vec3()));
    Cloud::new(splats).expect("a lattice is in range")
}

/// From so many degrees about the y axis, parallel rays.
fn view(degrees: f64, height: f64, size: u32) -> Camera {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let pose = Pose::look_at(DVec3::new(sin, 0.0, -cos) * 60.0, DVec3::ZERO, DVec3::Y).expect("eyes differ");
    Camera::orthographic(pose, height, [size; 2]).expect("sizes are in range")
}

/// The optical depth at each column: the box of voxels, blurred by their kernel, integrated along the ray in steps of σ/2, which
/// for Gaussians is right to e^(−8π²).
fn true_depths(camera: &Camera, spacing: DVec3, sigma: f64) -> Vec<f64> {
    let to_world = camera.pose().world_to_camera.inverse();
    let half = 0.5 * VOXELS as f64;
    let inside = |x: f64| {
        let phi = |x: f64| 0.5 * libm::erfc(-x / sigma * std::f64::consts::FRAC_1_SQRT_2);
        phi(x + half) - phi(x - half)
    };
    let step = 0.5 * sigma * spacing.min_element();
    let reach = (1.5 * half * spacing.length() / step) as i32;
    let column = |x: u32| {
        let across = (f64::from(x) + 0.5 - camera.intrinsics().center.x) / camera.intrinsics().focal.x;
        let at = |i: i32| {
            let p = to_world.transform_point3(DVec3::new(across, 0.0, 60.0 + step * f64::from(i))) / spacing;
            inside(p.x) * inside(p.y) * inside(p.z)
        };
        EXTINCTION * step * (-reach..=reach).map(at).sum::<f64>()
    };
    (0..SIDE).map(column).collect()
}

/// How far the optical depth of a row goes up and down, as a share of its mean, and how far the mean opacity is off.
fn evenness(frame: &Frame, depths: &[f64]) -> [f64; 2] {
    let alphas = alphas(frame);
    let ripple = |row: &[f64]| {
        let shares: Vec<f64> = row.iter().zip(depths).map(|(a, depth)| -(-a).ln_1p() / depth).collect();
        let least = shares.iter().copied().fold(f64::INFINITY, f64::min);
        (largest(shares.iter().copied()) - least) * shares.len() as f64 / shares.iter().sum::<f64>()
    };
    let expected: f64 = depths.iter().map(|depth| -(-depth).exp_m1()).sum::<f64>() * f64::from(SIDE);
    [largest(alphas.chunks(SIDE as usize).map(ripple)), (alphas.iter().sum::<f64>() / expected - 1.0).abs()]
}

/// Worst of all views, of an even and a stretched grid, and the curve over the views of the first.
fn turned(settings: &RenderSettings, sigma: f64) -> ([f64; 2], Vec<[f64; 2]>) {
    let (mut worst, mut curve) = ([0.0_f64; 2], Vec::new());
    for spacing in [DVec3::ONE, DVec3::new(1.0, 1.5, 2.0)] {
        let scene = scene(vec![field(spacing, sigma)]);
        for degrees in steps(46, [0.0, 90.0]) {
            // A third of the box's narrowest width, so that rays miss its upper and lower side.
            let camera = view(degrees, 4.0, SIDE);
            let found = evenness(&draw(&scene, &camera, settings), &true_depths(&camera, spacing, sigma));
            worst = [worst[0].max(found[0]), worst[1].max(found[1])];
            if spacing == DVec3::ONE {
                curve.push([degrees, found[0].max(FLOOR)]);
            }
        }
    }
    (worst, curve)
}

/// Ripple seen along an axis, over the kernels' σ.
fn narrow_and_wide(settings: &RenderSettings) -> Vec<[f64; 2]> {
    let ripple = |sigma: f64| {
        let camera = view(0.0, 4.0, SIDE);
        let frame = draw(&scene(vec![field(DVec3::ONE, sigma)]), &camera, settings);
        [sigma, evenness(&frame, &true_depths(&camera, DVec3::ONE, sigma))[0].max(FLOOR)]
    };
    steps(33, [0.4, 0.8]).map(ripple).collect()
}

/// Largest changes from a view to the next around 45°, of a box of two colours by cubes of two voxels.
/// Yuan, Chen et al., *Hybrid Forward Resampling and Volume Rendering*, 2003.
fn changes(picture: impl Fn(&Camera) -> Frame) -> Vec<[f64; 2]> {
    let views: Vec<f64> = steps(41, [43.0, 47.0]).collect();
    let frames: Vec<Frame> = views.iter().map(|degrees| picture(&view(*degrees, 6.0, 10))).collect();
    let pairs = frames.windows(2).zip(&views);
    pairs.map(|(pair, degrees)| [*degrees, apart(&pair[0], &pair[1]).max_error.max(FLOOR)]).collect()
}

fn checkers() -> Cloud {
    let cube = |p: Vec3| ((p + 100.0) / 2.0).floor().element_sum() as i32 % 2;
    painted(&fog([10; 3], DVec3::ONE, 0.2, [0.0; 3]), |p| [cube(p) as f32, 1.0 - cube(p) as f32, 0.5])
}

/// How far, in shortest steps, a single voxel at a corner is drawn from where the frame puts it, when `read` is what a reader makes of the frame.
fn misplaced(read: impl Fn(GridFrame) -> GridFrame) -> f64 {
    let dims = [6, 5, 4];
    // The first axis points to −x, the second to z, the third to y.
    let direction = DMat3::from_cols(DVec3::NEG_X, DVec3::Z, DVec3::Y);
    let frame = GridFrame {
        spacing: DVec3::new(0.5, 1.0, 2.0),
        origin: DVec3::new(1.0, -2.0, 0.5),
        direction,
        space: None,
    };
    let corners = [[0, 0, 0], [5, 0, 0], [0, 4, 0], [5, 4, 3]];
    let point = |value, strength| ControlPoint { value, color: [1.0; 3], strength };
    let shows_ones = TransferFunction::new(
        vec![point(0.0, 0.0), point(1.0, 1.0)],
        StrengthKind::Extinction,
        ColorSpace::Linear,
    )
    .expect("the points ascend");
    let distance = |index: [usize; 3]| {
        let mut values = vec![0.0; dims.iter().product()];
        values[(index[2] * dims[1] + index[1]) * dims[0] + index[0]] = 1.0;
        let volume = Volume::new(dims, Voxels::F32(values), read(frame)).expect("it fits");
        let cloud = to_kernels(&volume, &shows_ones, &KernelSettings::default()).expect("masses are finite");
        let camera = view(30.0, 24.0, 96);
        let alphas = alphas(&draw(&scene(vec![cloud]), &camera, &unshaded()));
        let total: f64 = alphas.iter().sum();
        let place = |i: usize| DVec3::new((i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5, 0.0);
        let seen = alphas.iter().enumerate().map(|(i, alpha)| place(i) * *alpha).sum::<DVec3>() / total;
        let at = frame.origin + direction * (frame.spacing * DVec3::from(index.map(|i| i as f64)));
        let expected = camera.pose().world_to_camera.transform_point3(at).truncate() * 4.0 + 48.0;
        (seen.truncate() - expected).length() / 4.0 / frame.spacing.min_element()
    };
    largest(corners.map(distance))
}

fn run() -> Findings {
    let fine = RenderSettings { footprint: FootprintForm::Exact, ..ordered(Order::Slabs { thickness: 1.0 }) };
    let short = RenderSettings { cutoff: 4.0, ..unshaded() };
    let (default, over_views) = turned(&unshaded(), 0.7);
    let (thinner, thinner_views) = turned(&fine, 0.7);
    let (cut, cut_views) = turned(&short, 0.7);
    let (narrow, narrow_views) = turned(&unshaded(), 0.4);

    let scene_of_two = scene(vec![checkers()]);
    let truth_changes = changes(|camera| truth(&scene_of_two, camera, &unshaded(), ReferenceKind::R1));
    let of =
        |settings: RenderSettings| changes(move |camera| draw(&scene(vec![checkers()]), camera, &settings));
    let (default_changes, fine_changes) = (of(unshaded()), of(fine));
    let sheet_changes = of(ordered(Order::AxisSheets { spacing: 1.0 / 0.7 }));
    let beyond = |curve: &[[f64; 2]]| largest(curve.iter().zip(&truth_changes).map(|(a, b)| a[1] - b[1]));

    let even = |role, method, found| at_most(role, method, "ripple from peak to peak, share", found, 0.01);
    let mean = |role, method, found| at_most(role, method, "mean opacity off, share", found, 0.005);
    let jump = |role, method, curve: &[[f64; 2]]| {
        at_most(role, method, "largest change at 45° beyond the true one", beyond(curve), 2.0 * LEVEL)
    };
    let place =
        |role, method, found| at_most(role, method, "marked voxel off, in its shortest step", found, 0.02);
    let half_a_voxel = |frame: GridFrame| GridFrame {
        origin: frame.origin + frame.direction * (0.5 * frame.spacing),
        ..frame
    };
    let verdicts = vec![
        even(Role::Default, "default", default[0]),
        even(Role::Ours, "exact, slabs of 1 σ", thinner[0]),
        failing(even(Role::Baseline, "cut off at 2 σ", cut[0])),
        failing(even(Role::Baseline, "kernels of 0.4 voxels", narrow[0])),
        mean(Role::Default, "default", default[1]),
        mean(Role::Ours, "exact, slabs of 1 σ", thinner[1]),
        jump(Role::Default, "default", &default_changes),
        jump(Role::Ours, "exact, slabs of 1 σ", &fine_changes),
        failing(jump(Role::Baseline, "sheets along an axis", &sheet_changes)),
        place(Role::Default, "default", misplaced(|frame| frame)),
        failing(place(
            Role::Baseline,
            "directions of axes not read",
            misplaced(|frame| GridFrame { direction: DMat3::IDENTITY, ..frame }),
        )),
        failing(place(Role::Baseline, "samples taken for corners", misplaced(half_a_voxel))),
    ];

    let estimate = steps(33, [0.4, 0.8]).map(|sigma| [sigma, 4.0 * (-2.0 * PI * PI * sigma * sigma).exp()]);
    let panels = vec![
        Panel {
            title: "Ripple of a constant field along a row, seen along an axis".into(),
            x: Axis::linear("σ of the kernels, voxels"),
            y: Axis::log("ripple of the optical depth from peak to peak, share"),
            bound: Some(0.01),
            curves: vec![
                Curve::new("default", Role::Default, narrow_and_wide(&unshaded())),
                Curve::new(
                    "cut off at 4.9 σ",
                    Role::Ours,
                    narrow_and_wide(&RenderSettings { cutoff: 24.0, ..unshaded() }),
                ),
                Curve::new("cut off at 2 σ", Role::Baseline, narrow_and_wide(&short)),
                Curve::new("4 exp(−2π²σ²)", Role::Estimate, estimate),
            ],
        },
        Panel {
            title: "Ripple of a constant field from all sides".into(),
            x: Axis::linear("degrees from an axis"),
            y: Axis::log("ripple of the optical depth from peak to peak, share"),
            bound: Some(0.01),
            curves: vec![
                Curve::new("default", Role::Default, over_views),
                Curve::new("exact, slabs of 1 σ", Role::Ours, thinner_views),
                Curve::new("cut off at 2 σ", Role::Baseline, cut_views),
                Curve::new("kernels of 0.4 voxels", Role::Baseline, narrow_views),
            ],
        },
        Panel {
            title: "Turning past 45° by 0.1° a frame: a box of two colours".into(),
            x: Axis::linear("degrees from an axis"),
            y: Axis::log("largest change of a channel from frame to frame"),
            bound: None,
            curves: vec![
                Curve::new("default", Role::Default, default_changes),
                Curve::new("exact, slabs of 1 σ", Role::Ours, fine_changes),
                Curve::new("sheets along an axis", Role::Baseline, sheet_changes),
                Curve::new("true picture", Role::Truth, truth_changes),
            ],
        },
    ];
    Findings { panels, verdicts }
}
