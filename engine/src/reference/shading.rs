//! Light on a point, in camera space.
//!
//! Blinn, *Models of light reflection for computer synthesized pictures*, 1977: the highlight by the
//! half-way vector.

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
    /// On the side that is seen, of length 1, or less for the mean of several; zero for a splat without a normal.
    pub(super) normal: DVec3,
    /// The direction from the eye to the point, any length.
    pub(super) seen_along: DVec3,
}

impl Lighting {
    pub(super) fn new(scene: &Scene, world_to_camera: DAffine3) -> Self {
        let mut lighting = Self { ambient: DVec3::ZERO, lamps: Vec::new() };
        if scene.lights.is_empty() {
            lighting.ambient = DVec3::ONE;
            lighting.lamps.push(Lamp { place: Place::Infinite(DVec3::NEG_Z), color: DVec3::ONE });
        }
        for light in &scene.lights {
            let color = |color: [f32; 3]| DVec3::from_array(color.map(f64::from));
            lighting.lamps.push(match *light {
                Light::Ambient { color: ambient } => {
                    lighting.ambient += color(ambient);
                    continue;
                }
                Light::Directional { towards, color: emitted } => {
                    let towards = world_to_camera.transform_vector3(towards).normalize_or_zero();
                    Lamp { place: Place::Infinite(towards), color: color(emitted) }
                }
                Light::Point { position, color: emitted } => Lamp {
                    place: Place::At(world_to_camera.transform_point3(position)),
                    color: color(emitted),
                },
            });
        }
        lighting
    }

    /// The colour that leaves a spot towards the eye. Without a normal only ambient light is
    /// returned.
    pub(super) fn shade(&self, color: DVec3, material: &Material, spot: &Spot) -> DVec3 {
        let Material { emission, ambient, diffuse, specular, exponent } = *material;
        let [emission, ambient, diffuse, specular, exponent] =
            [emission, ambient, diffuse, specular, exponent].map(f64::from);
        let view = -spot.seen_along.normalize_or_zero();
        let normal = spot.normal.normalize_or_zero();
        let length = spot.normal.length().min(1.0);
        // Toksvig, *Mipmapping Normal Maps*, 2005: a highlight is as wide as it and the normals are.
        let wider = exponent * length / (length + exponent * (1.0 - length));
        let specular = specular * (1.0 + wider) / (1.0 + exponent);
        let (mut scattered, mut mirrored) = (DVec3::ZERO, DVec3::ZERO);
        for lamp in &self.lamps {
            let towards = match lamp.place {
                Place::Infinite(towards) => towards,
                Place::At(position) => (position - spot.point).normalize_or_zero(),
            };
            let cosine = mean_cosine(length, normal.dot(towards), view.dot(towards));
            if cosine > 0.0 {
                scattered += lamp.color * cosine;
                let half_way = (towards + view).normalize_or_zero();
                mirrored += lamp.color * normal.dot(half_way).max(0.0).powf(wider);
            }
        }
        color * (emission + ambient * self.ambient + diffuse * scattered) + specular * mirrored
    }
}

/// The mean of max(n·l, 0) over normals whose mean has a length and a cosine with l, where the eye's cosine with l is `facing`: half the
/// sum of the mean of n·l, which the normals behind the eye's horizon turn towards it, and of that of |n·l|, the root of its mean
/// square less what it varies.
fn mean_cosine(length: f64, cosine: f64, facing: f64) -> f64 {
    if length == 0.0 {
        return 0.0;
    }
    let lost = 1.0 - length.max(0.5);
    let across = lost - lost * lost * (2.0 / 3.0);
    let square = across + (1.0 - 3.0 * across) * cosine * cosine;
    let either = (1.0 - 0.402 * across) * square.max(0.0).sqrt();
    let signed = (1.0 - 2.0 * lost) * cosine + lost * facing;
    (0.5 * (either + signed)).max(0.0)
}
