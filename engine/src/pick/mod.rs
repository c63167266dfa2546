//! Picking: which splat is seen at a point of the picture.
//!
//! What is picked is where half of what is seen along the ray lies in front: with T the transmittance at a depth and T∞ behind
//! everything, where T falls to (1 + T∞)/2. On an opaque surface that is the surface, in an opaque volume where
//! [`crate::Frame::median_depth`] is, and in a faint one still its middle. At a surface layer the splat is its front-most one, most often the one
//! whose id [`crate::Frame::id`] holds (that is of the first layer that shows, however little, and of equally near ones rounding may choose
//! another); in a volume the kernel that takes most of the light there; where kernels are composited by their
//! centres the one that takes T across.
//!
//! A hierarchy of boxes finds the splats that the ray meets ([`Picker`]); what they are along it is said by the formulas of
//! the reference R1, so that no level of detail and no rounding of the rasterizer has a part in it.

mod tree;

use crate::camera::{Camera, Projection};
use crate::cloud::Cloud;
use crate::footprint::Lens;
use crate::reference::{MOST_REACH, Median};
use crate::scene::{RenderSettings, Scene};
use crate::validate::SceneError;
use glam::{DAffine3, DMat3, DVec2, DVec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::Arc;
use tree::{BoxTree, Needle, bounds};

/// Consecutive splats that share a box.
const RUN: usize = 16;

/// A splat under a point of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picked {
    /// The cloud's number in the scene.
    pub cloud: usize,
    /// The splat's number in the cloud.
    pub splat: usize,
    /// Its number in the scene, as [`crate::Frame::id`] counts.
    pub id: u32,
    /// z along the view axis at which half of what is seen along the ray is in front, in world units.
    pub depth: f64,
    /// The point there, in the world.
    pub position: DVec3,
    /// How opaque all is that the ray meets, at least 1e-6 and at most 1.
    pub opacity: f64,
}

/// Finds the splat under a point of the picture.
///
/// The hierarchy of a cloud's splats is built once, however often the cloud stands in the scene; above it is one of the clouds'
/// places, which is all that is built again when clouds move ([`Picker::update`]).
pub struct Picker {
    scene: Scene,
    /// Of each cloud; clones of one cloud share theirs.
    trees: Vec<Arc<SplatTree>>,
    places: BoxTree,
}

/// Boxes of runs of a cloud's splats, in cloud space.
struct SplatTree {
    /// Keeps the splats, by whose address clones are known.
    cloud: Cloud,
    boxes: BoxTree,
    bounds: [DVec3; 2],
}

impl Picker {
    /// A picker for a scene, of which it keeps a clone.
    ///
    /// # Errors
    /// When a light or a transform is not finite, or there are more clouds or splats than ids can name.
    pub fn new(scene: &Scene) -> Result<Self, SceneError> {
        let mut picker = Self { scene: Scene::default(), trees: Vec::new(), places: BoxTree::new(&[]) };
        picker.update(scene)?;
        Ok(picker)
    }

    /// Takes another scene, and makes anew only what it must: the hierarchies of clouds that were not there before, and
    /// that of places.
    ///
    /// # Errors
    /// Those of [`Picker::new`]; the picker then stays as it was.
    pub fn update(&mut self, scene: &Scene) -> Result<(), SceneError> {
        scene.validate()?;
        let known = std::mem::take(&mut self.trees).into_iter();
        let mut by_address: HashMap<_, _> = known.map(|tree| (tree.cloud.address(), tree)).collect();
        let tree = |cloud: &Cloud| {
            let tree = by_address.entry(cloud.address()).or_insert_with(|| Arc::new(SplatTree::new(cloud)));
            Arc::clone(tree)
        };
        self.trees = scene.clouds.iter().map(tree).collect();
        let place = |(cloud, tree): (&Cloud, &Arc<SplatTree>)| {
            let [low, high] = tree.bounds;
            let to_world = cloud.cloud_to_world();
            let middle = to_world.transform_point3((low + high) / 2.0);
            let DMat3 { x_axis, y_axis, z_axis } = to_world.matrix3;
            let half = (high - low) / 2.0;
            let half = x_axis.abs() * half.x + y_axis.abs() * half.y + z_axis.abs() * half.z;
            [middle - half, middle + half]
        };
        let boxes: Vec<_> = scene.clouds.iter().zip(&self.trees).map(place).collect();
        self.places = BoxTree::new(&boxes);
        self.scene = scene.clone();
        Ok(())
    }

    /// The splat that is seen at a point of the picture, in pixels from its top left corner: the centre of pixel (i, j) is
    /// (i + 0.5, j + 0.5). `None` where nothing is seen.
    ///
    /// Of the settings the filter and the outline count, as far as it lies within 6σ.
    ///
    /// # Errors
    /// When a setting is outside its range.
    pub fn pick(
        &self,
        camera: &Camera,
        settings: &RenderSettings,
        pixel: DVec2,
    ) -> Result<Option<Picked>, SceneError> {
        settings.validate()?;
        if !pixel.is_finite() {
            return Ok(None);
        }
        // Light has no part in it.
        let outline = settings.outline.min(MOST_REACH * MOST_REACH);
        let settings = RenderSettings { shade: false, outline, ..*settings };
        let median = Median::new(&self.scene, camera, &settings);
        let mut ids = Vec::new();
        self.candidates(camera, &settings, pixel, &mut ids);
        let Some((id, depth, opacity)) = median.at(pixel, &ids) else { return Ok(None) };
        let (cloud, first) = self.cloud_of(id);
        let position = Lens::new(camera, 0.0).position(pixel, depth);
        let camera_to_world = camera.pose().world_to_camera.inverse();
        Ok(Some(Picked {
            cloud,
            splat: (id - first) as usize,
            id,
            depth,
            position: camera_to_world.transform_point3(position),
            opacity,
        }))
    }

    /// The ids of all splats that the ray may meet, in rising order.
    fn candidates(&self, camera: &Camera, settings: &RenderSettings, pixel: DVec2, ids: &mut Vec<u32>) {
        let lens = Lens::new(camera, settings.low_pass);
        let perspective = camera.projection() == Projection::Perspective;
        let ray = lens.ray(pixel);
        let shear = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(-ray.x, -ray.y, 1.0));
        let origin = lens.position(pixel, 0.0);
        let camera_to_needle = DAffine3 { matrix3: shear, translation: -origin };
        let needle = Needle {
            world_to_needle: camera_to_needle * camera.pose().world_to_camera,
            filter_reach: MOST_REACH * lens.filter_sigma / lens.focal,
            perspective,
            near: camera.near(),
        };
        let mut clouds = Vec::new();
        self.places.pierced(&needle, needle.world_to_needle, &mut |cloud| clouds.push(cloud));
        clouds.sort_unstable();
        let mut first_id = 0;
        let mut next = 0;
        for cloud in clouds {
            first_id += self.scene.clouds[next..cloud].iter().map(|cloud| cloud.len() as u32).sum::<u32>();
            next = cloud;
            let (cloud, tree) = (&self.scene.clouds[cloud], &self.trees[cloud]);
            let from = ids.len();
            tree.boxes.pierced(&needle, needle.world_to_needle * cloud.cloud_to_world(), &mut |run| {
                let run = run * RUN..cloud.len().min((run + 1) * RUN);
                ids.extend(run.map(|index| first_id + index as u32));
            });
            ids[from..].sort_unstable();
        }
    }

    /// The number of the cloud with a splat, and its first splat.
    fn cloud_of(&self, id: u32) -> (usize, u32) {
        let (mut cloud, mut first) = (0, 0);
        while id - first >= self.scene.clouds[cloud].len() as u32 {
            first += self.scene.clouds[cloud].len() as u32;
            cloud += 1;
        }
        (cloud, first)
    }
}

impl SplatTree {
    fn new(cloud: &Cloud) -> Self {
        let of_splat = |index: usize| {
            let center = cloud.center(index).as_dvec3();
            let factor = cloud.factor(index).as_dmat3();
            let variance = |axis: DVec3| axis * axis;
            // As far as the ellipsoid reaches along each axis: the roots of Σ's diagonal.
            let sigma =
                (variance(factor.x_axis) + variance(factor.y_axis) + variance(factor.z_axis)).map(f64::sqrt);
            [center - MOST_REACH * sigma, center + MOST_REACH * sigma]
        };
        let of_run = |run: usize| {
            let splats: Vec<_> = (run * RUN..cloud.len().min((run + 1) * RUN)).map(of_splat).collect();
            bounds(&splats)
        };
        let boxes: Vec<_> = (0..cloud.len().div_ceil(RUN)).into_par_iter().map(of_run).collect();
        Self { cloud: cloud.clone(), boxes: BoxTree::new(&boxes), bounds: bounds(&boxes) }
    }
}

#[cfg(test)]
mod tests;
