//! What other programs need to draw scenes of `oblate chart`: writes `head` and `warp` as files and `scenes.json`, which describes them.
//!
//! ```sh
//! cargo run --release --example chart_inputs -- FOLDER [--quick]
//! ```
//!
//! `benches/peers` reads them. Lengths are in world units, angles in degrees, matrices in rows, colours linear unless said otherwise; the
//! centre of the first pixel is (0.5, 0.5).

use glam::DVec3;
use oblate::chart::scenes::{BUILT_IN, HEAD_TRANSFER, Scale, Subject, head_volume};
use oblate::engine::Pose;
use oblate::engine::color::linear_to_srgb;
use oblate::importers::Content;
use oblate::importers::export::{Target, save};
use oblate::surfels::Room;
use oblate::volumes::TransferFunction;
use serde_json::{Value, json};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let (options, folders): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|argument| argument.starts_with('-'));
    let scale = match options.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => Scale::Full,
        ["--quick"] => Scale::Quick,
        _ => return Err(format!("{options:?}: there is no option but --quick").into()),
    };
    let [folder] = &folders[..] else {
        return Err("which folder? chart_inputs FOLDER [--quick]".into());
    };
    let folder = PathBuf::from(folder);
    std::fs::create_dir_all(&folder)?;
    let scenes = json!({ "format": 1, "head": head(&folder, scale)?, "warp": warp(&folder, scale)? });
    let path = folder.join("scenes.json");
    std::fs::write(&path, format!("{scenes:#}\n"))?;
    println!("wrote {}", path.display());
    Ok(())
}

fn subject(name: &str, scale: Scale) -> Result<Subject, Failure> {
    let built_in =
        BUILT_IN.iter().find(|built_in| built_in.name == name).ok_or(format!("no scene {name}"))?;
    Ok((built_in.make)(scale)?)
}

/// The volume, its control points, the camera and the material; its light is a headlight.
fn head(folder: &Path, scale: Scale) -> Result<Value, Failure> {
    let subject = subject("head", scale)?;
    let name = "head.nrrd";
    let mut file = BufWriter::new(File::create(folder.join(name))?);
    save(&Content::Volume(head_volume(scale)?), DVec3::Z, Target::Nrrd, &mut file)?;
    file.flush()?;
    let transfer: TransferFunction = HEAD_TRANSFER.parse()?;
    let points = transfer.points().iter().map(|point| {
        let [red, green, blue] = point.color;
        json!([point.value, red, green, blue, point.strength])
    });
    let material = subject.scene.clouds.first().ok_or("nothing to draw")?.material();
    let pose = subject.camera.pose();
    let [_, height] = subject.camera.size();
    let half_height = f64::from(height) / 2.0 / subject.camera.intrinsics().focal.y;
    Ok(json!({
        "size": subject.camera.size(),
        "background": opaque(&subject),
        "volume": name,
        "transfer": {
            "about": "value, red, green, blue in sRGB, extinction per unit of length; linear between points, then decoded",
            "points": points.collect::<Vec<_>>(),
        },
        "camera": {
            "eye": pose.eye().to_array(),
            "target": (pose.eye() + pose.forward()).to_array(),
            // Rows of the rotation are right, down and forward.
            "up": (-pose.world_to_camera.matrix3.row(1)).to_array(),
            "vertical_angle": 2.0 * half_height.atan().to_degrees(),
        },
        "headlight": {
            "ambient": material.ambient,
            "diffuse": material.diffuse,
            "specular": material.specular,
            "exponent": material.exponent,
        },
    }))
}

/// The photograph in sRGB, its depths along the axis as little-endian f32 in rows, and both cameras.
fn warp(folder: &Path, scale: Scale) -> Result<Value, Failure> {
    let view = subject("warp", scale)?;
    let camera = Room.camera(view.camera.size()[0])?;
    let image = Room.image(&camera);
    let [photograph, depths] = ["warp.png", "warp.f32"];
    let level = |value: f32| (255.0 * linear_to_srgb(value)).round() as u8;
    let levels = image.colors.as_flattened().iter().map(|value| level(*value)).collect();
    let [width, height] = camera.size();
    image::RgbImage::from_raw(width, height, levels)
        .ok_or("a photograph that isn't whole")?
        .save(folder.join(photograph))?;
    let bytes: Vec<u8> = image.depths.iter().flat_map(|depth| depth.to_le_bytes()).collect();
    std::fs::write(folder.join(depths), bytes)?;
    let intrinsics = camera.intrinsics();
    Ok(json!({
        "size": camera.size(),
        "background": opaque(&view),
        "photograph": photograph,
        "depths": depths,
        "intrinsics": { "focal": intrinsics.focal.to_array(), "center": intrinsics.center.to_array() },
        "world_to_camera": rows(camera.pose()),
        "world_to_view": rows(view.camera.pose()),
    }))
}

fn opaque(subject: &Subject) -> [f32; 3] {
    let [red, green, blue, _] = subject.settings.background;
    [red, green, blue]
}

/// Three rows of four.
fn rows(pose: Pose) -> [[f64; 4]; 3] {
    let matrix = pose.world_to_camera;
    [0, 1, 2].map(|row| {
        let [x, y, z] = matrix.matrix3.row(row).to_array();
        [x, y, z, matrix.translation[row]]
    })
}
