//! Lists of volumes that end behind cuts.

use crate::in_order;
use crate::scenes::*;
use glam::{DAffine3, DVec3};
use oblate_engine::simd::Level;
use oblate_engine::{Camera, Cloud, Order, Pose, RenderSettings, Scene, Shapes, Splats, Strength};
use oblate_engine::{Renderer, Surface};

/// Fog of small kernels around a slanted sheet, seen at a wide angle, so that rays of a tile and of another differ in length.
const SPACING: f64 = 0.05;
const PLACE: DVec3 = DVec3::new(0.0, 0.0, 3.8);
const SLANT: f64 = 25.0;

/// A kernel's own reach, and what the filter, and edges between pixels, add along the sheet's slant.
const HIDDEN: f64 = 0.3;

/// Half as wide as fog's: of kernels that reach farther than a tenth of their depth nothing is known.
fn haze() -> Cloud {
    let mut splats = fog([128, 64, 32], DVec3::splat(SPACING), 0.6, [0.2, 0.6, 0.9]).splats();
    if let Shapes::Shared(factor) = &mut splats.shapes {
        *factor *= 0.5;
    }
    in_order(&Cloud::new(splats).unwrap()).transformed(DAffine3::from_translation(PLACE))
}

/// Those kernels that are not far behind the sheet.
fn seen(haze: &Cloud, sheet: DAffine3) -> Cloud {
    let splats = haze.splats();
    let is_seen = |center: &DVec3| {
        let place = sheet.inverse().transform_point3(haze.cloud_to_world().transform_point3(*center));
        place.z < HIDDEN
    };
    let centers: Vec<_> = splats.centers.iter().copied().filter(|c| is_seen(&c.as_dvec3())).collect();
    let (Shapes::Shared(factor), Strength::Extinction { masses }) = (splats.shapes, splats.strength) else {
        panic!("fog is of equal kernels");
    };
    kernels(centers, factor, masses[0], splats.colors[0]).transformed(haze.cloud_to_world())
}

/// A sheet with an opacity.
fn sheet(opacity: f32) -> Cloud {
    let mut splats: Splats = plane(240, 0.05, [0.9, 0.5, 0.1]).splats();
    if let Strength::Surface(Surface { opacities, areas, .. }) = &mut splats.strength {
        *opacities = (opacity < 1.0).then(|| vec![opacity; areas.len()]);
    }
    in_order(&Cloud::new(splats).unwrap())
}

/// What lies behind an opaque sheet could as well not be there. Both pictures add the same kernels in the same order, with other
/// ends of batches: they differ by rounding, of up to a hundred terms and of places in other clusters.
#[test]
fn what_is_behind_a_sheet_could_be_missing() {
    let pose = Pose::look_at(DVec3::ZERO, DVec3::Z, DVec3::Y).unwrap();
    let camera = Camera::perspective(pose, 80f64.to_radians(), [192, 128]).unwrap();
    let placed = tilted(SLANT, PLACE);
    // A translucent one before it makes segments that both see the fog.
    let before = tilted(SLANT, PLACE - 0.3 * DVec3::Z);
    let (whole, part) = (haze(), seen(&haze(), placed));
    assert!(4 * part.len() < 3 * whole.len(), "{} of {}", part.len(), whole.len());
    let sheets = [sheet(1.0).transformed(placed), sheet(0.4).transformed(before)];
    for order in [Order::Centers, Order::PerPixel, Order::Slabs { thickness: 2.0 }] {
        for side in [8, 16, 32] {
            let settings = RenderSettings { order, occlusion: false, ..unshaded() };
            let picture = |fog: &Cloud| {
                let [opaque, translucent] = sheets.clone();
                let scene = Scene { clouds: vec![fog.clone(), opaque, translucent], lights: Vec::new() };
                let mut renderer = Renderer::with(Level::best(), side);
                renderer.render(&scene, &camera, &settings, &()).unwrap().clone()
            };
            let (expected, found) = (picture(&part), picture(&whole));
            for (place, (expected, found)) in expected.color.iter().zip(&found.color).enumerate() {
                let off = expected.iter().zip(found).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(off <= 1e-4, "{order:?}, tiles of {side}: {off} at {}, {}", place % 192, place / 192);
            }
        }
    }
}
