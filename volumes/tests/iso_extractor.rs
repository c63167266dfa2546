//! One value after another, all types of samples, slabs of a grid, the smooth choice: the same surfels on every way.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use common::*;
use glam::{DAffine3, DVec3};
use oblate_engine::{Closed, Cloud, Splats};
use oblate_volumes::{
    Grid, GridFrame, Interpolation, IsoError, IsoExtractor, IsoSettings, IsoSurfel, IsoSurfels, Volume,
    Voxels, iso_surfels, marschner_lobb, stream_iso_surfels,
};

/// Two balls in a grid of several blocks, none of whose sides is a multiple of a brick's.
fn balls() -> Volume {
    let ball = |p: DVec3, center: DVec3, radius: f64| radius - (p - center).length();
    sampled([75, 45, 150], GridFrame::default(), |p| {
        let near = ball(p, DVec3::new(25.3, 22.1, 30.7), 17.0);
        near.max(ball(p, DVec3::new(45.2, 21.4, 104.9), 16.0)).max(ball(
            p,
            DVec3::new(70.0, 20.0, 64.0),
            12.0,
        ))
    })
}

/// In the order of their places.
fn sorted(surfels: impl Iterator<Item = IsoSurfel>) -> Vec<IsoSurfel> {
    let mut surfels: Vec<IsoSurfel> = surfels.collect();
    let key = |s: &IsoSurfel| s.center.to_array().map(|x| (x * 1e3) as i64);
    surfels.sort_by_key(|s| (key(s), s.area.to_bits()));
    surfels
}

#[test]
fn values_one_after_the_other_are_as_values_by_themselves() {
    let volume = balls();
    let extractor = IsoExtractor::new(&volume);
    let mut kept = IsoSurfels::default();
    for value in [0.0, 5.0, -3.0, 100.0, 0.0] {
        extractor.extract_into(value, Interpolation::Trilinear, &mut kept).unwrap();
        assert_eq!(kept, extractor.extract(value, Interpolation::Trilinear).unwrap());
        assert_eq!(kept.len(), kept.iter().count());
        let area: f64 = kept.iter().map(|s| f64::from(s.area)).sum();
        assert!((kept.area() - area).abs() <= 1e-9 * area);
        let cloud = kept.cloud(&IsoSettings::default()).unwrap();
        assert_eq!(cloud, iso_surfels(&volume, value, &IsoSettings::default()).unwrap());
        let parts: Vec<_> = kept.parts(&IsoSettings::default()).collect();
        let centers: Vec<_> = parts.iter().flat_map(|part| part.centers.clone()).collect();
        assert_eq!(centers, kept.splats(&IsoSettings::default()).centers);
    }
    // Nothing is at 100, and the third ball ends at the border.
    assert!(extractor.extract(100.0, Interpolation::Trilinear).unwrap().is_empty());
    assert!(!kept.is_closed());
}

/// The cloud is that of the arrays, whose normals are those of the shapes.
#[test]
fn a_cloud_is_that_of_its_splats() {
    let surfels = IsoExtractor::new(balls()).extract(0.0, Interpolation::Trilinear).unwrap();
    assert!(surfels.len() > 5000, "{}: more than a thread makes at a time", surfels.len());
    let mut renewed = Cloud::default();
    for (opacity, flattening) in [(1.0, f32::INFINITY), (0.5, f32::INFINITY), (1.0, 4.0)] {
        let settings = IsoSettings { opacity, flattening, ..IsoSettings::default() };
        let splats = surfels.splats(&settings);
        for (index, normal) in splats.normals.iter().flatten().enumerate() {
            let factor = splats.shapes.factor(index);
            // A few roundings of numbers up to 1.
            assert!((factor.x_axis.cross(factor.y_axis).normalize() - *normal).length() < 1e-6);
        }
        let through = Cloud::new(Splats { normals: None, ..splats }).unwrap();
        let origin = DAffine3::from_translation(surfels.frame().origin);
        let cloud = surfels.cloud(&settings).unwrap();
        assert_eq!(cloud, through.transformed(origin));
        surfels.renew_cloud(&mut renewed, &settings).unwrap();
        assert_eq!(renewed, cloud);
    }
}

#[test]
fn types_of_samples_make_no_difference() {
    let mut random = Random(5);
    let bytes: Vec<u8> = (0..20 * 19 * 18).map(|_| (random.next() * 9.0) as u8).collect();
    let voxels = [
        Voxels::U16(bytes.iter().map(|&b| u16::from(b)).collect()),
        Voxels::I16(bytes.iter().map(|&b| i16::from(b)).collect()),
        Voxels::F32(bytes.iter().map(|&b| f32::from(b)).collect()),
        Voxels::U8(bytes),
    ];
    for interpolation in [Interpolation::Trilinear, Interpolation::Tricubic] {
        let all = voxels.clone().map(|voxels| {
            let volume = Volume::new([20, 19, 18], voxels, GridFrame::default()).unwrap();
            // Through samples: with polygons that are points and lines.
            IsoExtractor::new(&volume).extract(4.0, interpolation).unwrap()
        });
        assert!(all[0].len() > 5000 && all.iter().all(|surfels| *surfels == all[0]));
    }
}

#[test]
fn slabs_give_what_the_whole_gives() {
    let volume = balls();
    let Voxels::F32(samples) = volume.voxels() else { panic!("samples are f32") };
    let grid = Grid { dims: volume.dims(), frame: volume.frame() };
    let slice = grid.dims[0] * grid.dims[1];
    for interpolation in [Interpolation::Trilinear, Interpolation::Tricubic] {
        let (mut most, mut closed, mut all) = (0, Closed::EVERYWHERE, Vec::new());
        let read = |slices: std::ops::Range<usize>| {
            most = most.max(slices.len());
            Ok(Voxels::F32(samples[slices.start * slice..slices.end * slice].to_vec()))
        };
        stream_iso_surfels(&grid, 0.0, interpolation, read, |surfels| -> Result<(), IsoError> {
            all.extend(surfels.iter());
            closed = closed.clone().and(surfels.closed());
            Ok(())
        })
        .unwrap();
        let whole = IsoExtractor::new(&volume).extract(0.0, interpolation).unwrap();
        assert_eq!(sorted(all.into_iter()), sorted(whole.iter()));
        assert!(most <= 69, "{most}");
        assert!(!whole.is_closed() && closed == *whole.closed());
    }
    let short = |_| Ok(Voxels::U8(vec![0; 7]));
    let result = stream_iso_surfels(&grid, 0.0, Interpolation::Trilinear, short, |_| Ok(()));
    assert_eq!(result, Err(IsoError::Slices { expected: slice * 67, found: 7 }));
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let volume = balls();
    for interpolation in [Interpolation::Trilinear, Interpolation::Tricubic] {
        let [one, two, five] = on_threads(|| IsoExtractor::new(&volume).extract(0.0, interpolation).unwrap());
        assert!(one == two && one == five && one.area().to_bits() == two.area().to_bits());
    }
}

/// The spline keeps cubic polynomials: places are on the polynomial's zero, normals across it. Numbers of up to some thousands in
/// single precision, off by 2e-5 each, slopes of about forty.
#[test]
fn cubic_polynomials_are_kept() {
    let field = |p: DVec3| {
        let q = (p - DVec3::new(7.7, 8.1, 7.2)) / 8.0;
        1.0 - q.length_squared() + 0.3 * q.x * q.y * q.z - 0.2 * q.x.powi(3) + 0.1 * q.y.powi(2) * q.z
    };
    let volume = sampled([17; 3], GridFrame::default(), |p| 300.0 * field(p));
    let surfels = IsoExtractor::new(&volume).extract(150.0, Interpolation::Tricubic).unwrap();
    let e = 1e-4;
    let slope = |p: DVec3, axis: DVec3| (field(p + axis * e) - field(p - axis * e)) / (2.0 * e);
    let mut count = 0;
    for surfel in surfels.iter() {
        let p = surfel.center.as_dvec3();
        // Beside the border the spline's support is not whole.
        if (p - 8.0).abs().max_element() > 5.0 {
            continue;
        }
        count += 1;
        let gradient = DVec3::new(slope(p, DVec3::X), slope(p, DVec3::Y), slope(p, DVec3::Z));
        assert!((field(p) - 0.5).abs() / gradient.length() < 1e-4, "{p}");
        let normal = surfel.normal().as_dvec3();
        let off = normal.cross(-gradient.normalize()).length();
        assert!(off < 2e-5 && normal.dot(gradient) < 0.0, "{p}: {off}");
    }
    assert!(count > 300, "{count}");
}

/// The smooth choice beside what is missing: closed as the other is, and as many surfels.
#[test]
fn missing_samples_keep_the_smooth_surface_in_place() {
    let whole = |p: DVec3| 6.0 - (p - DVec3::splat(9.3)).length();
    let holed = |p: DVec3| if (p - DVec3::new(9.0, 9.0, 17.0)).length() < 1.5 { f64::NAN } else { whole(p) };
    let volume = sampled([20; 3], GridFrame::default(), holed);
    let extractor = IsoExtractor::new(&volume);
    let [linear, cubic] =
        [Interpolation::Trilinear, Interpolation::Tricubic].map(|i| extractor.extract(0.0, i).unwrap());
    assert_eq!((linear.len(), linear.is_closed()), (cubic.len(), cubic.is_closed()));
    for (a, b) in linear.iter().zip(cubic.iter()) {
        // Both are within h²/8 · 2/r of the sphere.
        assert!((a.center - b.center).length() < 0.1 && a.area == b.area);
    }
}

/// Values and lengths of any size: the same surfels, scaled.
#[test]
fn no_number_is_too_large_or_too_small() {
    let volume = marschner_lobb(20).unwrap();
    let Voxels::F32(samples) = volume.voxels() else { panic!("the phantom has f32 samples") };
    let count = iso_surfels(&volume, 0.5, &IsoSettings::default()).unwrap().len();
    for (scale, spacing) in [(1e-30, 1.0), (1e30, 1.0), (1.0, 1e-9), (1.0, 1e9), (2e38, 1e12)] {
        let frame = GridFrame { spacing: DVec3::splat(spacing), ..GridFrame::default() };
        let values = samples.iter().map(|v| v * scale).collect();
        let scaled = Volume::new(volume.dims(), Voxels::F32(values), frame).unwrap();
        let surfels = IsoExtractor::new(&scaled).extract(0.5 * scale, Interpolation::Trilinear).unwrap();
        // Values that are equal to ½ may be so no longer.
        assert!(surfels.len().abs_diff(count) <= 3, "{scale} {spacing}: {} {count}", surfels.len());
        assert!(surfels.iter().all(|s| s.center.is_finite() && s.area > 0.0 && s.normal().is_finite()));
    }
    for spacing in [1e-20, 1e20] {
        let frame = GridFrame { spacing: DVec3::splat(spacing), ..GridFrame::default() };
        let scaled = volume.clone().with_frame(frame).unwrap();
        let result = IsoExtractor::new(&scaled).extract(0.5, Interpolation::Trilinear);
        assert!(matches!(result, Err(IsoError::Extent { .. })), "{spacing}");
    }
}
