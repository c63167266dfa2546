//! Scanned volumes from all around: where a ray meets the surface, the picture of its surfels is opaque.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use common::*;
use glam::DVec3;
use oblate_engine::{Camera, Pose, RenderSettings, Renderer, Scene};
use oblate_volumes::{GridFrame, IsoSettings, Volume, Voxels, iso_surfels};

const SIDE: usize = 40;
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

/// Rays along a side of the three by three pixels around one that is fainter than it should be.
const FINE: usize = 31;

/// The least opacity where a surface is met.
const OPAQUE: f32 = 0.98;

/// Looks at a volume from all directions, from afar and near by turns: how many pixels are fainter than [`OPAQUE`].
fn faint(name: &str, volume: &Volume, iso: f32) -> usize {
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
        let ray = |i: f64, j: f64| {
            let [x, y] = [i, j].map(|p| ((p + 0.5) / SIDE as f64 * 2.0 - 1.0) * (angle / 2.0).tan());
            (eye, (forward + right * x + down * y).normalize())
        };
        // Gaps between thin vessels, and their edges, pass between the rays of pixels.
        let is_covered = |pixel: [usize; 2]| {
            let mut around = (0..FINE * FINE)
                .map(|n| [n % FINE, n / FINE].map(|k| 3.0 * (k as f64 + 0.5) / FINE as f64 - 1.5));
            around.all(|[x, y]| is_met(volume, iso, ray(pixel[0] as f64 + x, pixel[1] as f64 + y)))
        };
        let met: Vec<bool> = (0..SIDE * SIDE)
            .map(|p| is_met(volume, iso, ray((p % SIDE) as f64, (p / SIDE) as f64)))
            .collect();
        for j in 1..SIDE - 1 {
            for i in 1..SIDE - 1 {
                // Silhouettes fade over a pixel or two.
                let is_inner = (0..9).all(|n| met[(j + n / 3 - 1) * SIDE + i + n % 3 - 1]);
                if is_inner {
                    seen += 1;
                    let alpha = picture.color[j * SIDE + i][3];
                    least = least.min(alpha);
                    faint += usize::from(alpha <= OPAQUE && is_covered([i, j]));
                }
            }
        }
    }
    println!("{name}: {seen} pixels, {faint} of them faint, least alpha {least}");
    assert!(seen > 1000, "{name}: {seen}");
    faint
}

#[test]
fn engine() {
    let Some(volume) = real_engine() else { return };
    assert_eq!(faint("engine", &volume, 100.0), 0);
}

#[test]
fn head() {
    let Some(volume) = real_head() else { return };
    assert_eq!(faint("head", &volume, 500.0), 0);
}

#[test]
fn bonsai() {
    let Some(volume) = real_cube("bonsai_256x256x256_uint8.raw.gz") else { return };
    assert_eq!(faint("bonsai", &volume, 40.0), 0);
}

#[test]
fn thin_vessels() {
    let Some(volume) = real_cube("aneurism_256x256x256_uint8.raw.gz") else { return };
    assert_eq!(faint("aneurism", &volume, 80.0), 0);
}
