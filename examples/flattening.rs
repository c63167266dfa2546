//! The dial from kernels to surfels, as an animated PNG: `cargo run --release --example flattening`
//!
//! A semi-transparent head, in which the samples at the skull's surface are pressed flat, ever more and back again. One formula
//! draws every frame; nothing steps between 1 (kernels) and infinity (surfels).

use oblate::engine::color::linear_to_srgb;
use oblate::engine::{Camera, Pose, RenderSettings, Renderer, Scene};
use oblate::volumes::{Classifier, Flattening, KernelSettings, shepp_logan};

const SIZE: u32 = 320;
const FRAMES: u32 = 24;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let head = shepp_logan(96)?;
    // Values from 0 (outside) to 1 (the skull); extinction per unit of length, of which the head is two.
    let look = "transfer 1\nstrength extinction\ncolor srgb\n 0.1 0.2 0.4 0.6 0\n 0.3 0.5 0.6 0.7 0.5\n 0.6 0.9 0.8 0.7 6"
        .parse()?;
    let pose = Pose::look_at([2.2, -3.2, 1.6].into(), [0.0; 3].into(), [0.0, 0.0, 1.0].into())?;
    let camera = Camera::perspective(pose, 33_f64.to_radians(), [SIZE; 2])?;
    let settings = RenderSettings { background: [0.0, 0.0, 0.0, 1.0], ..RenderSettings::default() };
    let mut renderer = Renderer::new();

    let file = std::io::BufWriter::new(std::fs::File::create("flattening.png")?);
    let mut encoder = png::Encoder::new(file, SIZE, SIZE);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_animated(FRAMES, 0)?;
    encoder.set_frame_delay(1, 20)?;
    let mut writer = encoder.write_header()?;
    for number in 0..FRAMES {
        // The thickness, 1 / ratio, goes from 1 to 0 and back.
        let turn = f64::from(number) / f64::from(FRAMES) * std::f64::consts::TAU;
        let ratio = (2.0 / (1.0 + turn.cos())) as f32;
        let flattening = Flattening { value: 0.6, least_gradient: 0.0, ratio };
        let kernels = KernelSettings { flattening: Some(flattening), ..KernelSettings::default() };
        let cloud = Classifier::new(&head, kernels).classify(&look)?;
        let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
        let frame = renderer.render(&scene, &camera, &settings, &())?;
        let byte = |c: &f32| (linear_to_srgb(*c).clamp(0.0, 1.0) * 255.0).round() as u8;
        let bytes: Vec<u8> = frame.color.iter().flat_map(|color| color[..3].iter().map(byte)).collect();
        writer.write_image_data(&bytes)?;
    }
    Ok(writer.finish()?)
}
