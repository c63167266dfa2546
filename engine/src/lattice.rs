//! Volumes at every second pixel of every second row: what lies between is interpolated where that keeps to the tolerance.
//!
//! Kernels that are several pixels wide add up to a picture as smooth as they are, but for what opacity sharpens. So volumes are
//! drawn twice: tiles of every second pixel first, a quarter of the work; then, block by block, the pixels between are
//! interpolated, or the block is drawn like any other where the interpolation may be off by more than its share of the
//! tolerance, where surfaces cut through what is seen, and at the picture's borders.
//!
//! Eight pixels give the one in their middle by the polynomial through them. By how much the two outermost change it says how far off
//! it may be: of a kernel alone up to six times as much, in 99.9 % of an engine's pixels up to twice.

use crate::camera::Projection;
use crate::columns::Kind;
use crate::composite::Runs;
use crate::cull::{VisibleRange, touched_pixels};
use crate::frame::Channels;
use crate::grow::grow;
use crate::pass::PerPass;
use crate::tile::{BLOCK_SIDE, MAX_SIDE, Tile};
use crate::view::SceneView;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// From one drawn pixel to the next.
pub(crate) const STEP: usize = 2;

/// The share of the tolerance that the two outermost pixels may change.
const SHARE: f32 = 0.125;

/// Standard deviation of kernels in pixels, filter included, from which on they are interpolated. One of so many alone is then off by six
/// times what the outermost two change in the same block at most, two hundred times where it is half as wide: it may lie between the
/// pixels that are drawn.
pub(crate) const LEAST_SIGMA: f64 = 1.75;

/// What kernels may have left where they end, by the tolerance: an interpolation across that is off by a half of it.
pub(crate) const HIGHEST_END: f64 = 0.5;

/// The share of the pixels with volumes in which surfaces may be: there all pixels are drawn.
const MOST_CUT: f64 = 0.5;

/// Pixels to either side of one that is interpolated.
const REACH: usize = 4;

/// Pixels of the lattice in a row of a tile, and of what its interpolation needs.
const MOST: usize = MAX_SIDE / STEP;
const WINDOW: usize = MOST + 2 * REACH - 1;

/// Samples of a block in a row.
const OWN: usize = BLOCK_SIDE / STEP;

/// Red, green, blue and opacity.
type Sample = [f32; 4];

/// Where nothing was drawn.
const UNKNOWN: Sample = [f32::NAN; 4];

/// What volumes send and hide at every second pixel.
#[derive(Default)]
pub(crate) struct Lattice {
    is_used: bool,
    /// Pixels of it in a row, and rows.
    size: [usize; 2],
    samples: Vec<[AtomicU32; 4]>,
    /// Side of its tiles in its pixels, and how many are in a row, and rows of them.
    side: usize,
    columns: usize,
    rows: usize,
    /// Of each tile: how far it was looked into, see [`Runs::reached`].
    reached: Vec<AtomicU32>,
    /// Which tiles are to be drawn in this round.
    changed: Vec<bool>,
}

impl Lattice {
    /// Begins a frame with tiles of a side; it is used where volumes are wide enough in the picture.
    pub(crate) fn begin(&mut self, view: SceneView, visible: &PerPass<Vec<VisibleRange>>, side: usize) {
        self.changed.clear();
        self.is_used = is_worth_it(view, visible);
        if self.is_used {
            self.size = view.camera.size().map(|length| (length as usize).div_ceil(STEP));
            self.side = side;
            [self.columns, self.rows] = self.size.map(|length| length.div_ceil(side));
            let tiles = self.columns * self.rows;
            grow(&mut self.samples, self.size[0] * self.size[1], Default::default);
            self.reached.resize_with(tiles.max(self.reached.len()), AtomicU32::default);
            self.changed.resize(tiles, true);
        }
    }

    /// Whether there is one.
    pub(crate) fn is_used(&self) -> bool {
        self.is_used
    }

    /// Side of the squares of pixels that volumes are listed for, those of tiles having one.
    pub(crate) fn listed_side(&self, side: usize) -> usize {
        if self.is_used { side * STEP } else { side }
    }

    /// How many tiles there are: none where it isn't used.
    pub(crate) fn tiles(&self) -> usize {
        self.changed.len()
    }

    /// A tile, and where it says how far it was looked into.
    pub(crate) fn tile(&self, index: usize) -> (Tile, &AtomicU32) {
        let place = [index % self.columns, index / self.columns];
        (Tile::new(place, self.side, self.size).of_every(STEP), &self.reached[index])
    }

    /// The tiles of the picture that lie in one of the lattice's, of so many in a row and rows.
    pub(crate) fn parts(
        &self,
        index: usize,
        [columns, rows]: [usize; 2],
    ) -> impl Iterator<Item = usize> + use<> {
        let [left, top] = [index % self.columns * STEP, index / self.columns * STEP];
        let across = left..(left + STEP).min(columns);
        (top..(top + STEP).min(rows))
            .flat_map(move |row| across.clone().map(move |column| row * columns + column))
    }

    /// The number of the tile that a tile of the picture is in.
    pub(crate) fn tile_of(&self, tile: Tile) -> usize {
        let [column, row] = tile.origin.map(|origin| origin / (self.side * STEP));
        row * self.columns + column
    }

    /// Says which tiles of the picture have changed, of so many in a row.
    pub(crate) fn mark(&mut self, changed: &[bool], columns: usize) {
        let rows = changed.len() / columns.max(1);
        for index in 0..self.tiles() {
            self.changed[index] = self.parts(index, [columns, rows]).any(|part| changed[part]);
        }
    }

    /// Whether a tile has changed.
    pub(crate) fn is_changed(&self, index: usize) -> bool {
        self.changed[index]
    }

    /// Whether any of what a tile of the picture is interpolated from has changed.
    pub(crate) fn is_stale(&self, tile: Tile) -> bool {
        if !self.is_used {
            return false;
        }
        let touched = |axis: usize, count: usize| {
            let first = (tile.origin[axis] / STEP).saturating_sub(REACH) / self.side;
            let last = (tile.origin[axis] + tile.side).div_ceil(STEP) + REACH;
            first..last.div_ceil(self.side).min(count)
        };
        touched(1, self.rows)
            .any(|row| self.changed[row * self.columns..][touched(0, self.columns)].contains(&true))
    }

    /// Takes in what a tile's pixels see. Without runs nobody knows, nor where rough kernels are.
    #[inline(always)]
    pub(crate) fn store(&self, tile: Tile, runs: Option<&Runs>) {
        for block in tile.visible_blocks() {
            let ([left, top], [columns, rows]) = (tile.corner(block), tile.visible(block));
            let runs = runs.filter(|runs| runs.rough >> block & 1 == 0);
            for row in 0..rows {
                let first = (tile.origin[1] + top + row) * self.size[0] + tile.origin[0] + left;
                for (column, sample) in self.samples[first..first + columns].iter().enumerate() {
                    let pixel = row * BLOCK_SIDE + column;
                    let seen = runs.map_or(UNKNOWN, |runs| {
                        let seen = runs.block(0, block);
                        let [red, green, blue] = seen.color.each_ref().map(|plane| plane.0[pixel]);
                        [red, green, blue, seen.opacity.0[pixel]]
                    });
                    for (channel, value) in sample.iter().zip(seen) {
                        channel.store(value.to_bits(), Relaxed);
                    }
                }
            }
        }
    }

    /// How far the lattice was looked into where a tile of the picture is.
    pub(crate) fn reached(&self, tile: Tile) -> f32 {
        f32::from_bits(self.reached[self.tile_of(tile)].load(Relaxed))
    }

    /// Interpolates what a tile of the picture sees where that is as good as drawn; gives the blocks where it is not. Runs are
    /// clear.
    #[inline(always)]
    pub(crate) fn fill(&self, tile: Tile, tolerance: f32, runs: &mut Runs) -> u64 {
        let mut open = tile.visible_set();
        let Some(window) = Window::of(self, tile) else { return 0 };
        let between = Between::new(&window);
        for block in tile.visible_blocks() {
            let place = tile.corner(block).map(|pixel| pixel / STEP);
            if between.is_smooth(place, SHARE * tolerance) {
                let seen = runs.block_mut(block);
                // What waves beyond them is within the doubt, but not its ratios, by which colours may be encoded.
                seen.opacity.0 = between.pixels(&window, 3, place).map(|opacity| opacity.clamp(0.0, 1.0));
                for (channel, plane) in seen.color.iter_mut().enumerate() {
                    let colors = between.pixels(&window, channel, place);
                    // Between pixels it may be brighter than at any of them, but not by far.
                    let brightest = 2.0 * window.brightest[channel];
                    plane.0 = std::array::from_fn(|i| colors[i].max(0.0).min(seen.opacity.0[i] * brightest));
                }
                open &= !(1 << block);
            }
        }
        open
    }
}

fn is_worth_it(view: SceneView, PerPass { surfaces, volumes }: &PerPass<Vec<VisibleRange>>) -> bool {
    let SceneView { scene, camera, settings } = view;
    // Medians of depth are not smooth.
    let is_allowed =
        settings.interpolation && settings.tolerance > 0.0 && settings.channels == Channels::Color;
    let is_large = camera.size().iter().all(|length| *length as usize >= 2 * MAX_SIDE);
    if !is_allowed || !is_large || volumes.is_empty() {
        return false;
    }
    let lens = view.lens();
    let is_wide = |range: &VisibleRange| {
        let sigma = scene.clouds[range.cloud].median_sigma(range.level).unwrap_or(0.0);
        let distance = match lens.projection {
            Projection::Perspective => f64::from(range.distances[1]),
            Projection::Orthographic => 1.0,
        };
        (sigma * lens.focal.min_element() / distance).hypot(lens.filter_sigma) >= LEAST_SIGMA
    };
    // Kernels that end where they still show are drawn again.
    let fades = |range: &VisibleRange| match scene.clouds[range.cloud].levels()[range.level].columns.kind {
        Kind::Opacity { least, .. } => f64::from(least) <= HIGHEST_END * settings.tolerance,
        _ => true,
    };
    let seen = |ranges: &[VisibleRange]| touched_pixels(camera, ranges.iter());
    let is_smooth = volumes.iter().all(|range| is_wide(range) && fades(range));
    is_smooth && (surfaces.is_empty() || seen(surfaces) < MOST_CUT * seen(volumes))
}

/// The lattice's pixels in a tile of the picture and around it.
struct Window {
    /// By channels, rows and columns.
    samples: [[[f32; WINDOW]; WINDOW]; 4],
    /// The largest of each colour among them, for an opacity of 1.
    brightest: [f32; 3],
}

impl Window {
    /// `None` if nothing is there.
    #[inline(always)]
    fn of(lattice: &Lattice, tile: Tile) -> Option<Self> {
        let mut window = Self { samples: [[[f32::NAN; WINDOW]; WINDOW]; 4], brightest: [0.0; 3] };
        let [left, top] = tile.origin.map(|origin| origin / STEP);
        let count = tile.side / STEP + 2 * REACH - 1;
        let mut shows = false;
        for row in 0..count {
            let y = (top + row).wrapping_sub(REACH - 1);
            for column in 0..count {
                let x = (left + column).wrapping_sub(REACH - 1);
                if x >= lattice.size[0] || y >= lattice.size[1] {
                    continue;
                }
                let sample = lattice.samples[y * lattice.size[0] + x].each_ref();
                let sample: Sample = sample.map(|channel| f32::from_bits(channel.load(Relaxed)));
                // What is unknown is seen.
                shows |= sample[3] > 0.0 || sample[3].is_nan();
                for (channel, value) in window.samples.iter_mut().zip(sample) {
                    channel[row][column] = value;
                }
                let per_opacity = 1.0 / sample[3].max(f32::MIN_POSITIVE);
                for (brightest, color) in window.brightest.iter_mut().zip(sample) {
                    *brightest = brightest.max(color * per_opacity);
                }
            }
        }
        shows.then_some(window)
    }
}

/// The pixels between those of a window, and how far off they may be in any channel; by rows and columns of the lattice's
/// pixels in the tile that they are behind.
struct Between {
    /// In rows of the lattice, of all rows of the window.
    across: [[[f32; MOST]; WINDOW]; 4],
    /// Between rows: in columns of the lattice, and between these, too.
    down: [[[[f32; MOST]; MOST]; 4]; 2],
    doubt_across: [[f32; MOST]; WINDOW],
    doubt_down: [[f32; MOST]; MOST],
}

impl Between {
    #[inline(always)]
    fn new(Window { samples: window, .. }: &Window) -> Self {
        let mut between = Self {
            across: [[[0.0; MOST]; WINDOW]; 4],
            down: [[[[0.0; MOST]; MOST]; 4]; 2],
            doubt_across: [[0.0; MOST]; WINDOW],
            doubt_down: [[0.0; MOST]; MOST],
        };
        let Self { across, down, doubt_across, doubt_down } = &mut between;
        for (window, across) in window.iter().zip(across.iter_mut()) {
            for ((row, across), doubts) in window.iter().zip(across).zip(&mut *doubt_across) {
                for (column, (across, doubt)) in across.iter_mut().zip(doubts).enumerate() {
                    let own;
                    (*across, own) = middle(std::array::from_fn(|i| row[column + i]));
                    *doubt = doubt.max(own);
                }
            }
        }
        let [below, aside] = down;
        for (channel, (below, aside)) in below.iter_mut().zip(aside).enumerate() {
            for (row, ((below, aside), doubts)) in
                below.iter_mut().zip(aside).zip(&mut *doubt_down).enumerate()
            {
                for (column, doubt) in doubts.iter_mut().enumerate() {
                    let (own, other);
                    (below[column], own) =
                        middle(std::array::from_fn(|i| window[channel][row + i][column + REACH - 1]));
                    (aside[column], other) =
                        middle(std::array::from_fn(|i| across[channel][row + i][column]));
                    *doubt = doubt.max(own).max(other);
                }
            }
        }
        between
    }

    /// Whether the pixels of a block, whose first one is one of the lattice's at a column and row of the tile, are known well enough.
    #[inline(always)]
    fn is_smooth(&self, [column, row]: [usize; 2], most: f32) -> bool {
        let mut doubt = 0.0_f32;
        for y in row..row + OWN {
            for x in column..column + OWN {
                let [own, next] = [0, 1].map(|i| self.doubt_across[y + REACH - 1 + i][x]);
                doubt = doubt.max(own).max(next).max(self.doubt_down[y][x]);
            }
        }
        // The largest of numbers passes over those that are none.
        let is_known = (row..row + OWN).all(|y| {
            (column..column + OWN).all(|x| {
                !self.down[1][3][y][x].is_nan()
                    && !self.down[0][3][y][x].is_nan()
                    && !self.across[3][y + REACH - 1][x].is_nan()
            })
        });
        is_known && doubt <= most
    }

    /// A channel of the block.
    #[inline(always)]
    fn pixels(
        &self,
        Window { samples: window, .. }: &Window,
        channel: usize,
        [column, row]: [usize; 2],
    ) -> [f32; BLOCK_SIDE * BLOCK_SIDE] {
        let mut pixels = [0.0; BLOCK_SIDE * BLOCK_SIDE];
        for (y, rows) in pixels.chunks_exact_mut(STEP * BLOCK_SIDE).enumerate() {
            let (own, below) = rows.split_at_mut(BLOCK_SIDE);
            for x in 0..OWN {
                let (row, column) = (row + y, column + x);
                own[STEP * x] = window[channel][row + REACH - 1][column + REACH - 1];
                own[STEP * x + 1] = self.across[channel][row + REACH - 1][column];
                below[STEP * x] = self.down[0][channel][row][column];
                below[STEP * x + 1] = self.down[1][channel][row][column];
            }
        }
        pixels
    }
}

/// The middle of eight evenly spaced values, by the polynomial through them; and by how much that of the inner six is another.
#[inline(always)]
fn middle(values: [f32; 2 * REACH]) -> (f32, f32) {
    let [a, b, c, d, e, f, g, h] = values;
    let [outer, third, second, inner] = [a + h, b + g, c + f, d + e];
    let middle = (1225.0 * inner - 245.0 * second + 49.0 * third - 5.0 * outer) * (1.0 / 2048.0);
    let change = (5.0 * inner - 9.0 * second + 5.0 * third - outer) * (5.0 / 2048.0);
    (middle, change.abs())
}
