//! A volume, an iso-surface in it and a mesh through both: `cargo run --release --example mixed_scene`

use oblate::engine::color::linear_to_srgb;
use oblate::engine::{Camera, Pose, RenderSettings, Scene, render};
use oblate::surfels::{Density, Mesh, SamplerSettings, primitives, sample, view_spacing};
use oblate::volumes::{IsoSettings, KernelSettings, TransferFunction, iso_surfels, shepp_logan, to_kernels};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // What there is: a head phantom of 96³ values and a knot around it, both about the origin.
    // `oblate::importers::open` reads volumes and meshes from files.
    let head = shepp_logan(96)?;
    let knot = Mesh { primitives: vec![primitives::torus_knot(2, 3, 0.15, [400, 40])] };

    // From where it is seen: z is up, 30° from top to bottom, 600×600 pixels.
    let pose = Pose::look_at([3.5, -4.5, 2.5].into(), [0.0; 3].into(), [0.0, 0.0, 1.0].into())?;
    let camera = Camera::perspective(pose, 30f64.to_radians(), [600, 600])?;

    // Its skull as blue glass: value, red, green, blue, extinction per unit length.
    let glass: TransferFunction =
        "transfer 1\nstrength extinction\ncolor srgb\n 0.4 0.2 0.4 0.9 0\n 1 0.5 0.7 1 3".parse()?;
    let skull = to_kernels(&head, &glass, &KernelSettings::default())?;
    // The surfaces in its brain in orange, and surfels on the knot: one a pixel.
    let organs = iso_surfels(&head, 0.25, &IsoSettings { color: [0.9, 0.3, 0.05], ..Default::default() })?;
    let spacing = view_spacing(&camera, knot.bounds().ok_or("the knot is empty")?);
    let knot = sample(&knot, Density::Spacing(spacing), &SamplerSettings::default())?;

    // All in one picture, before black. Without lights there is a headlight.
    let scene = Scene { clouds: vec![skull, organs, knot], lights: Vec::new() };
    let settings = RenderSettings { background: [0.0, 0.0, 0.0, 1.0], ..Default::default() };
    let frame = render(&scene, &camera, &settings, &())?;

    // Linear light to sRGB bytes; the background is opaque, so nothing is premultiplied.
    let byte = |c: &f32| (linear_to_srgb(*c).clamp(0.0, 1.0) * 255.0).round() as u8;
    let bytes: Vec<u8> = frame.color.iter().flat_map(|color| color[..3].iter().map(byte)).collect();
    Ok(image::save_buffer("mixed_scene.png", &bytes, 600, 600, image::ColorType::Rgb8)?)
}
