//! Colours: linear light, filtered over what a surfel owns and not beyond.

mod support;

use glam::{DAffine3, DQuat, DVec3, Vec2, Vec4};
use oblate_engine::color::{linear_to_srgb, srgb_to_linear};
use oblate_engine::{Camera, Cloud, Material, Pose, RenderSettings, Scene, render};
use oblate_surfels::{
    BaseColor, Density, Filter, Mesh, Primitive, SamplerSettings, Texture, Wrap, primitives, sample,
};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use support::{centers, mesh_of, surface};

fn texture(size: [usize; 2], wrap: Wrap, texel: impl Fn(usize, usize) -> [u8; 4]) -> Option<Arc<Texture>> {
    let [width, height] = size;
    let texels = (0..width * height).map(|i| texel(i % width, i / width)).collect();
    Some(Arc::new(Texture { width, height, texels, wrap: [wrap; 2], filter: Filter::Linear }))
}

fn grey(value: u8) -> [u8; 4] {
    [value, value, value, 255]
}

/// A square of side 2 that shows its material.
fn square(material: BaseColor) -> Mesh {
    mesh_of(Primitive { material, ..primitives::plane(1) }, DAffine3::IDENTITY)
}

fn surfels(mesh: &Mesh, count: usize) -> Cloud {
    sample(mesh, Density::Count(count), &SamplerSettings::default()).expect("the mesh is right")
}

#[test]
fn a_minified_checkerboard_is_the_mean_in_linear_light() {
    let board =
        texture([256, 256], Wrap::Repeat, |x, y| grey(if (x + y).is_multiple_of(2) { 255 } else { 0 }));
    let cloud = surfels(&square(BaseColor { factor: Vec4::ONE, texture: board }), 1000);
    // 65 texels a surfel, 8 a point: levels 1 and 2, where every texel is the mean of as many of each.
    for color in &cloud.splats().colors {
        assert!(color.iter().all(|c| (c - 0.5).abs() < 1e-4), "{color:?}");
    }
}

#[test]
fn odd_sides_keep_the_mean() {
    let ramp = texture([7, 5], Wrap::Clamp, |x, y| grey((x * 30 + y * 11) as u8));
    let mean =
        (0..35).map(|i| srgb_to_linear(((i % 7 * 30 + i / 7 * 11) as f32) / 255.0)).sum::<f32>() / 35.0;
    let cloud = surfels(&square(BaseColor { factor: Vec4::ONE, texture: ramp }), 1);
    // Few surfels, each point beyond the last level or nearly: their mean is the texture's, but for the
    // bilinear blend at the border.
    let areas = &surface(&cloud).areas;
    let sum: f32 = cloud.splats().colors.iter().zip(areas).map(|(c, area)| c[0] * area).sum();
    assert!((sum / 4.0 - mean).abs() < 0.03 * mean, "{} is not {mean}", sum / 4.0);
}

#[test]
fn a_texture_of_the_same_resolution_is_blurred_less_than_by_the_kernel() {
    let (size, period) = (128, 8.0);
    let wave = |x: f64| 0.5 + 0.4 * (TAU * x / period).sin();
    let texel =
        |x: usize, _: usize| grey((linear_to_srgb(wave(x as f64 + 0.5) as f32) * 255.0).round() as u8);
    let material = BaseColor { factor: Vec4::ONE, texture: texture([size, size], Wrap::Repeat, texel) };
    let cloud = surfels(&square(material), size * size);
    // Regression of the colour on the wave at the surfel's centre: how much of its amplitude is left.
    let (mut product, mut square) = (0.0, 0.0);
    for (center, color) in centers(&cloud).iter().zip(&cloud.splats().colors) {
        let there = wave((center.x + 1.0) / 2.0 * size as f64) - 0.5;
        product += there * (f64::from(color[0]) - 0.5);
        square += there * there;
    }
    let left = product / square;
    let kernel = (-2.0 * (PI * 0.7 / period).powi(2)).exp();
    assert!(left > kernel && left < 1.01, "{left} of the amplitude is left; the kernel leaves {kernel}");
}

#[test]
fn wrap_modes_say_what_lies_outside() {
    // White in the left half, black in the right; seen over u from −1 to 2.
    let expected = [
        (Wrap::Repeat, [1.0, 0.0, 1.0, 0.0, 1.0, 0.0]),
        (Wrap::Mirror, [0.0, 1.0, 1.0, 0.0, 0.0, 1.0]),
        (Wrap::Clamp, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]),
    ];
    for (wrap, halves) in expected {
        let half = texture([64, 64], wrap, |x, _| grey(if x < 32 { 255 } else { 0 }));
        let mut mesh = square(BaseColor { factor: Vec4::ONE, texture: half });
        for coords in mesh.primitives[0].tex_coords.as_mut().unwrap() {
            *coords = Vec2::new(3.0 * coords.x - 1.0, 3.0 * coords.y - 1.0);
        }
        let cloud = surfels(&mesh, 3000);
        let mut looked_at = [0; 6];
        for (center, color) in centers(&cloud).iter().zip(&cloud.splats().colors) {
            let half = (center.x + 1.0) * 3.0;
            // In the middle of a half: a surfel is a ninth of it wide.
            if (half.fract() - 0.5).abs() < 0.25 {
                let expected: f32 = halves[half as usize];
                assert!((color[0] - expected).abs() < 1e-4, "{wrap:?} at {half}: {color:?}");
                looked_at[half as usize] += 1;
            }
        }
        assert!(looked_at.iter().all(|&n| n > 50));
    }
}

#[test]
fn factor_vertex_colour_and_texture_multiply() {
    let mut mesh = square(BaseColor {
        factor: Vec4::new(0.5, 1.0, 0.25, 1.0),
        texture: texture([4, 4], Wrap::Clamp, |_, _| [255, 255, 255, 255]),
    });
    // Red rises along x from 0 to 1.
    let red = |p: &glam::Vec3| Vec4::new((p.x + 1.0) / 2.0, 0.5, 1.0, 1.0);
    mesh.primitives[0].colors = Some(mesh.primitives[0].positions.iter().map(red).collect());
    let cloud = surfels(&mesh, 1000);
    for (center, color) in centers(&cloud).iter().zip(&cloud.splats().colors) {
        let expected = [0.5 * (center.x as f32 + 1.0) / 2.0, 0.5, 0.25];
        for (found, expected) in color.iter().zip(expected) {
            // A linear function's mean over what a surfel owns is its value at the centroid.
            assert!((found - expected).abs() < 1e-4, "{color:?} at {center}");
        }
    }
    assert_eq!(surface(&cloud).opacities, None);
}

#[test]
fn transparent_texels_lend_no_colour() {
    // Opaque red beside invisible green: the mean is red, half there.
    let texel = |x: usize, _: usize| if x.is_multiple_of(2) { [255, 0, 0, 255] } else { [0, 255, 0, 0] };
    let material = BaseColor { factor: Vec4::ONE, texture: texture([256, 256], Wrap::Repeat, texel) };
    let cloud = surfels(&square(material), 1000);
    let opacities = surface(&cloud).opacities.unwrap();
    for (color, opacity) in cloud.splats().colors.iter().zip(opacities) {
        assert!((color[0] - 1.0).abs() < 1e-4 && color[1].abs() < 1e-4, "{color:?}");
        assert!((opacity - 0.5).abs() < 1e-4, "{opacity}");
    }
}

#[test]
fn masks_are_compared_texel_by_texel_before_they_are_filtered() {
    // 8 texels a point: alphas of 0.4 and 0.8, of which the cut-offs let none, every other or all through.
    let texel = |x: usize, _: usize| if x.is_multiple_of(2) { [255, 0, 0, 204] } else { [0, 255, 0, 102] };
    let picture = texture([256, 256], Wrap::Repeat, texel);
    for (cutoff, factor, expected) in
        [(0.5, 1.0, 0.5), (0.3, 0.5, 0.5), (0.4, 1.0, 1.0), (0.3, 1.0, 1.0), (0.9, 1.0, 0.0), (0.5, 0.5, 0.0)]
    {
        let factor = Vec4::ONE.with_w(factor);
        let mut mesh = square(BaseColor { factor, texture: picture.clone() });
        mesh.primitives[0].alpha_cutoff = Some(cutoff);
        let cloud = surfels(&mesh, 1000);
        let opacities = surface(&cloud).opacities.unwrap_or_else(|| vec![1.0; cloud.len()]);
        for (color, opacity) in cloud.splats().colors.iter().zip(opacities) {
            assert!((opacity - expected).abs() < 1e-4, "{opacity} with {cutoff}, {factor}");
            let green = [0.0, 0.0, 0.5][(2.0 * expected) as usize];
            assert!((color[1] - green).abs() < 1e-4, "{color:?} with {cutoff}, {factor}");
        }
    }
}

#[test]
fn one_texture_with_two_masks() {
    let picture = texture([8, 8], Wrap::Clamp, |_, _| [255, 255, 255, 128]);
    let mut mesh = square(BaseColor { factor: Vec4::ONE, texture: picture });
    let mut above = mesh.primitives[0].clone();
    above.primitive_to_mesh = DAffine3::from_translation(glam::DVec3::Y);
    mesh.primitives.push(above);
    mesh.primitives[0].alpha_cutoff = Some(0.6);
    mesh.primitives[1].alpha_cutoff = Some(0.4);
    let cloud = surfels(&mesh, 200);
    for (center, opacity) in centers(&cloud).iter().zip(surface(&cloud).opacities.unwrap()) {
        assert_eq!(opacity, center.y.round() as f32, "{center}");
    }
}

#[test]
fn coarse_masks_keep_their_edges() {
    // Two texels, 50 surfels each: filtered as colours are, the edge would be as wide as one of them.
    let halves = texture([2, 1], Wrap::Clamp, |x, _| [255, 255, 255, if x == 0 { 255 } else { 0 }]);
    let mut mesh = square(BaseColor { factor: Vec4::ONE, texture: halves });
    mesh.primitives[0].alpha_cutoff = Some(0.5);
    let cloud = surfels(&mesh, 10_000);
    let opacities = surface(&cloud).opacities.unwrap();
    for (center, opacity) in centers(&cloud).iter().zip(&opacities) {
        if center.x.abs() > 0.04 {
            let expected = if center.x < 0.0 { 1.0 } else { 0.0 };
            assert!((opacity - expected).abs() < 1e-6, "{opacity} at {center}");
        }
    }
    // Half of the square is there, to a twentieth of a surfel along the edge of 100.
    let areas = surface(&cloud).areas;
    let shown: f32 = areas.iter().zip(&opacities).map(|(area, opacity)| area * opacity).sum();
    assert!((shown / 4.0 - 0.5).abs() < 5e-4, "{shown}");
}

#[test]
fn masks_compare_factor_times_vertex_colour() {
    let mut mesh = square(BaseColor { factor: Vec4::new(1.0, 0.5, 1.0, 0.8), texture: None });
    mesh.primitives[0].alpha_cutoff = Some(0.4);
    let alpha = |p: &glam::Vec3| Vec4::new(1.0, 1.0, 1.0, (1.0 - p.x) / 2.0);
    mesh.primitives[0].colors = Some(mesh.primitives[0].positions.iter().map(alpha).collect());
    let cloud = surfels(&mesh, 10_000);
    let opacities = surface(&cloud).opacities.unwrap();
    for ((center, color), opacity) in centers(&cloud).iter().zip(&cloud.splats().colors).zip(opacities) {
        // 0.8 · (1 − x) / 2 ≥ 0.4 where x ≤ 0; a surfel owns two spacings.
        if center.x.abs() > 0.04 {
            assert_eq!(opacity, if center.x < 0.0 { 1.0 } else { 0.0 }, "{center}");
        }
        let expected = if opacity > 0.0 { [1.0, 0.5, 1.0] } else { [0.0; 3] };
        // A quotient of rounded means.
        assert!(color.iter().zip(expected).all(|(c, e)| (c - e).abs() < 1e-6), "{color:?}");
    }
}

/// A texture of alpha ½ whose vertices have alpha from 0 on the left to 1 on the right: 0.3 of it is there from 0.6 on, in texels that are
/// larger than surfels and in ones that are smaller.
#[test]
fn masks_compare_factor_times_vertex_colour_times_texel() {
    for side in [4, 256] {
        let half = texture([side, side], Wrap::Clamp, |_, _| [255, 0, 0, 128]);
        let mut mesh = square(BaseColor { factor: Vec4::ONE, texture: half });
        mesh.primitives[0].alpha_cutoff = Some(0.3);
        let alpha = |p: &glam::Vec3| Vec4::ONE.with_w((p.x + 1.0) / 2.0);
        mesh.primitives[0].colors = Some(mesh.primitives[0].positions.iter().map(alpha).collect());
        let cloud = surfels(&mesh, 2500);
        let opacities = surface(&cloud).opacities.expect("some are not there");
        for (center, opacity) in centers(&cloud).iter().zip(&opacities) {
            let alpha = (center.x + 1.0) / 2.0;
            // Of smaller ones there are means for eight alphas from 0.3 to 1, of which the next counts.
            if (alpha - 0.3 * 255.0 / 128.0).abs() > if side == 4 { 0.04 } else { 0.09 } {
                assert!(
                    (opacity - if alpha > 0.6 { 1.0 } else { 0.0 }).abs() < 1e-6,
                    "{side}: {opacity} at {alpha}"
                );
            }
        }
        // With one alpha for all there is one mask.
        for (alpha, is_there) in [(0.59, false), (0.61, true)] {
            let colors = vec![Vec4::ONE.with_w(alpha); mesh.primitives[0].positions.len()];
            mesh.primitives[0].colors = Some(colors);
            let opacities = surface(&surfels(&mesh, 200)).opacities.unwrap_or_else(|| vec![1.0]);
            assert!(opacities.iter().all(|opacity| *opacity == f32::from(is_there)), "{side}: {alpha}");
        }
    }
}

/// Of two texels as wide as 50 surfels each surfel has one of the colours; smaller texels are averaged.
#[test]
fn nearest_texels_are_squares_of_one_colour() {
    let of = |size: [usize; 2], count: usize| {
        let board = texture(size, Wrap::Clamp, |x, y| grey(if (x + y).is_multiple_of(2) { 255 } else { 0 }));
        let board = board.map(|board| Arc::new(Texture { filter: Filter::Nearest, ..(*board).clone() }));
        surfels(&square(BaseColor { factor: Vec4::ONE, texture: board }), count)
    };
    let coarse = of([2, 1], 10_000);
    for (center, color) in centers(&coarse).iter().zip(&coarse.splats().colors) {
        if center.x.abs() > 0.04 {
            assert!(
                (color[0] - if center.x < 0.0 { 1.0 } else { 0.0 }).abs() < 1e-6,
                "{color:?} at {center}"
            );
        }
    }
    let fine = of([256, 256], 1000);
    assert!(fine.splats().colors.iter().all(|color| (color[0] - 0.5).abs() < 1e-4));
}

#[test]
fn what_is_unlit_shows_its_colours() {
    let mut mesh = square(BaseColor::default());
    assert_eq!(surfels(&mesh, 10).material(), Material::default());
    mesh.primitives[0].unlit = true;
    assert_eq!(surfels(&mesh, 10).material(), Material::UNLIT);
    mesh.primitives.push(primitives::plane(1));
    assert_eq!(surfels(&mesh, 10).material(), Material::default());
}

/// A white wall with a red sheet before or behind it that nothing is left of, or that a third shows of, nearer than surfels are wide.
#[test]
fn surfels_of_opaque_parts_stand_for_nothing_else() {
    let wall = BaseColor { factor: Vec4::ONE, texture: None };
    for (opacity, away) in [(0.0, 0.002), (0.0, -0.002), (0.3, -0.002)] {
        let red = BaseColor { factor: Vec4::new(1.0, 0.0, 0.0, opacity), texture: None };
        let mut mesh = square(wall.clone());
        mesh.primitives.push(Primitive {
            material: red,
            primitive_to_mesh: DAffine3::from_scale_rotation_translation(
                DVec3::splat(0.5),
                DQuat::IDENTITY,
                DVec3::Y * away,
            ),
            ..primitives::plane(1)
        });
        let cloud = surfels(&mesh, 5000);
        let opacities = surface(&cloud).opacities.expect("some are clear");
        for (color, found) in cloud.splats().colors.iter().zip(&opacities) {
            let is_wall = *color == [1.0; 3] && *found == 1.0;
            let is_sheet = (found - opacity).abs() < 1e-6;
            assert!(is_wall || is_sheet, "{color:?}, {found}");
        }
        let pose = Pose::look_at(DVec3::Y * 5.0, DVec3::ZERO, DVec3::Z).unwrap();
        let camera = Camera::orthographic(pose, 3.0, [48; 2]).unwrap();
        let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
        let settings = RenderSettings { shade: false, ..RenderSettings::default() };
        let frame = render(&scene, &camera, &settings, &()).unwrap();
        for (pixel, color) in frame.color.iter().enumerate() {
            let [x, y] = [pixel % 48, pixel / 48].map(|at| (at as f32 + 0.5 - 24.0) / 16.0);
            let from_middle = x.abs().max(y.abs());
            if from_middle < 0.9 {
                // Where the sheet ends, as much of it as a single sheet may cover too much, 7 %, counts beside the wall.
                let least = if (from_middle - 0.5).abs() < 0.1 { 0.93 } else { 0.999 };
                assert!(color[3] > least, "{opacity} at {away}: {color:?} at {x}, {y}");
                assert!(opacity > 0.0 || color[1] > least, "{opacity} at {away}: {color:?} at {x}, {y}");
            }
        }
    }
}
