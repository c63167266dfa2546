//! Orientation, closedness, sizes, and meshes that are wrong.

mod support;

use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4, dvec3};
use oblate_engine::{Camera, Closed, Cloud, Intrinsics, Pose, Projection};
use oblate_surfels::{
    Density, Filter, Mesh, Primitive, SampleError, SamplerSettings, Texture, Wrap, primitives, sample,
    view_spacing,
};
use proptest::prelude::*;
use std::f64::consts::PI;
use std::sync::Arc;
use support::{centers, mesh_of, outward, surface, total_area};

fn surfels(mesh: &Mesh, count: usize) -> Result<Cloud, SampleError> {
    sample(mesh, Density::Count(count), &SamplerSettings::default())
}

fn sphere(transform: DAffine3) -> Mesh {
    mesh_of(primitives::sphere(200), transform)
}

#[test]
fn surfels_face_outwards_also_when_mirrored() {
    let far = DAffine3::from_translation(dvec3(1e6, -2e6, 3e6));
    let mirrored = DAffine3::from_scale(dvec3(-1.0, 1.0, 1.0));
    for (name, transform) in [("plain", DAffine3::IDENTITY), ("mirrored", mirrored), ("far", far)] {
        let cloud = surfels(&sphere(transform), 3000).unwrap();
        let normals = cloud.splats().normals.unwrap();
        let rows = centers(&cloud).into_iter().zip(outward(&cloud)).zip(&normals);
        for ((center, facing), normal) in rows {
            let expected = center - transform.translation;
            // A cell of 0.065 turns the mean normal by less than that; a far centre keeps its digits.
            assert!((expected.length() - 1.0).abs() < 1e-3, "{name}: {center}");
            assert!(facing.dot(expected) > 0.995, "{name}: faces {facing} at {expected}");
            assert!(normal.as_dvec3().dot(expected) > 0.999, "{name}: shaded {normal} at {expected}");
        }
    }
}

#[test]
fn stretched_normals_are_the_ellipsoids() {
    let scale = dvec3(1.0, 2.0, 3.0);
    let cloud = surfels(&sphere(DAffine3::from_scale(scale)), 20_000).unwrap();
    let normals = cloud.splats().normals.unwrap();
    for (center, normal) in centers(&cloud).iter().zip(&normals) {
        let expected = (*center / scale / scale).normalize();
        assert!(normal.as_dvec3().dot(expected) > 0.999, "{normal} at {center}, not {expected}");
    }
}

#[test]
fn surfels_are_flat_and_about_round() {
    let cloud = surfels(&sphere(DAffine3::IDENTITY), 1000).unwrap();
    let tolerance = surface(&cloud).depth_tolerance;
    for i in 0..cloud.len() {
        let factor = cloud.factor(i);
        assert_eq!(factor.z_axis, Vec3::ZERO);
        // Cells are √1.5 spacings wide. At least the blur, 0.4 of that over 0.7 spacings; at most what the largest piece, a hexagon or a
        // rectangle of a variance of 1/6, adds to it.
        for axis in [factor.x_axis, factor.y_axis] {
            let radii = 2.0 * axis.length() / tolerance;
            assert!((0.699..1.01).contains(&radii), "{radii}");
        }
    }
}

#[test]
fn measures() {
    let turned = DAffine3::from_scale_rotation_translation(
        dvec3(2.0, 1.0, 3.0),
        glam::DQuat::from_rotation_y(PI / 2.0),
        dvec3(1.0, 5.0, 0.0),
    );
    let mesh = mesh_of(primitives::plane(3), turned);
    assert!((mesh.area() - 24.0).abs() < 1e-6);
    let [low, high] = mesh.bounds().unwrap();
    assert!(low.distance(dvec3(-2.0, 5.0, -2.0)) < 1e-6 && high.distance(dvec3(4.0, 5.0, 2.0)) < 1e-6);
    assert_eq!(Mesh::default().bounds(), None);
    assert!((sphere(DAffine3::IDENTITY).area() / (4.0 * PI) - 1.0).abs() < 1e-3);
    // Pappus: 2π · 2π · 0.3, but for the facets.
    let torus = mesh_of(primitives::torus_knot(1, 0, 0.3, [200, 100]), DAffine3::IDENTITY);
    assert!((torus.area() / (4.0 * PI * PI * 0.3) - 1.0).abs() < 2e-3);
}

#[test]
fn closed_meshes_are_told_from_open_ones() {
    let knot = |p, q| mesh_of(primitives::torus_knot(p, q, 0.2, [64, 16]), DAffine3::from_rotation_y(0.7));
    for closed in [sphere(DAffine3::from_rotation_z(0.1)), knot(2, 3), knot(1, 0)] {
        assert!(closed.is_closed());
        let volume = |p: &Primitive| {
            let corner = |i: u32| p.positions[i as usize].as_dvec3();
            let six = |t: &[u32; 3]| corner(t[0]).dot(corner(t[1]).cross(corner(t[2])));
            p.triangles.iter().map(six).sum::<f64>()
        };
        assert!(closed.primitives.iter().map(volume).sum::<f64>() > 0.0, "inside out");

        let mut with_hole = closed.clone();
        with_hole.primitives[0].triangles.pop();
        assert!(!with_hole.is_closed());
        let mut flipped = closed.clone();
        flipped.primitives[0].triangles[5].swap(0, 1);
        assert!(!flipped.is_closed());
        let mut doubled = closed.clone();
        doubled.primitives.extend(closed.primitives.iter().cloned());
        assert!(!doubled.is_closed());
    }
    assert!(!mesh_of(primitives::plane(2), DAffine3::IDENTITY).is_closed());
    // Inside out, by itself, beside one that isn't, and as a mirror image of what is.
    let mut turned = sphere(DAffine3::from_translation(dvec3(5.0, 0.0, 0.0)));
    let mirrored = sphere(DAffine3::from_scale(dvec3(1.0, 1.0, -1.0)));
    turned.primitives[0].triangles.iter_mut().for_each(|triangle| triangle.swap(0, 1));
    assert!(!turned.is_closed() && mirrored.is_closed());
    let mut both = sphere(DAffine3::IDENTITY);
    assert!(both.is_closed());
    both.primitives.extend(turned.primitives);
    assert!(!both.is_closed());
    assert!(!Mesh::default().is_closed());
    assert!(surface(&surfels(&knot(2, 3), 500).unwrap()).closed.is_everywhere());
}

/// An open mesh has sides if its triangles are known to face as their neighbours do.
#[test]
fn sides_are_told_from_none() {
    let closed = |mesh: &Mesh| surface(&surfels(mesh, 500).unwrap()).closed.clone();
    let plane = mesh_of(primitives::plane(20), DAffine3::IDENTITY);
    assert_eq!(closed(&plane), Closed::Sided);
    let changed = |change: fn(&mut Vec<[u32; 3]>)| {
        let mut mesh = plane.clone();
        change(&mut mesh.primitives[0].triangles);
        closed(&mesh)
    };
    // Turned, all of them are; one, or half, are not as the others are.
    assert_eq!(changed(|all| all.iter_mut().for_each(|t| t.swap(0, 1))), Closed::Sided);
    assert_eq!(changed(|all| all[300].swap(0, 1)), Closed::Nowhere);
    assert_eq!(changed(|all| all[..400].iter_mut().for_each(|t| t.swap(0, 1))), Closed::Nowhere);
    // A third sheet at one edge of 2400 is none of its own; where few triangles have neighbours nothing is known.
    assert_eq!(changed(|all| all.push([all[300][0], all[300][1], 0])), Closed::Sided);
    assert_eq!(changed(|all| *all = all.iter().step_by(2).copied().collect()), Closed::Nowhere);
}

#[test]
fn backs_are_dropped_where_nobody_sees_them_or_the_file_asks_for_it() {
    let drops_backs = |shapes: &[(Primitive, f32, bool)]| {
        let part = |(shape, alpha, double_sided): &(Primitive, f32, bool)| {
            let mut part = Primitive { double_sided: *double_sided, ..shape.clone() };
            part.material.factor.w = *alpha;
            part
        };
        surface(&surfels(&Mesh { primitives: shapes.iter().map(part).collect() }, 300).unwrap())
            .closed
            .is_everywhere()
    };
    let (ball, sheet) = (primitives::sphere(40), primitives::plane(2));
    for (alpha, double_sided, of_ball, of_sheet) in [
        (1.0, true, true, false),
        (1.0, false, true, false),
        (0.5, true, false, false),
        (0.5, false, true, true),
    ] {
        assert_eq!(drops_backs(&[(ball.clone(), alpha, double_sided)]), of_ball, "{alpha} {double_sided}");
        assert_eq!(drops_backs(&[(sheet.clone(), alpha, double_sided)]), of_sheet, "{alpha} {double_sided}");
    }
    let far =
        Primitive { primitive_to_mesh: DAffine3::from_translation(dvec3(5.0, 0.0, 0.0)), ..ball.clone() };
    let pair = |first: (f32, bool), second: (f32, bool)| {
        drops_backs(&[(ball.clone(), first.0, first.1), (far.clone(), second.0, second.1)])
    };
    assert!(pair((1.0, true), (1.0, false)) && pair((0.5, false), (1.0, false)));
    assert!(!pair((0.5, false), (1.0, true)) && !pair((0.5, false), (0.5, true)));
}

#[test]
fn the_same_for_any_number_of_threads() {
    let mesh = mesh_of(primitives::torus_knot(2, 3, 0.2, [300, 40]), DAffine3::IDENTITY);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| surfels(&mesh, 60_000)).unwrap()
    };
    let one = with(1);
    assert!(one.len() > 50_000);
    assert!(one == with(2) && one == with(5));
}

#[test]
fn a_million_tiny_triangles_become_ten_thousand_surfels() {
    let mesh = mesh_of(primitives::plane(710), DAffine3::IDENTITY);
    assert!(mesh.primitives[0].triangles.len() > 1_000_000);
    let cloud = surfels(&mesh, 10_000).unwrap();
    assert!((9_000..11_000).contains(&cloud.len()), "{}", cloud.len());
    assert!((total_area(&cloud) / 4.0 - 1.0).abs() < 1e-6);
}

#[test]
fn one_huge_triangle() {
    let mut triangle = primitives::plane(1);
    triangle.triangles.truncate(1);
    let mesh = mesh_of(triangle, DAffine3::from_scale(DVec3::splat(1e9)));
    let cloud = surfels(&mesh, 100_000).unwrap();
    assert!((90_000..110_000).contains(&cloud.len()), "{}", cloud.len());
    assert!((total_area(&cloud) / mesh.area() - 1.0).abs() < 1e-6);
}

#[test]
fn spacing_and_count_are_two_words_for_one_thing() {
    let mesh = mesh_of(primitives::plane(1), DAffine3::IDENTITY);
    let by_spacing = sample(&mesh, Density::Spacing(0.02), &SamplerSettings::default()).unwrap();
    assert_eq!(by_spacing, surfels(&mesh, 10_000).unwrap());
}

/// A poster a fifth of a surfel before a wall: no surfel stands for both, and each has the places and colours of one.
#[test]
fn parts_of_a_mesh_have_their_own_surfels() {
    let mut mesh = mesh_of(primitives::plane(1), DAffine3::IDENTITY);
    let mut poster = mesh.primitives[0].clone();
    let normal = surfels(&mesh, 100).unwrap().splats().normals.unwrap()[0].as_dvec3();
    poster.primitive_to_mesh = DAffine3::from_translation(normal * 0.004);
    poster.material.factor = glam::Vec4::new(1.0, 0.0, 0.0, 1.0);
    mesh.primitives[0].material.factor = glam::Vec4::new(0.0, 1.0, 0.0, 1.0);
    mesh.primitives.push(poster);
    let cloud = sample(&mesh, Density::Spacing(0.02), &SamplerSettings::default()).unwrap();
    let splats = cloud.splats();
    let to_world = cloud.cloud_to_world();
    let mut counts = [0; 2];
    for (center, color) in splats.centers.iter().zip(&splats.colors) {
        let distance = to_world.transform_point3(center.as_dvec3()).dot(normal);
        let is_poster = distance > 0.002;
        assert_eq!(*color, if is_poster { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] });
        // As exact as single precision is.
        assert!((distance - if is_poster { 0.004 } else { 0.0 }).abs() < 1e-6, "{distance}");
        counts[usize::from(is_poster)] += 1;
    }
    assert!(counts[0] == counts[1] && counts[0] > 9_000, "{counts:?}");
}

#[test]
fn never_more_surfels_than_the_cap() {
    let settings = SamplerSettings { max_surfels: 500, ..SamplerSettings::default() };
    // Sixty far specks, each of which gets a surfel at any spacing that tells them apart, and a square.
    let speck = |i: u32| Primitive {
        primitive_to_mesh: DAffine3::from_scale_rotation_translation(
            DVec3::splat(1e-5),
            glam::DQuat::from_rotation_x(f64::from(i)),
            dvec3(f64::from(i), 3.0, 0.0),
        ),
        ..primitives::plane(1)
    };
    let mut mesh = mesh_of(primitives::plane(1), DAffine3::IDENTITY);
    mesh.primitives.extend((0..60).map(speck));
    for max_surfels in [1, 20, 500] {
        let settings = SamplerSettings { max_surfels, ..settings };
        let cloud = sample(&mesh, Density::Spacing(1e-4), &settings).unwrap();
        assert!(cloud.len() <= max_surfels && 3 * cloud.len() >= max_surfels, "{}", cloud.len());
        assert!((total_area(&cloud) / mesh.area() - 1.0).abs() < 1e-6);
    }
    // A hair: 1 long, 10⁻⁶ wide. By its area it would be a million spacings of 10⁻⁶ long.
    let hair = mesh_of(primitives::plane(1), DAffine3::from_scale(dvec3(1.0, 1.0, 1e-6)));
    let cloud = sample(&hair, Density::Spacing(1e-8), &settings).unwrap();
    assert!(cloud.len() <= 500 && cloud.len() > 50, "{}", cloud.len());
}

#[test]
fn triangles_without_area_are_left_out() {
    let mut mesh = mesh_of(primitives::plane(1), DAffine3::IDENTITY);
    let expected = surfels(&mesh, 1000).unwrap();
    mesh.primitives[0].triangles.extend([[0, 0, 1], [2, 2, 2]]);
    assert_eq!(surfels(&mesh, 1000).unwrap(), expected);
    mesh.primitives[0].triangles = vec![[0, 0, 1]];
    assert_eq!(surfels(&mesh, 1000), Err(SampleError::NoArea));
}

#[test]
fn wrong_meshes_are_refused() {
    let good = primitives::plane(1);
    let refused = |change: &dyn Fn(&mut Primitive)| {
        let mut primitive = good.clone();
        change(&mut primitive);
        surfels(&Mesh { primitives: vec![good.clone(), primitive] }, 10).unwrap_err()
    };
    assert_eq!(surfels(&Mesh::default(), 10), Err(SampleError::Empty));
    assert_eq!(
        refused(&|p| p.triangles[1][2] = 4),
        SampleError::Index { primitive: 1, triangle: 1, index: 4, positions: 4 }
    );
    let not_finite = |what, index| SampleError::NotFinite { primitive: 1, what, index };
    assert_eq!(refused(&|p| p.positions[2].y = f32::NAN), not_finite("position", 2));
    assert_eq!(refused(&|p| p.primitive_to_mesh.translation.x = f64::INFINITY), not_finite("transform", 0));
    assert_eq!(refused(&|p| p.material.factor.w = f32::NAN), not_finite("base colour factor", 0));
    assert_eq!(refused(&|p| p.alpha_cutoff = Some(f32::NAN)), not_finite("alpha cut-off", 0));
    assert_eq!(refused(&|p| p.colors = Some(vec![Vec4::NAN; 4])), not_finite("colour", 0));
    let coords = |p: &mut Primitive| p.tex_coords = Some(vec![Vec2::INFINITY; 4]);
    assert_eq!(refused(&coords), not_finite("texture coordinate", 0));
    let length = |array| SampleError::Length { primitive: 1, array, found: 3, positions: 4 };
    assert_eq!(refused(&|p| p.normals = Some(vec![Vec3::Y; 3])), length("normals"));
    assert_eq!(refused(&|p| p.colors = Some(vec![Vec4::ONE; 3])), length("colours"));
    assert_eq!(refused(&|p| p.tex_coords = Some(vec![Vec2::ONE; 3])), length("texture coordinates"));
    let texture = |width, height| {
        let texels = vec![[0; 4]; 6];
        Some(Arc::new(Texture { width, height, texels, wrap: [Wrap::Clamp; 2], filter: Filter::Linear }))
    };
    for (width, height) in [(2, 2), (usize::MAX, 2), (0, 6)] {
        let expected = SampleError::Texture { primitive: 1, width, height, found: 6 };
        assert_eq!(refused(&|p| p.material.texture = texture(width, height)), expected);
    }
    let mesh = mesh_of(good.clone(), DAffine3::IDENTITY);
    for spacing in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let found = sample(&mesh, Density::Spacing(spacing), &SamplerSettings::default());
        assert!(matches!(found, Err(SampleError::Density { what: "spacing", .. })), "{spacing}: {found:?}");
    }
    assert!(matches!(surfels(&mesh, 0), Err(SampleError::Density { .. })));
    for scale in [1e-30, 1e30, 1e200] {
        let found = surfels(&mesh_of(good.clone(), DAffine3::from_scale(DVec3::splat(scale))), 10);
        assert!(matches!(found, Err(SampleError::Size(_))), "{scale}: {found:?}");
    }
}

#[test]
fn useless_normals_fall_back_to_the_triangles() {
    let mut plane = primitives::plane(1);
    plane.normals = Some(vec![Vec3::ZERO, Vec3::NAN, Vec3::ZERO, Vec3::ZERO]);
    let cloud = surfels(&mesh_of(plane, DAffine3::IDENTITY), 100).unwrap();
    let normals = cloud.splats().normals.unwrap();
    assert!(normals.iter().all(|n| n.distance(Vec3::Y) < 1e-6));
}

#[test]
fn the_view_says_how_dense() {
    let bounds = [DVec3::splat(-1.0), DVec3::splat(1.0)];
    let look = |eye, target| Pose::look_at(eye, target, DVec3::Y).unwrap();
    let focal = 500.0 / (PI / 12.0).tan();
    let camera = |pose| Camera::perspective(pose, PI / 6.0, [1000, 1000]).unwrap();
    let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} is not {b}");
    // The nearest face is 4 away.
    close(view_spacing(&camera(look(dvec3(0.0, 0.0, 5.0), DVec3::ZERO)), bounds), 4.0 / focal);
    // Only what the picture shows counts: this one sees the far end of a long box alone.
    let long = [dvec3(-1.0, -1.0, -50.0), dvec3(1.0, 1.0, 3.0)];
    let beside = camera(look(dvec3(9.0, 0.0, 0.0), dvec3(0.0, 0.0, -40.0)));
    let seen = view_spacing(&beside, long) * focal;
    assert!(seen > 12.0 && seen < 25.0, "the nearest part seen is {seen} away");
    // Inside: a tenth of the diagonal.
    let inside = camera(look(dvec3(0.1, 0.2, 0.3), DVec3::ZERO));
    close(view_spacing(&inside, bounds), 0.1 * 12_f64.sqrt() / focal);
    // Looking away, the box beside or behind it: still a number to work with.
    for target in [dvec3(0.0, 0.0, 9.0), dvec3(50.0, 0.0, 5.0)] {
        let spacing = view_spacing(&camera(look(dvec3(0.0, 0.0, 5.0), target)), bounds);
        assert!(spacing > 0.0 && spacing.is_finite(), "{spacing}");
    }
    let intrinsics = Intrinsics { focal: glam::DVec2::splat(200.0), center: glam::DVec2::splat(50.0) };
    let pose = look(dvec3(0.0, 0.0, 5.0), DVec3::ZERO);
    let flat = Camera::from_intrinsics(pose, intrinsics, Projection::Orthographic, [100, 100]).unwrap();
    close(view_spacing(&flat, bounds), 1.0 / 200.0);
    // Pixels as wide as their depth count as an eighth of it.
    let intrinsics = Intrinsics { focal: glam::DVec2::ONE, ..intrinsics };
    let wide = Camera::from_intrinsics(pose, intrinsics, Projection::Perspective, [100, 100]).unwrap();
    close(view_spacing(&wide, bounds), 4.0 / 8.0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Any soup of triangles keeps its area, and every surfel is near the soup.
    #[test]
    fn area_is_kept(
        corners in prop::collection::vec(prop::array::uniform3(-1.0_f32..1.0), 3..60),
        count in 1_usize..2000,
    ) {
        let positions: Vec<Vec3> = corners.into_iter().map(Vec3::from_array).collect();
        let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let soup =
            Primitive { positions, triangles, normals: None, tex_coords: None, ..primitives::plane(1) };
        let mesh = mesh_of(soup, DAffine3::IDENTITY);
        let cloud = surfels(&mesh, count).unwrap();
        prop_assert!((total_area(&cloud) / mesh.area() - 1.0).abs() < 1e-5);
        let [low, high] = mesh.bounds().unwrap();
        let spacing = (mesh.area() / count as f64).sqrt();
        for center in centers(&cloud) {
            prop_assert!(center.cmpge(low - spacing).all() && center.cmple(high + spacing).all());
        }
    }
}
