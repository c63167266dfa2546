//! Stage `cull`, its second part: what is hidden is left out before it is projected.
//!
//! Which clusters are hidden is guessed from how much those in front of them cover. Then the picture is drawn without them,
//! each tile says how far it was looked into, and what was left out but comes nearer than that is missing: it is added, and
//! the tiles that it touches are drawn again, until nothing is missing. So a wrong guess costs time and changes nothing; and
//! where little seems to be hidden all is drawn at once.

mod bounds;
mod facing;
mod guess;
mod looked;
mod sheet;

use crate::camera::Camera;
use crate::closing::Closing;
use crate::cull::VisibleRange;
use crate::footprint::Lens;
use crate::scene::{RenderSettings, Scene};
use bounds::{Bounds, Sight};
use facing::Facing;
use guess::Guess;
pub(crate) use looked::Looked;
use rayon::prelude::*;

/// After as many rounds all that is missing is drawn at once.
const MOST_ROUNDS: usize = 8;

/// Fewer ranges aren't worth a guess.
const LEAST_RANGES: usize = 16;

/// Less than this share of the splats isn't worth the rounds that leaving it out may take.
const WORTH_IT: f64 = 0.33;

/// What is drawn, what is left out, and how far the tiles were looked into. Of two kinds each: surfaces and volumes.
#[derive(Default)]
pub(crate) struct Occlusion {
    bounds: [Vec<Bounds>; 2],
    guess: Guess,
    left_out: [Vec<u32>; 2],
    next: [Vec<u32>; 2],
    changed: Vec<bool>,
    looked: Looked,
    rounds: usize,
}

/// What a frame's rounds have in common.
#[derive(Clone, Copy)]
pub(crate) struct Visible<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) camera: &'a Camera,
    pub(crate) settings: &'a RenderSettings,
    pub(crate) closing: Closing,
    /// Surfaces, which come from near to far, and volumes.
    pub(crate) ranges: &'a [Vec<VisibleRange>; 2],
}

impl Visible<'_> {
    fn sight(&self) -> Sight {
        let Self { camera, settings, closing, .. } = self;
        let lens = Lens::new(camera, settings.low_pass);
        Sight::new(camera, lens, (settings.farthest_end(), f64::from(closing.thickness())))
    }
}

impl Occlusion {
    /// Guesses what is hidden in a frame with tiles of a side, and leaves it out where that is worth it.
    pub(crate) fn begin(&mut self, visible: Visible, side: usize) {
        let Visible { scene, camera, settings, ranges, .. } = visible;
        self.looked.clear(camera.size(), side);
        self.changed.clear();
        self.changed.resize(self.looked.tiles(), true);
        self.rounds = 0;
        let count = ranges[0].len() + ranges[1].len();
        for (kind, ranges) in ranges.iter().enumerate() {
            self.left_out[kind].clear();
            self.next[kind].clear();
            self.next[kind].extend(0..ranges.len() as u32);
        }
        if !settings.occlusion || count < LEAST_RANGES {
            return;
        }
        let sight = visible.sight();
        for (bounds, ranges) in self.bounds.iter_mut().zip(ranges) {
            let of = |range: &VisibleRange| Bounds::new(&sight, range);
            ranges.par_iter().map(of).collect_into_vec(bounds);
        }
        self.guess.begin(&self.looked);
        let spent = settings.tolerance / 4.0;
        if !self.guess.may_hide((scene, &sight, spent), ranges, &self.bounds) {
            return;
        }
        let surfaces = self.guess.hidden_surfaces((scene, &sight, spent), &ranges[0]);
        let volumes = self.guess.hidden_volumes((scene, &sight, spent), &ranges[1], &self.bounds[1]);
        self.next[0].retain(|rank| !self.guess.is_turned_away(*rank));
        let hidden = [surfaces, volumes];
        let splats = |kind: usize, ranks: &[u32]| -> usize {
            ranks.iter().map(|rank| ranges[kind][*rank as usize].splats.len()).sum()
        };
        let [all, left_out] = [&self.next, &hidden].map(|ranks| splats(0, &ranks[0]) + splats(1, &ranks[1]));
        if (left_out as f64) < WORTH_IT * all as f64 {
            return;
        }
        for (kind, hidden) in hidden.into_iter().enumerate() {
            let mut is_left_out = vec![false; ranges[kind].len()];
            hidden.iter().for_each(|rank| is_left_out[*rank as usize] = true);
            self.next[kind].retain(|rank| !is_left_out[*rank as usize]);
            self.left_out[kind] = hidden;
        }
    }

    /// The ranges of a kind that are to be projected in this round, by their places among the visible ones.
    pub(crate) fn next(&self, kind: usize) -> &[u32] {
        &self.next[kind]
    }

    /// Whether what is drawn of a kind is new in this round.
    pub(crate) fn is_new(&self, kind: usize) -> bool {
        self.rounds == 0 || !self.next[kind].is_empty()
    }

    /// Whether anything of a kind is left out.
    pub(crate) fn leaves_out(&self, kind: usize) -> bool {
        !self.left_out[kind].is_empty()
    }

    /// Which tiles are to be drawn in this round.
    pub(crate) fn changed(&self) -> &[bool] {
        &self.changed
    }

    /// Where tiles say how far they were looked into.
    pub(crate) fn looked(&self) -> &Looked {
        &self.looked
    }

    /// Finds what was left out of the tiles as they are drawn now but is seen; false if the picture is done.
    pub(crate) fn find_missing(&mut self, visible: Visible) -> bool {
        if !self.leaves_out(0) && !self.leaves_out(1) {
            return false;
        }
        let Visible { scene, ranges, .. } = visible;
        let sight = visible.sight();
        self.rounds += 1;
        let takes_all = self.rounds >= MOST_ROUNDS;
        // Where a tile has holes what is behind them is not added all at once.
        let enough = (1_u32 << (self.rounds - 1)) as f32;
        self.guess.begin(&self.looked);
        self.changed.fill(false);
        for kind in 0..2 {
            let (bounds, looked, ranges) = (&self.bounds[kind], &self.looked, &ranges[kind]);
            // In which squares those that are missing are seen: cells of surfaces, tiles of volumes.
            let find = |rank: &u32| -> Vec<u32> {
                let (bounds, range) = (&bounds[*rank as usize], &ranges[*rank as usize]);
                if kind == 1 {
                    let tiles = looked.tiles_that_show(&bounds.pixels, [bounds.near, bounds.distance]);
                    return tiles.map(|tile| tile as u32).collect();
                }
                if looked.hides_surface(&bounds.pixels, bounds.near) {
                    return Vec::new();
                }
                Facing::new(&sight, &scene.clouds[range.cloud], range).cells_that_show(range, looked)
            };
            let found: Vec<Vec<u32>> = self.left_out[kind].par_iter().map(find).collect();
            self.next[kind].clear();
            let mut found = found.into_iter();
            self.left_out[kind].retain(|rank| {
                let squares = found.next().unwrap_or_default();
                let is_next = match kind {
                    _ if squares.is_empty() => false,
                    0 => takes_all || self.guess.admits(*rank, &squares, enough),
                    _ => true,
                };
                if is_next {
                    self.next[kind].push(*rank);
                    for square in squares {
                        let square = square as usize;
                        let tile = if kind == 0 { self.looked.tile_of(square) } else { square };
                        self.changed[tile] = true;
                    }
                }
                !is_next
            });
        }
        self.next.iter().any(|next| !next.is_empty())
    }

    /// How many splats are left out.
    pub(crate) fn count(&self, visible: Visible) -> u64 {
        let of = |kind: usize| {
            let ranges = self.left_out[kind].iter().map(move |rank| &visible.ranges[kind][*rank as usize]);
            ranges.map(|range| range.count(visible.scene.clouds[range.cloud].levels()) as u64).sum::<u64>()
        };
        of(0) + of(1)
    }
}
