//! Colours, normals and amplitudes.

use super::super::record::MOST_END;
use super::super::scalar::{EVENLY_COVERED, LARGEST_ALPHA, LEAST_OPACITY};
use super::WideProjector;
use super::geometry::{Footprints, Placed, lanes};
use super::orientation::Spread;
use crate::cloud::OpacityFilter;
use crate::columns::{self, PackedHarmonics};
use crate::harmonics::basis;
use crate::scene::Blend;
use crate::simd::*;

/// Colours in the space of blending, shaded where the splats are a volume's, and normals of length 1, or less if they are means, or zero.
pub(super) struct Colors<S: Simd> {
    pub(super) color: V3<S>,
    pub(super) normal: V3<S>,
}

/// What splats look like.
pub(super) struct Looks<S: Simd> {
    pub(super) amplitude: V<S>,
    pub(super) slope: [V<S>; 2],
    pub(super) color: V3<S>,
    pub(super) normal: V3<S>,
    /// Where r ends.
    pub(super) cutoff: V<S>,
    pub(super) is_seen: M<S>,
}

impl WideProjector<'_> {
    /// The unit vectors from the eye along vectors in cloud space, or along parallel rays.
    #[inline(always)]
    pub(super) fn seen_along<S: Simd>(&self, simd: S, towards: V3<S>) -> V3<S> {
        if self.perspective {
            return normalize_or_zero(simd, towards);
        }
        let forward = self.scalar.camera_to_cloud.matrix3.z_axis.normalize_or_zero();
        splat3(simd, forward.as_vec3().to_array())
    }

    /// The base colours in the space of blending, as they are seen from the eye.
    #[inline(always)]
    fn base_colors<S: Simd>(&self, simd: S, block: usize, towards: V3<S>) -> V3<S> {
        let columns = self.scalar.columns;
        let blend = self.scalar.view.settings.blend;
        let room = &mut Default::default();
        if columns.harmonics.is_none() && blend == Blend::Linear {
            return lanes(simd, *columns.colors.block(block, room));
        }
        let mut encoded = match columns.colors.encoded(block) {
            Some(encoded) => lanes(simd, encoded),
            None => colors_to_srgb(simd, lanes(simd, *columns.colors.block(block, room))),
        };
        if let Some(harmonics) = &columns.harmonics {
            let color = evaluate(simd, harmonics, block, self.seen_along(simd, towards));
            encoded = [0, 1, 2].each(
                #[inline(always)]
                |i| (encoded[i] + color[i]).max(splat(simd, 0.0)),
            );
        }
        if blend == Blend::Display {
            return encoded;
        }
        colors_to_linear(simd, encoded)
    }

    #[inline(always)]
    pub(super) fn colors<S: Simd>(
        &self,
        simd: S,
        block: usize,
        placed: &Placed<S>,
        (towards, spread): (V3<S>, Option<&Spread<S>>),
    ) -> Colors<S> {
        let columns = self.scalar.columns;
        let color = self.base_colors(simd, block, towards);
        let normal = match &columns.normals {
            None => splat3(simd, [0.0; 3]),
            Some(normals) => {
                let mut own = lanes(simd, *normals.block(block));
                if let Some(Spread { kept, shift, .. }) = spread {
                    own = [0, 1, 2].each(
                        #[inline(always)]
                        |i| kept.mul_add(own[i], shift[i]),
                    );
                }
                let unit = normalize_or_zero(simd, Self::transform(simd, &self.normal_to_camera, own));
                if self.scalar.has_means {
                    let length = dot(own, own).sqrt().min(splat(simd, 1.0));
                    unit.each(
                        #[inline(always)]
                        |n| n * length,
                    )
                } else {
                    unit
                }
            }
        };
        let is_surface = matches!(columns.kind, columns::Kind::Surface(_));
        if is_surface || !self.scalar.view.settings.shade {
            return Colors { color, normal };
        }
        let color = self.scalar.shader.shade_wide_two_sided(
            simd,
            color,
            (normal, self.scalar.has_means),
            placed.center,
        );
        Colors { color, normal }
    }

    #[inline(always)]
    pub(super) fn looks<S: Simd, const UNEVEN: bool>(
        &self,
        simd: S,
        block: usize,
        (placed, footprints): (&Placed<S>, &Footprints<S>),
        (Colors { color, normal }, areas): (Colors<S>, V3<S>),
    ) -> Looks<S> {
        let columns = self.scalar.columns;
        let zero = splat(simd, 0.0);
        let strength = V::simd_from(simd, columns.strengths.block(block, &mut Default::default())[0])
            * self.strength_scale;
        let cutoff = splat(simd, self.cutoff);
        match &columns.kind {
            columns::Kind::Extinction => {
                let amplitude = strength * footprints.unit_integral;
                let is_seen = amplitude.simd_gt(zero);
                Looks { amplitude, slope: [zero; 2], color, normal, cutoff, is_seen }
            }
            columns::Kind::Opacity { filter, least } => {
                let of_filter = match &columns.opacities_of_own {
                    None => zero,
                    Some(sums) => {
                        let more = V::simd_from(simd, sums.block(block)[0]) - strength;
                        let [root, _, other] = footprints.conic_root;
                        more.max(zero) * (root * other * self.low_pass)
                    }
                };
                let undimmed = strength + of_filter;
                let attenuation = match filter {
                    OpacityFilter::Classic => footprints.gain,
                    OpacityFilter::Compensated => footprints.attenuation,
                };
                let amplitude = (undimmed * attenuation).min(splat(simd, LARGEST_ALPHA as f32));
                let times_least = (amplitude * (1.0 / self.least_opacity))
                    .min(undimmed * (1.0 / least.max(LEAST_OPACITY as f32)));
                let one = splat(simd, 1.0);
                let is_seen = times_least.simd_gt(one);
                let end = log2(simd, times_least.max(one));
                const TWO_LN2: f32 = 2.0 * std::f32::consts::LN_2;
                let cutoff = cutoff.min(end * TWO_LN2);
                let end = end.min(splat(simd, MOST_END - 1.0)) * (1.0 / MOST_END);
                Looks { amplitude, slope: [zero, end], color, normal, cutoff, is_seen }
            }
            columns::Kind::Surface(surface) => {
                let even = surface.coverage_floor.max(EVENLY_COVERED as f32);
                let lacks = splat(simd, surface.coverage_floor - even);
                let own = footprints.attenuation.sqrt();
                let floor = match &columns.grains {
                    None => lacks.mul_add(own, splat(simd, even)),
                    Some(grains) => {
                        let own = own * V::simd_from(simd, grains.block(block)[0]);
                        let between = least_between_cells(simd, surface.overlap, footprints.attenuation);
                        lacks.mul_add(own, splat(simd, even)).min(between)
                    }
                };
                let coverage = strength * footprints.unit_integral / floor;
                let facing = dot(areas, placed.ray);
                let amplitude = coverage * facing;
                let slope = [0, 1].each(
                    #[inline(always)]
                    |i| areas[i] * coverage * (1.0 / self.focal[i]),
                );
                // The side that is seen is the shape's; a shading normal agrees with it.
                let cosine = dot(normal, areas);
                let turned = cosine.simd_lt(zero);
                let bare = dot(normal, normal).simd_eq(zero);
                let own = if UNEVEN { normalize_or_zero(simd, areas) } else { areas };
                let normal = [0, 1, 2].each(
                    #[inline(always)]
                    |i| bare.select(own[i], turned.select(-normal[i], normal[i])),
                );
                let mut is_seen = amplitude.abs().simd_gt(zero)
                    | slope[0].abs().simd_gt(zero)
                    | slope[1].abs().simd_gt(zero);
                if self.scalar.hides_backs {
                    is_seen &= facing.simd_lt(zero);
                }
                Looks { amplitude, slope, color, normal, cutoff, is_seen }
            }
        }
    }
}

/// As in [`super::super::scalar`].
#[inline(always)]
fn least_between_cells<S: Simd>(simd: S, overlap: f32, attenuation: V<S>) -> V<S> {
    let one = splat(simd, 1.0);
    let exponent = (one + one / attenuation) * (-std::f32::consts::PI.powi(2) * overlap);
    (-splat(simd, 4.0)).mul_add(exp(simd, exponent), one)
}

/// Harmonics of the splats of a block, seen along unit vectors.
#[inline(always)]
fn evaluate<S: Simd>(simd: S, harmonics: &PackedHarmonics, block: usize, direction: V3<S>) -> V3<S> {
    let [x, y, z] = direction;
    let values = basis(x, y, z).each(
        #[inline(always)]
        |value| value * harmonics.unit,
    );
    let pairs = harmonics.block(block);
    let per_channel = harmonics.pairs_per_channel();
    [0, 1, 2].each(
        #[inline(always)]
        |channel| {
            let mut sum = splat(simd, 0.0);
            for (number, pair) in pairs[channel * per_channel..][..per_channel].iter().enumerate() {
                let pair: i32x8<S> = u32x8::simd_from(simd, *pair).bitcast();
                let low: V<S> = ((pair << 16) >> 16).to_float();
                let high: V<S> = (pair >> 16).to_float();
                sum = low.mul_add(values[2 * number], sum);
                if 2 * number + 1 < values.len() {
                    sum = high.mul_add(values[2 * number + 1], sum);
                }
            }
            sum
        },
    )
}
