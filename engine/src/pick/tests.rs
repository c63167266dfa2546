//! The hierarchy leaves out nothing that matters: with all ids the same is found.

use super::*;
use crate::camera::{Intrinsics, Pose};
use crate::closed::Closed;
use crate::cloud::{Material, OpacityFilter, Shapes, Splats, Strength, Surface};
use glam::{DQuat, Mat3, Quat, Vec3};
use proptest::prelude::*;

/// Numbers in [0, 1), the same in every run.
fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Splats of all sizes and directions within ±1, in no order.
fn cloud(count: usize, kind: usize, seed: u64) -> Cloud {
    let mut next = random(seed);
    let mut vector = || Vec3::new(next() as f32, next() as f32, next() as f32) * 2.0 - 1.0;
    let centers = (0..count).map(|_| vector()).collect();
    let flat = if kind == 2 { 0.0 } else { 1.0 };
    let factor = |v: Vec3, size: Vec3| {
        let size = size.abs() * 0.08 + 0.001;
        Mat3::from_quat(Quat::from_scaled_axis(3.0 * v))
            * Mat3::from_diagonal(size * Vec3::new(1.0, 1.0, flat))
    };
    let factors = (0..count).map(|_| factor(vector(), vector())).collect();
    let strength = match kind {
        0 => Strength::Extinction { masses: vec![0.01; count] },
        1 => Strength::Opacity { peaks: vec![0.6; count], filter: OpacityFilter::Classic, least: 0.0 },
        _ => Strength::Surface(Surface {
            areas: vec![0.01; count],
            opacities: None,
            depth_tolerance: 0.02,
            coverage_floor: 0.85,
            closed: Closed::Nowhere,
        }),
    };
    Cloud::new(Splats {
        centers,
        shapes: Shapes::Each(factors),
        strength,
        colors: vec![[0.5; 3]; count],
        harmonics: None,
        normals: None,
        material: Material::default(),
    })
    .unwrap()
}

fn camera(parallel: bool, eye: DVec3) -> Camera {
    let pose = Pose::look_at(eye, DVec3::new(0.1, 0.0, 0.2), DVec3::Y).unwrap();
    let projection = if parallel { Projection::Orthographic } else { Projection::Perspective };
    let focal = if parallel { DVec2::new(18.0, 12.0) } else { DVec2::new(70.0, 50.0) };
    let intrinsics = Intrinsics { focal, center: DVec2::new(30.0, 22.0) };
    Camera::from_intrinsics(pose, intrinsics, projection, [64, 48]).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]
    #[test]
    fn all_ids_give_the_same(
        seed in 0..1000_u64,
        kinds in prop::collection::vec(0..3_usize, 1..4),
        parallel: bool,
        eye in prop::array::uniform3(-3.0..3.0_f64),
        pixel in prop::array::uniform2(0.0..48.0_f64),
    ) {
        let mut clouds = Vec::new();
        for (number, kind) in kinds.into_iter().enumerate() {
            let own = cloud(150 + 40 * number, kind, seed + number as u64);
            // Turned, mirrored, stretched, and flat.
            for scale in [DVec3::ONE, DVec3::new(-0.5, 1.0, 2.0), DVec3::new(1.0, 1.0, 0.0)] {
                let turn = DMat3::from_quat(DQuat::from_rotation_y(seed as f64));
                let place = DAffine3::from_mat3_translation(turn * DMat3::from_diagonal(scale), scale);
                clouds.push(own.clone().transformed(place));
            }
        }
        let scene = Scene { clouds, lights: Vec::new() };
        let picker = Picker::new(&scene).unwrap();
        prop_assert_eq!(picker.trees.iter().map(Arc::as_ptr).collect::<std::collections::HashSet<_>>().len(), scene.clouds.len() / 3);
        let (camera, pixel) = (camera(parallel, DVec3::from(eye)), DVec2::from(pixel));
        let settings = RenderSettings::default();
        let median = Median::new(&scene, &camera, &settings);
        let all: Vec<u32> = (0..scene.validate().unwrap() as u32).collect();
        let brute = median.at(pixel, &all);
        let picked = picker.pick(&camera, &settings, pixel).unwrap();
        match (picked, brute) {
            (None, None) => {}
            (Some(picked), Some((id, depth, opacity))) => {
                prop_assert_eq!(picked.id, id);
                // Bit for bit but for kernels that reach it beyond 6σ, whose share is 0.
                prop_assert_eq!((picked.depth, picked.opacity), (depth, opacity));
            }
            different => prop_assert!(false, "{different:?}"),
        }
    }
}

#[test]
fn few_are_looked_at() {
    // 4096 kernels on a lattice of 16³: a ray along an axis meets 16 rows of 6σ and what shares their boxes.
    let centers: Vec<Vec3> =
        (0..4096).map(|i| Vec3::new((i % 16) as f32, (i / 16 % 16) as f32, (i / 256) as f32)).collect();
    let splats = Splats {
        shapes: Shapes::Shared(Mat3::IDENTITY * 0.1),
        strength: Strength::Extinction { masses: vec![0.1; centers.len()] },
        colors: vec![[0.5; 3]; centers.len()],
        harmonics: None,
        normals: None,
        material: Material::default(),
        centers,
    };
    let scene = Scene { clouds: vec![Cloud::new(splats).unwrap()], lights: Vec::new() };
    let pose = Pose::look_at(DVec3::new(-10.0, 8.0, 8.0), DVec3::new(0.0, 8.0, 8.0), DVec3::Y).unwrap();
    let camera = Camera::orthographic(pose, 16.0, [160, 160]).unwrap();
    let picker = Picker::new(&scene).unwrap();
    let mut ids = Vec::new();
    let settings = RenderSettings::default();
    picker.candidates(&camera, &settings, DVec2::splat(80.0), &mut ids);
    // One row of sixteen is one box.
    assert_eq!(ids.len(), 16, "{ids:?}");
    assert!(ids.is_sorted());
}

#[test]
fn coincident_boxes_make_a_tree() {
    let place = [DVec3::ONE; 2];
    let elsewhere = [DVec3::splat(-50.0), DVec3::splat(-49.0)];
    for boxes in [
        vec![place; 10_000],
        vec![[DVec3::ONE, DVec3::splat(1.5)]; 10_000],
        (0..10_000).map(|i| if i == 7 { elsewhere } else { place }).collect(),
    ] {
        let tree = BoxTree::new(&boxes);
        let mut deepest = 0;
        let mut open = vec![(0, 1)];
        while let Some((node, depth)) = open.pop() {
            let node = &tree.bvh.nodes[node];
            deepest = deepest.max(depth);
            if node.prim_count == 0 {
                open.extend([0, 1].map(|child| (node.first_index as usize + child, depth + 1)));
            }
        }
        // 14 would be balanced; without spreading they are chains.
        assert!(deepest < 100, "{deepest} deep of {}", boxes.len());
    }
}
