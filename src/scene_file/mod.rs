//! Scene files: versioned TOML whose keys carry the names of the options.
//!
//! ```toml
//! version = 1
//!
//! [camera]                       # eye, target, up, and fov (degrees) or orthographic (height)
//! eye = [457.5, -285, 352]
//!
//! [[volume]]
//! path = "engine.vti"            # relative to this file
//! transfer = "amber"             # a preset or a file
//! iso = [60, 200]
//! iso-color = ["d0c8b840", "ffffff"] # sRGB and opacity, one for all or one for each value; else opaque light grey
//! refine = 2                     # each voxel as 2³: the transfer function is applied between samples, too
//! flatten = [120, 5]             # samples at this value, of this gradient or more, as surfels among the kernels
//! color-by = "heat.vti"          # colours by another volume's values, by default those of the first preset
//! color-transfer = "heat.txt"
//! clip-box = [0, 0, 0, 128, 256, 256]    # of whatever stands in the world, two corners
//! clip-plane = [[0, 1, 0, 40]]   # what has 0 x + 1 y + 0 z at 40 or above
//!
//! [[mesh]]
//! path = "helmet.glb"
//! scale = 90                     # one number or three; then rotate, then translate
//! rotate = [90, 0, 0]            # degrees about x, then y, then z
//! translate = [128, 60, 64]
//! surfel-spacing = 0.5
//!
//! [[mesh]]                       # one thing in many places: read, sampled and kept once
//! path = "tree.glb"
//! instances = [                  # the table's own place first, then these
//!     { translate = [1, 0, 0] },
//!     { translate = [4, 0, 2], rotate = [0, 30, 0], scale = 1.5 },
//! ]
//!
//! [[points]]                     # a point cloud; placed as meshes are
//! path = "scan.laz"
//! point-color = "intensity"      # rgb, intensity or height
//!
//! [[splats]]                     # trained Gaussians; placed as meshes are
//! path = "garden.ply"
//!
//! [[light]]
//! kind = "directional"           # ambient, directional (towards) or point (position)
//! towards = [1, -1, 2]
//! color = "fff0e0"               # sRGB; intensity multiplies it
//! intensity = 0.8
//!
//! [render]                       # options of the picture
//! size = [800, 600]
//! shade = true
//! order = "slabs"
//! slab-thickness = 1
//! tolerance = "2/255"            # or a number
//! ```

mod tables;

use crate::check::Wrong;
use crate::description::{CameraOptions, Description, PictureOptions, Reference, Source};
use anyhow::{Context, Result};
use serde::Deserialize;
use std::ops::Range;
use std::path::Path;
use tables::{LightTable, MeshTable, PointsTable, SourceTable, SplatsTable, VolumeTable};
use toml::Spanned;

/// The version of the format that this program reads.
const VERSION: i64 = 1;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: Spanned<i64>,
    camera: Option<Spanned<CameraOptions>>,
    #[serde(default)]
    mesh: Vec<Spanned<MeshTable>>,
    #[serde(default)]
    volume: Vec<Spanned<VolumeTable>>,
    #[serde(default)]
    points: Vec<Spanned<PointsTable>>,
    #[serde(default)]
    splats: Vec<Spanned<SplatsTable>>,
    #[serde(default)]
    light: Vec<Spanned<LightTable>>,
    render: Option<Spanned<PictureOptions>>,
}

/// Reads a scene file. Paths in it are relative to it.
pub(crate) fn read(path: &Path) -> Result<Description> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(&text, folder).map_err(|problem| {
        let place = problem.span.map_or_else(String::new, |span| place(&text, span));
        anyhow::anyhow!("{}{place}: {}", path.display(), problem.message)
    })
}

/// What is wrong, and where in the text.
pub(crate) struct Problem {
    message: String,
    span: Option<Range<usize>>,
}

/// Reads the text of a scene file that lies in `folder`.
pub(crate) fn parse(text: &str, folder: &Path) -> Result<Description, Problem> {
    let file: File = toml::from_str(text).map_err(|e| Problem {
        // The message may go over several lines; errors are said on one.
        message: brackets(text, e.span()).unwrap_or_else(|| e.message().trim().replace('\n', ", ")),
        span: e.span(),
    })?;
    let version = *file.version.get_ref();
    if version != VERSION {
        return Err(Problem {
            message: format!("version {version} is unknown; this program reads version {VERSION}"),
            span: Some(file.version.span()),
        });
    }

    let mut sources = Vec::new();
    for table in file.volume {
        sources.push(source(text, table, folder)?);
    }
    for table in file.mesh {
        sources.push(source(text, table, folder)?);
    }
    for table in file.points {
        sources.push(source(text, table, folder)?);
    }
    for table in file.splats {
        sources.push(source(text, table, folder)?);
    }
    let camera = file.camera.map(|table| in_table(text, table, |t| t.check().map(|()| t)));
    let picture = file.render.map(|table| {
        in_table(text, table, |t| {
            let samples = t.samples.is_none() || t.reference == Some(Reference::R2);
            check("samples", samples, || "is for reference = \"r2\"".into())?;
            check("slab-thickness", t.thickness_has_use(), || "is for order = \"slabs\"".into())?;
            check("budget", t.budget_has_use(), || "is kept by level-of-detail = true".into())?;
            t.check().map(|()| t)
        })
    });
    let lights = file.light.into_iter().map(|table| in_table(text, table, LightTable::light));
    Ok(Description {
        camera: camera.transpose()?.unwrap_or_default(),
        picture: picture.transpose()?.unwrap_or_default(),
        sources,
        lights: lights.collect::<Result<_, _>>()?,
    })
}

/// What is said of a table that begins there, if it is written as the only one and is one of several, or the other way around.
fn brackets(text: &str, span: Option<Range<usize>>) -> Option<String> {
    let header = text.get(span?.start..)?.strip_prefix('[')?;
    let (name, _) = header.trim_start_matches('[').split_once(']')?;
    match name {
        "mesh" | "volume" | "points" | "splats" | "light" if !header.starts_with('[') => {
            Some(format!("there may be several; write [[{name}]]"))
        }
        "camera" | "render" if header.starts_with('[') => Some(format!("there is one; write [{name}]")),
        _ => None,
    }
}

/// A table's source, in each of its places: the table's own place is where it stands among its instances.
fn source<T: SourceTable>(text: &str, mut table: Spanned<T>, folder: &Path) -> Result<Source, Problem> {
    let instances = table.get_mut().instances();
    let mut source = in_table(text, table, |t| t.source(folder))?;
    let Some(instances) = instances else { return Ok(source) };
    let span = instances.span();
    let instances = instances.into_inner();
    if instances.is_empty() {
        let message = "instances is empty; it must list one place or more, such as { translate = [1, 0, 0] }";
        return Err(Problem { message: message.into(), span: Some(span) });
    }
    let own = std::mem::take(&mut source.places);
    for instance in instances {
        let outer = in_table(text, instance, |t| t.placement())?;
        source.places.extend(own.iter().map(|inner| outer * *inner));
    }
    Ok(source)
}

/// Checks or converts a table; what is wrong gets the place of its key.
fn in_table<T, U>(
    text: &str,
    table: Spanned<T>,
    convert: impl FnOnce(T) -> Result<U, Wrong>,
) -> Result<U, Problem> {
    let span = table.span();
    convert(table.into_inner()).map_err(|Wrong { key, problem }| Problem {
        message: format!("{key} {problem}"),
        span: Some(key_span(text, span, key)),
    })
}

/// Where a line of the table begins with the key; else where the table begins.
fn key_span(text: &str, table: Range<usize>, key: &str) -> Range<usize> {
    let mut at = table.start;
    for (index, line) in text.get(table.start..).unwrap_or_default().split_inclusive('\n').enumerate() {
        let content = line.trim_start();
        if index > 0 && content.starts_with('[') {
            break;
        }
        let is_key = |rest: &str| rest.trim_start().starts_with('=');
        if content.strip_prefix(key).is_some_and(is_key) {
            let start = at + line.len() - content.len();
            return start..start + key.len();
        }
        at += line.len();
    }
    table
}

fn check(key: &'static str, right: bool, problem: impl FnOnce() -> String) -> Result<(), Wrong> {
    if right { Ok(()) } else { Err(Wrong { key, problem: problem() }) }
}

/// `, line 3, column 5 (`iso = []`)`.
fn place(text: &str, span: Range<usize>) -> String {
    let start = text.floor_char_boundary(span.start);
    let before = &text[..start];
    let line_start = before.rfind('\n').map_or(0, |i| i + 1);
    let (line, column) = (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1);
    let source = text[line_start..].lines().next().unwrap_or("").trim();
    format!(", line {line}, column {column} (`{source}`)")
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use oblate::engine::{Light, Order};

    fn problem(text: &str) -> String {
        let Err(problem) = parse(text, Path::new("folder")) else { panic!("{text} passed") };
        format!("{}{}", problem.span.map_or(String::new(), |s| place(text, s)), problem.message)
    }

    #[test]
    fn a_whole_file() {
        let text = "version = 1\n[camera]\neye = [1, -2.5, 3]\n[[mesh]]\npath = 'a.glb'\nscale = 2\n\
                    rotate = [0, 0, 90]\ntranslate = [10, 0, 0]\n[[volume]]\npath = 'v.raw'\ndims = [2, 3, 4]\n\
                    type = 'u16'\nendian = 'big'\niso = [3]\n[[light]]\nkind = 'ambient'\nintensity = 0.5\n\
                    [render]\nlow-pass = 0.5\norder = 'slabs'\nslab-thickness = 0.5\nbackground = '#ffffff00'\nfootprint = 'exact'\n";
        let scene = parse(text, Path::new("folder")).map_err(|p| p.message).unwrap();
        assert_eq!(scene.camera.eye, Some([1.0, -2.5, 3.0]));
        assert_eq!(scene.picture.low_pass, Some(0.5));
        assert_eq!(scene.picture.order(), Order::Slabs { thickness: 0.5 });
        assert_eq!(scene.sources.len(), 2);
        assert_eq!(scene.sources[0].file.dims, Some([2, 3, 4]));
        let slices =
            parse(&text.replace("[2, 3, 4]", "[2, 3]"), Path::new("")).map_err(|p| p.message).unwrap();
        assert_eq!(slices.sources[0].file.dims, Some([2, 3, 1]));
        let mesh = &scene.sources[1];
        assert_eq!(mesh.path, Path::new("folder/a.glb"));
        // x is scaled to 2, turned to y, moved along x.
        let moved = mesh.places[0].transform_point3(DVec3::X);
        assert!((moved - DVec3::new(10.0, 2.0, 0.0)).length() < 1e-12, "{moved}");
        assert_eq!(scene.lights, [Light::Ambient { color: [0.5; 3] }]);
    }

    #[test]
    fn instances_stand_outside_of_the_own_place() {
        let text = "version = 1\n[[splats]]\npath = 'a.ply'\nscale = 2\ntranslate = [1, 0, 0]\ninstances = [\n\
                    { translate = [0, 0, 5] }, { scale = 3, rotate = [0, 0, 90] },\n {} ]\n\
                    [[mesh]]\npath = 'b.obj'\n[[mesh.instances]]\nscale = 4\n[[mesh.instances]]\n";
        let scene = parse(text, Path::new("")).map_err(|p| p.message).unwrap();
        let [mesh, splats] = &scene.sources[..] else { panic!("{:?}", scene.sources) };
        let moved = splats.places.iter().map(|place| place.transform_point3(DVec3::X));
        let wanted = [DVec3::new(3.0, 0.0, 5.0), DVec3::new(0.0, 9.0, 0.0), DVec3::new(3.0, 0.0, 0.0)];
        assert_eq!(splats.places.len(), wanted.len());
        for (moved, wanted) in moved.zip(wanted) {
            assert!((moved - wanted).length() < 1e-12, "{moved} for {wanted}");
        }
        assert_eq!(mesh.places.len(), 2);
        assert_eq!(mesh.places[0].transform_point3(DVec3::X), DVec3::X * 4.0);

        let table = "version = 1\n[[mesh]]\npath = 'a'\ntranslate = [0, 0, 0]\n";
        let wrong = problem(&format!("{table}instances = [\n  {{}},\n  {{ scale = 0 }},\n]\n"));
        assert!(wrong.contains("line 7, column 3") && wrong.contains("above 0"), "{wrong}");
        let wrong = problem(&format!("{table}instances = [{{ translate = [nan, 0, 0] }}]\n"));
        assert!(wrong.contains("line 5") && wrong.contains("translate"), "{wrong}");
        let wrong = problem(&format!("{table}instances = [{{ position = [1, 0, 0] }}]\n"));
        assert!(wrong.contains("line 5") && wrong.contains("position"), "{wrong}");
        assert!(problem(&format!("{table}instances = []\n")).contains("line 5, column 13"));
        let wrong = problem(&format!("{table}[[mesh.instances]]\nscale = -1\n"));
        assert!(wrong.contains("line 6") && wrong.contains("above 0"), "{wrong}");
    }

    #[test]
    fn mistakes_show_their_place() {
        let unknown = problem("version = 1\n[[mesh]]\npath = 'a'\n  colour = 3\n");
        assert!(unknown.contains("line 4, column 3"), "{unknown}");
        assert!(unknown.contains("colour"), "{unknown}");
        assert!(problem("version = 2").contains("version 2 is unknown"));
        assert!(problem("[camera]").contains("version"));
        let light = problem("version = 1\n[[light]]\nkind = 'point'\n");
        assert!(light.contains("line 3") && light.contains("position"), "{light}");
        assert!(problem("version = 1\n[[mesh]]\npath = 'a'\nscale = -1\n").contains("above 0"));
        assert!(problem("version = 1\n[[mesh]]\npath = 'a'\nscale = 'big'\n").contains("line 4"));
        assert!(problem("version = 1\n[render]\nfootprint = 'fine'\n").contains("line 3"));
        for (wrong, right) in [("[mesh]", "[[mesh]]"), ("[light]", "[[light]]"), ("[[camera]]", "[camera]")] {
            let said = problem(&format!("version = 1\n\n{wrong}\npath = 'a'\n"));
            assert!(said.contains("line 3") && said.contains(&format!("; write {right}")), "{said}");
        }
    }
}
