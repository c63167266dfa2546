//! The numbers of an image, each in rows of its own.

use super::lanes::*;
use super::{DepthError, DepthKind, LEAST_INVERSE, RgbdImage};
use oblate_engine::simd::{Level, dispatch};
use rayon::prelude::*;

/// What surfels are made from.
#[derive(Default)]
pub(super) struct ImageRows {
    /// Inverse depths along the axis, 0 where unknown.
    pub(super) inverses: Bordered,
    pub(super) colors: [Bordered; 3],
    /// Of all inverse depths.
    pub(super) inverse_sum: f64,
}

impl ImageRows {
    /// Of an image, in the memory of another's.
    pub(super) fn of(level: Level, image: &RgbdImage, memory: Self) -> Result<Self, DepthError> {
        image.check_shape()?;
        let mut inverses = memory.inverses.renewed(image.size);
        let mut colors = memory.colors.map(|old| old.renewed(image.size));
        let [red, green, blue] = colors.each_mut().map(Bordered::rows);
        let rows = inverses.rows().zip(red.zip(green).zip(blue)).enumerate();
        let sum_of = |(row, (inverses, ((red, green), blue)))| {
            let to = (inverses, [red, green, blue]);
            dispatch!(level, simd => take_in(simd, (image, row), to))
        };
        // Summed by rows: the same for any number of threads.
        let sums: Vec<Result<f64, DepthError>> = rows.map(sum_of).collect();
        let inverse_sum = sums.into_iter().sum::<Result<f64, _>>()?;
        Ok(Self { inverses, colors, inverse_sum })
    }
}

/// Takes in a row of an image: inverse depths, 0 where unknown, and colours. Gives the sum of the inverse depths.
#[inline(always)]
fn take_in<S: Simd>(
    simd: S,
    (image, row): (&RgbdImage, usize),
    (inverses, [red, green, blue]): (&mut [f32], [&mut [f32]; 3]),
) -> Result<f64, DepthError> {
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
    let mut sum = zero;
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
        let inverse = is_known.select(inverse, zero);
        inverse.store_slice(inverses);
        sum += inverse;
    }
    let sums: [f32; LANES] = sum.into();
    Ok(sums.into_iter().map(f64::from).sum())
}
