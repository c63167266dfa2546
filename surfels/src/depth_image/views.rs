//! Several depth images in one picture.

use super::lanes::*;
use super::pairs::{Sixteen, Square, Surfels};
use super::squares::{AREA, SIDE};
use super::surfels::{Maker, Memory};
use super::{DepthError, DepthSettings, RgbdImage};
use glam::DAffine3;
use oblate_engine::simd::dispatch;
use oblate_engine::{Camera, Cloud, Projection};
use rayon::prelude::*;

/// The surfels of several depth images, a cloud for each, as they are best seen by `view`: where more than one shows a surface, each
/// sample has a share that goes by how many pixels of the new view it is spread over (1 over the third power of that) and by how far the view turns (cos⁴ of the angle). Shares of what lies at
/// one place add up to 1, so that what is covered once by one image is covered once by all.
///
/// # Errors
/// Those of [`super::depth_surfels`].
pub fn merged_depth_surfels(
    images: &[RgbdImage],
    view: &Camera,
    settings: &DepthSettings,
) -> Result<Vec<Cloud>, DepthError> {
    let mut clouds = Vec::new();
    DepthSampler::default().sample(&mut clouds, images, view, settings)?;
    Ok(clouds)
}

/// Samples the surfaces of depth images that come one after the other, as from a depth camera, in memory that it keeps.
#[derive(Default)]
pub struct DepthSampler {
    memory: Vec<Memory>,
}

impl DepthSampler {
    /// Makes clouds what [`merged_depth_surfels`] gives, one for each image, in the memory that they have ([`Cloud::renew`]). Of a single image that
    /// is the same for all views.
    ///
    /// # Errors
    /// Those of [`super::depth_surfels`]. Then there are no clouds.
    pub fn sample(
        &mut self,
        clouds: &mut Vec<Cloud>,
        images: &[RgbdImage],
        view: &Camera,
        settings: &DepthSettings,
    ) -> Result<(), DepthError> {
        // Put back when all are made.
        let mut made = std::mem::take(clouds);
        let mut memory = std::mem::take(&mut self.memory);
        memory.resize_with(images.len(), Memory::default);
        let makers = images.iter().zip(memory).map(|(image, memory)| Maker::new(image, memory));
        let makers = makers.collect::<Result<Vec<_>, _>>()?;
        made.resize_with(images.len(), Cloud::default);
        if let ([maker], [cloud]) = (&makers[..], &mut made[..]) {
            maker.renew(cloud, settings, None)?;
        } else {
            let views: Vec<View> = makers.iter().map(|maker| View::new(maker, view)).collect();
            let qualities: Vec<Vec<f32>> = views.iter().map(View::qualities).collect();
            for (own, cloud) in made.iter_mut().enumerate() {
                let shares = Shares::new(own, &views, &qualities);
                views[own].maker.renew(cloud, settings, Some(&|square| shares.of(square)))?;
            }
        }
        *clouds = made;
        self.memory = makers.into_iter().map(Maker::into_memory).collect();
        Ok(())
    }
}

/// The shares of an image in what several show.
struct Shares<'a> {
    own: &'a View<'a>,
    /// What the others show, with what leads there from the image's camera, and how well each of their pixels serves.
    others: Vec<(&'a View<'a>, Affine, &'a [f32])>,
}

impl<'a> Shares<'a> {
    fn new(own: usize, views: &'a [View<'a>], qualities: &'a [Vec<f32>]) -> Self {
        let to_world = views[own].maker.image.pose.world_to_camera.inverse();
        let leads = |view: &View| Affine::new(view.maker.image.pose.world_to_camera * to_world);
        let others = views.iter().zip(qualities).enumerate().filter(|(other, _)| *other != own);
        let others = others.map(|(_, (view, qualities))| (view, leads(view), &qualities[..])).collect();
        Self { own: &views[own], others }
    }

    /// Those of a square's surfels.
    fn of(&self, square: &Square) -> [f32; AREA] {
        let mut shares = self.own.qualities_of(square);
        for (number, share) in shares.iter_mut().enumerate().take(square.len()) {
            let center = square.center(number);
            let seen = |(view, there, qualities): &(&View, Affine, &[f32])| {
                Some(qualities[view.pixel_of(there.point(center))?])
            };
            let total = *share + self.others.iter().filter_map(seen).sum::<f32>();
            *share = if total > 0.0 { *share / total } else { 1.0 };
        }
        shares
    }
}

/// From one camera's space to another's: rows of a matrix and what is added.
#[derive(Clone, Copy)]
struct Affine([[f32; 4]; 3]);

impl Affine {
    fn new(map: DAffine3) -> Self {
        let DAffine3 { matrix3: m, translation } = map;
        Self([0, 1, 2].map(|i| [m.x_axis[i], m.y_axis[i], m.z_axis[i], translation[i]].map(|x| x as f32)))
    }

    fn point(&self, p: [f32; 3]) -> [f32; 3] {
        self.0.map(|[x, y, z, add]| x * p[0] + y * p[1] + z * p[2] + add)
    }
}

/// An image beside the new view.
struct View<'a> {
    maker: &'a Maker<'a>,
    /// The new view's z, where its eye is, and, where its rays are parallel, where they go to, in its camera's space.
    new_z: [f32; 4],
    eye: [f32; 3],
    along: Option<[f32; 3]>,
    /// Pixels of the new view in a unit of area at a depth of 1, or at any where rays are parallel.
    pixels_per_area: f32,
}

impl<'a> View<'a> {
    fn new(maker: &'a Maker<'a>, new: &Camera) -> Self {
        let own = maker.image.pose.world_to_camera;
        let (pose, new_focal) = (new.pose(), new.intrinsics().focal);
        let along = own.transform_vector3(pose.forward()).as_vec3().to_array();
        Self {
            maker,
            new_z: Affine::new(pose.world_to_camera * own.inverse()).0[2],
            eye: own.transform_point3(pose.eye()).as_vec3().to_array(),
            along: (new.projection() == Projection::Orthographic).then_some(along),
            pixels_per_area: (new_focal.x * new_focal.y) as f32,
        }
    }

    /// How well each pixel's sample serves the new view: 1 where it is no larger than a pixel there and seen from the same side.
    fn qualities(&self) -> Vec<f32> {
        let (squares, [width, _]) = (&self.maker.squares, self.maker.image.size);
        let mut qualities = vec![0.0; self.maker.image.depths.len()];
        let of_rows = |surfels: &mut Surfels, (row, qualities): (usize, &mut [f32])| {
            for square in squares.in_row(row) {
                let own = self.qualities_of(surfels.of(square));
                for ([x, y], quality) in squares.pixels_of(square).zip(own) {
                    qualities[(usize::from(y) - row * SIDE) * width + usize::from(x)] = quality;
                }
            }
        };
        let rows = qualities.par_chunks_mut(SIDE * width).enumerate();
        rows.for_each_init(|| self.maker.surfels(), of_rows);
        qualities
    }

    /// Those of a square's surfels.
    fn qualities_of(&self, square: &Square) -> [f32; AREA] {
        let mut qualities = [0.0; AREA];
        dispatch!(self.maker.level, simd => {
            for first in (0..AREA).step_by(LANES) {
                self.quality(simd, square.sixteen(simd, first)).store_slice(&mut qualities[first..first + LANES]);
            }
        });
        qualities
    }

    /// Those of sixteen.
    #[inline(always)]
    fn quality<S: Simd>(&self, simd: S, surfels: Sixteen<S>) -> F<S> {
        let Sixteen { center, half_axes: [u, v], area } = surfels;
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let [x, y, z, add] = self.new_z;
        let depth = center[0] * x + (center[1] * y + (center[2] * z + add));
        // All in their depths in the image: what is near or far is as any other.
        let scale = one / center[2];
        let [ray, u, v] = [scaled::<S>(center, scale), scaled::<S>(u, scale), scaled::<S>(v, scale)];
        let [a, b, c] = self.eye;
        // The way from the eye, and pixels of the new view in a unit of area that is seen along it.
        let (from_eye, pixels) = match self.along {
            Some([a, b, c]) => ([splat(simd, a), splat(simd, b), splat(simd, c)], one),
            None => {
                let nearer = center[2] / depth;
                let from_eye = [ray[0] - scale * a, ray[1] - scale * b, ray[2] - scale * c];
                (from_eye, (scale * scale) * (nearer * nearer) * nearer)
            }
        };
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let length = dot::<S>(normal, normal).sqrt();
        // A surfel without a normal is as if it were seen edge-on.
        let along_normal = length.simd_gt(zero).select(dot::<S>(normal, from_eye).abs() / length, zero);
        let spread = area * self.pixels_per_area * pixels * along_normal;
        // Trust falls as the new view turns away from the one that a sample was taken from, and faster with the pixels that it is blurred over: a
        // coarse sample hardly counts beside a fine one.
        let turned = dot::<S>(from_eye, ray).max(zero);
        let cosine_squared = turned * turned / (dot::<S>(from_eye, from_eye) * dot::<S>(ray, ray));
        let blur = spread.max(one);
        let quality = cosine_squared * cosine_squared / (blur * blur * blur);
        let is_ahead = if self.along.is_some() { depth.simd_eq(depth) } else { depth.simd_gt(zero) };
        // What is no number, as of a surfel at the eye, is none.
        (is_ahead & quality.simd_ge(zero)).select(quality, zero)
    }

    /// The pixel that shows a place of its camera's space.
    fn pixel_of(&self, [x, y, z]: [f32; 3]) -> Option<usize> {
        let Maker { image, focal, center, .. } = self.maker;
        let at = [0, 1].map(|axis| focal[axis] * [x, y][axis] / z + center[axis]);
        let inside = (0..2).all(|axis| at[axis] >= 0.0 && at[axis] < image.size[axis] as f32);
        let pixel = (z > 0.0 && inside).then(|| at[1] as usize * image.size[0] + at[0] as usize)?;
        let depth = image.along_axis(pixel, image.depths[pixel]);
        (depth > 0.0 && self.maker.steps.are_one_surface([depth, z])).then_some(pixel)
    }
}

#[inline(always)]
fn scaled<S: Simd>([x, y, z]: F3<S>, by: F<S>) -> F3<S> {
    [x * by, y * by, z * by]
}

#[inline(always)]
fn dot<S: Simd>(a: F3<S>, b: F3<S>) -> F<S> {
    a[0] * b[0] + (a[1] * b[1] + a[2] * b[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth_image::room::Room;
    use glam::{DMat3, DVec2, DVec3};
    use oblate_engine::simd::Level;
    use oblate_engine::{Intrinsics, Pose};

    /// In double precision and in the world: of a surfel by its centre, half-axes and area in its camera's space.
    fn quality(own: &Camera, new: &Camera, [center, u, v]: [DVec3; 3], area: f64) -> f64 {
        let to_world = own.pose().world_to_camera.inverse();
        let place = to_world.transform_point3(center);
        let normal = to_world.transform_vector3(u.cross(v).normalize());
        let there = new.pose().world_to_camera.transform_point3(place);
        let (per_area, to_eye) = match new.projection() {
            Projection::Perspective => (normal / there.z.powi(3), place - new.pose().eye()),
            Projection::Orthographic => (normal, new.pose().forward()),
        };
        let spread = area * new.intrinsics().focal.element_product() * per_area.dot(to_eye).abs();
        let cosine = to_eye.normalize().dot((place - own.pose().eye()).normalize()).max(0.0);
        let is_ahead = new.projection() == Projection::Orthographic || there.z > 0.0;
        if is_ahead { cosine.powi(4) / spread.max(1.0).powi(3) } else { 0.0 }
    }

    #[test]
    fn qualities_are_those_of_the_formula() {
        let own = Room.other_camera(48).expect("a camera");
        let image = Room.image(&own);
        let pose = |[x, y, z]: [f64; 3], turn: f64| {
            let turn = DMat3::from_rotation_y(turn);
            Pose { world_to_camera: DAffine3::from_mat3_translation(turn, DVec3::new(x, y, z)) }
        };
        let near = |pose| {
            let intrinsics = Intrinsics { focal: DVec2::splat(90.0), center: DVec2::splat(20.0) };
            Camera::from_intrinsics(pose, intrinsics, Projection::Perspective, [40; 2]).expect("a camera")
        };
        let views = [
            near(pose([0.3, -0.1, -0.5], 0.2)),
            // Some of the room is behind it, and some is seen from the other side.
            near(pose([0.0, 0.0, -2.5], 0.0)),
            near(pose([0.0, 0.0, 6.0], 2.5)),
            Camera::orthographic(pose([0.5, 0.0, 1.0], -0.4), 2.0, [64, 48]).expect("a camera"),
        ];
        let mut of_use = [0; 2];
        for new in &views {
            for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
                let maker = Maker::with(level, &image, Memory::default()).expect("the image is one");
                let found = View::new(&maker, new).qualities();
                let mut surfels = maker.surfels();
                for square in (0..image.size[1].div_ceil(SIDE)).flat_map(|row| maker.squares.in_row(row)) {
                    let rows = surfels.of(square);
                    for (number, [x, y]) in maker.squares.pixels_of(square).enumerate() {
                        let (vectors, area) = rows.surfel(number);
                        let right = quality(&own, new, vectors, area);
                        let found = f64::from(found[usize::from(y) * image.size[0] + usize::from(x)]);
                        // Roundings of some tens of operations, to the fourth power and the third. What is spread over more than two
                        // hundred pixels, and below 1e-7, lies near the plane of the new eye, where the depth is a difference of
                        // larger numbers.
                        assert!(
                            (found - right).abs() <= 1e-4 * right + 1e-7,
                            "{level:?}: {found} for {right}"
                        );
                        of_use[usize::from(right > 0.0)] += 1;
                    }
                }
            }
        }
        assert!(of_use[0] > 100 && of_use[1] > 1000, "{of_use:?}");
    }

    /// Places of one image's surfels in another are those of the formula in double precision, but beside borders of pixels.
    #[test]
    fn a_place_is_seen_by_its_pixel() {
        let cameras = [Room.camera(96), Room.other_camera(75)].map(|camera| camera.expect("a camera"));
        let images = cameras.each_ref().map(|camera| Room.image(camera));
        let makers =
            images.each_ref().map(|image| Maker::new(image, Memory::default()).expect("the image is one"));
        let views = makers.each_ref().map(|maker| View::new(maker, &cameras[0]));
        let own_to_other = cameras[1].pose().world_to_camera * cameras[0].pose().world_to_camera.inverse();
        let lead = Affine::new(own_to_other);
        let (mut surfels, mut counts) = (makers[0].surfels(), [0; 2]);
        for square in (0..images[0].size[1].div_ceil(SIDE)).flat_map(|row| makers[0].squares.in_row(row)) {
            let own = surfels.of(square);
            for number in 0..own.len() {
                let center = DVec3::from(own.center(number).map(f64::from));
                let there = own_to_other.transform_point3(center);
                let at =
                    images[1].intrinsics.focal * there.truncate() / there.z + images[1].intrinsics.center;
                let inside = at.cmpge(DVec2::ZERO).all() && at.x < 75.0 && at.y < images[1].size[1] as f64;
                let pixel = at.y as usize * 75 + at.x as usize;
                let depth = if inside && there.z > 0.0 { images[1].depths[pixel] } else { 0.0 };
                let focal = images[1].intrinsics.focal.min_element();
                // In steps that are one surface, of 10.6 pixel widths.
                let steps = (f64::from(depth) - there.z).abs() * focal / there.z.min(f64::from(depth)) / 10.6;
                let is_near_border =
                    (at - at.round()).abs().min_element() < 1e-3 || (steps - 1.0).abs() < 1e-3;
                if is_near_border {
                    continue;
                }
                let expected = (depth > 0.0 && steps <= 1.0).then_some(pixel);
                assert_eq!(views[1].pixel_of(lead.point(own.center(number))), expected, "{at}");
                counts[usize::from(expected.is_some())] += 1;
            }
        }
        assert!(counts[0] > 500 && counts[1] > 3000, "{counts:?}");
    }
}
