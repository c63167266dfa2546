//! When what is open along a ray is closed: the policies of [`Order`], as the stages need them.
//!
//! Slabs lie between spheres around the eye (planes where rays are parallel): a round kernel is equally far at all its
//! pixels, so that most kernels are shared out by one number, and turning the camera changes nothing.
//!
//! **Matched slabs.** Slabs spread what lies in them: a kernel's part could be anywhere in a slab of thickness d, which adds
//! a variance of d²/12, and without order in the slab as much again. So a kernel is shared out as if its variance along
//! the ray were less by d²/6, and the spread that results is its own. Where it is about as wide as a slab then it is a box,
//! which touches two slabs and costs a clamp, never narrower than a slab; where it is wider it is a normal distribution,
//! and the picture converges to the integral as d shrinks.

use crate::camera::{Camera, Projection};
use crate::cloud::Cloud;
use crate::columns::{Factors, Kind};
use crate::cull::VisibleRange;
use crate::footprint::Lens;
use crate::scene::{Baseline, Order, Scene};
use crate::simd::*;
use crate::validate::SceneError;
use crate::view::SceneView;
use glam::{DVec3, Vec3};

/// A policy, with what it needs to know of a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Closing {
    /// After each kernel, by distance; those whose distances differ by less come in the order of their places.
    Centers { alike: f32 },
    /// After each kernel, by depth in a window.
    PerPixel,
    /// At planes.
    Slabs(Slabs),
    /// At sheets of a grid.
    Sheets(Sheets),
}

/// Slabs by distance from the eye, or from its plane where rays are parallel; the first begins at the near plane, or one slab before it where
/// opacities are composited whole.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slabs {
    near: f64,
    thickness: f64,
    lens: Lens,
    /// What slabs add to the variance of kernels, in units of d².
    added: f32,
    /// See [`Self::are_level`].
    level: f32,
    /// Whether opacities are composited whole, as they are defined; else they are spread as extinctions are.
    opacities_are_whole: bool,
}

/// Sheets of a grid, by the centres of kernels in camera space: number p·normal + offset, rounded down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sheets {
    pub(crate) normal: Vec3,
    pub(crate) offset: f32,
}

/// Kernels along the rays that meet them.
pub(crate) struct Distances<F> {
    /// Of the centre.
    pub(crate) center: F,
    /// Of the densest point, its change a pixel.
    pub(crate) slope: [F; 2],
    /// Spread.
    pub(crate) sigma: F,
}

/// How a kernel is spread over slabs.
pub(crate) struct Spread<F> {
    /// 1/σ in world units.
    pub(crate) inverse: F,
    /// How far it reaches to either side, in world units.
    pub(crate) half: F,
    /// How much of it is a normal distribution; the rest is a box.
    pub(crate) normal_part: F,
}

/// The least variance of a box, in units of d²: it is as wide as a slab. A kernel thinner than that is not, but were its box
/// narrower it would jump from slab to slab; so its share of two slabs is linear in where it is, whatever the slabs' phase.
/// Half as wide a box has 1.4 times the error in clouds of mixed sizes and 2.3 times in thick slabs; wider ones blur.
const LEAST_VARIANCE: f32 = 1.0 / 12.0;

/// The largest variance of a box, in units of d²: with a little more than that of a slab, kernels whose σ_z are about the
/// same are all boxes at a thickness of 2σ_z.
const WIDEST_BOX: f32 = 1.5 / 12.0;

/// From this variance on, in units of d², a kernel is a normal distribution. Between the two it is a part of both, so that
/// nothing jumps when it turns.
const NARROWEST_NORMAL: f32 = 0.25;

/// [`share_of_normal`] ends at this many of its σ.
const NORMAL_REACH: f32 = 3.5;

/// A normal distribution's slabs are those within as many of its σ; the first and the last get what is beyond. In slabs of σ two kernels
/// with an optical depth of 4 are off by 0.010 with 2.4 and by 0.003 with 2.8.
pub(crate) const SLAB_REACH: f32 = 2.8;

/// What reaches farther than a slab to either side, but no farther than as many, ends after one, and touches three: where samples are alike
/// all kernels do in slabs of 1.5σ. Two kernels at the worst place are off by two to four times as much, in half the time.
const ENDS_AT_THREE: f32 = 1.6;

/// The width of a box with σ = 1.
pub(crate) const BOX: f32 = 3.464_101_6;

/// The share of a normal distribution before x of its σ: an odd polynomial and ½ with the variance of Φ, within 2.4e-4 of it, never
/// below 0 or above 1.
#[inline(always)]
pub(crate) fn share_of_normal<S: Simd, F: Floats<S>>(simd: S, x: F) -> F {
    const HALF_PHI: [f32; 6] =
        [0.398_070_34, -0.064_418_78, 0.008_528_793, -0.000_727_582_9, 3.493_727_5e-5, -7.075_79e-7];
    let reach = F::simd_from(simd, NORMAL_REACH);
    let x = x.max(-reach).min(reach);
    x.mul_add(polynomial(simd, x * x, HALF_PHI), F::simd_from(simd, 0.5))
}

/// The share of a box before x of its σ.
#[inline(always)]
pub(crate) fn share_of_box<S: Simd, F: Floats<S>>(simd: S, x: F) -> F {
    let (zero, half, one) = (F::simd_from(simd, 0.0), F::simd_from(simd, 0.5), F::simd_from(simd, 1.0));
    x.mul_add(F::simd_from(simd, 1.0 / BOX), half).max(zero).min(one)
}

/// The share of a kernel before x of its σ that is a normal distribution by a part, and a box by the rest.
#[inline(always)]
pub(crate) fn share_before<S: Simd, F: Floats<S>>(simd: S, x: F, normal_part: F) -> F {
    let of_box = share_of_box(simd, x);
    (share_of_normal(simd, x) - of_box).mul_add(normal_part, of_box)
}

/// See [`Slabs::are_level`]; in tolerances, for optical depths from a tenth up, and for smaller ones that times a tenth over them.
const LEVEL: f32 = 2.5;
const LEAST_STEEP: f32 = 0.1;

/// Slabs go by the clouds with the smallest kernels, down to this share of the largest: a kernel that touches ten thousand slabs
/// would take as long as a thousand that touch one or two each.
pub(crate) const LARGEST_RATIO: f64 = 1024.0;

/// Behind it there are no others: sorting has as many bits, and single precision tells as many distances apart.
const LAST_SLAB: u32 = (1 << 22) - 1;

impl Closing {
    /// What a frame's order asks for, of the kernels in ranges.
    ///
    /// # Errors
    /// When sheets are asked for and the first cloud of kernels is no grid.
    pub(crate) fn new(view: SceneView, visible: &[VisibleRange]) -> Result<Self, SceneError> {
        let SceneView { scene, camera, settings } = view;
        let mut volumes = scene.clouds.iter().filter(|cloud| !cloud.is_surface());
        let thickness = match settings.order {
            Order::Auto if !scene.has_extinctions() => return Ok(Self::Centers { alike: 0.0 }),
            Order::Auto => Order::THICKNESS,
            Order::Slabs { thickness } => thickness,
            Order::Centers => return Ok(Self::Centers { alike: 0.0 }),
            Order::Shells { thickness } => {
                return Ok(Self::Centers { alike: (thickness * least_sigma(scene, visible)) as f32 });
            }
            Order::PerPixel => return Ok(Self::PerPixel),
            Order::AxisSheets { spacing } => {
                return Sheets::new(volumes.next(), camera, spacing).map(Self::Sheets);
            }
        };
        let sigma = least_sigma(scene, visible);
        let farthest = visible.iter().map(|range| range.distances[1]).fold(0.0, f32::max);
        let depth = (f64::from(farthest) - camera.near()).max(0.0);
        let is_corrected = settings.baseline != Some(Baseline::UncorrectedShares);
        let thickness = (thickness * sigma).max(depth / f64::from(LAST_SLAB));
        let opacities_are_whole = scene.has_opacities() && scene.has_extinctions();
        Ok(Self::Slabs(Slabs {
            lens: view.lens(),
            near: camera.near() - if opacities_are_whole { thickness } else { 0.0 },
            thickness,
            added: if is_corrected { 1.0 / 6.0 } else { 0.0 },
            level: LEVEL * settings.tolerance as f32,
            opacities_are_whole,
        }))
    }

    /// By how much distances may differ and count as equal, where kernels come by these.
    pub(crate) fn alike(&self) -> f32 {
        if let Self::Centers { alike } = *self { alike } else { 0.0 }
    }

    /// Whether records need the numbers of their slabs.
    pub(crate) fn has_slabs(self) -> bool {
        matches!(self, Self::Slabs(_) | Self::Sheets(_))
    }

    /// Whether opacities are composited whole, at their centres, and extinctions are spread over slabs.
    pub(crate) fn is_mixed(&self) -> bool {
        matches!(self, Self::Slabs(slabs) if slabs.opacities_are_whole)
    }

    /// Whether kernels of a kind are composited whole where others are spread.
    pub(crate) fn takes_whole(&self, kind: &Kind) -> bool {
        self.is_mixed() && matches!(kind, Kind::Opacity { .. })
    }

    /// The same for a picture of every second pixel, or of still fewer.
    pub(crate) fn of_every(self, step: usize) -> Self {
        match self {
            Self::Slabs(slabs) => Self::Slabs(Slabs { lens: slabs.lens.of_every(step), ..slabs }),
            other => other,
        }
    }

    /// Of slabs; 0 of sheets.
    #[inline(always)]
    pub(crate) fn thickness(&self) -> f32 {
        if let Self::Slabs(slabs) = self { slabs.thickness() } else { 0.0 }
    }

    /// The slabs that kernels may touch, first and last, as numbers; sheets by their centres in camera space. `reach` is how
    /// far from their centres their densest points are at most.
    #[inline(always)]
    pub(crate) fn numbers<S: Simd, F: Floats<S>>(
        &self,
        simd: S,
        center: [F; 3],
        (distance, sigma, reach): (F, F, F),
    ) -> [F; 2] {
        let ends = match self {
            Self::Centers { .. } | Self::PerPixel => return [F::simd_from(simd, 0.0); 2],
            Self::Slabs(slabs) => {
                let half = slabs.half(simd, sigma, reach);
                let from_near = distance - slabs.near as f32;
                let per_length = (1.0 / slabs.thickness) as f32;
                [(from_near - half) * per_length, (from_near + half) * per_length]
            }
            Self::Sheets(Sheets { normal, offset }) => {
                [dot(center, splat3(simd, normal.to_array())) + F::simd_from(simd, *offset); 2]
            }
        };
        let (zero, last) = (F::simd_from(simd, 0.0), F::simd_from(simd, LAST_SLAB as f32));
        ends.each(
            #[inline(always)]
            |number| number.max(zero).min(last).floor(),
        )
    }

    /// Where among slabs a kernel is composited whole: the number of a slab, and as a fraction the part of it before the kernel. The first slab
    /// has all that lies before the near plane, however far, and nothing that is spread.
    #[inline(always)]
    pub(crate) fn center_among_slabs<S: Simd, F: Floats<S>>(&self, simd: S, distance: F) -> F {
        let [zero, one, last] = [0.0, 1.0, LAST_SLAB as f32].each(
            #[inline(always)]
            |number| F::simd_from(simd, number),
        );
        let Self::Slabs(slabs) = self else { return zero };
        let place = (distance - slabs.near as f32) * (1.0 / slabs.thickness) as f32;
        place.simd_ge(one).select(place.min(last), one / ((one - place).max(zero) + one))
    }

    /// As [`Self::center_among_slabs`], of one kernel.
    pub(crate) fn center_of_one(&self, distance: f32) -> f32 {
        dispatch!(Level::Baseline, simd => {
            let distance: V<_> = splat(simd, distance);
            self.center_among_slabs(simd, distance).reduce_max()
        })
    }

    /// As [`Self::numbers`], of one kernel.
    pub(crate) fn numbers_of_one(&self, center: Vec3, [distance, sigma, reach]: [f64; 3]) -> [f32; 2] {
        dispatch!(Level::Baseline, simd => {
            let [distance, sigma, reach] = [distance, sigma, reach].map(|x| splat(simd, x as f32));
            let center = center.to_array().map(|x| splat(simd, x));
            self.numbers(simd, center, (distance, sigma, reach)).map(|number| number.reduce_max())
        })
    }
}

/// The σ that orders go by: the least of what clouds draw that are spread, if that is not too small beside the largest; 1 where there is none.
fn least_sigma(scene: &Scene, visible: &[VisibleRange]) -> f64 {
    let ends = |[least, largest]: [f64; 2], sigma: f64| [least.min(sigma), largest.max(sigma)];
    let [least, largest] = drawn_sigmas(scene, visible).fold([f64::INFINITY, 0.0], ends);
    if largest > 0.0 { least.max(largest / LARGEST_RATIO) } else { 1.0 }
}

/// The size of the kernels of each cloud, as it is drawn: of several levels of detail the geometric mean over the splats of
/// their medians. Clouds that have levels count where they are seen, others always.
fn drawn_sigmas(scene: &Scene, visible: &[VisibleRange]) -> impl Iterator<Item = f64> {
    let mut sums = vec![[0.0, 0.0]; scene.clouds.len()];
    for range in visible {
        let cloud = &scene.clouds[range.cloud];
        if let Some(sigma) = cloud.median_sigma(range.level)
            && cloud.levels().len() > 1
        {
            let count = range.count(cloud.levels()) as f64;
            sums[range.cloud][0] += count;
            sums[range.cloud][1] += count * sigma.ln();
        }
    }
    // Opacities beside extinctions are not spread.
    let is_spread = |cloud: &Cloud| cloud.is_medium() || !scene.has_extinctions();
    let clouds = scene.clouds.iter().zip(sums).filter(move |(cloud, _)| is_spread(cloud));
    clouds.filter_map(|(cloud, [count, sum])| match cloud.levels().len() {
        1 => cloud.median_sigma(0),
        _ => (count > 0.0).then(|| (sum / count).exp()),
    })
}

impl Slabs {
    /// Distances of kernels by their means in pixels, the z of these, its slope and σ_z.
    #[inline(always)]
    pub(crate) fn distances<S: Simd, F: Floats<S>>(
        &self,
        simd: S,
        mean: [F; 2],
        (depth, slope, sigma_z): (F, [F; 2], F),
    ) -> Distances<F> {
        if self.is_parallel() {
            return Distances { center: depth, slope, sigma: sigma_z };
        }
        let [x, y, z] = self.lens.positions(mean, F::simd_from(simd, 1.0));
        let length = dot([x, y, z], [x, y, z]).sqrt();
        // z|v| changes with z and with |v|, whose slope is v/(f|v|).
        let turning = depth / length;
        let focal = self.lens.focal.as_vec2();
        Distances {
            center: depth * length,
            slope: [
                slope[0].mul_add(length, x * turning * (1.0 / focal.x)),
                slope[1].mul_add(length, y * turning * (1.0 / focal.y)),
            ],
            sigma: sigma_z * length,
        }
    }

    /// How kernels are spread.
    #[inline(always)]
    pub(crate) fn spread<S: Simd, F: Floats<S>>(&self, simd: S, sigma: F) -> Spread<F> {
        let (zero, one) = (F::simd_from(simd, 0.0), F::simd_from(simd, 1.0));
        let thickness = self.thickness as f32;
        let relative = sigma * (1.0 / thickness);
        let variance = relative.mul_add(relative, F::simd_from(simd, -self.added));
        let variance = variance.max(F::simd_from(simd, LEAST_VARIANCE));
        let normal_part = (variance - WIDEST_BOX) * (1.0 / (NARROWEST_NORMAL - WIDEST_BOX));
        let sigma = variance.sqrt() * thickness;
        let is_box = normal_part.simd_le(zero);
        let reach = is_box.select(F::simd_from(simd, 0.5 * BOX), F::simd_from(simd, SLAB_REACH));
        Spread { inverse: one / sigma, half: sigma * reach, normal_part: normal_part.max(zero).min(one) }
    }

    /// How far to either side kernels are in slabs, from how far their densest points are from the centre at most. A
    /// box that reaches a little over half a slab ends there, so that it touches two slabs, and not now and then three; what reaches up to
    /// [`ENDS_AT_THREE`] slabs ends after one. The last slabs get what is beyond them.
    #[inline(always)]
    fn half<S: Simd, F: Floats<S>>(&self, simd: S, sigma: F, reach: F) -> F {
        let Spread { half, normal_part, .. } = self.spread(simd, sigma);
        let is_box = normal_part.simd_le(F::simd_from(simd, 0.0));
        let (thickness, all) = (self.thickness as f32, half + reach);
        let [half, most_of_half, one, most_of_one] = [0.499, 0.75, 0.999, ENDS_AT_THREE].each(
            #[inline(always)]
            |count| F::simd_from(simd, count * thickness),
        );
        let all = all.simd_le(most_of_one).select(all.min(one), all);
        (is_box & all.simd_le(most_of_half)).select(all.min(half), all)
    }

    /// Which kernels are shared out alike at all their pixels: those whose shares before all planes between their slabs, `planes` of them,
    /// have a small standard deviation over the footprint, as it follows from that of their distances. A box's share is the steepest.
    ///
    /// 0.8 times that part of a kernel, of either sign, then lies in the neighbouring slab: of its optical depth at most a fifth of the
    /// tolerance, or two tolerances of it (0.8 % at 1/255) where it is above a tenth. A slab shows that by its own optical depth, and what its kernels move to and fro cancels
    /// where their places are even.
    #[inline(always)]
    pub(crate) fn are_level<S: Simd, F: Floats<S>>(
        &self,
        simd: S,
        (deviation, inverse, planes): (F, F, F),
        optical_depth: F,
    ) -> F::Mask {
        let weight = (optical_depth * (1.0 / LEAST_STEEP)).min(F::simd_from(simd, 1.0));
        (deviation * inverse * planes * weight).simd_le(F::simd_from(simd, self.level * BOX))
    }

    /// Whether distances are depths.
    pub(crate) fn is_parallel(&self) -> bool {
        self.lens.projection == Projection::Orthographic
    }

    /// How far a slab begins.
    #[inline(always)]
    pub(crate) fn begin(&self, number: u32) -> f32 {
        self.thickness.mul_add(f64::from(number), self.near) as f32
    }

    /// The slabs that distances lie in.
    #[inline(always)]
    pub(crate) fn numbers_at(&self, distances: [f32; 2]) -> [u32; 2] {
        let (near, per_length) = (self.near as f32, 1.0 / self.thickness as f32);
        distances.map(|distance| ((distance - near) * per_length) as u32)
    }

    #[inline(always)]
    pub(crate) fn thickness(&self) -> f32 {
        self.thickness as f32
    }
}

impl Sheets {
    fn new(cloud: Option<&Cloud>, camera: &Camera, spacing: f64) -> Result<Self, SceneError> {
        let Some((cloud, Factors::Shared(factor))) = cloud.map(|cloud| (cloud, &cloud.columns().factors))
        else {
            return Err(SceneError::NoGrid);
        };
        let cloud_to_camera = camera.pose().world_to_camera * cloud.cloud_to_world();
        // Distances in σ along the half-axes.
        let to_grid = (cloud_to_camera.matrix3 * factor.as_dmat3()).inverse();
        if cloud.is_empty() || !to_grid.is_finite() {
            return Err(SceneError::NoGrid);
        }
        let center =
            |index: usize| cloud_to_camera.transform_point3(cloud.columns().center(index).as_dvec3());
        let (first, middle) = (center(0), (0..cloud.len()).map(center).sum::<DVec3>());
        let view = if camera.projection() == Projection::Perspective { middle } else { DVec3::Z };
        let axes = [0, 1, 2].map(|axis| to_grid.row(axis));
        let facing = |axis: &DVec3| axis.normalize().dot(view);
        let axis =
            axes.into_iter().max_by(|a, b| facing(a).abs().total_cmp(&facing(b).abs())).unwrap_or(DVec3::Z);
        let normal = axis * facing(&axis).signum() / spacing;
        // A sheet's kernels lie in its middle; the nearest have numbers from 0 on.
        let least = (0..cloud.len()).map(|index| normal.dot(center(index) - first)).fold(0.0, f64::min);
        Ok(Self { normal: normal.as_vec3(), offset: (0.5 - least.floor() - normal.dot(first)) as f32 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pose;

    fn slabs(added: f32) -> Slabs {
        let pose = Pose::look_at(DVec3::ZERO, DVec3::Z, DVec3::Y).unwrap();
        let camera = Camera::perspective(pose, 0.5, [8, 8]).unwrap();
        Slabs {
            near: 0.25,
            thickness: 0.5,
            lens: Lens::new(&camera, 0.3),
            added,
            level: 0.0,
            opacities_are_whole: false,
        }
    }

    /// The share of a kernel with σ before a distance x from its centre.
    fn share(slabs: &Slabs, sigma: f32, x: f32) -> f64 {
        dispatch!(Level::Baseline, simd => {
            let Spread { inverse, normal_part, .. } = slabs.spread(simd, splat(simd, sigma));
            f64::from(share_before(simd, inverse * x, normal_part).reduce_max())
        })
    }

    /// The variance of what shares tell, by parts: ∫ 2x (1 − F(x)) dx twice, for both sides are alike.
    fn variance(slabs: &Slabs, sigma: f32) -> f64 {
        let step = 1e-3 * sigma.max(0.1);
        (0..8000)
            .map(|i| {
                let x = (i as f32 + 0.5) * step;
                4.0 * f64::from(x) * (1.0 - share(slabs, sigma, x)) * f64::from(step)
            })
            .sum()
    }

    #[test]
    fn shares_and_slabs_together_spread_a_kernel_as_it_is() {
        let slabs = slabs(1.0 / 6.0);
        for sigma in [0.25, 0.26, 0.27, 0.3, 0.4, 0.7, 2.0] {
            // The slab adds d²/12, and that there is no order in it as much again.
            let found = variance(&slabs, sigma) + 0.5 * 0.5 / 6.0;
            let expected = f64::from(sigma * sigma);
            // The polynomial's variance is 1 within 3e-4.
            assert!((found - expected).abs() <= 1e-3 * expected, "σ = {sigma}: {found}, not {expected}");
        }
        // What is thinner is as wide as a slab.
        let thin = variance(&slabs, 0.1);
        assert!((thin - 0.5f64.powi(2) / 12.0).abs() < 1e-4, "{thin}");
    }

    #[test]
    fn shares_change_smoothly_with_the_kernel() {
        // A thousandth more σ is σ²/σ'² thousandths more σ', which moves a share by half of that at most: x ≤ √3 σ' in a box.
        // From box to normal distribution it is a change of 5e-3 at most of their difference, 0.06.
        let slabs = slabs(1.0 / 6.0);
        for i in 0..2000 {
            let sigma = 0.05 + 5e-4 * i as f32;
            let ratio = 1.0 / (1.0 - 0.25 / 6.0 / f64::from(sigma * sigma)).max(1.0 / 3.0);
            for x in [0.05, 0.1, 0.2, 0.3, 0.5, 0.9] {
                let change = share(&slabs, sigma * 1.001, x) - share(&slabs, sigma, x);
                assert!(change.abs() < 1e-3 * (0.5 * ratio + 0.5), "σ = {sigma}, x = {x}: {change}");
            }
        }
    }

    #[test]
    fn a_kernel_is_within_its_slabs() {
        let closing = Closing::Slabs(slabs(1.0 / 6.0));
        let Closing::Slabs(slabs) = &closing else { unreachable!() };
        for i in 0..400 {
            let (distance, sigma) = (1.0 + 0.011 * f64::from(i), 0.02 + 0.004 * f64::from(i));
            let [first, last] = closing.numbers_of_one(Vec3::ZERO, [distance, sigma, 0.0]);
            assert!(first <= last && first.fract() == 0.0 && last.fract() == 0.0);
            let before = share(slabs, sigma as f32, slabs.begin(first as u32) - distance as f32);
            let until = share(slabs, sigma as f32, slabs.begin(last as u32 + 1) - distance as f32);
            // A normal distribution that ends after three slabs lacks 4 % on either side at most; a box wider than a slab, by
            // 22 % at most, may end before it.
            assert!(before < 0.1 && until > 0.9, "{distance}, {sigma}: {before}, {until}");
            // Slabs are 0.5 thick: 1.85σ, and 1.5σ.
            assert!(sigma > 0.27 || last <= first + 1.0, "{distance}, {sigma}: from {first} to {last}");
            assert!(sigma > 0.5 / 1.49 || last <= first + 2.0, "{distance}, {sigma}: from {first} to {last}");
        }
    }

    #[test]
    fn distances_of_round_kernels_have_no_slope() {
        // Seen from aside the depth of a ball's densest points falls as its rays turn away, their distance doesn't.
        let slabs = slabs(1.0 / 6.0);
        let (center, sigma) = (DVec3::new(0.8, -0.5, 4.0), 0.3);
        let pose = Pose::look_at(DVec3::ZERO, DVec3::Z, -DVec3::Y).unwrap();
        let camera = Camera::perspective(pose, 0.5, [8, 8]).unwrap();
        let splat_in_camera =
            crate::footprint::CameraSplat { center, factor: glam::DMat3::from_diagonal(DVec3::splat(sigma)) };
        let footprint = crate::footprint::Footprint::new(&splat_in_camera, &Lens::new(&camera, 0.0)).unwrap();
        let [distance, slope, spread] = dispatch!(Level::Baseline, simd => {
            let of = |x: f64| splat(simd, x as f32);
            let mean = [of(footprint.mean.x), of(footprint.mean.y)];
            let kernel = (
                of(footprint.depth),
                [of(footprint.depth_slope.x), of(footprint.depth_slope.y)],
                of(footprint.sigma_z),
            );
            let Distances { center, slope, sigma } = slabs.distances(simd, mean, kernel);
            [center, slope[0].abs().max(slope[1].abs()), sigma].map(|x| f64::from(x.reduce_max()))
        });
        assert!((distance - center.length()).abs() < 1e-5, "{distance}");
        assert!((spread - sigma).abs() < 1e-5, "{spread}");
        // In world units a pixel; the depth's is 0.005 here.
        assert!(slope < 1e-6, "{slope}");
        assert!(footprint.depth_slope.length() > 1e-3);
    }
}
