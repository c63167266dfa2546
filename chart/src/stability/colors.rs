//! Case 15: spaces of colours, and filters that files declare.

use super::setups::*;
use super::{Case, Findings};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DVec2, DVec3, Mat3, Vec3};
use oblate_engine::color::{linear_to_srgb, srgb_to_linear};
use oblate_engine::{
    Blend, Camera, Cloud, Frame, OpacityFilter, Pose, RenderSettings, Scene, Shapes, Strength,
};

pub(super) const CASE: Case = Case {
    number: 15,
    title: "Spaces of colours, and filters",
    criterion: "A mesh and a splat of one colour and one opacity can't be told apart, within 1/255, whichever space a scene is blended in; what is opaque is the same in both spaces. A splat of any size, from 0.05 to 3 pixels, is as bright as the filter makes it that its file declares: every pixel within 1/255, and all together within 1 %.",
    run,
};

const SIDE: u32 = 24;
const COLOR: [f32; 3] = [0.8, 0.3, 0.05];
const BEHIND: [f32; 4] = [0.05, 0.2, 0.7, 1.0];

/// One world unit a pixel.
fn camera() -> Camera {
    let pose = Pose::look_at(DVec3::NEG_Z * 100.0, DVec3::ZERO, DVec3::NEG_Y).expect("it looks ahead");
    Camera::orthographic(pose, SIDE.into(), [SIDE; 2]).expect("the height is in range")
}

/// A splat so wide that its opacity is its peak everywhere.
fn splat(opacity: f32) -> Scene {
    let strength = Strength::Opacity { peaks: vec![opacity], filter: OpacityFilter::Classic, least: 0.0 };
    let shapes = Shapes::Shared(Mat3::from_diagonal(Vec3::new(2e4, 2e4, 1.0)));
    scene(vec![splats(vec![Vec3::ZERO], shapes, strength, vec![COLOR])])
}

fn mesh(opacity: f32) -> Scene {
    scene(vec![translucent(&plane(44, 1.0, COLOR), opacity)])
}

fn over(scene: &Scene, blend: Blend) -> Frame {
    draw(scene, &camera(), &RenderSettings { blend, background: BEHIND, ..unshaded() })
}

/// The colour that a share of one over the other is, in f64.
fn mixed(opacity: f64, blend: Blend) -> [f64; 3] {
    std::array::from_fn(|c| {
        let [front, behind] = [COLOR[c], BEHIND[c]].map(|value| match blend {
            Blend::Linear => f64::from(value),
            Blend::Display => f64::from(linear_to_srgb(value)),
        });
        let mean = opacity * front + (1.0 - opacity) * behind;
        if blend == Blend::Linear { mean } else { f64::from(srgb_to_linear(mean as f32)) }
    })
}

/// How far a picture is from one colour.
fn off(frame: &Frame, expected: [f64; 3]) -> f64 {
    let error = |pixel: &[f32; 4]| largest((0..3).map(|c| (f64::from(pixel[c]) - expected[c]).abs()));
    largest(frame.color.iter().map(error))
}

/// A round splat of a σ in pixels, a little beside a pixel's middle.
fn dot(sigma: f64, filter: OpacityFilter) -> Cloud {
    kernel(DVec3::new(0.3, 0.2, 0.0), Mat3::from_diagonal(Vec3::splat(sigma as f32)), 0.8, filter)
}

/// How far the sum of the pixels' opacities is off, as a share, and the largest |Δα| of a pixel, of a splat that is drawn with the filter
/// `taken` where its file declares another.
fn off_brightness(sigma: f64, [declared, taken]: [OpacityFilter; 2], settings: &RenderSettings) -> [f64; 2] {
    let found = alphas(&draw(&scene(vec![dot(sigma, taken)]), &camera(), settings));
    let widened = sigma * sigma + 0.3;
    let share = if declared == OpacityFilter::Classic { 1.0 } else { sigma * sigma / widened };
    let middle = DVec2::splat(f64::from(SIDE) / 2.0) + DVec2::new(0.3, 0.2);
    let pixel = |i: usize| {
        let at = DVec2::new((i % SIDE as usize) as f64, (i / SIDE as usize) as f64) + 0.5;
        0.8 * share * (-0.5 * (at - middle).length_squared() / widened).exp()
    };
    let expected: Vec<f64> = (0..found.len()).map(pixel).collect();
    let sum = |values: &[f64]| values.iter().sum::<f64>();
    [(sum(&found) / sum(&expected) - 1.0).abs(), largest_difference(&found, &expected)]
}

fn run() -> Findings {
    let mut verdicts = Vec::new();
    let spaces = [("default", Role::Default, Blend::Linear), ("display", Role::Ours, Blend::Display)];
    let opacities: Vec<f64> = steps(41, [0.0, 1.0]).collect();
    let (mut alike, mut right) = (Vec::new(), Vec::new());
    for (name, role, blend) in spaces {
        let pictures: Vec<[Frame; 2]> = opacities
            .iter()
            .map(|o| [splat(*o as f32), mesh(*o as f32)].map(|scene| over(&scene, blend)))
            .collect();
        let points = |error: &dyn Fn(&[Frame; 2], f64) -> f64| -> Vec<[f64; 2]> {
            pictures.iter().zip(&opacities).map(|(pair, o)| [*o, error(pair, *o).max(FLOOR)]).collect()
        };
        let between = points(&|[a, b], _| apart(a, b).max_error);
        let beside = points(&|[a, b], o| off(a, mixed(o, blend)).max(off(b, mixed(o, blend))));
        let worst = |points: &[[f64; 2]]| largest(points.iter().map(|p| p[1]));
        verdicts.push(at_most(role, name, "splat from mesh, any opacity", worst(&between), LEVEL));
        verdicts.push(at_most(role, name, "either from the mixed colour", worst(&beside), LEVEL));
        alike.push(Curve::new(name, role, between));
        right.push(beside);
    }
    let name = "splats in display space, meshes in linear light";
    let apart_by_space = |o: f64| {
        let [splat, mesh] = [over(&splat(o as f32), Blend::Display), over(&mesh(o as f32), Blend::Linear)];
        [o, apart(&splat, &mesh).max_error.max(FLOOR)]
    };
    let points: Vec<[f64; 2]> = opacities.iter().map(|o| apart_by_space(*o)).collect();
    let figure = "splat from mesh, any opacity";
    let worst = largest(points.iter().map(|p| p[1]));
    verdicts.push(failing(at_most(Role::Baseline, "a space for each kind", figure, worst, LEVEL)));
    alike.push(Curve::new(name, Role::Baseline, points));
    // Colours of a file that are taken for what they aren't.
    let encoded: Vec<[f32; 3]> = vec![COLOR.map(linear_to_srgb)];
    let read = |colors: Vec<[f32; 3]>| {
        let mut splats = splat(1.0).clouds[0].splats();
        splats.colors = colors;
        over(&scene(vec![Cloud::new(splats).expect("colours are finite")]), Blend::Linear)
    };
    let opaque = "opaque colour off, declared as sRGB";
    let of_opaque = |colors| off(&read(colors), COLOR.map(f64::from));
    let decoded = encoded.iter().map(|color| color.map(srgb_to_linear)).collect();
    verdicts.push(at_most(Role::Default, "default", opaque, of_opaque(decoded), LEVEL));
    verdicts.push(failing(at_most(
        Role::Baseline,
        "sRGB taken for linear",
        opaque,
        of_opaque(encoded),
        LEVEL,
    )));

    let sigmas: Vec<f64> = ratios(49, [0.05, 3.0]).collect();
    let fine = RenderSettings { tolerance: 1e-6, cutoff: 30.0, ..unshaded() };
    let rows = [
        ("default", Role::Default, unshaded(), false),
        ("tolerance 10⁻⁶", Role::Ours, fine, false),
        ("declaration not read", Role::Baseline, fine, true),
    ];
    let mut brightness = Vec::new();
    for (filter, what) in [(OpacityFilter::Classic, "classic"), (OpacityFilter::Compensated, "compensated")] {
        for (name, role, settings, is_mistaken) in &rows {
            let taken = match (is_mistaken, filter) {
                (false, filter) => filter,
                (true, OpacityFilter::Classic) => OpacityFilter::Compensated,
                (true, OpacityFilter::Compensated) => OpacityFilter::Classic,
            };
            let errors: Vec<[f64; 2]> =
                sigmas.iter().map(|sigma| off_brightness(*sigma, [filter, taken], settings)).collect();
            let points = sigmas.iter().zip(&errors).map(|(sigma, error)| [*sigma, error[0].max(FLOOR)]);
            brightness.push(Curve::new(format!("{name}, {what}"), *role, points));
            let of = |figure: &str, i: usize, bound| {
                let found = largest(errors.iter().map(|error| error[i]));
                at_most(*role, name, &format!("{figure}, {what}"), found, bound)
            };
            let pixel = of("largest |Δα| of a splat", 1, LEVEL);
            let total = of("total opacity off, share", 0, 0.01);
            // What falls below its tolerance the default leaves out: of a splat of 0.05 px more than half.
            let is_faint = *role == Role::Default && filter == OpacityFilter::Compensated;
            verdicts.push(if *is_mistaken { failing(pixel) } else { pixel });
            verdicts.push(if *is_mistaken || is_faint { failing(total) } else { total });
        }
    }
    let spaces = [("linear", Role::Default), ("display", Role::Ours)];
    let mixes =
        spaces.iter().zip(right).map(|((name, role), points)| Curve::new(*name, *role, points)).collect();
    let panel = Panel::of_errors;
    let panels = vec![
        panel(
            "A mesh and a splat of one colour",
            Axis::linear("opacity"),
            "largest difference of the two",
            LEVEL,
            alike,
        ),
        panel(
            "Each beside the colour that it should be",
            Axis::linear("opacity"),
            "largest error",
            LEVEL,
            mixes,
        ),
        panel(
            "A splat of any size, by the filter of its file",
            Axis::log("σ in pixels"),
            "error of the total opacity, share",
            0.01,
            brightness,
        ),
    ];
    Findings { panels, verdicts }
}
