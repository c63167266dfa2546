//! Random clusters, near and far, of any kind.

use crate::scenes::*;
use crate::{alike, in_order};
use glam::{DVec3, Mat3, Vec3};
use oblate_engine::cloud::oblate_factor;
use oblate_engine::{
    Camera, Cloud, Material, OpacityFilter, Pose, RenderSettings, Shapes, Splats, Strength, Surface,
};
use proptest::prelude::*;

/// Numbers from −1 to 1 that look random.
fn noise(seed: u32) -> impl FnMut() -> f32 {
    let mut state = u64::from(seed) * 2 + 1;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

/// Patches of a thousand surfels or kernels each, around places in a box that the camera may stand in.
fn patches(seed: u32, (count, size, opacity, kind): (usize, f32, f32, usize)) -> Cloud {
    let mut next = noise(seed);
    let mut vector = || Vec3::new(next(), next(), next());
    let (mut centers, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..count {
        let middle = vector() * Vec3::new(1.5, 1.5, 3.0);
        let normal = (vector() + Vec3::new(0.0, 0.0, 1e-3)).normalize();
        let (u, v) = normal.any_orthonormal_pair();
        let color = (vector() * 0.5 + 0.5).to_array();
        for i in 0..1024 {
            let [x, y] = [i % 32, i / 32].map(|i| (i as f32 - 15.5) / 15.5 * size);
            let off = if kind == 0 { Vec3::ZERO } else { vector() * size * 0.3 };
            centers.push(middle + u * x + v * y + off);
            normals.push(normal);
            colors.push(color);
        }
    }
    let spacing = size / 15.5;
    let total = centers.len();
    let factor = |normal: &Vec3| oblate_factor(*normal, 0.8 * spacing, f32::INFINITY);
    let (strength, shapes) = match kind {
        0 => (
            Strength::Surface(Surface {
                areas: vec![spacing * spacing; total],
                opacities: (opacity < 1.0).then(|| vec![opacity; total]),
                depth_tolerance: spacing,
                coverage_floor: 0.9,
                closed: seed.is_multiple_of(2).into(),
            }),
            Shapes::Each(normals.iter().map(factor).collect()),
        ),
        1 => (
            Strength::Extinction { masses: vec![20.0 * opacity * spacing * spacing; total] },
            Shapes::Shared(Mat3::IDENTITY * spacing),
        ),
        _ => (
            Strength::Opacity {
                peaks: vec![opacity.min(0.99); total],
                filter: OpacityFilter::Classic,
                least: 0.0,
            },
            Shapes::Each(normals.iter().map(factor).collect()),
        ),
    };
    Cloud::new(Splats {
        centers,
        shapes,
        strength,
        colors,
        harmonics: None,
        normals: Some(normals),
        material: Material::UNLIT,
    })
    .unwrap()
}

/// Draws clusters with and without what is hidden: as many of each kind, of a size and an opacity, before an eye at a
/// distance, with a wall at an angle, and with the ends of kernels and of surfels.
fn leaves_out(
    (seed, counts): (u32, [usize; 3]),
    [size, opacity]: [f32; 2],
    (distance, is_parallel): (f64, bool),
    wall: Option<f64>,
    [cutoff, outline]: [f64; 2],
) {
    let mut clouds: Vec<_> = (0..3)
        .filter(|kind| counts[*kind] > 0)
        .map(|kind| patches(seed + kind as u32, (counts[kind], size, opacity, kind)))
        .collect();
    // Most of them stand behind it, some beside it and some before.
    clouds.extend(wall.map(|degrees| {
        let wall = in_order(&plane(200, 0.02, [0.5, 0.5, 0.9]));
        wall.transformed(tilted(degrees, DVec3::new(0.0, 0.0, -1.0)))
    }));
    let pose = Pose::look_at(DVec3::new(0.2, 0.1, -distance), DVec3::ZERO, DVec3::Y).unwrap();
    let camera = if is_parallel {
        Camera::orthographic(pose, 2.5, [90, 70]).unwrap()
    } else {
        Camera::perspective(pose, 0.9, [90, 70]).unwrap()
    };
    let (_, [all, rest]) = alike(&clouds, &camera, &RenderSettings { cutoff, outline, ..unshaded() });
    println!("{} of {} left out", rest.occluded, all.visible);
}

/// Near surfels of both forms: those of a batch are summed form by form.
#[test]
fn other_batches_change_nothing_but_roundings() {
    leaves_out((32_831, [39, 0, 0]), [0.852_853_7, 1.0], (3.111_365_122_144_907_2, false), None, [6.0, 40.0]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn leaving_out_changes_nothing(
        seed in 0..1_000_000_u32,
        counts in [8..60_usize, 0..20_usize, 0..20_usize],
        size in 0.1..0.9_f32,
        opacity in prop_oneof![Just(1.0_f32), Just(0.999), 0.3..1.0_f32],
        distance in 0.3..5.0_f64,
        is_parallel: bool,
        wall in prop_oneof![Just(None), (-40.0..40.0_f64).prop_map(Some)],
        ends in prop_oneof![Just([12.25; 2]), Just([40.0, 6.0]), Just([6.0, 40.0])],
    ) {
        leaves_out((seed, counts), [size, opacity], (distance, is_parallel), wall, ends);
    }
}
