//! Merging where a surface is flat.

use glam::{Mat3, Vec3};
use oblate_engine::{Closed, Cloud, Material, Shapes, Splats, Strength, Surface};
use oblate_surfels::{Density, Deviation, MergeError, Mesh, SamplerSettings, merge_flat, primitives, sample};

const BOUNDS: Deviation = Deviation { distance: 0.05, angle: 0.1, color: 0.1 };

/// A square of `n`² surfels a unit apart, σ = 0.7, in a plane through the origin with normal `normal`; colours from `color`.
fn square(n: i32, normal: Vec3, color: impl Fn(i32, i32) -> f32) -> Splats {
    let (u, v) = normal.any_orthonormal_pair();
    let places: Vec<(i32, i32)> = (0..n).flat_map(|j| (0..n).map(move |i| (i, j))).collect();
    Splats {
        centers: places.iter().map(|(i, j)| u * *i as f32 + v * *j as f32).collect(),
        shapes: Shapes::Each(vec![Mat3::from_cols(u * 0.7, v * 0.7, Vec3::ZERO); places.len()]),
        strength: Strength::Surface(Surface {
            areas: vec![1.0; places.len()],
            opacities: None,
            depth_tolerance: 0.7,
            coverage_floor: 0.9,
            closed: Closed::Nowhere,
        }),
        colors: places.iter().map(|(i, j)| [color(*i, *j), 0.5, 0.5]).collect(),
        harmonics: None,
        normals: Some(vec![u.cross(v); places.len()]),
        material: Material::default(),
    }
}

/// What a cloud covers at `place` of a plane, seen along its normal.
fn coverage(cloud: &Cloud, place: Vec3) -> f64 {
    let splats = cloud.splats();
    let Strength::Surface(surface) = &splats.strength else { panic!("a surface") };
    let one = |i: usize| {
        let factor = splats.shapes.factor(i);
        let (u, v) = (factor.x_axis, factor.y_axis);
        let d = place - splats.centers[i];
        let q = (u.dot(d) / u.length_squared()).powi(2) + (v.dot(d) / v.length_squared()).powi(2);
        f64::from(surface.areas[i] * (-0.5 * q).exp() / (std::f32::consts::TAU * u.cross(v).length()))
    };
    (0..cloud.len()).map(one).sum()
}

fn area(cloud: &Cloud) -> f64 {
    let Strength::Surface(surface) = cloud.splats().strength else { panic!("a surface") };
    surface.areas.iter().map(|a| f64::from(*a)).sum()
}

/// A square is covered as before by far fewer: 0.95 of it at samples and little less between them. Where it ends, which is over two units, a quarter more
/// may be covered: areas are raised there, too. What is covered more than once doesn't show.
#[test]
fn a_square_takes_few_surfels() {
    let cloud = Cloud::new(square(64, Vec3::new(0.2, 0.3, 1.0).normalize(), |_, _| 0.5)).unwrap();
    let merged = merge_flat(&cloud, BOUNDS).unwrap();
    assert!(
        8 * merged.merged < cloud.len() && 3 * merged.cloud.len() < cloud.len(),
        "{}",
        merged.cloud.len()
    );
    assert!(merged.largest.distance < 1e-4 && merged.largest.angle < 1e-3 && merged.largest.color < 1e-6);
    let (u, v) = (cloud.center(1) - cloud.center(0), cloud.center(64) - cloud.center(0));
    let mut worst = [0.0_f64; 2];
    for j in -4..=67 {
        for i in -4..=67 {
            let place = cloud.center(0) + u * (i as f32 + 0.3) + v * (j as f32 + 0.6);
            let [before, after] = [&cloud, &merged.cloud].map(|cloud| coverage(cloud, place).min(1.0));
            let inside = [i, j].iter().all(|x| (2..62).contains(x));
            worst[usize::from(inside)] = worst[usize::from(inside)].max((before - after).abs());
        }
    }
    assert!(worst[1] < 0.1 && worst[0] < 0.25, "{worst:?}");
}

/// Half red, half not: nothing is merged across, and nothing of the one colour gets to where it is farther than a σ from the other.
#[test]
fn colours_stay_apart() {
    let cloud = Cloud::new(square(40, Vec3::Z, |i, _| if i < 20 { 1.0 } else { 0.0 })).unwrap();
    let merged = merge_flat(&cloud, BOUNDS).unwrap();
    assert!(2 * merged.cloud.len() < cloud.len());
    assert!(merged.cloud.splats().colors.iter().all(|c| c[0] == 0.0 || c[0] == 1.0));
    assert!(merged.largest.color == 0.0);
    // Without that bound colours are mixed, and their mean stays.
    let mixed = merge_flat(&cloud, Deviation { color: 1.0, ..BOUNDS }).unwrap();
    assert!(mixed.cloud.len() < merged.cloud.len() && mixed.largest.color > 0.1);
}

/// On a sphere the bounds decide how large patches get: deviations keep to them, area and closedness stay, and twice the angle
/// takes fewer.
#[test]
fn a_sphere_keeps_to_the_bounds() {
    let mesh = Mesh { primitives: vec![primitives::sphere(128)] };
    let cloud = sample(&mesh, Density::Count(20_000), &SamplerSettings::default()).unwrap();
    let mut before = cloud.len();
    for angle in [0.1, 0.2, 0.4] {
        let bounds = Deviation { distance: angle * angle, angle, color: 0.1 };
        let merged = merge_flat(&cloud, bounds).unwrap();
        let Deviation { distance, angle: turned, .. } = merged.largest;
        assert!(
            distance <= bounds.distance && turned <= angle && turned > 0.25 * angle,
            "{:?}",
            merged.largest
        );
        assert!(merged.cloud.len() < before, "{} for {angle}", merged.cloud.len());
        before = merged.cloud.len();
        // Raised where sizes change.
        let grown = area(&merged.cloud) / area(&cloud);
        assert!((1.0 - 1e-6..1.25).contains(&grown), "{grown}");
        for i in 0..merged.cloud.len() {
            let factor = merged.cloud.factor(i);
            let outward = factor.x_axis.cross(factor.y_axis).dot(merged.cloud.center(i));
            assert!(outward > 0.0 && factor.z_axis == Vec3::ZERO);
        }
    }
    assert!(2 * before < cloud.len(), "{before}");
}

/// Two sheets nearer than the bound on distance, facing away from each other, are never one.
#[test]
fn sheets_stay_apart() {
    let mut both = square(24, Vec3::Z, |_, _| 0.5);
    let other = square(24, -Vec3::Z, |_, _| 0.5);
    both.centers.extend(other.centers.iter().map(|c| *c - Vec3::Z * 0.01));
    let (Shapes::Each(a), Shapes::Each(b)) = (&mut both.shapes, other.shapes) else { panic!("each its own") };
    a.extend(b);
    let (Strength::Surface(a), Strength::Surface(b)) = (&mut both.strength, other.strength) else {
        panic!("surfaces")
    };
    a.areas.extend(b.areas);
    both.colors.extend(other.colors);
    both.normals.as_mut().unwrap().extend(other.normals.unwrap());
    let cloud = Cloud::new(both).unwrap();
    let merged = merge_flat(&cloud, BOUNDS).unwrap();
    assert!(merged.cloud.len() < cloud.len());
    for normal in merged.cloud.splats().normals.unwrap() {
        assert!(normal.z.abs() > 0.999, "{normal}");
    }
}

#[test]
fn odd_clouds_and_bounds() {
    let one = Cloud::new(square(1, Vec3::Z, |_, _| 0.5)).unwrap();
    let merged = merge_flat(&one, BOUNDS).unwrap();
    assert_eq!((merged.cloud.splats(), merged.merged), (one.splats(), 0));
    let none = Cloud::new(square(0, Vec3::Z, |_, _| 0.5)).unwrap();
    assert!(merge_flat(&none, BOUNDS).unwrap().cloud.is_empty());
    // No area, no extent, all in one place: one is as good.
    let mut nothing = square(5, Vec3::Z, |_, _| 0.5);
    nothing.centers.fill(Vec3::ONE);
    nothing.shapes = Shapes::Each(vec![Mat3::ZERO; 25]);
    nothing.normals = None;
    if let Strength::Surface(surface) = &mut nothing.strength {
        surface.areas.fill(0.0);
    }
    let merged = merge_flat(&Cloud::new(nothing).unwrap(), BOUNDS).unwrap();
    assert_eq!(merged.cloud.len(), 1);
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        for bounds in [
            Deviation { distance: bad, ..BOUNDS },
            Deviation { angle: bad, ..BOUNDS },
            Deviation { color: bad, ..BOUNDS },
        ] {
            assert!(matches!(merge_flat(&one, bounds), Err(MergeError::Bound { .. })));
        }
    }
    let kernels =
        Splats { strength: Strength::Extinction { masses: vec![1.0] }, ..square(1, Vec3::Z, |_, _| 0.5) };
    assert_eq!(merge_flat(&Cloud::new(kernels).unwrap(), BOUNDS), Err(MergeError::NotSurface));
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let mesh = Mesh { primitives: vec![primitives::torus_knot(2, 3, 0.3, [256, 32])] };
    let cloud = sample(&mesh, Density::Count(5_000), &SamplerSettings::default()).unwrap();
    let bounds = Deviation { distance: 0.2, angle: 1.0, color: 0.1 };
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| merge_flat(&cloud, bounds).unwrap())
    };
    let one = on(1);
    assert!(one.merged > 100, "{}", one.merged);
    assert!(one == on(3));
}
