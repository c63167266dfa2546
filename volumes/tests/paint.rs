//! A cloud in the colours of a second volume.

use glam::{DAffine3, DMat3, DVec3};
use oblate_volumes::{
    ColorSpace, ControlPoint, GridFrame, IsoSettings, StrengthKind, TransferFunction, Volume, Voxels,
    iso_surfels, painted,
};

/// Values of the field are x in the world, which the function makes red from 0 to 10: a surfel's red is its x / 10, wherever cloud and
/// field stand, up to f32's rounding.
#[test]
fn colours_are_those_of_the_field_at_the_place() {
    let ball = |i: usize| {
        let p = DVec3::new((i % 12) as f64, (i / 12 % 12) as f64, (i / 144) as f64);
        (5.0 - (p - DVec3::splat(5.5)).length()) as f32
    };
    let ball =
        Volume::new([12; 3], Voxels::F32((0..1728).map(ball).collect()), GridFrame::default()).unwrap();
    let settings = IsoSettings { color: [0.25, 0.5, 0.75], ..IsoSettings::default() };
    let moved = DAffine3::from_translation(DVec3::new(1.0, 0.5, -2.0));
    let cloud = iso_surfels(&ball, 1.0, &settings).unwrap().transformed(moved);
    // Turned and stretched, and it ends at x = 8.
    let direction = DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z);
    let frame = GridFrame {
        spacing: DVec3::new(2.0, 1.0, 2.0),
        origin: DVec3::new(0.0, -4.0, -6.0),
        direction,
        space: None,
    };
    let x = |i: usize| (i / 12 % 9) as f32;
    let field = Volume::new([12, 9, 12], Voxels::F32((0..12 * 9 * 12).map(x).collect()), frame).unwrap();
    let point = |value, red| ControlPoint { value, color: [red, 0.0, 1.0], strength: 0.0 };
    let points = vec![point(0.0, 0.0), point(10.0, 1.0)];
    let transfer = TransferFunction::new(points, StrengthKind::Extinction, ColorSpace::Linear).unwrap();
    let painted = painted(&cloud, &field, &transfer).unwrap();
    let (before, after) = (cloud.splats(), painted.splats());
    assert_eq!((&before.centers, &before.strength), (&after.centers, &after.strength));
    let mut inside = 0;
    for (center, color) in after.centers.iter().zip(&after.colors) {
        let x = cloud.cloud_to_world().transform_point3(center.as_dvec3()).x;
        if x <= 8.0 {
            inside += 1;
            assert!((f64::from(color[0]) - x / 10.0).abs() < 1e-6, "{color:?} at {x}");
            assert_eq!(color[1..], [0.0, 1.0]);
        } else {
            assert_eq!(*color, settings.color);
        }
    }
    assert!(inside > 100 && inside + 20 < after.centers.len(), "{inside} of {}", after.centers.len());
}
