//! MTL: the materials of an OBJ file.
//!
//! Of a material the base colour is read: `Kd`, `d` and `map_Kd`. MTL has no defined colour space; `Kd`
//! counts as sRGB-encoded like the textures it stands beside. Both are multiplied, in linear light, as the specification says. A
//! `Kd` of zeros beside a map counts as white, since many writers leave it there; that is noted. `Tr` is not read: some writers mean
//! 1 - d by it, others d. Where it is neither 0 nor 1, and there is no `d`, that is noted.

use crate::file::File;
use crate::meshes::geometry::decoded;
use crate::meshes::texture;
use crate::{ImportError, Note, Place};
use glam::{Vec3, Vec4};
use oblate_surfels::{BaseColor, Texture, Wrap};
use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;

/// What is said where an opacity is given in a way that has two meanings.
const AMBIGUOUS: &str =
    "Tr of materials without d: some programs mean 1 - d by it, others d; it counts as opaque";

/// What is said where nothing would be seen of a map.
const BLACK: &str = "white for Kd 0 0 0 of materials with map_Kd, by which the map would be black";

/// Materials by name, each image read once.
#[derive(Default)]
pub(crate) struct Library {
    pub(crate) materials: HashMap<String, BaseColor>,
    pub(crate) notes: Vec<Note>,
    /// By the naming file, the name in it and whether it is clamped.
    textures: HashMap<(PathBuf, String, bool), Arc<Texture>>,
}

impl Library {
    /// Adds the materials of a file.
    pub(crate) fn add(&mut self, file: &File) -> Result<(), ImportError> {
        let mut name: Option<String> = None;
        // Materials that have an opacity, and those that have something that may be one.
        let (mut said, mut perhaps) = (HashSet::new(), HashSet::new());
        for (index, line) in file.text().split(|&b| b == b'\n').enumerate() {
            let text = String::from_utf8_lossy(line);
            let text = text.trim();
            let (word, rest) = text.split_once(|c: char| c.is_whitespace()).unwrap_or((text, ""));
            let (place, rest) = (Place::Line(index + 1), rest.trim());
            if word == "newmtl" {
                self.materials.insert(rest.to_owned(), BaseColor::default());
                name = Some(rest.to_owned());
                continue;
            }
            if word == "Tr" && !["0", "1"].map(str::parse::<f32>).contains(&rest.parse()) {
                perhaps.extend(name.clone());
            }
            if !matches!(word, "Kd" | "d" | "map_Kd") {
                continue;
            }
            let Some(material) = name.as_ref().and_then(|name| self.materials.get_mut(name)) else {
                return Err(file.malformed(place, format!("{word} before any newmtl")));
            };
            match word {
                "Kd" => {
                    let [r, g, b] = color(rest).map_err(|problem| file.malformed(place, problem))?;
                    let [r, g, b, _] = decoded([r, g, b, 1.0]);
                    material.factor = Vec4::new(r, g, b, material.factor.w);
                }
                "d" => {
                    let opacity = rest.strip_prefix("-halo").unwrap_or(rest).trim();
                    let opacity = opacity.parse().ok().filter(|d| (0.0..=1.0).contains(d));
                    let problem = || file.malformed(place, format!("d {rest:?} must be a number in [0, 1]"));
                    material.factor.w = opacity.ok_or_else(problem)?;
                    said.extend(name.clone());
                }
                "map_Kd" => {
                    let (image, clamp) = map(file, place.clone(), rest)?;
                    let wrap = [if clamp { Wrap::Clamp } else { Wrap::Repeat }; 2];
                    let key = (file.path.clone(), image.clone(), clamp);
                    let texture = match self.textures.get(&key) {
                        Some(texture) => Arc::clone(texture),
                        None => texture::read_named(file, place, &image, wrap)?,
                    };
                    self.textures.insert(key, Arc::clone(&texture));
                    material.texture = Some(texture);
                }
                _ => {}
            }
        }
        if !perhaps.is_subset(&said) {
            self.note(Note::LeftOut(AMBIGUOUS.into()));
        }
        self.show_maps();
        Ok(())
    }

    /// Makes a `Kd` of zeros beside a map white.
    fn show_maps(&mut self) {
        let hidden =
            |color: &&mut BaseColor| color.texture.is_some() && color.factor.truncate() == Vec3::ZERO;
        let mut any = false;
        for color in self.materials.values_mut().filter(hidden) {
            color.factor = Vec4::ONE.with_w(color.factor.w);
            any = true;
        }
        if any {
            self.note(Note::Assumed(BLACK.into()));
        }
    }

    /// What is said once, whichever file it is of.
    fn note(&mut self, note: Note) {
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }
}

/// `r g b`, or `r` for a grey.
fn color(text: &str) -> Result<[f32; 3], String> {
    let problem = || format!("Kd {text:?} must be one or three numbers in [0, 1]");
    let numbers: Option<Vec<f32>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    let color = match *numbers.ok_or_else(problem)?.as_slice() {
        [grey] => [grey; 3],
        [r, g, b] => [r, g, b],
        _ => return Err(problem()),
    };
    if color.iter().all(|c| (0.0..=1.0).contains(c)) { Ok(color) } else { Err(problem()) }
}

/// The image's name behind options of `map_Kd`, and whether it is clamped.
fn map(file: &File, place: Place, text: &str) -> Result<(String, bool), ImportError> {
    let mut rest = text;
    let mut clamp = false;
    while rest.starts_with('-') {
        let (option, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
        let (values, after) = arguments(option, after.trim_start());
        let neutral = match option {
            "-clamp" => {
                clamp = values == ["on"];
                true
            }
            "-s" => values.iter().all(|value| value.parse() == Ok(1.0)),
            "-o" | "-t" => values.iter().all(|value| value.parse() == Ok(0.0)),
            "-mm" => values.len() == 2 && values[0].parse() == Ok(0.0) && values[1].parse() == Ok(1.0),
            "-blendu" | "-blendv" | "-cc" | "-texres" | "-boost" | "-bm" | "-imfchan" | "-type" => true,
            // A name may begin with a dash.
            _ => break,
        };
        if !neutral {
            let feature = format!("map_Kd {option} {}: moving a map is not supported", values.join(" "));
            return Err(file.unsupported(place, feature));
        }
        rest = after;
    }
    if rest.is_empty() {
        return Err(file.malformed(place, "map_Kd names no image"));
    }
    Ok((rest.to_owned(), clamp))
}

/// The values of an option, and what follows them.
fn arguments<'a>(option: &str, text: &'a str) -> (Vec<&'a str>, &'a str) {
    let (most, numeric) = match option {
        "-s" | "-o" | "-t" => (3, true),
        "-mm" => (2, true),
        _ => (1, false),
    };
    let mut values = Vec::new();
    let mut rest = text;
    while values.len() < most {
        let (word, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
        if word.is_empty() || (numeric && word.parse::<f32>().is_err()) {
            break;
        }
        values.push(word);
        rest = after.trim_start();
    }
    (values, rest)
}
