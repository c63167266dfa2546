//! The scene's splats in camera space, in f64.

use super::gaussian::Gaussian;
use super::harmonics;
use super::integral::{Fragment, REACH};
use super::layers::Sample;
use super::shading::{Lighting, Spot};
use super::view::{Ray, View};
use crate::cloud::{Cloud, OpacityFilter};
use crate::color::{linear_to_srgb, srgb_to_linear};
use crate::columns::Kind;
use crate::scene::{Blend, Order, RenderSettings, Scene};
use glam::{DAffine3, DMat3, DVec3, DVec4};
use rayon::prelude::*;

/// Volume kernels end at this squared Mahalanobis distance: e^{-18} of their density.
const FAR_CUT: f64 = REACH * REACH;

/// α of 1 is an infinite optical depth; the most that is drawn is this.
const MOST_OPAQUE: f64 = 1.0 - 1e-9;

/// The steepest slope dz/dx that a surfel's plane is followed along: 86°. Steeper ones are followed as far, lest one seen edge-on before two
/// sheets makes one layer of both.
const STEEPEST: f64 = 15.0;

/// The same of a surfel much smaller than the pixel's filter, whose share of the footprint's area, to the fourth power, decides between both.
const STEEPEST_OF_SMALL: f64 = 1.0;

/// How even the filter makes coverage at most, as the floor says it.
const EVENLY_COVERED: f64 = 0.96;

/// What every ray of a picture shares.
pub(super) struct Setup<'a> {
    pub(super) view: View,
    pub(super) lighting: Lighting,
    pub(super) settings: &'a RenderSettings,
    /// Variance of the filter that splats take up, in squared pixels.
    pub(super) low_pass: f64,
    pub(super) clouds: Vec<Placed<'a>>,
    /// Whether kernels of kind `Opacity` are composited whole, at their centres; else they are spread along the ray.
    pub(super) opacities_are_whole: bool,
}

/// A cloud in camera space.
pub(super) struct Placed<'a> {
    cloud: &'a Cloud,
    first_id: u32,
    to_camera: DAffine3,
    /// Cofactors of the linear part: the inverse transpose times |det|, finite for flat transforms too.
    normal_to_camera: DMat3,
    /// Sign of the determinant; −1 mirrors, and cross products with it.
    handedness: f64,
    volume_scale: f64,
    hides_backs: bool,
}

/// The ball outside which a splat is nothing.
#[derive(Clone, Copy)]
pub(super) struct Ball {
    pub(super) center: DVec3,
    pub(super) radius: f64,
    pub(super) id: u32,
}

/// A surfel or a kernel, ready for rays.
pub(super) enum Splat<'a> {
    Surfel(Surfel<'a>),
    Kernel(Kernel),
}

/// A sample of a surface.
pub(super) struct Surfel<'a> {
    gaussian: Gaussian,
    geometric_normal: DVec3,
    /// The product of the normal and a ray through the centre: of all places on the plane that of the normal and the place is the
    /// same, where rays meet in the eye.
    facing: f64,
    parallel: bool,
    area: f64,
    cutoff: f64,
    /// How far from a sample its plane is followed.
    plane_reach: f64,
    /// With the z and weight of the centre still to be replaced by a ray's.
    prototype: Sample<'a>,
}

/// A part of a volume, shaded.
pub(super) struct Kernel {
    gaussian: Gaussian,
    strength: Amplitude,
    color: DVec3,
    /// Of the centre.
    pub(super) distance: f64,
    /// Whether it is composited there, between surfaces.
    pub(super) is_whole: bool,
    /// Where r ends.
    cutoff: f64,
    pub(super) id: u32,
}

enum Amplitude {
    Mass(f64),
    /// Opacity where the ray passes the centre.
    Peak(f64),
}

impl<'a> Setup<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        camera: &crate::camera::Camera,
        settings: &'a RenderSettings,
        low_pass: f64,
    ) -> Self {
        let world_to_camera = camera.pose().world_to_camera;
        let mut clouds = Vec::with_capacity(scene.clouds.len());
        let mut count = 0usize;
        for cloud in &scene.clouds {
            let to_camera = world_to_camera * cloud.cloud_to_world();
            let linear = to_camera.matrix3;
            let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
            let handedness = linear.determinant().signum();
            clouds.push(Placed {
                cloud,
                first_id: count as u32,
                to_camera,
                normal_to_camera: handedness * DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)),
                handedness,
                volume_scale: linear.determinant().abs(),
                hides_backs: cloud.is_closed_for(camera),
            });
            count += cloud.len();
        }
        let spreads = matches!(settings.order, Order::Slabs { .. } | Order::AxisSheets { .. });
        Self {
            view: View::new(camera),
            lighting: Lighting::new(scene, world_to_camera),
            settings,
            low_pass,
            opacities_are_whole: scene.has_extinctions() || !spreads,
            clouds,
        }
    }

    /// Colours in the space of blending.
    pub(super) fn encode(&self, color: [f32; 3]) -> DVec3 {
        DVec3::from_array(match self.settings.blend {
            Blend::Linear => color.map(f64::from),
            Blend::Display => color.map(|c| f64::from(linear_to_srgb(c))),
        })
    }

    /// Premultiplied, in the space of blending.
    pub(super) fn background(&self) -> DVec4 {
        let [red, green, blue, alpha] = self.settings.background;
        f64::from(alpha) * self.encode([red, green, blue]).extend(1.0)
    }

    /// A splat's colour as it is seen, in the space of blending.
    fn color(&self, placed: &Placed<'_>, index: usize, center: DVec3) -> DVec3 {
        let splats = placed.cloud.columns();
        let Some(own) = &splats.harmonics else { return self.encode(splats.color(index)) };
        // The cloud's own axes are those of its harmonics.
        let to_cloud = placed.to_camera.matrix3.inverse();
        let direction = (to_cloud * self.view.direction(center)).normalize_or_zero();
        let display = DVec3::from_array(splats.color(index).map(|c| f64::from(linear_to_srgb(c))));
        let varying =
            if direction == DVec3::ZERO { DVec3::ZERO } else { harmonics::sum(direction, own.row(index)) };
        let seen = (display + varying).max(DVec3::ZERO);
        match self.settings.blend {
            Blend::Linear => DVec3::from_array(seen.to_array().map(|c| f64::from(srgb_to_linear(c as f32)))),
            Blend::Display => seen,
        }
    }

    /// The filter spreads a splat over a larger shadow, and dims it by as much.
    fn attenuation(&self, filtered: &Gaussian, columns: &[DVec3; 5]) -> f64 {
        let direction = self.view.direction(filtered.center);
        let [a, b, c, ..] = *columns;
        match Gaussian::new(filtered.center, &[a, b, c, DVec3::ZERO, DVec3::ZERO]) {
            Some(bare) if self.low_pass > 0.0 && direction != DVec3::ZERO => {
                bare.shadow(direction) / filtered.shadow(direction)
            }
            Some(_) => 1.0,
            None => 0.0,
        }
    }

    /// The balls of all splats that can be seen at all.
    pub(super) fn balls(&self) -> Vec<Ball> {
        let of_cloud = |placed: &Placed<'a>| {
            let (first_id, count) = (placed.first_id, placed.cloud.len() as u32);
            (0..count)
                .into_par_iter()
                .filter_map(|i| self.ball(placed, i))
                .map(move |mut ball| {
                    ball.id += first_id;
                    ball
                })
                .collect::<Vec<_>>()
        };
        let beyond_near = self.view.beyond_near();
        let mut balls: Vec<Ball> = self.clouds.iter().flat_map(of_cloud).collect();
        balls.retain(|ball| beyond_near.touches(ball.center, ball.radius));
        balls
    }

    fn ball(&self, placed: &Placed<'_>, index: u32) -> Option<Ball> {
        let (center, columns) = self.columns(placed, index as usize);
        if placed.hides_backs {
            let normal = placed.geometric_normal(&columns);
            if normal.dot(self.view.direction(center)) >= 0.0 {
                return None;
            }
        }
        let reach = if placed.cloud.is_surface() { self.settings.outline } else { FAR_CUT };
        // The largest variance: at most the trace, at most the largest row sum of |Σ'| (Gershgorin).
        let trace: f64 = columns.iter().map(|c| c.length_squared()).sum();
        let row_sums: DVec3 = columns.iter().map(|c| c.abs() * c.abs().element_sum()).sum();
        let variance = trace.min(row_sums.max_element()) * (1.0 + 1e-6);
        Some(Ball { center, radius: (reach * variance).sqrt(), id: index })
    }

    /// Centre and a factor of Σ' in camera space.
    fn columns(&self, placed: &Placed<'_>, index: usize) -> (DVec3, [DVec3; 5]) {
        let splats = placed.cloud.columns();
        let center = placed.to_camera.transform_point3(splats.center(index).as_dvec3());
        let factor = placed.to_camera.matrix3 * splats.factor(index).as_dmat3();
        let filter = self.view.filter_at(center.z, self.low_pass);
        let columns = [factor.x_axis, factor.y_axis, factor.z_axis, DVec3::X * filter.x, DVec3::Y * filter.y];
        (center, columns)
    }

    /// The cloud with a splat.
    fn placed(&self, id: u32) -> &Placed<'a> {
        &self.clouds[self.clouds.partition_point(|c| c.first_id <= id) - 1]
    }

    /// As [`Self::splat`], but not the backs of closed surfaces either, which [`Self::balls`] leaves out.
    pub(super) fn seen_splat(&self, id: u32) -> Option<Splat<'a>> {
        let placed = self.placed(id);
        self.ball(placed, id - placed.first_id)?;
        self.splat(id)
    }

    /// The splat with an id, ready for rays; `None` where there is nothing to see of it.
    pub(super) fn splat(&self, id: u32) -> Option<Splat<'a>> {
        let placed = self.placed(id);
        let index = (id - placed.first_id) as usize;
        let splats = placed.cloud.columns();
        let (center, columns) = self.columns(placed, index);
        let gaussian = Gaussian::new(center, &columns)?;
        let color = self.color(placed, index, center);
        let normal = (placed.normal_to_camera * splats.normal(index).as_dvec3()).normalize_or_zero();
        let mut cutoff = FAR_CUT;
        let strength = match splats.kind {
            Kind::Surface(ref surface) => {
                let area = f64::from(splats.strength(index)) * placed.area_scale(index);
                let geometric_normal = placed.geometric_normal(&columns);
                // A shading normal is on the side of the shape's.
                let own = match normal.dot(geometric_normal) {
                    _ if normal == DVec3::ZERO => geometric_normal,
                    cosine if cosine < 0.0 => -normal,
                    _ => normal,
                };
                let filter = self.view.filter_at(center.z, self.low_pass);
                let seen_along = self.view.direction(center);
                // Across the ray.
                let filter_area = filter.x * filter.y * seen_along.z.abs();
                let of_filter = (filter_area / gaussian.shadow(seen_along)).clamp(0.0, 1.0);
                let smallness = of_filter.powi(4);
                let filter_sigma = filter.max_element();
                // What random places lack fades as the root of the area that the filter averages.
                let floor = f64::from(surface.coverage_floor);
                let even = floor.max(EVENLY_COVERED);
                let filtered = |own: f64| even - (even - floor) * own.sqrt();
                let prototype = Sample {
                    z: center.z,
                    plane_z: center.z,
                    thickness: smallness * filter_sigma,
                    id,
                    sigma: 0.0,
                    weight: 0.0,
                    opacity: f64::from(splats.opacity(index)),
                    color,
                    normal: own,
                    back: false,
                    has_sides: surface.closed.has_sides(),
                    material: &splats.material,
                    depth_tolerance: f64::from(surface.depth_tolerance) * placed.volume_scale.cbrt(),
                    cloud_floor: floor,
                    coverage_floor: filtered(self.attenuation(&gaussian, &columns)),
                    even: filtered(1.0 - of_filter),
                };
                let cutoff = self.settings.outline;
                let steepest = STEEPEST + (STEEPEST_OF_SMALL - STEEPEST) * smallness;
                let plane_reach = steepest * cutoff.sqrt() * filter_sigma;
                let facing = geometric_normal.dot(seen_along);
                let parallel = self.view.parallel;
                let surfel = Surfel {
                    gaussian,
                    geometric_normal,
                    facing,
                    parallel,
                    area,
                    cutoff,
                    plane_reach,
                    prototype,
                };
                return Some(Splat::Surfel(surfel));
            }
            Kind::Extinction => Amplitude::Mass(f64::from(splats.strength(index)) * placed.volume_scale),
            Kind::Opacity { filter, least } => {
                let own = f64::from(splats.strength(index));
                cutoff = cutoff.min(2.0 * (own / f64::from(least)).ln());
                let attenuation = match filter {
                    OpacityFilter::Classic => 1.0,
                    OpacityFilter::Compensated => self.attenuation(&gaussian, &columns),
                };
                Amplitude::Peak(own * attenuation)
            }
        };
        let color = if self.settings.shade {
            // A kernel has no sides: its normal is turned to the viewer.
            let seen_along = self.view.direction(center);
            let normal = if normal.dot(seen_along) > 0.0 { -normal } else { normal };
            let spot = Spot { point: center, normal, seen_along };
            self.lighting.shade(color, &splats.material, &spot)
        } else {
            color
        };
        let is_whole = matches!(strength, Amplitude::Peak(_)) && self.opacities_are_whole;
        let distance = self.view.distance(center);
        Some(Splat::Kernel(Kernel { gaussian, strength, color, distance, is_whole, cutoff, id }))
    }
}

impl Placed<'_> {
    /// The unit normal of the plane of a splat's first two half-axes; zero for a needle.
    fn geometric_normal(&self, columns: &[DVec3; 5]) -> DVec3 {
        self.handedness * columns[0].cross(columns[1]).normalize_or_zero()
    }

    /// How the transform scales areas in a splat's plane.
    fn area_scale(&self, index: usize) -> f64 {
        let factor = self.cloud.columns().factor(index).as_dmat3();
        let normal = factor.x_axis.cross(factor.y_axis).normalize_or_zero();
        // Cofactors map area vectors.
        (self.normal_to_camera * normal).length()
    }
}

impl<'a> Surfel<'a> {
    /// The sample that a ray takes. Samples end at the outline, and what they lose there is given back.
    pub(super) fn sample(&self, ray: &Ray, near: f64) -> Option<Sample<'a>> {
        let profile = self.gaussian.along(ray);
        if profile.r > self.cutoff || profile.z < near {
            return None;
        }
        // At the mean of what the filter sees there, which need not lie on the ray.
        let depth = if self.parallel { 1.0 } else { profile.z };
        let cosine = self.facing.abs() / (depth * ray.direction.length());
        let kept = -(-0.5 * self.cutoff).exp_m1();
        let weight = self.area * profile.integral * cosine / kept;
        let normal = self.geometric_normal;
        let on_plane = normal.dot(self.gaussian.center - ray.origin) / normal.dot(ray.direction);
        let plane_z = on_plane.max(profile.z - self.plane_reach).min(profile.z + self.plane_reach);
        let back = self.facing > 0.0;
        let sample = Sample { z: profile.z, plane_z, sigma: profile.sigma, weight, back, ..self.prototype };
        (weight > 0.0).then_some(sample)
    }
}

impl Kernel {
    /// The kernel along a ray.
    pub(super) fn fragment(&self, ray: &Ray) -> Option<Fragment> {
        let profile = self.gaussian.along(ray);
        if profile.r > self.cutoff {
            return None;
        }
        let optical_depth = match self.strength {
            Amplitude::Mass(mass) => mass * profile.integral,
            Amplitude::Peak(peak) => -(-(peak * (-0.5 * profile.r).exp()).min(MOST_OPAQUE)).ln_1p(),
        };
        Some(Fragment { z: profile.z, sigma: profile.sigma, optical_depth, color: self.color })
    }
}
