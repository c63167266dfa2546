//! Splats as training makes them: a chequered ground, a torus, a sphere, a cloud of fuzz and a backdrop.

use super::random::Random;
use glam::{Mat3, Vec3};
use oblate_engine::color::srgb_to_linear;
use oblate_engine::footprint::{CameraSplat, Footprint, Lens};
use oblate_engine::{
    Camera, Cloud, Harmonics, Material, OpacityFilter, RenderSettings, Shapes, Splats, Strength,
};
use std::f32::consts::TAU;

/// A place on what the splats stand for: centre, normal, display colour, spread in a scene of a million.
type Place = (Vec3, Vec3, Vec3, f32);

/// Colours of harmonics of degree 3.
const PER_SPLAT: usize = 15;

/// Trained-like splats with harmonics of degree 3; y is down.
pub fn trained(count: usize) -> Splats {
    let mut random = Random(7);
    let scale = (1e6 / count as f32).sqrt();
    let (mut centers, mut factors) = (Vec::with_capacity(count), Vec::with_capacity(count));
    let (mut peaks, mut colors) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for _ in 0..count {
        let (place, normal, color, sigma) = place(&mut random);
        centers.push(place + normal * (0.003 * random.normal()));
        // Flat along the normal, turned at random about it.
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let (sin, cos) = random.uniform(0.0, TAU).sin_cos();
        let along = tangent * cos + bitangent * sin;
        let log_scales = random.normals() * 0.55 + (sigma * scale).ln() - Vec3::Z * 1.6;
        let axes = Mat3::from_cols(along, normal.cross(along), normal);
        factors.push(axes * Mat3::from_diagonal(log_scales.to_array().map(f32::exp).into()));
        peaks.push(1.0 / (1.0 + (-(0.8 + 2.2 * random.normal())).exp()));
        let noisy = (color + random.normals() * 0.06).clamp(Vec3::ZERO, Vec3::ONE);
        colors.push(noisy.to_array().map(srgb_to_linear));
    }
    let coefficients = (0..PER_SPLAT * count).map(|_| (random.normals() * 0.04).to_array()).collect();
    Splats {
        centers,
        shapes: Shapes::Each(factors),
        strength: Strength::Opacity {
            peaks,
            filter: OpacityFilter::Compensated,
            least: Strength::LEAST_OF_TRAINED,
        },
        colors,
        harmonics: Some(Harmonics { degree: 3, coefficients }),
        normals: None,
        material: Material::UNLIT,
    }
}

fn place(random: &mut Random) -> Place {
    let part = random.uniform(0.0, 1.0);
    if part < 0.40 {
        let [x, z] = [random.uniform(-2.5, 2.5), random.uniform(-2.5, 2.5)];
        let is_light = ((x * 2.0).floor() + (z * 2.0).floor()).rem_euclid(2.0) == 1.0;
        let color = if is_light { Vec3::new(0.75, 0.7, 0.6) } else { Vec3::new(0.25, 0.32, 0.22) };
        return (Vec3::new(x, 0.0, z), -Vec3::Y, color, 0.0075);
    }
    if part < 0.65 {
        let [u, w] = [random.uniform(0.0, TAU), random.uniform(0.0, TAU)];
        let normal = Vec3::new(w.cos() * u.cos(), w.sin(), w.cos() * u.sin());
        let middle = Vec3::new(0.9 * u.cos(), -0.55, 0.9 * u.sin());
        let color = Vec3::new(u * 3.0, u * 3.0 + 2.0, w * 2.0 + 4.0).map(|x| 0.5 + 0.45 * x.cos());
        return (middle + normal * 0.32, normal, color, 0.005);
    }
    let away = random.normals();
    let normal = away.try_normalize().unwrap_or(Vec3::Z);
    if part < 0.85 {
        let color = (normal * 9.0).map(|x| 0.5 + 0.4 * x.sin());
        return (normal * 0.5 - Vec3::Y, normal, color, 0.004);
    }
    if part < 0.95 {
        let place = away * Vec3::new(0.6, 0.3, 0.6) + Vec3::new(0.3, -1.5, 0.2);
        return (place, normal, Vec3::new(0.7, 0.7, 0.85), 0.012);
    }
    let color =
        (Vec3::splat(0.45 - 0.3 * normal.y) + Vec3::new(0.0, 0.05, 0.15)).clamp(Vec3::ZERO, Vec3::ONE);
    (normal * 8.0, -normal, color, 0.07)
}

/// The same splats as extinction kernels whose opacities have the same peaks in a picture.
pub fn as_extinction(mut splats: Splats, camera: &Camera, settings: &RenderSettings) -> Splats {
    let (Strength::Opacity { peaks, filter, .. }, Shapes::Each(factors)) = (&splats.strength, &splats.shapes)
    else {
        return splats;
    };
    let lens = Lens::new(camera, settings.low_pass);
    let world_to_camera = camera.pose().world_to_camera;
    let mass = |((center, factor), peak): ((&Vec3, &Mat3), &f32)| {
        let splat = CameraSplat {
            center: world_to_camera.transform_point3(center.as_dvec3()),
            factor: world_to_camera.matrix3 * factor.as_dmat3(),
        };
        let Some(footprint) = Footprint::new(&splat, &lens) else { return 0.0 };
        // Optical depth −ln(1 − α); nothing finite is opaque.
        let attenuation = match filter {
            OpacityFilter::Classic => 1.0,
            OpacityFilter::Compensated => footprint.filter_attenuation(&splat, &lens),
        };
        let alpha = (f64::from(*peak) * attenuation).min(0.999);
        (-(-alpha).ln_1p() / (footprint.unit_integral * footprint.center_ray.length())) as f32
    };
    let masses = splats.centers.iter().zip(factors).zip(peaks).map(mass).collect();
    splats.strength = Strength::Extinction { masses };
    splats
}

/// The splats as a cloud.
pub fn cloud(splats: Splats) -> Cloud {
    Cloud::new(splats).expect("the numbers are finite")
}
