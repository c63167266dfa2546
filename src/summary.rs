//! What `oblate info` tells of a file, as text and as JSON.

use crate::notation::comma_list;
use glam::{DMat3, DVec3};
use oblate::engine::{Blend, OpacityFilter, Splats, Strength};
use oblate::importers::{Content, Opened};
use oblate::surfels::{Mesh, PointCloud, Primitive};
use oblate::volumes::{Arrangement, Histogram, IrregularVolume, Space, Volume, propose_iso};
use serde::Serialize;
use std::fmt::{self, Display, Write};

/// Bars of the histogram, at most.
const BARS: usize = 24;
/// Characters of its longest bar.
const LONGEST: f64 = 48.0;

/// A file in numbers. Keys without a meaning for a kind of content are left out.
#[derive(Debug, Serialize)]
pub(crate) struct Summary {
    file: String,
    format: &'static str,
    #[serde(flatten)]
    body: Body,
    /// Corners of the box of what is in it, in the file's own space.
    bounds: Option<[[f64; 3]; 2]>,
    /// What was not taken as it stands.
    notes: Vec<String>,
}

#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
enum Body {
    Mesh {
        parts: usize,
        triangles: usize,
        vertices: usize,
        /// Parts that have them.
        normals: usize,
        texture_coordinates: usize,
        vertex_colors: usize,
        /// Part, width, height.
        textures: Vec<[usize; 3]>,
        area: f64,
    },
    Volume {
        dims: [usize; 3],
        #[serde(rename = "type")]
        sample_type: &'static str,
        spacing: [f64; 3],
        origin: [f64; 3],
        /// The directions of the grid's axes.
        axes: [[f64; 3]; 3],
        /// What the file calls the space that they are in.
        space: Option<&'static str>,
        #[serde(flatten)]
        values: Values,
    },
    Irregular {
        /// `curvilinear` or `scattered`.
        arrangement: &'static str,
        /// Points along each axis of a curvilinear grid.
        dims: Option<[usize; 3]>,
        count: usize,
        #[serde(flatten)]
        values: Values,
    },
    Points {
        count: usize,
        colors: bool,
        normals: bool,
        intensities: Option<[f32; 2]>,
        /// Where the scanner stood.
        viewpoint: Option<[f64; 3]>,
    },
    Splats {
        count: usize,
        /// `opacity` for trained splats, `area` for surfels, `mass` for kernels with extinctions.
        strength: &'static str,
        range: Option<[f32; 2]>,
        /// The highest degree of spherical harmonics.
        degree: u8,
        /// What the opacities were trained with.
        filter: Option<&'static str>,
        /// The space in which colours mix.
        blend: &'static str,
    },
}

/// The values of a volume.
#[derive(Debug, Serialize)]
struct Values {
    range: Option<[f32; 2]>,
    not_finite: u64,
    iso: Option<f32>,
    /// Centres of bins and counts.
    histogram: Vec<(f32, u64)>,
}

impl Summary {
    pub(crate) fn new(file: String, opened: &Opened) -> Self {
        let (body, bounds) = match &opened.content {
            Content::Mesh(mesh) => (mesh_body(mesh), mesh.bounds()),
            Content::Volume(volume) => (volume_body(volume), Some(corners(volume))),
            Content::Irregular(volume) => (irregular_body(volume), Some(volume.bounds())),
            Content::Points(points) => (points_body(points), points_bounds(points)),
            Content::Splats { splats, blend, origin } => {
                (splats_body(splats, *blend), bounds(splats.centers.iter().map(|p| p.as_dvec3() + *origin)))
            }
        };
        let notes = opened.notes.iter().map(ToString::to_string).collect();
        let bounds = bounds.map(|corners| corners.map(|corner| corner.to_array()));
        Self { file, format: opened.format, body, bounds, notes }
    }
}

fn mesh_body(mesh: &Mesh) -> Body {
    let parts = &mesh.primitives;
    let sum = |of: fn(&Primitive) -> usize| parts.iter().map(of).sum::<usize>();
    let having = |has: fn(&Primitive) -> bool| parts.iter().filter(|part| has(part)).count();
    let texture = |(index, part): (usize, &Primitive)| {
        part.material.texture.as_ref().map(|texture| [index, texture.width, texture.height])
    };
    Body::Mesh {
        parts: parts.len(),
        triangles: sum(|p| p.triangles.len()),
        vertices: sum(|p| p.positions.len()),
        normals: having(|p| p.normals.is_some()),
        texture_coordinates: having(|p| p.tex_coords.is_some()),
        vertex_colors: having(|p| p.colors.is_some()),
        textures: parts.iter().enumerate().filter_map(texture).collect(),
        area: mesh.area(),
    }
}

fn volume_body(volume: &Volume) -> Body {
    let frame = volume.frame();
    Body::Volume {
        dims: volume.dims(),
        sample_type: volume.voxels().type_name(),
        spacing: frame.spacing.to_array(),
        origin: frame.origin.to_array(),
        axes: frame.direction.to_cols_array_2d(),
        space: frame.space.map(Space::name),
        values: values(volume),
    }
}

fn irregular_body(volume: &IrregularVolume) -> Body {
    let (arrangement, dims) = match volume.arrangement() {
        Arrangement::Curvilinear => ("curvilinear", Some(volume.samples().dims())),
        Arrangement::Scattered => ("scattered", None),
    };
    Body::Irregular { arrangement, dims, count: volume.points().len(), values: values(volume.samples()) }
}

fn values(volume: &Volume) -> Values {
    let histogram = volume.histogram(BARS);
    let bin = |histogram: &Histogram, bin: usize| {
        // The last bin may reach beyond the values.
        (histogram.center(bin).min(histogram.range()[1]), histogram.counts()[bin])
    };
    Values {
        range: histogram.as_ref().map(Histogram::range),
        not_finite: histogram.as_ref().map_or(volume.voxels().len() as u64, Histogram::ignored),
        iso: propose_iso(volume),
        histogram: histogram.map_or_else(Vec::new, |h| (0..h.counts().len()).map(|i| bin(&h, i)).collect()),
    }
}

fn points_body(points: &PointCloud) -> Body {
    Body::Points {
        count: points.positions.len(),
        colors: points.colors.is_some(),
        normals: points.normals.is_some(),
        intensities: points.intensities.as_deref().and_then(range),
        viewpoint: points.viewpoint.map(|place| place.to_array()),
    }
}

fn splats_body(splats: &Splats, blend: Blend) -> Body {
    let (strength, values, filter) = match &splats.strength {
        Strength::Opacity { peaks, filter, .. } => ("opacity", peaks, Some(filter)),
        Strength::Surface(surface) => ("area", &surface.areas, None),
        Strength::Extinction { masses } => ("mass", masses, None),
    };
    Body::Splats {
        count: splats.centers.len(),
        strength,
        range: range(values),
        degree: splats.harmonics.as_ref().map_or(0, |harmonics| harmonics.degree),
        filter: filter.map(|filter| match filter {
            OpacityFilter::Classic => "classic",
            OpacityFilter::Compensated => "compensated",
        }),
        blend: match blend {
            Blend::Linear => "linear",
            Blend::Display => "display",
        },
    }
}

fn range(values: &[f32]) -> Option<[f32; 2]> {
    let join = |[low, high]: [f32; 2], [a, b]: [f32; 2]| [low.min(a), high.max(b)];
    values.iter().map(|value| [*value; 2]).reduce(join)
}

fn bounds(points: impl Iterator<Item = DVec3>) -> Option<[DVec3; 2]> {
    points.map(|p| [p; 2]).reduce(|[low, high], [a, b]| [low.min(a), high.max(b)])
}

fn points_bounds(points: &PointCloud) -> Option<[DVec3; 2]> {
    bounds(points.positions.iter().map(|p| points.origin + p.as_dvec3()))
}

/// Smallest and largest corner of the box of the samples.
fn corners(volume: &Volume) -> [DVec3; 2] {
    let to_world = volume.index_to_world();
    let last = volume.dims().map(|n| n as f64 - 1.0);
    let corner = |corner: u8| {
        let index = DVec3::from([0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { last[axis] } else { 0.0 }));
        to_world.transform_point3(index)
    };
    bounds((0..8).map(corner)).unwrap_or_default()
}

impl Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.file)?;
        writeln!(f, "format      {}", self.format)?;
        self.body.write(f)?;
        match self.bounds {
            Some([low, high]) => writeln!(f, "bounds      {} to {}", list(low), list(high))?,
            None => writeln!(f, "bounds      none")?,
        }
        if let Body::Volume { values, .. } | Body::Irregular { values, .. } = &self.body {
            write_values(f, values)?;
            write_histogram(f, &values.histogram)?;
        }
        self.notes.iter().try_for_each(|note| writeln!(f, "note        {note}"))
    }
}

impl Body {
    fn write(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mesh {
                parts,
                triangles,
                vertices,
                normals,
                texture_coordinates,
                vertex_colors,
                textures,
                area,
            } => {
                writeln!(f, "mesh        {parts} {}", if *parts == 1 { "part" } else { "parts" })?;
                writeln!(f, "triangles   {triangles}\nvertices    {vertices}")?;
                let having = |what: &str, count: usize| match count {
                    0 => None,
                    n if n == *parts => Some(what.to_owned()),
                    n => Some(format!("{what} ({n} of {parts} parts)")),
                };
                let attributes = [
                    having("normals", *normals),
                    having("texture coordinates", *texture_coordinates),
                    having("vertex colours", *vertex_colors),
                ];
                writeln!(f, "attributes  {}", some_of(attributes))?;
                for [part, width, height] in textures {
                    writeln!(f, "texture     {width}×{height} on part {part}")?;
                }
                writeln!(f, "area        {}", short(*area))
            }
            Self::Volume { dims: [x, y, z], sample_type, spacing, origin, axes, space, .. } => {
                writeln!(f, "volume      {x}×{y}×{z} voxels of {sample_type}")?;
                writeln!(f, "spacing     {}", list(*spacing))?;
                writeln!(f, "origin      {}", list(*origin))?;
                if *axes != DMat3::IDENTITY.to_cols_array_2d() {
                    let [i, j, k] = axes.map(list);
                    writeln!(f, "axes        {i}   {j}   {k}")?;
                }
                space.map_or(Ok(()), |name| writeln!(f, "space       {name}"))
            }
            Self::Irregular { arrangement, dims, count, .. } => match dims {
                Some([x, y, z]) => writeln!(f, "volume      {arrangement} grid of {x}×{y}×{z} points"),
                None => writeln!(f, "volume      {count} {arrangement} samples"),
            },
            Self::Points { count, colors, normals, intensities, viewpoint } => {
                writeln!(f, "points      {count}")?;
                let has = |what: &str, has: bool| has.then(|| what.to_owned());
                let attributes = [
                    has("colours", *colors),
                    has("normals", *normals),
                    has("intensities", intensities.is_some()),
                ];
                writeln!(f, "attributes  {}", some_of(attributes))?;
                if let Some(range) = intensities {
                    writeln!(f, "intensity   {}", from_to(*range))?;
                }
                viewpoint.map_or(Ok(()), |place| writeln!(f, "viewpoint   {}", list(place)))
            }
            Self::Splats { count, strength, range, degree, filter, blend } => {
                writeln!(f, "splats      {count}")?;
                match degree {
                    0 => writeln!(f, "harmonics   none: the same colour from everywhere")?,
                    degree => {
                        let colors = (degree + 1) * (degree + 1) - 1;
                        writeln!(
                            f,
                            "harmonics   degree {degree}: {colors} colours a splat beside the constant one"
                        )?;
                    }
                }
                if let Some(range) = range {
                    writeln!(f, "{strength:<12}{}", from_to(*range))?;
                }
                if let Some(filter) = filter {
                    writeln!(f, "filter      {filter}")?;
                }
                writeln!(f, "blending    {blend}")
            }
        }
    }
}

fn write_values(f: &mut fmt::Formatter<'_>, values: &Values) -> fmt::Result {
    let &Values { range, not_finite, iso, .. } = values;
    let Some([low, high]) = range else {
        return writeln!(f, "values      none that is finite");
    };
    writeln!(f, "values      {low} to {high}")?;
    if not_finite > 0 {
        writeln!(f, "not finite  {not_finite}")?;
    }
    iso.map_or(Ok(()), |iso| writeln!(f, "iso-value   {iso} separates the two main classes: try --iso {iso}"))
}

/// Bars as long as the logarithm of the counts: the background would leave no other bar visible.
fn write_histogram(f: &mut fmt::Formatter<'_>, histogram: &[(f32, u64)]) -> fmt::Result {
    if histogram.is_empty() {
        return Ok(());
    }
    let longest = histogram.iter().map(|(_, n)| (*n as f64).ln_1p()).fold(0.0, f64::max);
    writeln!(f, "histogram   (centre of the bin, length ~ log of the count, count)")?;
    for &(center, count) in histogram {
        let length = (LONGEST * (count as f64).ln_1p() / longest).round() as usize;
        let center = short(f64::from(center));
        writeln!(f, "{center:>10}  {}{}{count}", "█".repeat(length), if length > 0 { " " } else { "" })?;
    }
    Ok(())
}

fn some_of<const N: usize>(attributes: [Option<String>; N]) -> String {
    let attributes: Vec<String> = attributes.into_iter().flatten().collect();
    if attributes.is_empty() { "none".into() } else { attributes.join(", ") }
}

fn from_to([low, high]: [f32; 2]) -> String {
    let mut text = short(low.into());
    // Writing to a string cannot fail.
    let _ = write!(text, " to {}", short(high.into()));
    text
}

fn list(v: [f64; 3]) -> String {
    v.map(short).join(", ")
}

/// Six significant digits.
fn short(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { (5 - value.abs().log10().floor() as i32).clamp(0, 12) };
    let step = 10f64.powi(digits);
    comma_list(&[(value * step).round() / step])
}
