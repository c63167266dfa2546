//! What lies beside a part of a picture is left out, and nothing else.

#![expect(clippy::unwrap_used, reason = "what is not there fails the test")]

use glam::{DVec3, Mat3, Quat, Vec3};
use oblate_engine::{
    Camera, Channels, Closed, Cloud, FootprintForm, Material, Order, Pose, RenderSettings, Scene, Shapes,
    Splats, Strength, Surface, render,
};

const SIZE: [u32; 2] = [96, 64];
const PART: u32 = 8;
const COUNT: usize = 900;

/// Numbers from 0 to 1 in an order without a pattern.
fn numbers() -> impl FnMut() -> f32 {
    let mut state = 1_u32;
    move || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 8) as f32 / (1 << 24) as f32
    }
}

/// Needles, or surfels, in a cube with a middle and a side: in no order, so that all blocks of eight are as large as it.
fn scattered(is_surface: bool, middle: Vec3, side: f32) -> Cloud {
    let mut next = numbers();
    let mut vector = |scale: f32| Vec3::from_array([(); 3].map(|()| scale * (next() - 0.5)));
    let centers: Vec<Vec3> = (0..COUNT).map(|_| vector(side) + middle).collect();
    let shape = |turn: Vec3| {
        let thin = if is_surface { 0.0 } else { 0.02 };
        let axes = Vec3::new(0.3, if is_surface { 0.1 } else { 0.02 }, thin);
        Mat3::from_quat(Quat::from_scaled_axis(6.0 * turn)) * Mat3::from_diagonal(axes)
    };
    let factors = (0..COUNT).map(|_| shape(vector(1.0))).collect();
    let strength = if is_surface {
        let areas = vec![0.2; COUNT];
        let surface = Surface {
            areas,
            opacities: None,
            depth_tolerance: 0.1,
            coverage_floor: 0.9,
            closed: Closed::Nowhere,
        };
        Strength::Surface(surface)
    } else {
        Strength::Extinction { masses: vec![4e-3; COUNT] }
    };
    Cloud::new(Splats {
        centers,
        shapes: Shapes::Each(factors),
        strength,
        colors: (0..COUNT).map(|_| (vector(1.0) + 0.5).to_array()).collect(),
        harmonics: None,
        normals: None,
        material: Material::default(),
    })
    .unwrap()
}

/// Parts of a picture are what the whole is there, in every form and at wide angles, where affine footprints are far larger than
/// what they are of. Means differ by the rounding of numbers up to 100 pixels, so that a pixel at an end may be off by what ends there:
/// e^{−12.25/2} = 2.2e-3 of an opacity of up to ½ or, of a surface, of a coverage of up to 1 over a floor of 0.9.
#[test]
fn a_part_is_what_the_whole_is_there() {
    let pose = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y).unwrap();
    let cameras = [
        Camera::perspective(pose, 110f64.to_radians(), SIZE).unwrap(),
        Camera::orthographic(pose, 6.0, SIZE).unwrap(),
    ];
    // A cube whose sphere reaches behind the eye, of which nothing is left out at wide angles, and some before it, from beside
    // the picture to its middle.
    let around = |is_surface| vec![scattered(is_surface, Vec3::new(0.0, 0.0, -4.5), 8.0)];
    let before = |is_surface| {
        let middles = [-7.5, -4.5, -1.5, 1.5].map(|x| Vec3::new(x, 0.5, -4.0));
        middles.map(|middle| scattered(is_surface, middle, 3.0)).into()
    };
    let kinds = [(around(false), false), (around(true), true), (before(false), false), (before(true), true)];
    let scenes = kinds.map(|(clouds, is_surface)| (Scene { clouds, lights: Vec::new() }, is_surface));
    // Where shells end doesn't go by what else is seen.
    let forms = [FootprintForm::Auto, FootprintForm::Point, FootprintForm::Affine, FootprintForm::Exact];
    let in_shells = (FootprintForm::Auto, Order::Shells { thickness: 1.0 });
    for (camera, (scene, is_surface)) in
        cameras.iter().flat_map(|camera| scenes.each_ref().map(|s| (camera, s)))
    {
        for (footprint, order) in forms.map(|form| (form, Order::Centers)).into_iter().chain([in_shells]) {
            let settings = RenderSettings {
                footprint,
                order,
                shade: false,
                channels: Channels::Color,
                ..RenderSettings::default()
            };
            let whole = render(scene, camera, &settings, &()).unwrap();
            let shown = whole.color.iter().filter(|pixel| pixel[3] > 0.01).count();
            assert!(shown > 1000, "{shown} pixels show anything");
            for corner in (0..SIZE[0] * SIZE[1] / (PART * PART)).map(|i| [i % 12 * PART, i / 12 * PART]) {
                let part = camera.part(corner.map(|c| c as i32), [PART; 2]).unwrap();
                let part = render(scene, &part, &settings, &()).unwrap();
                for (place, found) in part.color.iter().enumerate() {
                    let [x, y] = [corner[0] as usize + place % 8, corner[1] as usize + place / 8];
                    let expected = whole.color[y * SIZE[0] as usize + x];
                    let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                    let most = if *is_surface { 2.5e-3 } else { 1.1e-3 };
                    assert!(off <= most, "{footprint:?}, surface {is_surface}: {off} at {x}, {y}");
                }
            }
        }
    }
}
