//! `oblate pick`.

use super::print;
use crate::assemble::{Assembled, assemble};
use crate::draw::Drawing;
use crate::inputs::{SceneArgs, blend};
use crate::notation;
use crate::progress::Console;
use anyhow::Result;
use clap::Args;
use glam::DVec2;
use oblate::engine::{Channels, Picker};
use serde::Serialize;

/// Says which splat is seen at a point of the picture: of which file, where, how far away.
///
/// What is picked is where half of what is seen along the ray lies in front: an opaque surface, or the middle of a volume.
/// Options are those of render, the camera that it prints among them. Each point gives one line of JSON.
#[derive(Args)]
pub(crate) struct PickArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// A point in pixels from the top left corner, the middle of the first pixel being 0.5,0.5; may be given
    /// several times [default: the middle of the picture]
    #[arg(long, value_name = "X,Y", value_parser = notation::pair, allow_hyphen_values = true)]
    at: Vec<[f64; 2]>,
    /// Says nothing but what is picked, and errors
    #[arg(long, short)]
    quiet: bool,
}

/// A point of the picture and what is seen there.
#[derive(Serialize)]
struct Line<'a> {
    at: [f64; 2],
    /// Null where nothing is seen.
    picked: Option<Picked<'a>>,
}

#[derive(Serialize)]
struct Picked<'a> {
    /// The file, or the part of the built-in scene.
    source: &'a str,
    /// Which of its places, from 0.
    instance: usize,
    /// The cloud of the scene, and the splat in it.
    cloud: usize,
    splat: usize,
    /// As in EXR files of pictures in which no splat stands for several.
    id: u32,
    /// z along the view axis.
    depth: f64,
    /// In the world.
    position: [f64; 3],
    /// Of all that is seen there.
    opacity: f64,
}

pub(crate) fn run(args: &PickArgs) -> Result<()> {
    let console = Console { quiet: args.quiet };
    args.scene.check()?;
    let mut described = args.scene.describe()?;
    // All options count, as clouds that get levels of detail are in another order, which ids follow.
    let mut drawing = Drawing::new(&described.picture, Channels::Color)?;
    let items = args.scene.load(&mut described, console)?;
    if described.picture.blend.is_none() {
        drawing.settings.blend = blend(&items, console);
    }
    let assembled = assemble(items, &described.camera, described.lights, &drawing, console)?;
    let Assembled { scene, camera, view, origins } = &assembled;
    console.say(format_args!("camera: {view}"));

    let picker = Picker::new(scene)?;
    let middle = drawing.size.map(|side| f64::from(side) / 2.0);
    let points = if args.at.is_empty() { &[middle][..] } else { &args.at };
    let mut lines = String::new();
    for at in points {
        let picked = picker.pick(camera, &drawing.settings, DVec2::from(*at))?.map(|found| {
            let (source, instance) = &origins[found.cloud];
            Picked {
                source,
                instance: *instance,
                cloud: found.cloud,
                splat: found.splat,
                id: found.id,
                depth: found.depth,
                position: found.position.to_array(),
                opacity: found.opacity,
            }
        });
        lines += &(serde_json::to_string(&Line { at: *at, picked })? + "\n");
    }
    print(&lines)
}
