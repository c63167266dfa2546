//! Grids as fields: gradients, samples, histograms, and what is fitted to them.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use common::*;
use glam::{DVec3, Vec3};
use oblate_volumes::{
    GridFrame, KernelSettings, PRESETS, Volume, VolumeError, Voxels, marschner_lobb, preset, propose_iso,
    shepp_logan, to_kernels,
};
use proptest::prelude::*;

#[test]
fn gradients_of_a_linear_field_are_exact_in_any_frame() {
    let slope = DVec3::new(0.7, -1.1, 0.4);
    for (name, frame) in frames() {
        let volume = sampled([3, 4, 5], frame, |p| slope.dot(p - frame.origin));
        for index in [[0, 0, 0], [1, 2, 2], [2, 3, 4], [0, 3, 2]] {
            // Samples below 20 in f32, differences of half a step: 1e-5.
            let gradient = volume.gradient(index).as_dvec3();
            assert!((gradient - slope).length() < 1e-5, "{name} at {index:?}: {gradient}");
        }
    }
}

#[test]
fn gradients_pass_by_what_is_missing() {
    let row = |values: &[f32]| {
        Volume::new([values.len(), 1, 1], Voxels::F32(values.to_vec()), GridFrame::default()).unwrap()
    };
    assert_eq!(row(&[1.0, 3.0, f32::NAN]).gradient([1, 0, 0]), Vec3::new(2.0, 0.0, 0.0));
    assert_eq!(row(&[f32::NAN, 3.0, f32::NAN]).gradient([1, 0, 0]), Vec3::ZERO);
    assert_eq!(row(&[3.0]).gradient([0, 0, 0]), Vec3::ZERO);
}

#[test]
fn refined_volumes_are_the_same_field() {
    for (name, frame) in frames() {
        let volume = sampled([4, 3, 5], frame, |p| p.x * p.y - 0.3 * p.z);
        for times in [2, 3] {
            let fine = volume.refined(times).unwrap();
            let last = volume.dims().map(|d| d * times - 1);
            assert_eq!(fine.dims(), last.map(|d| d + 1));
            for index in [[0, 0, 0], last, [4, 5, 7]] {
                // Middles of parts of voxels.
                let at = DVec3::from(index.map(|i| (i as f64 + 0.5) / times as f64 - 0.5));
                let place = fine.index_to_world().transform_point3(DVec3::from(index.map(|i| i as f64)))
                    - volume.index_to_world().transform_point3(at);
                assert!(place.length() < 1e-12, "{name}: {place}");
                let inside = at.clamp(DVec3::ZERO, DVec3::from(volume.dims().map(|d| (d - 1) as f64)));
                let wanted = volume.sample(inside).unwrap();
                assert!((fine.value(index) - wanted).abs() < 1e-5 * wanted.abs().max(1.0), "{name}");
            }
        }
        assert_eq!(volume.refined(1).unwrap().dims(), volume.dims());
    }
    let missing = Volume::new([2, 1, 1], Voxels::F32(vec![1.0, f32::NAN]), GridFrame::default()).unwrap();
    let Voxels::F32(values) = missing.refined(2).unwrap().voxels().clone() else { panic!("f32") };
    assert!(values[0] == 1.0 && values[1].is_nan() && values[2].is_nan(), "{values:?}");
    for times in [0, usize::MAX, 1 << 40] {
        assert!(matches!(missing.refined(times), Err(VolumeError::Refined { .. })), "{times}");
    }
}

#[test]
fn samples_are_trilinear() {
    let field = |p: DVec3| 1.0 + 2.0 * p.x - p.y + 0.5 * p.z + p.x * p.y - p.x * p.y * p.z;
    let volume = sampled([4, 3, 2], GridFrame::default(), field);
    for p in [DVec3::ZERO, DVec3::new(3.0, 2.0, 1.0), DVec3::new(0.3, 0.7, 0.1), DVec3::new(2.0, 1.0, 0.5)] {
        let cell = p.floor();
        // Within a cell the field is trilinear; f32 samples of a few units.
        assert!((f64::from(volume.sample(p).unwrap()) - field(p)).abs() < 1e-5, "{p} in {cell}");
    }
    for outside in [DVec3::new(-0.01, 0.0, 0.0), DVec3::new(0.0, 0.0, 1.01), DVec3::NAN] {
        assert_eq!(volume.sample(outside), None);
    }
    let holed = Volume::new([2, 1, 1], Voxels::F32(vec![1.0, f32::NAN]), GridFrame::default()).unwrap();
    assert_eq!(holed.sample(DVec3::ZERO), Some(1.0));
    assert_eq!(holed.sample(DVec3::new(0.5, 0.0, 0.0)), None);
}

#[test]
fn histograms_count_what_is_finite() {
    let values = vec![0.0, 1.0, 1.0, 4.0, f32::NAN, f32::INFINITY];
    let volume = Volume::new([6, 1, 1], Voxels::F32(values), GridFrame::default()).unwrap();
    let histogram = volume.histogram(4).unwrap();
    assert_eq!(histogram.counts(), [1, 2, 0, 1]);
    assert_eq!((histogram.range(), histogram.ignored()), ([0.0, 4.0], 2));
    assert_eq!(histogram.center(0), 0.5);
    // Bins of integers hold whole integers: 0 to 9 in at most 4 bins is 3 each, the last short.
    let integers = Volume::new([10, 1, 1], Voxels::I16((0..10).collect()), GridFrame::default()).unwrap();
    assert_eq!(integers.histogram(4).unwrap().counts(), [3, 3, 3, 1]);
    assert_eq!(integers.histogram(4).unwrap().center(0), 1.0);
    let none = Volume::new([1, 1, 1], Voxels::F32(vec![f32::NAN]), GridFrame::default()).unwrap();
    assert!(none.histogram(8).is_none() && none.value_range().is_none());
}

/// Two classes far apart: 30 × 10 and 10 × 200 part half-way, with known moments.
#[test]
fn classes_part_two_peaks() {
    let values = (0..40)
        .map(|i| {
            if i < 15 {
                9
            } else if i < 30 {
                11
            } else {
                200_u8
            }
        })
        .collect();
    let volume = Volume::new([40, 1, 1], Voxels::U8(values), GridFrame::default()).unwrap();
    let classes = volume.histogram(256).unwrap().classes().unwrap();
    assert_eq!((classes.low_mean, classes.low_deviation, classes.high_mean), (10.0, 1.0, 200.0));
    assert_eq!(propose_iso(&volume), Some(105.5));
}

/// A ball in a box: the value proposed is inside the range, and its surface a sphere inside the box.
#[test]
fn proposals_are_sensible_for_analytic_volumes() {
    let (dims, center) = grid_around(GridFrame::default(), 10.0);
    let ball = sampled(dims, GridFrame::default(), |p| 10.0 - (p - center).length());
    let iso = propose_iso(&ball).unwrap();
    assert!((-8.0..8.0).contains(&iso), "{iso}");
    // A flat volume has no surface; one without finite values has nothing.
    for value in [3.0, f64::NAN] {
        assert_eq!(propose_iso(&sampled([3; 3], GridFrame::default(), |_| value)), None);
    }
}

/// Optical depth along the middle of a volume, looking along z.
fn depth_through_the_middle(volume: &Volume, name: &str) -> f64 {
    let transfer = preset(name).unwrap().fit(volume).unwrap();
    let [nx, ny, nz] = volume.dims();
    let values = (0..nz).map(|k| transfer.at(volume.value([nx / 2, ny / 2, k])).extinction);
    values.map(f64::from).sum::<f64>() * volume.frame().spacing.z
}

#[test]
fn presets_are_fitted() {
    // A block of 12³ ones in 24³ zeros: its optical depth is 3 whatever the units of length and value.
    for (scale, value) in [(1.0, 1.0), (1e-3, 1.0), (50.0, 700.0)] {
        let frame = GridFrame { spacing: DVec3::splat(scale), ..GridFrame::default() };
        let inside = |p: DVec3| (p / scale - 11.5).abs().max_element() < 6.0;
        let volume = sampled([24; 3], frame, |p| if inside(p) { value } else { 0.0 });
        for preset in &PRESETS {
            let depth = depth_through_the_middle(&volume, preset.name);
            assert!((depth - 3.0).abs() < 0.05, "{} at {scale}: {depth}", preset.name);
            assert_eq!(preset.fit(&volume).unwrap().at(0.0).extinction, 0.0);
        }
    }
    assert!(preset("no such preset").is_none());
}

#[test]
fn presets_fit_odd_volumes() {
    let frame = GridFrame::default();
    let volumes = [
        sampled([1; 3], frame, |_| 5.0),
        sampled([3; 3], frame, |_| 0.0),
        sampled([3; 3], frame, |_| f64::NAN),
        sampled([3; 3], frame, |p| 1e9 + 64.0 * p.x),
        sampled([3; 3], frame, |p| 3e38 * (p.x - 1.0)),
        marschner_lobb(8).unwrap(),
        shepp_logan(16).unwrap(),
    ];
    for volume in &volumes {
        for preset in &PRESETS {
            let transfer = preset.fit(volume).unwrap();
            to_kernels(volume, &transfer, &KernelSettings::default()).unwrap();
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the values are: proposals lie in the range, presets fit, nothing panics.
    #[test]
    fn any_values_fit(values in prop::collection::vec(prop::num::f32::ANY, 27)) {
        let volume = Volume::new([3; 3], Voxels::F32(values), GridFrame::default()).unwrap();
        if let (Some(iso), Some([low, high])) = (propose_iso(&volume), volume.value_range()) {
            prop_assert!(low <= iso && iso <= high, "{low} {iso} {high}");
        }
        for preset in &PRESETS {
            prop_assert!(preset.fit(&volume).is_ok());
        }
    }
}
