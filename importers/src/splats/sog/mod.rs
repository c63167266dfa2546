//! SOG, versions 1 and 2, and its sets of levels of detail: splats in lossless WebP images.
//!
//! PlayCanvas, *The SOG format*, <https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog>, 2025, and
//! the sources of *splat-transform*, 2026. `meta.json` names images, beside it or with it in a zip file (`.sog`), and says
//! what their bytes stand for; texel i, by rows, belongs to splat i:
//!
//! | image | bytes |
//! |---|---|
//! | means | low and high bytes, in an image each, of 16 bits between bounds of sign(x) ln(1 + \|x\|) |
//! | quats | the three smallest of w x y z; alpha 252 to 255 tells the largest |
//! | scales | log scales: entries of a codebook; between bounds of each axis in version 1 |
//! | sh0 | coefficients of the constant harmonic, likewise; alpha is the opacity, its logit in version 1 |
//! | shN | a palette of harmonics, 64 entries in a row, whose bytes are likewise; each splat's number in it |
//!
//! `lod-meta.json` has a tree, whose leaves say which splats of which `meta.json` are theirs in each level.
//! [`OpenOptions::level`] chooses; an environment belongs to all levels.
//!
//! **Axes** are those of the 3DGS .ply of the same scene. **Flags**: the model `antialiased` (or `antialias`) is
//! [`oblate_engine::OpacityFilter::Compensated`], `2dgs` makes the third half-axis 0.
//!
//! Refused: lossy or animated images, too small ones, entries that a palette lacks. Splats with an alpha of quats below
//! 252 or an entry beyond a codebook are left out and counted.

mod folder;
mod levels;
mod meta;
mod scene;
mod texture;

use super::packed::within;
use super::{ROWS, Training, gather};
use crate::file::File;
use crate::{ImportError, Note, OpenOptions, Opened, Place};
use levels::{Levels, Part};
use scene::Scene;

/// The beginning of a zip file.
pub(crate) const ZIP: &[u8] = b"PK\x03\x04";

/// Whether JSON names the images of a scene, or a set of levels.
pub(crate) fn is_meta(json: &[u8]) -> bool {
    let has = |name: &[u8]| json.windows(name.len()).any(|window| window == name);
    (has(b"\"means\"") && has(b"\"quats\"")) || is_levels(json)
}

fn is_levels(json: &[u8]) -> bool {
    let has = |name: &[u8]| json.windows(name.len()).any(|window| window == name);
    has(b"\"lodLevels\"") && has(b"\"filenames\"")
}

/// Reads a zip file, `meta.json` or `lod-meta.json`.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let (mut budget, mut notes) = (options.max_memory, Vec::new());
    if file.bytes.starts_with(ZIP) || !is_levels(&file.bytes) {
        if let Some(level) = options.level.filter(|level| *level > 0) {
            return Err(file.unsupported(Place::Whole, format!("no level {level}: there is one, 0")));
        }
        let scene = Scene::open(file, &mut budget, &mut notes)?;
        let parts = [Part { file: 0, offset: 0, count: scene.count() }];
        return merge(file, (&[scene], &parts), budget, notes);
    }
    let levels: Levels = serde_json::from_slice(file.text())
        .map_err(|error| file.malformed(Place::Whole, error.to_string()))?;
    let level = options.level.unwrap_or(0);
    let mut parts = levels.parts(level).map_err(|problem| file.malformed(Place::Whole, problem))?;
    let mut scenes = Vec::new();
    let mut last = None;
    for part in &mut parts {
        if last != Some(part.file) {
            last = Some(part.file);
            let name = &levels.filenames[part.file];
            let named = file.read_named(Place::Part("filenames".into()), name)?;
            scenes.push(Scene::open(&named, &mut budget, &mut notes)?);
        }
        part.file = scenes.len() - 1;
        let there = scenes[part.file].count();
        if part.count > there || part.offset > there - part.count {
            let Part { offset, count, .. } = part;
            let name = &levels.filenames[last.unwrap_or(0)];
            let problem = format!("{name} has {there} splats; a node wants {count} from {offset}");
            return Err(file.malformed(Place::Whole, problem));
        }
    }
    if let Some(name) = &levels.environment {
        let named = file.read_named(Place::Part("environment".into()), name)?;
        let scene = Scene::open(&named, &mut budget, &mut notes)?;
        parts.push(Part { file: scenes.len(), offset: 0, count: scene.count() });
        scenes.push(scene);
    }
    if levels.count > 1 {
        let others =
            format!("the other {} of {} levels of detail; this is {level}", levels.count - 1, levels.count);
        notes.push(Note::LeftOut(others));
    }
    merge(file, (&scenes, &parts), budget, notes)
}

/// Splats of parts of scenes, one part after another.
fn merge(
    file: &File,
    (scenes, parts): (&[Scene], &[Part]),
    budget: u64,
    notes: Vec<Note>,
) -> Result<Opened, ImportError> {
    let wrong = |problem: String| file.malformed(Place::Whole, problem);
    let mut training: Option<Training> = None;
    for scene in scenes {
        let next = scene.training();
        let all = training.get_or_insert(next);
        if all.filter != next.filter {
            return Err(wrong("its parts were trained with different filters".into()));
        }
        all.degree = all.degree.max(next.degree);
    }
    let training = training.ok_or_else(|| wrong("there are no splats in this level".into()))?;
    let mut ends = Vec::with_capacity(parts.len());
    let mut count = 0_usize;
    for part in parts {
        count = count.saturating_add(part.count);
        ends.push(count);
    }
    within(budget, file, 0, (count, training))?;
    let mut opened = gather(file, (count, ROWS), training, |range, sink| {
        for row in range {
            let number = ends.partition_point(|end| *end <= row);
            let part = parts[number];
            let index = part.offset + part.count - (ends[number] - row);
            sink.put(&scenes[part.file].splat(index).map_err(wrong)?);
        }
        Ok(())
    })?;
    opened.notes.extend(notes);
    Ok(opened)
}
