//! Where a visible range is in the picture, at most, and how near.

use crate::camera::{Camera, Projection};
use crate::closing::SLAB_REACH;
use crate::cull::VisibleRange;
use crate::footprint::{Lens, Rect};
use crate::raster::{KERNEL_REACH, STEEPEST, SURFEL_REACH};
use glam::{DAffine3, DVec2, DVec3};

/// What f32 may be off by, as a share of how far a range is.
const ROUNDING: f64 = 1e-5;

/// A camera, as bounds need it.
pub(super) struct Sight {
    pub(super) lens: Lens,
    pub(super) world_to_camera: DAffine3,
    pub(super) size: [u32; 2],
    /// √ρ.
    pub(super) root_cutoff: f64,
    /// How much deeper or nearer than where it is seen a surfel's plane may be, where z is 1.
    pub(super) plane_reach: f64,
    /// Of slabs; 0 where there are none.
    thickness: f64,
}

/// What the records of a range can't exceed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub(super) pixels: Rect,
    /// Pixels of the rectangle as if the picture had no borders.
    pub(super) area: f64,
    /// z from which on they may be seen; of surfaces, where the span of their first sample may begin.
    pub(super) near: f32,
    /// How far from the eye, or its plane where rays are parallel, the nearest centre is; or the nearest slab that a kernel touches.
    pub(super) distance: f32,
}

impl Sight {
    pub(super) fn new(camera: &Camera, lens: Lens, (cutoff, thickness): (f64, f64)) -> Self {
        let root_cutoff = cutoff.sqrt();
        Self {
            lens,
            world_to_camera: camera.pose().world_to_camera,
            size: camera.size(),
            root_cutoff,
            plane_reach: f64::from(STEEPEST) * root_cutoff * lens.filter_sigma / lens.focal.min_element(),
            thickness,
        }
    }

    pub(super) fn is_perspective(&self) -> bool {
        self.lens.projection == Projection::Perspective
    }

    /// Through the middle of a range, with z = 1.
    pub(super) fn ray(&self, center: DVec3) -> DVec3 {
        if self.is_perspective() { center / center.z } else { DVec3::Z }
    }

    /// Pixels a squared world unit at a place.
    pub(super) fn pixels_at(&self, place: DVec3) -> f64 {
        let scale = if self.is_perspective() { place.z.max(1e-9).recip() } else { 1.0 };
        self.lens.focal.element_product() * scale * scale
    }

    /// Where a place is seen.
    pub(super) fn pixel(&self, place: DVec3) -> [f64; 2] {
        let scale = if self.is_perspective() { place.z.max(1e-9).recip() } else { 1.0 };
        (place.truncate() * scale * self.lens.focal + self.lens.principal).to_array()
    }

    /// Along an axis, between which pixels a sphere is seen; everywhere if it reaches the camera plane.
    fn shadow(&self, axis: usize, center: DVec3, radius: f64) -> [f64; 2] {
        let (focal, principal) = (self.lens.focal[axis], self.lens.principal[axis]);
        let (x, z) = (center[axis], center.z);
        let ends = if !self.is_perspective() {
            [x - radius, x + radius]
        } else if z <= radius * (1.0 + 1e-9) {
            return [f64::NEG_INFINITY, f64::INFINITY];
        } else {
            // The slopes of the tangents.
            let root = radius * (x * x + z * z - radius * radius).max(0.0).sqrt();
            let under = (z - radius) * (z + radius);
            [(x * z - root) / under, (x * z + root) / under]
        };
        ends.map(|end| end * focal + principal)
    }
}

impl VisibleRange {
    /// σ with the pixels' filter, at most.
    pub(super) fn filtered(&self, sight: &Sight) -> f64 {
        (self.reach - self.radius) / sight.root_cutoff
    }
}

impl Bounds {
    pub(super) fn new(sight: &Sight, range: &VisibleRange) -> Self {
        let VisibleRange { center_in_camera: center, radius, sigma, reach, .. } = *range;
        let perspective = sight.is_perspective();
        let nearest = center.z - radius;
        let filtered = range.filtered(sight);
        let (mut low, mut high) = (DVec2::ZERO, DVec2::ZERO);
        for axis in 0..2 {
            // Ellipsoids are within their spheres; the affine form is as wide as its centre is near.
            let [from, to] = sight.shadow(axis, center, reach);
            let centers = sight.shadow(axis, center, radius);
            let (focal, principal) = (sight.lens.focal[axis], sight.lens.principal[axis]);
            let slope = if perspective {
                centers.map(|end| ((end - principal) / focal).abs()).into_iter().fold(0.0, f64::max)
            } else {
                0.0
            };
            let scale = if perspective { focal / nearest.max(f64::MIN_POSITIVE) } else { focal };
            let half = sight.root_cutoff * (sigma * slope.hypot(1.0) * scale).hypot(sight.lens.filter_sigma);
            low[axis] = from.min(centers[0] - half) - 1.0;
            high[axis] = to.max(centers[1] + half) + 1.0;
        }
        let pixel = |axis: usize, end: f64| end.clamp(0.0, f64::from(sight.size[axis])) as u16;
        let pixels = Rect {
            min: [0, 1].map(|axis| pixel(axis, low[axis].floor())),
            max: [0, 1].map(|axis| pixel(axis, high[axis].ceil())),
        };
        let slack = sight.slack(range);
        let is_in_slabs = !range.is_surface && sight.thickness > 0.0;
        let within_slabs = if is_in_slabs {
            (f64::from(SLAB_REACH) + sight.root_cutoff) * filtered + sight.thickness
        } else {
            0.0
        };
        // Of kernels what the slope adds and what is spread along rays are parts of one σ, see `composite::lead`.
        let root = sight.root_cutoff;
        let beyond = if range.is_surface { SURFEL_REACH + root } else { KERNEL_REACH.hypot(root) };
        let plane = if range.is_surface { sight.plane_reach(center.z + radius) } else { 0.0 };
        let near = nearest - beyond * filtered - plane;
        Self {
            pixels,
            area: (high - low).element_product(),
            near: (near - slack) as f32,
            distance: range.distances[0] - (within_slabs + slack) as f32,
        }
    }
}

impl Sight {
    /// How much deeper or nearer than where it is seen a surfel's plane may be that is as far as `far`.
    fn plane_reach(&self, far: f64) -> f64 {
        self.plane_reach * if self.is_perspective() { far.max(0.0) } else { 1.0 }
    }

    /// What rounding may do to depths in a range.
    pub(super) fn slack(&self, range: &VisibleRange) -> f64 {
        ROUNDING * (range.center_in_camera.length() + range.reach)
    }
}
