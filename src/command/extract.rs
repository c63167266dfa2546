//! `oblate extract`.

use super::use_threads;
use crate::check::Wrong;
use crate::content::{open, open_options};
use crate::description::FileOptions;
use crate::notation::distance_and_angle;
use crate::output::{Output, StatsPlace, WriteSeek};
use crate::progress::Console;
use crate::stats::{median, milliseconds, peak_mib, rounded, timed};
use anyhow::{Result, anyhow, bail, ensure};
use clap::Args;
use glam::DVec3;
use oblate::engine::{Blend, Closed, Splats, Strength};
use oblate::importers::export::{SurfelWriter, check_name};
use oblate::importers::{Content, RawSlices, Watch};
use oblate::surfels::{Deviation, Merged, merge_flat};
use oblate::volumes::{
    Arrangement, Grid, GridFrame, Interpolation, IrregularExtractor, IrregularVolume, IsoExtractor,
    IsoSettings, IsoSurfels, Volume, stream_iso_surfels,
};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Writes the surface at a value of a volume as surfels, in oblate's own PLY: places, normals, areas, half-axes.
#[derive(Args)]
pub(crate) struct ExtractArgs {
    /// A volume: NRRD, VTI, VTR, VTK, MetaImage, NIfTI, TIFF, DICOM, slices, raw
    #[arg(value_name = "VOLUME")]
    volume: PathBuf,
    /// The value on the surface
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    iso: f32,
    /// The surfels, .ply
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Surface and normals of a tricubic B-spline instead of the trilinear interpolant: for smooth data, takes longer
    #[arg(long)]
    tricubic: bool,
    /// Reads a raw file some slices at a time, so that it is never in memory as a whole
    #[arg(long, conflicts_with_all = ["repeat", "again"])]
    stream: bool,
    /// Merges surfels where the surface is flat: none is farther from the plane of the one that stands for it than D, and none
    /// is turned more [default: 10 degrees]
    #[arg(long, value_name = "D[,DEGREES]", allow_hyphen_values = true, value_parser = distance_and_angle, conflicts_with = "stream")]
    merge: Option<[f64; 2]>,
    #[command(flatten)]
    file: FileOptions,
    /// Threads [default: all cores]
    #[arg(long, value_name = "N", help_heading = "Running")]
    threads: Option<usize>,
    /// Extractions that --stats takes the medians of, after one that warms up [default: 1]
    #[arg(long, value_name = "N", help_heading = "Running")]
    repeat: Option<usize>,
    /// The second value that --stats measures, with the hierarchy in place [default: the value of --iso]
    #[arg(long, value_name = "V", allow_hyphen_values = true, help_heading = "Running")]
    again: Option<f32>,
    /// Writes what it took as one JSON object; - is standard output
    #[arg(long, value_name = "FILE|-", help_heading = "Running")]
    stats: Option<PathBuf>,
    /// Says nothing but errors
    #[arg(long, short, help_heading = "Running")]
    quiet: bool,
}

/// `--stats`; times are medians in milliseconds.
#[derive(Serialize)]
struct ExtractStats {
    surfels: u64,
    /// In squared world units.
    area: f64,
    closed: bool,
    threads: usize,
    /// The volume in memory to surfels in memory, with the hierarchy's making; of a stream with reading and writing.
    #[serde(serialize_with = "rounded")]
    extract_ms: f64,
    /// Of it the hierarchy's making; null for a stream.
    hierarchy_ms: Option<f64>,
    /// The second value, with the hierarchy in place; null for a stream.
    again_ms: Option<f64>,
    again_surfels: Option<u64>,
    /// What --merge did; null without it.
    merging: Option<Merging>,
    #[serde(serialize_with = "rounded")]
    load_ms: f64,
    #[serde(serialize_with = "rounded")]
    write_ms: f64,
    /// Largest resident size of the process; null where the system doesn't tell.
    peak_mib: Option<f64>,
}

/// Of `--merge`.
#[derive(Serialize)]
struct Merging {
    /// How many were written, and how many of these stand for several.
    surfels: usize,
    merged: usize,
    /// The largest distance and angle, in world units and degrees, between a surfel and the one that stands for it.
    largest_distance: f64,
    largest_degrees: f64,
    #[serde(serialize_with = "rounded")]
    merge_ms: f64,
}

pub(crate) fn run(args: ExtractArgs) -> Result<()> {
    let console = Console { quiet: args.quiet };
    args.file.check().map_err(Wrong::option)?;
    ensure!(args.repeat != Some(0), "--repeat is 0; it must be at least 1");
    for (option, value) in [("iso", Some(args.iso)), ("again", args.again)] {
        ensure!(value.is_none_or(f32::is_finite), "--{option} is not finite");
    }
    let is_ply = args.output.extension().is_none_or(|e| e.eq_ignore_ascii_case("ply"));
    ensure!(is_ply, "{}: surfels are written as .ply; convert writes others", args.output.display());
    check_name(&args.output)?;
    use_threads(args.threads)?;
    // Places that can't be written to are found before the work.
    let output = Output::begin(&args.output)?;
    let stats = args.stats.as_deref().map(StatsPlace::begin).transpose()?;
    let reads: Vec<&Path> = std::iter::once(args.volume.as_path()).chain(args.file.reads()).collect();
    output.ensure_unread(&reads)?;
    if let Some(stats) = &stats {
        stats.ensure_other(&output, &reads)?;
    }
    let settings = IsoSettings {
        interpolation: if args.tricubic { Interpolation::Tricubic } else { Interpolation::Trilinear },
        ..IsoSettings::default()
    };
    let name = args.volume.display().to_string();
    let made = if args.stream { stream(&args, &settings, output) } else { whole(&args, &settings, output) };
    // What importers say begins with the name.
    let named = |error: anyhow::Error| {
        if error.to_string().starts_with(&format!("{name}: ")) { error } else { error.context(name.clone()) }
    };
    let found = made.map_err(named)?;
    let count = found.merging.as_ref().map_or(found.surfels, |merging| merging.surfels as u64);
    let closed = if found.closed { "a closed" } else { "an open" };
    console.say(format_args!(
        "wrote {}, {count} surfels of {closed} surface, area {}",
        args.output.display(),
        found.area as f32
    ));
    stats.map_or(Ok(()), |place| place.finish(&found))
}

/// The volume in memory.
fn whole(args: &ExtractArgs, settings: &IsoSettings, output: Output) -> Result<ExtractStats> {
    let console = Console { quiet: args.quiet };
    let (field, load_time) = timed(|| load(args, console))?;
    let search = || Search::new(&field, settings.interpolation);
    let extractor = search()?;
    let measured = args.stats.is_some() || args.repeat.is_some();
    let repeats = if measured { 1 + args.repeat.unwrap_or(1) } else { 1 };
    let again = args.again.unwrap_or(args.iso);
    let (mut surfels, mut others) = (IsoSurfels::default(), IsoSurfels::default());
    let [mut extractions, mut hierarchies, mut second] = [const { Vec::new() }; 3];
    for _ in 0..repeats {
        let (made, hierarchy_time) = timed(search)?;
        let ((), found_in) = timed(|| made.find(args.iso, &mut surfels))?;
        hierarchies.push(milliseconds(hierarchy_time));
        extractions.push(milliseconds(hierarchy_time + found_in));
        if measured {
            let ((), time) = timed(|| extractor.find(again, &mut others))?;
            second.push(milliseconds(time));
        }
    }
    if surfels.is_empty() {
        let values = match &field {
            Field::Regular(volume) => volume,
            Field::Irregular(volume) => volume.samples(),
        };
        let range = values
            .value_range()
            .map_or("no finite value".into(), |[low, high]| format!("values {low} to {high}"));
        bail!("there are no splats to write: no surface is at {}; {range}", args.iso);
    }
    let first = usize::from(measured);
    let merged = args.merge.map(|bounds| timed(|| merge(&surfels, settings, bounds))).transpose()?;
    let reach = match &field {
        Field::Regular(volume) => reach(Grid { dims: volume.dims(), frame: volume.frame() }),
        Field::Irregular(volume) => {
            let [low, high] = volume.bounds();
            low.distance(high)
        }
    };
    let places = places_of(surfels.frame(), reach);
    let ((), write_time) = timed(|| {
        output.finish(|file| {
            let [place, origin] = places;
            let mut writer = SurfelWriter::new(file, Blend::Linear, origin);
            match &merged {
                Some((merged, _)) => write([merged.cloud.splats()], place, &mut writer)?,
                None => write(surfels.parts(settings), place, &mut writer)?,
            }
            writer.finish()?;
            Ok(())
        })
    })?;
    let merging = merged.map(|(merged, time)| Merging {
        surfels: merged.cloud.len(),
        merged: merged.merged,
        largest_distance: merged.largest.distance,
        largest_degrees: merged.largest.angle.to_degrees(),
        merge_ms: milliseconds(time),
    });
    if let Some(Merging { surfels: left, largest_distance: distance, largest_degrees, .. }) = &merging {
        console.say(format_args!(
            "merged {} surfels into {left}, at most {distance:.3} and {largest_degrees:.1} degrees off",
            surfels.len()
        ));
    }
    let micro = |times: Vec<f64>| crate::stats::round_micro(median(times));
    Ok(ExtractStats {
        surfels: surfels.len() as u64,
        area: surfels.area(),
        closed: surfels.is_closed(),
        threads: rayon::current_num_threads(),
        extract_ms: median(extractions.split_off(first)),
        hierarchy_ms: Some(micro(hierarchies.split_off(first))),
        again_ms: measured.then(|| micro(second.split_off(first))),
        again_surfels: measured.then(|| others.len() as u64),
        merging,
        load_ms: milliseconds(load_time),
        write_ms: milliseconds(write_time),
        peak_mib: peak_mib(),
    })
}

/// The volume slab by slab.
fn stream(args: &ExtractArgs, settings: &IsoSettings, output: Output) -> Result<ExtractStats> {
    let console = Console { quiet: args.quiet };
    let task = std::sync::Arc::new(console.task(format!("reading {}", args.volume.display())));
    let mut options = open_options(&args.file);
    let told = std::sync::Arc::clone(&task);
    options.watch = Some(Watch::new(move |done, of| told.at(done, of)));
    let slices = RawSlices::open(&args.volume, &options)?;
    let [place, origin] = places_of(slices.grid().frame, reach(slices.grid()));
    let (mut area, mut closed, mut found, mut count) = (0.0, true, false, 0);
    let begun = Instant::now();
    output.finish(|file| {
        let mut writer = SurfelWriter::new(file, Blend::Linear, origin);
        let read = |range| slices.read(range).map_err(anyhow::Error::from);
        stream_iso_surfels(&slices.grid(), args.iso, settings.interpolation, read, |surfels| {
            area += surfels.area();
            found |= !surfels.is_empty();
            closed &= surfels.is_closed();
            write(surfels.parts(settings), place, &mut writer)
        })?;
        ensure!(found, "there are no splats to write: no surface is at {}", args.iso);
        count = writer.finish()?;
        Ok(())
    })?;
    Ok(ExtractStats {
        surfels: count as u64,
        area,
        closed,
        threads: rayon::current_num_threads(),
        extract_ms: milliseconds(begun.elapsed()),
        hierarchy_ms: None,
        again_ms: None,
        again_surfels: None,
        merging: None,
        load_ms: 0.0,
        write_ms: 0.0,
        peak_mib: peak_mib(),
    })
}

/// What surfaces are found in.
enum Field {
    Regular(Volume),
    Irregular(IrregularVolume),
}

/// What finds them.
enum Search<'a> {
    Regular(IsoExtractor<&'a Volume>, Interpolation),
    Irregular(Box<IrregularExtractor<'a>>),
}

impl<'a> Search<'a> {
    fn new(field: &'a Field, interpolation: Interpolation) -> Result<Self> {
        Ok(match field {
            Field::Regular(volume) => Self::Regular(IsoExtractor::new(volume), interpolation),
            Field::Irregular(volume) => {
                Self::Irregular(Box::new(IrregularExtractor::new(volume, interpolation)?))
            }
        })
    }

    fn find(&self, value: f32, surfels: &mut IsoSurfels) -> Result<()> {
        match self {
            Self::Regular(extractor, interpolation) => {
                extractor.extract_into(value, *interpolation, surfels)?
            }
            Self::Irregular(extractor) => *surfels = extractor.extract(value)?,
        }
        Ok(())
    }
}

fn load(args: &ExtractArgs, console: Console) -> Result<Field> {
    let (opened, uses) = open(&args.volume, &args.file, console)?;
    args.file.check_use(uses).map_err(Wrong::option)?;
    for note in &opened.notes {
        console.say(format_args!("{}: {note}", args.volume.display()));
    }
    match opened.content {
        Content::Volume(volume) => Ok(Field::Regular(volume)),
        Content::Irregular(volume) if volume.arrangement() == Arrangement::Scattered => {
            Err(anyhow!("scattered samples have no cells, and so no surfaces"))
        }
        Content::Irregular(volume) => Ok(Field::Irregular(volume)),
        _ => Err(anyhow!("it is no volume")),
    }
}

/// How far a grid reaches from its sample (0, 0, 0).
fn reach(Grid { dims, frame }: Grid) -> f64 {
    (frame.spacing * DVec3::from(dims.map(|d| d as f64))).length()
}

/// What is added to the centres of a frame's surfels, and what they then are relative to: its origin is added if single precision has room for them
/// as far from there as they reach.
fn places_of(frame: GridFrame, reach: f64) -> [DVec3; 2] {
    let farthest = frame.origin.abs().max_element() + reach;
    // A surfel's σ is two thirds of a step; rounding may move it by a hundredth.
    if farthest * f64::from(f32::EPSILON) / 2.0 <= frame.spacing.max_element() / 150.0 {
        [frame.origin, DVec3::ZERO]
    } else {
        [DVec3::ZERO, frame.origin]
    }
}

/// One surfel where several are alike. They have one colour.
fn merge(surfels: &IsoSurfels, settings: &IsoSettings, [distance, angle]: [f64; 2]) -> Result<Merged> {
    Ok(merge_flat(&surfels.cloud(settings)?, Deviation { distance, angle, color: 0.0 })?)
}

/// Writes surfels at their place.
fn write(
    parts: impl IntoIterator<Item = Splats>,
    place: DVec3,
    writer: &mut SurfelWriter<'_, dyn WriteSeek + '_>,
) -> Result<()> {
    for mut part in parts {
        if place != DVec3::ZERO {
            part.centers.iter_mut().for_each(|center| *center = (center.as_dvec3() + place).as_vec3());
            if let Strength::Surface(surface) = &mut part.strength {
                surface.closed = std::mem::replace(&mut surface.closed, Closed::Nowhere).translated(place);
            }
        }
        writer.write(&part)?;
    }
    Ok(())
}
