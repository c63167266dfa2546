//! Gaussian splats of PLY files; the layout is told in the parent module.

use super::body::Body;
use super::header::{Element, Header, Kind, Property};
use crate::file::File;
use crate::{ImportError, Place};
use glam::{DMat3, DQuat, DVec3, Mat3, Vec3};
use oblate_engine::color::srgb_to_linear;
use oblate_engine::{Harmonics, Material, OpacityFilter, Shapes, Splats, Strength};
use rayon::prelude::*;

/// What every splat has, in the order of a record; after it come the filter and the harmonics.
const NAMES: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
    "rot_1", "rot_2", "rot_3",
];
const COLOR: usize = 3;
const OPACITY: usize = 6;
const SCALES: usize = 7;
const ROTATION: usize = 10;
/// 0 where a file has none.
const FILTER: usize = 14;
const HARMONICS: usize = 15;

/// Smallest and largest number at a place of a record.
const fn range(place: usize) -> [f32; 2] {
    match place {
        OPACITY => [f32::NEG_INFINITY, f32::INFINITY],
        // e^88 is in the range of single precision.
        SCALES..ROTATION => [f32::NEG_INFINITY, 88.0],
        // So are sums of harmonics with such coefficients, decoded to linear.
        COLOR..OPACITY | HARMONICS.. => [-1e12, 1e12],
        _ => [f32::MIN, f32::MAX],
    }
}

/// The spherical harmonic of degree 0, √(1/4π).
const CONSTANT_HARMONIC: f32 = 0.282_094_8;

/// Rows that are read at a time.
const ROWS: usize = 1 << 14;

/// Reads the splats in the order of the file.
pub(super) fn read(file: &File, header: &Header) -> Result<Splats, ImportError> {
    let mut body = Body::new(file, header);
    for element in &header.elements {
        if element.name == "vertex" {
            return read_vertices(file, body, element, trained_filter(header, element));
        }
        drop(body.gather::<f32>(element, &[])?);
    }
    Err(file.malformed(Place::Whole, "splats need an element \"vertex\""))
}

/// What the opacities were trained with: the last comment that says so, or else whether splats have filters.
fn trained_filter(header: &Header, element: &Element) -> OpacityFilter {
    let said = |(_, comment): &(usize, String)| {
        let words: Vec<&str> = comment.split_whitespace().collect();
        match words[..] {
            ["SplatRenderMode:", "default"] | ["antialiased", "0"] => Some(OpacityFilter::Classic),
            ["SplatRenderMode:", "mip"] | ["antialiased", "1"] => Some(OpacityFilter::Compensated),
            _ => None,
        }
    };
    let has_filters = element.kind("filter_3D").is_some();
    let unsaid = if has_filters { OpacityFilter::Compensated } else { OpacityFilter::Classic };
    header.comments.iter().rev().find_map(said).unwrap_or(unsaid)
}

fn read_vertices(
    file: &File,
    body: Body<'_>,
    element: &Element,
    filter: OpacityFilter,
) -> Result<Splats, ImportError> {
    let layout = Layout::new(file, element)?;
    let count = element.rows;
    let (bodies, rows) = body.split(element, ROWS)?;
    let mut centers = vec![Vec3::ZERO; count];
    let mut factors = vec![Mat3::ZERO; count];
    let mut peaks = vec![0.0; count];
    let mut colors = vec![[0.0; 3]; count];
    let mut coefficients = vec![[0.0; 3]; count * layout.per_splat];

    // Parts write to their places: nothing is held twice.
    let mut rest = &mut coefficients[..];
    let parts: Vec<Part<'_>> = bodies
        .into_iter()
        .zip(centers.chunks_mut(rows).zip(factors.chunks_mut(rows)))
        .zip(peaks.chunks_mut(rows).zip(colors.chunks_mut(rows)))
        .enumerate()
        .map(|(part, ((body, (centers, factors)), (peaks, colors)))| {
            let coefficients = rest.split_off_mut(..centers.len() * layout.per_splat).unwrap_or_default();
            Part { first_row: part * rows, body, centers, factors, peaks, colors, coefficients }
        })
        .collect();
    let read: Vec<_> = parts.into_par_iter().map(|part| part.read(file, element, &layout)).collect();
    // What is wrong first in the file is said, whoever came upon something first.
    let dropped = read.into_iter().collect::<Result<Vec<_>, _>>()?.concat();
    if !dropped.is_empty() {
        drop_rows(&mut centers, 1, &dropped);
        drop_rows(&mut factors, 1, &dropped);
        drop_rows(&mut peaks, 1, &dropped);
        drop_rows(&mut colors, 1, &dropped);
        drop_rows(&mut coefficients, layout.per_splat, &dropped);
    }
    if centers.is_empty() {
        let problem = format!(
            "there are no splats in it ({count} rows, {} of them left out for a quaternion of zeros); at least one is \
             needed",
            dropped.len()
        );
        return Err(file.malformed(Place::Whole, problem));
    }
    Ok(Splats {
        centers,
        shapes: Shapes::Each(factors),
        strength: Strength::Opacity { peaks, filter },
        colors,
        harmonics: (layout.degree > 0).then_some(Harmonics { degree: layout.degree, coefficients }),
        normals: None,
        material: Material::UNLIT,
    })
}

fn drop_rows<T>(values: &mut Vec<T>, per_row: usize, dropped: &[usize]) {
    let mut index = 0;
    values.retain(|_| {
        let row = index / per_row;
        index += 1;
        dropped.binary_search(&row).is_err()
    });
}

/// Where a row's properties belong.
struct Layout {
    /// The names of a record's places.
    names: Vec<String>,
    ranges: Vec<[f32; 2]>,
    /// The place in a record of each property that is wanted.
    places: Vec<Option<usize>>,
    degree: u8,
    /// Coefficients of each channel.
    per_splat: usize,
}

impl Layout {
    fn new(file: &File, element: &Element) -> Result<Self, ImportError> {
        let malformed = |problem| Err(file.malformed(Place::Whole, problem));
        if let Some(missing) = NAMES.iter().find(|name| element.kind(name).is_none()) {
            let problem = format!(
                "vertices have no property {missing}; splats need x y z, f_dc_0..2, opacity, scale_0..2, rot_0..3"
            );
            return malformed(problem);
        }
        let numbered = element.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count();
        let Some(degree) = [0, 9, 24, 45].iter().position(|n| *n == numbered) else {
            let problem = format!(
                "vertices have {numbered} properties f_rest_*; splats have none, 9, 24 or 45, for harmonics up to \
                 degree 0, 1, 2 or 3"
            );
            return malformed(problem);
        };
        let rest: Vec<String> = (0..numbered).map(|i| format!("f_rest_{i}")).collect();
        if let Some(missing) = rest.iter().find(|name| element.kind(name).is_none()) {
            let last = numbered - 1;
            return malformed(format!(
                "vertices have {numbered} properties f_rest_*, but no {missing}; they are f_rest_0 to f_rest_{last}"
            ));
        }
        let names: Vec<String> =
            NAMES.into_iter().chain(["filter_3D"]).map(str::to_owned).chain(rest).collect();
        let place = |property: &Property| names.iter().position(|name| *name == property.name);
        let places: Vec<Option<usize>> = element.properties.iter().map(place).collect();
        let is_list = |(property, place): (&Property, &Option<usize>)| {
            (place.is_some() && matches!(property.kind, Kind::List { .. })).then(|| property.name.clone())
        };
        if let Some(list) = element.properties.iter().zip(&places).find_map(is_list) {
            return malformed(format!("vertex property {list:?} must not be a list"));
        }
        let ranges = (0..names.len()).map(range).collect();
        Ok(Self { names, ranges, places, degree: degree as u8, per_splat: numbered / 3 })
    }

    /// That a splat can be made of a record.
    fn check(&self, record: &[f32]) -> Result<(), String> {
        let wrong = |(value, [low, high]): (&f32, &[f32; 2])| !(low <= value && value <= high);
        let Some(place) = record.iter().zip(&self.ranges).position(wrong) else { return Ok(()) };
        let (name, value, [low, high]) = (&self.names[place], record[place], self.ranges[place]);
        Err(format!("{name} is {value}; it must be a number from {low:?} to {high:?}"))
    }

    /// The splat of a record; `None` without an orientation.
    fn activate(&self, record: &[f32]) -> Option<Splat> {
        let [w, x, y, z] = [0, 1, 2, 3].map(|i| f64::from(record[ROTATION + i]));
        let quaternion = DQuat::from_xyzw(x, y, z, w);
        if quaternion.length_squared() == 0.0 {
            return None;
        }
        let trained = DVec3::from([0, 1, 2].map(|i| f64::from(record[SCALES + i]).exp()));
        let filter = f64::from(record[FILTER]);
        let filtered = DVec3::from(trained.to_array().map(|sigma| sigma.hypot(filter)));
        // What the filter adds to the volume it takes from the peak.
        let share = if filter == 0.0 { 1.0 } else { (trained / filtered).element_product() };
        let peak = share / (1.0 + (-f64::from(record[OPACITY])).exp());
        let color = [0, 1, 2].map(|i| {
            let display = 0.5 + CONSTANT_HARMONIC * record[COLOR + i];
            // With harmonics only the sum is cut off.
            srgb_to_linear(if self.degree == 0 { display.max(0.0) } else { display })
        });
        let factor = DMat3::from_quat(quaternion.normalize()) * DMat3::from_diagonal(filtered);
        let center = Vec3::from_slice(&record[..COLOR]);
        Some(Splat { center, factor: factor.as_mat3(), peak: peak as f32, color })
    }
}

struct Splat {
    center: Vec3,
    factor: Mat3,
    peak: f32,
    color: [f32; 3],
}

/// Some of the rows and the places of their splats.
struct Part<'a> {
    first_row: usize,
    body: Body<'a>,
    centers: &'a mut [Vec3],
    factors: &'a mut [Mat3],
    peaks: &'a mut [f32],
    colors: &'a mut [[f32; 3]],
    coefficients: &'a mut [[f32; 3]],
}

impl Part<'_> {
    /// Fills the places; gives the rows that make no splat.
    fn read(mut self, file: &File, element: &Element, layout: &Layout) -> Result<Vec<usize>, ImportError> {
        let mut dropped = Vec::new();
        let per_splat = layout.per_splat;
        let mut record = vec![0.0; HARMONICS + 3 * per_splat];
        for index in 0..self.centers.len() {
            let row = self.first_row + index;
            self.body.record(element, row, &layout.places, &mut record)?;
            let wrong = |problem| file.malformed(Place::Part(format!("vertex {row}")), problem);
            layout.check(&record).map_err(wrong)?;
            let Some(splat) = layout.activate(&record) else {
                dropped.push(row);
                continue;
            };
            self.centers[index] = splat.center;
            self.factors[index] = splat.factor;
            self.peaks[index] = splat.peak;
            self.colors[index] = splat.color;
            let colors = &mut self.coefficients[index * per_splat..][..per_splat];
            for (number, color) in colors.iter_mut().enumerate() {
                // All of a channel stand together in the file.
                *color = [0, 1, 2].map(|channel| record[HARMONICS + channel * per_splat + number]);
            }
        }
        Ok(dropped)
    }
}
