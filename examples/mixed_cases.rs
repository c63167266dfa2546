//! What other engines draw apart, mixed in one order: `cargo run --release --example mixed_cases`
//!
//! Surfaces through fog, glass between splats, a surface inside its volume; volumes in each other, splats in a
//! volume, the camera in one: each a scene of clouds, and the order of compositing is the default one.

use glam::{DAffine3, DQuat, DVec3, Vec3, Vec4};
use oblate::engine::cloud::{Cloud, Material, OpacityFilter, Shapes, Splats, Strength, oblate_factor};
use oblate::engine::color::linear_to_srgb;
use oblate::engine::{Camera, Light, Pose, RenderSettings, Scene, render};
use oblate::surfels::{BaseColor, Density, Mesh, Primitive, SamplerSettings, primitives, sample};
use oblate::volumes::{GridFrame, IsoSettings, KernelSettings, Volume, Voxels, iso_surfels, to_kernels};
use std::error::Error;
use std::f32::consts::{PI, TAU};

const SIDE: usize = 320;
const GAP: usize = 4;

type Panel = Result<(Vec<Cloud>, Camera), Box<dyn Error>>;

fn main() -> Result<(), Box<dyn Error>> {
    let above = [mesh_in_fog, glass_between_splats, surface_in_its_volume];
    let below = [two_volumes, splats_in_a_volume, inside_a_volume];
    let [width, height] = [3, 2].map(|n| n * (SIDE + GAP) - GAP);
    let mut sheet = image::RgbImage::from_pixel(width as u32, height as u32, image::Rgb([255; 3]));
    for (i, panel) in above.into_iter().chain(below).enumerate() {
        let (clouds, camera) = panel()?;
        let lights = vec![
            Light::Ambient { color: [0.7, 0.75, 0.85] },
            Light::Directional { towards: DVec3::new(-0.7, 1.2, 1.0), color: [1.3, 1.2, 1.05] },
        ];
        let settings = RenderSettings { background: [0.012, 0.015, 0.022, 1.0], ..Default::default() };
        let frame = render(&Scene { clouds, lights }, &camera, &settings, &())?;
        let [left, top] = [i % 3, i / 3].map(|n| n * (SIDE + GAP));
        for (at, color) in frame.color.iter().enumerate() {
            // Linear light to sRGB bytes; the background is opaque, so nothing is premultiplied.
            let byte = |c: f32| (linear_to_srgb(c).clamp(0.0, 1.0) * 255.0).round() as u8;
            let pixel = image::Rgb([byte(color[0]), byte(color[1]), byte(color[2])]);
            sheet.put_pixel((left + at % SIDE) as u32, (top + at / SIDE) as u32, pixel);
        }
    }
    Ok(sheet.save("mixed_cases.png")?)
}

/// An opaque knot, up to its middle in fog.
fn mesh_in_fog() -> Panel {
    let knot = primitives::torus_knot(2, 3, 0.17, [600, 48]);
    let knot = mesh(knot, [0.85, 0.2, 0.04, 1.0], DAffine3::from_rotation_x(1.2))?;
    let fog = volume(2.0, |p| {
        let rim = (p.x.hypot(p.z) - 1.2).max(0.0);
        (0.2 - p.y).min(0.7) + 0.06 * billows(5.0 * p) - 1.5 * rim * rim
    });
    let look = "0 0.6 0.68 0.78 0\n 0.8 0.75 0.82 0.9 3.2";
    Ok((vec![knot, haze(&fog, look)?], camera([0.0, 1.5, 5.2], 34.0)?))
}

/// A pane through a coil of splats: half of each turn lies behind it.
fn glass_between_splats() -> Panel {
    let coil = (0..420).map(|i| {
        let t = i as f32 / 420.0;
        let (sin, cos) = (t * 5.0 * TAU).sin_cos();
        let along = Vec3::new(0.12, -sin, cos).normalize();
        (Vec3::new(2.2 * t - 1.1, 0.75 * cos, 0.75 * sin), along, rainbow(t))
    });
    let pane = mesh(primitives::plane(1), [0.35, 0.6, 0.65, 0.55], DAffine3::from_rotation_x(1.45))?;
    Ok((vec![pane, splats(coil, [0.075, 0.035])?], camera([2.2, 1.2, 4.3], 32.0)?))
}

/// The core of a cloud of four balls as a surface, its outer parts as glass.
fn surface_in_its_volume() -> Panel {
    let balls =
        [[0.5, 0.2, 0.1, 0.5], [-0.45, 0.35, 0.2, 0.45], [-0.1, -0.5, 0.0, 0.5], [0.1, 0.3, -0.5, 0.4]];
    let field = volume(1.4, |p| {
        balls.iter().map(|[x, y, z, r]| (-(p - Vec3::new(*x, *y, *z)).length_squared() / (r * r)).exp()).sum()
    });
    let look = "0.12 0.1 0.45 0.6 0\n 0.25 0.3 0.75 0.8 1.6\n 0.5 0.3 0.7 0.7 0.3";
    let core = IsoSettings { color: [0.95, 0.2, 0.02], ..Default::default() };
    Ok((vec![haze(&field, look)?, iso_surfels(&field, 0.7, &core)?], camera([1.5, 1.6, 4.2], 32.0)?))
}

/// Two volumes in the same place; where both are, their colours mix.
fn two_volumes() -> Panel {
    let ball = volume(1.1, |p| 1.0 - p.length());
    let cloud = |color: &str, x: f64| -> Result<Cloud, Box<dyn Error>> {
        let look = format!("0 {color} 0\n 0.25 {color} 1.4\n 1 {color} 3");
        Ok(haze(&ball, &look)?.transformed(DAffine3::from_translation(DVec3::new(x, 0.25 * x, -0.6 * x))))
    };
    Ok((vec![cloud("0.1 0.45 0.95", -0.5)?, cloud("0.98 0.6 0.1", 0.5)?], camera([0.0, 0.8, 5.2], 32.0)?))
}

/// A spiral of splats in a ball of glass.
fn splats_in_a_volume() -> Panel {
    let spiral = (0..6000).map(|i| {
        let t = (i as f32 + 0.5) / 6000.0;
        // From −1 to 1, most of it near 0.
        let scatter = |k: f32| (i as f32 * k).fract() + (i as f32 * (k + 0.123)).fract() - 1.0;
        let angle = 7.0 * t.sqrt() + (i % 2) as f32 * PI + 1.2 * scatter(0.618);
        let (sin, cos) = angle.sin_cos();
        let place = Vec3::new(cos, 0.3 * scatter(0.414) * (1.1 - t), sin) * (0.9 * t);
        (place, Vec3::new(-sin, 0.0, cos), rainbow(0.06 + 0.62 * t))
    });
    let ball = volume(1.1, |p| 1.0 - p.length());
    let look = "0 0.5 0.7 0.9 0\n 0.03 0.6 0.8 1 1.6\n 0.08 0.5 0.7 0.9 0.1\n 1 0.4 0.5 0.8 0.1";
    Ok((vec![splats(spiral, [0.02, 0.009])?, haze(&ball, look)?], camera([0.0, 2.4, 3.9], 29.0)?))
}

/// Dusk all around the camera, and balls that recede into it.
fn inside_a_volume() -> Panel {
    let dusk = volume(2.2, |p| p.y + 0.2 * billows(3.0 * p));
    let look = "-2 0.98 0.55 0.25 1.4\n -0.4 0.9 0.5 0.45 0.9\n 0.6 0.45 0.4 0.6 0.4\n 2 0.15 0.2 0.5 0.7";
    let mut clouds = vec![haze(&dusk, look)?];
    for i in 0..9 {
        let t = f64::from(i) / 9.0;
        let place = DVec3::new(0.55 * (7.0 * t).sin(), 0.5 * (7.0 * t).cos(), 1.0 - 2.8 * t);
        let to_world = DAffine3::from_scale_rotation_translation(DVec3::splat(0.17), DQuat::IDENTITY, place);
        let [r, g, b] = rainbow(0.9 * t as f32);
        clouds.push(mesh(primitives::sphere(48), [r, g, b, 1.0], to_world)?);
    }
    Ok((clouds, camera([0.0, 0.1, 2.1], 62.0)?))
}

/// From −3 to 3, in waves.
fn billows(p: Vec3) -> f32 {
    (p.x + p.y).sin() + (0.8 * p.z - p.x + 1.0).sin() + (1.3 * p.x + p.z - 0.7 * p.y).sin()
}

/// Looks at the origin with y up.
fn camera(eye: [f64; 3], degrees: f64) -> Result<Camera, Box<dyn Error>> {
    let pose = Pose::look_at(eye.into(), DVec3::ZERO, DVec3::Y)?;
    Ok(Camera::perspective(pose, degrees.to_radians(), [SIDE as u32; 2])?)
}

/// 72³ values of a function in a cube around the origin.
fn volume(half: f64, value: impl Fn(Vec3) -> f32) -> Volume {
    let step = 2.0 * half / 71.0;
    let at = |i: usize| {
        value(Vec3::from([i % 72, i / 72 % 72, i / 5184].map(|n| (n as f64 * step - half) as f32)))
    };
    let frame = GridFrame { spacing: DVec3::splat(step), origin: DVec3::splat(-half), ..Default::default() };
    Volume::new([72; 3], Voxels::F32((0..72 * 72 * 72).map(at).collect()), frame).expect("72 cubed values")
}

/// A volume's inside under a transfer function: value, red, green, blue, extinction.
fn haze(volume: &Volume, look: &str) -> Result<Cloud, Box<dyn Error>> {
    let look = format!("transfer 1\nstrength extinction\ncolor srgb\n{look}").parse()?;
    Ok(to_kernels(volume, &look, &KernelSettings::default())?)
}

/// Surfels on a shape, denser than the pixels; with an alpha below 1 it is a pane of one layer.
fn mesh(mut shape: Primitive, rgba: [f32; 4], to_world: DAffine3) -> Result<Cloud, Box<dyn Error>> {
    shape.material = BaseColor { factor: Vec4::from(rgba), texture: None };
    shape.primitive_to_mesh = to_world;
    Ok(sample(&Mesh { primitives: vec![shape] }, Density::Spacing(0.007), &SamplerSettings::default())?)
}

/// Splats as trained scenes have them: places, directions, colours; σ along and across the direction.
fn splats(
    items: impl Iterator<Item = (Vec3, Vec3, [f32; 3])>,
    [along, across]: [f32; 2],
) -> Result<Cloud, Box<dyn Error>> {
    let (mut centers, mut factors, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for (center, direction, color) in items {
        centers.push(center);
        factors.push(oblate_factor(direction, across, across / along));
        colors.push(color);
    }
    let strength = Strength::Opacity {
        peaks: vec![0.85; centers.len()],
        filter: OpacityFilter::Compensated,
        least: 0.0,
    };
    let (shapes, material) = (Shapes::Each(factors), Material::UNLIT);
    Ok(Cloud::new(Splats { centers, shapes, strength, colors, harmonics: None, normals: None, material })?)
}

/// Linear colours from red over yellow to blue and violet.
fn rainbow(turn: f32) -> [f32; 3] {
    [0.0, 0.33, 0.67].map(|shift| (0.5 + 0.5 * ((turn - shift) * TAU).cos()).powi(2))
}
