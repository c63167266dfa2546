//! One splat to a record in f64: the specification of the wide projection, and what it leaves to be done for splats
//! that reach the camera plane or cover no area of their own.

use super::ewa::{CameraSplat, Footprint, Lens, MEAN_DEVIATION};
use super::record::{Form, Kind, MOST_END, MOST_SLABS, NO_END, Record, Rect};
use super::{Projected, SurfaceSample, cutoff_gain};
use crate::camera::{Camera, Projection};
use crate::closing::Closing;
use crate::cloud::{Cloud, OpacityFilter, area_scale};
use crate::color::{linear_to_srgb, srgb_to_linear};
use crate::columns::{self, Columns};
use crate::cull::{Frustum, VisibleRange};
use crate::harmonics::basis;
use crate::levels::{Level, Orientation, Shown};
use crate::occlusion::Looked;
use crate::scene::{Blend, FootprintForm, RenderSettings};
use crate::shade::Shader;
use crate::simd::{self, SimdBase as _, dispatch};
use glam::{DAffine3, DMat3, DVec3, Vec3};

/// The largest amplitude: what is beyond it is opaque whatever its value, and sums stay finite.
pub(super) const MOST_AMPLITUDE: f32 = 1e20;

/// The largest amplitude times colour: thousands of these can be summed up.
pub(super) const MOST_SUMMED: f32 = 1e35;

/// Colours beyond 1e33 leave amplitudes as large as this, which is opaque.
pub(super) const OPAQUE_AMPLITUDE: f32 = 100.0;

/// Rounds an amplitude.
fn single(x: f64) -> f32 {
    let most = f64::from(MOST_AMPLITUDE);
    x.clamp(-most, most) as f32
}

/// What every projector of a frame shares.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) camera: &'a Camera,
    pub(super) settings: &'a RenderSettings,
    pub(super) lens: Lens,
    pub(super) frustum: Frustum,
    pub(super) closing: Closing,
    pub(super) looked: Option<&'a Looked>,
    /// Pixels in a row of a tile.
    pub(super) tile_side: f32,
}

/// Projects the splats of one cloud.
pub(super) struct Projector<'a> {
    /// Of the cloud.
    pub(super) levels: &'a [Level],
    /// Of the level whose splats are projected.
    pub(super) columns: &'a Columns,
    pub(super) cloud_index: u16,
    pub(super) shader: Shader<'a>,
    pub(super) view: View<'a>,
    pub(super) cloud_to_camera: DAffine3,
    pub(super) camera_to_cloud: DAffine3,
    pub(super) normal_to_camera: DMat3,
    pub(super) determinant: f64,
    /// Of a surface that is closed for the viewer only what faces that viewer is seen.
    pub(super) hides_backs: bool,
    /// What is seen of surfels that stand for others.
    pub(super) shown: Shown,
    /// Whether splats stand for others, and their normals are means, shorter than 1.
    pub(super) has_means: bool,
}

impl<'a> Projector<'a> {
    /// Projects splats of a range of a cloud.
    pub(super) fn new(cloud: &'a Cloud, range: &VisibleRange, shader: Shader<'a>, view: View<'a>) -> Self {
        let cloud_to_camera = view.camera.pose().world_to_camera * cloud.cloud_to_world();
        let linear = cloud_to_camera.matrix3;
        let determinant = linear.determinant().abs();
        // The cofactor matrix is |M| M⁻ᵀ and exists for every M; the sign keeps normals outside when M mirrors.
        let cofactor = DMat3::from_cols(
            linear.y_axis.cross(linear.z_axis),
            linear.z_axis.cross(linear.x_axis),
            linear.x_axis.cross(linear.y_axis),
        );
        let normal_to_camera = cofactor * linear.determinant().signum();
        let camera_to_cloud = cloud_to_camera.inverse();
        Self {
            levels: cloud.levels(),
            columns: &cloud.levels()[range.level].columns,
            cloud_index: range.cloud as u16,
            shader,
            view,
            cloud_to_camera,
            camera_to_cloud,
            normal_to_camera,
            determinant,
            hides_backs: range.hides_backs,
            shown: match &cloud.levels()[range.level].columns.kind {
                columns::Kind::Surface(surface) => Shown::of(&surface.closed, range.hides_backs),
                _ => Shown::Both,
            },
            has_means: range.level > 0,
        }
    }

    /// What is drawn of a splat; `None` if nothing.
    pub(super) fn project_splat(&self, index: usize) -> Option<Projected> {
        let View { camera, settings, lens, frustum, closing, .. } = &self.view;
        let splats = self.columns;
        let factor_in_cloud = splats.factor(index);
        let splat = CameraSplat {
            center: self.cloud_to_camera.transform_point3(splats.center(index).as_dvec3()),
            factor: self.cloud_to_camera.matrix3 * factor_in_cloud.as_dmat3(),
        };
        let perspective = lens.projection == Projection::Perspective;
        // The vector area of what is seen, and of what area it is a share.
        let side = splats.orientations.as_ref().map(|orientations| {
            let seen_along = self.seen_along(splats.center(index));
            Orientation::of_numbers(orientations.row(index)).side(seen_along, self.shown)
        });
        let (facing, area_scale) = match &side {
            Some(side) => (self.normal_to_camera * side.area, 1.0),
            None => {
                let normal = (self.normal_to_camera * axis_normal(factor_in_cloud)).normalize_or_zero();
                (normal, area_scale(self.cloud_to_camera.matrix3, factor_in_cloud))
            }
        };
        if self.hides_backs {
            let ray = if perspective { splat.center } else { DVec3::Z };
            if facing.dot(ray) >= 0.0 {
                return None;
            }
        }

        let footprint = Footprint::new(&splat, lens)?;
        let cutoff = settings.cutoff_of(&splats.kind);
        if footprint.depth_range(cutoff)[1] <= camera.near() {
            return None;
        }
        let crosses = footprint.crosses_camera_plane(cutoff);
        let form = self.form(&footprint);
        let exact = form == Form::Exact;
        // A kernel that crosses the camera plane has no bounded rectangle, but most of those are beside
        // the frustum.
        if crosses && !frustum.touches_ellipsoid(&splat, cutoff, lens) {
            return None;
        }
        let narrower = footprint;
        let footprint = if form == Form::Point { narrower.round() } else { narrower };
        let attenuation = match splats.kind {
            columns::Kind::Opacity { filter: OpacityFilter::Compensated, .. } => {
                footprint.filter_attenuation(&splat, lens)
            }
            _ => footprint.unit_integral / narrower.unit_integral,
        };
        let own = f64::from(splats.strength(index));
        // Each of those that it stands for shows the filter's area h² besides its own.
        let of_filter = splats.opacities_of_own.as_ref().map_or(0.0, |sums| {
            let more = (f64::from(sums.row(index)[0]) - own).max(0.0);
            more * lens.filter_sigma.powi(2) * footprint.root_area()
        });
        let undimmed = own + of_filter;
        let peak = (undimmed * attenuation).min(LARGEST_ALPHA);
        let end = match splats.kind {
            columns::Kind::Opacity { least, .. } => {
                opacity_end([peak, undimmed], [settings.least_opacity(), least.into()])
            }
            _ => f64::INFINITY,
        };
        let bounded = cutoff.min(end);
        if bounded <= 0.0 {
            return None;
        }
        let [center, half] = footprint.bounds(bounded, exact);
        let rect = Rect::around(center, half, camera.size())?;

        let mut record = Record::geometry(&footprint, form);
        record.tag.cloud = self.cloud_index;
        let normal = splats.normal(index).as_dvec3();
        let normal = side.map_or(normal, |side| side.kept * normal + side.shift);
        // How much shorter than 1 a mean is says how much normals differ.
        let length = if self.has_means { normal.length().min(1.0) } else { 1.0 };
        let normal = (self.normal_to_camera * normal).normalize_or_zero() * length;
        let color = self.color(index);
        let shaded = |normal: DVec3| {
            if settings.shade {
                self.shader.shade_two_sided(color, normal.as_vec3(), splat.center.as_vec3())
            } else {
                color
            }
        };
        let gain = cutoff_gain(cutoff);
        let ray = footprint.center_ray;
        let mut sample = SurfaceSample::default();
        match &splats.kind {
            columns::Kind::Extinction => {
                let mass = f64::from(splats.strength(index)) * self.determinant * gain;
                let length = if exact { 1.0 } else { ray.length() };
                record.tag.kind = Kind::Extinction;
                record.amplitude = single(mass * footprint.unit_integral * length);
                record.color = shaded(normal);
            }
            columns::Kind::Opacity { .. } => {
                record.tag.kind = Kind::Opacity;
                record.amplitude = peak as f32;
                let end = end / (2.0 * std::f64::consts::LN_2 * f64::from(MOST_END));
                record.amplitude_slope_or_slabs[1] = end.min(1.0 - f64::from(MOST_END).recip()) as f32;
                record.color = shaded(normal);
            }
            columns::Kind::Surface(surface) => {
                let area = f64::from(splats.strength(index)) * area_scale * gain;
                let attenuation = footprint.filter_attenuation(&splat, lens);
                let grain = splats.grains.as_ref().map_or(1.0, |grains| f64::from(grains.row(index)[0]));
                let floor = filtered_floor(f64::from(surface.coverage_floor), grain.powi(2) * attenuation)
                    .min(least_between_cells(f64::from(surface.overlap), attenuation));
                let coverage = area * footprint.unit_integral / floor;
                let slope = facing.truncate() / lens.focal * coverage;
                record.tag.kind = Kind::Surface;
                record.amplitude = single(coverage * facing.dot(ray));
                record.amplitude_slope_or_slabs = [single(slope.x), single(slope.y)];
                record.color = color;
                // The side that is seen is the shape's; a shading normal agrees with it.
                let normal = match normal.dot(facing) {
                    _ if normal == DVec3::ZERO => facing,
                    cosine if cosine < 0.0 => -normal,
                    _ => normal,
                };
                sample.normal = normal.as_vec3().to_array();
                sample.opacity = splats.opacity(index);
            }
        }
        let brightest = record.color.map(f32::abs).into_iter().fold(MOST_SUMMED / MOST_AMPLITUDE, f32::max);
        let most = (MOST_SUMMED / brightest).max(OPAQUE_AMPLITUDE);
        record.amplitude = record.amplitude.clamp(-most, most);
        if record.amplitude == 0.0 && record.amplitude_slope_or_slabs == [0.0; 2] {
            return None;
        }
        let mut distance = if perspective { splat.center.length() } else { splat.center.z } as f32;
        if record.tag.kind != Kind::Surface && closing.has_slabs() {
            // The largest half-axis is less than this.
            let filter =
                lens.filter_sigma / lens.focal.min_element() * if perspective { splat.center.z } else { 1.0 };
            let [x, y, z] = [splat.factor.x_axis, splat.factor.y_axis, splat.factor.z_axis];
            let trace = x.length_squared() + y.length_squared() + z.length_squared() + filter.powi(2);
            let along = [f64::from(distance), footprint.sigma_z * ray.length(), (cutoff * trace).sqrt()];
            let [first, last] = if closing.takes_whole(&splats.kind) {
                [closing.center_of_one(distance); 2]
            } else {
                closing.numbers_of_one(splat.center.as_vec3(), along)
            };
            let [_, end] = record.amplitude_slope_or_slabs;
            let more = last - first;
            let end = if more < MOST_SLABS { end } else { NO_END };
            record.amplitude_slope_or_slabs = [first, more + end];
            distance = first;
        }
        if settings.color_by_form {
            record.color = form.color();
        }
        Some(Projected { record, rect, distance, sample })
    }

    /// The form that is asked for, or the cheapest whose error stays within its share of the tolerance. What crosses the camera plane is
    /// exact.
    fn form(&self, footprint: &Footprint) -> Form {
        let View { settings, lens, .. } = &self.view;
        match settings.footprint {
            _ if footprint.crosses_camera_plane(settings.cutoff_of(&self.columns.kind)) => Form::Exact,
            FootprintForm::Exact if lens.projection == Projection::Perspective => Form::Exact,
            FootprintForm::Exact | FootprintForm::Affine => Form::Affine,
            FootprintForm::Point => Form::Point,
            FootprintForm::Auto => {
                let share = settings.tolerance / 4.0;
                let is_extinction = matches!(self.columns.kind, columns::Kind::Extinction);
                let error = footprint.affine_error(is_extinction, lens);
                if error > share {
                    Form::Exact
                } else if error + footprint.roundness_error() + self.slope_error(footprint) <= share {
                    Form::Point
                } else {
                    Form::Affine
                }
            }
        }
    }

    /// The error of leaving out the slope of a kernel's distance: of its share of a slab by that slope over the footprint, E|x| = 0.798 of
    /// it, over the thickness at most. An order pixel by pixel is all about slopes, and the least may turn it round. Layers of surfaces
    /// follow planes, whose tilt points keep.
    fn slope_error(&self, footprint: &Footprint) -> f64 {
        match &self.view.closing {
            _ if matches!(self.columns.kind, columns::Kind::Surface(_)) => 0.0,
            closing if closing.takes_whole(&self.columns.kind) => 0.0,
            Closing::Centers { .. } | Closing::Sheets(_) => 0.0,
            Closing::PerPixel => f64::INFINITY,
            Closing::Slabs(slabs) => {
                let slope = dispatch!(simd::Level::Baseline, simd => {
                    let of = |x: f64| simd::splat(simd, x as f32);
                    let [mean, slope] = [footprint.mean, footprint.depth_slope].map(|v| [of(v.x), of(v.y)]);
                    let kernel = (of(footprint.depth), slope, of(footprint.sigma_z));
                    let slope = slabs.distances(simd, mean, kernel).slope;
                    slope.map(|slope| f64::from(slope.reduce_max()))
                });
                MEAN_DEVIATION * footprint.spread_of(slope.into()) / f64::from(slabs.thickness())
            }
        }
    }

    /// The splat's colour in the space of blending, as it is seen from the eye.
    fn color(&self, index: usize) -> [f32; 3] {
        let splats = self.columns;
        let linear = splats.color(index);
        let blend = self.view.settings.blend;
        let Some(harmonics) = &splats.harmonics else {
            return if blend == Blend::Linear { linear } else { linear.map(linear_to_srgb) };
        };
        let direction = self.seen_along(splats.center(index)).as_vec3();
        let values = basis(direction.x, direction.y, direction.z);
        let mut color = linear.map(linear_to_srgb);
        for (value, coefficient) in values.iter().zip(harmonics.row(index)) {
            for (channel, c) in color.iter_mut().zip(coefficient) {
                *channel += value * c;
            }
        }
        let color = color.map(|c| c.max(0.0));
        if blend == Blend::Linear { color.map(srgb_to_linear) } else { color }
    }

    /// The unit vector from the eye to a point, both in cloud space.
    fn seen_along(&self, point: Vec3) -> DVec3 {
        let direction = match self.view.lens.projection {
            Projection::Perspective => point.as_dvec3() - self.camera_to_cloud.translation,
            Projection::Orthographic => self.camera_to_cloud.matrix3.z_axis,
        };
        direction.normalize_or_zero()
    }
}

/// e₁ × e₂ of a factor, the direction that it is flattened along.
fn axis_normal(factor: glam::Mat3) -> DVec3 {
    factor.x_axis.as_dvec3().cross(factor.y_axis.as_dvec3())
}

/// Keeps the optical depth of a kernel of opacity 1 finite; off by less than 1e-6 of a channel.
pub(super) const LARGEST_ALPHA: f64 = 1.0 - 1e-6;

/// How even the pixels' filter makes coverage at most, as a floor says it: what is cut off, and what a surface lacks that bends within a surfel,
/// stay. With 0.99 eight pixels of a scanned head were as faint as 0.956 (`volumes/tests/holes.rs`).
pub(crate) const EVENLY_COVERED: f64 = 0.96;

/// A cloud's coverage floor behind a filter that dims a surfel by this attenuation. Sums of coverage are 1 in the mean; what random
/// places lack fades as the root of the area that is averaged (Campbell's theorem), what regular ones lack sooner.
fn filtered_floor(floor: f64, attenuation: f64) -> f64 {
    let even = floor.max(EVENLY_COVERED);
    even - (even - floor) * attenuation.sqrt()
}

/// The least coverage between the cells that merged surfels stand for, whose σ₁σ₂ is `overlap` of their area and which the filter dims by this
/// attenuation.
///
/// Gaussians s apart sum up to 1 ± 2 exp(−2π²σ²/s²) along each axis. With the overlap o and the attenuation a of what is seen face-on σ²/s² is o for
/// the kernels alone, and o (1 − a)/a for the filter, or half of it along cells that are twice as long as wide, as those of a k-d tree may be. At a
/// slant a falls and this rises, though less is between cells along one axis only: outlines stay as they are, and need it least.
fn least_between_cells(overlap: f64, attenuation: f64) -> f64 {
    1.0 - 4.0 * (-std::f64::consts::PI.powi(2) * overlap * (1.0 + 1.0 / attenuation)).exp()
}

/// Opacities below this count as if they were this.
pub(super) const LEAST_OPACITY: f64 = 1e-30;

/// Where a kernel ends whose peaks, as the filter leaves it and by itself, fall below the least opacities, of pictures and of the cloud;
/// at 0 or below if one is no more than that.
fn opacity_end(peaks: [f64; 2], least: [f64; 2]) -> f64 {
    let end = |i: usize| 2.0 * (peaks[i] / least[i].max(LEAST_OPACITY)).ln();
    end(0).min(end(1))
}
