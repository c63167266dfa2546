//! `oblate chart`.

use super::use_threads;
use crate::assemble::{Assembled, assemble};
use crate::description::{CameraOptions, FileOptions, Look, PictureOptions};
use crate::draw::Drawing;
use crate::inputs::{SceneArgs, blend};
use crate::output::Output;
use crate::peers::Peers;
use crate::progress::{Console, Task};
use anyhow::{Context, Result, ensure};
use clap::Args;
use oblate::chart::measure::{Plan, Watch, measure};
use oblate::chart::report::{Machine, Report};
use oblate::chart::scenes::{BUILT_IN, Scale, Subject};
use oblate::chart::stability::CASES;
use oblate::engine::Channels;
use oblate::engine::simd::Level;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Draws scenes in every way that fits them, and charts time against error.
///
/// Errors are those to two reference integrators. Writes report.html, which needs no network, each chart as SVG and PNG, and all numbers as
/// chart.json. Scenes of the program's own: head, clouds, surface, mixed, trained, staged, far, warp.
#[derive(Args)]
pub(crate) struct ChartArgs {
    /// Scenes of the program's own by name, scene files, meshes, volumes, points or splats [default: the program's own]
    #[arg(value_name = "NAME | SCENE.toml | FILE")]
    scenes: Vec<PathBuf>,
    /// The folder for what is written
    #[arg(short, long, value_name = "DIR", default_value = "chart")]
    output: PathBuf,
    /// Smaller scenes and pictures, fewer frames: half a minute instead of minutes
    #[arg(long)]
    quick: bool,
    /// Also runs the fifteen cases in which methods fail, and draws their curves
    #[arg(long)]
    failures: bool,
    /// What other programs took, as benches/peers writes it
    #[arg(long, value_name = "FILE")]
    peers: Option<PathBuf>,
    /// Threads [default: all cores]
    #[arg(long, value_name = "N", help_heading = "Running")]
    threads: Option<usize>,
    /// Says nothing but errors
    #[arg(long, short, help_heading = "Running")]
    quiet: bool,
}

/// Reads the clock, and shows how far the work is.
struct Watcher<'a> {
    begun: Instant,
    task: &'a Task,
    /// How many subjects are done, and how many there are.
    subjects: [usize; 2],
}

/// Steps of the bar for a subject.
const STEPS: f64 = 300.0;

impl Watch for Watcher<'_> {
    fn now(&self) -> Duration {
        self.begun.elapsed()
    }

    fn at(&self, work: &str, share: f64) {
        self.task.says(work);
        let [done, all] = self.subjects.map(|count| (count as f64 * STEPS) as u64);
        // References, then frames: a third of the time each.
        let part = if work.ends_with("R1") {
            0.0
        } else if work.ends_with("R2") {
            1.0
        } else {
            2.0
        };
        self.task.at(done + ((part + share) * STEPS / 3.0) as u64, all);
    }
}

pub(crate) fn run(args: &ChartArgs) -> Result<()> {
    let console = Console { quiet: args.quiet };
    use_threads(args.threads)?;
    let peers = args.peers.as_deref().map(Peers::read).transpose()?;
    let made = !args.output.exists();
    std::fs::create_dir_all(&args.output)
        .with_context(|| format!("cannot write {}", args.output.display()))?;
    // A folder that can't be written to is found before the work.
    let places = begin(args);
    if places.is_err() && made {
        let _ = std::fs::remove_dir(&args.output);
    }
    places?;
    let scale = if args.quick { Scale::Quick } else { Scale::Full };
    let names: Vec<PathBuf> = if args.scenes.is_empty() {
        BUILT_IN.iter().map(|built_in| built_in.name.into()).collect()
    } else {
        args.scenes.clone()
    };
    for name in &names {
        let is_known = BUILT_IN.iter().any(|built_in| Path::new(built_in.name) == name);
        ensure!(
            is_known || name.exists(),
            "{}: there is no such file, nor a scene of the program's own by that name ({})",
            name.display(),
            BUILT_IN.map(|built_in| built_in.name).join(", ")
        );
    }

    let mut measured = Vec::new();
    let task = console.task("measuring");
    let begun = Instant::now();
    for (done, name) in names.iter().enumerate() {
        let mut subject = subject(name, scale, console)?;
        if let Some(peers) = &peers {
            subject.peers = peers.of(&subject)?;
        }
        let watch = Watcher { begun, task: &task, subjects: [done, names.len()] };
        measured.push(measure(&subject, &Plan::new(scale), &watch).with_context(|| subject.name.clone())?);
    }
    let mut failures = Vec::new();
    if args.failures {
        for (done, case) in CASES.iter().enumerate() {
            task.says(&format!("case {}: {}", case.number, case.title));
            task.at(done as u64, CASES.len() as u64);
            failures.push((*case, (case.run)()));
        }
    }
    drop(task);
    let machine = machine();
    let report = Report { machine: &machine, measured: &measured, failures: &failures };
    for file in report.files()? {
        let output = Output::begin(&args.output.join(&file.name))?;
        output.finish(|place| Ok(place.write_all(&file.content)?))?;
    }
    let took = begun.elapsed().as_secs_f64();
    console.say(format_args!("wrote {}, {took:.0} s", args.output.join("report.html").display()));
    Ok(())
}

/// A scene of the program's own, or what a file holds, as it is drawn when nothing is said.
fn subject(name: &Path, scale: Scale, console: Console) -> Result<Subject> {
    if let Some(built_in) = BUILT_IN.iter().find(|built_in| Path::new(built_in.name) == name) {
        return Ok((built_in.make)(scale)?);
    }
    let args = SceneArgs {
        files: vec![name.to_owned()],
        picture: PictureOptions::default(),
        camera: CameraOptions::default(),
        look: Look::default(),
        file: FileOptions::default(),
    };
    let mut described = args.describe()?;
    described.picture.size = Some(described.picture.size.unwrap_or([scale.side(); 2]));
    let mut drawing = Drawing::new(&described.picture, Channels::Color)?;
    let items = args.load(&mut described, console)?;
    if described.picture.blend.is_none() {
        drawing.settings.blend = blend(&items, console);
    }
    let Assembled { scene, camera, .. } =
        assemble(items, &described.camera, described.lights, &drawing, console)?;
    let stem = name.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Subject {
        name: stem,
        about: format!("{}, as it is drawn when nothing is said.", name.display()),
        scene,
        camera,
        settings: drawing.settings,
        known: None,
        peers: Vec::new(),
    })
}

fn machine() -> Machine {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let processor = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    Machine {
        processor: processor.map_or("a processor that is not named", |(_, name)| name).into(),
        threads: rayon::current_num_threads(),
        instructions: format!("{:?}", Level::best()),
        system: format!("{}, {}", std::env::consts::OS, std::env::consts::ARCH),
        version: env!("CARGO_PKG_VERSION").into(),
        command: std::iter::once("oblate".into())
            .chain(std::env::args().skip(1))
            .collect::<Vec<_>>()
            .join(" "),
    }
}

/// That both files can be written, and that none of them is read.
fn begin(args: &ChartArgs) -> Result<()> {
    Output::begin(&args.output.join("report.html"))?;
    Output::begin(&args.output.join("chart.json"))?.ensure_unread(args.peers.as_slice())
}
