//! `oblate warp`.

use super::use_threads;
use crate::depth_inputs::{DepthInputs, pose, pose_files};
use crate::notation::size;
use crate::output::{Output, StatsPlace};
use crate::picture::{Format, write_animation};
use crate::progress::Console;
use crate::stats::{median, milliseconds, peak_mib, rounded, timed};
use anyhow::{Context, Result, bail, ensure};
use clap::{ArgGroup, Args};
use glam::{DAffine3, DQuat, DVec2};
use oblate::engine::{
    Blend, Camera, Channels, Frame, Intrinsics, Pose, Projection, RenderSettings, Renderer, Scene,
};
use oblate::importers::depth::read_poses;
use oblate::surfels::{DEPTH_LOW_PASS, DepthSampler, DepthSettings, RgbdImage, fill_disocclusions};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Draws photographs with depths as they look from elsewhere: every pixel a surfel as large as it is on the surface that it shows.
///
/// What no photograph shows stays transparent; --fill guesses what things hid, from the background beside them. The camera of the new view is that of the first
/// photograph, standing elsewhere.
#[derive(Args)]
#[command(group = ArgGroup::new("view").args(["to", "sequence"]).required(true))]
pub(crate) struct WarpArgs {
    #[command(flatten)]
    inputs: DepthInputs,
    /// Where the new view is taken from, as in --pose
    #[arg(long, value_name = "FILE[:N]")]
    to: Option<String>,
    /// A file of poses to go through: writes an animated PNG, which browsers play, and its frames beside it
    #[arg(long, value_name = "FILE")]
    sequence: Option<PathBuf>,
    /// Frames of a sequence, evenly along its poses, which are interpolated [default: one for each pose]
    #[arg(long, value_name = "N", requires = "sequence", conflicts_with = "to")]
    frames: Option<u32>,
    /// Frames a second
    #[arg(long, value_name = "N", requires = "sequence", conflicts_with = "to", default_value = "25")]
    rate: u16,
    /// Pixels of the new picture, which shows the same angle of view [default: those of the first photograph]
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Fills what things hid in the photographs, from the background beside it; beyond their borders nothing is made up
    #[arg(long)]
    fill: bool,
    /// The picture, .png or .exr; .png of a sequence
    #[arg(short, long, value_name = "FILE", default_value = "warp.png")]
    output: PathBuf,
    /// Threads [default: all cores]
    #[arg(long, value_name = "N", help_heading = "Running")]
    threads: Option<usize>,
    /// Pictures that --stats takes the medians of, after one that warms up [default: 1]
    #[arg(long, value_name = "N", help_heading = "Running", requires = "stats", conflicts_with = "sequence")]
    repeat: Option<usize>,
    /// Writes what it took as one JSON object; - is standard output
    #[arg(long, value_name = "FILE|-", help_heading = "Running")]
    stats: Option<PathBuf>,
    /// Says nothing but errors
    #[arg(long, short, help_heading = "Running")]
    quiet: bool,
}

/// `--stats`, of the last picture; times are medians in milliseconds.
#[derive(Serialize)]
struct WarpStats {
    surfels: u64,
    /// Pixels whose opacity is below one half, before they are filled.
    holes: u64,
    /// Those that were filled.
    filled: u64,
    threads: usize,
    #[serde(serialize_with = "rounded")]
    load_ms: f64,
    #[serde(serialize_with = "rounded")]
    surfels_ms: f64,
    #[serde(serialize_with = "rounded")]
    frame_ms: f64,
    #[serde(serialize_with = "rounded")]
    fill_ms: f64,
    /// Largest resident size of the process; null where the system doesn't tell.
    peak_mib: Option<f64>,
}

pub(crate) fn run(args: WarpArgs) -> Result<()> {
    let console = Console { quiet: args.quiet };
    ensure!(args.repeat != Some(0), "--repeat is 0; it must be at least 1");
    if let Some(frames) = args.frames {
        ensure!((1..=65_535).contains(&frames), "--frames is {frames}; it must be from 1 to 65535");
    }
    ensure!(args.rate > 0, "--rate is 0; it must be at least 1");
    use_threads(args.threads)?;
    let format = Format::of(&args.output, None)?;
    let output = Output::begin(&args.output)?;
    let stats = args.stats.as_deref().map(StatsPlace::begin).transpose()?;
    let reads = args.reads();
    output.ensure_unread(&reads)?;
    if let Some(stats) = &stats {
        stats.ensure_other(&output, &reads)?;
    }
    let poses = args.poses()?;
    if args.sequence.is_some() {
        let frames = (0..poses.len()).map(|number| beside(&args.output, number));
        for frame in frames.filter(|frame| frame.exists()) {
            Output::begin(&frame)?.ensure_unread(&reads)?;
        }
    }
    let (images, load_time) = timed(|| args.inputs.load(console))?;
    let cameras = poses.iter().map(|pose| args.camera(&images[0], *pose)).collect::<Result<Vec<_>>>()?;
    // Filling asks for depths.
    let channels = if args.fill { Channels::All } else { format.channels() };
    let mut warp = Warp::new(&images, args.fill, channels);
    let repeats = if stats.is_some() { args.repeat.unwrap_or(1) + 1 } else { 1 };
    if let [camera] = &cameras[..]
        && args.sequence.is_none()
    {
        for _ in 1..repeats {
            warp.draw(camera)?;
        }
        let frame = warp.draw(camera)?;
        output.finish(|file| format.write(frame, file))?;
    } else {
        ensure!(format == Format::Png8, "{}: a sequence is written as .png", args.output.display());
        let task = console.task("drawing");
        let size = cameras[0].size();
        let mut frames = cameras.iter().enumerate().map(|(number, camera)| {
            let frame = warp.draw(camera)?;
            Output::begin(&beside(&args.output, number))?.finish(|file| format.write(frame, file))?;
            task.at(number as u64 + 1, cameras.len() as u64);
            Ok(frame.clone())
        });
        output.finish(|file| write_animation((size, cameras.len(), args.rate), &mut frames, file))?;
    }
    let [width, height] = cameras[0].size();
    let frames =
        if args.sequence.is_some() { args.frames_written(cameras.len(), console) } else { String::new() };
    console.say(format_args!("wrote {}, {width}×{height}{frames}", args.output.display()));
    if let Some(place) = stats {
        let after_first = |times: &[f64]| median(times[usize::from(times.len() > 1)..].to_vec());
        place.finish(&WarpStats {
            surfels: warp.surfels,
            holes: warp.holes,
            filled: warp.filled,
            threads: rayon::current_num_threads(),
            load_ms: milliseconds(load_time),
            surfels_ms: after_first(&warp.times[0]),
            frame_ms: after_first(&warp.times[1]),
            fill_ms: after_first(&warp.times[2]),
            peak_mib: peak_mib(),
        })?;
    }
    Ok(())
}

impl WarpArgs {
    /// The files that are named.
    fn reads(&self) -> Vec<&Path> {
        let to = self.to.as_deref().into_iter().flat_map(pose_files);
        self.inputs.reads().chain(self.sequence.as_deref()).chain(to).collect()
    }

    /// Where pictures are taken from.
    fn poses(&self) -> Result<Vec<Pose>> {
        let Some(sequence) = &self.sequence else {
            let Some(to) = &self.to else { bail!("--to or --sequence is needed") };
            return Ok(vec![pose(to).context("--to")?]);
        };
        let poses: Vec<Pose> =
            read_poses(sequence).context("--sequence")?.iter().map(|timed| timed.pose).collect();
        let Some(frames) = self.frames else { return Ok(poses) };
        let last = poses.len() - 1;
        let step = last as f64 / f64::from(frames.max(2) - 1);
        Ok((0..frames).map(|frame| between(&poses, f64::from(frame) * step)).collect())
    }

    /// What is said of the frames of a sequence; tells of those that would be next and were there before.
    fn frames_written(&self, count: usize, console: Console) -> String {
        let name = |number: usize| beside(&self.output, number).display().to_string();
        let older = (count..).take_while(|number| beside(&self.output, *number).exists()).count();
        match older {
            0 => {}
            1 => console.say(format_args!("{} was there before and is no frame of it", name(count))),
            _ => console.say(format_args!(
                "{} to {} were there before and are no frames of it",
                name(count),
                name(count + older - 1)
            )),
        }
        match count {
            1 => format!(", 1 frame, {}", name(0)),
            _ => format!(", {count} frames, {} to {}", name(0), name(count - 1)),
        }
    }

    fn camera(&self, image: &RgbdImage, pose: Pose) -> Result<Camera> {
        let own = image.size.map(|side| side as f64);
        let size = match self.size {
            Some([width, height]) => {
                let is_one = |side: u32| (1..=u32::from(u16::MAX)).contains(&side);
                ensure!(
                    is_one(width) && is_one(height),
                    "--size is {width}x{height}; it must be 1 to 65535 pixels on each side"
                );
                [width, height]
            }
            None => image.camera()?.size(),
        };
        let scale = DVec2::from(size.map(f64::from)) / DVec2::from(own);
        let Intrinsics { focal, center } = image.intrinsics;
        let intrinsics = Intrinsics { focal: focal * scale, center: center * scale };
        Ok(Camera::from_intrinsics(pose, intrinsics, Projection::Perspective, size)?)
    }
}

/// The pose at a place along a way, 1 being the second.
fn between(poses: &[Pose], place: f64) -> Pose {
    let first = (place.floor() as usize).min(poses.len() - 1);
    let next = (first + 1).min(poses.len() - 1);
    let [a, b] = [first, next].map(|i| poses[i].world_to_camera.inverse());
    let share = (place - first as f64).clamp(0.0, 1.0);
    let [from, to] = [a, b].map(|pose| DQuat::from_mat3(&pose.matrix3));
    let to_world = DAffine3::from_rotation_translation(
        from.slerp(to, share).normalize(),
        a.translation.lerp(b.translation, share),
    );
    Pose { world_to_camera: to_world.inverse() }
}

/// The name of a frame of a sequence.
fn beside(path: &Path, number: usize) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    path.with_file_name(format!("{stem}-{number:04}.png"))
}

/// Photographs, drawn from elsewhere, one picture after the other; what they are drawn from and with is kept.
struct Warp<'a> {
    images: &'a [RgbdImage],
    fill: bool,
    channels: Channels,
    sampler: DepthSampler,
    scene: Scene,
    renderer: Renderer,
    /// The picture without holes.
    whole: Frame,
    surfels: u64,
    holes: u64,
    filled: u64,
    /// Milliseconds of making surfels, drawing them and filling holes.
    times: [Vec<f64>; 3],
}

impl<'a> Warp<'a> {
    fn new(images: &'a [RgbdImage], fill: bool, channels: Channels) -> Self {
        Self {
            images,
            fill,
            channels,
            sampler: DepthSampler::default(),
            scene: Scene { clouds: Vec::new(), lights: Vec::new() },
            renderer: Renderer::new(),
            whole: Frame::default(),
            surfels: 0,
            holes: 0,
            filled: 0,
            times: Default::default(),
        }
    }

    fn draw(&mut self, camera: &Camera) -> Result<&Frame> {
        let settings = RenderSettings {
            low_pass: DEPTH_LOW_PASS,
            // Photographs are resampled as they are stored.
            blend: Blend::Display,
            shade: false,
            channels: self.channels,
            ..RenderSettings::default()
        };
        let clouds = &mut self.scene.clouds;
        let ((), surfels_time) =
            timed(|| Ok(self.sampler.sample(clouds, self.images, camera, &DepthSettings::default())?))?;
        self.surfels = clouds.iter().map(|cloud| cloud.len() as u64).sum();
        let (mut frame, frame_time) =
            timed(|| Ok(self.renderer.render(&self.scene, camera, &settings, &())?))?;
        self.holes = frame.color.iter().filter(|pixel| pixel[3] < 0.5).count() as u64;
        let mut fill_time = Duration::ZERO;
        if self.fill {
            let (filled, time) = timed(|| {
                self.whole.clone_from(frame);
                Ok(fill_disocclusions(&mut self.whole))
            })?;
            (self.filled, fill_time, frame) = (filled as u64, time, &self.whole);
        }
        for (times, time) in self.times.iter_mut().zip([surfels_time, frame_time, fill_time]) {
            times.push(milliseconds(time));
        }
        Ok(frame)
    }
}
