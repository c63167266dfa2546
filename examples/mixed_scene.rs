//! A volume, an iso-surface in it and a mesh through both: `cargo run --release --example mixed_scene`

use oblate::engine::color::linear_to_srgb;
use oblate::engine::{Camera, Pose, RenderSettings, Scene, render};
use oblate::surfels::{Mesh, SamplerSettings, primitives, sample_seen};
use oblate::volumes::{GridFrame, IsoSettings, KernelSettings, Volume, Voxels, iso_surfels, to_kernels};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // What there is: 64³ values that fall from the middle of a cube, from −1 to 1, and a knot around it.
    // `oblate::importers::open` reads volumes and meshes from files.
    let value = |i: usize| {
        let [x, y, z] = [i % 64, i / 64 % 64, i / 4096].map(|n| (n as f32 - 31.5) / 32.0);
        1.0 - (x * x + y * y + 2.0 * z * z).sqrt()
    };
    let voxels = Voxels::F32((0..64 * 64 * 64).map(value).collect());
    let [spacing, origin] = [1.0 / 32.0, -31.5 / 32.0].map(glam::DVec3::splat);
    let cloud = Volume::new([64; 3], voxels, GridFrame { spacing, origin, ..Default::default() })?;
    let knot = Mesh { primitives: vec![primitives::torus_knot(2, 3, 0.15, [400, 40])] };

    // From where it is seen: z is up, 30° from top to bottom, 600×600 pixels.
    let pose = Pose::look_at([3.5, -4.5, 2.5].into(), [0.0; 3].into(), [0.0, 0.0, 1.0].into())?;
    let camera = Camera::perspective(pose, 30f64.to_radians(), [600, 600])?;

    // Its outer parts as haze: value, red, green, blue, extinction per unit length.
    let look = "transfer 1\nstrength extinction\ncolor srgb\n 0 0.2 0.4 0.9 0\n 0.4 0.5 0.7 1 3".parse()?;
    let haze = to_kernels(&cloud, &look, &KernelSettings::default())?;
    // The surface of its core in orange, and surfels on what is seen of the knot, one a pixel: clouds by their depth.
    let core = iso_surfels(&cloud, 0.5, &IsoSettings { color: [0.9, 0.3, 0.05], ..Default::default() })?;
    let knot = sample_seen(&knot, &camera, &SamplerSettings::default())?;

    // All in one picture, before black. Without lights there is a headlight.
    let scene = Scene { clouds: [vec![haze, core], knot].concat(), lights: Vec::new() };
    let settings = RenderSettings { background: [0.0, 0.0, 0.0, 1.0], ..Default::default() };
    let frame = render(&scene, &camera, &settings, &())?;

    // Linear light to sRGB bytes; the background is opaque, so nothing is premultiplied.
    let byte = |c: &f32| (linear_to_srgb(*c).clamp(0.0, 1.0) * 255.0).round() as u8;
    let bytes: Vec<u8> = frame.color.iter().flat_map(|color| color[..3].iter().map(byte)).collect();
    Ok(image::save_buffer("mixed_scene.png", &bytes, 600, 600, image::ColorType::Rgb8)?)
}
