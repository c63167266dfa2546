//! Scanned volumes from all around: where a ray meets the surface, the picture of its surfels is opaque.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use common::*;
use glam::DVec3;
use oblate_engine::{Camera, Pose, RenderSettings, Renderer, Scene};
use oblate_volumes::{GridFrame, IsoSettings, Volume, Voxels, iso_surfels};
use rayon::prelude::*;

const SIDE: usize = 40;
/// Rays along a side of the picture, and of three pixels.
const RAYS: usize = 4 * SIDE;
const RAYS_AROUND: usize = 3 * RAYS / SIDE;
/// Vertical angle of view.
const ANGLE: f64 = 0.5;

fn real_cube(name: &str) -> Option<Volume> {
    let bytes = real_bytes(name)?;
    Some(Volume::new([256; 3], Voxels::U8(bytes), GridFrame::default()).unwrap())
}

/// The 26 directions along axes and diagonals.
fn directions() -> impl Iterator<Item = DVec3> {
    let all = (0..27).map(|i| DVec3::new((i % 3) as f64, (i / 3 % 3) as f64, (i / 9) as f64) - 1.0);
    all.filter(|d| *d != DVec3::ZERO).map(DVec3::normalize)
}

/// Whether a ray through a volume comes from outside to inside.
fn is_met(volume: &Volume, iso: f32, (from, along): (DVec3, DVec3)) -> bool {
    let (frame, dims) = (volume.frame(), volume.dims());
    let extent = frame.spacing * DVec3::from(dims.map(|d| (d - 1) as f64));
    let (a, b) = ((frame.origin - from) / along, (frame.origin + extent - from) / along);
    let (near, far) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
    let mut was_outside = false;
    let mut t = near;
    while t < far {
        let inside =
            volume.sample((from + along * t - frame.origin) / frame.spacing).is_some_and(|v| v >= iso);
        if inside && was_outside {
            return true;
        }
        was_outside = !inside;
        t += 1.0;
    }
    false
}

/// Looks at a volume from all directions, from afar and near by turns.
fn look(name: &str, volume: &Volume, iso: f32) {
    let frame = volume.frame();
    let extent = frame.spacing * DVec3::from(volume.dims().map(|d| (d - 1) as f64));
    let center = frame.origin + extent * 0.5;
    let scene = Scene {
        clouds: vec![iso_surfels(volume, iso, &IsoSettings::default()).unwrap()],
        lights: Vec::new(),
    };
    let settings = RenderSettings { background: [0.0; 4], ..RenderSettings::default() };
    let mut renderer = Renderer::new();
    let (mut least, mut seen, mut faint) = (1.0_f32, 0, 0);
    for (number, direction) in directions().enumerate() {
        let zoom = [0.25, 1.0, 2.0, 8.0][number % 4];
        let eye = center + direction * extent.length() * 1.1 / (ANGLE / 2.0).tan() / 2.0;
        let up = if direction.z.abs() > 0.9 { DVec3::Y } else { DVec3::Z };
        let angle = 2.0 * ((ANGLE / 2.0).tan() / zoom).atan();
        let pose = Pose::look_at(eye, center, up).unwrap();
        let camera = Camera::perspective(pose, angle, [SIDE as u32; 2]).unwrap();
        let picture = renderer.render(&scene, &camera, &settings, &()).unwrap();
        let forward = -direction;
        let right = forward.cross(up).normalize();
        let down = forward.cross(right);
        let ray = |i: usize, j: usize| {
            let [x, y] = [i, j].map(|p| ((p as f64 + 0.5) / RAYS as f64 * 2.0 - 1.0) * (angle / 2.0).tan());
            (eye, (forward + right * x + down * y).normalize())
        };
        let met: Vec<bool> = (0..RAYS * RAYS)
            .into_par_iter()
            .map(|ray_number| is_met(volume, iso, ray(ray_number % RAYS, ray_number / RAYS)))
            .collect();
        for j in 1..SIDE - 1 {
            for i in 1..SIDE - 1 {
                // Silhouettes fade over a pixel or two, and those of gaps between rays do, too.
                let around = (0..RAYS_AROUND * RAYS_AROUND).map(|n| [n % RAYS_AROUND, n / RAYS_AROUND]);
                let is_inner = around
                    .map(|[x, y]| [(i - 1) * RAYS / SIDE + x, (j - 1) * RAYS / SIDE + y])
                    .all(|[x, y]| met[y * RAYS + x]);
                if is_inner {
                    seen += 1;
                    let alpha = picture.color[j * SIDE + i][3];
                    if alpha < 0.98 {
                        faint += 1;
                        println!("{name}: {alpha} at {i}, {j} from {direction} at {zoom}");
                    }
                    least = least.min(alpha);
                }
            }
        }
    }
    println!("{name}: {seen} pixels, {faint} of them fainter than 0.98, least alpha {least}");
    // Where a surface bends within the pixel's filter its surfels cover less than those of a plane, and the floor, which the filter raises, does not
    // make up for all of it.
    assert!(seen > 1000 && least > 0.95 && 1000 * faint <= seen, "{name}: {least}, {faint}");
}

#[test]
fn engine() {
    let Some(volume) = real_engine() else { return };
    look("engine", &volume, 100.0);
}

#[test]
fn head() {
    let Some(volume) = real_head() else { return };
    look("head", &volume, 500.0);
}

#[test]
fn bonsai() {
    let Some(volume) = real_cube("bonsai_256x256x256_uint8.raw.gz") else { return };
    look("bonsai", &volume, 40.0);
}

#[test]
fn thin_vessels() {
    let Some(volume) = real_cube("aneurism_256x256x256_uint8.raw.gz") else { return };
    look("aneurism", &volume, 80.0);
}
