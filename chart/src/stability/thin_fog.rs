//! Case 7: thin fog.

use super::setups::*;
use super::{Case, Findings};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{Baseline, Camera, Cloud, OpacityFilter, Order, Pose, RenderSettings, Shapes, Strength};

pub(super) const CASE: Case = Case {
    number: 7,
    title: "Thin fog",
    criterion: "Up to 1000 layers, each with an opacity of 0.0039, less than a level of 8 bits, let through what their product lets through, within 10⁻³; one kernel split into up to 1000 looks like the whole one within 1/255.",
    run,
};

/// The opacity of a layer: a little less than a level of 8 bits.
const THIN: f64 = 0.0039;
/// Optical depth of the kernel that is split.
const WHOLE: f64 = 2.0;

/// Splats of one optical depth each along a ray through all centres: what it lets through.
type Through<'a> = Box<dyn Fn(usize, f64) -> f64 + 'a>;

/// What the engine lets through a number of splats, a thousandth of their σ apart.
fn drawn(is_trained: bool, settings: &RenderSettings, count: usize, depth: f64) -> f64 {
    let pose =
        Pose::look_at(DVec3::NEG_Z * 20.0, DVec3::ZERO, DVec3::Y).expect("the eye is not at the origin");
    // One pixel that is a hundredth of σ wide: its filter is nothing.
    let camera = Camera::orthographic(pose, 0.01, [1; 2]).expect("the size is in range");
    let strength = if is_trained {
        let peaks = vec![-(-depth).exp_m1() as f32; count];
        Strength::Opacity { peaks, filter: OpacityFilter::Compensated, least: 0.0 }
    } else {
        Strength::Extinction { masses: vec![mass_of(depth as f32, Mat3::IDENTITY); count] }
    };
    let centers = (0..count).map(|i| Vec3::Z * 1e-3 * i as f32).collect();
    let layers: Cloud = splats(centers, Shapes::Shared(Mat3::IDENTITY), strength, vec![[1.0; 3]; count]);
    1.0 - alphas(&draw(&scene(vec![layers]), &camera, settings))[0]
}

/// Opacities below 1/255 dropped, as all programs for trained splats do.
fn cut(count: usize, depth: f64) -> f64 {
    let alpha = -(-depth).exp_m1();
    if alpha < LEVEL { 1.0 } else { (1.0 - alpha).powi(count as i32) }
}

/// What is seen kept in 8 bits, from back to front.
fn in_8_bits(count: usize, depth: f64) -> f64 {
    let alpha = -(-depth).exp_m1();
    let over = |behind: f64| ((alpha + (1.0 - alpha) * behind) * 255.0).round() / 255.0;
    1.0 - (0..count).fold(0.0, |behind, _| over(behind))
}

fn run() -> Findings {
    let engine = |is_trained, settings: RenderSettings| -> Through<'static> {
        Box::new(move |count, depth| drawn(is_trained, &settings, count, depth))
    };
    let taylor = RenderSettings { baseline: Some(Baseline::Taylor), ..ordered(Order::Centers) };
    let fine = RenderSettings { tolerance: 1e-6, ..unshaded() };
    let methods: [(&str, Role, Through<'_>); 8] = [
        ("default, volume kernels", Role::Default, engine(false, unshaded())),
        ("exact", Role::Ours, engine(false, nothing_but(Order::Auto))),
        ("sorted centres", Role::Ours, engine(false, ordered(Order::Centers))),
        ("default, trained", Role::Default, engine(true, unshaded())),
        ("trained, tolerance 1e-6", Role::Ours, engine(true, fine)),
        ("opacities below 1/255 dropped", Role::Baseline, Box::new(cut)),
        ("8 bits", Role::Baseline, Box::new(in_8_bits)),
        ("α = τ (Taylor)", Role::Baseline, engine(false, taylor)),
    ];
    let counts: Vec<usize> = {
        let mut counts: Vec<usize> = ratios(31, [1.0, 1000.0]).map(|n| n.round() as usize).collect();
        counts.dedup();
        counts
    };
    let depth = -(-THIN).ln_1p();
    let layers = |through: &Through<'_>| -> Vec<[f64; 2]> {
        let off = |n: usize| (through(n, depth) - (-depth * n as f64).exp()).abs();
        counts.iter().map(|n| [*n as f64, off(*n).max(FLOOR)]).collect()
    };
    let split = |through: &Through<'_>| -> Vec<[f64; 2]> {
        let off = |n: usize| (through(n, WHOLE / n as f64) - (-WHOLE).exp()).abs();
        counts.iter().map(|n| [*n as f64, off(*n).max(FLOOR)]).collect()
    };
    let curves = |of: &dyn Fn(&Through<'_>) -> Vec<[f64; 2]>| -> Vec<Curve> {
        methods.iter().map(|(name, role, through)| Curve::new(*name, *role, of(through))).collect()
    };
    let (of_layers, of_split) = (curves(&layers), curves(&split));

    let mut verdicts = Vec::new();
    for (k, (name, role, _)) in methods.iter().enumerate() {
        let worst = |curve: &Curve| largest(curve.points.iter().map(|p| p[1]));
        let layers =
            at_most(*role, name, "up to 1000 layers: transmittance off by", worst(&of_layers[k]), 1e-3);
        let parts = at_most(*role, name, "one split in up to 1000: off by", worst(&of_split[k]), LEVEL);
        let fails = *role == Role::Baseline;
        verdicts.extend([layers, parts].map(|v| if fails { failing(v) } else { v }));
    }

    let estimate = counts.iter().map(|n| [*n as f64, THIN * *n as f64]).filter(|p| p[1] < 1.0);
    let estimate = Curve::new("Nα, lost by the cut", Role::Estimate, estimate);
    let y = || Axis::log("transmittance off by");
    let panels = vec![
        Panel {
            title: "Layers of fog, an opacity of 0.0039 each".into(),
            x: Axis::log("layers"),
            y: y(),
            bound: Some(1e-3),
            curves: of_layers.into_iter().chain([estimate]).collect(),
        },
        Panel {
            title: "A kernel with an optical depth of 2, split".into(),
            x: Axis::log("parts"),
            y: y(),
            bound: Some(LEVEL),
            curves: of_split,
        },
    ];
    Findings { panels, verdicts }
}
