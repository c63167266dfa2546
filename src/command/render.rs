//! `oblate render`.

use super::{print, use_threads};
use crate::assemble::{Assembled, assemble};
use crate::description::Transfer;
use crate::draw::Drawing;
use crate::inputs::{SceneArgs, blend};
use crate::output::{Output, StatsPlace};
use crate::picture::Format;
use crate::progress::Console;
use crate::stats::{
    FrameTimes, SplatForms, Stats, median, milliseconds, peak_mib, round_micro, store_bound_ms, timed,
};
use crate::transfer;
use anyhow::{Result, ensure};
use clap::Args;
use oblate::engine::{Scene, Stage};
use std::path::PathBuf;
use std::time::Instant;

/// Draws a picture of a scene file, of meshes, volumes, point clouds and trained splats, or of the built-in scene.
///
/// Meshes (glTF, OBJ, PLY, STL), volumes (NRRD, VTI, VTK, MetaImage, NIfTI, TIFF, slices, raw), point clouds (LAS, LAZ,
/// PLY, PCD, XYZ) and trained splats (PLY, .splat, .spz, .sog, .ksplat, glTF) given together stand in one scene.
/// Without a file the built-in scene is drawn. The camera used is printed so that it can be refined.
#[derive(Args)]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// The picture, .png or .exr (linear, with depths, normals and ids)
    #[arg(short, long, value_name = "FILE", default_value = "oblate.png")]
    output: PathBuf,
    /// Bits a channel of a PNG [default: 8]
    #[arg(long, value_name = "8|16", value_parser = bits)]
    bits: Option<u8>,

    /// Threads [default: all cores]
    #[arg(long, value_name = "N", help_heading = "Running")]
    threads: Option<usize>,
    /// Frames that --stats takes the medians of, after one that warms up [default: 1]
    #[arg(long, value_name = "N", help_heading = "Running")]
    repeat: Option<usize>,
    /// Writes what it took as one JSON object; - is standard output
    #[arg(long, value_name = "FILE|-", help_heading = "Running")]
    stats: Option<PathBuf>,
    /// Says nothing but errors
    #[arg(long, short, help_heading = "Running")]
    quiet: bool,
}

fn bits(text: &str) -> Result<u8, String> {
    match text {
        "8" => Ok(8),
        "16" => Ok(16),
        _ => Err("PNG is written with 8 or 16 bits".into()),
    }
}

pub(crate) fn run(args: RenderArgs) -> Result<()> {
    let begun = Instant::now();
    if matches!(&args.scene.look.transfer, Some(Transfer::Named(name)) if name == "list") {
        return print(&transfer::list());
    }
    let console = Console { quiet: args.quiet };
    let repeats = args.repeat.unwrap_or(1);
    ensure!(repeats > 0, "--repeat is 0; it must be at least 1");
    use_threads(args.threads)?;
    args.scene.check()?;
    // Places that can't be written to are found before the work.
    let format = Format::of(&args.output, args.bits)?;
    let output = Output::begin(&args.output)?;
    let stats = args.stats.as_deref().map(StatsPlace::begin).transpose()?;
    let mut described = args.scene.describe()?;
    let reads = args.scene.reads(&described);
    output.ensure_unread(&reads)?;
    if let Some(stats) = &stats {
        stats.ensure_other(&output, &reads)?;
    }

    let mut drawing = Drawing::new(&described.picture, format.channels())?;
    drawing.measured = (stats.is_some() || args.repeat.is_some()).then_some(repeats);
    let (items, load_time) = timed(|| args.scene.load(&mut described, console))?;
    if described.picture.blend.is_none() {
        drawing.settings.blend = blend(&items, console);
    }
    let (assembled, build_time) =
        timed(|| assemble(items, &described.camera, described.lights, &drawing, console))?;
    let Assembled { scene, camera, view, .. } = assembled;
    console.say(format_args!("camera: {view}"));

    let settled = drawing.settle(&scene, &camera, console)?;
    let (frame, times) = drawing.draw(&scene, &camera, console)?;
    output.finish(|file| format.write(&frame, file))?;
    let [width, height] = drawing.size;
    let took = begun.elapsed().as_secs_f64();
    console.say(format_args!("wrote {}, {width}×{height}, {took:.2} s", args.output.display()));

    if let Some(place) = stats {
        let mut stats = summary(&scene, &times, drawing.reference.is_some());
        stats.load_ms = milliseconds(load_time);
        stats.build_ms = milliseconds(build_time);
        stats.way = settled.as_ref().map(|(way, _)| way.clone());
        stats.settle_ms = settled.map(|(_, time)| round_micro(milliseconds(time)));
        place.finish(&stats)?;
    }
    Ok(())
}

/// Medians of the frames; loading and building are not in it.
fn summary(scene: &Scene, times: &[FrameTimes], by_reference: bool) -> Stats {
    let of =
        |time: fn(&FrameTimes, usize) -> f64, i: usize| median(times.iter().map(|t| time(t, i)).collect());
    let counts = times.last().filter(|_| !by_reference).map(|t| t.counts);
    let stages = if by_reference { &[][..] } else { &Stage::ALL[..] };
    Stats {
        splats: scene.clouds.iter().map(|cloud| cloud.len() as u64).sum(),
        splat_bytes: scene.bytes(),
        culled: counts.map(|c| c.culled),
        occluded: counts.map(|c| c.occluded),
        visible: counts.map(|c| c.visible),
        merged: counts.map(|c| c.merged),
        forms: counts.map(|c| SplatForms::new(c.forms)),
        fragments: counts.map(|c| c.fragments),
        late: counts.map(|c| c.late),
        store_bound_ms: counts.map(|c| round_micro(store_bound_ms(c.fragments))),
        threads: rayon::current_num_threads(),
        frame_ms: of(|t, _| t.frame_ms, 0),
        stages_ms: stages.iter().map(|s| (s.name(), of(|t, i| t.stages_ms[i], *s as usize))).collect(),
        load_ms: 0.0,
        build_ms: 0.0,
        way: None,
        settle_ms: None,
        peak_mib: peak_mib(),
    }
}
