//! `oblate info`.

use super::print;
use crate::check::Wrong;
use crate::content::open;
use crate::description::FileOptions;
use crate::notation::comma_list;
use anyhow::Result;
use clap::Args;
use glam::DVec3;
use oblate::engine::{Harmonics, Splats, Strength};
use oblate::importers::Content;
use oblate::surfels::Mesh;
use oblate::volumes::{Histogram, Volume, propose_iso};
use std::fmt::{self, Write};
use std::path::PathBuf;

/// Bars of the histogram.
const BARS: usize = 24;
/// Characters of its longest bar.
const LONGEST: f64 = 48.0;

/// Says what a mesh, a volume or a file of splats holds, and proposes an iso-value.
#[derive(Args)]
pub(crate) struct InfoArgs {
    /// A mesh (glTF, GLB, OBJ, PLY), a volume (NRRD, VTI, raw) or trained splats (PLY)
    file: PathBuf,
    #[command(flatten)]
    options: FileOptions,
}

pub(crate) fn run(args: &InfoArgs) -> Result<()> {
    args.options.check().map_err(Wrong::option)?;
    let name = args.file.display().to_string();
    let mut text = format!("{name}\n");
    let (opened, uses) = open(&args.file, &args.options)?;
    args.options.check_use(uses).map_err(|wrong| wrong.option().context(name))?;
    match opened.content {
        Content::Mesh(mesh) => describe_mesh(&mesh, &mut text)?,
        Content::Volume(volume) => describe_volume(&volume, &mut text)?,
        Content::Splats { splats, .. } => describe_splats(&splats, &mut text)?,
        _ => {}
    }
    for note in &opened.notes {
        writeln!(text, "{note}")?;
    }
    print(&text)
}

fn describe_mesh(mesh: &Mesh, text: &mut String) -> fmt::Result {
    let sum = |of: fn(&oblate::surfels::Primitive) -> usize| mesh.primitives.iter().map(of).sum::<usize>();
    let parts = mesh.primitives.len();
    writeln!(text, "mesh        {parts} {}", if parts == 1 { "part" } else { "parts" })?;
    writeln!(text, "triangles   {}", sum(|p| p.triangles.len()))?;
    writeln!(text, "vertices    {}", sum(|p| p.positions.len()))?;
    let having = |what: &str, has: fn(&oblate::surfels::Primitive) -> bool| match mesh
        .primitives
        .iter()
        .filter(|p| has(p))
        .count()
    {
        0 => None,
        n if n == parts => Some(what.to_owned()),
        n => Some(format!("{what} ({n} of {parts} parts)")),
    };
    let attributes = [
        having("normals", |p| p.normals.is_some()),
        having("texture coordinates", |p| p.tex_coords.is_some()),
        having("vertex colours", |p| p.colors.is_some()),
    ];
    let attributes: Vec<String> = attributes.into_iter().flatten().collect();
    writeln!(
        text,
        "attributes  {}",
        if attributes.is_empty() { "none".into() } else { attributes.join(", ") }
    )?;
    for (index, part) in mesh.primitives.iter().enumerate() {
        if let Some(texture) = &part.material.texture {
            writeln!(text, "texture     {}×{} on part {index}", texture.width, texture.height)?;
        }
    }
    writeln!(text, "area        {}", short(mesh.area()))?;
    describe_bounds(mesh.bounds(), text)
}

fn describe_splats(splats: &Splats, text: &mut String) -> fmt::Result {
    writeln!(text, "splats      {}", splats.centers.len())?;
    let per_splat = splats.harmonics.as_ref().map_or(0, Harmonics::per_splat);
    match &splats.harmonics {
        Some(Harmonics { degree, .. }) => {
            writeln!(
                text,
                "harmonics   degree {degree}: {per_splat} colours a splat beside the constant one"
            )?;
        }
        None => writeln!(text, "harmonics   none: the same colour from everywhere")?,
    }
    if let Strength::Opacity { peaks, .. } = &splats.strength {
        let (low, high) = peaks.iter().fold((1.0_f32, 0.0_f32), |(low, high), p| (low.min(*p), high.max(*p)));
        writeln!(text, "opacity     {} to {}", short(low.into()), short(high.into()))?;
    }
    let mut bounds = None;
    for center in splats.centers.iter().map(|p| p.as_dvec3()) {
        let [low, high] = bounds.unwrap_or([center; 2]);
        bounds = Some([low.min(center), high.max(center)]);
    }
    describe_bounds(bounds, text)
}

fn describe_volume(volume: &Volume, text: &mut String) -> fmt::Result {
    let [x, y, z] = volume.dims();
    writeln!(text, "volume      {x}×{y}×{z} voxels of {}", volume.voxels().type_name())?;
    let frame = volume.frame();
    writeln!(text, "spacing     {}", list(frame.spacing))?;
    writeln!(text, "origin      {}", list(frame.origin))?;
    if frame.direction != glam::DMat3::IDENTITY {
        let [i, j, k] = [frame.direction.x_axis, frame.direction.y_axis, frame.direction.z_axis].map(list);
        writeln!(text, "axes        {i}   {j}   {k}")?;
    }
    describe_bounds(Some(corners(volume)), text)?;
    let Some(histogram) = volume.histogram(BARS) else {
        return writeln!(text, "values      none that is finite");
    };
    let [low, high] = histogram.range();
    writeln!(text, "values      {low} to {high}")?;
    if histogram.ignored() > 0 {
        writeln!(text, "not finite  {}", histogram.ignored())?;
    }
    if let Some(iso) = propose_iso(volume) {
        writeln!(text, "iso-value   {iso} separates the two main classes: try --iso {iso}")?;
    }
    describe_histogram(&histogram, text)
}

/// Bars as long as the logarithm of the counts: the background would leave no other bar visible.
fn describe_histogram(histogram: &Histogram, text: &mut String) -> fmt::Result {
    let counts = histogram.counts();
    let longest = counts.iter().map(|n| (*n as f64).ln_1p()).fold(0.0, f64::max);
    writeln!(text, "histogram   (centre of the bin, length ~ log of the count, count)")?;
    for (bin, &count) in counts.iter().enumerate() {
        let length = (LONGEST * (count as f64).ln_1p() / longest).round() as usize;
        // The last bin may reach beyond the values.
        let center = short(f64::from(histogram.center(bin).min(histogram.range()[1])));
        writeln!(text, "{center:>10}  {}{}{count}", "█".repeat(length), if length > 0 { " " } else { "" })?;
    }
    Ok(())
}

/// Smallest and largest corner of the box of the samples.
fn corners(volume: &Volume) -> [DVec3; 2] {
    let to_world = volume.index_to_world();
    let last = volume.dims().map(|n| n as f64 - 1.0);
    let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for corner in 0..8_u8 {
        let index = DVec3::from([0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { last[axis] } else { 0.0 }));
        let p = to_world.transform_point3(index);
        bounds = [bounds[0].min(p), bounds[1].max(p)];
    }
    bounds
}

fn describe_bounds(bounds: Option<[DVec3; 2]>, text: &mut String) -> fmt::Result {
    match bounds {
        Some([low, high]) => writeln!(text, "bounds      {} to {}", list(low), list(high)),
        None => writeln!(text, "bounds      none"),
    }
}

fn list(v: DVec3) -> String {
    v.to_array().map(short).join(", ")
}

/// Six significant digits.
fn short(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { (5 - value.abs().log10().floor() as i32).clamp(0, 12) };
    let step = 10f64.powi(digits);
    comma_list(&[(value * step).round() / step])
}
