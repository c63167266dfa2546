//! A volume, an iso-surface in it and a mesh through both, from a program:
//!
//!     cargo run --release --example mixed_scene

use oblate::engine::color::linear_to_srgb;
use oblate::engine::{Camera, Pose, RenderSettings, Scene, render};
use oblate::surfels::{Density, Mesh, SamplerSettings, primitives, sample, view_spacing};
use oblate::volumes::{IsoSettings, KernelSettings, TransferFunction, iso_surfels, shepp_logan, to_kernels};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    // What there is: a head phantom in the cube from −1 to 1, and a knot around it.
    // `oblate::importers::open` reads volumes and meshes from files.
    let head = shepp_logan(96)?;
    let knot = Mesh { primitives: vec![primitives::torus_knot(2, 3, 0.15, [400, 40])] };

    // From where it is seen: z is up, 30° from top to bottom, 600×600 pixels.
    let size = [600, 600];
    let pose = Pose::look_at([3.5, -4.5, 2.5].into(), [0.0; 3].into(), [0.0, 0.0, 1.0].into())?;
    let camera = Camera::perspective(pose, 30f64.to_radians(), size)?;

    // The inside of the head as kernels: nothing below 0.1, a red brain, a white skull.
    let look: TransferFunction = "transfer 1\nstrength extinction\ncolor srgb\n\
                                  0.1 0.8 0.2 0.1 0\n 0.25 0.9 0.3 0.2 0.9\n 1.0 1.0 0.95 0.85 2.5"
        .parse()?;
    let inside = to_kernels(&head, &look, &KernelSettings::default())?;

    // The skull's surface, and surfels on the knot: one a pixel.
    let skull = iso_surfels(&head, 0.6, &IsoSettings { opacity: 0.3, ..IsoSettings::default() })?;
    let spacing = view_spacing(&camera, knot.bounds().ok_or("the knot is empty")?);
    let knot = sample(&knot, Density::Spacing(spacing), &SamplerSettings::default())?;

    // All in one picture, before dark grey. Without lights there is a headlight.
    let scene = Scene { clouds: vec![inside, skull, knot], lights: Vec::new() };
    let settings = RenderSettings { background: [0.02, 0.02, 0.02, 1.0], ..RenderSettings::default() };
    let frame = render(&scene, &camera, &settings, &())?;

    // Linear light to sRGB bytes; the background is opaque, so nothing is premultiplied.
    let byte = |c: f32| (linear_to_srgb(c).clamp(0.0, 1.0) * 255.0).round() as u8;
    let bytes: Vec<u8> = frame.color.iter().flat_map(|[r, g, b, _]| [byte(*r), byte(*g), byte(*b)]).collect();
    image::save_buffer("mixed_scene.png", &bytes, size[0], size[1], image::ColorType::Rgb8)?;
    println!("wrote mixed_scene.png");
    Ok(())
}
