//! Light: Blinn–Phong (Blinn, *Models of light reflection for computer synthesized pictures*, 1977), for
//! volume kernels a step per splat, for surfaces deferred to the pixel.

use crate::camera::{Camera, Projection};
use crate::cloud::Material;
use crate::scene::{Light, Scene};
use glam::{DVec3, Vec3};

/// A light in camera space.
#[derive(Clone, Copy, Debug)]
enum Source {
    Towards(Vec3, Vec3),
    At(Vec3, Vec3),
}

/// The scene's lights in camera space and a material.
#[derive(Clone, Debug)]
pub(crate) struct Shader {
    material: Material,
    ambient: Vec3,
    sources: Vec<Source>,
    parallel_rays: bool,
}

impl Shader {
    pub(crate) fn new(scene: &Scene, camera: &Camera, material: Material) -> Self {
        let world_to_camera = camera.pose().world_to_camera;
        let mut ambient = Vec3::ZERO;
        let mut sources = Vec::new();
        for light in &scene.lights {
            match *light {
                Light::Ambient { color } => ambient += Vec3::from(color),
                Light::Directional { towards, color } => {
                    let towards = (world_to_camera.matrix3 * towards).normalize_or_zero();
                    sources.push(Source::Towards(towards.as_vec3(), color.into()));
                }
                Light::Point { position, color } => {
                    let position = world_to_camera.transform_point3(position);
                    sources.push(Source::At(position.as_vec3(), color.into()));
                }
            }
        }
        if scene.lights.is_empty() {
            ambient = Vec3::ONE;
            sources.push(Source::Towards((-DVec3::Z).as_vec3(), Vec3::ONE));
        }
        let parallel_rays = camera.projection() == Projection::Orthographic;
        Self { material, ambient, sources, parallel_rays }
    }

    /// As [`Self::shade`], for a point that has no sides: the normal is turned to the viewer.
    pub(crate) fn shade_two_sided(&self, base: [f32; 3], normal: Vec3, position: Vec3) -> [f32; 3] {
        let faces_away = normal.dot(self.to_eye(position)) < 0.0;
        self.shade(base, if faces_away { -normal } else { normal }, position)
    }

    fn to_eye(&self, position: Vec3) -> Vec3 {
        if self.parallel_rays { -Vec3::Z } else { (-position).normalize_or_zero() }
    }

    /// The colour sent to the camera by a point with a base colour and a unit normal on the side that is
    /// seen. A point without a normal (zero), deep inside a uniform region, returns ambient light alone.
    pub(crate) fn shade(&self, base: [f32; 3], normal: Vec3, position: Vec3) -> [f32; 3] {
        let Material { ambient, diffuse, specular, exponent } = self.material;
        let base = Vec3::from(base);
        let to_eye = self.to_eye(position);
        let mut light = self.ambient * ambient;
        let mut highlight = Vec3::ZERO;
        for source in &self.sources {
            let (towards, color) = match *source {
                Source::Towards(direction, color) => (direction, color),
                Source::At(place, color) => ((place - position).normalize_or_zero(), color),
            };
            let cosine = normal.dot(towards);
            if cosine > 0.0 {
                light += color * (diffuse * cosine);
                let half = (towards + to_eye).normalize_or_zero();
                highlight += color * (specular * normal.dot(half).max(0.0).powf(exponent));
            }
        }
        (base * light + highlight).to_array()
    }
}
