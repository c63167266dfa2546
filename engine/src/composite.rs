//! Stage `composite`: fragments to runs. Between cuts things add, cuts fold with *over*.

use crate::bin::TILE;
use crate::exponential::opacity;
use crate::footprint::Records;
use crate::layers::{Cuts, MAX_LAYERS};
use crate::raster::{Fragment, Fragments};
use glam::Vec4;

/// A surface layer at a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Cut {
    pub(crate) depth: f32,
    pub(crate) alpha: f32,
    /// Base colour in the blend space; shaded when the pixel is resolved.
    pub(crate) color: [f32; 3],
    /// Unit normal in camera space.
    pub(crate) normal: [f32; 3],
    /// The front-most splat.
    pub(crate) id: u32,
    /// Its cloud, whose material shades the layer.
    pub(crate) cloud: u16,
}

/// What a stretch of a ray sends towards the camera and lets through. Composition is associative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Run {
    /// Red, green, blue, each times its contribution, and z times its contribution.
    pub(crate) color_and_depth: Vec4,
    /// What does not pass. Kept instead of the transmittance, of which 1 − α loses the thinnest media.
    pub(crate) opacity: f32,
}

impl Run {
    /// Nothing there.
    pub(crate) const CLEAR: Self = Self { color_and_depth: Vec4::ZERO, opacity: 0.0 };

    /// A run that sends `color` from depth z with opacity `alpha`.
    pub(crate) fn layer(color: [f32; 3], depth: f32, alpha: f32) -> Self {
        let [red, green, blue] = color;
        let color_and_depth = Vec4::new(red, green, blue, depth) * alpha;
        Self { color_and_depth, opacity: alpha }
    }

    /// This run in front of another: (C, T)∘(C', T') = (C + T·C', T·T').
    #[inline(always)]
    #[must_use]
    pub(crate) fn over(self, behind: Self) -> Self {
        let transmittance = 1.0 - self.opacity;
        Self {
            color_and_depth: self.color_and_depth + behind.color_and_depth * transmittance,
            opacity: self.opacity + behind.opacity * transmittance,
        }
    }
}

/// The runs of a tile: the segments between a pixel's cuts, near to far.
pub(crate) struct Runs {
    runs: Vec<Run>,
}

const SEGMENTS: usize = MAX_LAYERS + 1;

impl Runs {
    pub(crate) fn new() -> Self {
        Self { runs: vec![Run::CLEAR; TILE * TILE * SEGMENTS] }
    }

    pub(crate) fn clear(&mut self) {
        self.runs.fill(Run::CLEAR);
    }

    /// The runs of a pixel; run j lies in front of cut j.
    pub(crate) fn of(&self, pixel: usize) -> &[Run] {
        &self.runs[pixel * SEGMENTS..][..SEGMENTS]
    }

    /// Whether nothing behind what is there already can be seen, in the `pixels` of a tile.
    pub(crate) fn all_spent(&self, pixels: impl Iterator<Item = usize>, spent: f32) -> bool {
        let mut pixels = pixels;
        pixels.all(|pixel| self.runs[pixel * SEGMENTS].opacity >= 1.0 - spent)
    }
}

/// Adds fragments to runs.
pub(crate) struct Compositor<'a> {
    pub(crate) records: &'a Records,
    pub(crate) near: f32,
    pub(crate) spent: f32,
}

impl Compositor<'_> {
    /// Order `Centers`: every splat is closed before the next opens.
    pub(crate) fn add(&self, fragments: &Fragments, cuts: &Cuts, runs: &mut Runs) {
        let mut start = 0;
        for (index, end) in &fragments.splats {
            let color = self.records.records[*index as usize].color;
            for fragment in &fragments.fragments[start..*end] {
                let pixel = fragment.pixel as usize;
                let runs = &mut runs.runs[pixel * SEGMENTS..][..SEGMENTS];
                self.add_fragment(fragment, color, cuts.of(pixel), runs);
            }
            start = *end;
        }
    }

    #[inline(always)]
    fn add_fragment(&self, fragment: &Fragment, color: [f32; 3], cuts: &[Cut], runs: &mut [Run]) {
        if runs[0].opacity >= 1.0 - self.spent {
            return;
        }
        let reach = REACH * fragment.sigma_z;
        let (nearest, farthest) = (fragment.depth - reach, fragment.depth + reach);
        let mut from = self.near;
        for (segment, run) in runs[..=cuts.len()].iter_mut().enumerate() {
            let cut = cuts.get(segment);
            let to = cut.map_or(f32::INFINITY, |cut| cut.depth);
            if farthest > from && nearest < to {
                let whole = nearest >= from && farthest <= to;
                let share = if whole { 1.0 } else { fragment.share(from, to) };
                let alpha = opacity(share * fragment.optical_depth);
                *run = run.over(Run::layer(color, fragment.depth.clamp(from, to), alpha));
            }
            if farthest <= to || cut.is_some_and(|cut| cut.alpha >= 1.0) {
                return;
            }
            from = to;
        }
    }
}

/// Beyond this many σ_z a kernel has 6e-5 of its mass, which counts as none.
const REACH: f32 = 4.0;

impl Fragment {
    /// The share of the kernel between two depths: Φ((to − z)/σ_z) − Φ((from − z)/σ_z).
    fn share(&self, from: f32, to: f32) -> f32 {
        if self.sigma_z <= 0.0 {
            return f32::from(u8::from(self.depth >= from && self.depth < to));
        }
        let below = |z: f32| {
            if z == f32::INFINITY { 1.0 } else { normal_cdf((z - self.depth) / self.sigma_z) }
        };
        (below(to) - below(from)).max(0.0)
    }
}

/// Φ(x), to the precision of f32.
fn normal_cdf(x: f32) -> f32 {
    0.5 * libm::erfcf(-x * std::f32::consts::FRAC_1_SQRT_2)
}
