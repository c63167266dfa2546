//! Case 11: meshes, volumes and splats in one another.

use super::setups::*;
use super::{Case, Findings, Verdict};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use oblate_engine::reference::stochastic;
use oblate_engine::{
    Camera, Closed, Cloud, FootprintForm, Frame, Order, Pose, ReferenceKind, RenderSettings, Strength, settle,
};

pub(super) const CASE: Case = Case {
    number: 11,
    title: "Meshes, volumes and splats in one another",
    criterion: "An opaque mesh in fog, a translucent sheet between splats, splats in a volume, two volumes through each other, the camera amid all of these: no channel is more than 1/255 off the integral along the ray, pixels beside an edge left out. An estimate by chance that sorts nothing comes to the same picture, within its own error.",
    run,
};

/// Pixels along a side.
const SIDE: u32 = 18;

/// Meshes and kernels in one another.
struct Mix {
    name: &'static str,
    /// Which of ours are known to miss: the default; slabs of 1 σ.
    misses: [bool; 2],
    meshes: Vec<Cloud>,
    kernels: Vec<Cloud>,
    camera: Camera,
}

impl Mix {
    fn all(&self) -> Vec<Cloud> {
        self.meshes.iter().chain(&self.kernels).cloned().collect()
    }
}

/// A sheet through the origin, tilted about the x axis, that lets a share through.
fn sheet(opacity: f32, degrees: f64) -> Cloud {
    let tilt = DAffine3::from_mat3(DMat3::from_rotation_x(degrees.to_radians()));
    translucent(&plane(34, 0.07, [0.9, 0.8, 0.2]), opacity).transformed(tilt)
}

/// A sphere of evenly spread surfels.
fn ball(count: usize, radius: f32) -> Cloud {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let point = |i: usize| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        (DVec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z).as_vec3()
    };
    let points: Vec<_> = (0..count).map(|i| (point(i) * radius, point(i))).collect();
    let mut splats =
        surfels(&points, 4.0 * std::f32::consts::PI * radius.powi(2) / count as f32, [0.9, 0.4, 0.1])
            .splats();
    // Its coverage is even to a few hundredths.
    if let Strength::Surface(surface) = &mut splats.strength {
        (surface.closed, surface.coverage_floor) = (Closed::EVERYWHERE, 0.95);
    }
    Cloud::new(splats).expect("a sphere is in range")
}

fn mixes() -> Vec<Mix> {
    let camera = looking_from(DVec3::new(2.5, 2.0, -4.5), SIDE);
    let other = |spacing, extinction| painted(&haze(9, spacing, extinction), |p| [0.8, 0.5 + 0.3 * p.x, 0.1]);
    let inside = Pose::look_at(DVec3::new(0.3, 0.25, -0.9), DVec3::ZERO, DVec3::Y).expect("it looks ahead");
    let tilt = DAffine3::from_mat3_translation(DMat3::from_rotation_x(0.6), DVec3::new(0.5, 0.2, 0.4));
    let left = moved(haze(10, 0.22, 0.8), DVec3::NEG_X * 0.4);
    let mix = |name, meshes, kernels| Mix { name, misses: [false; 2], meshes, kernels, camera };
    vec![
        mix("opaque mesh in fog", vec![ball(1500, 0.7)], vec![haze(11, 0.22, 0.8)]),
        // Trained splats are defined by the order of their centres, which slabs don't keep.
        Mix {
            misses: [false, true],
            ..mix("sheet between splats", vec![sheet(0.5, 25.0)], vec![trained(60, 0.2)])
        },
        mix("splats in a volume", vec![], vec![haze(11, 0.22, 0.6), trained(60, 0.2)]),
        mix("two volumes", vec![], vec![left, other(0.22, 0.8).transformed(tilt)]),
        Mix {
            camera: Camera::perspective(inside, 1.0, [SIDE; 2]).expect("the angle is in range"),
            ..mix(
                "camera amid all",
                vec![moved(ball(1500, 0.4), DVec3::new(-0.1, -0.1, 0.3))],
                vec![haze(11, 0.22, 0.6), other(0.25, 0.4), trained(60, 0.2)],
            )
        },
    ]
}

/// Pixels beside none of which the first surface ends, or folds by more than 83°.
fn smooth(frame: &Frame, camera: &Camera) -> Vec<usize> {
    let goes_on = |a: usize, b: usize| {
        let [a, b] = [a, b].map(|i| f64::from(frame.depth[i]));
        a == b || (a - b).abs() <= 8.0 * camera.pixel_width_at(a)
    };
    let around = |i: usize| {
        let [x, y] = [i % frame.width, i / frame.width];
        let columns = x.saturating_sub(1)..(x + 2).min(frame.width);
        let rows = y.saturating_sub(1)..(y + 2).min(frame.height);
        rows.flat_map(move |v| columns.clone().map(move |u| v * frame.width + u))
    };
    (0..frame.color.len()).filter(|i| around(*i).all(|j| goes_on(*i, j))).collect()
}

/// The largest error of a channel at some pixels.
fn off_at(places: &[usize], a: &Frame, b: &Frame) -> f64 {
    let channels = places.iter().flat_map(|i| a.color[*i].into_iter().zip(b.color[*i]));
    largest(channels.map(|(a, b)| f64::from((a - b).abs())))
}

/// Pictures over each other, the first one before all.
fn over(pictures: impl IntoIterator<Item = Frame>) -> Frame {
    let behind = |mut front: Frame, back: Frame| {
        for (a, b) in front.color.iter_mut().zip(&back.color) {
            let through = 1.0 - a[3];
            *a = std::array::from_fn(|c| a[c] + through * b[c]);
        }
        front
    };
    pictures.into_iter().reduce(behind).expect("there is a picture")
}

/// The kernels of all clouds that are or aren't behind the first surface of a picture, by their centres.
fn by_centers(clouds: &[Cloud], surface: &Frame, camera: &Camera, behind: bool) -> Vec<Cloud> {
    let focal = camera.intrinsics().focal.x;
    let is_behind = |p: DVec3| {
        let p = camera.pose().world_to_camera.transform_point3(p);
        let seen = (p.truncate() / p.z * focal + camera.intrinsics().center).floor();
        let size = surface.width as f64;
        let inside = p.z > 0.0 && seen.min_element() >= 0.0 && seen.max_element() < size;
        inside && p.z > f64::from(surface.depth[(seen.y * size + seen.x) as usize])
    };
    let part = |cloud: &Cloud| {
        let mut splats = cloud.splats();
        let to_world = cloud.cloud_to_world();
        let taken: Vec<bool> = splats
            .centers
            .iter()
            .map(|center| is_behind(to_world.transform_point3(center.as_dvec3())) == behind)
            .collect();
        match &mut splats.strength {
            Strength::Extinction { masses: values } | Strength::Opacity { peaks: values, .. } => {
                values
                    .iter_mut()
                    .zip(&taken)
                    .for_each(|(value, taken)| *value *= f32::from(u8::from(*taken)));
            }
            Strength::Surface(_) => {}
        }
        Cloud::new(splats).expect("less is in range, too").transformed(to_world)
    };
    clouds.iter().map(part).collect()
}

/// Each of what others do: one picture of all that is drawn, in layers.
fn layered(mix: &Mix, cut: bool) -> Frame {
    let draw = |clouds: Vec<Cloud>| draw(&scene(clouds), &mix.camera, &ordered(Order::Centers));
    let surface = draw(mix.meshes.clone());
    if !cut {
        // Object by object, meshes first, as they come: each over those before it.
        return over(mix.kernels.iter().rev().map(|cloud| draw(vec![cloud.clone()])).chain([surface]));
    }
    let [before, behind] =
        [false, true].map(|behind| draw(by_centers(&mix.kernels, &surface, &mix.camera, behind)));
    over([before, surface, behind])
}

/// A kernel of τ = 2 with a translucent sheet at a distance in its σ.
fn sheet_through(distance: f64) -> Mix {
    let factor = Mat3::from_diagonal(Vec3::splat(0.3));
    let ball = kernels(vec![Vec3::ZERO], factor, mass_of(2.0, factor), [0.1, 0.5, 0.9]);
    let sheet = moved(sheet(0.6, 0.0), DVec3::Z * 0.3 * distance);
    let camera = looking_from(DVec3::NEG_Z * 6.0, 7);
    Mix { name: "", misses: [false; 2], meshes: vec![sheet], kernels: vec![ball], camera }
}

/// Two volumes in each other.
fn two_of(extinction: f64) -> Mix {
    let volume = haze(7, 0.3, extinction);
    let other = painted(&volume, |p| [0.9, 0.5 + 0.3 * p.y, 0.1]);
    let kernels = vec![volume, moved(other, DVec3::new(0.5, 0.3, 0.4))];
    let camera = looking_from(DVec3::new(2.5, 2.0, -4.5), 8);
    Mix { name: "", misses: [false; 2], meshes: vec![], kernels, camera }
}

/// The largest errors of each method.
fn curves(
    methods: &[(&str, Role, RenderSettings)],
    xs: impl Iterator<Item = f64>,
    mix: fn(f64) -> Mix,
) -> Vec<Curve> {
    let with_truth = |x: f64| {
        let mix = mix(x);
        let expected = truth(&scene(mix.all()), &mix.camera, &unshaded(), ReferenceKind::R1);
        (x, mix, expected)
    };
    let scenes: Vec<(f64, Mix, Frame)> = xs.map(with_truth).collect();
    let curve = |name: &str, role, picture: &dyn Fn(&Mix) -> Frame| {
        let error = |(x, mix, expected): &(f64, Mix, Frame)| {
            [*x, apart(&picture(mix), expected).max_error.max(FLOOR)]
        };
        Curve::new(name, role, scenes.iter().map(error))
    };
    let ours = methods.iter().map(|(name, role, settings)| {
        curve(name, *role, &|mix| draw(&scene(mix.all()), &mix.camera, settings))
    });
    let mut curves: Vec<Curve> = ours.collect();
    curves.push(curve("one after the other", Role::Baseline, &|mix| layered(mix, false)));
    if !scenes[0].1.meshes.is_empty() {
        curves.push(curve("before or behind by centres", Role::Baseline, &|mix| layered(mix, true)));
    }
    curves
}

fn run() -> Findings {
    let settings = |order| RenderSettings { tolerance: LEVEL / 8.0, ..ordered(order) };
    let fine =
        RenderSettings { footprint: FootprintForm::Exact, ..settings(Order::Slabs { thickness: 1.0 }) };
    let ours = [
        ("default", Role::Default, unshaded()),
        ("slabs of 1 σ", Role::Ours, fine),
        ("pixel by pixel", Role::Ours, settings(Order::PerPixel)),
        ("by centres", Role::Ours, settings(Order::Centers)),
    ];
    let mut verdicts = Vec::new();
    let error = |role, method: &str, mix: &Mix, found| {
        at_most(role, method, &format!("largest error, {}", mix.name), found, LEVEL)
    };
    for mix in mixes() {
        let all = scene(mix.all());
        let expected = truth(&all, &mix.camera, &unshaded(), ReferenceKind::R1);
        let places = smooth(&expected, &mix.camera);
        for ((name, role, settings), misses) in ours.iter().zip(mix.misses) {
            let found = off_at(&places, &draw(&all, &mix.camera, settings), &expected);
            verdicts.push(Verdict { fails: misses, ..error(*role, name, &mix, found) });
        }
        let settings = settle(&all, &mix.camera, &unshaded()).expect("settings of cases are in range");
        let found = off_at(&places, &draw(&all, &mix.camera, &settings), &expected);
        verdicts.push(error(Role::Ours, "settled by trial", &mix, found));
        for (name, cut) in [("one after the other", false), ("before or behind by centres", true)] {
            if !cut || !mix.meshes.is_empty() {
                let found = off_at(&places, &layered(&mix, cut), &expected);
                verdicts.push(failing(error(Role::Baseline, name, &mix, found)));
            }
        }
    }

    // The estimate by chance, of the scene with all in it.
    let mix = mixes().pop().expect("there are mixes");
    let all = scene(mix.all());
    let camera = looking_from(DVec3::new(2.0, 1.5, -4.0), 10);
    let expected = truth(&all, &camera, &unshaded(), ReferenceKind::R1);
    let pixels = expected.color.as_flattened();
    let chance = |samples: u32| {
        let estimate = stochastic(&all, &camera, &unshaded(), samples, 1).expect("the number is in range");
        let errors =
            estimate.color.as_flattened().iter().zip(estimate.standard_error.as_flattened()).zip(pixels);
        let squares = errors.map(|((found, error), expected)| {
            let off = (found - f64::from(*expected)).powi(2);
            [off, off / (error * error).max(1e-18), error * error]
        });
        let sum = squares.fold([0.0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
        sum.map(|sum| (sum / pixels.len() as f64).sqrt())
    };
    let estimates: Vec<[f64; 4]> = ratios(16, [8.0, 2048.0])
        .map(|samples| {
            let [off, in_errors, error] = chance(samples.round() as u32);
            [samples.round(), off, in_errors, error]
        })
        .collect();
    // The root mean square of a hundred pixels of four channels that go together: 1 ± 0.07, three times that.
    let last = estimates[estimates.len() - 1];
    verdicts.push(at_most(
        Role::Truth,
        "by chance, 2048 samples",
        "r.m.s. error in standard errors",
        last[2],
        1.21,
    ));

    let panels = vec![
        Panel {
            title: "A translucent sheet moves through a kernel of optical depth 2".into(),
            x: Axis::linear("sheet's distance behind the kernel's centre, σ"),
            y: Axis::log("largest error of a channel"),
            bound: Some(LEVEL),
            curves: curves(&ours, steps(33, [-4.0, 4.0]), sheet_through),
        },
        Panel {
            title: "Two volumes in each other, ever denser".into(),
            x: Axis::log("extinction"),
            y: Axis::log("largest error of a channel"),
            bound: Some(LEVEL),
            curves: curves(&ours, ratios(16, [0.1, 10.0]), two_of),
        },
        Panel {
            title: "Without any sorting: mesh, two volumes and splats, by chance".into(),
            x: Axis::log("samples a pixel"),
            y: Axis::log("r.m.s. difference from the integral"),
            bound: None,
            curves: vec![
                Curve::new("by chance", Role::Truth, estimates.iter().map(|e| [e[0], e[1]])),
                Curve::new("its standard error", Role::Estimate, estimates.iter().map(|e| [e[0], e[3]])),
            ],
        },
    ];
    Findings { panels, verdicts }
}
