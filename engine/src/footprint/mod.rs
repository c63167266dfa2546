//! Stage `footprint`: visible splats to screen-space records, each with the cheapest form that its share of
//! the tolerance allows.

mod ewa;
mod record;
mod scalar;
mod wide;

pub use ewa::{CameraSplat, Footprint, Hit, Lens};
pub use record::{Form, Kind, Record, RecordHit, Rect, Tag};

use crate::camera::Camera;
use crate::closing::Closing;
use crate::cull::{CLUSTER_SIZE, Frustum, VisibleRange};
use crate::order::Run;
use crate::scene::{RenderSettings, Scene};
use crate::shade::Shader;
use crate::simd::Level;
use rayon::prelude::*;
use scalar::{Projector, View};
use std::sync::atomic::AtomicU32;
use wide::WideProjector;

/// Mass outside r ≤ ρ is e^{−ρ/2} of the whole; what is kept is raised to carry it.
pub(crate) fn cutoff_gain(cutoff: f64) -> f64 {
    -1.0 / (-0.5 * cutoff).exp_m1()
}

/// What the layers need of a surface record besides its geometry.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SurfaceSample {
    /// Unit shading normal in camera space.
    pub(crate) normal: [f32; 3],
    /// Opacity of the surface there.
    pub(crate) opacity: f32,
    /// The splat's number in the scene.
    pub(crate) id: u32,
}

/// What is drawn of one splat.
struct Projected {
    record: Record,
    rect: Rect,
    /// What volumes are sorted by, and surfaces roughly: from the eye, or z where rays are parallel; or the first slab.
    distance: f32,
    sample: SurfaceSample,
}

/// The records of a frame's volumes, or of its surfaces; parallel arrays.
///
/// Every visible range has [`CLUSTER_SIZE`] places, of which the first are taken: so ranges are projected side by
/// side, and the places say the same for any number of threads.
#[derive(Default)]
pub(crate) struct Records {
    pub(crate) records: Vec<Record>,
    pub(crate) rects: Vec<Rect>,
    /// Bits of the distances; sorting takes these places for the order.
    pub(crate) distances: Vec<AtomicU32>,
    /// Of surfaces; empty for volumes.
    pub(crate) samples: Vec<SurfaceSample>,
    /// The places taken.
    pub(crate) runs: Vec<Run>,
    /// How many there are of each form, by range.
    forms: Vec<[u32; Form::ALL.len()]>,
}

/// Where the records of one range go.
struct Places<'a> {
    records: &'a mut [Record; CLUSTER_SIZE],
    rects: &'a mut [Rect; CLUSTER_SIZE],
    distances: &'a mut [AtomicU32; CLUSTER_SIZE],
    /// As many, or none.
    samples: &'a mut [SurfaceSample],
    run: &'a mut Run,
    forms: &'a mut [u32; Form::ALL.len()],
}

impl Places<'_> {
    fn push(&mut self, splat: Projected) {
        let Projected { record, rect, distance, sample } = splat;
        let place = self.run.len;
        self.records[place] = record;
        self.rects[place] = rect;
        *self.distances[place].get_mut() = distance.to_bits();
        if let Some(slot) = self.samples.get_mut(place) {
            *slot = sample;
        }
        self.forms[record.tag.form as usize] += 1;
        self.run.include([distance; 2]);
        self.run.len = place + 1;
    }

    /// Puts the last splat before the one at `place`.
    fn move_last_to(&mut self, place: usize) {
        let moved = place..self.run.len;
        self.records[moved.clone()].rotate_right(1);
        self.rects[moved.clone()].rotate_right(1);
        self.distances[moved.clone()].rotate_right(1);
        if let Some(samples) = self.samples.get_mut(moved) {
            samples.rotate_right(1);
        }
    }
}

impl Records {
    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        self.runs.iter().map(|run| run.len).sum()
    }

    /// How many there are of each form.
    pub(crate) fn forms(&self) -> [u64; Form::ALL.len()] {
        std::array::from_fn(|form| self.forms.iter().map(|count| u64::from(count[form])).sum())
    }

    /// Forgets all records.
    pub(crate) fn clear(&mut self) {
        self.runs.clear();
        self.forms.clear();
    }

    /// Projects those of a scene's ranges that are `chosen`, behind what there is; runs come in the same order.
    pub(crate) fn append(&mut self, view: &SceneView, ranges: &[VisibleRange], chosen: &[u32]) {
        let begin = self.runs.len();
        let count = begin + chosen.len();
        let places = count * CLUSTER_SIZE;
        // Volumes have no samples: one place a range is as good as none.
        let samples_a_range = if ranges.iter().any(|range| range.is_surface) { CLUSTER_SIZE } else { 1 };
        let samples = count * samples_a_range;
        self.records.resize(places.max(self.records.len()), Record::BLANK);
        self.rects.resize(places.max(self.rects.len()), Rect::default());
        self.distances.resize_with(places.max(self.distances.len()), AtomicU32::default);
        self.samples.resize(samples.max(self.samples.len()), SurfaceSample::default());
        self.runs.extend((begin..count).map(|number| Run::new(number * CLUSTER_SIZE)));
        self.forms.resize(count, [0; Form::ALL.len()]);
        let records = self.records.as_chunks_mut().0[begin..].par_iter_mut();
        let rects = self.rects.as_chunks_mut().0[begin..].par_iter_mut();
        let distances = self.distances.as_chunks_mut().0[begin..].par_iter_mut();
        let samples = self.samples[begin * samples_a_range..].par_chunks_mut(samples_a_range);
        let places = records.zip(rects).zip(distances).zip(samples);
        chosen.par_iter().zip(&mut self.runs[begin..]).zip(&mut self.forms[begin..]).zip(places).for_each(
            |(((range, run), forms), (((records, rects), distances), samples))| {
                let range = &ranges[*range as usize];
                let mut places = Places { records, rects, distances, samples, run, forms };
                let projector = view.projector(range);
                WideProjector::new(&projector).project(view.level, range, &mut places);
            },
        );
    }
}

/// A scene as a camera sees it.
pub(crate) struct SceneView<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) camera: &'a Camera,
    pub(crate) settings: &'a RenderSettings,
    /// One a cloud.
    pub(crate) shaders: &'a [Shader],
    pub(crate) closing: Closing,
    pub(crate) level: Level,
}

impl SceneView<'_> {
    fn projector(&self, range: &VisibleRange) -> Projector<'_> {
        let Self { scene, camera, settings, shaders, .. } = *self;
        let (lens, frustum) = (Lens::new(camera, settings.low_pass), Frustum::new(camera));
        let view = View { camera, settings, lens, frustum, closing: self.closing };
        Projector::new(
            (&scene.clouds[range.cloud], range.level),
            range.cloud as u16,
            &shaders[range.cloud],
            view,
        )
    }
}

#[cfg(test)]
mod tests;
