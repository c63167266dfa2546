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

use crate::closing::Closing;
use crate::cull::VisibleRange;
use crate::pass::{Pass, PerPass};
use crate::view::SceneView;
use bounds::{Bounds, Sight};
use facing::Facing;
use guess::Guess;
pub(crate) use looked::Looked;
use rayon::prelude::*;

/// After as many rounds all that is missing is drawn at once.
const MOST_ROUNDS: usize = 8;

/// Fewer ranges aren't worth a guess.
const LEAST_RANGES: usize = 16;

/// Nor are pictures of fewer cells, as windows are in which ways are tried: it asks all surfels of clusters, of which those show few.
const LEAST_CELLS: usize = 16;

/// Less than this share of the splats isn't worth the rounds that leaving it out may take.
const WORTH_IT: f64 = 0.33;

/// What is drawn, what is left out, and how far the tiles were looked into.
#[derive(Default)]
pub(crate) struct Occlusion {
    bounds: Vec<Bounds>,
    guess: Guess,
    left_out: PerPass<Vec<u32>>,
    /// How many splats of volumes are in clusters that cuts hide.
    behind_cuts: u64,
    next: Vec<u32>,
    changed: Vec<bool>,
    looked: Looked,
    rounds: usize,
}

/// What a frame's rounds have in common.
#[derive(Clone, Copy)]
pub(crate) struct Visible<'a> {
    pub(crate) view: SceneView<'a>,
    pub(crate) closing: Closing,
    /// Of surfaces from near to far.
    pub(crate) ranges: &'a PerPass<Vec<VisibleRange>>,
}

impl Visible<'_> {
    fn sight(&self) -> Sight {
        let SceneView { camera, settings, .. } = self.view;
        let reach = (settings.farthest_end(), f64::from(self.closing.thickness()));
        Sight::new(camera, self.view.lens(), reach)
    }

    /// How many splats are drawn of a pass's range.
    fn count(&self, pass: Pass, rank: u32) -> u64 {
        let range = &self.ranges[pass][rank as usize];
        range.count(self.view.scene.clouds[range.cloud].levels()) as u64
    }
}

impl Occlusion {
    /// Begins a frame with tiles of a side.
    pub(crate) fn begin(&mut self, size: [u32; 2], side: usize) {
        self.looked.clear(size, side);
        self.left_out.surfaces.clear();
        self.left_out.volumes.clear();
        self.behind_cuts = 0;
    }

    /// Begins a pass. What surfaces hide of volumes is known by then; what else is hidden is guessed, and left out where that is
    /// worth it.
    pub(crate) fn begin_pass(&mut self, pass: Pass, visible: Visible) {
        let SceneView { scene, settings, .. } = visible.view;
        let ranges = &visible.ranges[pass];
        self.changed.clear();
        self.changed.resize(self.looked.tiles(), true);
        self.rounds = 0;
        self.next.clear();
        self.next.extend(0..ranges.len() as u32);
        if !settings.occlusion || ranges.len() < LEAST_RANGES {
            return;
        }
        let sight = visible.sight();
        let view = (scene, &sight, settings.tolerance / 4.0);
        self.guess.begin(&self.looked);
        let may_hide = self.looked.cells() >= LEAST_CELLS && self.guess.may_hide(view, pass, ranges);
        let has_cuts = pass == Pass::Volumes && !visible.ranges.surfaces.is_empty();
        if !may_hide && !has_cuts {
            return;
        }
        ranges.par_iter().map(|range| Bounds::new(&sight, range)).collect_into_vec(&mut self.bounds);
        if has_cuts {
            self.leave_out_behind_cuts(visible);
        }
        if !may_hide {
            return;
        }
        let hidden = match pass {
            Pass::Surfaces => self.guess.hidden_surfaces(view, ranges),
            Pass::Volumes => self.guess.hidden_volumes(view, (ranges, &self.bounds, &self.next)),
        };
        if pass == Pass::Surfaces {
            self.next.retain(|rank| !self.guess.is_turned_away(*rank));
        }
        let splats =
            |ranks: &[u32]| -> usize { ranks.iter().map(|rank| ranges[*rank as usize].splats.len()).sum() };
        if (splats(&hidden) as f64) < WORTH_IT * splats(&self.next) as f64 {
            return;
        }
        let mut is_left_out = vec![false; ranges.len()];
        hidden.iter().for_each(|rank| is_left_out[*rank as usize] = true);
        self.next.retain(|rank| !is_left_out[*rank as usize]);
        self.left_out[pass] = hidden;
    }

    /// Leaves out the volumes that are hidden by what is drawn of surfaces, for good.
    fn leave_out_behind_cuts(&mut self, visible: Visible) {
        let Self { looked, bounds, behind_cuts, next, .. } = self;
        next.retain(|rank| {
            let Bounds { pixels, near, .. } = &bounds[*rank as usize];
            let is_hidden = looked.hides_kernel(pixels, *near);
            if is_hidden {
                *behind_cuts += visible.count(Pass::Volumes, *rank);
            }
            !is_hidden
        });
    }

    /// The ranges of the pass that are to be projected in this round, by their places among the visible ones.
    pub(crate) fn next(&self) -> &[u32] {
        &self.next
    }

    /// Whether anything is left out of a pass.
    pub(crate) fn leaves_out(&self, pass: Pass) -> bool {
        !self.left_out[pass].is_empty()
    }

    /// Which tiles are to be drawn in this round.
    pub(crate) fn changed(&self) -> &[bool] {
        &self.changed
    }

    /// Where tiles say how far they were looked into.
    pub(crate) fn looked(&self) -> &Looked {
        &self.looked
    }

    /// Finds what a pass left out of the tiles as they are drawn now but is seen; false if nothing was.
    pub(crate) fn find_missing(&mut self, pass: Pass, visible: Visible) -> bool {
        if !self.leaves_out(pass) {
            return false;
        }
        let Visible { view: SceneView { scene, .. }, ranges, .. } = visible;
        let sight = visible.sight();
        self.rounds += 1;
        let takes_all = self.rounds >= MOST_ROUNDS;
        // Where a tile has holes what is behind them is not added all at once.
        let enough = (1_u32 << (self.rounds - 1)) as f32;
        self.guess.begin(&self.looked);
        self.changed.fill(false);
        let (bounds, looked, ranges) = (&self.bounds, &self.looked, &ranges[pass]);
        // In which squares those that are missing are seen: cells of surfaces, tiles of volumes.
        let find = |rank: &u32| -> Vec<u32> {
            let (bounds, range) = (&bounds[*rank as usize], &ranges[*rank as usize]);
            if pass == Pass::Volumes {
                let tiles = looked.tiles_that_show(&bounds.pixels, [bounds.near, bounds.distance]);
                return tiles.map(|tile| tile as u32).collect();
            }
            if looked.hides_surface(&bounds.pixels, bounds.near) {
                return Vec::new();
            }
            Facing::new(&sight, &scene.clouds[range.cloud], range).cells_that_show(range, looked)
        };
        let found: Vec<Vec<u32>> = self.left_out[pass].par_iter().map(find).collect();
        self.next.clear();
        let mut found = found.into_iter();
        self.left_out[pass].retain(|rank| {
            let squares = found.next().unwrap_or_default();
            let is_next = !squares.is_empty()
                && (pass == Pass::Volumes || takes_all || self.guess.admits(*rank, &squares, enough));
            if is_next {
                self.next.push(*rank);
                for square in squares {
                    let square = square as usize;
                    let tile = if pass == Pass::Surfaces { self.looked.tile_of(square) } else { square };
                    self.changed[tile] = true;
                }
            }
            !is_next
        });
        !self.next.is_empty()
    }

    /// How many splats are left out with their clusters.
    pub(crate) fn count(&self, visible: Visible) -> u64 {
        let of = |pass: Pass| self.left_out[pass].iter().map(move |rank| visible.count(pass, *rank));
        Pass::BOTH.into_iter().flat_map(of).sum::<u64>() + self.behind_cuts
    }
}
