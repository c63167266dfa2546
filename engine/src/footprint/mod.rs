//! Stage `footprint`: visible splats to screen-space records, those of surfaces to octets of them, each with the cheapest form that
//! its share of the tolerance allows.

mod ewa;
mod octet;
mod record;
mod scalar;
mod wide;

pub use ewa::{CameraSplat, Footprint, Hit, Lens};
pub(crate) use octet::{Octet, Part};
pub(crate) use record::MOST_END;
pub use record::{Form, Kind, Record, RecordHit, Rect, Tag};
pub(crate) use scalar::EVENLY_COVERED;

use crate::closing::Closing;
use crate::columns::LANES;
use crate::cull::{Frustum, VisibleRange};
use crate::grow::grow;
use crate::occlusion::Looked;
use crate::order::Run;
use crate::shade::Lights;
use crate::simd::Level;
use crate::view::SceneView;
use rayon::prelude::*;
use scalar::{Projector, View};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use wide::{Blocks, WideProjector};

/// Mass outside r ≤ ρ is e^{−ρ/2} of the whole; what is kept is raised to carry it.
pub(crate) fn cutoff_gain(cutoff: f64) -> f64 {
    -1.0 / (-0.5 * cutoff).exp_m1()
}

/// What is drawn of a surfel besides its record.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SurfaceSample {
    /// Unit shading normal in camera space.
    pub(crate) normal: [f32; 3],
    /// Opacity of the surface there.
    pub(crate) opacity: f32,
}

/// What is drawn of one splat.
struct Projected {
    record: Record,
    rect: Rect,
    /// What volumes are sorted by: from the eye, or z where rays are parallel; or the first slab.
    distance: f32,
    sample: SurfaceSample,
}

/// The records of a frame's volumes, or the octets of its surfaces; parallel arrays.
///
/// First it is found which blocks of each visible range are projected. Every few ranges have as many places as these have splats, or
/// blocks of a surface, of which the first are taken: so they are projected side by side, and the places say the same for any number of
/// threads.
#[derive(Default)]
pub(crate) struct Records {
    /// Of volumes.
    pub(crate) records: Vec<Record>,
    /// Of surfaces.
    pub(crate) octets: Vec<Octet>,
    /// Of octets those around all surfels, and [`Rect::NONE`] where these lie apart.
    pub(crate) rects: Vec<Rect>,
    /// Of each surfel.
    pub(crate) own_rects: Vec<[Rect; LANES]>,
    /// Bits of volumes' distances; sorting takes these places for the order.
    pub(crate) distances: Vec<AtomicU32>,
    /// The places taken.
    pub(crate) runs: Vec<Run>,
    /// By range.
    tallies: Vec<Tally>,
    /// What is projected of each range.
    blocks: Vec<Blocks>,
    /// How many places there are so far.
    used: usize,
}

/// Runs whose parts are listed one after the other, at least.
const RUNS_TOGETHER: usize = 64;

/// Ranges that are projected one after the other.
const RANGES_TOGETHER: usize = 4;

/// As a measure how many tiles of a side a rectangle touches in the mean. Surfels are apart, and listed each by itself, where the one
/// around all touches more than theirs together.
fn touched([width, height]: [f32; 2], side: f32) -> f32 {
    (width + side) * (height + side)
}

/// What became of the splats of a range.
#[derive(Clone, Copy, Default)]
struct Tally {
    forms: [u32; Form::ALL.len()],
    behind_cuts: u32,
    /// Of octets.
    parts: u32,
}

/// Where the records of one range go, at least [`LANES`] places more than there are, or its octets.
struct Places<'a> {
    /// Empty for surfaces.
    records: &'a mut [Record],
    /// Empty for volumes.
    octets: &'a mut [Octet],
    own_rects: &'a mut [[Rect; LANES]],
    rects: &'a mut [Rect],
    /// Empty for surfaces.
    distances: &'a mut [AtomicU32],
    run: &'a mut Run,
    tally: &'a mut Tally,
}

/// Where the records of ranges go that are projected together.
struct Slots<'a> {
    start: usize,
    records: &'a mut [Record],
    octets: &'a mut [Octet],
    own_rects: &'a mut [[Rect; LANES]],
    rects: &'a mut [Rect],
    distances: &'a mut [AtomicU32],
}

impl Slots<'_> {
    /// Parts with the first places; of what only one kind has with as many, if there are any.
    fn split(&mut self, count: usize) -> Self {
        let start = self.start;
        self.start += count;
        Self {
            start,
            records: self.records.split_off_mut(..count).unwrap_or_default(),
            octets: self.octets.split_off_mut(..count).unwrap_or_default(),
            own_rects: self.own_rects.split_off_mut(..count).unwrap_or_default(),
            rects: self.rects.split_off_mut(..count).unwrap_or_default(),
            distances: self.distances.split_off_mut(..count).unwrap_or_default(),
        }
    }
}

impl Places<'_> {
    /// Puts a kernel in the next place.
    fn push(&mut self, kernel: Projected) {
        let Projected { record, rect, distance, .. } = kernel;
        let place = self.run.len;
        self.records[place] = record;
        self.rects[place] = rect;
        *self.distances[place].get_mut() = distance.to_bits();
        self.tally.forms[record.tag.form as usize] += 1;
        self.run.include([distance; 2]);
        self.run.len = place + 1;
    }

    /// Puts the last kernel before the one at `place`.
    fn move_last_to(&mut self, place: usize) {
        let moved = place..self.run.len;
        self.records[moved.clone()].rotate_right(1);
        self.rects[moved.clone()].rotate_right(1);
        self.distances[moved].rotate_right(1);
    }

    /// Begins the octet in the next place: of a cloud, and of ids.
    fn begin_octet(&mut self, cloud: u16, ids: [u32; 2]) {
        let octet = &mut self.octets[self.run.len];
        (octet.cloud, octet.ids) = (cloud.into(), ids);
        (octet.seen, octet.are_alike) = (0, false);
    }

    /// Puts a surfel in that octet.
    fn put(&mut self, lane: usize, surfel: &Projected) {
        let place = self.run.len;
        self.octets[place].put(lane, surfel);
        self.own_rects[place][lane] = surfel.rect;
        self.tally.forms[surfel.record.tag.form as usize] += 1;
    }

    /// Finds the rectangle around that octet, for tiles of a side.
    fn bound(&mut self, side: f32) {
        let place = self.run.len;
        let (octet, rects) = (&self.octets[place], &self.own_rects[place]);
        let seen = rects.iter().enumerate().filter(|(lane, _)| octet.seen >> lane & 1 != 0);
        let (around, sum) = seen.fold((Rect::NONE, 0.0), |(around, sum), (_, own)| {
            let lengths = [0, 1].map(|axis| f32::from(own.max[axis] - own.min[axis]));
            (around.around_both(own), sum + touched(lengths, side))
        });
        let lengths = [0, 1].map(|axis| f32::from(around.max[axis].saturating_sub(around.min[axis])));
        self.rects[place] = if touched(lengths, side) > sum { Rect::NONE } else { around };
    }

    /// Keeps that octet if any is seen.
    fn end_octet(&mut self) {
        let place = self.run.len;
        let seen = self.octets[place].seen.count_ones();
        self.tally.parts += if self.rects[place] == Rect::NONE { seen } else { seen.min(1) };
        self.run.len += usize::from(seen > 0);
    }
}

impl Records {
    /// How many places are taken.
    pub(crate) fn len(&self) -> usize {
        self.runs.iter().map(|run| run.len).sum()
    }

    /// How many splats are drawn in each form.
    pub(crate) fn forms(&self) -> [u64; Form::ALL.len()] {
        std::array::from_fn(|form| self.tallies.iter().map(|tally| u64::from(tally.forms[form])).sum())
    }

    /// How many splats are drawn of some runs.
    pub(crate) fn count(&self, of_run: impl Fn(usize) -> bool) -> u64 {
        let own = self.tallies.iter().enumerate().filter(|(run, _)| of_run(*run));
        own.map(|(_, tally)| tally.forms.iter().map(|count| u64::from(*count)).sum::<u64>()).sum()
    }

    /// Writes the numbers of what is listed of octets behind each other, and says how many there are.
    pub(crate) fn list_parts(&self, order: &mut Vec<AtomicU32>) -> usize {
        let count = self.tallies.iter().map(|tally| tally.parts as usize).sum();
        grow(order, count, AtomicU32::default);
        let mut rest = &order[..];
        let slots: Vec<&[AtomicU32]> = self
            .tallies
            .iter()
            .map(|tally| rest.split_off(..tally.parts as usize).unwrap_or_default())
            .collect();
        self.runs.par_iter().zip(slots).with_min_len(RUNS_TOGETHER).for_each(|(run, slots)| {
            let parts =
                run.places().flat_map(|place| Part::of(place, &self.octets[place], &self.rects[place]));
            slots.iter().zip(parts).for_each(|(slot, part)| slot.store(part.0, Relaxed));
        });
        count
    }

    /// The rectangle of a part.
    #[inline(always)]
    pub(crate) fn rect_of(&self, part: Part) -> Rect {
        let place = part.place() as usize;
        part.lane().map_or(self.rects[place], |lane| self.own_rects[place][lane])
    }

    /// Puts runs in the order of their ranks.
    pub(crate) fn sort_runs(&mut self, ranks: &mut [u32]) {
        let runs = ranks.iter().zip(self.runs.drain(..).zip(self.tallies.drain(..)));
        let mut runs: Vec<_> = runs.map(|(rank, run)| (*rank, run)).collect();
        runs.sort_unstable_by_key(|(rank, _)| *rank);
        for ((rank, (run, tally)), place) in runs.into_iter().zip(ranks) {
            *place = rank;
            self.runs.push(run);
            self.tallies.push(tally);
        }
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
    pub(crate) fn append(&mut self, projector: &SceneProjector, ranges: &[VisibleRange], chosen: &[u32]) {
        let frustum = Frustum::new(projector.view.camera);
        let blocks = |rank: &u32| {
            let range = &ranges[*rank as usize];
            let is_inside = frustum.is_between_sides(range.center_in_camera, range.reach);
            if is_inside && range.is_chosen_whole() && (range.is_surface || projector.looked.is_none()) {
                return Blocks::all(range);
            }
            WideProjector::new(&projector.of(range)).blocks(projector.level, range)
        };
        chosen.par_iter().with_min_len(RANGES_TOGETHER).map(blocks).collect_into_vec(&mut self.blocks);
        let is_surface = ranges.iter().any(|range| range.is_surface);
        let places = |blocks: &[Blocks]| {
            let count = |blocks: &Blocks| if is_surface { blocks.len() } else { blocks.count };
            // Eight records are written where one is.
            blocks.iter().map(count).sum::<usize>() + if is_surface { 0 } else { LANES }
        };
        let (begin, start) = (self.runs.len(), self.used);
        self.used += self.blocks.chunks(RANGES_TOGETHER).map(places).sum::<usize>();
        if is_surface {
            assert!(self.used <= Part::MOST_OCTETS, "more surfels are in the picture than can be numbered");
            grow(&mut self.octets, self.used, || Octet::NONE);
            grow(&mut self.own_rects, self.used, || [Rect::NONE; LANES]);
        } else {
            grow(&mut self.records, self.used, || Record::BLANK);
            grow(&mut self.distances, self.used, AtomicU32::default);
        }
        grow(&mut self.rects, self.used, Rect::default);
        self.runs.resize(begin + chosen.len(), Run::new(0));
        self.tallies.resize(begin + chosen.len(), Tally::default());
        let mut rest = Slots {
            start,
            records: self.records.get_mut(start..).unwrap_or_default(),
            octets: self.octets.get_mut(start..).unwrap_or_default(),
            own_rects: self.own_rects.get_mut(start..).unwrap_or_default(),
            rects: &mut self.rects[start..],
            distances: self.distances.get_mut(start..).unwrap_or_default(),
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
                    let Slots { records, octets, own_rects, rects, distances, .. } = &mut slots;
                    let range = &ranges[*rank as usize];
                    let mut places = Places { records, octets, own_rects, rects, distances, run, tally };
                    WideProjector::new(&projector.of(range)).project(
                        projector.level,
                        (range, blocks),
                        &mut places,
                    );
                    slots.split(run.len);
                }
            },
        );
    }
}

/// Projects the ranges of a scene.
pub(crate) struct SceneProjector<'a> {
    pub(crate) view: SceneView<'a>,
    pub(crate) lights: &'a Lights,
    pub(crate) closing: Closing,
    /// Of what is drawn of surfaces, if that hides volumes.
    pub(crate) looked: Option<&'a Looked>,
    /// Pixels in a row of a tile.
    pub(crate) tile_side: usize,
    pub(crate) level: Level,
}

impl SceneProjector<'_> {
    fn of(&self, range: &VisibleRange) -> Projector<'_> {
        let Self { view, lights, closing, looked, tile_side, .. } = *self;
        let SceneView { scene, camera, settings } = view;
        let (lens, frustum) = (view.lens(), Frustum::new(camera));
        let view = View { camera, settings, lens, frustum, closing, looked, tile_side: tile_side as f32 };
        let cloud = &scene.clouds[range.cloud];
        Projector::new(cloud, range, lights.on(cloud.material()), view)
    }
}

#[cfg(test)]
mod tests;
