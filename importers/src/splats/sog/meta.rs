//! What `meta.json` says, in both versions, as tables of what each byte stands for.

use crate::Note;
use crate::splats::Training;
use oblate_engine::{Blend, OpacityFilter};
use serde::Deserialize;
use std::array;

/// The file as it is written.
#[derive(Deserialize)]
pub(super) struct Meta {
    version: Option<u32>,
    count: Option<usize>,
    model: Option<String>,
    #[serde(default)]
    antialias: bool,
    pub(super) means: Means,
    scales: Coded,
    pub(super) quats: Files,
    sh0: Coded,
    #[serde(rename = "shN")]
    palette: Option<Palette>,
}

#[derive(Deserialize)]
pub(super) struct Means {
    shape: Option<Vec<usize>>,
    /// Of logarithms: sign(x) ln(1 + |x|).
    pub(super) mins: [f64; 3],
    pub(super) maxs: [f64; 3],
    pub(super) files: [String; 2],
}

#[derive(Deserialize)]
pub(super) struct Files {
    pub(super) files: [String; 1],
}

#[derive(Deserialize)]
struct Coded {
    codebook: Option<Vec<Option<f32>>>,
    mins: Option<Vec<f32>>,
    maxs: Option<Vec<f32>>,
    files: [String; 1],
}

#[derive(Deserialize)]
struct Palette {
    count: Option<usize>,
    bands: Option<u8>,
    codebook: Option<Vec<Option<f32>>>,
    mins: Option<f32>,
    maxs: Option<f32>,
    /// The palette's colours, each splat's number of one.
    files: [String; 2],
}

/// What each of 256 bytes stands for; NaN is nothing.
pub(super) type Table = [f32; 256];

/// What the bytes of a scene stand for.
pub(super) struct Tables {
    pub(super) count: usize,
    pub(super) flat: bool,
    filter: OpacityFilter,
    /// Of each axis.
    pub(super) log_scales: [Table; 3],
    pub(super) scale_file: String,
    /// Coefficients of the constant harmonic of each channel.
    pub(super) constant: [Table; 3],
    pub(super) opacity: Table,
    pub(super) color_file: String,
    pub(super) palette: Option<PaletteTable>,
}

pub(super) struct PaletteTable {
    pub(super) values: Table,
    /// The number of palette entries and the degree, where the file says so.
    pub(super) count: Option<usize>,
    pub(super) degree: Option<u8>,
    pub(super) files: [String; 2],
}

impl Tables {
    pub(super) fn new(meta: &Meta, notes: &mut Vec<Note>) -> Result<Self, String> {
        match meta.version {
            None | Some(1 | 2) => {}
            Some(version) => return Err(format!("version {version}; versions 1 and 2 are read")),
        }
        // Version 1 doesn't say its number.
        let coded = meta.version == Some(2);
        let stated =
            if coded { meta.count } else { meta.means.shape.as_ref().and_then(|s| s.first().copied()) };
        let Some(count) = stated else {
            return Err(format!("there is no {}", if coded { "count" } else { "means.shape" }));
        };
        let (filter, flat) = meta.filter(notes);
        let (log_scales, constant, opacity) = if coded {
            let scales = codebook("scales", meta.scales.codebook.as_deref(), notes)?;
            let constant = codebook("sh0", meta.sh0.codebook.as_deref(), notes)?;
            ([scales; 3], [constant; 3], lerp(0.0, 1.0))
        } else {
            let [log_scales @ .., _] = meta.scales.ranges("scales", 3)?;
            let [constant @ .., logit] = meta.sh0.ranges("sh0", 4)?;
            let opacity = logit.map(|logit| (1.0 / (1.0 + (-f64::from(logit)).exp())) as f32);
            (log_scales, constant, opacity)
        };
        let palette = match &meta.palette {
            Some(palette) if palette.bands != Some(0) => Some(palette.table(coded, notes)?),
            _ => None,
        };
        let [scale_file] = meta.scales.files.clone();
        let [color_file] = meta.sh0.files.clone();
        Ok(Self { count, flat, filter, log_scales, scale_file, constant, opacity, color_file, palette })
    }

    pub(super) fn training(&self, degree: u8) -> Training {
        Training { degree, filter: self.filter, blend: Blend::Display }
    }
}

impl Meta {
    /// What opacities were trained with, and whether splats are flat.
    fn filter(&self, notes: &mut Vec<Note>) -> (OpacityFilter, bool) {
        match self.model.as_deref() {
            Some("antialiased") => (OpacityFilter::Compensated, false),
            Some("2dgs") => (OpacityFilter::Classic, true),
            None | Some("default") if self.antialias => (OpacityFilter::Compensated, false),
            None | Some("default") => (OpacityFilter::Classic, false),
            Some(model) => {
                notes.push(Note::Assumed(format!("ordinary splats: the model {model:?} is not known")));
                (OpacityFilter::Classic, false)
            }
        }
    }
}

impl Coded {
    /// Tables of `count` channels of version 1; those beyond are of zeros.
    fn ranges(&self, name: &str, count: usize) -> Result<[Table; 4], String> {
        let of = |values: &Option<Vec<f32>>| values.as_ref().filter(|values| values.len() >= count).cloned();
        let (Some(mins), Some(maxs)) = (of(&self.mins), of(&self.maxs)) else {
            return Err(format!("{name} needs mins and maxs of {count} channels"));
        };
        Ok(array::from_fn(
            |channel| if channel < count { lerp(mins[channel], maxs[channel]) } else { [0.0; 256] },
        ))
    }
}

impl Palette {
    fn table(&self, coded: bool, notes: &mut Vec<Note>) -> Result<PaletteTable, String> {
        let values = if coded {
            codebook("shN", self.codebook.as_deref(), notes)?
        } else {
            let (Some(min), Some(max)) = (self.mins, self.maxs) else {
                return Err("shN needs mins and maxs".into());
            };
            lerp(min, max)
        };
        if let Some(bands @ 4..) = self.bands {
            return Err(format!("shN has harmonics of degree {bands}; degrees up to 3 are read"));
        }
        Ok(PaletteTable { values, count: self.count, degree: self.bands, files: self.files.clone() })
    }
}

/// Bytes from `min` to `max`.
fn lerp(min: f32, max: f32) -> Table {
    array::from_fn(|byte| min + (max - min) * (byte as f32 / 255.0))
}

fn codebook(name: &str, entries: Option<&[Option<f32>]>, notes: &mut Vec<Note>) -> Result<Table, String> {
    let entries = entries.ok_or_else(|| format!("{name} needs a codebook"))?;
    if entries.is_empty() || entries.len() > 256 {
        return Err(format!("{name} has a codebook of {} entries, which must be 1 to 256", entries.len()));
    }
    let mut table: Table = array::from_fn(|byte| entries.get(byte).copied().flatten().unwrap_or(f32::NAN));
    // Some writers left the first entry out.
    if entries[0].is_none() && table[1].is_finite() && table[255].is_finite() {
        table[0] = table[1] - (table[255] - table[1]) / 255.0;
        let what = format!("the first entry of the codebook of {name}, which is null, continues the others");
        notes.push(Note::Assumed(what));
    }
    Ok(table)
}
