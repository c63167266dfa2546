//! Pixels to surfels.

use super::edges::{Edges, STEEPEST, Steps};
use super::lanes::*;
use super::pairs::{NUMBERS, Square, Surfels};
use super::plane::Planes;
use super::rows::ImageRows;
use super::squares::{AREA, Squares};
use super::{DepthError, RgbdImage};
use oblate_engine::cloud::Material;
use oblate_engine::simd::Level;
use oblate_engine::{Closed, Cloud, Intrinsics, SurfelLook, SurfelPlaces, SurfelRows};
use std::ops::Range;

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

/// How far apart samples of one layer may lie, in widths of a pixel at the usual depth: what depth cameras are uncertain by across a room. (With
/// 16, one of the pairs of photographs in `tests/pairs` is 0.005 dB farther from the best of the others, which is more than its bound; of
/// the arithmetic mean a little sky makes so much that what is near and what is behind it are one layer.)
const DEPTH_TOLERANCE: f64 = 17.0;

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
    Maker::new(image, Memory::default())?.renew(&mut cloud, settings, None)?;
    Ok(cloud)
}

/// As much of the areas of a square's surfels as counts.
pub(super) type Share<'a> = &'a (dyn Fn(&Square) -> [f32; AREA] + Sync);

/// An image whose surfaces are known.
pub(super) struct Maker<'a> {
    pub(super) image: &'a RgbdImage,
    pub(super) steps: Steps,
    pub(super) squares: Squares,
    pub(super) level: Level,
    rows: ImageRows,
    edges: Edges,
    /// The image's, in single precision.
    pub(super) focal: [f32; 2],
    pub(super) center: [f32; 2],
}

/// What a [`Maker`] leaves for the next.
#[derive(Default)]
pub(super) struct Memory {
    rows: ImageRows,
    edges: Edges,
}

impl<'a> Maker<'a> {
    pub(super) fn new(image: &'a RgbdImage, memory: Memory) -> Result<Self, DepthError> {
        Self::with(Level::best(), image, memory)
    }

    pub(super) fn with(level: Level, image: &'a RgbdImage, memory: Memory) -> Result<Self, DepthError> {
        let rows = ImageRows::of(level, image, memory.rows)?;
        let squares = Squares::of(level, image.size, &rows.inverses);
        if squares.pixels() == 0 {
            return Err(DepthError::NoDepth);
        }
        let steps = Steps::of(image);
        let edges = Edges::of(level, (image.size, &rows.inverses), &steps, memory.edges);
        let Intrinsics { focal, center } = image.intrinsics;
        let [focal, center] = [focal, center].map(|v| v.as_vec2().to_array());
        Ok(Self { image, steps, squares, level, rows, edges, focal, center })
    }

    pub(super) fn into_memory(self) -> Memory {
        Memory { rows: self.rows, edges: self.edges }
    }

    /// Makes a cloud, in its memory, that of all whose depth is known, each with a share of its area.
    pub(super) fn renew(
        &self,
        cloud: &mut Cloud,
        settings: &DepthSettings,
        share: Option<Share>,
    ) -> Result<(), DepthError> {
        let pixel_width = self.rows.usual_depth() / self.image.intrinsics.focal.min_element();
        let look = SurfelLook {
            color: None,
            opacity: 1.0,
            depth_tolerance: (DEPTH_TOLERANCE * pixel_width) as f32,
            coverage_floor: COVERAGE_FLOOR,
            closed: Closed::OneSided,
            material: settings.material,
        };
        cloud.renew(self.squares.pixels(), &look, |numbers, places| self.put(numbers, share, places))?;
        *cloud = std::mem::take(cloud).transformed(self.image.pose.world_to_camera.inverse());
        Ok(())
    }

    /// Puts the surfels of the known pixels with these numbers in places of a cloud.
    fn put(&self, numbers: Range<usize>, share: Option<Share>, places: &mut SurfelPlaces) {
        let mut surfels = self.surfels();
        let (squares, mut before) = self.squares.with(numbers);
        for square in squares {
            let square = surfels.of(square);
            let mut areas = *square.areas();
            if let Some(share) = share {
                for (area, share) in areas.iter_mut().zip(share(square)) {
                    *area *= share;
                }
            }
            places.put(&SurfelRows { areas: &areas[before..square.len()], ..square.since(before) });
            before = 0;
        }
    }

    pub(super) fn surfels(&self) -> Surfels<'_> {
        Surfels::new(self)
    }

    /// The surfels from a pixel on, in camera space; of no meaning where depths are unknown.
    #[inline(always)]
    pub(super) fn numbers<S: Simd>(&self, simd: S, [column, row]: [usize; 2]) -> [F<S>; NUMBERS] {
        let (one, zero) = (splat(simd, 1.0), splat(simd, 0.0));
        let Self { rows: ImageRows { inverses, .. }, edges, focal, .. } = self;
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
        for (result, colors) in taken_back.iter_mut().zip(&self.rows.colors) {
            let own = colors.load(simd, place);
            let along = colors.load(simd, left) + colors.load(simd, right) - own - own;
            let across = colors.load(simd, above) + colors.load(simd, below) - own - own;
            *result = (own - along * taken[0] - across * taken[1]).max(zero);
        }
        taken_back
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
    use crate::depth_image::squares::SIDE;
    use glam::DVec2;
    use oblate_engine::{CameraError, Strength};

    /// All sets of instructions give the same surfels but for rounding.
    #[test]
    fn levels_agree() -> Result<(), CameraError> {
        let image = Room.image(&Room.camera(83)?);
        let cloud = |level: Level| {
            let maker = Maker::with(level, &image, Memory::default()).expect("the image is one");
            let mut cloud = Cloud::default();
            maker.renew(&mut cloud, &DepthSettings::default(), None).expect("the depths are right");
            cloud.splats()
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

    /// Whatever was made before it, and however many of its square are known, each surfel of a cloud is its own pixel's.
    #[test]
    fn each_pixel_has_its_own_surfel() -> Result<(), CameraError> {
        let mut image = Room.image(&Room.camera(83)?);
        let width = image.size[0];
        for at in (0..image.depths.len()).filter(|at| at % 7 == 0 || at % width < 20 && at / width > 30) {
            image.depths[at] = 0.0;
        }
        let maker = Maker::new(&image, Memory::default()).expect("the image is one");
        let splats = depth_surfels(&image, &DepthSettings::default()).expect("the depths are right").splats();
        let squares = (0..image.size[1].div_ceil(SIDE)).flat_map(|row| maker.squares.in_row(row));
        let all =
            squares.flat_map(|square| maker.squares.pixels_of(square).enumerate().map(move |p| (square, p)));
        let mut i = 0;
        for (square, (place, pixel)) in all {
            let mut surfels = maker.surfels();
            let own = surfels.of(square);
            let ([center, u, v], area) = own.surfel(place);
            assert_eq!(center, splats.centers[i].as_dvec3(), "{pixel:?}");
            let factor = splats.shapes.factor(i);
            assert_eq!([u, v], [factor.x_axis.as_dvec3(), factor.y_axis.as_dvec3()], "{pixel:?}");
            let Strength::Surface(surface) = &splats.strength else { panic!("surfels are of a surface") };
            assert_eq!(area, f64::from(surface.areas[i]), "{pixel:?}");
            let color = own.since(place).colors.map(|row| row[0]);
            assert_eq!(color, splats.colors[i], "{pixel:?}");
            // It is moved by less than a pixel where its surface ends.
            let seen = center.truncate() / center.z * image.intrinsics.focal + image.intrinsics.center;
            let off = seen - DVec2::from(pixel.map(|x| f64::from(x) + 0.5));
            assert!(off.abs().max_element() < 0.5, "{pixel:?}: {off}");
            i += 1;
        }
        assert_eq!(i, splats.centers.len());
        Ok(())
    }
}
