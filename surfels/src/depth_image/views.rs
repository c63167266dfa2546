//! Several depth images in one picture.

use super::pairs::Surfels;
use super::squares::Pixel;
use super::surfels::{Maker, Memory};
use super::{DepthError, DepthSettings, RgbdImage};
use glam::{DAffine3, DVec3};
use oblate_engine::{Camera, Cloud, Projection, Surfel};
use rayon::prelude::*;

/// How fast trust in a sample falls as the new view turns away from the one that it was taken from: cosⁿ of the angle between.
const TURNING: i32 = 4;

/// And as it is blurred over more pixels: a coarse sample hardly counts beside a fine one.
const BLUR: i32 = 3;

/// The surfels of several depth images, a cloud for each, as they are best seen by `view`: where more than one shows a surface, each
/// sample has a share that goes by how many pixels of the new view it is spread over and by how far the view turns. Shares of what lies at
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
    /// Makes clouds what [`merged_depth_surfels`] gives, in the memory that they have ([`Cloud::renew`]). Of a single image that is the same for all
    /// views.
    ///
    /// # Errors
    /// Those of [`super::depth_surfels`]. Then some clouds may be empty, and others as they were.
    pub fn sample(
        &mut self,
        clouds: &mut Vec<Cloud>,
        images: &[RgbdImage],
        view: &Camera,
        settings: &DepthSettings,
    ) -> Result<(), DepthError> {
        let mut memory = std::mem::take(&mut self.memory);
        memory.resize_with(images.len(), Memory::default);
        let makers = images.iter().zip(memory).map(|(image, memory)| Maker::new(image, memory));
        let makers = makers.collect::<Result<Vec<_>, _>>()?;
        clouds.resize_with(images.len(), Cloud::default);
        if let ([maker], [cloud]) = (&makers[..], &mut clouds[..]) {
            maker.renew(cloud, settings, None)?;
        } else {
            let shares = Shares::new(&makers, view);
            for (own, (maker, cloud)) in makers.iter().zip(clouds).enumerate() {
                let share = |pixel, surfel: &Surfel| shares.of(own, pixel, surfel);
                maker.renew(cloud, settings, Some(&share))?;
            }
        }
        self.memory = makers.into_iter().map(Maker::into_memory).collect();
        Ok(())
    }
}

/// The shares of several images in what is seen.
struct Shares<'a> {
    views: Vec<View<'a>>,
    /// Of each image's pixels.
    qualities: Vec<Vec<f32>>,
}

impl<'a> Shares<'a> {
    fn new(makers: &'a [Maker<'a>], view: &'a Camera) -> Self {
        let views: Vec<View> = makers.iter().map(|maker| View::new(maker, view)).collect();
        let qualities = views.iter().map(View::qualities).collect();
        Self { views, qualities }
    }

    /// That of a pixel's surfel in an image.
    fn of(&self, own: usize, pixel: Pixel, surfel: &Surfel) -> f32 {
        let Self { views, qualities } = self;
        let place = views[own].to_world.transform_point3(surfel.center.as_dvec3());
        let quality = qualities[own][views[own].index(pixel)];
        let others = (0..views.len()).filter(|other| *other != own);
        let seen = others.filter_map(|other| Some(qualities[other][views[other].sees(place)?]));
        let total = quality + seen.sum::<f32>();
        if total > 0.0 { quality / total } else { 1.0 }
    }
}

/// An image beside the new view.
struct View<'a> {
    maker: &'a Maker<'a>,
    to_world: DAffine3,
    world_to_camera: DAffine3,
    new: &'a Camera,
}

impl<'a> View<'a> {
    fn new(maker: &'a Maker<'a>, new: &'a Camera) -> Self {
        let world_to_camera = maker.image.pose.world_to_camera;
        Self { maker, to_world: world_to_camera.inverse(), world_to_camera, new }
    }

    /// How well each pixel's sample serves the new view: 1 where it is no larger than a pixel there and seen from the same side.
    fn qualities(&self) -> Vec<f32> {
        let squares = &self.maker.squares;
        let of_square = |surfels: &mut Surfels, square: usize| -> Vec<f32> {
            let rows = surfels.of(square);
            (0..squares.pixels_of(square).count()).map(|place| self.quality(&rows.surfel(place))).collect()
        };
        let of_squares: Vec<Vec<f32>> =
            (0..squares.count()).into_par_iter().map_init(|| self.maker.surfels(), of_square).collect();
        let mut qualities = vec![0.0; self.maker.image.depths.len()];
        for (square, own) in of_squares.into_iter().enumerate() {
            for (pixel, quality) in squares.pixels_of(square).zip(own) {
                qualities[self.index(pixel)] = quality;
            }
        }
        qualities
    }

    /// A pixel's place in the image's arrays.
    fn index(&self, [column, row]: Pixel) -> usize {
        usize::from(row) * self.maker.image.size[0] + usize::from(column)
    }

    fn quality(&self, surfel: &Surfel) -> f32 {
        let place = self.to_world.transform_point3(surfel.center.as_dvec3());
        let normal = surfel.factor.x_axis.cross(surfel.factor.y_axis).as_dvec3().normalize_or_zero();
        let normal = self.to_world.transform_vector3(normal);
        let pose = self.new.pose();
        let there = pose.world_to_camera.transform_point3(place);
        // Pixels of the new view that a surface's unit of area takes up, and the way to the eye.
        let [per_area, to_eye] = match self.new.projection() {
            Projection::Perspective => [normal * (1.0 / there.z.powi(3)), place - pose.eye()],
            Projection::Orthographic => [normal, pose.forward()],
        };
        let focal = self.new.intrinsics().focal;
        let spread = f64::from(surfel.area) * focal.x * focal.y * per_area.dot(to_eye).abs();
        let own = self.to_world.translation;
        let cosine = unit(to_eye).dot(unit(place - own)).max(0.0);
        let is_ahead = self.new.projection() == Projection::Orthographic || there.z > 0.0;
        if is_ahead { (cosine.powi(TURNING) / spread.max(1.0).powi(BLUR)) as f32 } else { 0.0 }
    }

    /// The pixel that shows a place of the world.
    fn sees(&self, place: DVec3) -> Option<usize> {
        let image = self.maker.image;
        let there = self.world_to_camera.transform_point3(place);
        let at = image.intrinsics.focal * there.truncate() / there.z + image.intrinsics.center;
        let inside = (0..2).all(|axis| at[axis] >= 0.0 && at[axis] < image.size[axis] as f64);
        let pixel = (there.z > 0.0 && inside).then(|| at.y as usize * image.size[0] + at.x as usize)?;
        let depths = [image.along_axis(pixel, image.depths[pixel]), there.z as f32];
        (depths[0] > 0.0 && self.maker.steps.are_one_surface(depths)).then_some(pixel)
    }
}

fn unit(direction: DVec3) -> DVec3 {
    direction.normalize_or_zero()
}
