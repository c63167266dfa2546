//! Pixels to surfels.

use super::edges::{Edges, STEEPEST, Steps};
use super::plane::{Plane, planes};
use super::{DepthError, RgbdImage};
use glam::{Mat3, Vec2, Vec3};
use oblate_engine::cloud::Material;
use oblate_engine::{Cloud, Surfel, SurfelLook};

/// σ of a pixel's kernel in pixels of the depth image. Sums of such kernels on a lattice are 1 ± 0.07, and colours are means under them.
const SIGMA: f32 = 0.45;

/// Of the variance by which the kernels blur, what is taken back from colours, in px². All would be SIGMA²; less leaves noise as it is.
const SHARPENED: f32 = 0.12;

/// The share of its mean coverage at which a surface is opaque. At edges surfels are cut where their pixel ends, so that hardly anything is left beyond: however
/// low the floor is, edges move by less than a pixel, and what is seen between two samples of an uneven surface is closed.
const COVERAGE_FLOOR: f32 = 0.05;

/// How far apart samples of one layer may lie, in widths of a pixel at the mean depth: what depth cameras are uncertain by across a room.
const DEPTH_TOLERANCE: f64 = 16.0;

/// The variance of the low-pass filter, in px², with which a photograph is best seen from nearby: its pixels are means over squares of a variance of 1/12
/// already, and with that it is the usual 0.3.
pub const DEPTH_LOW_PASS: f64 = 0.3 - 1.0 / 12.0;

/// How depth images become surfels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthSettings {
    /// How the surface answers light. Default [`Material::UNLIT`]: a photograph has its light in it.
    pub material: Material,
}

impl Default for DepthSettings {
    fn default() -> Self {
        Self { material: Material::UNLIT }
    }
}

/// The surface that a depth image shows: a surfel for each pixel whose depth is known, as large as the pixel is on the plane through its
/// neighbours (Yuan, Chen et al., *Hybrid Forward Resampling and Volume Rendering*, 2003, section 3). Where a surface ends, surfels are cut; backs are
/// dropped. Nothing is drawn where depths are unknown.
///
/// # Errors
/// When the image is none, no depth is known, or the surfels leave the range of single precision.
pub fn depth_surfels(image: &RgbdImage, settings: &DepthSettings) -> Result<Cloud, DepthError> {
    Maker::new(image)?.cloud(settings, |_, _| 1.0)
}

/// An image whose surfaces are known.
pub(super) struct Maker<'a> {
    pub(super) image: &'a RgbdImage,
    /// Along the axis; 0 where unknown.
    pub(super) depths: Vec<f32>,
    pub(super) steps: Steps,
    edges: Edges,
    planes: Vec<Plane>,
    /// The image's, in single precision.
    focal: Vec2,
    center: Vec2,
}

impl<'a> Maker<'a> {
    pub(super) fn new(image: &'a RgbdImage) -> Result<Self, DepthError> {
        image.check()?;
        let depths = image.depths_along_axis();
        let steps = Steps::of(image);
        let edges = Edges::of(image.size[0], &depths, &steps);
        let planes = planes(image.size[0], &depths, &edges);
        let [focal, center] = [image.intrinsics.focal, image.intrinsics.center].map(|v| v.as_vec2());
        Ok(Self { image, depths, steps, edges, planes, focal, center })
    }

    /// The cloud of all whose depth is known, each with a share of its area.
    pub(super) fn cloud(
        &self,
        settings: &DepthSettings,
        share: impl Fn(usize, &Surfel) -> f32 + Sync,
    ) -> Result<Cloud, DepthError> {
        let known: Vec<u32> =
            (0..self.depths.len() as u32).filter(|at| self.depths[*at as usize] > 0.0).collect();
        if known.is_empty() {
            return Err(DepthError::NoDepth);
        }
        let total: f64 = known.iter().map(|at| f64::from(self.depths[*at as usize])).sum();
        let pixel_width = total / known.len() as f64 / self.image.intrinsics.focal.min_element();
        let look = SurfelLook {
            color: None,
            opacity: 1.0,
            depth_tolerance: (DEPTH_TOLERANCE * pixel_width) as f32,
            coverage_floor: COVERAGE_FLOOR,
            closed: true,
            material: settings.material,
        };
        let surfel = |at: &u32| {
            let surfel = self.surfel(*at as usize);
            Surfel { area: surfel.area * share(*at as usize, &surfel), ..surfel }
        };
        let cloud = Cloud::of_surfels(known.len(), &look, |numbers| known[numbers].iter().map(surfel))?;
        Ok(cloud.transformed(self.image.pose.world_to_camera.inverse()))
    }

    /// The surfel of a pixel whose depth is known, in camera space.
    pub(super) fn surfel(&self, at: usize) -> Surfel {
        let plane = &self.planes[at];
        let [width, height] = self.image.size;
        let [column, row] = [at % width, at / width];
        let place = Vec2::new(column as f32, row as f32) + 0.5;
        let ray = ((place - self.center) / self.focal).extend(1.0);
        let measured = self.depths[at];
        let fitted = 1.0 / plane.inverse;
        // Beyond a step that links pixels no plane is believed.
        let is_near = self.steps.are_one_surface([fitted, measured]);
        let depth = if is_near { fitted } else { measured };
        // p = ray/d: its derivatives in the plane, a pixel to the right and a pixel down.
        let along = |axis: usize| {
            let steepest = STEEPEST / (self.focal[axis] * depth);
            let mut step = -ray * (plane.slope[axis].clamp(-steepest, steepest) * depth * depth);
            step[axis] += depth / self.focal[axis];
            step
        };
        let [right, down] = [along(0), along(1)];
        // What is unknown is no edge.
        let is_unknown = |beside: usize| self.depths[beside] == 0.0;
        let linked = self.edges.around(at);
        let goes_on = [
            linked[0] || column == 0 || is_unknown(at - 1),
            linked[1] || column + 1 == width || is_unknown(at + 1),
            linked[2] || row == 0 || is_unknown(at - width),
            linked[3] || row + 1 == height || is_unknown(at + width),
        ];
        let [x, y] = [Cut::of([goes_on[0], goes_on[1]]), Cut::of([goes_on[2], goes_on[3]])];
        Surfel {
            center: ray * depth + right * x.shift + down * y.shift,
            // Its normal, down × right, faces the camera.
            factor: Mat3::from_cols(down * y.sigma, right * x.sigma, Vec3::ZERO),
            area: right.cross(down).length(),
            color: self.color(at, linked),
        }
    }

    /// The colour of a pixel, from which some of the blur of the kernels is taken back: their mean over a surface is about
    /// c + ½σ²Δc.
    fn color(&self, at: usize, [left, right, above, below]: [bool; 4]) -> [f32; 3] {
        let colors = &self.image.colors;
        let own = Vec3::from(colors[at]);
        let mut color = own;
        let mut take = |before: usize, after: usize| {
            let curvature = Vec3::from(colors[before]) + Vec3::from(colors[after]) - 2.0 * own;
            color -= curvature * (0.5 * SHARPENED);
        };
        if left && right {
            take(at - 1, at + 1);
        }
        if above && below {
            take(at - self.image.size[0], at + self.image.size[0]);
        }
        color.max(Vec3::ZERO).to_array()
    }
}

/// What is left of a kernel along a line of pixels, in pixels.
#[derive(Clone, Copy)]
struct Cut {
    shift: f32,
    sigma: f32,
}

impl Cut {
    /// Mean and σ of a normal distribution that is cut off half a pixel, t = 1/(2 SIGMA), from its middle on both sides where the surface doesn't go on:
    /// with λ = φ(t)/Φ(t) the mean −λ and the variance 1 − λ(λ + t) of one that is cut on the right, and 1 − 2tφ(t)/(2Φ(t) − 1) of one that is
    /// cut on both.
    fn of(goes_on: [bool; 2]) -> Self {
        const MEAN: f32 = 0.248_3;
        const ONE_SIDE: f32 = 0.813_9;
        const TWO_SIDES: f32 = 0.589_9;
        match goes_on {
            [true, true] => Self { shift: 0.0, sigma: SIGMA },
            [false, true] => Self { shift: MEAN * SIGMA, sigma: ONE_SIDE * SIGMA },
            [true, false] => Self { shift: -MEAN * SIGMA, sigma: ONE_SIDE * SIGMA },
            [false, false] => Self { shift: 0.0, sigma: TWO_SIDES * SIGMA },
        }
    }
}
