//! Kernels: they sum to the field, lie where the frame says, and nothing empty becomes one.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use common::*;
use glam::{DMat3, DVec3};
use oblate_engine::{Cloud, Shapes, Strength, color::srgb_to_linear};
use oblate_volumes::{
    ColorSpace, ControlPoint, Flattening, GradientRamp, GridFrame, KernelSettings, StrengthKind,
    TransferFunction, Volume, Voxels, marschner_lobb, to_kernels,
};

fn point(value: f32, strength: f32) -> ControlPoint {
    ControlPoint { value, color: [0.5, 0.25, 1.0], strength }
}

/// Extinction = value, from 0 to 10.
fn ramp() -> TransferFunction {
    let points = vec![point(0.0, 0.0), point(10.0, 10.0)];
    TransferFunction::new(points, StrengthKind::Extinction, ColorSpace::Linear).unwrap()
}

fn kernels(volume: &Volume) -> Cloud {
    to_kernels(volume, &ramp(), &KernelSettings::default()).unwrap()
}

fn masses(cloud: &Cloud) -> Vec<f32> {
    match cloud.splats().strength {
        Strength::Extinction { masses } => masses,
        other => panic!("no extinction but {other:?}"),
    }
}

fn world(cloud: &Cloud, index: usize) -> DVec3 {
    cloud.cloud_to_world().transform_point3(cloud.center(index).as_dvec3())
}

/// Poisson summation: a lattice of Gaussians of 0.7 steps ripples by 6 e^(−2π²·0.49) = 3.8·10⁻⁴, whatever the
/// lattice; the masses are f32.
#[test]
fn kernels_of_a_constant_field_sum_to_it() {
    let mut random = Random(3);
    for (name, frame) in frames() {
        let dims = [17; 3];
        let cloud = kernels(&sampled(dims, frame, |_| 2.5));
        assert_eq!(cloud.len(), 17 * 17 * 17);
        let Shapes::Shared(factor) = cloud.splats().shapes else { panic!("one covariance for a grid") };
        let factor = factor.as_dmat3();
        let steps = frame.direction * DMat3::from_diagonal(frame.spacing);
        let peak = (2.0 * std::f64::consts::PI).powf(-1.5) / factor.determinant().abs();
        for _ in 0..50 {
            let aside = DVec3::new(random.next(), random.next(), random.next());
            let at = middle(dims, frame) + steps * aside;
            let sum: f64 = masses(&cloud)
                .iter()
                .enumerate()
                .map(|(i, mass)| {
                    let d = factor.inverse() * (at - world(&cloud, i));
                    f64::from(*mass) * peak * (-0.5 * d.length_squared()).exp()
                })
                .sum();
            assert!((sum / 2.5 - 1.0).abs() < 4e-4, "{name}: {sum}");
        }
    }
}

/// The one sample that is not empty becomes the one kernel, at the place, with the mass and colour.
#[test]
fn a_marked_corner_lands_where_the_frame_says() {
    let dims = [3, 4, 5];
    for (name, frame) in frames() {
        for (corner, index) in [([0, 0, 0], 0), ([2, 0, 0], 2), ([0, 3, 0], 9), ([2, 3, 4], 59)] {
            let mut values = vec![0_u8; 60];
            values[index] = 4;
            let cloud = kernels(&Volume::new(dims, Voxels::U8(values), frame).unwrap());
            assert_eq!(cloud.len(), 1, "{name}");
            let place = DVec3::from(corner.map(f64::from)) * frame.spacing;
            let expected = frame.origin
                + frame.direction.x_axis * place.x
                + frame.direction.y_axis * place.y
                + frame.direction.z_axis * place.z;
            assert!((world(&cloud, 0) - expected).length() < 1e-5, "{name}");
            let volume = frame.spacing.element_product() * frame.direction.determinant().abs();
            assert!((f64::from(masses(&cloud)[0]) - 4.0 * volume).abs() < 1e-6 * volume, "{name}");
            assert_eq!(cloud.splats().colors[0], [0.5, 0.25, 1.0]);
        }
    }
}

#[test]
fn normals_point_to_lower_values() {
    for (name, frame) in frames() {
        let up = DVec3::new(0.2, 0.5, -0.3);
        let cloud = kernels(&sampled([4; 3], frame, |p| 5.0 + 0.1 * up.dot(p - frame.origin)));
        for normal in cloud.splats().normals.as_ref().unwrap() {
            assert!((normal.as_dvec3() + up.normalize()).length() < 1e-4, "{name}: {normal}");
        }
    }
    let flat = kernels(&sampled([3; 3], GridFrame::default(), |_| 1.0));
    assert!(flat.splats().normals.as_ref().unwrap().iter().all(|n| *n == glam::Vec3::ZERO));
}

#[test]
fn what_is_empty_becomes_nothing() {
    let frame = GridFrame::default();
    for value in [0.0, -3.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert!(kernels(&sampled([5; 3], frame, |_| value)).is_empty(), "{value}");
    }
    for dims in [[1, 1, 1], [20, 1, 1], [1, 9, 9]] {
        let cloud = kernels(&sampled(dims, frame, |_| 1.0));
        assert_eq!(cloud.len(), dims.iter().product::<usize>());
    }
    // Missing samples leave their neighbours' gradients one-sided and finite.
    let holed =
        kernels(&sampled([5; 3], frame, |p| if p == DVec3::splat(2.0) { f64::NAN } else { 1.0 + p.x }));
    assert_eq!(holed.len(), 124);
    for normal in holed.splats().normals.as_ref().unwrap() {
        assert!((*normal + glam::Vec3::X).length() < 1e-6, "{normal}");
    }
}

/// Every number type reads the same numbers.
#[test]
fn number_types_agree() {
    let frame = GridFrame::default();
    let of = |voxels| kernels(&Volume::new([3, 3, 3], voxels, frame).unwrap());
    let expected = of(Voxels::F32((0..27).map(|i| (i % 11) as f32).collect()));
    assert!(of(Voxels::U8((0..27).map(|i| i % 11).collect())) == expected);
    assert!(of(Voxels::U16((0..27).map(|i| i % 11).collect())) == expected);
    assert!(of(Voxels::I16((0..27).map(|i| i % 11).collect())) == expected);
    let negative = of(Voxels::I16(vec![-5; 27]));
    assert!(negative.is_empty());
}

fn indices(dims: [usize; 3]) -> Vec<[i32; 3]> {
    let cloud = kernels(&sampled(dims, GridFrame::default(), |_| 1.0));
    cloud.splats().centers.iter().map(|c| c.to_array().map(|x| x as i32)).collect()
}

/// Kernels are all there, once.
#[test]
fn every_sample_becomes_one_kernel() {
    let mut seen = indices([20, 11, 9]);
    assert_eq!(seen.len(), 20 * 11 * 9);
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen.len(), 20 * 11 * 9);
}

/// Morton order: each run of 8ⁿ kernels, from a multiple of 8ⁿ on, fills a cube of side 2ⁿ.
#[test]
fn neighbours_in_memory_are_neighbours_in_space() {
    for n in 1..=4 {
        for run in indices([32, 16, 32]).chunks(1 << (3 * n)) {
            for axis in 0..3 {
                let (low, high) = run.iter().fold((99, 0), |(l, h), i| (l.min(i[axis]), h.max(i[axis])));
                assert!(high - low < 1 << n, "{low} to {high} in a run of 8^{n}");
            }
        }
    }
}

#[test]
fn the_gradient_ramp_multiplies_extinction() {
    let frame = GridFrame { spacing: DVec3::splat(0.5), ..GridFrame::default() };
    // Slope 2 a world unit is 1 a step: half-way up a ramp from 1 to 3.
    let volume = sampled([4; 3], frame, |p| 2.0 + 2.0 * p.y);
    let transfer = ramp().with_gradient(GradientRamp { low: 1.0, high: 3.0 }).unwrap();
    let whole = kernels(&volume);
    let half = to_kernels(&volume, &transfer, &KernelSettings::default()).unwrap();
    for (half, whole) in masses(&half).iter().zip(masses(&whole)) {
        assert!((half / whole - 0.5).abs() < 1e-5);
    }
    let steep = ramp().with_gradient(GradientRamp { low: 2.5, high: 3.0 }).unwrap();
    assert!(to_kernels(&volume, &steep, &KernelSettings::default()).unwrap().is_empty());
}

/// A layer thinner than a step, between samples: classified at samples it is not there; after interpolation its optical depth is that of the
/// samples in it, of which one more or less is there than fits.
#[test]
fn refined_volumes_are_classified_after_interpolation() {
    let volume = sampled([4, 4, 21], GridFrame::default(), |p| p.z);
    let layer =
        [(10.2, 0.0), (10.2, 5.0), (10.8, 5.0), (10.8, 0.0)].map(|(value, strength)| point(value, strength));
    let transfer =
        TransferFunction::new(layer.to_vec(), StrengthKind::Extinction, ColorSpace::Linear).unwrap();
    assert!(to_kernels(&volume, &transfer, &KernelSettings::default()).unwrap().is_empty());
    for times in [5, 10, 20] {
        let fine = volume.refined(times).unwrap();
        let cloud = to_kernels(&fine, &transfer, &KernelSettings::default()).unwrap();
        let [nx, ny, _] = fine.dims();
        let area = (nx * ny) as f64 / (times * times) as f64;
        let depth = masses(&cloud).iter().map(|m| f64::from(*m)).sum::<f64>() / area;
        assert!((depth - 3.0).abs() <= 5.0 / times as f64 + 1e-4, "{depth} at {times} samples a step");
    }
}

/// A volume has as much extinction however finely it is classified, one slice as well: its voxels reach half a step beyond its samples.
#[test]
fn refined_volumes_have_as_much_extinction() {
    let spacing = DVec3::new(0.5, 0.7, 0.2);
    for dims in [[5, 4, 3], [5, 4, 1]] {
        let volume = sampled(dims, GridFrame { spacing, ..GridFrame::default() }, |_| 1.0);
        let whole = dims.iter().product::<usize>() as f64 * spacing.element_product();
        for times in 1..=4 {
            let mass: f64 =
                masses(&kernels(&volume.refined(times).unwrap())).iter().map(|m| f64::from(*m)).sum();
            assert!(
                (mass / whole - 1.0).abs() < 1e-5,
                "{dims:?}: {mass} at {times} samples a step, not {whole}"
            );
        }
    }
}

#[test]
fn large_origins_lose_nothing() {
    let frame = GridFrame { spacing: DVec3::splat(1e-3), origin: DVec3::splat(1e6), ..GridFrame::default() };
    let cloud = kernels(&sampled([8; 3], frame, |_| 1.0));
    let [low, high] = cloud.bounds().unwrap();
    // f64 resolves 1e6 to 1e-10.
    assert!((high - low - DVec3::splat(7e-3)).length() < 1e-9, "{low} {high}");
}

#[test]
fn colours_become_linear() {
    let points = vec![point(0.0, 1.0)];
    let transfer = TransferFunction::new(points, StrengthKind::Extinction, ColorSpace::Srgb).unwrap();
    let volume = sampled([2; 3], GridFrame::default(), |_| 1.0);
    let cloud = to_kernels(&volume, &transfer, &KernelSettings::default()).unwrap();
    assert_eq!(cloud.splats().colors[0], [0.5, 0.25, 1.0].map(srgb_to_linear));
}

#[test]
fn masses_beyond_f32_are_refused() {
    let frame = GridFrame { spacing: DVec3::splat(1e20), ..GridFrame::default() };
    let volume = Volume::new([1; 3], Voxels::U8(vec![1]), frame).unwrap();
    assert!(to_kernels(&volume, &ramp(), &KernelSettings::default()).is_err());
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let volume = marschner_lobb(40).unwrap();
    let [one, two, five] = on_threads(|| kernels(&volume));
    assert!(one == two && one == five && one.len() > 1000);
}

/// Of a linear field the surface is a plane: samples within half a step of it lie on it and are flat, or nearer and thinner by the ratio,
/// and all else is as it was. Places and factors are f32 of some ten units.
#[test]
fn samples_at_a_surface_become_surfels() {
    let direction = DVec3::new(0.8, 0.5, -0.3);
    for (name, frame) in frames() {
        let volume = sampled([12; 3], frame, |p| 50.0 + direction.dot(p - frame.origin));
        let value = volume.sample(DVec3::new(5.2, 5.7, 6.1)).unwrap();
        let flattened = |least_gradient, ratio| {
            let flattening = Some(Flattening { value, least_gradient, ratio });
            to_kernels(&volume, &ramp(), &KernelSettings { flattening, ..Default::default() }).unwrap()
        };
        let round = kernels(&volume);
        let unit = direction.normalize();
        let above = |cloud: &Cloud, i| {
            let place = cloud.center(i).as_dvec3();
            (f64::from(value) - 50.0 - direction.dot(place)) / direction.length()
        };
        let index_slope = (volume.gradients_to_world().inverse() * direction).length();
        for ratio in [1.0, 4.0, f32::INFINITY] {
            let cloud = flattened(0.0, ratio);
            assert_eq!(masses(&cloud), masses(&round));
            let mut flat = 0;
            for i in 0..cloud.len() {
                let steps = above(&round, i) * direction.length() / index_slope;
                // At the very limit rounding decides.
                if (steps.abs() - 0.5).abs() < 1e-4 {
                    continue;
                }
                let pressed = if steps.abs() < 0.5 { f64::from(ratio) } else { 1.0 };
                flat += usize::from(steps.abs() < 0.5);
                let left = above(&cloud, i) - above(&round, i) / pressed;
                assert!(left.abs() < 2e-4, "{name}, {ratio}: {left} left of {}", above(&round, i));
                let extent =
                    |cloud: &Cloud, along: DVec3| (cloud.factor(i).as_dmat3().transpose() * along).length();
                let thin = extent(&cloud, unit) - extent(&round, unit) / pressed;
                assert!(thin.abs() < 1e-4, "{name}, {ratio}: {thin}");
            }
            assert!(flat > 50 && 4 * flat < cloud.len(), "{name}: {flat} of {}", cloud.len());
        }
        // What is too even for a surface stays as it is.
        let even = flattened(2.0 * direction.length() as f32, f32::INFINITY);
        assert!(
            (0..even.len()).all(|i| (even.center(i), even.factor(i)) == (round.center(i), round.factor(i)))
        );
    }
}
