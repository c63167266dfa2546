//! A volume, clouds in each other, a surface, all of them mixed, trained splats, alone and on a stage, and a crowd from afar.

use super::gaussians::{cloud, trained as trained_splats};
use super::random::Random;
use super::{Scale, Subject, SubjectError};
use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use oblate_engine::{
    Blend, Camera, CameraError, Cloud, Material, Pose, RenderSettings, Scene, Shapes, Splats, Strength,
};
use oblate_surfels::{BaseColor, Density, Filter, Mesh, SamplerSettings, Texture, Wrap, primitives, sample};
use oblate_volumes::{
    IsoSettings, KernelSettings, TransferFunction, Volume, Voxels, iso_surfels, marschner_lobb, shepp_logan,
    to_kernels,
};
use std::f32::consts::TAU;
use std::sync::Arc;

/// The transfer function of `head`: skin as haze, skull as tinted glass, brain as fog with darker and lighter parts.
pub const HEAD_TRANSFER: &str = "
    transfer 1
    strength extinction
    color srgb
    0.05  0.85 0.55 0.45  0
    0.18  0.85 0.55 0.45  1.2
    0.22  0.70 0.45 0.50  1.5
    0.35  0.90 0.40 0.30  6
    0.60  0.80 0.95 0.92  3
    0.95  0.95 0.97 1.00  9
";

/// The skull alone, as glass.
const SKULL: &str = "
    transfer 1
    strength extinction
    color srgb
    0.45  0.30 0.60 0.66  0
    0.80  0.75 0.95 0.92  4
";

/// 30° high, y up unless said otherwise.
fn camera(eye: DVec3, up: DVec3, side: u32) -> Result<Camera, CameraError> {
    Camera::perspective(Pose::look_at(eye, DVec3::ZERO, up)?, 30f64.to_radians(), [side; 2])
}

fn subject(name: &str, about: &str, clouds: Vec<Cloud>, camera: Camera) -> Subject {
    Subject {
        name: name.into(),
        about: about.into(),
        scene: Scene { clouds, lights: Vec::new() },
        camera,
        settings: RenderSettings { background: [0.02, 0.02, 0.02, 1.0], ..RenderSettings::default() },
        known: None,
        peers: Vec::new(),
    }
}

/// The head phantom, each axis filtered by (1 2 1)/4: its skull is thinner than the lattice can hold.
fn phantom(side: usize) -> Result<Volume, SubjectError> {
    let raw = shepp_logan(side)?;
    let mut values: Vec<f32> = (0..raw.voxels().len()).map(|i| raw.voxels().get(i)).collect();
    for step in [1, side, side * side] {
        let before = values.clone();
        for i in step..values.len() - step {
            values[i] = 0.25 * before[i - step] + 0.5 * before[i] + 0.25 * before[i + step];
        }
    }
    Ok(Volume::new(raw.dims(), Voxels::F32(values), raw.frame())?)
}

fn classified(volume: &Volume, transfer: &str) -> Result<Cloud, SubjectError> {
    let transfer: TransferFunction = transfer.parse()?;
    Ok(to_kernels(volume, &transfer, &KernelSettings::default())?)
}

/// The volume of `head`, 64³ samples or 40³.
///
/// # Errors
/// Never, unless numbers in this crate are wrong.
pub fn head_volume(scale: Scale) -> Result<Volume, SubjectError> {
    phantom(scale.pick(64, 40))
}

pub(super) fn head(scale: Scale) -> Result<Subject, SubjectError> {
    let kernels = classified(&head_volume(scale)?, HEAD_TRANSFER)?;
    let about = "A medical volume: the Shepp–Logan head as shaded, semi-transparent kernels. What is hard: tens of them overlap on every ray.";
    let camera = camera(DVec3::new(2.2, -2.9, 1.6), DVec3::Z, scale.side())?;
    Ok(subject("head", about, vec![kernels], camera))
}

/// Kernels of all sizes in contrasting colours through each other.
fn motley(count: usize) -> Result<Cloud, SubjectError> {
    let mut random = Random(3);
    let size = (1e4 / count as f32).cbrt();
    let (mut centers, mut factors, mut masses, mut colors) = (vec![], vec![], vec![], vec![]);
    while centers.len() < count {
        let place = Vec3::from_array(std::array::from_fn(|_| random.uniform(-1.0, 1.0)));
        if place.length() > 1.0 {
            continue;
        }
        let sigma = 0.07 * size * (0.5 * random.normal()).exp();
        // An optical depth through the middle, of a round kernel of this size.
        let depth = 0.3 * (0.4 * random.normal()).exp();
        let hue = random.uniform(0.0, TAU);
        centers.push(place);
        factors.push(Mat3::from_diagonal(Vec3::splat(sigma)));
        masses.push(depth * TAU * sigma * sigma);
        colors.push([0.0, 2.1, 4.2].map(|shift: f32| 0.5 + 0.45 * (hue + shift).cos()));
    }
    Ok(Cloud::new(Splats {
        centers,
        shapes: Shapes::Each(factors),
        strength: Strength::Extinction { masses },
        colors,
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })?)
}

pub(super) fn clouds(scale: Scale) -> Result<Subject, SubjectError> {
    let about = "Kernels of all sizes in contrasting colours through each other, optical depths about 0.3: every mistake in the order shows as a wrong colour.";
    let camera = camera(DVec3::new(1.6, 1.2, -4.0), DVec3::Y, scale.side())?;
    let cloud = motley(scale.pick(8_000, 2_500))?;
    Ok(subject("clouds", about, vec![cloud], camera))
}

pub(super) fn surface(scale: Scale) -> Result<Subject, SubjectError> {
    let settings = IsoSettings { color: [0.75, 0.55, 0.3], ..IsoSettings::default() };
    let surface = iso_surfels(&marschner_lobb(scale.pick(120, 50))?, 0.5, &settings)?;
    let about = "An opaque iso-surface of the Marschner–Lobb signal: waves as fine as the grid can hold, one hiding the next.";
    let camera = camera(DVec3::new(1.4, -2.6, 2.4), DVec3::Z, scale.side())?;
    Ok(subject("surface", about, vec![surface], camera))
}

/// A trefoil, chequered.
fn knot(spacing: f64, size: f64) -> Result<Cloud, SubjectError> {
    const SIDE: usize = 256;
    let texels = (0..SIDE * SIDE).map(|i| match (i % SIDE * 4 / SIDE + i / SIDE * 4 / SIDE) % 2 {
        0 => [0xf2, 0xb1, 0x34, 0xff],
        _ => [0x60, 0x3a, 0x8a, 0xff],
    });
    let texture = Texture {
        width: SIDE,
        height: SIDE,
        texels: texels.collect(),
        wrap: [Wrap::Repeat; 2],
        filter: Filter::Linear,
    };
    let mut knot = primitives::torus_knot(2, 3, 0.17, [480, 48]);
    knot.material = BaseColor { texture: Some(Arc::new(texture)), ..BaseColor::default() };
    let cloud =
        sample(&Mesh { primitives: vec![knot] }, Density::Spacing(spacing), &SamplerSettings::default())?;
    let upright = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
    Ok(cloud.transformed(DAffine3::from_mat3(upright * size)))
}

pub(super) fn mixed(scale: Scale) -> Result<Subject, SubjectError> {
    let phantom = phantom(scale.pick(80, 36))?;
    let inner = IsoSettings { color: [0.6, 0.15, 0.1], ..IsoSettings::default() };
    let clouds = vec![
        classified(&phantom, SKULL)?,
        iso_surfels(&phantom, 0.3, &inner)?,
        knot(scale.pick(0.012, 0.03), 0.88)?,
    ];
    let about = "A mesh through a semi-transparent volume with an iso-surface in it: kernels are cut exactly where surfaces pass through them.";
    let camera = camera(DVec3::new(2.2, -3.2, 1.6), DVec3::Z, scale.side())?;
    Ok(subject("mixed", about, clouds, camera))
}

/// Sees what [`trained_splats`] makes; y is down.
fn trained_camera(side: u32) -> Result<Camera, CameraError> {
    let pose = Pose::look_at(DVec3::new(2.2, -2.2, -3.4), DVec3::new(0.0, -0.6, 0.0), -DVec3::Y)?;
    Camera::perspective(pose, 50f64.to_radians(), [side; 2])
}

pub(super) fn trained(scale: Scale) -> Result<Subject, SubjectError> {
    let splats = cloud(trained_splats(scale.pick(120_000, 25_000)));
    let about = "Gaussians as training makes them: flat, of all sizes, with harmonics of degree 3. They are defined by sorted compositing in display space, and so is R1.";
    let mut subject = subject("trained", about, vec![splats], trained_camera(scale.side())?);
    subject.settings.blend = Blend::Display;
    Ok(subject)
}

pub(super) fn staged(scale: Scale) -> Result<Subject, SubjectError> {
    let splats = cloud(trained_splats(scale.pick(1_500, 800)));
    let place = DAffine3::from_translation(DVec3::new(0.2, -1.0, 0.3));
    let ring = knot(scale.pick(0.015, 0.035), 0.8)?.transformed(place);
    let smoke = motley(scale.pick(400, 200))?;
    let masses = smoke.splats();
    let smoke = Cloud::new(Splats { colors: vec![[0.7, 0.75, 0.8]; masses.colors.len()], ..masses })?;
    let about = "Trained splats with a mesh through them and smoke around both: three kinds of strength in one order along every ray.";
    let clouds = vec![splats, ring, smoke.transformed(place)];
    Ok(subject("staged", about, clouds, trained_camera(scale.side())?))
}

pub(super) fn far(scale: Scale) -> Result<Subject, SubjectError> {
    // Dense, so that what is filtered matters: voxels of a sixth of a pixel.
    let volume = classified(&phantom(scale.pick(96, 48))?, HEAD_TRANSFER)?.with_levels();
    let figure = knot(scale.pick(0.012, 0.03), 0.5)?.with_levels();
    let mut clouds = Vec::new();
    let side = scale.pick(6, 3);
    for row in 0..side {
        for column in 0..side {
            let middle = f64::from(side - 1) / 2.0;
            let place = DVec3::new(f64::from(column) - middle, f64::from(row) - middle, 0.0)
                * DVec3::new(2.2, 2.6, 1.0);
            let source = if (row + column) % 2 == 0 { &figure } else { &volume };
            clouds.push(source.clone().transformed(DAffine3::from_translation(place)));
        }
    }
    let about = "A crowd of heads and chequered knots, each a few dozen pixels tall: splats are far smaller than pixels.";
    let camera = camera(DVec3::new(3.0, -26.0, 14.0), DVec3::Z, scale.side())?;
    Ok(subject("far", about, clouds, camera))
}
