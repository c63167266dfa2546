//! The surfels of a mesh cover it evenly, whatever its triangles are like.

mod support;

use glam::{DAffine3, DMat3, DVec3, dvec3};
use oblate_engine::Cloud;
use oblate_surfels::{
    Density, MESH_COVERAGE_FLOOR, MESH_SURFEL_RADIUS, Mesh, Primitive, SamplerSettings, primitives, sample,
};
use std::f64::consts::TAU;
use support::{Finder, mesh_of, quasirandom, surface, total_area};

const PLACES: usize = 3000;

/// Above the floor, what is to be seen of unevenness is little: colours are means over Σw, and a layer counts as more than one sheet only
/// where it covers farther above 1 than the floor is below.
const CEILING: f64 = 2.0 - MESH_COVERAGE_FLOOR as f64;

fn surfels(mesh: &Mesh, count: usize) -> (Cloud, f64) {
    let cloud = sample(mesh, Density::Count(count), &SamplerSettings::default()).expect("the mesh is right");
    let spacing = (mesh.area() / count as f64).sqrt();
    assert!(
        (f64::from(surface(&cloud).depth_tolerance) / (2.0 * f64::from(MESH_SURFEL_RADIUS) * spacing) - 1.0)
            .abs()
            < 1e-5
    );
    // Each of n areas is rounded to f32 once, and positions were: 6e-8 each, to the second power.
    let error = total_area(&cloud) / mesh.area() - 1.0;
    assert!(error.abs() < 1e-6, "areas sum to the mesh's times 1 + {error:e}");
    (cloud, spacing)
}

/// Checks Σw at places on the surface given with their outward normals.
fn assert_even(cloud: &Cloud, spacing: f64, places: impl Iterator<Item = (DVec3, DVec3)>) {
    let finder = Finder::new(cloud, 5.0 * f64::from(MESH_SURFEL_RADIUS) * spacing);
    let covers: Vec<f64> = places.map(|(at, normal)| finder.coverage(at, normal)).collect();
    assert!(covers.len() > PLACES / 10, "only {} places were looked at", covers.len());
    let least = covers.iter().copied().fold(f64::INFINITY, f64::min);
    let most = covers.iter().copied().fold(0.0, f64::max);
    assert!(least >= f64::from(MESH_COVERAGE_FLOOR), "Σw falls to {least}");
    assert!(most <= CEILING, "Σw rises to {most}");
}

/// Places in the triangles of a mesh, three radii away from all their edges.
fn within_triangles(mesh: &Mesh, margin: f64) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
    let corners = |p: &Primitive, t: [u32; 3]| {
        t.map(|i| p.primitive_to_mesh.transform_point3(p.positions[i as usize].as_dvec3()))
    };
    let all: Vec<[DVec3; 3]> =
        mesh.primitives.iter().flat_map(|p| p.triangles.iter().map(move |t| corners(p, *t))).collect();
    (0..20 * PLACES).filter_map(move |i| {
        let [a, b, c] = all[i % all.len()];
        let [u, v] = quasirandom(i);
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let at = a + (b - a) * u + (c - a) * v;
        let normal = (b - a).cross(c - a).normalize();
        let from_edge = |p: DVec3, q: DVec3| normal.cross(q - p).normalize().dot(at - p);
        (from_edge(a, b).min(from_edge(b, c)).min(from_edge(c, a)) > margin).then_some((at, normal))
    })
}

#[test]
fn a_square_of_huge_middling_or_tiny_triangles() {
    let turned = DAffine3::from_rotation_x(0.3);
    for cells in [1, 7, 250] {
        let (cloud, spacing) = surfels(&mesh_of(primitives::plane(cells), turned), 10_000);
        let ratio = cloud.len() as f64 / 10_000.0;
        assert!((0.9..1.1).contains(&ratio), "{cells}: {} surfels for 10000", cloud.len());
        let inner = 1.0 - 3.0 * f64::from(MESH_SURFEL_RADIUS) * spacing;
        let place = |i| {
            let [u, v] = quasirandom(i);
            let at = dvec3((2.0 * u - 1.0) * inner, 0.0, (2.0 * v - 1.0) * inner);
            (turned.transform_point3(at), turned.transform_vector3(DVec3::Y))
        };
        assert_even(&cloud, spacing, (0..PLACES).map(place));
    }
}

#[test]
fn neighbours_keep_their_distance() {
    for cells in [1, 250] {
        let (cloud, spacing) = surfels(&mesh_of(primitives::plane(cells), DAffine3::IDENTITY), 10_000);
        let finder = Finder::new(&cloud, 2.0 * spacing);
        let nearest = |i: usize| {
            let others = finder.near(finder.centers[i]).filter(|&j| j != i);
            others
                .map(|j| finder.centers[i].distance(finder.centers[j]) / spacing)
                .fold(f64::INFINITY, f64::min)
        };
        let mut distances: Vec<f64> = (0..cloud.len()).map(nearest).collect();
        distances.sort_by(f64::total_cmp);
        // The square lattice of an aligned plane, but for cells that the border cuts.
        assert!(distances[0] > 0.5, "two are {} spacings apart", distances[0]);
        assert!((distances[distances.len() / 2] - 1.0).abs() < 1e-3);
        assert!(distances[distances.len() - 1] < 1.5);
    }
}

#[test]
fn spheres_of_fine_and_coarse_triangles() {
    for segments in [300, 1000] {
        let (cloud, spacing) = surfels(&mesh_of(primitives::sphere(segments), DAffine3::IDENTITY), 10_000);
        let place = |i| {
            let [u, v] = quasirandom(i);
            let (z, (sin, cos)) = (2.0 * u - 1.0, (TAU * v).sin_cos());
            let normal = dvec3((1.0 - z * z).sqrt() * cos, z, (1.0 - z * z).sqrt() * sin);
            (normal, normal)
        };
        assert_even(&cloud, spacing, (0..PLACES).map(place));
    }
    let coarse = mesh_of(primitives::sphere(12), DAffine3::from_scale(dvec3(3.0, 3.0, 3.0)));
    let (cloud, spacing) = surfels(&coarse, 10_000);
    assert_even(&cloud, spacing, within_triangles(&coarse, 3.0 * f64::from(MESH_SURFEL_RADIUS) * spacing));
}

#[test]
fn tori_sampled_finely_and_coarsely() {
    let mesh = mesh_of(primitives::torus_knot(1, 0, 0.3, [300, 100]), DAffine3::IDENTITY);
    for count in [2_000, 20_000] {
        let (cloud, spacing) = surfels(&mesh, count);
        let place = |i| {
            let [u, v] = quasirandom(i);
            let ((sin, cos), (up, out)) = ((TAU * u).sin_cos(), (TAU * v).sin_cos());
            let normal = dvec3(cos * out, up, sin * out);
            (dvec3(cos, 0.0, sin) + 0.3 * normal, normal)
        };
        assert_even(&cloud, spacing, (0..PLACES).map(place));
    }
}

/// Six squares; their transforms are permutations, so that edges fit exactly.
fn cube() -> Mesh {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let side = |i: usize| {
        let (along, sign) = (i % 3, if i < 3 { 1.0 } else { -1.0 });
        let (normal, first) = (sign * axes[along], axes[(along + 1) % 3]);
        let turn = DMat3::from_cols(first, normal, first.cross(normal));
        Primitive { primitive_to_mesh: DAffine3::from_mat3_translation(turn, normal), ..primitives::plane(1) }
    };
    Mesh { primitives: (0..6).map(side).collect() }
}

#[test]
fn a_cube_has_even_faces_and_sharp_edges() {
    let mesh = cube();
    let (cloud, spacing) = surfels(&mesh, 12_000);
    assert!(surface(&cloud).closed.is_everywhere());
    assert_even(&cloud, spacing, within_triangles(&mesh, 3.0 * f64::from(MESH_SURFEL_RADIUS) * spacing));
    // No surfel owns two sides of an edge: each lies in a face and faces as it does.
    let finder = Finder::new(&cloud, spacing);
    for (center, normal) in finder.centers.iter().zip(&finder.normals) {
        assert!(normal.abs().max_element() > 1.0 - 1e-6, "{normal} at {center}");
        assert!((center.dot(*normal) - 1.0).abs() < 1e-6, "{center} is not in the face to {normal}");
    }
}

#[test]
fn both_sides_of_a_thin_wall() {
    let over = DAffine3::from_rotation_x(std::f64::consts::PI);
    let back = DAffine3::from_translation(dvec3(0.0, -1e-3, 0.0)) * over;
    let mut mesh = mesh_of(primitives::plane(1), DAffine3::IDENTITY);
    mesh.primitives.push(Primitive { primitive_to_mesh: back, ..primitives::plane(1) });
    let (cloud, spacing) = surfels(&mesh, 10_000); // spacing 0.028: the wall is 1/28 of it
    assert_even(&cloud, spacing, within_triangles(&mesh, 3.0 * f64::from(MESH_SURFEL_RADIUS) * spacing));
}

#[test]
fn slivers_are_covered_along_their_length() {
    // A fan: 1000 triangles of length 1 whose narrow side is a twelfth of a spacing.
    let count = 1000_u32;
    let mut fan = primitives::plane(1);
    let rim = |i: u32| (0.25 * TAU * f64::from(i) / f64::from(count)).sin_cos();
    fan.positions = (0..=count).map(rim).map(|(sin, cos)| dvec3(sin, 0.0, cos).as_vec3()).collect();
    fan.positions.push(glam::Vec3::ZERO);
    fan.triangles = (0..count).map(|i| [i, i + 1, count + 1]).collect();
    fan.normals = None;
    fan.tex_coords = None;
    let (cloud, spacing) = surfels(&mesh_of(fan, DAffine3::IDENTITY), 2_000);
    let margin = 3.0 * f64::from(MESH_SURFEL_RADIUS) * spacing;
    let place = |i| {
        let [u, v] = quasirandom(i);
        let (at, radius) = (dvec3(u, 0.0, v), u.hypot(v));
        (u > margin && v > margin && radius < 1.0 - margin).then_some((at, DVec3::Y))
    };
    assert_even(&cloud, spacing, (0..PLACES).filter_map(place));
}
