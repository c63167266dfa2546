//! Irregular volumes: surfaces lie where the cells do, kernels of a constant field add up to it.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use common::*;
use glam::{DAffine3, DMat3, DVec3};
use oblate_engine::{Cloud, Material};
use oblate_volumes::{
    ColorSpace, ControlPoint, IRREGULAR_COVERAGE_FLOOR, Interpolation, IrregularError, IrregularVolume,
    IsoSettings, IsoSurfels, KERNEL_SIGMA, KernelSettings, PRESETS, Partition, StrengthKind,
    TransferFunction, to_kernels,
};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

/// A field on a grid whose points are those of index space taken to the world by `map`.
fn mapped(dims: [usize; 3], map: impl Fn(DVec3) -> DVec3, field: impl Fn(DVec3) -> f64) -> IrregularVolume {
    let [nx, ny, nz] = dims;
    let mut points = Vec::new();
    for k in 0..nz {
        for j in 0..ny {
            points.extend((0..nx).map(|i| map(DVec3::new(i as f64, j as f64, k as f64))));
        }
    }
    let values = points.iter().map(|point| field(*point) as f32).collect();
    IrregularVolume::curvilinear(dims, points, values).unwrap()
}

/// Index space bent, stretched and sheared.
fn bent(index: DVec3) -> DVec3 {
    let p = index * 0.3;
    DVec3::new(
        p.x + 0.06 * p.x * p.x + 0.2 * (0.7 * p.y).sin(),
        1.5 * p.y + 0.1 * p.x * p.z,
        0.4 * p.z + 0.3 * p.x + 0.05 * p.z * p.z,
    )
}

fn found(volume: &IrregularVolume, iso: f32) -> IsoSurfels {
    volume.iso_surfels(iso, Interpolation::Trilinear).unwrap()
}

/// Extinction 1 everywhere.
fn one() -> TransferFunction {
    let points = vec![ControlPoint { value: 0.0, color: [0.5; 3], strength: 1.0 }];
    TransferFunction::new(points, StrengthKind::Extinction, ColorSpace::Linear).unwrap()
}

fn kernels(volume: &IrregularVolume) -> Cloud {
    Partition::new(volume).kernels(&one(), Material::default()).unwrap()
}

fn masses(cloud: &Cloud) -> Vec<f32> {
    let oblate_engine::Strength::Extinction { masses } = cloud.splats().strength else {
        panic!("no kernels")
    };
    masses
}

/// What kernels add up to at a point; with `shared` their own masses, without those of their steps alone.
fn sum_at(cloud: &Cloud, point: DVec3, shared: bool) -> f64 {
    let masses = masses(cloud);
    let one = |index: usize| {
        let factor = cloud.factor(index).as_dmat3();
        let away = point - cloud.cloud_to_world().transform_point3(cloud.center(index).as_dvec3());
        let squared = (factor.inverse() * away).length_squared();
        let determinant = factor.determinant().abs();
        let mass = if shared { f64::from(masses[index]) } else { determinant / KERNEL_SIGMA.powi(3) };
        mass * TAU.powf(-1.5) / determinant * (-0.5 * squared).exp()
    };
    (0..cloud.len()).map(one).sum()
}

/// Values of a linear field are trilinear in every cell, whatever its shape: all is exact but for roundings.
#[test]
fn planes_are_exact_on_bent_grids() {
    let mut random = Random(11);
    for mirrored in [false, true] {
        let map = |index: DVec3| bent(index) * DVec3::new(if mirrored { -1.0 } else { 1.0 }, 1.0, 1.0);
        for _ in 0..6 {
            let normal = random.direction();
            let level = normal.dot(map(DVec3::splat(6.2)));
            let volume = mapped([14, 13, 15], map, |p| level - normal.dot(p));
            let surfels = found(&volume, 0.0);
            assert!(surfels.len() > 50, "{}", surfels.len());
            let origin = surfels.frame().origin;
            for surfel in surfels.iter() {
                // f32 tells values of size 5 apart to 5e-7, and the slope is at least that of the shortest step, 0.1.
                let off = normal.dot(origin + surfel.center.as_dvec3()) - level;
                assert!(off.abs() < 1e-5, "{off}");
                // Differences of such values over the shortest steps: 5e-7/0.1, in a direction that the cell's aspect, 10, turns on.
                assert!(surfel.normal().as_dvec3().distance(normal) < 1e-3, "{}", surfel.normal());
                let [u, v] = surfel.half_axes;
                assert!(
                    u.dot(v).abs() < 1e-5 * u.length() * v.length() + 1e-6
                        && u.length() >= v.length() * 0.9999
                );
            }
        }
    }
}

/// The plane z = 0 through a bent grid of unit square cross-section keeps its area.
#[test]
fn areas_are_those_of_the_world() {
    // A disc of radius 1 to 3, crossed by a plane through the axis and one across it.
    let cylinder = |index: DVec3| {
        let (radius, angle) = (1.0 + 2.0 * index.x / 20.0, TAU * index.y / 60.0);
        DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.2 * index.z - 1.03)
    };
    let volume = mapped([21, 61, 11], cylinder, |p| -p.z);
    // Chords of 6 degrees: polygons of 60 sides have sin(φ)/φ of the circle's area.
    let side = TAU / 60.0;
    let exact = PI * 8.0 * side.sin() / side;
    let across = found(&volume, 0.0);
    // Each cell is a trapezium whose map is bilinear: cofactors in its middle give its area exactly.
    assert!((across.area() / exact - 1.0).abs() < 1e-5, "{} for {exact}", across.area());
    let along = mapped([21, 61, 11], cylinder, |p| -p.y - 0.013);
    let (exact, area) = (2.0 * 2.0 * 2.0, found(&along, 0.0).area());
    // Two rectangles of 2 by 2, whose cells bend by the sagitta of 3 degrees.
    assert!((area / exact - 1.0).abs() < 2e-3, "{area} for {exact}");
}

/// Spherical coordinates, collapsed at both poles and in the middle.
#[test]
fn spheres_in_their_own_coordinates() {
    let dims = [9, 25, 49];
    let map = |index: DVec3| {
        let [radius, polar, azimuth] = [index.x / 4.0, PI * index.y / 24.0, TAU * index.z / 48.0];
        DVec3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()) * radius
    };
    let surfels = found(&mapped(dims, map, |p| -p.length()), -1.1);
    // Cells of 7.5 degrees: their corners are within 5.3 degrees of their middles, where they lie 1 − cos 5.3° too deep; their
    // areas lack up to the square of that and of the bent sides, four times as much.
    let half = 7.5_f64.to_radians() / 2.0_f64.sqrt();
    let depth = 1.0 - half.cos();
    let area = surfels.area() / (4.0 * PI * 1.21);
    assert!(area < 1.0 && area > 1.0 - 4.0 * depth, "{area}");
    for surfel in surfels.iter() {
        let place = surfels.frame().origin + surfel.center.as_dvec3();
        let radius = place.length() / 1.1;
        assert!(radius < 1.0 + 1e-5 && radius > 1.0 - 1.1 * depth, "{radius}");
        // Across a cell the surface turns by 7.5 degrees; normals are its middle's to the second order.
        let slope = surfel.normal().as_dvec3().dot(place.normalize());
        assert!(slope > half.cos(), "{slope} at {place}");
    }
    // A sphere that cuts across the cells, away from the poles: depth and area by the cells' sizes there, at most 0.25.
    let center = DVec3::new(0.9, 0.5, 0.1);
    let surfels = found(&mapped(dims, map, |p| -p.distance(center)), -0.6);
    let area = surfels.area() / (4.0 * PI * 0.36);
    // A chord of 0.25 on a radius of 0.6 lies 0.013 deep, 2 % of the radius; areas lack twice that.
    assert!((area - 1.0).abs() < 0.05, "{area}");
    for surfel in surfels.iter() {
        let place = surfels.frame().origin + surfel.center.as_dvec3();
        assert!((place.distance(center) - 0.6).abs() < 0.02, "{place}");
    }
}

/// Summed coverage on planes, where spacing jumps by two and on a bent grid.
#[test]
fn planes_are_covered() {
    let mut random = Random(12);
    let jump = |i: f64| if i < 12.0 { i } else { 12.0 + 2.0 * (i - 12.0) };
    let jumps = |index: DVec3| DVec3::from([index.x, index.y, index.z].map(jump));
    let even = |index: DVec3| index * DVec3::new(1.0, 0.5, 2.0);
    let grown = |index: DVec3| DVec3::from([index.x, index.y, index.z].map(|i| 10.0 * 1.1_f64.powf(i)));
    for (name, map, least, most) in [
        // As regular grids, which vary by 11 %.
        ("even", &even as &dyn Fn(DVec3) -> DVec3, 0.89, 1.11),
        // Long cells have one part less than the next ones, which takes 0.02 more.
        ("×1.1", &grown, 0.87, 1.13),
        ("jumps ×2", &jumps, f64::from(IRREGULAR_COVERAGE_FLOOR), 1.4),
    ] {
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        for _ in 0..12 {
            let normal = random.direction();
            let through = map(DVec3::splat(12.0));
            let volume = mapped([25; 3], map, |p| -normal.dot(p - through));
            let cloud = found(&volume, 0.0).cloud(&IsoSettings::default()).unwrap();
            let surfels = surfels(&cloud);
            let (t1, t2) = normal.any_orthonormal_pair();
            let scale = (map(DVec3::splat(13.0)) - through).max_element();
            for _ in 0..100 {
                let aside = t1 * (random.next() - 0.5) + t2 * (random.next() - 0.5);
                let w = coverage(&surfels, through + aside * 4.0 * scale, normal, f64::INFINITY);
                (low, high) = (low.min(w), high.max(w));
            }
        }
        println!("planes, {name}: summed coverage {low:.4} to {high:.4}");
        assert!(low >= least && high <= most, "{name}: {low} to {high}");
    }
}

/// Large cells have many surfels, which lie on the trilinear interpolant as one would.
#[test]
fn long_cells_are_searched_in_parts() {
    let volume = mapped([9; 3], |index| index * DVec3::new(2.0, 1.0, 0.5), |p| p.z + 0.1 * p.x * p.y);
    let surfels = found(&volume, 3.0);
    // Steps are a 128th of the diagonal, 18.3, but for what 64 samples of each allow: four times shorter than the volume's.
    assert!(surfels.len() > 500, "{}", surfels.len());
    for surfel in surfels.iter() {
        let place = surfels.frame().origin + surfel.center.as_dvec3();
        // The interpolant of products of coordinates is these products.
        assert!((place.z + 0.1 * place.x * place.y - 3.0).abs() < 1e-4, "{place}");
        assert!(surfel.half_axes[0].length() < 0.6, "{surfel:?}");
    }
    // A spline is searched cell by cell.
    assert!(volume.iso_surfels(3.0, Interpolation::Tricubic).unwrap().len() < surfels.len() / 4);
}

/// Along one axis, along all: the sums are products of those along the axes.
#[test]
fn kernels_of_a_constant_field_add_up_where_spacing_jumps() {
    let steps = |jump: bool| (0..13).map(move |i| if jump && i > 6 { 2 * i - 6 } else { i } as f64);
    let axes = [true, false].map(|jump| steps(jump).collect::<Vec<f64>>());
    for (name, of) in [("one axis", [0, 1, 1]), ("three axes", [0, 0, 0])] {
        let values = vec![1.0; 13 * 13 * 13];
        let volume = IrregularVolume::rectilinear(of.map(|axis| &axes[axis][..]), values).unwrap();
        let cloud = kernels(&volume);
        let range = |shared: bool| {
            let mut range = [f64::INFINITY, 0.0_f64];
            for step in 0..90 {
                let x = 3.0 + 0.1 * f64::from(step);
                let point = if of[1] == 0 { DVec3::splat(x) } else { DVec3::new(x, 6.0, 6.0) };
                let sum = sum_at(&cloud, point, shared);
                range = [range[0].min(sum), range[1].max(sum)];
            }
            range
        };
        let (without, with) = (range(false), range(true));
        let residual = Partition::new(&volume).residual();
        println!(
            "{name}: without {without:.3?}, with {with:.3?}; at samples {:.3?} rms {:.4}, before {:.3?} rms {:.4}",
            residual.range, residual.rms, residual.before.0, residual.before.1
        );
        assert!(residual.rms < 0.25 * residual.before.1);
        let worst = |[low, high]: [f64; 2]| (1.0 - low).max(high - 1.0);
        assert!(worst(with) < 0.25 * worst(without), "{name}: {with:?}, without {without:?}");
    }
}

/// What kernels add up to at samples is what the residual says, on a bent grid: that of brute force, as a share of 1, along borders of what
/// they have by themselves, but at least of what an even grid has there.
#[test]
fn residuals_are_those_of_brute_force() {
    let dims = [9, 8, 7];
    let volume = mapped(dims, bent, |_| 1.0);
    let cloud = kernels(&volume);
    let (residual, mut range) = (Partition::new(&volume).residual(), [f64::INFINITY, 0.0_f64]);
    // Kernels of an even grid are products of those along its axes.
    let along = |count: usize, index: usize| -> f64 {
        let kernel = |other: usize| (-0.5 * ((other as f64 - index as f64) / KERNEL_SIGMA).powi(2)).exp();
        (0..count).map(kernel).sum::<f64>() / (TAU.sqrt() * KERNEL_SIGMA)
    };
    for (number, point) in volume.points().iter().enumerate() {
        let index = [number % 9, number / 9 % 8, number / 72];
        let even: f64 = (0..3).map(|axis| along(dims[axis], index[axis])).product();
        let should = sum_at(&cloud, *point, false).clamp(even, even.max(1.0));
        let sum = sum_at(&cloud, *point, true) / should;
        range = [range[0].min(sum), range[1].max(sum)];
    }
    // Single precision, and kernels cut off at e^−9 of their peak, a few dozen of them.
    for (found, expected) in range.iter().zip(residual.range) {
        assert!((found - expected).abs() < 2e-3, "{range:?}, {residual:?}");
    }
    assert!(residual.rms < 0.25 * residual.before.1, "{residual:?}");
}

/// A tube whose first and last samples around lie in one place: no seam, and no more extinction than the tube has.
#[test]
fn kernels_add_up_where_borders_of_a_grid_meet() {
    let tube = |index: DVec3| {
        let (radius, angle) = (4.0 + 0.5 * index.x, TAU * index.y / 48.0);
        DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.5 * index.z)
    };
    let cloud = kernels(&mapped([9, 49, 9], tube, |_| 1.0));
    let at = |angle: f64| sum_at(&cloud, DVec3::new(6.0 * angle.cos(), 6.0 * angle.sin(), 2.0), true);
    for step in 0..48 {
        let sum = at(TAU * f64::from(step) / 96.0);
        // At a seam two samples lie where one would, and steps from it are one-sided: with the masses that steps alone give, the sum is 1.57.
        assert!((sum - 1.0).abs() < 0.025, "{step}: {sum}");
    }
    // As a regular volume's, kernels reach half a step beyond the samples along borders that meet nothing.
    let mass: f64 = masses(&cloud).iter().map(|mass| f64::from(*mass)).sum();
    let volume = PI * (8.25_f64.powi(2) - 3.75_f64.powi(2)) * 4.5;
    assert!((mass / volume - 1.0).abs() < 0.02, "{mass} for {volume}");
}

/// An even grid gives a regular volume's kernels.
#[test]
fn even_grids_are_regular() {
    let frame = frames()[2].1;
    let regular = sampled([11; 3], frame, |p| 2.0 + 0.1 * p.x);
    let to_world = regular.index_to_world();
    let irregular = mapped([11; 3], |i| to_world.transform_point3(i), |p| 2.0 + 0.1 * p.x);
    let expected = to_kernels(&regular, &one(), &KernelSettings::default()).unwrap();
    let cloud = kernels(&irregular);
    assert_eq!(cloud.len(), expected.len());
    // To the borders, within what single precision leaves of a sum.
    for (ours, theirs) in masses(&cloud).into_iter().zip(masses(&expected)) {
        assert!((ours / theirs - 1.0).abs() < 1e-5, "{ours} for {theirs}");
    }
    let center = middle([11; 3], frame);
    let [ours, theirs] = [&cloud, &expected].map(|cloud| sum_at(cloud, center, true));
    // The ripple of a lattice: 4·10⁻⁴.
    assert!((ours / theirs - 1.0).abs() < 8e-4, "{ours} for {theirs}");
    let factor = |cloud: &Cloud| cloud.factor(5 * 121).as_dmat3();
    let covariance = |f: DMat3| f * f.transpose();
    let difference = covariance(factor(&cloud)) - covariance(factor(&expected));
    assert!(difference.to_cols_array().iter().all(|x| x.abs() < 1e-5), "{difference}");
    for (a, b) in cloud.splats().normals.unwrap().iter().zip(expected.splats().normals.unwrap()) {
        // Differences of values near 2 over a step of 1: 1e-7 of a slope of 0.1.
        assert!(a.distance(b) < 1e-4, "{a} for {b}");
    }
    let surfels = found(&irregular, 2.4);
    let plane = oblate_volumes::IsoExtractor::new(&regular).extract(2.4, Interpolation::Trilinear).unwrap();
    assert!(surfels.len() >= plane.len());
    assert!((surfels.area() / plane.area() - 1.0).abs() < 1e-5);
    // Fitted to the same values in the same volumes.
    let [ours, theirs] = [irregular.samples(), &regular].map(|volume| PRESETS[0].fit(volume).unwrap());
    for (a, b) in ours.points().iter().zip(theirs.points()) {
        assert!((a.strength - b.strength).abs() <= 1e-5 * b.strength);
    }
}

/// Points of a lattice moved by up to a third of a step.
fn jittered(random: &mut Random, side: usize) -> Vec<DVec3> {
    let mut points = Vec::new();
    for k in 0..side {
        for j in 0..side {
            for i in 0..side {
                let moved = DVec3::new(random.next(), random.next(), random.next()) - 0.5;
                points.push(DVec3::new(i as f64, j as f64, k as f64) + moved * (2.0 / 3.0));
            }
        }
    }
    points
}

#[test]
fn scattered_samples_have_kernels_and_gradients() {
    let mut random = Random(13);
    let points = jittered(&mut random, 12);
    let slope = DVec3::new(0.3, -0.2, 0.5);
    let values = points.iter().map(|p| (slope.dot(*p) + 5.0) as f32).collect();
    let volume = IrregularVolume::scattered(points, values).unwrap();
    let partition = Partition::new(&volume);
    let residual = partition.residual();
    println!("scattered: {residual:.3?}");
    // 0.071 of 0.168.
    assert!(residual.rms < 0.5 * residual.before.1, "{residual:?}");
    let cloud = partition.kernels(&one(), Material::default()).unwrap();
    assert_eq!(cloud.len(), 12 * 12 * 12);
    for normal in cloud.splats().normals.unwrap() {
        // Least squares are exact for linear fields; values of f32 near 5 differ by 5e-7.
        assert!(normal.as_dvec3().distance(-slope.normalize()) < 1e-5, "{normal}");
    }
    let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
    for _ in 0..100 {
        let point = DVec3::splat(3.0) + DVec3::new(random.next(), random.next(), random.next()) * 5.0;
        let sum = sum_at(&cloud, point, true);
        (low, high) = (low.min(sum), high.max(sum));
    }
    println!("scattered, between samples: {low:.3} to {high:.3}");
    assert!(low > 0.8 && high < 1.15, "{low} to {high}");
    assert!(found(&volume, 5.0).is_empty());
}

/// What is not there has no kernel, and cells that it is a corner of have no surface.
#[test]
fn holes_stay_holes() {
    let volume =
        mapped([9; 3], bent, |p| if p.distance(bent(DVec3::splat(4.0))) < 0.3 { f64::NAN } else { p.x });
    let missing = volume.samples().histogram(4).unwrap().ignored();
    assert!(missing > 0);
    assert_eq!(kernels(&volume).len() as u64 + missing, 9 * 9 * 9);
    let middle = bent(DVec3::splat(4.0));
    let surfels = found(&volume, middle.x as f32);
    assert!(!surfels.is_empty());
    for surfel in surfels.iter() {
        assert!((surfels.frame().origin + surfel.center.as_dvec3()).distance(middle) > 0.2);
    }
}

#[test]
fn numbers_that_are_no_volume_are_refused() {
    let flat: Vec<DVec3> = (0..8).map(|i| DVec3::new(f64::from(i % 2), f64::from(i / 2), 0.0)).collect();
    let values = || vec![0.0; 8];
    assert_eq!(IrregularVolume::curvilinear([2; 3], flat.clone(), values()), Err(IrregularError::Flat(8)));
    assert_eq!(IrregularVolume::scattered(flat.clone(), values()), Err(IrregularError::Flat(8)));
    let cells = IrregularVolume::curvilinear([4, 2, 1], flat.clone(), values());
    assert_eq!(cells, Err(IrregularError::Cells { dims: [4, 2, 1] }));
    let count = IrregularVolume::scattered(flat.clone(), vec![0.0; 7]);
    assert_eq!(count, Err(IrregularError::Count { points: 8, values: 7 }));
    assert!(matches!(
        IrregularVolume::curvilinear([2, 2, 3], flat.clone(), values()),
        Err(IrregularError::Volume(_))
    ));
    let far = flat.iter().map(|p| *p * 1e200).collect();
    assert!(matches!(IrregularVolume::scattered(far, values()), Err(IrregularError::Extent(_))));
    assert_eq!(IrregularVolume::scattered(flat, vec![f32::NAN; 8]), Err(IrregularError::Flat(0)));
    assert!(matches!(
        IrregularVolume::rectilinear([&[0.0, 1.0], &[0.0, 1.0], &[0.0, 2.0]], vec![0.0; 7]),
        Err(IrregularError::Count { points: 8, values: 7 })
    ));
}

#[test]
fn placed_volumes_have_placed_kernels_and_surfaces() {
    let volume = mapped([8; 3], bent, |p| p.x + p.y);
    let placement = DAffine3::from_scale_rotation_translation(
        DVec3::new(2.0, 2.0, -2.0),
        glam::DQuat::from_rotation_z(PI / 2.0),
        DVec3::new(5.0, 6.0, 7.0),
    );
    let placed = volume.clone().placed(placement).unwrap();
    let value = (volume.points()[200].x + volume.points()[200].y) as f32;
    let (before, after) = (found(&volume, value), found(&placed, value));
    assert_eq!(before.len(), after.len());
    for (a, b) in before.iter().zip(after.iter()) {
        let expected = placement.transform_point3(before.frame().origin + a.center.as_dvec3());
        assert!((after.frame().origin + b.center.as_dvec3()).distance(expected) < 1e-5);
    }
}

#[test]
fn threads_change_nothing() {
    let volume = mapped([20, 21, 22], bent, |p| p.length());
    let [one, two, five] = on_threads(|| (kernels(&volume).splats(), found(&volume, 3.0)));
    assert!(one == two && one == five);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the points: no panic, and all that comes of them is finite.
    #[test]
    fn folded_and_collapsed_cells_give_finite_splats(
        // Few coordinates: coincident points and folded cells are common.
        coordinates in prop::collection::vec((0_u8..4, 0_u8..4, 0_u8..5, 0_u8..6), 36),
        scale in -5_i32..6,
    ) {
        let scale = 10_f64.powi(2 * scale);
        let point = |&(x, y, z, _): &(u8, u8, u8, u8)| {
            if z == 4 { DVec3::splat(f64::NAN) } else { DVec3::new(x.into(), y.into(), z.into()) * scale }
        };
        let points: Vec<DVec3> = coordinates.iter().map(point).collect();
        let values: Vec<f32> =
            coordinates.iter().map(|c| if c.3 == 5 { f32::NAN } else { f32::from(c.3) }).collect();
        for volume in [
            IrregularVolume::curvilinear([3, 4, 3], points.clone(), values.clone()),
            IrregularVolume::scattered(points, values),
        ] {
            let Ok(volume) = volume else { continue };
            let partition = Partition::new(&volume);
            prop_assert!(partition.residual().rms.is_finite());
            prop_assert!(partition.kernels(&one(), Material::default()).is_ok());
            for interpolation in [Interpolation::Trilinear, Interpolation::Tricubic] {
                let surfels = volume.iso_surfels(2.5, interpolation).unwrap();
                prop_assert!(surfels.area().is_finite());
                prop_assert!(surfels.cloud(&IsoSettings::default()).is_ok());
            }
        }
    }
}
