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
use crate::columns::LANES;
use crate::cull::{Frustum, VisibleRange};
use crate::grow::grow;
use crate::occlusion::Looked;
use crate::order::Run;
use crate::scene::{RenderSettings, Scene};
use crate::shade::Shader;
use crate::simd::Level;
use rayon::prelude::*;
use scalar::{Projector, View};
use std::sync::atomic::AtomicU32;
use wide::{Blocks, WideProjector};

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
/// First it is found which blocks of each visible range are projected. Every few ranges have as many places as these have splats, of which
/// the first are taken: so they are projected side by side, and the places say the same for any number of threads.
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
    /// By range.
    tallies: Vec<Tally>,
    /// What is projected of each range.
    blocks: Vec<Blocks>,
    /// How many places there are so far.
    used: usize,
}

/// Ranges that are projected one after the other.
const RANGES_TOGETHER: usize = 4;

/// What became of the splats of a range.
#[derive(Clone, Copy, Default)]
struct Tally {
    forms: [u32; Form::ALL.len()],
    behind_cuts: u32,
}

/// Where the records of one range go, at least [`LANES`] places more than there are.
struct Places<'a> {
    records: &'a mut [Record],
    rects: &'a mut [Rect],
    distances: &'a mut [AtomicU32],
    /// As many, or none.
    samples: &'a mut [SurfaceSample],
    run: &'a mut Run,
    tally: &'a mut Tally,
}

/// Where the records of ranges go that are projected together.
struct Slots<'a> {
    start: usize,
    records: &'a mut [Record],
    rects: &'a mut [Rect],
    distances: &'a mut [AtomicU32],
    samples: &'a mut [SurfaceSample],
}

impl Slots<'_> {
    /// Parts with the first places; of the samples with as many, if there are any.
    fn split(&mut self, count: usize) -> Self {
        let start = self.start;
        self.start += count;
        Self {
            start,
            records: self.records.split_off_mut(..count).unwrap_or_default(),
            rects: self.rects.split_off_mut(..count).unwrap_or_default(),
            distances: self.distances.split_off_mut(..count).unwrap_or_default(),
            samples: self.samples.split_off_mut(..count).unwrap_or_default(),
        }
    }
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
        self.tally.forms[record.tag.form as usize] += 1;
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
        std::array::from_fn(|form| self.tallies.iter().map(|tally| u64::from(tally.forms[form])).sum())
    }

    /// How many splats in the picture have none, since they lie behind cuts.
    pub(crate) fn behind_cuts(&self) -> u64 {
        self.tallies.iter().map(|tally| u64::from(tally.behind_cuts)).sum()
    }

    /// Forgets all records.
    pub(crate) fn clear(&mut self) {
        self.runs.clear();
        self.tallies.clear();
        self.used = 0;
    }

    /// Projects those of a scene's ranges that are `chosen`, behind what there is; runs come in the same order.
    pub(crate) fn append(&mut self, view: &SceneView, ranges: &[VisibleRange], chosen: &[u32]) {
        let frustum = Frustum::new(view.camera);
        let blocks = |rank: &u32| {
            let range = &ranges[*rank as usize];
            let is_inside = frustum.is_between_sides(range.center_in_camera, range.reach);
            if is_inside && range.is_chosen_whole() && (range.is_surface || view.looked.is_none()) {
                return Blocks::all(range);
            }
            WideProjector::new(&view.projector(range)).blocks(view.level, range)
        };
        chosen.par_iter().with_min_len(RANGES_TOGETHER).map(blocks).collect_into_vec(&mut self.blocks);
        let places = |blocks: &[Blocks]| blocks.iter().map(|blocks| blocks.count).sum::<usize>() + LANES;
        let (begin, start) = (self.runs.len(), self.used);
        self.used += self.blocks.chunks(RANGES_TOGETHER).map(places).sum::<usize>();
        // Volumes have no samples.
        let samples = if ranges.iter().any(|range| range.is_surface) { self.used } else { 0 };
        grow(&mut self.records, self.used, || Record::BLANK);
        grow(&mut self.rects, self.used, Rect::default);
        grow(&mut self.distances, self.used, AtomicU32::default);
        grow(&mut self.samples, samples, SurfaceSample::default);
        self.runs.resize(begin + chosen.len(), Run::new(0));
        self.tallies.resize(begin + chosen.len(), Tally::default());
        let mut rest = Slots {
            start,
            records: &mut self.records[start..],
            rects: &mut self.rects[start..],
            distances: &mut self.distances[start..],
            samples: self.samples.get_mut(start..).unwrap_or_default(),
        };
        let together = self.blocks.chunks(RANGES_TOGETHER);
        let slots: Vec<Slots> = together.map(|blocks| rest.split(places(blocks))).collect();
        let together = chosen.par_chunks(RANGES_TOGETHER).zip(self.blocks.par_chunks(RANGES_TOGETHER));
        let runs = self.runs[begin..].par_chunks_mut(RANGES_TOGETHER);
        let tallies = self.tallies[begin..].par_chunks_mut(RANGES_TOGETHER);
        slots.into_par_iter().zip(together).zip(runs.zip(tallies)).for_each(
            |((mut slots, (ranks, blocks)), (runs, tallies))| {
                for (((rank, blocks), run), tally) in ranks.iter().zip(blocks).zip(runs).zip(tallies) {
                    *run = Run::new(slots.start);
                    tally.behind_cuts = blocks.behind_cuts;
                    let Slots { records, rects, distances, samples, .. } = &mut slots;
                    let range = &ranges[*rank as usize];
                    let projector = view.projector(range);
                    let mut places = Places { records, rects, distances, samples, run, tally };
                    WideProjector::new(&projector).project(view.level, (range, blocks), &mut places);
                    slots.split(run.len);
                }
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
    /// Of what is drawn of surfaces, if that hides volumes.
    pub(crate) looked: Option<&'a Looked>,
    pub(crate) level: Level,
}

impl SceneView<'_> {
    fn projector(&self, range: &VisibleRange) -> Projector<'_> {
        let Self { scene, camera, settings, shaders, closing, looked, .. } = *self;
        let (lens, frustum) = (Lens::new(camera, settings.low_pass), Frustum::new(camera));
        let view = View { camera, settings, lens, frustum, closing, looked };
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
