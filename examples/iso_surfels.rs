//! From a volume to surfels to a picture: `cargo run --release --example iso_surfels [VOLUME ISO]`

use oblate::engine::color::linear_to_srgb;
use oblate::engine::{Camera, Pose, RenderSettings, Scene, render};
use oblate::importers::{Content, OpenOptions, open};
use oblate::surfels::{Deviation, merge_flat};
use oblate::volumes::{Interpolation, IsoExtractor, IsoSettings, Volume, marschner_lobb};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A file's volume and a value, or the test signal of Marschner and Lobb, 1994, as a surface of ripples.
    let mut args = std::env::args().skip(1);
    let (volume, iso) = match (args.next(), args.next()) {
        (Some(path), Some(iso)) => {
            match open(std::path::Path::new(&path), &OpenOptions::default())?.content {
                Content::Volume(volume) => (volume, iso.parse()?),
                _ => return Err(format!("{path} is no volume").into()),
            }
        }
        _ => (marschner_lobb(100)?, 0.5),
    };

    // The extractor looks through the volume once; each value is quick from then on. `extract_into` keeps the memory, too.
    let extractor = IsoExtractor::new(&volume);
    let surfels = extractor.extract(iso, Interpolation::Trilinear)?;
    let kind = if surfels.is_closed() { "closed" } else { "open" };
    println!("{} surfels, area {:.1}, {kind}", surfels.len(), surfels.area());
    for surfel in surfels.iter().take(2) {
        println!("  at {:.2}, normal {:.3}, area {:.5}", surfel.center, surfel.normal(), surfel.area);
    }

    // As a cloud to be drawn, and with one surfel where several are within a quarter of a step and 10° of it.
    let settings = IsoSettings { color: [0.35, 0.55, 0.7], ..IsoSettings::default() };
    let cloud = surfels.cloud(&settings)?;
    let step = volume.frame().spacing.min_element();
    let bounds = Deviation { distance: 0.25 * step, angle: 10_f64.to_radians(), color: 0.0 };
    let merged = merge_flat(&cloud, bounds)?;
    println!("merged into {}, at most {:.1}° off", merged.cloud.len(), merged.largest.angle.to_degrees());

    let scene = Scene { clouds: vec![merged.cloud], lights: Vec::new() };
    let settings = RenderSettings { background: [0.0, 0.0, 0.0, 1.0], ..RenderSettings::default() };
    let frame = render(&scene, &camera(&volume)?, &settings, &())?;
    let byte = |c: &f32| (linear_to_srgb(*c).clamp(0.0, 1.0) * 255.0).round() as u8;
    let bytes: Vec<u8> = frame.color.iter().flat_map(|color| color[..3].iter().map(byte)).collect();
    Ok(image::save_buffer("iso_surfels.png", &bytes, 600, 600, image::ColorType::Rgb8)?)
}

/// From above and aside, so that the whole grid is in the picture.
fn camera(volume: &Volume) -> Result<Camera, Box<dyn std::error::Error>> {
    let to_world = volume.index_to_world();
    let [low, high] = [[0; 3], volume.dims().map(|d| d - 1)]
        .map(|corner| to_world.transform_point3(corner.map(|i| i as f64).into()));
    let (middle, radius) = ((low + high) / 2.0, (high - low).length() / 2.0);
    let eye = middle + glam::DVec3::new(0.5, -0.6, 0.62).normalize() * radius / 15_f64.to_radians().sin();
    let pose = Pose::look_at(eye, middle, glam::DVec3::Z)?;
    Ok(Camera::perspective(pose, 30_f64.to_radians(), [600, 600])?)
}
