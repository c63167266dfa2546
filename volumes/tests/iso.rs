//! Iso-surfels of surfaces that are known: places, normals, and the cases in which there is little or nothing.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use std::f64::consts::PI;

use common::*;
use glam::DVec3;
use oblate_engine::Shapes;
use oblate_volumes::{
    GridFrame, IsoError, IsoSettings, Volume, Voxels, iso_surfels, marschner_lobb, propose_iso, shepp_logan,
};
use proptest::prelude::*;

fn surfels_at(volume: &Volume, iso: f32) -> oblate_engine::Cloud {
    iso_surfels(volume, iso, &IsoSettings::default()).unwrap()
}

fn degrees(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// The interpolant of r errs by Σ hᵢ²/8 max|∂ᵢᵢr| ≤ 3/(8r); a component of the interpolated central differences
/// by (1/6 + 3/8) max|∂³r|, and |∂³r| ≤ 1.155/r². The cell reaches √3 inwards, the differences one step more.
#[test]
fn sphere_errors_are_those_of_the_interpolant() {
    for radius in [6.0, 10.0, 20.0] {
        let frame = GridFrame::default();
        let (dims, center) = grid_around(frame, radius);
        let cloud = surfels_at(&sampled(dims, frame, |p| radius - (p - center).length()), 0.0);
        let (mut place, mut angle) = (0.0_f64, 0.0_f64);
        for (position, factor, normal, _) in surfels(&cloud) {
            let out = position - center;
            place = place.max((out.length() - radius).abs());
            angle = angle.max(degrees(normal, out));
            assert_eq!(factor.z_axis, DVec3::ZERO);
        }
        println!(
            "sphere of {radius} steps: {} surfels, place {place:.5} steps, normal {angle:.4}°",
            cloud.len()
        );
        let inner = radius - 3_f64.sqrt();
        assert!(place <= 3.0 / (8.0 * inner) + 1e-5, "{place}");
        let bound = (3_f64.sqrt() * (1.0 / 6.0 + 3.0 / 8.0) * 1.155 / (inner - 1.0).powi(2)).to_degrees();
        assert!(angle <= bound, "{angle} beyond {bound}");
    }
}

/// The signal by its formula, apart from the crate's own, and its gradient by differences.
fn signal(p: DVec3) -> f64 {
    let ripple = (12.0 * PI * (PI * p.x.hypot(p.y) / 2.0).cos()).cos();
    (1.0 - (PI * p.z / 2.0).sin() + 0.25 * (1.0 + ripple)) / 2.5
}

fn signal_gradient(p: DVec3) -> DVec3 {
    let e = 1e-5;
    let along = |axis: DVec3| (signal(p + axis * e) - signal(p - axis * e)) / (2.0 * e);
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
}

/// Distance to the signal's surface at ½ along its gradient: an upper bound of the distance; at most `reach`.
fn distance(p: DVec3, reach: f64) -> f64 {
    let direction = signal_gradient(p).normalize();
    let above = signal(p) >= 0.5;
    let steps = 300;
    (1..=steps)
        .map(|step| reach * f64::from(step) / f64::from(steps))
        .find(|&d| [-1.0, 1.0].iter().any(|side| (signal(p + direction * d * side) >= 0.5) != above))
        .unwrap_or(reach)
}

/// Residual, mean distance in world units, mean angle in degrees, over surfels a step away from the border.
fn marschner_lobb_errors(n: usize) -> [f64; 3] {
    let step = 2.0 / (n as f64 - 1.0);
    let cloud = surfels_at(&marschner_lobb(n).unwrap(), 0.5);
    let (mut residual, mut distances, mut angles, mut count) = (0.0_f64, 0.0, 0.0, 0.0);
    for (p, _, normal, _) in surfels(&cloud).into_iter().step_by(n / 20) {
        if p.abs().max_element() > 1.0 - 1.01 * step {
            continue;
        }
        residual = residual.max((signal(p) - 0.5).abs());
        distances += distance(p, step);
        angles += degrees(normal, -signal_gradient(p));
        count += 1.0;
    }
    println!(
        "Marschner-Lobb at {n}³: {} surfels, residual at most {residual:.4}, mean distance {:.4} steps, mean \
         normal error {:.2}°",
        cloud.len(),
        distances / count / step,
        angles / count
    );
    [residual, distances / count, angles / count]
}

/// Residuals keep to the interpolation error h²/8 Σ max|∂ᵢᵢ| with Σ = 0.1 (59.2² + 93 + 93) + 1 = 370: the ripple's
/// phase 12π cos(πr/2) turns by at most 59.2 a unit. At the authors' 40³ that is 0.12 of a ripple of ±0.1: the
/// hard case. Finer grids must converge with the second order of interpolant and differences (4 a doubling;
/// 3 leaves room for the terms beyond).
#[test]
fn marschner_lobb_errors_are_bounded_and_converge() {
    let [at_40, at_80, at_160] = [40, 80, 160].map(marschner_lobb_errors);
    for (n, [residual, ..]) in [(40.0, at_40), (80.0, at_80), (160.0, at_160)] {
        let step: f64 = 2.0 / (n - 1.0);
        assert!(residual <= step * step / 8.0 * 370.0, "{n}: {residual}");
    }
    assert!(at_80[1] >= 3.0 * at_160[1] && at_80[2] >= 3.0 * at_160[2], "{at_80:?} {at_160:?}");
    // At 40³ no bound can be derived that says anything: a central difference keeps sin(2π·0.48)/(2π·0.48) = 4 %
    // of the slope where the ripple is fastest, so normals there are the mean surface's, up to 84° (atan 5.92/0.63)
    // off. These two are measured, 0.143 steps and 42.5°, with a fifth to spare: they watch for change.
    assert!(at_40[1] <= 0.172 * 2.0 / 39.0 && at_40[2] <= 51.0, "{at_40:?}");
}

/// A plane is exact in every frame: places, normals, areas.
#[test]
fn a_linear_field_gives_its_plane() {
    for (name, frame) in frames() {
        let dims = [12; 3];
        let (center, normal) = (middle(dims, frame), DVec3::new(0.3, -0.5, 0.8).normalize());
        let cloud = surfels_at(&sampled(dims, frame, |p| 5.0 - 2.0 * normal.dot(p - center)), 5.0);
        assert!(cloud.len() > 100 && !surface(&cloud).closed.is_everywhere());
        for (position, factor, facing, _) in surfels(&cloud) {
            // f32 samples of a few tens, gradients of 2: a few 1e-6.
            assert!(normal.dot(position - center).abs() < 2e-5, "{name}");
            assert!(degrees(facing, normal) < 1e-3, "{name}: {facing}");
            assert!(factor.x_axis.dot(normal).abs() + factor.y_axis.dot(normal).abs() < 1e-5, "{name}");
            assert!(factor.x_axis.dot(factor.y_axis).abs() < 1e-5, "{name}");
            assert!(factor.x_axis.cross(factor.y_axis).dot(normal) > 0.0, "{name}");
        }
    }
}

/// Normals are the volume's own gradients, interpolated: one-sided at the grid's border and beside values that are missing, whatever
/// cells are looked at together.
#[test]
fn normals_are_interpolated_gradients() {
    let (dims, frame) = ([35, 18, 9], GridFrame::default());
    let wave = |p: DVec3| p.z + (0.4 * p.x).sin() + (0.5 * p.y).cos() + 0.02 * p.z * p.x - 4.5;
    let holes = [DVec3::new(20.0, 9.0, 2.0), DVec3::new(7.0, 0.0, 6.0)];
    let volume = sampled(dims, frame, |p| if holes.contains(&p) { f64::NAN } else { wave(p) });
    let cloud = surfels_at(&volume, 0.0);
    let at_border = |p: DVec3| (0..2).any(|axis| p[axis] < 1.0 || p[axis] > dims[axis] as f64 - 2.0);
    let (mut of_border, mut beside_holes) = (0, 0);
    for (position, _, normal, _) in surfels(&cloud) {
        let low = position.floor().min(DVec3::from(dims.map(|n| n as f64 - 2.0)));
        let share = position - low;
        let gradient = (0..8).map(|corner| {
            let upper = [0, 1, 2].map(|axis| corner >> axis & 1);
            let weights = [0, 1, 2].map(|a| if upper[a] == 1 { share[a] } else { 1.0 - share[a] });
            let index = [0, 1, 2].map(|axis| low[axis] as usize + upper[axis]);
            volume.gradient(index).as_dvec3() * weights.iter().product::<f64>()
        });
        let right = -gradient.sum::<DVec3>();
        // Samples of a few steps and gradients near 1, in single precision.
        assert!(degrees(normal, right) < 1e-3, "at {position}: {normal}, {right}");
        of_border += usize::from(at_border(position));
        beside_holes += usize::from(holes.iter().any(|hole| (position - *hole).length() < 2.5));
    }
    assert!(of_border > 80 && beside_holes > 4, "{of_border}, {beside_holes}");
}

#[test]
fn flattening_sets_the_thickness() {
    let (dims, center) = grid_around(GridFrame::default(), 5.0);
    let volume = sampled(dims, GridFrame::default(), |p| 5.0 - (p - center).length());
    let cloud =
        iso_surfels(&volume, 0.0, &IsoSettings { flattening: 4.0, ..IsoSettings::default() }).unwrap();
    for (_, factor, normal, _) in surfels(&cloud) {
        let thinner = factor.x_axis.length().min(factor.y_axis.length());
        assert!((factor.z_axis - normal * thinner / 4.0).length() < 1e-6);
    }
    assert!(matches!(cloud.splats().shapes, Shapes::Each(_)));
}

/// A surface through the samples themselves is there once, with its whole area.
#[test]
fn samples_on_the_value_make_no_duplicates_and_no_holes() {
    // A plane of samples at exactly the value.
    let frame = GridFrame::default();
    let cloud = surfels_at(&sampled([9, 9, 9], frame, |p| 4.0 - p.z), 0.0);
    assert_eq!(cloud.len(), 64);
    let area: f32 = surface(&cloud).areas.iter().sum();
    assert!((area - 64.0).abs() < 1e-4);
    // A plateau at exactly the value is inside: its rim, a 4³ cube's, is the surface.
    let inside = |c: f64| (3.0..=7.0).contains(&c);
    let plateau = sampled([11, 11, 11], frame, |p| f64::from(inside(p.x) && inside(p.y) && inside(p.z)));
    let cloud = surfels_at(&plateau, 1.0);
    let area: f32 = surface(&cloud).areas.iter().sum();
    assert!((area - 96.0).abs() < 1e-3 && surface(&cloud).closed.is_everywhere(), "{area}");
    // Half-way it bulges by half a step all around: faces 6·4², and rims that are chamfers.
    let bulged: f32 = surface(&surfels_at(&plateau, 0.5)).areas.iter().sum();
    assert!(bulged > 96.0 && bulged < 150.0, "{bulged}");
    // One sample at the value touches; it is no surface.
    let dot = sampled([5, 5, 5], frame, |p| f64::from(p == DVec3::splat(2.0)));
    assert!(surfels_at(&dot, 1.0).is_empty());
    assert_eq!(surfels_at(&dot, 0.5).len(), 8);
}

#[test]
fn sheets_of_one_cell_become_a_surfel_each() {
    let mut values = vec![0.0; 8];
    (values[0], values[7]) = (1.0, 1.0);
    let volume = Volume::new([2, 2, 2], Voxels::F32(values), GridFrame::default()).unwrap();
    let cloud = surfels_at(&volume, 0.5);
    assert_eq!(cloud.len(), 2);
    assert!(surfels(&cloud)[0].2.min_element() > 0.0);
}

#[test]
fn empty_thin_and_missing() {
    let frame = GridFrame::default();
    assert!(surfels_at(&sampled([8, 8, 8], frame, |_| 1.0), 0.5).is_empty());
    assert!(surfels_at(&sampled([8, 8, 8], frame, |_| f64::NAN), 0.5).is_empty());
    for dims in [[1, 1, 1], [9, 1, 1], [9, 9, 1], [1, 9, 9]] {
        assert!(surfels_at(&sampled(dims, frame, |p| p.element_sum()), 3.0).is_empty(), "{dims:?}");
    }
    // A value that is not finite takes out its eight cells and opens the surface, whatever it is.
    let whole = |p: DVec3| 3.0 - (p - DVec3::splat(5.0)).length();
    let count = surfels_at(&sampled([11; 3], frame, whole), 0.0).len();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let holed = sampled([11; 3], frame, |p| if p == DVec3::new(5.0, 5.0, 8.0) { bad } else { whole(p) });
        let cloud = surfels_at(&holed, 0.0);
        assert!(cloud.len() < count && cloud.len() >= count - 8 && !surface(&cloud).closed.is_everywhere());
    }
    // Far from the surface it changes nothing.
    let holed = sampled([11; 3], frame, |p| if p == DVec3::splat(5.0) { f64::NAN } else { whole(p) });
    let cloud = surfels_at(&holed, 0.0);
    assert!(cloud.len() == count && surface(&cloud).closed.is_everywhere());
}

#[test]
fn settings_outside_their_range_are_refused() {
    let volume = sampled([3; 3], GridFrame::default(), |p| p.x);
    let with = |iso, flattening, opacity| {
        iso_surfels(&volume, iso, &IsoSettings { flattening, opacity, ..IsoSettings::default() })
    };
    for result in [
        with(f32::NAN, 2.0, 1.0),
        with(1.0, 0.5, 1.0),
        with(1.0, f32::NAN, 1.0),
        with(1.0, 2.0, 1.5),
        with(1.0, 2.0, f32::NAN),
    ] {
        assert!(matches!(result, Err(IsoError::Setting { .. })), "{result:?}");
    }
    assert_eq!(surface(&with(0.5, 2.0, 0.25).unwrap()).opacities.as_ref().unwrap()[0], 0.25);
}

/// At a world origin of 1e6 with steps of 1e-3 the surface lies as well as at 0.
#[test]
fn large_origins_lose_nothing() {
    let origin = DVec3::new(1e6, -2e6, 3e6);
    let frame = GridFrame { spacing: DVec3::splat(1e-3), origin, ..GridFrame::default() };
    let values = (0..1000).map(|i| (i % 10) as f32).collect();
    let cloud = surfels_at(&Volume::new([10; 3], Voxels::F32(values), frame).unwrap(), 4.25);
    for (position, ..) in surfels(&cloud) {
        // f64 resolves 1e6 to 1e-10.
        assert!((position.x - origin.x - 4.25e-3).abs() < 1e-9, "{position}");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let volume = marschner_lobb(40).unwrap();
    let [one, two, five] = on_threads(|| surfels_at(&volume, 0.5));
    assert!(one == two && one == five);
}

#[test]
fn the_phantom_has_closed_surfaces() {
    let volume = shepp_logan(96).unwrap();
    assert_eq!(volume.value([48, 48, 0]), 0.0);
    // At y = −0.3 in the middle there is brain, at y = −0.9 skull, which is 0.046 thick: two steps.
    assert!((volume.value([48, 33, 48]) - 0.2).abs() < 1e-6);
    let [low, high] = volume.value_range().unwrap();
    assert!(low >= -1e-6 && (0.95..=1.0).contains(&high), "{low} to {high}");
    let iso = propose_iso(&volume).unwrap();
    assert!(surface(&surfels_at(&volume, iso)).closed.is_everywhere());
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    /// Noise, with sheets and saddles in its cells: every surfel has an area and a unit normal and lies within a
    /// thousandth of a step of the grid.
    #[test]
    fn noise_keeps_the_promises(values in prop::collection::vec(-1.0_f32..1.0, 64)) {
        let volume = Volume::new([4, 4, 4], Voxels::F32(values), GridFrame::default()).unwrap();
        for (position, _, normal, area) in surfels(&surfels_at(&volume, 0.0)) {
            prop_assert!(area > 0.0 && (normal.length() - 1.0).abs() < 1e-5);
            let clamped = position.clamp(DVec3::ZERO, DVec3::splat(3.0));
            prop_assert!((position - clamped).length() <= 3_f64.sqrt() / 1024.0 + 1e-6);
        }
    }
}
