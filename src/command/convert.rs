//! `oblate convert`.

use crate::assemble::asked_surfels;
use crate::check::Wrong;
use crate::content::open;
use crate::description::{FileOptions, Look};
use crate::finish::{Paint, kept};
use crate::output::Output;
use crate::points::point_cloud;
use crate::progress::Console;
use crate::volume_looks::{Field, volume_clouds};
use anyhow::{Context, Result, anyhow, ensure};
use clap::Args;
use glam::{DAffine3, DVec3, Vec3};
use oblate::engine::{Blend, Cloud, Splats, Strength};
use oblate::importers::export::{Target, check_name, save};
use oblate::importers::{Content, Note};
use std::path::PathBuf;

/// Writes what a file holds in another format: splats as PLY, .splat, .spz or glTF, volumes as NRRD or VTI.
///
/// Meshes become surfels, 500,000 unless --surfels or --surfel-spacing asks for others, and points one each; volumes
/// become iso-surfels or kernels where --iso or --transfer asks for them. What a format has no room for is said.
#[derive(Args)]
pub(crate) struct ConvertArgs {
    /// What is read: any file that render takes, but no scene file
    #[arg(value_name = "IN")]
    from: PathBuf,
    /// What is written: .ply, .splat, .spz, .glb (splats), .nrrd, .vti (volumes)
    #[arg(value_name = "OUT")]
    to: PathBuf,
    /// The format, where the name's ending does not tell: .ply is gaussian-ply for trained splats, surfel-ply for others
    #[arg(long = "as", value_name = "FORMAT", value_parser = target)]
    target: Option<Target>,
    #[command(flatten)]
    look: Look,
    #[command(flatten)]
    file: FileOptions,
    /// Says nothing but errors
    #[arg(long, short, help_heading = "Running")]
    quiet: bool,
}

/// By how much of its σ rounding may move a splat.
const SMALL_MOVE: f64 = 1.0 / 128.0;

/// Surfels of a mesh where nothing is said of them.
const SURFELS: usize = 500_000;

fn target(name: &str) -> Result<Target, String> {
    let found = Target::ALL.into_iter().find(|(_, of_target)| *of_target == name);
    let names = || Target::ALL.map(|(_, name)| name).join(", ");
    found.map(|(target, _)| target).ok_or_else(|| format!("formats are {}", names()))
}

pub(crate) fn run(args: ConvertArgs) -> Result<()> {
    let console = Console { quiet: args.quiet };
    args.look.check().and_then(|()| args.file.check()).map_err(Wrong::option)?;
    // Names that tell no format and places that can't be written to are found before the work.
    check_name(&args.to)?;
    if args.target.is_none() {
        Target::of(&args.to, false)?;
    }
    let output = Output::begin(&args.to)?;
    let named = args.file.reads().chain(args.look.reads());
    output.ensure_unread(&std::iter::once(args.from.as_path()).chain(named).collect::<Vec<_>>())?;
    let name = args.from.display().to_string();
    let (opened, uses) = open(&args.from, &args.file, console)?;
    let used = args.file.check_use(uses).and_then(|()| args.look.check_use(uses));
    used.map_err(|wrong| wrong.option().context(name.clone()))?;
    let (mut notes, up) = (opened.notes, opened.up);
    let trained = matches!(&opened.content, Content::Splats { splats, .. } if is_trained(splats));
    let target = args.target.map_or_else(|| Target::of(&args.to, trained), Ok)?;
    let content = if target.holds_volumes() {
        ensure!(
            args.look == Look::default(),
            "{name}: {} holds a volume as it is; options on surfaces and colours are for formats of splats",
            target.name()
        );
        opened.content
    } else {
        let space = match &opened.content {
            Content::Volume(volume) => volume.frame().space,
            _ => None,
        };
        let paint = Paint::read(&args.look, (DAffine3::IDENTITY, space), console)?;
        splats(opened.content, &args.look, paint.as_ref()).with_context(|| name.clone())?
    };
    output.finish(|file| {
        notes.extend(save(&content, up, target, file)?);
        Ok(())
    })?;
    let custom = target.up(&content);
    if custom != up && !target.holds_volumes() && target != Target::Glb {
        let [up, custom] = [up, custom].map(axis);
        let text = format!(
            "that {up} is up: axes are as they were, but programs take {custom} for up in such files"
        );
        notes.push(Note::LeftOut(text));
    }
    for note in &notes {
        console.say(format_args!("{name}: {note}"));
    }
    let count = match &content {
        Content::Splats { splats, .. } => format!(", {} splats", splats.centers.len()),
        _ => String::new(),
    };
    console.say(format_args!("wrote {} as {}{count}", args.to.display(), target.name()));
    Ok(())
}

/// The name of an axis of either sign.
fn axis(direction: DVec3) -> String {
    let names = ["x", "y", "z"];
    let sign = if direction.element_sum() < 0.0 { '−' } else { '+' };
    format!("{sign}{}", names[direction.abs().max_position()])
}

fn is_trained(splats: &Splats) -> bool {
    matches!(splats.strength, Strength::Opacity { .. })
}

/// The one set of splats that is asked for of a volume.
fn one_cloud(look: &Look, format: &str, clouds: impl FnOnce(&Look) -> Result<Vec<Cloud>>) -> Result<Cloud> {
    ensure!(
        look.iso.is_some() || look.transfer.is_some(),
        "such a volume is written as {format}; as splats with --iso or --transfer"
    );
    let [cloud]: [Cloud; 1] = clouds(look)?.try_into().map_err(|clouds: Vec<Cloud>| {
        anyhow!(
            "{} sets of splats are asked for, one goes into a file: give one --iso or --transfer",
            clouds.len()
        )
    })?;
    Ok(cloud)
}

/// Splats of what is none yet.
fn splats(content: Content, look: &Look, paint: Option<&Paint>) -> Result<Content> {
    let kept = kept(look);
    let cloud = match content {
        Content::Mesh(mesh) => {
            let asked = look.surfels.is_some() || look.surfel_spacing.is_some();
            let look = if asked { look.clone() } else { Look { surfels: Some(SURFELS), ..look.clone() } };
            asked_surfels(&mesh, &look)?
        }
        Content::Volume(volume) => {
            one_cloud(look, ".nrrd or .vti", |look| volume_clouds(Field::Regular(&volume), look, paint))?
        }
        Content::Irregular(volume) => one_cloud(look, "no format of volumes", |look| {
            volume_clouds(Field::Irregular(&volume), look, paint)
        })?,
        Content::Points(points) => point_cloud(&points, look)?,
        Content::Splats { splats, blend, origin } if !kept.is_empty() => {
            let cloud = Cloud::new(splats)?.transformed(DAffine3::from_translation(origin)).clipped(&kept)?;
            ensure!(!cloud.is_empty(), "nothing of it is within the planes");
            return Ok(Content::Splats { splats: cloud.splats(), blend, origin });
        }
        splats => return Ok(splats),
    };
    let cloud = cloud.clipped(&kept)?;
    ensure!(!cloud.is_empty(), "there is nothing visible in it");
    let (splats, origin) = in_place(&cloud);
    Ok(Content::Splats { splats, blend: Blend::Linear, origin })
}

/// The splats of a cloud in world space; relative to the cloud's place, where rounding would move them visibly.
fn in_place(cloud: &Cloud) -> (Splats, DVec3) {
    let mut splats = cloud.splats();
    // What becomes splats here is moved, but neither turned nor scaled.
    let place = cloud.cloud_to_world().translation;
    let sigma = |index| cloud.factor(index).to_cols_array_2d().map(|axis| Vec3::from(axis).length());
    let sigmas = (0..cloud.len()).map(|index| f64::from(sigma(index).into_iter().fold(0.0, f32::max)));
    let mean_sigma = sigmas.sum::<f64>() / cloud.len() as f64;
    let farthest = cloud.bounds().map_or(0.0, |[low, high]| low.abs().max(high.abs()).max_element());
    if farthest * f64::from(f32::EPSILON) / 2.0 <= SMALL_MOVE * mean_sigma {
        splats.centers.iter_mut().for_each(|center| *center = (center.as_dvec3() + place).as_vec3());
        return (splats, DVec3::ZERO);
    }
    (splats, place)
}
