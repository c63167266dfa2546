//! A photograph with depths from elsewhere: draws `depth_warp.png`, six panels of a room, beside what other methods make of it, with numbers.
//!
//! ```sh
//! cargo run --release --example depth_warp [FOLDER]
//! ```
//!
//! The room is made by the program. To warp a photograph of your own, read it with `oblate::importers::depth`, or use `oblate warp`.

use oblate::chart::baselines;
use oblate::engine::color::linear_to_srgb;
use oblate::engine::{Blend, Frame, RenderSettings, Renderer, Scene};
use oblate::surfels::{DEPTH_LOW_PASS, DepthSettings, RgbdImage, Room, depth_surfels, fill_disocclusions};
use std::path::PathBuf;
use std::time::Instant;

const WIDTH: u32 = 640;
const HEIGHT: usize = 480;

/// A picture in display levels from 0 to 1, and its alpha.
type Shown = Vec<[f32; 4]>;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| ".".into()));
    std::fs::create_dir_all(&folder)?;
    let (camera, elsewhere) = (Room.camera(WIDTH)?, Room.other_camera(WIDTH)?);
    let image: RgbdImage = Room.image(&camera);
    let truth: Shown =
        Room.picture(&elsewhere, 8).iter().map(|[r, g, b]| encode([*r, *g, *b, 1.0])).collect();

    // Photographs are resampled as they are stored, unlit, with the filter that their pixels leave to be added.
    let settings = RenderSettings {
        low_pass: DEPTH_LOW_PASS,
        blend: Blend::Display,
        shade: false,
        ..RenderSettings::default()
    };
    let mut renderer = Renderer::new();
    let (mut frame, mut times) = (Frame::default(), Vec::new());
    for _ in 0..6 {
        let begun = Instant::now();
        let cloud = depth_surfels(&image, &DepthSettings::default())?;
        let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
        frame = renderer.render(&scene, &elsewhere, &settings, &())?.clone();
        times.push(begun.elapsed());
    }
    times.sort();
    let warped = show(&frame);
    fill_disocclusions(&mut frame);
    let filled = show(&frame);

    let stored = RgbdImage {
        colors: image.colors.iter().map(|color| color.map(linear_to_srgb)).collect(),
        ..image.clone()
    };
    let others = [
        ("softmax splatting", baselines::softmax(&stored, &elsewhere)?.color),
        ("3×3 writes", baselines::nearest(&stored, &elsewhere, 3)?.color),
        ("nearest writes", baselines::nearest(&stored, &elsewhere, 1)?.color),
        ("McMillan's order", baselines::mcmillan(&stored, &elsewhere)?.color),
        ("triangles", baselines::triangles(&stored, &elsewhere, 0.05)?.color),
        ("texels 3×3", baselines::supersampled(&stored, &elsewhere, 3)?.color),
    ];

    println!("| | whole picture, dB | what it shows, dB | transparent pixels |\n|---|---|---|---|");
    let ours = [("oblate", &warped), ("oblate, filled", &filled)];
    for (name, picture) in ours.into_iter().chain(others.iter().map(|(name, picture)| (*name, picture))) {
        let open = picture.iter().filter(|pixel| pixel[3] < 0.5).count();
        let [whole, shown] = [false, true].map(|only_shown| psnr(picture, &truth, &warped, only_shown));
        println!("| {name} | {whole:.2} | {shown:.2} | {open} |");
    }
    println!(
        "\nsurfels and picture: {:.1} ms, the median of {}",
        times[times.len() / 2].as_secs_f64() * 1e3,
        times.len()
    );

    let source: Shown = image.colors.iter().map(|[r, g, b]| encode([*r, *g, *b, 1.0])).collect();
    let panels = [&source, &warped, &filled, &others[2].1, &others[0].1, &truth];
    let path = folder.join("depth_warp.png");
    sheet(panels).save(&path)?;
    println!(
        "wrote {}: the photograph, warped, filled; nearest writes, softmax splatting, what is really there",
        path.display()
    );
    Ok(())
}

fn encode([r, g, b, a]: [f32; 4]) -> [f32; 4] {
    [linear_to_srgb(r), linear_to_srgb(g), linear_to_srgb(b), a]
}

fn show(frame: &Frame) -> Shown {
    frame.color.iter().map(|pixel| encode(*pixel)).collect()
}

/// Over all pixels, or over those that the warped picture covers; what is transparent counts as black.
fn psnr(picture: &Shown, truth: &Shown, covered: &Shown, only_covered: bool) -> f64 {
    let counted =
        picture.iter().zip(truth).zip(covered).filter(|(_, covered)| !only_covered || covered[3] > 0.98);
    let (mut squares, mut count) = (0.0, 0.0);
    for ((pixel, truth), _) in counted {
        squares += (0..3).map(|i| f64::from(pixel[i] - truth[i]).powi(2)).sum::<f64>();
        count += 3.0;
    }
    10.0 * f64::log10(count / squares)
}

/// Panels of half the size, three in a row.
fn sheet(panels: [&Shown; 6]) -> image::RgbImage {
    let [width, height] = [WIDTH as usize / 2, HEIGHT / 2];
    image::RgbImage::from_fn(3 * width as u32, 2 * height as u32, |x, y| {
        let (x, y) = (x as usize, y as usize);
        let panel = panels[y / height * 3 + x / width];
        let corner = 2 * (y % height) * WIDTH as usize + 2 * (x % width);
        let four = [0, 1, WIDTH as usize, WIDTH as usize + 1].map(|next| panel[corner + next]);
        image::Rgb([0, 1, 2].map(|i| {
            let mean = four.iter().map(|pixel| pixel[i].clamp(0.0, 1.0)).sum::<f32>() / 4.0;
            (mean * 255.0).round() as u8
        }))
    })
}
