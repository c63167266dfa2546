//! Points of PLY files.

use super::body::Body;
use super::header::{Element, Header, Kind, Property};
use crate::file::{File, quoted};
use crate::points::{Gather, Has, Point};
use crate::{ImportError, Note, Opened, Place};
use glam::{DVec3, Vec3};

/// Where a point's numbers stand in a record.
const POSITION: usize = 0;
const COLOR: usize = 3;
const NORMAL: usize = 6;
const INTENSITY: usize = 9;
const RADIUS: usize = 10;
const NUMBERS: usize = 11;

/// Names of each number, by which come first.
const NAMES: [(usize, &[&str]); 10] = [
    (POSITION, &["x"]),
    (POSITION + 1, &["y"]),
    (POSITION + 2, &["z"]),
    (COLOR, &["red", "diffuse_red", "r"]),
    (COLOR + 1, &["green", "diffuse_green", "g"]),
    (COLOR + 2, &["blue", "diffuse_blue", "b"]),
    (NORMAL, &["nx", "normal_x"]),
    (NORMAL + 1, &["ny", "normal_y"]),
    (NORMAL + 2, &["nz", "normal_z"]),
    (RADIUS, &["radius"]),
];

/// The beginning of names of attributes that some programs give points.
const ATTRIBUTE: &str = "scalar_";

/// Reads points: the vertices of a file without faces.
pub(super) fn read(file: &File, header: &Header, element: &Element) -> Result<Opened, ImportError> {
    let mut places: Vec<Option<usize>> = vec![None; element.properties.len()];
    let first = |is: &dyn Fn(&str) -> bool| element.properties.iter().position(|property| is(&property.name));
    let property = |name: &str| {
        first(&|other| other == name).or_else(|| first(&|other| other.eq_ignore_ascii_case(name)))
    };
    for (number, names) in NAMES {
        if let Some(index) = names.iter().find_map(|name| property(name)) {
            places[index] = Some(number);
        }
    }
    let attribute = || element.properties.iter().position(|property| property.name.starts_with(ATTRIBUTE));
    let intensities = ["intensity", "scalar_intensity"];
    if let Some(index) = intensities.iter().find_map(|name| property(name)).or_else(attribute) {
        places[index] = Some(INTENSITY);
    }
    let list = |(property, place): (&Property, &Option<usize>)| {
        (place.is_some() && matches!(property.kind, Kind::List { .. })).then(|| property.name.clone())
    };
    if let Some(name) = element.properties.iter().zip(&places).find_map(list) {
        return Err(file.malformed(Place::Whole, format!("vertex property {name:?} must not be a list")));
    }
    let three = |first: usize| (first..first + 3).all(|number| places.contains(&Some(number)));
    if !three(POSITION) {
        return Err(file.malformed(Place::Whole, "element \"vertex\" must have properties x, y and z"));
    }
    let has = Has {
        colors: three(COLOR),
        intensities: places.contains(&Some(INTENSITY)),
        normals: three(NORMAL),
        radii: places.contains(&Some(RADIUS)),
    };
    let largest = |channel: usize| {
        let found =
            element.properties.iter().zip(&places).find(|(_, place)| **place == Some(COLOR + channel));
        found.and_then(|(property, _)| match property.kind {
            Kind::Scalar(scalar) => scalar.integer_max(),
            Kind::List { .. } => None,
        })
    };
    let [red, green, blue] = [0, 1, 2].map(largest);
    if has.colors && (red != green || red != blue) {
        return Err(file.malformed(Place::Whole, "red, green and blue of vertices must be of one type"));
    }
    let mut body = Body::at(file, header, element)?;
    let mut gather = Gather::new(element.rows, has);
    body.records(element, &places, &mut [0.0_f64; NUMBERS], |record| {
        let three = |at: usize| [record[at], record[at + 1], record[at + 2]];
        gather.put(&Point {
            position: DVec3::from(three(POSITION)),
            color: three(COLOR).map(|c| c as f32),
            normal: Vec3::from(three(NORMAL).map(|c| c as f32)),
            intensity: record[INTENSITY] as f32,
            radius: record[RADIUS] as f32,
        });
    })?;
    let last = header.elements.iter().rfind(|other| other.rows > 0);
    // Where the header says it, that was compared with the file's size.
    if header.end().is_none() && last.is_some_and(|last| last.name == element.name) {
        gather.notes.extend(body.rest());
    }
    let white = has.colors.then(|| white(&mut gather, red.map(|largest| largest as f32)));
    gather.decode_colors(white);
    for other in header.elements.iter().filter(|other| other.name != element.name && other.rows > 0) {
        gather.notes.push(Note::LeftOut(format!("{} rows of element {}", other.rows, quoted(&other.name))));
    }
    gather.finish(file)
}

/// The brightest colour's value: by rights 1 of floating point, the type's `largest` of integers; else, which is noted, that
/// of 8 or 16 bits where all colours keep to it, as some programs write them in wider types.
fn white(gather: &mut Gather, largest: Option<f32>) -> f32 {
    let brightest = gather.brightest();
    let meant = largest.unwrap_or(1.0);
    // Floating point a little above 1 is a bright colour; nothing in 8 bits would be as dark.
    let right = if largest.is_some() { brightest == 0.0 || meant <= 255.0 } else { brightest <= 2.0 };
    let narrower = || gather.white(&[255.0, 65535.0]).filter(|white| largest.is_none() || *white < meant);
    match narrower().filter(|_| !right) {
        Some(white) => {
            let what = format!("colours go up to {white}, though those of their type go up to {meant}");
            gather.notes.push(Note::Assumed(what));
            white
        }
        None => meant,
    }
}
