//! Pixels to surfels.

use super::edges::Edges;
use super::plane::{Plane, planes};
use super::{DepthError, RgbdImage};
use glam::{Mat3, Vec3};
use oblate_engine::cloud::Material;
use oblate_engine::{Cloud, Shapes, Splats, Strength, Surface};
use rayon::prelude::*;

/// σ of a pixel's kernel in the pixels of the depth image. Sums of such kernels on a lattice are 1 ± 0.029.
pub const DEPTH_KERNEL_SIGMA: f32 = 0.5;

/// The floor of summed coverage: 0.97 on a plane; neighbours whose planes differ leave more.
pub const DEPTH_COVERAGE_FLOOR: f32 = 0.9;

/// The steepest slope of a plane in pixel widths a pixel: 88°.
const STEEPEST: f32 = 28.6;

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

/// The surface that a depth image shows, a surfel for each pixel whose depth is known; backs are dropped.
pub fn depth_surfels(image: &RgbdImage, settings: &DepthSettings) -> Result<Cloud, DepthError> {
    image.check()?;
    let depths = image.depths_along_axis();
    let edges = Edges::of(image, &depths);
    let planes = planes(image.size[0], &depths, &edges);
    let maker = Maker { image, depths: &depths, edges: &edges };
    let samples: Vec<Sample> =
        planes.par_iter().enumerate().filter_map(|(at, plane)| maker.sample(at, plane)).collect();
    if samples.is_empty() {
        return Err(DepthError::NoDepth);
    }
    let mut radii: Vec<f32> = samples.iter().map(|sample| sample.area.sqrt()).collect();
    let middle = radii.len() / 2;
    let (_, radius, _) = radii.select_nth_unstable_by(middle, f32::total_cmp);
    let surface = Surface {
        areas: samples.iter().map(|sample| sample.area).collect(),
        opacities: None,
        depth_tolerance: *radius * std::env::var("EPS").map_or(3.0, |v| v.parse().unwrap()),
        coverage_floor: env("FLOOR", 0.2),
        closed: true,
    };
    let cloud = Cloud::new(Splats {
        centers: samples.iter().map(|sample| sample.center).collect(),
        shapes: Shapes::Each(samples.iter().map(|sample| sample.factor).collect()),
        strength: Strength::Surface(surface),
        colors: samples.iter().map(|sample| sharp(image, &edges, sample.pixel as usize)).collect(),
        harmonics: None,
        normals: None,
        material: settings.material,
    })?;
    Ok(cloud.transformed(image.pose.world_to_camera.inverse()))
}

struct Sample {
    pixel: u32,
    center: Vec3,
    factor: Mat3,
    area: f32,
}

struct Maker<'a> {
    image: &'a RgbdImage,
    depths: &'a [f32],
    edges: &'a Edges,
}

impl Maker<'_> {
    fn sample(&self, at: usize, plane: &Plane) -> Option<Sample> {
        let measured = self.depths[at];
        if measured <= 0.0 {
            return None;
        }
        let width = self.image.size[0];
        let place = [at % width, at / width].map(|x| x as f64 + 0.5);
        let ray = self.image.ray(place.into()).as_vec3();
        let focal = self.image.intrinsics.focal.as_vec2();
        let fitted = 1.0 / plane.inverse;
        let depth = if (fitted - measured).abs() * focal.min_element() <= 10.6 * measured { fitted } else { measured };
        // p = ray/d: its derivatives in the plane, a pixel to the right and a pixel down.
        let along = |axis: usize| {
            let steepest = STEEPEST / (focal[axis] * depth);
            let slope = plane.slope[axis].clamp(-steepest, steepest);
            let mut step = -ray * (slope * depth * depth);
            step[axis] += depth / focal[axis];
            step
        };
        let [right, down] = [along(0), along(1)];
        let across = down.cross(right);
        let around = self.edges.around(at);
        let [x, y] = [Cut::of(around[0], around[1]), Cut::of(around[2], around[3])];
        let center = ray * depth + right * x.shift + down * y.shift;
        // Faces the camera: y is down.
        let factor = Mat3::from_cols(down * y.sigma, right * x.sigma, Vec3::ZERO);
        let area = across.length();
        (center.is_finite() && factor.is_finite() && area.is_finite() && area > 0.0)
            .then_some(Sample { pixel: at as u32, center, factor, area })
    }
}

/// What is left of a kernel along a line of pixels, in pixels.
#[derive(Clone, Copy)]
struct Cut {
    shift: f32,
    sigma: f32,
}

impl Cut {
    /// The normal distribution cut off at the pixel's sides where the surface ends there: its mean and σ.
    fn of(before: bool, after: bool) -> Self {
        // A normal distribution cut off at σ of one side and of both.
        const ONE_MEAN: f32 = 0.287_6;
        const ONE_SIGMA: f32 = 0.793_5;
        const TWO_SIGMA: f32 = 0.539_6;
        let s = env("SIGMA", 0.45);
        if env("CUT", 1.0) == 0.0 { return Self { shift: 0.0, sigma: s } }
        match (before, after) {
            (true, true) => Self { shift: 0.0, sigma: s },
            (false, true) => Self { shift: ONE_MEAN * s, sigma: ONE_SIGMA * s },
            (true, false) => Self { shift: -ONE_MEAN * s, sigma: ONE_SIGMA * s },
            (false, false) => Self { shift: 0.0, sigma: TWO_SIGMA * s },
        }
    }
}

use std::sync::OnceLock;
fn env(n: &'static str, d: f32) -> f32 {
    static A: OnceLock<std::collections::HashMap<String, f32>> = OnceLock::new();
    let m = A.get_or_init(|| std::env::vars().filter_map(|(k, v)| Some((k, v.parse().ok()?))).collect());
    m.get(n).copied().unwrap_or(d)
}

fn sharp(image: &RgbdImage, edges: &Edges, at: usize) -> [f32; 3] {
    let amount = env("SHARP", 0.25) / 2.0;
    let own = image.colors[at];
    let around = edges.around(at);
    let w = image.size[0];
    let n = [at.wrapping_sub(1), at + 1, at.wrapping_sub(w), at + w];
    std::array::from_fn(|c| {
        let (mut lap, mut lo, mut hi) = (0.0, own[c], own[c]);
        for pair in [0, 2] {
            if around[pair] && around[pair + 1] {
                for k in [pair, pair + 1] { lap += image.colors[n[k]][c] - own[c]; }
            }
            for k in [pair, pair + 1] { if around[k] { lo = lo.min(image.colors[n[k]][c]); hi = hi.max(image.colors[n[k]][c]); } }
        }
        let v = own[c] - amount * lap;
        let over = env("OVER", 0.25) * (hi - lo);
        v.clamp((lo - over).max(0.0), hi + over)
    })
}
