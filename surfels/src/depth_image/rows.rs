//! The numbers of an image, each in rows of its own.

use super::lanes::*;
use super::{DepthError, DepthKind, LEAST_INVERSE, RgbdImage};
use oblate_engine::simd::{Level, dispatch};
use rayon::prelude::*;

/// Inverse depths that the usual one is found from, and the share of these, the nearest, that doesn't count.
const SAMPLED: usize = 4096;
const NEAREST: usize = 50;

/// What surfels are made from.
#[derive(Default)]
pub(super) struct ImageRows {
    /// Inverse depths along the axis, 0 where unknown.
    pub(super) inverses: Bordered,
    pub(super) colors: [Bordered; 3],
}

impl ImageRows {
    /// Of an image, in the memory of another's.
    pub(super) fn of(level: Level, image: &RgbdImage, memory: Self) -> Result<Self, DepthError> {
        image.check_shape()?;
        let mut inverses = memory.inverses.renewed(image.size);
        let mut colors = memory.colors.map(|old| old.renewed(image.size));
        let [red, green, blue] = colors.each_mut().map(Bordered::rows);
        let rows = inverses.rows().zip(red.zip(green).zip(blue)).enumerate();
        let take = |(row, (inverses, ((red, green), blue)))| {
            let to = (inverses, [red, green, blue]);
            dispatch!(level, simd => take_in(simd, (image, row), to))
        };
        // Of several wrong rows the first is named, for any number of threads.
        rows.map(take).collect::<Vec<Result<(), DepthError>>>().into_iter().collect::<Result<(), _>>()?;
        Ok(Self { inverses, colors })
    }

    /// The harmonic mean of the known depths, but for the nearest fiftieth, of some thousand pixels all over the image: however far a sky is, and
    /// however near single pixels seem, it stays where most things are. Something must be known.
    pub(super) fn usual_depth(&self) -> f64 {
        let known = |step: usize| -> Vec<f32> {
            self.inverses.numbers().iter().step_by(step).copied().filter(|inverse| *inverse > 0.0).collect()
        };
        let mut inverses = known((self.inverses.numbers().len() / SAMPLED) | 1);
        if inverses.len() < NEAREST {
            inverses = known(1);
        }
        inverses.sort_unstable_by(|a, b| b.total_cmp(a));
        let counted = &inverses[inverses.len() / NEAREST..];
        counted.len() as f64 / counted.iter().copied().map(f64::from).sum::<f64>()
    }
}

/// Takes in a row of an image: inverse depths, 0 where unknown, and colours.
#[inline(always)]
fn take_in<S: Simd>(
    simd: S,
    (image, row): (&RgbdImage, usize),
    (inverses, [red, green, blue]): (&mut [f32], [&mut [f32]; 3]),
) -> Result<(), DepthError> {
    let width = image.size[0];
    let first = row * width;
    let mut are_finite = true;
    let [red, green, blue] = [&mut red[..width], &mut green[..width], &mut blue[..width]];
    for (x, color) in image.colors[first..][..width].iter().enumerate() {
        [red[x], green[x], blue[x]] = *color;
        are_finite &= color[0].is_finite() & color[1].is_finite() & color[2].is_finite();
    }
    if !are_finite {
        image.check_colors(row)?;
    }
    let (zero, one, infinity) = (splat(simd, 0.0), splat(simd, 1.0), splat(simd, f32::INFINITY));
    let least = splat(simd, LEAST_INVERSE);
    let groups = image.depths[first..][..width].chunks(LANES).zip(inverses.chunks_exact_mut(LANES));
    for (group, (own, inverses)) in groups.enumerate() {
        let mut depths = [0.0; LANES];
        depths[..own.len()].copy_from_slice(own);
        if image.kind == DepthKind::AlongRay {
            for (lane, depth) in depths.iter_mut().enumerate() {
                *depth = image.along_axis(first + group * LANES + lane, *depth);
            }
        }
        let depth = F::from_slice(simd, &depths);
        let inverse = one / depth;
        // As in [`RgbdImage::along_axis`].
        let is_known = inverse.simd_gt(least) & inverse.simd_lt(infinity);
        is_known.select(inverse, zero).store_slice(inverses);
    }
    Ok(())
}
