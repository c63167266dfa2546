//! Packed splats; the layout is told in the parent module.

use super::header::{Element, Header, Kind};
use super::mode::Mode;
use super::table::Table;
use crate::scalar::Scalar;
use crate::source::Source;
use crate::splats::packed::within;
use crate::splats::{ROWS, Trained, Training, gather};
use crate::{ImportError, Note, OpenOptions, Opened, Place};
use oblate_engine::{Blend, OpacityFilter};
use std::f64::consts::SQRT_2;

/// Splats that share a chunk.
const CHUNK: usize = 256;

const PACKED: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

/// What each chunk has, in the order of a record.
const RANGES: [&str; 12] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
];
/// What it may have; without it colours are from 0 to 1.
const COLORS: [&str; 6] = ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"];

/// Reads the splats that `vertex` has.
pub(super) fn read(
    source: &Source,
    header: &Header,
    vertex: &Element,
    options: &OpenOptions,
) -> Result<Opened, ImportError> {
    let malformed = |problem| source.head.malformed(Place::Whole, problem);
    let chunk =
        header.element("chunk").ok_or_else(|| malformed("packed splats need an element \"chunk\"".into()))?;
    if chunk.rows != vertex.rows.div_ceil(CHUNK) {
        let expected = vertex.rows.div_ceil(CHUNK);
        let problem = format!(
            "{} chunks for {} splats; {expected} are needed, one for each 256",
            chunk.rows, vertex.rows
        );
        return Err(malformed(problem));
    }
    let with_colors = COLORS.iter().any(|name| chunk.kind(name).is_some());
    let names: Vec<String> =
        RANGES.iter().chain(COLORS.iter().filter(|_| with_colors)).map(|name| (*name).to_owned()).collect();
    let chunks = columns(source, header, chunk, (&names, Scalar::F32))?;
    let vertices = columns(source, header, vertex, (&PACKED.map(String::from), Scalar::U32))?;
    let (degree, coefficients) = match header.element("sh") {
        None => (0, None),
        Some(sh) => {
            let numbered = sh.properties.len();
            let Some(degree) = [9, 24, 45].iter().position(|n| *n == numbered) else {
                let problem =
                    format!("element \"sh\" has {numbered} properties; 9, 24 or 45 f_rest_* are right");
                return Err(malformed(problem));
            };
            if sh.rows != vertex.rows {
                let problem = format!("element \"sh\" has {} rows for {} splats", sh.rows, vertex.rows);
                return Err(malformed(problem));
            }
            let names: Vec<String> = (0..numbered).map(|i| format!("f_rest_{i}")).collect();
            (degree as u8 + 1, Some(columns(source, header, sh, (&names, Scalar::U8))?))
        }
    };
    let (mode, contradiction) = Mode::said(header);
    let flat = mode.flat == Some(true);
    let filter = mode.filter.unwrap_or(OpacityFilter::Classic);
    let training = Training { degree, filter, blend: Blend::Display };
    within(options.max_memory, &source.head, 0, (vertex.rows, training))?;
    let per_splat = training.per_splat();
    let mut opened = gather(&source.head, (vertex.rows, ROWS), training, |rows, sink| {
        let mut ranges: Vec<Ranges> = Vec::with_capacity(ROWS / CHUNK);
        // Without colours of their own they are from 0 to 1.
        let mut record = [0.0_f32; 18];
        record[15..].fill(1.0);
        chunks.records(rows.start / CHUNK..rows.end.div_ceil(CHUNK), &mut record, |record| {
            ranges.push(Ranges::new(record));
        })?;
        let mut harmonics = Vec::with_capacity(rows.len() * per_splat);
        if let Some(coefficients) = &coefficients {
            coefficients.records(rows.clone(), &mut vec![0.0_f32; 3 * per_splat], |record| {
                let color = |i| [0, 1, 2].map(|channel| coefficient(record[channel * per_splat + i]));
                harmonics.extend((0..per_splat).map(color));
            })?;
        }
        let mut index = 0;
        vertices.records(rows, &mut [0.0_f64; 4], |record| {
            let [position, rotation, scale, color] = [0, 1, 2, 3].map(|i| record[i] as u32);
            let mut trained = ranges[index / CHUNK].trained(position, scale, color);
            trained.rotation = unpacked_rotation(rotation);
            if flat {
                trained.log_scales[2] = f32::NEG_INFINITY;
            }
            trained.harmonics[..per_splat].copy_from_slice(&harmonics[index * per_splat..][..per_splat]);
            sink.put(&trained);
            index += 1;
        })
    })?;
    source.finish();
    opened.notes.extend(contradiction);
    if flat {
        let what = "the header says 2DGS: third scales, which packed splats always have, are taken as flat";
        opened.notes.push(Note::Assumed(what.into()));
    }
    Ok(opened)
}

/// The rows of an element that has all these names, of one type.
fn columns<'a>(
    source: &'a Source,
    header: &Header,
    element: &Element,
    (names, scalar): (&[String], Scalar),
) -> Result<Table<'a>, ImportError> {
    let malformed = |problem| Err(source.head.malformed(Place::Whole, problem));
    if let Some(wrong) = names.iter().find(|name| element.kind(name) != Some(Kind::Scalar(scalar))) {
        let kind = match scalar {
            Scalar::U32 => "uint",
            Scalar::U8 => "uchar",
            _ => "float",
        };
        return malformed(format!(
            "packed splats need a property {wrong} of type {kind} in element {:?}",
            element.name
        ));
    }
    let places: Vec<Option<usize>> = element
        .properties
        .iter()
        .map(|property| names.iter().position(|name| *name == property.name))
        .collect();
    match Table::find(source, header, element, &places)? {
        Some(table) => Ok(table),
        None => malformed("packed splats must be in binary rows without lists".into()),
    }
}

/// The ranges of a chunk: the least and the most of each number.
struct Ranges {
    position: [[f64; 3]; 2],
    log_scale: [[f64; 3]; 2],
    color: [[f64; 3]; 2],
}

impl Ranges {
    fn new(record: &[f32]) -> Self {
        let range = |at: usize| [at, at + 3].map(|at| [0, 1, 2].map(|i| f64::from(record[at + i])));
        Self { position: range(0), log_scale: range(6), color: range(12) }
    }

    fn trained(&self, position: u32, scale: u32, color: u32) -> Trained {
        Trained {
            center: between(self.position, by_11_10_11(position)),
            log_scales: between(self.log_scale, by_11_10_11(scale)),
            opacity: share(color, 8) as f32,
            color: between(self.color, [24, 16, 8].map(|shift| share(color >> shift, 8))),
            ..Trained::default()
        }
    }
}

fn between([low, high]: [[f64; 3]; 2], shares: [f64; 3]) -> [f32; 3] {
    [0, 1, 2].map(|i| (low[i] * (1.0 - shares[i]) + high[i] * shares[i]) as f32)
}

/// The lowest bits as a number from 0 to 1.
fn share(value: u32, bits: u32) -> f64 {
    let most = (1 << bits) - 1;
    f64::from(value & most) / f64::from(most)
}

fn by_11_10_11(value: u32) -> [f64; 3] {
    [share(value >> 21, 11), share(value >> 11, 10), share(value, 11)]
}

/// w x y z, of which the largest, by its number in the highest two bits, is what the others leave for unit length.
fn unpacked_rotation(value: u32) -> [f32; 4] {
    let others = [20, 10, 0].map(|shift| (share(value >> shift, 10) - 0.5) * SQRT_2);
    let largest = (1.0 - others.iter().map(|c| c * c).sum::<f64>()).max(0.0).sqrt();
    let [a, b, c] = others;
    let [w, x, y, z] = match value >> 30 {
        0 => [largest, a, b, c],
        1 => [a, largest, b, c],
        2 => [a, b, largest, c],
        _ => [a, b, c, largest],
    };
    [w, x, y, z].map(|c| c as f32)
}

/// Steps are of 1/32 from −4 to 4; a byte is the middle of its step, but for the first and the last.
fn coefficient(byte: f32) -> f32 {
    match byte {
        0.0 => -4.0,
        255.0 => 4.0,
        _ => (byte + 0.5) / 32.0 - 4.0,
    }
}
