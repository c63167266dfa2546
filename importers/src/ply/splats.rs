//! Gaussian splats of PLY files; the layout is told in the parent module.

use super::body::Body;
use super::header::{Element, Header, Kind, Property};
use crate::file::File;
use crate::splats::{ROWS, Trained, Training, gather};
use crate::{ImportError, Opened, Place};
use oblate_engine::{Blend, OpacityFilter};

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

/// The spherical harmonic of degree 0, √(1/4π).
const CONSTANT_HARMONIC: f32 = 0.282_094_8;

/// Reads the splats.
pub(super) fn read(file: &File, header: &Header) -> Result<Opened, ImportError> {
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
) -> Result<Opened, ImportError> {
    let layout = Layout::new(file, element)?;
    let (bodies, rows) = body.split(element, ROWS)?;
    let training = Training { degree: layout.degree, filter, blend: Blend::Display };
    gather(file, (element.rows, rows), training, |range, sink| {
        let mut body = bodies[range.start / rows].clone();
        let mut record = vec![0.0; HARMONICS + 3 * layout.per_splat];
        for row in range {
            body.record(element, row, &layout.places, &mut record)?;
            sink.put(&layout.trained(&record));
        }
        Ok(())
    })
}

/// Where a row's properties belong.
struct Layout {
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
        Ok(Self { places, degree: degree as u8, per_splat: numbered / 3 })
    }

    fn trained(&self, record: &[f32]) -> Trained {
        let mut trained = Trained {
            center: [0, 1, 2].map(|i| record[i]),
            log_scales: [0, 1, 2].map(|i| record[SCALES + i]),
            rotation: [0, 1, 2, 3].map(|i| record[ROTATION + i]),
            opacity: (1.0 / (1.0 + (-f64::from(record[OPACITY])).exp())) as f32,
            color: [0, 1, 2].map(|i| 0.5 + CONSTANT_HARMONIC * record[COLOR + i]),
            filter: record[FILTER],
            ..Trained::default()
        };
        // All of a channel stand together in the file.
        for (number, color) in trained.harmonics[..self.per_splat].iter_mut().enumerate() {
            *color = [0, 1, 2].map(|channel| record[HARMONICS + channel * self.per_splat + number]);
        }
        trained
    }
}
