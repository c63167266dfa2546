//! `oblate render`.

use super::print;
use crate::assemble::{Assembled, assemble};
use crate::check::{Uses, Wrong};
use crate::content::{Body, Item, load};
use crate::description::{CameraOptions, Description, FileOptions, Look, PictureOptions, Source, Transfer};
use crate::draw::Drawing;
use crate::output::Output;
use crate::picture::Format;
use crate::progress::Console;
use crate::stats::{FrameTimes, Stats, median, milliseconds, peak_mib, round_micro, store_bound_ms};
use crate::{built_in, scene_file, transfer};
use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use oblate::engine::{Blend, Scene, Stage};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Draws a picture of a scene file, of meshes, volumes, point clouds and trained splats, or of the built-in scene.
///
/// Meshes (glTF, OBJ, PLY, STL), volumes (NRRD, VTI, VTK, MetaImage, NIfTI, TIFF, slices, raw), point clouds (LAS, LAZ,
/// PLY, PCD, XYZ) and trained splats (PLY, .splat, .spz, .sog, .ksplat, glTF) given together stand in one scene.
/// Without a file the built-in scene is drawn. The camera used is printed so that it can be refined.
#[derive(Args)]
pub(crate) struct RenderArgs {
    /// A scene file (TOML), or meshes, volumes, points and splats; none: the built-in scene
    #[arg(value_name = "SCENE.toml | FILE")]
    files: Vec<PathBuf>,

    /// The picture, .png or .exr (linear, with depths, normals and ids)
    #[arg(short, long, value_name = "FILE", default_value = "oblate.png")]
    output: PathBuf,
    /// Bits a channel of a PNG [default: 8]
    #[arg(long, value_name = "8|16", value_parser = bits)]
    bits: Option<u8>,

    #[command(flatten)]
    picture: PictureOptions,
    #[command(flatten)]
    camera: CameraOptions,
    #[command(flatten)]
    look: Look,
    #[command(flatten)]
    file: FileOptions,

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
    if matches!(&args.look.transfer, Some(Transfer::Named(name)) if name == "list") {
        return print(&transfer::list());
    }
    let console = Console { quiet: args.quiet };
    let repeats = args.repeat.unwrap_or(1);
    ensure!(repeats > 0, "--repeat is 0; it must be at least 1");
    if let Some(threads) = args.threads {
        ensure!((1..=1024).contains(&threads), "--threads is {threads}; it must be from 1 to 1024");
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("--threads")?;
    }
    let wrong = [args.picture.check(), args.camera.check(), args.look.check(), args.file.check()];
    wrong.into_iter().collect::<Result<(), Wrong>>().map_err(Wrong::option)?;
    let built_in = args.files.is_empty();
    ensure!(
        !built_in || args.file == FileOptions::default(),
        "--dims, --type, --endian, --spacing, --texture, --level and --max-memory are for files; none is given"
    );
    // Places that can't be written to are found before the work.
    let format = Format::of(&args.output, args.bits)?;
    let output = Output::begin(&args.output)?;
    let stats = args.stats.as_deref().map(StatsPlace::begin).transpose()?;
    if let Some(StatsPlace::File(stats)) = &stats {
        ensure!(!stats.is_same(&output), "--output and --stats name one file; give two");
    }

    let mut described = if built_in { built_in::description() } else { describe(args.files)? };
    described.picture = args.picture.over(described.picture);
    described.camera = args.camera.over(described.camera);
    let mut drawing = Drawing::new(&described.picture, format.channels())?;
    let ((items, uses), load_time) = timed(|| {
        if built_in {
            return Ok((built_in::items(console)?, Uses { mesh: true, volume: true, ..Uses::default() }));
        }
        load_all(described.sources, &args.file, console)
    })?;
    let used = args.file.check_use(uses).and_then(|()| args.look.check_use(uses));
    used.map_err(|wrong| {
        let names: Vec<&str> = items.iter().map(|item| item.name.as_str()).collect();
        wrong.option().context(names.join(", "))
    })?;
    // What is said here counts for each file.
    let over = |item: Item| Item { look: args.look.clone().over(item.look), ..item };
    let items: Vec<Item> = items.into_iter().map(over).collect();
    if described.picture.blend.is_none() {
        drawing.settings.blend = blend(&items, console);
    }
    let size = drawing.size;
    let (Assembled { scene, camera, view }, build_time) =
        timed(|| assemble(items, &described.camera, size, described.lights, console))?;
    console.say(format_args!("camera: {view}"));

    let measured = (stats.is_some() || args.repeat.is_some()).then_some(repeats);
    let (frame, times) = drawing.draw(&scene, &camera, measured, console)?;
    output.finish(|file| format.write(&frame, file))?;
    let [width, height] = size;
    let took = begun.elapsed().as_secs_f64();
    console.say(format_args!("wrote {}, {width}×{height}, {took:.2} s", args.output.display()));

    if let Some(place) = stats {
        let mut stats = summary(&scene, &times, drawing.reference.is_some());
        stats.load_ms = milliseconds(load_time);
        stats.build_ms = milliseconds(build_time);
        place.finish(&stats)?;
    }
    Ok(())
}

/// The space of blending where nothing is said: splats by themselves are blended where they were trained.
fn blend(items: &[Item], console: Console) -> Blend {
    let in_display = |item: &&Item| matches!(item.body, Body::Splats { blend: Blend::Display, .. });
    let trained = items.iter().filter(in_display).count();
    if trained == 0 {
        Blend::Linear
    } else if trained == items.len() {
        console.say("blended in display space, where these splats were trained");
        Blend::Display
    } else {
        console
            .say("blended in linear light, not in display space, where the splats among these were trained");
        Blend::Linear
    }
}

/// A scene file's description, or one of the files as they are.
fn describe(files: Vec<PathBuf>) -> Result<Description> {
    let is_scene = |path: &Path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    match files.iter().find(|path| is_scene(path)) {
        Some(path) if files.len() > 1 => {
            bail!("{}: a scene file stands alone; list the other files in it", path.display())
        }
        Some(path) => {
            let description = scene_file::read(path)?;
            ensure!(
                !description.sources.is_empty(),
                "{}: it lists no [[mesh]], [[volume]], [[points]] or [[splats]]",
                path.display()
            );
            Ok(description)
        }
        None => Ok(Description {
            sources: files.into_iter().map(Source::new).collect(),
            ..Description::default()
        }),
    }
}

/// Everything to draw, and what options for files were of use for.
fn load_all(sources: Vec<Source>, file: &FileOptions, console: Console) -> Result<(Vec<Item>, Uses)> {
    let (mut items, mut uses) = (Vec::new(), Uses::default());
    for source in sources {
        let (item, of_item) = load(source, file, console)?;
        items.push(item);
        uses = uses | of_item;
    }
    Ok((items, uses))
}

fn timed<T>(work: impl FnOnce() -> Result<T>) -> Result<(T, Duration)> {
    let begun = Instant::now();
    Ok((work()?, begun.elapsed()))
}

/// Medians of the frames; loading and building are not in it.
fn summary(scene: &Scene, times: &[FrameTimes], by_reference: bool) -> Stats {
    let of =
        |time: fn(&FrameTimes, usize) -> f64, i: usize| median(times.iter().map(|t| time(t, i)).collect());
    let counts = times.last().filter(|_| !by_reference).map(|t| t.counts);
    let stages = if by_reference { &[][..] } else { &Stage::ALL[..] };
    Stats {
        splats: scene.clouds.iter().map(|cloud| cloud.len() as u64).sum(),
        visible: counts.map(|c| c.visible),
        fragments: counts.map(|c| c.fragments),
        late: counts.map(|c| c.late),
        store_bound_ms: counts.map(|c| round_micro(store_bound_ms(c.fragments))),
        threads: rayon::current_num_threads(),
        frame_ms: of(|t, _| t.frame_ms, 0),
        stages_ms: stages.iter().map(|s| (s.name(), of(|t, i| t.stages_ms[i], *s as usize))).collect(),
        load_ms: 0.0,
        build_ms: 0.0,
        peak_mib: peak_mib(),
    }
}

/// Where `--stats` goes.
enum StatsPlace {
    StandardOutput,
    File(Output),
}

impl StatsPlace {
    fn begin(path: &Path) -> Result<Self> {
        if path == Path::new("-") { Ok(Self::StandardOutput) } else { Output::begin(path).map(Self::File) }
    }

    fn finish(self, stats: &Stats) -> Result<()> {
        let json = serde_json::to_string(stats)? + "\n";
        match self {
            Self::StandardOutput => print(&json),
            Self::File(output) => output.finish(|file| Ok(file.write_all(json.as_bytes())?)),
        }
    }
}
