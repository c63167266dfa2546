//! Pixels to surfels.

use super::edges::{Edges, STEEPEST, Steps};
use super::lanes::*;
use super::plane::Planes;
use super::squares::{Pixel, SIDE, in_squares};
use super::{DepthError, RgbdImage};
use glam::{Mat3, Vec3};
use oblate_engine::cloud::Material;
use oblate_engine::simd::{Level, dispatch};
use oblate_engine::{Closed, Cloud, Intrinsics, Surfel, SurfelLook};
use rayon::prelude::*;

/// σ of a pixel's kernel in pixels of the depth image. Sums of such kernels on a lattice are 1 ± 0.07, and colours are means under them.
const SIGMA: f32 = 0.45;

/// Of the variance by which the kernels blur, what is taken back from colours, in px². All would be SIGMA²; less leaves noise as it is.
const SHARPENED: f32 = 0.12;

/// How far a kernel is moved towards a pixel whose depth is unknown, in pixels: it may be of the same surface, and nothing else shows it.
const INTO_UNKNOWN: f32 = 0.2;

/// The share of its mean coverage at which a surface is opaque. At edges surfels are cut where their pixel ends, so that hardly anything
/// is left beyond: however low the floor is, edges move by less than a pixel, and what is seen between two samples of an uneven surface
/// is closed.
const COVERAGE_FLOOR: f32 = 0.05;

/// How far apart samples of one layer may lie, in widths of a pixel at the mean depth: what depth cameras are uncertain by across a room.
const DEPTH_TOLERANCE: f64 = 16.0;

/// The variance of the low-pass filter, in px², with which a photograph is best seen from nearby: its pixels are means over squares of a
/// variance of 1/12 already, and with that it is the usual 0.3.
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
/// neighbours (Yuan, Chen et al., *Hybrid Forward Resampling and Volume Rendering*, 2003, section 3). Where a surface ends, surfels are
/// cut; backs are dropped. Nothing is drawn where depths are unknown. Surfels come in squares of pixels, not row by row.
///
/// A picture of photographs alone is best drawn unshaded, with [`DEPTH_LOW_PASS`], and in [`oblate_engine::Blend::Display`], since they are
/// resampled as they are stored.
///
/// # Errors
/// When the image is none, no depth is known, or the surfels leave the range of single precision.
pub fn depth_surfels(image: &RgbdImage, settings: &DepthSettings) -> Result<Cloud, DepthError> {
    let mut cloud = Cloud::default();
    renew_depth_surfels(&mut cloud, image, settings)?;
    Ok(cloud)
}

/// Makes a cloud the surface that [`depth_surfels`] gives, in the memory that the cloud has ([`Cloud::renew`]): for images that come one
/// after the other, as from a depth camera.
///
/// # Errors
/// Those of [`depth_surfels`]. Then the cloud is empty or as it was.
pub fn renew_depth_surfels(
    cloud: &mut Cloud,
    image: &RgbdImage,
    settings: &DepthSettings,
) -> Result<(), DepthError> {
    Maker::new(image)?.renew(cloud, settings, |_, _| 1.0)
}

/// An image whose surfaces are known.
pub(super) struct Maker<'a> {
    pub(super) image: &'a RgbdImage,
    /// Along the axis; 0 where unknown.
    pub(super) depths: Vec<f32>,
    pub(super) steps: Steps,
    level: Level,
    inverses: Bordered,
    colors: [Bordered; 3],
    edges: Edges,
    /// The image's, in single precision.
    focal: [f32; 2],
    center: [f32; 2],
}

impl<'a> Maker<'a> {
    pub(super) fn new(image: &'a RgbdImage) -> Result<Self, DepthError> {
        Self::with(Level::best(), image)
    }

    fn with(level: Level, image: &'a RgbdImage) -> Result<Self, DepthError> {
        image.check()?;
        let depths = image.depths_along_axis();
        let steps = Steps::of(image);
        let width = image.size[0];
        // What is nearer than numbers can tell is as good as unknown to its neighbours, and itself no surfel.
        let inverse = |depth: &f32| Some(1.0 / depth).filter(|inverse| inverse.is_finite()).unwrap_or(0.0);
        let inverses = Bordered::of(width, &depths, inverse);
        let colors = [0, 1, 2].map(|i| Bordered::of(width, &image.colors, |color| color[i]));
        let edges = Edges::of(level, image.size, &inverses, &steps);
        let Intrinsics { focal, center } = image.intrinsics;
        let [focal, center] = [focal, center].map(|v| v.as_vec2().to_array());
        Ok(Self { image, depths, steps, level, inverses, colors, edges, focal, center })
    }

    /// The cloud of all whose depth is known, each with a share of its area.
    pub(super) fn cloud(
        &self,
        settings: &DepthSettings,
        share: impl Fn(Pixel, &Surfel) -> f32 + Sync,
    ) -> Result<Cloud, DepthError> {
        let mut cloud = Cloud::default();
        self.renew(&mut cloud, settings, share)?;
        Ok(cloud)
    }

    /// The same in the memory of a cloud.
    fn renew(
        &self,
        cloud: &mut Cloud,
        settings: &DepthSettings,
        share: impl Fn(Pixel, &Surfel) -> f32 + Sync,
    ) -> Result<(), DepthError> {
        let known = in_squares(self.image.size[0], &self.depths);
        if known.is_empty() {
            return Err(DepthError::NoDepth);
        }
        // Summed by rows: the same for any number of threads.
        let sum = |row: &[f32]| row.iter().map(|depth| f64::from(*depth)).sum();
        let sums: Vec<f64> = self.depths.par_chunks(self.image.size[0]).map(sum).collect();
        let mean = sums.iter().sum::<f64>() / known.len() as f64;
        let pixel_width = mean / self.image.intrinsics.focal.min_element();
        let look = SurfelLook {
            color: None,
            opacity: 1.0,
            depth_tolerance: (DEPTH_TOLERANCE * pixel_width) as f32,
            coverage_floor: COVERAGE_FLOOR,
            closed: Closed::EVERYWHERE,
            material: settings.material,
        };
        cloud.renew(known.len(), &look, |numbers| {
            let mut surfels = self.surfels();
            let share = &share;
            known[numbers].iter().map(move |pixel| {
                let surfel = surfels.of(*pixel);
                Surfel { area: surfel.area * share(*pixel, &surfel), ..surfel }
            })
        })?;
        *cloud = std::mem::take(cloud).transformed(self.image.pose.world_to_camera.inverse());
        Ok(())
    }

    pub(super) fn surfels(&self) -> Surfels<'_> {
        Surfels { maker: self, rows: [Row::NONE; SIDE] }
    }

    /// A pixel's place in the image's arrays.
    #[inline(always)]
    pub(super) fn index(&self, [column, row]: Pixel) -> usize {
        usize::from(row) * self.image.size[0] + usize::from(column)
    }

    /// The surfels from a pixel on, in camera space; of no meaning where depths are unknown.
    #[inline(always)]
    fn numbers<S: Simd>(&self, simd: S, [column, row]: [usize; 2]) -> [F<S>; NUMBERS] {
        let (one, zero) = (splat(simd, 1.0), splat(simd, 0.0));
        let Self { inverses, edges, focal, .. } = self;
        let place = inverses.place([column, row]);
        let plane = Planes::at(simd, (inverses, edges), place);
        let columns = F::from_fn(
            simd,
            #[inline(always)]
            |lane| (column + lane) as f32 + 0.5,
        );
        let ray = [
            (columns - self.center[0]) * (1.0 / focal[0]),
            splat(simd, (row as f32 + 0.5 - self.center[1]) / focal[1]),
            one,
        ];
        let measured = inverses.load(simd, place);
        // Beyond a step that links pixels no plane is believed.
        let is_near = self.steps.are_near(simd, [plane.inverse, measured]);
        let inverse = is_near.select(plane.inverse, measured);
        let depth = one / inverse;
        // p = ray/d: its derivatives in the plane, a pixel to the right and a pixel down.
        let mut along = [[zero; 3]; 2];
        for (axis, along) in along.iter_mut().enumerate() {
            let steepest = inverse * (STEEPEST / focal[axis]);
            let slope = plane.slope[axis].max(-steepest).min(steepest) * (depth * depth);
            *along = [-ray[0] * slope, -ray[1] * slope, -slope];
            along[axis] += depth * (1.0 / focal[axis]);
        }
        let [right, down] = along;
        let stride = inverses.stride;
        let beside = [place - 1, place + 1, place - stride, place + stride];
        let links = [
            edges.right.load(simd, place - 1),
            edges.right.load(simd, place),
            edges.below.load(simd, place - stride),
            edges.below.load(simd, place),
        ];
        // What is unknown is no edge.
        let (mut goes_on, mut unknown) = (links, [zero; 4]);
        for ((goes_on, unknown), beside) in goes_on.iter_mut().zip(&mut unknown).zip(beside) {
            *unknown = inverses.load(simd, beside).simd_eq(zero).select(one, zero);
            *goes_on += *unknown;
        }
        let mut x = Cuts::of(simd, [goes_on[0], goes_on[1]]);
        let mut y = Cuts::of(simd, [goes_on[2], goes_on[3]]);
        x.shift += (unknown[1] - unknown[0]) * INTO_UNKNOWN;
        y.shift += (unknown[3] - unknown[2]) * INTO_UNKNOWN;
        let normal = [
            right[1] * down[2] - right[2] * down[1],
            right[2] * down[0] - right[0] * down[2],
            right[0] * down[1] - right[1] * down[0],
        ];
        let area = (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]).sqrt();
        let mut center = [zero; 3];
        for i in 0..3 {
            center[i] = down[i].mul_add(y.shift, right[i].mul_add(x.shift, ray[i] * depth));
        }
        // The normal, down × right, faces the camera.
        let [down, right] = [
            [down[0] * y.sigma, down[1] * y.sigma, down[2] * y.sigma],
            [right[0] * x.sigma, right[1] * x.sigma, right[2] * x.sigma],
        ];
        let ([a, b, c], [d, e, f], [g, h, i]) = (center, down, right);
        let [red, green, blue] = self.colors(simd, (place, beside), links);
        [a, b, c, d, e, f, g, h, i, area, red, green, blue]
    }

    /// The colours from a place on, from which some of the blur of the kernels is taken back: their mean over a surface is about
    /// c + ½σ²Δc.
    #[inline(always)]
    fn colors<S: Simd>(
        &self,
        simd: S,
        (place, [left, right, above, below]): (usize, [usize; 4]),
        links: [F<S>; 4],
    ) -> [F<S>; 3] {
        let zero = splat(simd, 0.0);
        let taken = [links[0] * links[1] * (0.5 * SHARPENED), links[2] * links[3] * (0.5 * SHARPENED)];
        let mut taken_back = [zero; 3];
        for (result, colors) in taken_back.iter_mut().zip(&self.colors) {
            let own = colors.load(simd, place);
            let along = colors.load(simd, left) + colors.load(simd, right) - own - own;
            let across = colors.load(simd, above) + colors.load(simd, below) - own - own;
            *result = (own - along * taken[0] - across * taken[1]).max(zero);
        }
        taken_back
    }
}

/// Numbers of a surfel: centre, two half-axes, area, colour.
const NUMBERS: usize = 13;

/// Makes the surfels of an image, as many at a time as lie together.
pub(super) struct Surfels<'a> {
    maker: &'a Maker<'a>,
    /// What was made last of each row of a square.
    rows: [Row; SIDE],
}

/// The surfels of [`LANES`] pixels beside each other.
struct Row {
    /// Which pixels: the number of their group in the row, and the row.
    group: [u16; 2],
    numbers: [[f32; LANES]; NUMBERS],
}

impl Row {
    /// No image has as many rows.
    const NONE: Self = Self { group: [u16::MAX; 2], numbers: [[0.0; LANES]; NUMBERS] };
}

impl Surfels<'_> {
    /// The surfel of a pixel whose depth is known, in camera space. It takes least to ask for pixels row by row or square by square.
    #[inline(always)]
    pub(super) fn of(&mut self, [column, row]: Pixel) -> Surfel {
        let (group, lane) = ([column / LANES as u16, row], usize::from(column) % LANES);
        let slot = usize::from(row) % SIDE;
        if self.rows[slot].group != group {
            self.make(group);
        }
        let numbers = &self.rows[slot].numbers;
        let [a, b, c, d, e, f, g, h, i, area, color @ ..] = numbers.each_ref().map(|row| row[lane]);
        let factor = Mat3::from_cols(Vec3::new(d, e, f), Vec3::new(g, h, i), Vec3::ZERO);
        Surfel { center: Vec3::new(a, b, c), factor, area, color }
    }

    /// Makes those of a group.
    #[inline(never)]
    fn make(&mut self, group: [u16; 2]) {
        let [number, row] = group.map(usize::from);
        let made = &mut self.rows[row % SIDE];
        made.group = group;
        dispatch!(self.maker.level, simd => {
            let numbers = self.maker.numbers(simd, [number * LANES, row]);
            for (made, numbers) in made.numbers.iter_mut().zip(numbers) {
                numbers.store_slice(made);
            }
        });
    }
}

/// What is left of kernels along lines of pixels, in pixels.
struct Cuts<S: Simd> {
    shift: F<S>,
    sigma: F<S>,
}

impl<S: Simd> Cuts<S> {
    /// Mean and σ of a normal distribution that is cut off half a pixel, t = 1/(2 SIGMA), from its middle on both sides where the surface
    /// doesn't go on: with λ = φ(t)/Φ(t) the mean −λ and the variance 1 − λ(λ + t) of one that is cut on the right, and 1 − 2tφ(t)/(2Φ(t)
    /// − 1) of one that is cut on both. 1 is where it goes on, 0 where it doesn't.
    #[inline(always)]
    fn of(simd: S, [before, after]: [F<S>; 2]) -> Self {
        const MEAN: f32 = 0.248_3;
        const ONE_SIDE: f32 = 0.813_9;
        const TWO_SIDES: f32 = 0.589_9;
        let sides = before + after;
        let cut = sides.simd_gt(0.5).select(splat(simd, ONE_SIDE * SIGMA), splat(simd, TWO_SIDES * SIGMA));
        let sigma = sides.simd_gt(1.5).select(splat(simd, SIGMA), cut);
        Self { shift: (after - before) * (MEAN * SIGMA), sigma }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth_image::room::Room;
    use oblate_engine::CameraError;

    /// All sets of instructions give the same surfels but for rounding.
    #[test]
    fn levels_agree() -> Result<(), CameraError> {
        let image = Room.image(&Room.camera(83)?);
        let cloud = |level: Level| {
            let maker = Maker::with(level, &image).expect("the image is one");
            maker.cloud(&DepthSettings::default(), |_, _| 1.0).expect("the depths are right").splats()
        };
        let baseline = cloud(Level::Baseline);
        for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
            let other = cloud(level);
            for i in 0..baseline.centers.len() {
                // A pixel is 1e-2 of a depth here; slopes of steep planes amplify what rounding makes of 1/z.
                let scale = 1e-5 * baseline.centers[i].z;
                assert!((baseline.centers[i] - other.centers[i]).length() < scale, "{level:?}, {i}");
                let [a, b] = [&baseline, &other].map(|splats| splats.shapes.factor(i));
                assert!((a - b).to_cols_array().iter().all(|c| c.abs() < scale), "{level:?}, {i}: {a} {b}");
            }
        }
        Ok(())
    }

    /// Whatever was made before it, each surfel of a cloud is its own pixel's.
    #[test]
    fn each_pixel_has_its_own_surfel() -> Result<(), CameraError> {
        let mut image = Room.image(&Room.camera(83)?);
        for at in (0..image.depths.len()).step_by(7) {
            image.depths[at] = 0.0;
        }
        let maker = Maker::new(&image).expect("the image is one");
        let splats =
            maker.cloud(&DepthSettings::default(), |_, _| 1.0).expect("the depths are right").splats();
        let pixels = in_squares(image.size[0], &maker.depths);
        assert_eq!(pixels.len(), splats.centers.len());
        for (i, pixel) in pixels.into_iter().enumerate() {
            let surfel = maker.surfels().of(pixel);
            assert_eq!(surfel.center, splats.centers[i], "{pixel:?}");
            assert_eq!(surfel.color, splats.colors[i], "{pixel:?}");
        }
        Ok(())
    }
}
