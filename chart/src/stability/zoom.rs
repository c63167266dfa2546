//! Case 6: zoom.

use super::setups::*;
use super::{Case, Findings};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{
    Camera, Cloud, Frame, OpacityFilter, Order, Pose, ReferenceKind, RenderSettings, Scene, Shapes, Strength,
};

pub(super) const CASE: Case = Case {
    number: 6,
    title: "Zoom",
    criterion: "A splat whose σ is 0.05 to 5 pixels keeps its light within 1 %, wherever it lies between pixels; a textured plane of surfels seen at 1/16 to 16 times its size is within 40 dB of what 256 rays a pixel see, and no more than 1 % brighter or darker. Trained Gaussians are cut off at an eighth of 1/255 by default: of the smallest, 5 % of the light is lost, at the worst place 10 %; at a finer tolerance 1.2 % of ripple is left there.",
    run,
};

/// Pixels along a side of pictures of one splat, and of the plane.
const SIDE: u32 = 40;
const PLANE_SIDE: u32 = 5;
const PEAK: f32 = 0.9;
/// Surfels along a side of the plane: it fills the picture when 16 of them are a pixel wide.
const SURFELS: usize = 16 * PLANE_SIDE as usize * 3 / 2;

/// Which splat is drawn small, and how.
struct Way {
    name: &'static str,
    role: Role,
    /// `None` is a volume kernel.
    filter: Option<OpacityFilter>,
    tolerance: f64,
}

const WAYS: [Way; 4] = [
    Way { name: "default, volume kernel", role: Role::Default, filter: None, tolerance: LEVEL },
    Way {
        name: "default, trained, compensated",
        role: Role::Default,
        filter: Some(OpacityFilter::Compensated),
        tolerance: LEVEL,
    },
    Way {
        name: "the same, tolerance 1e-6",
        role: Role::Ours,
        filter: Some(OpacityFilter::Compensated),
        tolerance: 1e-6,
    },
    Way {
        name: "3DGS: 0.3 px², not compensated",
        role: Role::Baseline,
        filter: Some(OpacityFilter::Classic),
        tolerance: 1e-6,
    },
];

/// What the pixels have of a splat's energy, 2πσ²o, in the mean over places between pixels; and how far it is off at the worst one.
fn energy(way: &Way, sigma: f64) -> [f64; 2] {
    let pose =
        Pose::look_at(DVec3::NEG_Z * 50.0, DVec3::ZERO, DVec3::Y).expect("the eye is not at the origin");
    let camera = Camera::orthographic(pose, f64::from(SIDE), [SIDE; 2]).expect("the size is in range");
    let factor = Mat3::from_diagonal(Vec3::splat(sigma as f32));
    let settings = RenderSettings { tolerance: way.tolerance, ..unshaded() };
    let shares: Vec<f64> = (0..16)
        .map(|i| {
            let center = DVec3::new(f64::from(i % 4), f64::from(i / 4), 0.0) / 4.0;
            let cloud = match way.filter {
                Some(filter) => kernel(center, factor, PEAK, filter),
                None => kernels(vec![center.as_vec3()], factor, mass_of(PEAK, factor), [1.0; 3]),
            };
            let drawn = alphas(&draw(&scene(vec![cloud]), &camera, &settings));
            // Of a volume it is the optical depths that add up.
            let amount = |alpha: f64| if way.filter.is_none() { -(-alpha).ln_1p() } else { alpha };
            let sum: f64 = drawn.into_iter().map(amount).sum();
            sum / (std::f64::consts::TAU * sigma * sigma * f64::from(PEAK))
        })
        .collect();
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    [mean, largest(shares.iter().map(|share| (share - 1.0).abs()))]
}

/// A surfel a unit: checks two surfels wide in red, grains in green, waves in blue.
fn textured() -> Cloud {
    let mut splats = plane(SURFELS, 1.0, [0.0; 3]).splats();
    let mut state = 1u32;
    let mut grain = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let color = |i: usize| {
        let [x, y] = [i % SURFELS, i / SURFELS];
        let wave = (x as f32 * 0.2).sin() * (y as f32 * 0.5).cos();
        [((x / 2 + y / 2) % 2) as f32, grain(), 0.5 + 0.5 * wave]
    };
    splats.colors = (0..SURFELS * SURFELS).map(color).collect();
    Cloud::new(splats).expect("colours are in range")
}

/// The same plane as trained Gaussians without compensation.
fn trained(plane: &Cloud) -> Cloud {
    let mut splats = plane.splats();
    splats.strength =
        Strength::Opacity { peaks: vec![0.95; plane.len()], filter: OpacityFilter::Classic, least: 0.0 };
    splats.shapes = Shapes::Shared(Mat3::from_diagonal(Vec3::new(0.6, 0.6, 0.0)));
    splats.normals = None;
    Cloud::new(splats).expect("peaks are in range")
}

/// Sees the plane at a slant, so many surfels a pixel in the middle.
fn view(per_pixel: f64) -> Camera {
    let distance = per_pixel * f64::from(PLANE_SIDE) / (2.0 * 15f64.to_radians().tan());
    let target = DVec3::new(0.3, 0.2, 0.0);
    let eye = target + DVec3::new(0.31, 0.5, -0.8).normalize() * distance;
    let pose = Pose::look_at(eye, target, DVec3::Y).expect("the eye is before the plane");
    Camera::perspective(pose, 30f64.to_radians(), [PLANE_SIDE; 2]).expect("the size is in range")
}

/// Each surfel to the pixel that its centre is in, of several the last one.
fn points(plane: &Cloud, camera: &Camera) -> Frame {
    let mut frame = Frame::new(PLANE_SIDE as usize, PLANE_SIDE as usize);
    let (splats, intrinsics) = (plane.splats(), camera.intrinsics());
    for (center, [red, green, blue]) in splats.centers.iter().zip(splats.colors) {
        let p = camera.pose().world_to_camera.transform_point3(center.as_dvec3());
        let at = p.truncate() / p.z * intrinsics.focal + intrinsics.center;
        let side = f64::from(PLANE_SIDE);
        if p.z > 0.0 && at.min_element() >= 0.0 && at.max_element() < side {
            frame.color[at.y as usize * PLANE_SIDE as usize + at.x as usize] = [red, green, blue, 1.0];
        }
    }
    frame
}

fn brightness(frame: &Frame) -> f64 {
    frame.color.iter().flat_map(|pixel| &pixel[..3]).map(|c| f64::from(*c)).sum()
}

/// A plane drawn by a camera, in some way.
type Drawing<'a> = Box<dyn Fn(&Camera) -> Frame + 'a>;

fn run() -> Findings {
    let sizes = || ratios(25, [0.05, 5.0]);
    let energies = WAYS.each_ref().map(|way| sizes().map(|sigma| energy(way, sigma)).collect::<Vec<_>>());
    let curves = |value: fn([f64; 2]) -> f64| -> Vec<Curve> {
        let one = |(way, found): (&Way, &Vec<[f64; 2]>)| {
            let points = sizes().zip(found).map(|(sigma, found)| [sigma, value(*found).max(FLOOR)]);
            Curve::new(way.name, way.role, points)
        };
        WAYS.iter().zip(&energies).map(one).collect()
    };
    let x = || Axis::log("σ, pixels");
    let estimate = Curve::new(
        "1 + 0.3 px²/σ²",
        Role::Estimate,
        sizes().map(|sigma| [sigma, 1.0 + 0.3 / (sigma * sigma)]),
    );
    let mut panels = vec![
        Panel {
            title: "Brightness of a small splat".into(),
            x: x(),
            y: Axis::log("energy in the picture over 2πσ²o"),
            bound: None,
            curves: curves(|[mean, _]| mean).into_iter().chain([estimate]).collect(),
        },
        Panel {
            title: "The same at the worst place between pixels".into(),
            x: x(),
            y: Axis::log("energy off by, share"),
            bound: Some(0.01),
            curves: curves(|[_, worst]| worst),
        },
    ];

    let plane = textured();
    let trained_scene = scene(vec![trained(&plane)]);
    let (bare, levels): (Scene, Scene) =
        (scene(vec![plane.clone()]), scene(vec![plane.clone().with_levels()]));
    let drawings: [(&str, Role, Drawing<'_>); 4] = [
        ("default", Role::Default, Box::new(|camera| draw(&bare, camera, &unshaded()))),
        ("with levels of detail", Role::Ours, Box::new(|camera| draw(&levels, camera, &unshaded()))),
        ("points", Role::Baseline, Box::new(|camera| points(&plane, camera))),
        (
            "3DGS: 0.3 px², not compensated",
            Role::Baseline,
            Box::new(|camera| draw(&trained_scene, camera, &ordered(Order::Centers))),
        ),
    ];
    let zooms: Vec<f64> = steps(13, [-4.0, 4.0]).map(f64::exp2).collect();
    let found: Vec<[[f64; 2]; 4]> = zooms
        .iter()
        .map(|zoom| {
            let camera = view(*zoom);
            let right = truth(&bare, &camera, &unshaded(), ReferenceKind::R2 { samples: 256 });
            drawings.each_ref().map(|(_, _, drawing)| {
                let drawn = drawing(&camera);
                [apart(&drawn, &right).psnr_db, (brightness(&drawn) / brightness(&right) - 1.0).abs()]
            })
        })
        .collect();
    let panel = |title: &str, y, bound, k: usize| Panel {
        title: title.into(),
        x: Axis::log("surfels a pixel, along a line"),
        y,
        bound,
        curves: drawings
            .iter()
            .enumerate()
            .map(|(i, (name, role, _))| {
                let points = zooms.iter().zip(&found).map(|(x, row)| [*x, row[i][k].clamp(FLOOR, 200.0)]);
                Curve::new(*name, *role, points)
            })
            .collect(),
    };
    let psnr = Axis::linear("PSNR beside 256 samples a pixel, dB");
    panels.push(panel("A textured plane: likeness", psnr, None, 0));
    panels.push(panel("A textured plane: brightness", Axis::log("brightness off by, share"), Some(0.01), 1));

    let mut verdicts = Vec::new();
    let baseline = |role| role == Role::Baseline;
    for (way, found) in WAYS.iter().zip(&energies) {
        let mean = largest(found.iter().map(|[mean, _]| (mean - 1.0).abs()));
        let worst = largest(found.iter().map(|[_, worst]| *worst));
        let is_cut = baseline(way.role) || way.filter.is_some() && way.tolerance == LEVEL;
        let of_mean = at_most(way.role, way.name, "energy off by, share, σ from 0.05 to 5 px", mean, 0.01);
        let of_worst = at_most(way.role, way.name, "the same, worst place between pixels", worst, 0.01);
        // What kernels of opacities are cut off by is not given back: 0.2 % beside the 1.1 % by which sums over pixels ripple.
        let is_worse = way.filter.is_some();
        verdicts.push(if is_cut { failing(of_mean) } else { of_mean });
        verdicts.push(if is_worse { failing(of_worst) } else { of_worst });
    }
    for (i, (name, role, _)) in drawings.iter().enumerate() {
        let least = -largest(found.iter().map(|row| -row[i][0]));
        let drift = largest(found.iter().map(|row| row[i][1]));
        let quality = at_least(*role, name, "textured plane, least PSNR, dB", least, 40.0);
        let change = at_most(*role, name, "textured plane, brightness off by, share", drift, 0.01);
        verdicts.extend([quality, change].map(|v| if baseline(*role) { failing(v) } else { v }));
    }
    Findings { panels, verdicts }
}
