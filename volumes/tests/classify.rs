//! Classification: what it gives, sample by sample, and that giving it again changes nothing.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use std::sync::Arc;

use common::*;
use glam::Vec3;
use oblate_engine::{Cloud, Strength};
use oblate_volumes::{
    Classifier, ColorSpace, ControlPoint, GradientRamp, GridFrame, KernelSettings, StrengthKind,
    TransferFunction, Volume, Voxels, to_kernels,
};
use proptest::prelude::*;

/// Not a multiple of a brick along any axis, and several bricks along each.
const DIMS: [usize; 3] = [21, 18, 11];

fn function(points: &[(f32, f32)], kind: StrengthKind) -> TransferFunction {
    let color = |value: f32| [0.5 + 0.001 * value, 0.25, 0.75].map(|c| c.clamp(0.0, 1.0));
    let points =
        points.iter().map(|&(value, strength)| ControlPoint { value, color: color(value), strength });
    TransferFunction::new(points.collect(), kind, ColorSpace::Srgb).unwrap()
}

/// Functions that show all, nothing, a peak, a step, one end only, and through a gradient ramp.
fn functions() -> Vec<TransferFunction> {
    let extinction = |points: &[(f32, f32)]| function(points, StrengthKind::Extinction);
    let ramp = GradientRamp { low: 2.0, high: 9.0 };
    vec![
        extinction(&[(0.0, 0.7)]),
        extinction(&[(0.0, 0.0), (100.0, 0.0)]),
        extinction(&[(40.2, 0.0), (40.7, 1.0), (41.3, 0.0)]),
        extinction(&[(60.0, 0.0), (60.0, 0.3), (70.0, 0.3), (70.0, 0.0)]),
        extinction(&[(-20.0, 0.4), (5.0, 0.0)]),
        function(&[(90.0, 0.0), (95.0, 0.9), (200.0, 1.0)], StrengthKind::OpacityPerUnit),
        extinction(&[(0.0, 0.0), (50.0, 0.5)]).with_gradient(ramp).unwrap(),
        extinction(&[(30.0, 0.0), (31.0, 1.0), (80.0, 0.0)]).with_gradient(ramp).unwrap(),
    ]
}

/// A blob from 0 to 120 whose values are whole, with a flat part and noise.
fn blob() -> Vec<u8> {
    let mut random = Random(11);
    let [nx, ny, nz] = DIMS;
    let mut values = Vec::new();
    for n in 0..nx * ny * nz {
        let p = Vec3::new((n % nx) as f32, (n / nx % ny) as f32, (n / (nx * ny)) as f32);
        let value = 120.0 - 12.0 * p.distance(Vec3::new(12.0, 8.0, 5.0));
        let noise = if p.x > 4.0 { 4.0 * random.next() as f32 } else { 0.0 };
        values.push((value.max(0.0) + noise) as u8);
    }
    values
}

/// The blob in every number type; samples of the last one are missing.
fn volumes() -> Vec<Volume> {
    let blob = blob();
    let mut holed: Vec<f32> = blob.iter().map(|v| f32::from(*v) + 0.25).collect();
    for (n, value) in holed.iter_mut().enumerate() {
        if n % 7 == 3 || n % DIMS[0] > 15 {
            *value = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][n % 3];
        }
    }
    [
        Voxels::U8(blob.clone()),
        Voxels::U16(blob.iter().map(|v| u16::from(*v)).collect()),
        Voxels::I16(blob.iter().map(|v| i16::from(*v) - 60).collect()),
        Voxels::F32(blob.iter().map(|v| f32::from(*v)).collect()),
        Voxels::F32(holed),
    ]
    .into_iter()
    .zip(frames())
    .map(|(voxels, (_, frame))| Volume::new(DIMS, voxels, frame).unwrap())
    .collect()
}

/// Compares a cloud with what the definition says of each sample; returns how many show.
fn check_against_definition(volume: &Volume, transfer: &TransferFunction, cloud: &Cloud) -> usize {
    let splats = cloud.splats();
    let Strength::Extinction { masses } = splats.strength else { panic!("no extinction") };
    let place = |p: Vec3| p.to_array().map(f32::to_bits);
    let of_place: std::collections::HashMap<_, usize> =
        splats.centers.iter().enumerate().map(|(i, p)| (place(*p), i)).collect();
    assert_eq!(of_place.len(), cloud.len(), "a sample became two kernels");
    let [nx, ny, nz] = volume.dims();
    let mut count = 0;
    for n in 0..nx * ny * nz {
        let index = [n % nx, n / nx % ny, n / (nx * ny)];
        let optical = transfer.at(volume.value(index));
        let gradient = volume.gradient(index);
        let factor = transfer.gradient().map_or(1.0, |ramp| ramp.factor(gradient.length()));
        let center = (volume.steps() * glam::DVec3::from(index.map(|i| i as f64))).as_vec3();
        let Some(&kernel) = of_place.get(&place(center)) else {
            // The magnitude here is rounded to f32 before its length is taken: 1e-6 of the ramp.
            assert!(optical.extinction * factor < 1e-5, "sample {index:?} is missing");
            continue;
        };
        count += 1;
        let mass = f64::from(optical.extinction) * f64::from(factor) * volume.voxel_volume();
        assert!((f64::from(masses[kernel]) - mass).abs() <= 1e-5 * f64::from(optical.extinction));
        assert!(optical.extinction > 0.0);
        assert_eq!(splats.colors[kernel], optical.color);
        // Unit vectors in f32: a few times 6e-8.
        let normal = splats.normals.as_ref().unwrap()[kernel];
        assert!((normal + gradient.normalize_or_zero()).length() < 1e-6, "{normal} at {gradient}");
    }
    assert_eq!(count, cloud.len());
    count
}

/// The sample's own definition, and bit for bit the cloud that is built anew, whatever was classified before.
#[test]
fn every_function_gives_what_the_definition_says_each_time() {
    for volume in volumes() {
        let settings = KernelSettings::default();
        let classifier = Classifier::new(&volume, settings);
        let functions = functions();
        let mut counts = Vec::new();
        for transfer in functions.iter().chain(functions.iter().rev()) {
            let cloud = classifier.classify(transfer).unwrap();
            assert!(cloud == to_kernels(&volume, transfer, &settings).unwrap());
            counts.push(check_against_definition(&volume, transfer, &cloud));
        }
        let name = volume.voxels().type_name();
        let finite = (0..volume.voxels().len()).filter(|n| volume.voxels().get(*n).is_finite()).count();
        assert_eq!(counts[..2], [finite, 0], "{name}");
        // Of the signed volume values end at 60.
        let shown = counts[..functions.len()].iter().filter(|count| **count > 0).count();
        assert!(shown >= functions.len() - 3, "{name} shows {counts:?}");
    }
}

#[test]
fn a_classifier_may_borrow_own_or_share_its_volume() {
    let volume = volumes().remove(0);
    let (settings, transfer) = (KernelSettings::default(), functions().remove(2));
    let borrowed = Classifier::new(&volume, settings).classify(&transfer).unwrap();
    let shared = Classifier::new(Arc::new(volume.clone()), settings);
    assert_eq!(shared.volume().dims(), DIMS);
    assert!(shared.classify(&transfer).unwrap() == borrowed);
    assert!(Classifier::new(volume, settings).classify(&transfer).unwrap() == borrowed);
    assert!(!borrowed.is_empty());
}

#[test]
fn nothing_finite_gives_nothing() {
    for dims in [[1, 1, 1], [9, 1, 17]] {
        let voxels = Voxels::F32(vec![f32::NAN; dims.iter().product()]);
        let volume = Volume::new(dims, voxels, GridFrame::default()).unwrap();
        let classifier = Classifier::new(&volume, KernelSettings::default());
        assert!(functions().iter().all(|f| classifier.classify(f).unwrap().is_empty()));
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let volumes = volumes();
    let all = || -> Vec<Cloud> {
        volumes
            .iter()
            .flat_map(|volume| {
                let classifier = Classifier::new(volume, KernelSettings::default());
                functions().into_iter().map(move |f| classifier.classify(&f).unwrap())
            })
            .collect()
    };
    let [one, two, five] = on_threads(all);
    assert!(one == two && one == five);
}

proptest! {
    /// Bricks that are passed over hold nothing that shows: the count is that of the definition.
    #[test]
    fn no_brick_that_shows_is_passed_over(
        levels in prop::collection::vec(-3_i16..12, 4),
        bumps in prop::collection::vec((0_usize..20 * 9 * 9, -3.0_f32..12.0), 0..20),
        mut values in prop::collection::vec((0_i16..16).prop_map(|v| f32::from(v) * 0.5), 1..5),
        strengths in prop::collection::vec(prop::sample::select(vec![0.0_f32, 0.0, 1e-20, 0.5]), 4),
    ) {
        // A level for each brick along x and y, and single samples beside it.
        let mut samples: Vec<f32> =
            (0..20 * 9 * 9).map(|n| f32::from(levels[(n % 20 / 8 + n / 20 % 9 / 8) % 4])).collect();
        for (place, value) in bumps {
            samples[place] = value;
        }
        values.sort_by(f32::total_cmp);
        let thrice = values.windows(3).any(|w| w[0] == w[2]);
        prop_assume!(!thrice);
        let points: Vec<(f32, f32)> = values.into_iter().zip(strengths).collect();
        let transfer = function(&points, StrengthKind::Extinction);
        let expected = samples.iter().filter(|v| transfer.at(**v).extinction > 0.0).count();
        let volume = Volume::new([20, 9, 9], Voxels::F32(samples), GridFrame::default()).unwrap();
        let cloud = to_kernels(&volume, &transfer, &KernelSettings::default()).unwrap();
        prop_assert_eq!(cloud.len(), expected);
    }
}
