//! Light on a point, in camera space.
//!
//! Blinn, *Models of light reflection for computer synthesized pictures*, 1977: the highlight by the
//! half-way vector. Surfaces have two sides: a normal is turned to the viewer first.

use super::ReferenceError;
use crate::cloud::Material;
use crate::scene::{Light, Scene};
use glam::{DAffine3, DVec3};

/// The lights of a scene as a camera has them.
pub(super) struct Lighting {
    ambient: DVec3,
    lamps: Vec<Lamp>,
}

enum Place {
    /// Towards the light, a unit vector.
    Infinite(DVec3),
    At(DVec3),
}

struct Lamp {
    place: Place,
    color: DVec3,
}

/// What light falls on.
pub(super) struct Spot {
    pub(super) point: DVec3,
    /// Any length; zero for a splat without a normal.
    pub(super) normal: DVec3,
    /// The direction from the eye to the point, any length.
    pub(super) seen_along: DVec3,
}

impl Lighting {
    pub(super) fn new(scene: &Scene, world_to_camera: DAffine3) -> Result<Self, ReferenceError> {
        let mut lighting = Self { ambient: DVec3::ZERO, lamps: Vec::new() };
        if scene.lights.is_empty() {
            lighting.ambient = DVec3::ONE;
            lighting.lamps.push(Lamp { place: Place::Infinite(DVec3::NEG_Z), color: DVec3::ONE });
        }
        for (index, light) in scene.lights.iter().enumerate() {
            let (place, color) = match *light {
                Light::Ambient { color } => (None, color),
                Light::Directional { towards, color } => {
                    let towards = world_to_camera.transform_vector3(towards).try_normalize();
                    (Some(Place::Infinite(towards.ok_or(ReferenceError::Light { index })?)), color)
                }
                Light::Point { position, color } => {
                    (Some(Place::At(world_to_camera.transform_point3(position))), color)
                }
            };
            let color = DVec3::from_array(color.map(f64::from));
            let placed = !matches!(place, Some(Place::At(point)) if !point.is_finite());
            if !color.is_finite() || !placed {
                return Err(ReferenceError::Light { index });
            }
            match place {
                None => lighting.ambient += color,
                Some(place) => lighting.lamps.push(Lamp { place, color }),
            }
        }
        Ok(lighting)
    }

    /// The colour that leaves a spot towards the eye. Without a normal only ambient light is
    /// returned.
    pub(super) fn shade(&self, color: DVec3, material: &Material, spot: &Spot) -> DVec3 {
        let [ambient, diffuse, specular, exponent] =
            [material.ambient, material.diffuse, material.specular, material.exponent].map(f64::from);
        let view = -spot.seen_along.normalize_or_zero();
        let normal = spot.normal.normalize_or_zero();
        let normal = if normal.dot(view) < 0.0 { -normal } else { normal };
        let (mut scattered, mut mirrored) = (DVec3::ZERO, DVec3::ZERO);
        for lamp in &self.lamps {
            let towards = match lamp.place {
                Place::Infinite(towards) => towards,
                Place::At(position) => (position - spot.point).normalize_or_zero(),
            };
            if normal.dot(towards) > 0.0 {
                scattered += lamp.color * normal.dot(towards);
                let half_way = (towards + view).normalize_or_zero();
                mirrored += lamp.color * normal.dot(half_way).max(0.0).powf(exponent);
            }
        }
        color * (ambient * self.ambient + diffuse * scattered) + specular * mirrored
    }
}
