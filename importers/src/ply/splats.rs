//! Gaussian splats of PLY files; the layout is told in the parent module.

use super::body::Body;
use super::header::{Element, Header, Kind, Property};
use super::mode::Mode;
use super::seen::Seen;
use super::table::Table;
use crate::file::File;
use crate::scalar::Scalar;
use crate::source::Source;
use crate::splats::{Sink, Trained, Training, color, gather};
use crate::{ImportError, Note, Opened, Place};
use oblate_engine::{Blend, OpacityFilter};
use std::sync::{Mutex, PoisonError};

/// What every splat has, in the order of a record; after it come colours, the filter and the harmonics.
const NAMES: [&str; 11] =
    ["x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
const OPACITY: usize = 3;
const SCALES: usize = 4;
const ROTATION: usize = 7;
const COLOR: usize = 11;
/// 0 where a file has none.
const FILTER: usize = 14;
const HARMONICS: usize = 15;

const COEFFICIENTS: [&str; 3] = ["f_dc_0", "f_dc_1", "f_dc_2"];
const CHANNELS: [&str; 3] = ["red", "green", "blue"];

/// Reads the splats that `vertex` has.
pub(super) fn read(source: Source, header: &Header, vertex: &Element) -> Result<Opened, ImportError> {
    let layout = Layout::new(&source.head, vertex)?;
    let (mode, contradiction) = Mode::said(header);
    let unsaid = if layout.filtered { OpacityFilter::Compensated } else { OpacityFilter::Classic };
    let filter = mode.filter.unwrap_or(unsaid);
    let training = Training { degree: layout.degree, filter, blend: Blend::Display };
    let all_seen = Mutex::new(Seen::default());
    let put = |record: &[f32], sink: &mut Sink<'_>, (trained, seen): &mut (Trained, Seen)| {
        layout.fill(trained, record);
        if sink.put(trained) {
            seen.add(record[OPACITY], trained);
        }
    };
    let mut opened = match Table::find(&source, header, vertex, &layout.places)? {
        Some(table) => {
            let opened = gather(&source.head, (vertex.rows, table.block()), training, |rows, sink| {
                let mut state = Default::default();
                table.records(rows, &mut layout.record(), |record| put(record, sink, &mut state))?;
                state.1.merge_into(&all_seen);
                Ok(())
            })?;
            source.finish();
            opened
        }
        None => {
            let file = &source.into_file()?;
            let body = Body::at(file, header, vertex)?;
            gather(file, (vertex.rows, vertex.rows.max(1)), training, |_, sink| {
                let mut state = Default::default();
                body.clone().records(vertex, &layout.places, &mut layout.record(), |record| {
                    put(record, sink, &mut state);
                })?;
                state.1.merge_into(&all_seen);
                Ok(())
            })?
        }
    };
    let seen = all_seen.into_inner().unwrap_or_else(PoisonError::into_inner);
    opened.notes.extend(contradiction);
    opened.notes.extend(layout.notes(mode, &seen));
    opened.notes.extend(seen.doubts());
    Ok(opened)
}

/// Where a row's properties belong.
struct Layout {
    /// The place in a record of each property that is wanted.
    places: Vec<Option<usize>>,
    degree: u8,
    /// Coefficients of each channel.
    per_splat: usize,
    /// What `red green blue` are divided with; `None` where there are coefficients instead.
    channel_max: Option<[f32; 3]>,
    filtered: bool,
    /// Without a third scale.
    flat: bool,
}

impl Layout {
    fn new(file: &File, element: &Element) -> Result<Self, ImportError> {
        let malformed = |problem| Err(file.malformed(Place::Whole, problem));
        let has = |name: &str| element.kind(name).is_some();
        let any_coefficient = COEFFICIENTS.iter().any(|name| has(name));
        let in_channels = !any_coefficient && CHANNELS.iter().all(|name| has(name));
        let colors = if in_channels { CHANNELS } else { COEFFICIENTS };
        let mut needed = NAMES.iter().chain(&colors).filter(|name| **name != "scale_2");
        if let Some(missing) = needed.find(|name| !has(name)) {
            let problem = format!(
                "vertices have no property {missing}; splats need x y z, f_dc_0..2 (or red green blue), opacity, \
                 scale_0..1 (and scale_2, where they aren't flat), rot_0..3"
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
        if let Some(missing) = rest.iter().find(|name| !has(name)) {
            let last = numbered - 1;
            return malformed(format!(
                "vertices have {numbered} properties f_rest_*, but no {missing}; they are f_rest_0 to f_rest_{last}"
            ));
        }
        let names = NAMES.into_iter().chain(colors).chain(["filter_3D"]).map(str::to_owned);
        let names: Vec<String> = names.chain(rest).collect();
        let place = |property: &Property| names.iter().position(|name| *name == property.name);
        let places: Vec<Option<usize>> = element.properties.iter().map(place).collect();
        let is_list = |(property, place): (&Property, &Option<usize>)| {
            (place.is_some() && matches!(property.kind, Kind::List { .. })).then(|| property.name.clone())
        };
        if let Some(list) = element.properties.iter().zip(&places).find_map(is_list) {
            return malformed(format!("vertex property {list:?} must not be a list"));
        }
        let channel_max = |name: &str| match element.kind(name) {
            Some(Kind::Scalar(Scalar::U8)) => Some(f32::from(u8::MAX)),
            Some(Kind::Scalar(Scalar::U16)) => Some(f32::from(u16::MAX)),
            _ => None,
        };
        let channel_max = match CHANNELS.map(channel_max) {
            _ if !in_channels => None,
            [Some(red), Some(green), Some(blue)] => Some([red, green, blue]),
            _ => return malformed("red green blue of splats must be uchar or ushort".into()),
        };
        Ok(Self {
            places,
            degree: degree as u8,
            per_splat: numbered / 3,
            channel_max,
            filtered: has("filter_3D"),
            flat: !has("scale_2"),
        })
    }

    /// A record that properties are read to.
    fn record(&self) -> Vec<f32> {
        let mut record = vec![0.0; HARMONICS + 3 * self.per_splat];
        record[SCALES + 2] = f32::NEG_INFINITY;
        record
    }

    /// Makes `trained`, which is the default one or another splat of the same file, the splat of a record.
    fn fill(&self, trained: &mut Trained, record: &[f32]) {
        let found = [0, 1, 2].map(|i| record[COLOR + i]);
        trained.center = [0, 1, 2].map(|i| record[i]);
        trained.log_scales = [0, 1, 2].map(|i| record[SCALES + i]);
        trained.rotation = [0, 1, 2, 3].map(|i| record[ROTATION + i]);
        trained.opacity = (1.0 / (1.0 + (-f64::from(record[OPACITY])).exp())) as f32;
        trained.color = match self.channel_max {
            None => color(found),
            Some(max) => [0, 1, 2].map(|i| found[i] / max[i]),
        };
        trained.filter = record[FILTER];
        // All of a channel stand together in the file.
        let [red, green, blue] =
            [0, 1, 2].map(|channel| &record[HARMONICS + channel * self.per_splat..][..self.per_splat]);
        let channels = red.iter().zip(green).zip(blue);
        for (harmonic, ((red, green), blue)) in trained.harmonics.iter_mut().zip(channels) {
            *harmonic = [*red, *green, *blue];
        }
    }

    /// What is missing, and where header and splats contradict each other.
    fn notes(&self, mode: Mode, seen: &Seen) -> Vec<Note> {
        let mut notes = Vec::new();
        let mut assume = |what: &str| notes.push(Note::Assumed(what.into()));
        match (self.flat, mode.flat) {
            (true, Some(false)) => assume(
                "splats have no scale_2, which makes them flat (2DGS), though the header says that they aren't 2DGS",
            ),
            (true, _) => assume("splats have no scale_2: they are flat (2DGS)"),
            (false, Some(true)) if !seen.is_flat() => {
                assume("the header says 2DGS, but splats have a third half-axis; they are drawn with it");
            }
            _ => {}
        }
        if self.filtered && mode.filter == Some(OpacityFilter::Classic) {
            assume(
                "the header says that opacities were not trained with compensation (no mip mode), though splats have \
                 filter_3D; they are drawn as the header says, with filter_3D in their shapes",
            );
        }
        if self.channel_max.is_some() {
            assume("splats have no f_dc_0..2; red green blue are taken for their colours");
        }
        notes
    }
}
