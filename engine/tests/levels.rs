//! One suite for every way to draw a picture: sets of instructions, sides of tiles and numbers of threads.
//!
//! Threads change no bit. Levels and sides differ by rounding; what that may do to a channel is derived at
//! [`Case::smooth`] and [`Case::jump`].

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DVec3, Mat3, Vec3};
use oblate_engine::cloud::oblate_factor;
use oblate_engine::simd::Level;
use oblate_engine::{
    Blend, Camera, Cloud, FootprintForm, Frame, Harmonics, Material, OpacityFilter, Pose, RenderSettings,
    Renderer, Scene, Shapes, Splats, Strength,
};
use scenes::*;

/// No multiple of 8, 16 or 32, so that every kind of tile is cut by the picture's border.
const SIZE: [u32; 2] = [75, 53];

struct Case {
    name: &'static str,
    scene: Scene,
    camera: Camera,
    settings: RenderSettings,
    /// The largest optical depth or opacity of a kernel, and the greatest number of kernels whose outlines may run
    /// through one pixel.
    peak: f64,
}

impl Case {
    /// What rounding may do to a channel of at most 1 where no outline and no limit of a layer runs through the
    /// pixel. Opacities are right to 6e-5 of themselves by the recurrence (twice: both pictures round) and to 2e-5 by
    /// the polynomial, optical depths to as much; a relative error of all of them is at most that error of a channel,
    /// since Σ Tτe^{−τ} ≤ 1. Tiles end early by themselves: a quarter of the tolerance.
    fn smooth(&self) -> f64 {
        2.0 * (6e-5 + 2e-5) + self.settings.tolerance / 4.0
    }

    /// What one kernel may add to a pixel that its outline runs through: its opacity at the cut-off, or the tolerance,
    /// where `Opacity` kernels end; the form of its footprint may differ by a quarter of the tolerance.
    fn jump(&self) -> f64 {
        let at_cutoff = self.peak * (-0.5 * self.settings.cutoff).exp() * 1.01;
        self.smooth() + (-(-at_cutoff).exp_m1()).max(self.settings.tolerance)
    }
}

fn view(eye: DVec3) -> Camera {
    let pose = looking_from(eye, 8).pose();
    Camera::perspective(pose, 30f64.to_radians(), SIZE).unwrap()
}

fn parallel(eye: DVec3, height: f64) -> Camera {
    Camera::orthographic(looking_from(eye, 8).pose(), height, SIZE).unwrap()
}

fn at(cloud: Cloud, x: f64, y: f64, z: f64) -> Cloud {
    cloud.transformed(tilted(0.0, DVec3::new(x, y, z)))
}

/// A number in [−1, 1) that looks random.
fn noise(i: usize, k: f64) -> f32 {
    let x = (i as f64 + 0.37) * k;
    ((x - x.floor()) * 2.0 - 1.0) as f32
}

fn spot(i: usize) -> Vec3 {
    Vec3::new(noise(i, 0.754_877_67), noise(i, 0.569_840_29), noise(i, 0.437_016_02))
}

fn color(i: usize) -> [f32; 3] {
    [0.127, 0.311, 0.233].map(|k| noise(i, k) * 0.5 + 0.5)
}

/// Kernels of differing shapes at noisy places, with opacities and harmonics of degree 3.
fn trained(count: usize, factor: impl Fn(usize) -> Mat3) -> Cloud {
    Cloud::new(Splats {
        centers: (0..count).map(spot).collect(),
        shapes: Shapes::Each((0..count).map(factor).collect()),
        strength: Strength::Opacity {
            peaks: (0..count).map(|i| 0.5 + 0.49 * noise(i, 0.618)).collect(),
            filter: OpacityFilter::Compensated,
            least: 0.0,
        },
        colors: (0..count).map(color).collect(),
        harmonics: Some(Harmonics {
            degree: 3,
            coefficients: (0..count * 15).map(|i| color(i).map(|c| (c - 0.5) * 0.2)).collect(),
        }),
        normals: None,
        material: Material::UNLIT,
    })
    .unwrap()
}

/// A shaded ball of extinction kernels of several colours.
fn cloudlet(density: f64) -> Cloud {
    let mut splats = fog([9; 3], DVec3::splat(0.2), density, [0.5; 3]).splats();
    splats.colors = (0..splats.centers.len()).map(color).collect();
    splats.normals = Some(splats.centers.iter().map(|p| p.normalize_or_zero()).collect());
    splats.material = Material::default();
    Cloud::new(splats).unwrap()
}

/// A sheet that lets part of the light through.
fn pane(opacity: f32, color: [f32; 3]) -> Cloud {
    let mut splats = plane(40, 0.06, color).splats();
    if let Strength::Surface(surface) = &mut splats.strength {
        surface.opacities = Some(vec![opacity; surface.areas.len()]);
    }
    Cloud::new(splats).unwrap()
}

/// Thin long splats: seen from the side, from the end, and across the diagonal of the picture.
fn needles() -> Cloud {
    trained(60, |i| {
        let along = if i % 3 == 0 { Vec3::new(1.0, 1.0, 0.0) } else { spot(i + 100) }.normalize_or(Vec3::X);
        let (a, b) = along.any_orthonormal_pair();
        Mat3::from_cols(along * 0.6, a * 0.012, b * if i % 2 == 0 { 0.0 } else { 0.012 })
    })
}

fn spots(spread: f32, radius: f32, flattening: f32, mass: f32) -> Cloud {
    let count = 150;
    let mut splats =
        kernels((0..count).map(|i| spot(i) * spread).collect(), Mat3::IDENTITY, mass, [0.5; 3]).splats();
    splats.shapes =
        Shapes::Each((0..count).map(|i| oblate_factor(spot(i + 7), radius, flattening)).collect());
    splats.colors = (0..count).map(color).collect();
    Cloud::new(splats).unwrap()
}

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let mut add = |name, clouds: Vec<Cloud>, camera: Camera, settings: RenderSettings, peak: f64| {
        cases.push(Case { name, scene: Scene { clouds, lights: Vec::new() }, camera, settings, peak });
    };
    let eye = DVec3::new(2.0, 1.6, -3.6);
    let (plain, lit) = (unshaded(), RenderSettings::default());
    let backdrop = RenderSettings { background: [0.1, 0.2, 0.3, 1.0], ..lit };
    let medium = || fog([10; 3], DVec3::splat(0.2), 0.8, [0.3, 0.5, 0.9]);
    let sheets = || {
        vec![
            at(pane(0.4, [0.9, 0.2, 0.1]), 0.2, 0.0, -0.8),
            at(pane(0.7, [0.2, 0.9, 0.1]), -0.2, 0.1, -0.3),
            sphere(1500, 0.5, [0.2, 0.3, 0.9]),
            at(pane(1.0, [0.7; 3]), 0.0, 0.3, 0.9).transformed(tilted(20.0, DVec3::ZERO)),
        ]
    };
    // A kernel of the lattice has τ = κ · spacing³/(2π (0.7 spacing)²) through its middle.
    let lattice = |extinction: f64| extinction * 0.2 / (std::f64::consts::TAU * 0.49);

    add("fog", vec![medium()], view(eye), plain, lattice(0.8));
    add("fog, parallel", vec![medium()], parallel(eye, 2.5), plain, lattice(0.8));
    add(
        "fog, encoded",
        vec![medium()],
        view(eye),
        RenderSettings { blend: Blend::Display, ..backdrop },
        lattice(0.8),
    );
    for low_pass in [0.0, 1.0] {
        add(
            "fog, other filter",
            vec![medium()],
            view(eye),
            RenderSettings { low_pass, ..plain },
            lattice(0.8),
        );
    }
    add(
        "thick fog",
        vec![fog([8; 3], DVec3::splat(0.25), 600.0, [0.9, 0.5, 0.2])],
        view(eye),
        backdrop,
        50.0,
    );
    add("thinnest fog", vec![fog([8; 3], DVec3::splat(0.25), 1e-7, [0.9, 0.5, 0.2])], view(eye), plain, 1e-8);
    let cut = || {
        vec![
            cloudlet(5.0),
            at(pane(1.0, [0.8, 0.7, 0.2]), 0.0, 0.0, 0.0).transformed(tilted(50.0, DVec3::ZERO)),
        ]
    };
    add("shaded cloud cut by a surface", cut(), view(eye), lit, lattice(5.0));
    // Seen along `eye`, neighbours of the lattice are equally far; which of two such kernels is in front is rounding.
    let aside = DVec3::new(2.0, 1.7, -3.3);
    add("the same, parallel", cut(), parallel(aside, 2.5), lit, lattice(5.0));
    add(
        "the same, encoded",
        cut(),
        view(eye),
        RenderSettings { blend: Blend::Display, ..backdrop },
        lattice(5.0),
    );
    add("sheets one behind the other", sheets(), view(eye), backdrop, 0.3);
    let mut fogged = sheets();
    fogged.push(medium());
    add("sheets in fog", fogged, view(eye), backdrop, lattice(0.8));
    for footprint in [FootprintForm::Auto, FootprintForm::Point, FootprintForm::Affine, FootprintForm::Exact]
    {
        let round = |i: usize| oblate_factor(spot(i + 3), 0.16 + 0.1 * noise(i, 0.71), 1.0 + (i % 5) as f32);
        let settings = RenderSettings { footprint, ..backdrop };
        add("trained", vec![trained(120, round)], view(eye), settings, 1.0);
        add(
            "trained before a ball",
            vec![trained(120, round), sphere(1500, 0.5, [0.8; 3])],
            view(eye),
            settings,
            1.0,
        );
        add("needles", vec![needles()], view(DVec3::new(0.0, 0.0, -4.0)), settings, 1.0);
        add("surfaces", sheets(), view(eye), settings, 0.3);
    }
    for low_pass in [0.0, 0.3, 1.0] {
        let settings = RenderSettings { low_pass, ..plain };
        add("needles, other filters", vec![needles()], view(eye), settings, 1.0);
        add("needles, parallel", vec![needles()], parallel(eye, 2.0), settings, 1.0);
    }
    let inside =
        Camera::perspective(Pose::look_at(DVec3::ZERO, DVec3::Z, DVec3::Y).unwrap(), 1.2, SIZE).unwrap();
    for (flattening, mass) in [(1.0, 0.3), (10.0, 0.1)] {
        // τ = m/(2πσ²) through a middle that is one unit away or nearer: most of them far less.
        let peak = f64::from(mass) * f64::from(flattening) / (std::f64::consts::TAU * 0.25 * 0.25);
        let clouds = || vec![spots(1.5, 0.25, flattening, mass)];
        add("across the camera plane", clouds(), inside, plain, peak);
        add("across the near plane", clouds(), inside.with_near(0.8).unwrap(), plain, peak);
        add(
            "across the near plane, parallel",
            clouds(),
            parallel(eye, 3.0).with_near(4.2).unwrap(),
            plain,
            peak,
        );
    }
    add("sub-pixel splats", vec![spots(1.0, 0.004, 3.0, 0.002)], view(eye), plain, 3.0);
    add("sub-pixel surfels", vec![sphere(20_000, 0.8, [0.6, 0.7, 0.8])], view(eye * 2.0), lit, 0.3);
    cases
}

fn bits(frame: &Frame) -> Vec<u32> {
    let channels = frame.color.iter().flatten().chain(&frame.depth).chain(&frame.expected_depth);
    let numbers = channels.chain(frame.normal.iter().flatten()).map(|c| c.to_bits());
    numbers.chain(frame.id.iter().copied()).collect()
}

/// Differences of each pixel's channels, the largest first.
fn differences(a: &Frame, b: &Frame) -> Vec<f64> {
    let largest = |(a, b): (&[f32; 4], &[f32; 4])| {
        a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
    };
    let mut all: Vec<f64> = a.color.iter().zip(&b.color).map(largest).collect();
    all.sort_by(|a, b| b.total_cmp(a));
    all
}

#[test]
fn levels_and_tiles_differ_by_rounding_and_threads_by_nothing() {
    let pools = [1, 2, 3].map(|n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap());
    let mut failures = Vec::new();
    for case in cases() {
        let Case { name, scene, camera, settings, .. } = &case;
        let mut first: Option<Frame> = None;
        let (mut worst, mut worst_at) = ([0.0_f64; 2], (Level::Baseline, 0));
        for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
            for side in [8, 16, 32] {
                let frames = pools.each_ref().map(|pool| {
                    let mut renderer = Renderer::with(level, side);
                    pool.install(|| renderer.render(scene, camera, settings, &()).map(|_| ())).unwrap();
                    renderer.into_frame()
                });
                for other in &frames[1..] {
                    assert!(bits(other) == bits(&frames[0]), "{name}: threads change {level:?}, side {side}");
                }
                let [frame, ..] = frames;
                assert!(
                    frame.color.iter().flatten().all(|c| c.is_finite()),
                    "{name}: {level:?}, side {side}"
                );
                let Some(first) = &first else {
                    let seen = frame.color.iter().filter(|p| p[..3].iter().any(|c| *c > 0.0)).count();
                    assert!(seen > 50, "{name}: only {seen} pixels show anything");
                    first = Some(frame);
                    continue;
                };
                let found = differences(first, &frame);
                if found[0] > worst[0] {
                    worst_at = (level, side);
                }
                // Outlines and limits run through one pixel in a hundred at most, rounding being 1e-6 of them.
                worst = [worst[0].max(found[0]), worst[1].max(found[found.len() / 100])];
            }
        }
        let (form, filter) = (settings.footprint, settings.low_pass);
        println!(
            "{name}, {form:?}, {filter} px²: {:.1e} at most ({worst_at:?}), {:.1e} at 99 %",
            worst[0], worst[1]
        );
        if worst[0] > case.jump() || worst[1] > case.smooth() {
            failures.push(format!(
                "{name}, {form:?}, {filter} px²: {worst:?}, bounds {:?}",
                [case.jump(), case.smooth()]
            ));
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
