//! Points become surfels that lie in the surface, face the right way and cover it.

mod support;

use glam::{DVec3, Quat, Vec3, dvec3, vec3};
use oblate_engine::observer::Observer;
use oblate_engine::{Camera, Cloud, Pose, RenderSettings, Scene, render};
use oblate_surfels::{
    POINT_COVERAGE_FLOOR, PointCloud, PointColor, PointError, PointSettings, point_surfels,
};
use std::f64::consts::{PI, TAU};
use support::{Finder, outward, quasirandom, surface, total_area};

fn cloud_of(positions: Vec<Vec3>) -> PointCloud {
    PointCloud { positions, ..PointCloud::default() }
}

fn surfels(points: &PointCloud) -> Cloud {
    point_surfels(points, &PointSettings::default()).expect("the points are right")
}

/// Numbers in [−½, ½) that repeat themselves only after 2⁶⁴ (Knuth, *The Art of Computer Programming* 2, 3.3.4).
fn random() -> impl FnMut() -> f32 {
    let mut state = 1_u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1_u64 << 24) as f32 - 0.5
    }
}

/// `side`² points in the unit square of z = 0, each up to `jitter` / 2 grid steps from where a grid has it.
fn jittered(side: usize, jitter: f32) -> Vec<Vec3> {
    let mut random = random();
    let mut place = |i: usize| (i as f32 + 0.5 + jitter * random()) / side as f32;
    (0..side * side).map(|i| vec3(place(i % side), place(i / side), 0.0)).collect()
}

fn on_sphere([u, v]: [f64; 2]) -> DVec3 {
    let (z, (sin, cos)) = (2.0 * u - 1.0, (TAU * v).sin_cos());
    dvec3((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
}

/// The least and the largest of Σw.
fn coverage(cloud: &Cloud, reach: f64, places: impl Iterator<Item = (DVec3, DVec3)>) -> [f64; 2] {
    let finder = Finder::new(cloud, reach);
    let covers = places.map(|(at, normal)| finder.coverage(at, normal));
    covers.fold([f64::INFINITY, 0.0], |[low, high], cover| [low.min(cover), high.max(cover)])
}

#[test]
fn a_plane_is_covered_evenly() {
    let turn = Quat::from_rotation_x(0.7) * Quat::from_rotation_y(0.4);
    let normal = (turn * Vec3::Z).as_dvec3();
    let origin = dvec3(637_000.0, 849_000.0, 400.0);
    // By how much grids are jittered, and what Σw then is at most; at least it is the floor.
    for (jitter, most) in [(0.0, 1.01), (0.5, 1.12), (1.0, 1.25)] {
        let positions = jittered(100, jitter).into_iter().map(|p| turn * p).collect();
        let points = PointCloud { origin, viewpoint: Some(origin + 10.0 * normal), ..cloud_of(positions) };
        let cloud = surfels(&points);
        // Positions are rounded by 6e-8, neighbours are 0.01 apart and about that far to both sides.
        for found in outward(&cloud) {
            assert!((found - normal).length() < 1e-4, "{found} for {normal}");
        }
        let place = |i| {
            let [u, v] = quasirandom(i).map(|u| 0.1 + 0.8 * u);
            (origin + (turn * vec3(u as f32, v as f32, 0.0)).as_dvec3(), normal)
        };
        let [low, high] = coverage(&cloud, 0.05, (0..3000).map(place));
        assert!(low >= f64::from(POINT_COVERAGE_FLOOR) && high <= most, "{jitter}: Σw from {low} to {high}");
        // Of the border's 400 cells, each reaches up to a spacing out instead of half a one: 2 % at most, and 1 % of what
        // the corners of a polygon for a disc have.
        assert!((0.99..1.06).contains(&total_area(&cloud)), "{jitter}: area {}", total_area(&cloud));
        assert!(!surface(&cloud).closed.is_everywhere());
    }
}

#[test]
fn a_sphere_faces_the_viewpoint_outside() {
    const COUNT: usize = 5000;
    let points = cloud_of((0..COUNT).map(|i| on_sphere(quasirandom(i)).as_vec3()).collect());
    let far = PointCloud { viewpoint: Some(dvec3(0.0, 0.0, 1e3)), ..points.clone() };
    let cloud = surfels(&far);
    // 12 neighbours of density ρ reach r = √(12/πρ). They are within t = r²/2 of the tangent plane, so the variance along the
    // true normal is at most t²/4. A normal that is θ off has no less than (σ sin θ − t/2 cos θ)², with σ the spread in
    // the plane; it is chosen for having the least, so tan θ ≤ t/σ. σ is r/2 in a full disc, r/3 is safe.
    let reach = (12.0 * 4.0 / COUNT as f64).sqrt();
    let largest = 1.5 * reach;
    for (center, normal) in support::centers(&cloud).iter().zip(outward(&cloud)) {
        let outside = normal.dot(*center);
        assert!(outside.abs() >= largest.atan().cos(), "{} rad", outside.acos());
        // What the viewpoint doesn't see it must not decide: sides are only right this side of the horizon.
        assert!(center.z < largest || outside > 0.0, "{center} faces {normal}");
    }
    let spacing = (4.0 * PI / COUNT as f64).sqrt();
    let places = (0..3000).map(|i| on_sphere(quasirandom(i + COUNT))).filter(|at| at.z > 0.2);
    let [low, high] = coverage(&cloud, 5.0 * spacing, places.map(|at| (at, at)));
    assert!(low >= 0.75 && high <= 1.25, "Σw from {low} to {high}");
    assert!((total_area(&cloud) / (4.0 * PI) - 1.0).abs() < 0.02, "{}", total_area(&cloud));
    // Without one, up.
    assert!(outward(&surfels(&points)).iter().all(|normal| normal.z >= 0.0));
}

/// The least alpha in the middle of a picture of the cloud from a direction.
fn least_alpha(cloud: Cloud, target: DVec3, direction: DVec3, height: f64) -> f32 {
    struct Nobody;
    impl Observer for Nobody {}
    let pose = Pose::look_at(target + 10.0 * direction, target, DVec3::Y).expect("a camera");
    let camera = Camera::orthographic(pose, height, [64; 2]).expect("a camera");
    let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
    let frame = render(&scene, &camera, &RenderSettings::default(), &Nobody).expect("a scene");
    frame.color.iter().map(|color| color[3]).fold(1.0, f32::min)
}

#[test]
fn tilted_planes_and_creases_let_nothing_through() {
    // Farther down, a surfel's filter in the picture is still smaller than a surfel: 64 pixels for 30 spacings.
    for tilt in [0.0_f64, 0.8, 1.3] {
        let direction = dvec3(tilt.sin(), 0.0, tilt.cos());
        let cloud = surfels(&cloud_of(jittered(100, 0.8)));
        let alpha = least_alpha(cloud, dvec3(0.5, 0.5, 0.0), direction, 0.3 * tilt.cos());
        assert!(alpha > 0.99, "tilted by {tilt}: {alpha}");
    }
    let fold = |p: Vec3| if p.x < 0.5 { p } else { vec3(0.5, p.y, 0.5 - p.x) };
    for direction in [DVec3::Z, DVec3::X, dvec3(1.0, 0.0, 1.0).normalize(), dvec3(0.9, 0.0, 0.1).normalize()]
    {
        let cloud = surfels(&cloud_of(jittered(100, 0.8).into_iter().map(fold).collect()));
        // The crease is in the middle or at the border of what is seen.
        let aside = 0.08 * dvec3(-f64::from(direction.x == 0.0), 0.0, -f64::from(direction.z == 0.0));
        let alpha = least_alpha(cloud, dvec3(0.5, 0.5, 0.0) + aside, direction, 0.1);
        assert!(alpha > 0.99, "from {direction}: {alpha}");
    }
}

#[test]
fn what_the_file_says_counts() {
    let positions = jittered(20, 0.5);
    let count = positions.len();
    let normals = (0..count).map(|i| if i == 0 { Vec3::ZERO } else { vec3(0.0, 3.0, -4.0) }).collect();
    let radii = (0..count).map(|i| [0.0, 0.001, 10.0][i.min(2)]).collect();
    let colors = (0..count).map(|i| [i as f32, 0.5, 0.25]).collect();
    let estimated = surfels(&cloud_of(positions.clone()));
    let points = PointCloud {
        normals: Some(normals),
        radii: Some(radii),
        colors: Some(colors),
        ..cloud_of(positions)
    };
    let cloud = surfels(&points);
    assert_eq!(cloud.len(), count);
    let (areas, guesses) = (surface(&cloud).areas, surface(&estimated).areas);
    let (normals, colors) = (outward(&cloud), cloud.splats().colors);
    for i in 0..count {
        let number = colors[i][0] as usize;
        assert_eq!(cloud.center(i), points.positions[number]);
        let expected = if number == 0 { DVec3::Z } else { dvec3(0.0, 0.6, -0.8) };
        assert!((normals[i] - expected).length() < 1e-5);
        let radius = cloud.factor(i).x_axis.length();
        match number {
            0 => assert_eq!((radius, areas[i]), (estimated.factor(i).x_axis.length(), guesses[i])),
            1 => {
                assert!((radius / 0.0005 - 1.0).abs() < 1e-5);
                assert!((f64::from(areas[i]) / (PI * 1e-6) - 1.0).abs() < 1e-5);
            }
            _ => {
                // Those at the border of what there is have what of their discs is beyond it.
                let place = cloud.center(i).truncate();
                let is_inside = place.min_element() > 0.15 && place.max_element() < 0.85;
                let most = if is_inside { 0.05 } else { 1.001 * PI as f32 * 100.0 };
                assert!((radius / 5.0 - 1.0).abs() < 1e-5 && areas[i] < most, "{place}: {}", areas[i]);
            }
        }
    }
}

#[test]
fn strays_do_not_become_large() {
    let mut positions = jittered(50, 0.5);
    positions.extend([vec3(0.5, 0.5, 40.0), vec3(100.0, 0.0, 0.0), vec3(100.0, 0.1, 0.0)]);
    let cloud = surfels(&cloud_of(positions));
    // Neighbours are 0.02 apart: 12 of them reach 0.04, in corners 0.08.
    for i in 0..cloud.len() {
        assert!(cloud.factor(i).x_axis.length() < 0.8 * 0.1, "{:?} {}", cloud.center(i), cloud.factor(i));
    }
}

#[test]
fn strays_among_strays_do_not_become_large() {
    let mut random = random();
    for count in [12, 13, 14, 30, 100] {
        let mut positions = jittered(150, 0.8);
        let mut beside = || random() + 0.5;
        positions.extend((0..count).map(|_| vec3(beside(), beside(), 0.2 + 0.6 * beside())));
        let cloud = surfels(&cloud_of(positions));
        // 12 neighbours reach 2 spacings of 1/150; strays half as far again, and σ is 0.41 of that.
        for i in 0..cloud.len() {
            let radius = cloud.factor(i).x_axis.length();
            assert!(radius < 0.015, "{count} strays: {radius} at {}", cloud.center(i));
        }
    }
}

#[test]
fn spacings_that_grow_with_distance_are_covered() {
    const STEP: f32 = 0.02;
    let mut random = random();
    // Rings from a distance of 1 to one of 100, as far apart as points are along them.
    let rings = (100_f32.ln() / STEP) as usize;
    let mut at = |i: usize| (i as f32 + 0.8 * random()) * STEP;
    let polar = (0..rings * 50).map(|i| (at(i / 50).exp(), at(i % 50)));
    let positions = polar.map(|(distance, angle)| vec3(distance * angle.cos(), distance * angle.sin(), 0.0));
    let cloud = surfels(&cloud_of(positions.collect()));
    let place = |i| {
        let [u, v] = quasirandom(i).map(|u| 0.1 + 0.8 * u);
        let (distance, (sin, cos)) = (100_f64.powf(u), v.sin_cos());
        (dvec3(distance * cos, distance * sin, 0.0), DVec3::Z)
    };
    let [low, high] = coverage(&cloud, 10.0, (0..300).map(place));
    assert!(low >= f64::from(POINT_COVERAGE_FLOOR) && high <= 1.3, "Σw from {low} to {high}");
}

#[test]
fn scan_lines_are_covered() {
    let turn = Quat::from_rotation_x(0.7) * Quat::from_rotation_y(0.4);
    let normal = (turn * Vec3::Z).as_dvec3();
    for (ratio, noise) in [4, 6, 8, 10, 14, 20].into_iter().flat_map(|ratio| [(ratio, 0.0), (ratio, 0.01)]) {
        let mut random = random();
        // 20 lines; noise has a standard deviation of 1 % of what is between them.
        let mut noisy = || noise * (random() + random() + random()) * 2.0;
        let row = 20 * ratio;
        let place = |i: usize| vec3((i % row) as f32 / ratio as f32, (i / row) as f32, 0.0);
        let mut noisy_place = |i| turn * (place(i) + vec3(noisy(), noisy(), noisy()));
        let positions = (0..20 * row).map(&mut noisy_place).collect();
        let cloud = surfels(&PointCloud { viewpoint: Some(100.0 * normal), ..cloud_of(positions) });
        let off = outward(&cloud).iter().map(|found| (*found - normal).length()).fold(0.0, f64::max);
        let place = |i| {
            let [u, v] = quasirandom(i).map(|u| (2.0 + 15.0 * u) as f32);
            ((turn * vec3(u, v, 0.0)).as_dvec3(), normal)
        };
        let [low, high] = coverage(&cloud, 4.0, (0..1000).map(place));
        let case = format!("1:{ratio}, noise {noise}: {off} off, Σw from {low} to {high}");
        // Of noise of 1 % normals over a line to both sides are off by some 1 %; where only a few of 12 neighbours are of the line
        // beside, by up to 3 %.
        assert!(off < 0.05, "{case}");
        // Lines 6 spacings apart are met by some points' 12 neighbours, by others' not: those overlap.
        let [least, most] = if ratio == 6 { [f64::from(POINT_COVERAGE_FLOOR), 1.5] } else { [0.75, 1.25] };
        assert!(low >= least && high <= most, "{case}");
    }
}

#[test]
fn a_wire_above_the_ground_stays_one() {
    let mut positions = jittered(60, 0.5);
    positions.extend((0..300).map(|i| vec3(i as f32 / 300.0, 0.5, 0.1)));
    let cloud = surfels(&cloud_of(positions));
    // Of the wire 12 neighbours reach 0.02, on the ground 0.04.
    for i in (0..cloud.len()).filter(|&i| cloud.center(i).z > 0.0) {
        let radius = cloud.factor(i).y_axis.length();
        assert!(radius < 0.02, "{radius} at {}", cloud.center(i));
    }
}

#[test]
fn radii_beyond_the_neighbours_reach_leave_no_holes() {
    let points = |radius: f32, positions: Vec<Vec3>| {
        let radii = Some(vec![radius; positions.len()]);
        surfels(&PointCloud { radii, ..cloud_of(positions) })
    };
    // The polygon that stands for a disc has its area.
    for radius in [0.01, 1.0, 100.0] {
        let area = total_area(&points(radius, vec![Vec3::ZERO])) / (PI * f64::from(radius).powi(2));
        assert!((area - 1.0).abs() < 1e-3, "{radius}: {area}");
    }
    // Two halves of each other's disc.
    let both = total_area(&points(10.0, vec![Vec3::ZERO, 0.01 * Vec3::X])) / (PI * 100.0);
    assert!((both - 1.0).abs() < 0.02, "{both}");
}

#[test]
fn few_points_and_points_in_odd_places() {
    let line = |count: usize| (0..count).map(|i| Vec3::X * i as f32).collect::<Vec<Vec3>>();
    let grid = |side: usize| jittered(side, 0.0);
    for (name, positions, expected) in [
        ("one", vec![vec3(3.0, 4.0, 5.0)], 1),
        ("at the origin", vec![Vec3::ZERO], 1),
        ("two", line(2), 2),
        ("fewer than neighbours", jittered(3, 0.5), 9),
        ("a line", line(100_000), 100_000),
        ("all in one place", vec![vec3(1.0, 2.0, 3.0); 100_000], 1),
        ("both zeros", vec![Vec3::ZERO, -Vec3::ZERO, Vec3::X], 2),
        ("two places", (0..100_000).map(|i| Vec3::Y * (i % 2) as f32).collect(), 2),
        ("a grid", grid(300), 90_000),
        ("no two distances can be squared", line(50).into_iter().map(|p| 1.0 + p * 1e-7).collect(), 50),
        ("far", line(50).into_iter().map(|p| p * 1e15).collect(), 50),
        ("near", grid(10).into_iter().map(|p| p * 1e-15).collect(), 100),
        ("one near", vec![Vec3::ZERO, Vec3::X * 1e-30, Vec3::Y], 3),
    ] {
        let cloud = surfels(&cloud_of(positions));
        let distinct = cloud.len();
        // Positions near 1 are rounded to multiples of 1.2e-7.
        assert!(distinct == expected || name.contains("squared") && distinct > 30, "{name}: {distinct}");
        let areas = surface(&cloud).areas;
        for (i, normal) in outward(&cloud).iter().enumerate() {
            assert!((normal.length() - 1.0).abs() < 1e-5, "{name}, surfel {i}: {normal}");
            assert!(cloud.factor(i).is_finite() && areas[i] >= 0.0, "{name}, surfel {i}");
        }
    }
    // What lies on a line along x faces up.
    assert!(outward(&surfels(&cloud_of(line(30)))).iter().all(|normal| normal.distance(DVec3::Z) < 1e-5));
}

#[test]
fn points_of_one_place_share_a_surfel() {
    let points = PointCloud {
        colors: Some(vec![[1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0]]),
        ..cloud_of(vec![Vec3::X, Vec3::Y, Vec3::X])
    };
    let cloud = surfels(&points);
    let of = |center| (0..2).find(|&i| cloud.center(i) == center).map(|i| cloud.splats().colors[i]);
    assert_eq!((of(Vec3::X), of(Vec3::Y)), (Some([0.5, 0.0, 0.5]), Some([0.0, 0.5, 0.0])));
}

#[test]
fn any_number_of_threads_gives_the_same() {
    let mut random = random();
    let points = cloud_of((0..30_000).map(|_| vec3(random(), random(), 0.1 * random())).collect());
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| surfels(&points))
    };
    assert_eq!(with(1), with(5));
}

#[test]
fn what_is_wrong_is_said() {
    let three = || cloud_of(vec![Vec3::X, Vec3::Y, Vec3::Z]);
    let message = |points: &PointCloud, settings: &PointSettings| match point_surfels(points, settings) {
        Err(error) => error.to_string(),
        Ok(cloud) => panic!("{} surfels", cloud.len()),
    };
    let plain = PointSettings::default();
    for (points, expected) in [
        (PointCloud::default(), "the point cloud has no points"),
        (cloud_of(vec![Vec3::X, Vec3::NAN]), "position 1 is not finite"),
        (PointCloud { origin: DVec3::INFINITY, ..three() }, "origin 0 is not finite"),
        (PointCloud { viewpoint: Some(DVec3::NAN), ..three() }, "viewpoint 0 is not finite"),
        (PointCloud { radii: Some(vec![0.0, 0.0, f32::INFINITY]), ..three() }, "radius 2 is not finite"),
        (PointCloud { intensities: Some(vec![f32::NAN; 3]), ..three() }, "intensity 0 is not finite"),
        (
            PointCloud { colors: Some(Vec::new()), ..three() },
            "0 colours for 3 points; there must be one for each",
        ),
        (
            PointCloud { normals: Some(vec![Vec3::X; 4]), ..three() },
            "4 normals for 3 points; there must be one for each",
        ),
        (cloud_of(vec![Vec3::X * 1e30, Vec3::Y * 1e30]), "surfels of radius"),
        (cloud_of(vec![Vec3::X * 1e-30, Vec3::Y * 1e-30]), "surfels of radius"),
    ] {
        let found = message(&points, &plain);
        assert!(found.starts_with(expected), "{found}");
    }
    for (settings, expected) in [
        (PointSettings { neighbors: 2, ..plain }, "the number of neighbours is 2; it must be from 3 to 64"),
        (
            PointSettings { up: Vec3::ZERO, ..plain },
            "the upward direction is [0, 0, 0]; it must be finite and not zero",
        ),
        (
            PointSettings { range: Some([2.0, 1.0]), ..plain },
            "the range of colours is 2 to 1; it must be finite, the lower end first",
        ),
        (
            PointSettings { color: PointColor::Intensity, ..plain },
            "the point cloud has no intensities to be coloured by",
        ),
    ] {
        assert_eq!(message(&three(), &settings), expected);
    }
    assert_eq!(point_surfels(&PointCloud::default(), &plain), Err(PointError::Empty));
}
