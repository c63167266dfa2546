//! How stages report: the library reads no clock, an observer may.

/// The stages of a picture, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stage {
    /// Which splats can be seen.
    Cull,
    /// Splats to screen-space records.
    Footprint,
    /// Records by distance.
    Order,
    /// Records to tiles.
    Bin,
    /// A tile's surface records to cuts, rasterized.
    Layers,
    /// A tile's volume records to runs, rasterized.
    Composite,
    /// Cuts and runs to the frame.
    Resolve,
}

impl Stage {
    /// Every stage, in order.
    pub const ALL: [Self; 7] =
        [Self::Cull, Self::Footprint, Self::Order, Self::Bin, Self::Layers, Self::Composite, Self::Resolve];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cull => "cull",
            Self::Footprint => "footprint",
            Self::Order => "order",
            Self::Bin => "bin",
            Self::Layers => "layers",
            Self::Composite => "composite",
            Self::Resolve => "resolve",
        }
    }

    /// Whether it runs tile by tile on many threads at once: then `begin` and `end` come in pairs on each
    /// of those threads. The other stages report from the thread that draws, in each round of surfaces and of volumes; there are further
    /// rounds where something that seemed hidden is not. [`Self::Cull`] reports before and after rounds, too.
    pub fn is_per_tile(self) -> bool {
        self >= Self::Layers
    }
}

/// What a frame took, counted and not timed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Splats in the scene.
    pub splats: u64,
    /// Splats, of whatever level of detail, that were not projected because their clusters lie outside the picture.
    pub culled: u64,
    /// Splats, of whatever level of detail, that were left out because they are hidden: whole clusters, and kernels behind surfaces.
    pub occluded: u64,
    /// Splats whose footprint touches the picture.
    pub visible: u64,
    /// Those of them that stand for others.
    pub merged: u64,
    /// Those of them in each form: point, affine, exact.
    pub forms: [u64; 3],
    /// Pixels that were evaluated, summed over the passes over surfaces and volumes: sixteen for each block of 4×4 that a
    /// splat's ellipse meets, as far as it could still be seen there.
    pub fragments: u64,
    /// Pixels of kernels that came when one behind them had left the window of [`crate::Order::PerPixel`]: there the disorder was
    /// larger than the window. 0 in other orders.
    pub late: u64,
}

/// Told of each stage's begin and end, and of the counts at the end of a frame.
pub trait Observer: Sync {
    /// A stage begins on this thread.
    fn begin(&self, _stage: Stage) {}
    /// The stage ends on this thread.
    fn end(&self, _stage: Stage) {}
    /// The frame is done.
    fn counts(&self, _counts: Counts) {}
}

/// Observes nothing.
impl Observer for () {}
