//! The splats of one `meta.json`.

use super::folder::Folder;
use super::meta::{Meta, Table, Tables};
use super::texture::{Packed, Texture};
use crate::file::{File, unmarked};
use crate::splats::{Trained, Training, color};
use crate::{ImportError, Note, Place};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_SQRT_2;

/// Entries of a palette in a row of its image.
const ENTRIES: usize = 64;

pub(super) struct Scene {
    tables: Tables,
    means: Means,
    rotations: Texture,
    scales: Texture,
    colors: Texture,
    palette: Option<Palette>,
}

struct Means {
    mins: [f64; 3],
    maxs: [f64; 3],
    low: Texture,
    high: Texture,
}

struct Palette {
    values: Table,
    count: usize,
    degree: u8,
    colors: Texture,
    labels: Texture,
}

/// The images of a scene, in the order in which they are decoded.
#[derive(Default)]
struct Images(Vec<Packed>);

impl Scene {
    /// Opens what `file` is or names: a zip file, or JSON with images beside it.
    pub(super) fn open(file: &File, budget: &mut u64, notes: &mut Vec<Note>) -> Result<Self, ImportError> {
        let wrong = |problem| file.malformed(Place::Whole, problem);
        let zipped;
        let (mut folder, json) = if file.bytes.starts_with(super::ZIP) {
            let mut folder = Folder::zip(file)?;
            zipped = folder.read("meta.json", budget)?;
            (folder, &zipped)
        } else {
            (Folder::Beside(file), &file.bytes)
        };
        let meta: Meta = serde_json::from_slice(unmarked(json))
            .map_err(|error| file.malformed(Place::Part("meta.json".into()), error.to_string()))?;
        let tables = Tables::new(&meta, notes)
            .map_err(|problem| file.malformed(Place::Part("meta.json".into()), problem))?;
        let count = tables.count;
        let mut images = Images::default();
        let mut add = |name: &str, least: usize| {
            let bytes = folder.read(name, budget)?;
            images.0.push(Packed::new(name, bytes, least, budget).map_err(wrong)?);
            Ok(())
        };
        let [low, high] = &meta.means.files;
        let [rotations] = &meta.quats.files;
        for name in [low, high, rotations, &tables.scale_file, &tables.color_file] {
            add(name, count)?;
        }
        if let Some(palette) = &tables.palette {
            let [colors, labels] = &palette.files;
            add(colors, 1)?;
            add(labels, count)?;
        }
        let palette_size = images.0.get(5).map(|image| (image.width, image.height));
        let shape = (tables.palette.as_ref().zip(palette_size))
            .map(|(palette, size)| palette_shape(palette.degree, palette.count, size))
            .transpose()
            .map_err(wrong)?;
        let decoded: Vec<_> = images.0.into_par_iter().map(Packed::decode).collect();
        let decoded: Vec<Texture> = decoded.into_iter().collect::<Result<_, _>>().map_err(wrong)?;
        let mut decoded = decoded.into_iter();
        let mut next = || decoded.next().ok_or_else(|| wrong("an image is missing".into()));
        let means = Means { mins: meta.means.mins, maxs: meta.means.maxs, low: next()?, high: next()? };
        let (rotations, scales, colors) = (next()?, next()?, next()?);
        let palette = match (&tables.palette, shape) {
            (Some(palette), Some((degree, count))) => {
                let values = palette.values;
                Some(Palette { values, count, degree, colors: next()?, labels: next()? })
            }
            _ => None,
        };
        Ok(Self { tables, means, rotations, scales, colors, palette })
    }

    pub(super) fn count(&self) -> usize {
        self.tables.count
    }

    pub(super) fn training(&self) -> Training {
        self.tables.training(self.palette.as_ref().map_or(0, |palette| palette.degree))
    }

    /// Splat `index`; the problem if its harmonics are not in the palette.
    pub(super) fn splat(&self, index: usize) -> Result<Trained, String> {
        let tables = &self.tables;
        let of = |tables: &[Table; 3], texel: [u8; 4]| [0, 1, 2].map(|i| tables[i][usize::from(texel[i])]);
        let shade = self.colors.texels[index];
        let mut log_scales = of(&tables.log_scales, self.scales.texels[index]);
        if tables.flat {
            log_scales[2] = f32::NEG_INFINITY;
        }
        let mut splat = Trained {
            center: self.means.center(index),
            log_scales,
            rotation: rotation(self.rotations.texels[index]),
            opacity: tables.opacity[usize::from(shade[3])],
            color: color(of(&tables.constant, shade)),
            ..Trained::default()
        };
        if let Some(palette) = &self.palette {
            let [low, high, ..] = palette.labels.texels[index];
            let label = usize::from(u16::from_le_bytes([low, high]));
            if label >= palette.count {
                let count = palette.count;
                return Err(format!("splat {index} has entry {label} of a palette of {count}"));
            }
            let per_splat = self.training().per_splat();
            let first = label / ENTRIES * palette.colors.width + label % ENTRIES * per_splat;
            let entry = &palette.colors.texels[first..][..per_splat];
            for (harmonic, [red, green, blue, _]) in splat.harmonics.iter_mut().zip(entry) {
                *harmonic = [red, green, blue].map(|byte| palette.values[usize::from(*byte)]);
            }
        }
        Ok(splat)
    }
}

impl Means {
    fn center(&self, index: usize) -> [f32; 3] {
        let (low, high) = (self.low.texels[index], self.high.texels[index]);
        [0, 1, 2].map(|axis| {
            let place = f64::from(u16::from_le_bytes([low[axis], high[axis]])) / 65535.0;
            let logarithm = self.mins[axis] + (self.maxs[axis] - self.mins[axis]) * place;
            logarithm.abs().exp_m1().copysign(logarithm) as f32
        })
    }
}

/// w x y z of the three smallest and, in alpha, which is the largest; NaN where it is none of them.
fn rotation([a, b, c, largest]: [u8; 4]) -> [f32; 4] {
    let Some(largest) = largest.checked_sub(252) else { return [f32::NAN; 4] };
    let small = [a, b, c].map(|byte| (f32::from(byte) / 255.0 * 2.0 - 1.0) * FRAC_1_SQRT_2);
    let missing = (1.0 - small.iter().map(|c| c * c).sum::<f32>()).max(0.0).sqrt();
    let [a, b, c] = small;
    match largest {
        0 => [missing, a, b, c],
        1 => [a, missing, b, c],
        2 => [a, b, missing, c],
        _ => [a, b, c, missing],
    }
}

/// The degree and the number of entries of a palette of that image.
fn palette_shape(
    degree: Option<u8>,
    count: Option<usize>,
    (width, height): (usize, usize),
) -> Result<(u8, usize), String> {
    let per_splat = |degree: u8| (usize::from(degree) + 1).pow(2) - 1;
    let by_width = (1..=3).find(|degree| ENTRIES * per_splat(*degree) == width);
    let Some(degree) = by_width.filter(|found| degree.is_none_or(|said| said == *found)) else {
        let said = degree.map_or_else(String::new, |degree| format!(" of degree {degree}"));
        return Err(format!(
            "the palette of harmonics{said} is {width} texels wide; degrees 1, 2, 3 need 192, 512, 960"
        ));
    };
    let room = ENTRIES * height;
    let count = count.unwrap_or(room);
    if count > room {
        return Err(format!("the palette has {count} entries; its image has room for {room}"));
    }
    Ok((degree, count))
}
