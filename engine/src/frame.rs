//! The finished picture and what was measured at its pixels.

use crate::grow::grow;
use crate::scene::{Blend, RenderSettings};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// What a frame holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// Colour and alpha; the other vectors are empty.
    Color,
    /// Everything.
    #[default]
    All,
}

/// The opacity from which on a layer is a surface. Rounding gives a layer that is clear up to 2e-7, from the quotient of two sums and what lies
/// before it.
pub(crate) const LEAST_VISIBLE: f32 = 1e-6;

/// A picture of `width * height` pixels, rows from top to bottom.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear Rec. 709, premultiplied, and alpha.
    pub color: Vec<[f32; 4]>,
    /// z of the first surface layer that shows, by a millionth at least; infinity where there is none. What is cut out, or clear, is none.
    pub depth: Vec<f32>,
    /// Mean z of what is seen, weighted by its contribution, the background left out; infinity where
    /// nothing is seen.
    pub expected_depth: Vec<f32>,
    /// z at which the transmittance has fallen to a half; infinity where more than half passes.
    pub median_depth: Vec<f32>,
    /// Unit normal of that layer in the world, on the side that is seen; zero where there is none.
    pub normal: Vec<[f32; 3]>,
    /// Id of the front-most splat of that layer, counted through the scene's clouds, of one that stands for several that of its
    /// first; [`Frame::NO_ID`] where there is none.
    pub id: Vec<u32>,
}

impl Frame {
    /// The id of a pixel without a surface.
    pub const NO_ID: u32 = u32::MAX;

    /// An empty picture with all channels: transparent, no surface.
    pub fn new(width: usize, height: usize) -> Self {
        let mut frame = Self::default();
        frame.resize([width, height], Channels::All);
        frame
    }

    /// Makes room for a picture; what pixels hold then is of no meaning where there were some before.
    pub(crate) fn resize(&mut self, [width, height]: [usize; 2], channels: Channels) {
        fn fit<T: Copy + Send + Sync>(channel: &mut Vec<T>, len: usize, empty: T) {
            channel.truncate(len);
            grow(channel, len, || empty);
        }
        (self.width, self.height) = (width, height);
        fit(&mut self.color, width * height, [0.0; 4]);
        let rest = if channels == Channels::All { width * height } else { 0 };
        fit(&mut self.depth, rest, f32::INFINITY);
        fit(&mut self.expected_depth, rest, f32::INFINITY);
        fit(&mut self.median_depth, rest, f32::INFINITY);
        fit(&mut self.normal, rest, [0.0; 3]);
        fit(&mut self.id, rest, Self::NO_ID);
    }

    /// The frame in bands of `height` rows, the last may be lower.
    pub(crate) fn bands(&mut self, height: usize) -> impl Iterator<Item = FrameRows<'_>> {
        let (width, size) = (self.width, self.width * height);
        let mut depth = self.depth.chunks_mut(size);
        let mut expected_depth = self.expected_depth.chunks_mut(size);
        let mut median_depth = self.median_depth.chunks_mut(size);
        let mut normal = self.normal.chunks_mut(size);
        let mut id = self.id.chunks_mut(size);
        self.color.chunks_mut(size).map(move |color| FrameRows {
            width,
            color,
            depth: depth.next().unwrap_or_default(),
            expected_depth: expected_depth.next().unwrap_or_default(),
            median_depth: median_depth.next().unwrap_or_default(),
            normal: normal.next().unwrap_or_default(),
            id: id.next().unwrap_or_default(),
        })
    }
}

/// Which tiles of a frame show nothing but the background since an earlier picture: there is nothing to write.
#[derive(Default)]
pub(crate) struct Clear {
    tiles: Vec<AtomicBool>,
    of: Option<Ground>,
}

/// What tiles that show nothing look like, and where they are.
#[derive(PartialEq)]
struct Ground {
    size: [usize; 2],
    side: usize,
    background: [f32; 4],
    blend: Blend,
    channels: Channels,
}

impl Clear {
    /// Begins a picture, in tiles of a side.
    pub(crate) fn begin(&mut self, frame: &Frame, side: usize, settings: &RenderSettings) {
        let RenderSettings { background, blend, channels, .. } = *settings;
        let size = [frame.width, frame.height];
        let of = Some(Ground { size, side, background, blend, channels });
        if self.of != of {
            self.of = of;
            self.tiles.clear();
            let tiles = size.map(|length| length.div_ceil(side)).iter().product();
            self.tiles.resize_with(tiles, AtomicBool::default);
        }
    }

    /// Puts down whether a tile shows nothing, and says whether it needn't be written.
    pub(crate) fn stays(&self, tile: usize, shows_nothing: bool) -> bool {
        self.tiles[tile].swap(shows_nothing, Relaxed) && shows_nothing
    }
}

/// Rows that one thread writes at a time: as few as a tile may have.
pub(crate) const BAND: usize = 8;

/// Some rows of a frame.
pub(crate) struct FrameRows<'a> {
    width: usize,
    pub(crate) color: &'a mut [[f32; 4]],
    pub(crate) depth: &'a mut [f32],
    pub(crate) expected_depth: &'a mut [f32],
    pub(crate) median_depth: &'a mut [f32],
    pub(crate) normal: &'a mut [[f32; 3]],
    pub(crate) id: &'a mut [u32],
}

impl FrameRows<'_> {
    /// Where a pixel is; rows count from the first of these.
    pub(crate) fn place(&self, column: usize, row: usize) -> usize {
        row * self.width + column
    }
}
