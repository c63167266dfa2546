//! Where points stand for splats by themselves, and what that changes.

use super::*;
use glam::{DMat3, DVec2};
use oblate_engine::footprint::{CameraSplat, Footprint, Lens};
use oblate_engine::{Pose, Projection};

/// ∫|w − w_round| / ∫w over the picture, by sums over a fine grid.
fn difference(footprint: &Footprint) -> f64 {
    let round = footprint.round();
    let width = 8.0 / round.conic_root[0];
    let (count, mut sum, mut all) = (160, 0.0, 0.0);
    for i in 0..count * count {
        let place = [i % count, i / count].map(|k| ((k as f64 + 0.5) / count as f64 * 2.0 - 1.0) * width);
        let of = |f: &Footprint| f.unit_integral * (-0.5 * f.q(DVec2::from(place))).exp();
        sum += (of(footprint) - of(&round)).abs();
        all += of(footprint);
    }
    sum / all
}

#[test]
fn the_estimate_bounds_what_roundness_changes() {
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let lens = Lens {
            focal: DVec2::splat(500.0),
            principal: DVec2::splat(200.0),
            projection,
            filter_sigma: 0.3f64.sqrt(),
        };
        for size in [0.01, 0.03, 0.1, 0.3, 1.0, 3.0] {
            for index in 0..40 {
                let width =
                    size * if projection == Projection::Perspective { 10.0 / 500.0 } else { 1.0 / 500.0 };
                // From needles and discs to balls.
                let axes = [1.0, spread(index, 0.618_034), spread(index, 0.754_878)];
                let factor = turned(index).as_dmat3() * DMat3::from_diagonal(DVec3::from(axes) * width);
                let center = DVec3::new(1.0, -0.5, 10.0);
                let footprint = Footprint::new(&CameraSplat { center, factor }, &lens).unwrap();
                let (found, estimate) = (difference(&footprint), footprint.roundness_error());
                // The bound is sharp where it is small; sums over the grid are right to 1e-3 of themselves.
                assert!(
                    found <= estimate * 1.001 + 1e-9,
                    "{size} px, splat {index}: {found} over {estimate}"
                );
                assert!(
                    estimate > 0.2 || estimate <= found * 1.1 + 1e-6,
                    "{size} px, splat {index}: {found}, estimate {estimate}"
                );
            }
        }
    }
}

/// A field of splats of mixed sizes, from a hundredth of a pixel to three: balls and others, or discs and ellipses.
fn field(kind: Kind, count: usize, peak: f32) -> Cloud {
    let splats: Vec<_> = (0..count)
        .map(|index| {
            let size = (0.01 * 300f64.powf(spread(index, 0.819_173))) as f32 * PIXEL;
            let own = Vec3::new(1.0, 1.0 - 0.9 * spread(index, 0.31) as f32, spread(index, 0.47) as f32);
            let axes = if index % 2 == 0 { Vec3::ONE } else { own };
            let flat = if kind == Kind::Surface { Vec3::new(1.0, 1.0, 0.0) } else { Vec3::ONE };
            (place(index).as_vec3(), turned(index) * Mat3::from_diagonal(axes * flat * size))
        })
        .collect();
    cloud(kind, &splats, peak, (0..count).map(color).collect())
}

/// The side of a pixel in the middle of the picture.
const PIXEL: f32 = 0.04;

/// A unit vector.
const TO_EYE: DVec3 = DVec3::new(0.3, 0.2, -0.932_737_9);

/// Looks at the origin from a distance.
fn camera(projection: Projection, distance: f64) -> Camera {
    let pose = Pose::look_at(TO_EYE * distance, DVec3::ZERO, DVec3::Y).unwrap();
    let half = 32.0 * f64::from(PIXEL);
    match projection {
        Projection::Perspective => Camera::perspective(pose, 2.0 * (half / distance).atan(), [64; 2]),
        Projection::Orthographic => Camera::orthographic(pose, 2.0 * half, [64; 2]),
    }
    .unwrap()
}

#[test]
fn points_are_within_the_share_of_the_tolerance() {
    // Each point's optical depth, or coverage, is right to a quarter of the tolerance of its energy. Spread over the pixels its error is at
    // most π²/8 = 1.24 times as large a share of its peak, 0.37 ε for 0.64 ε; so is the pixel's, of what is seen of it.
    for tolerance in [1.0 / 255.0, 8.0 / 255.0] {
        for kind in KINDS {
            for projection in [Projection::Perspective, Projection::Orthographic] {
                for order in ORDERS {
                    let clouds = [field(kind, 4000, 0.3)];
                    let [(auto, forms), (affine, none)] =
                        [FootprintForm::Auto, FootprintForm::Affine].map(|form| {
                            let settings = RenderSettings { tolerance, ..drawn_as(form, order) };
                            draw(&clouds, &camera(projection, 400.0), &settings)
                        });
                    let difference = apart(&auto, &affine);
                    println!(
                        "{tolerance:.4}, {kind:?}, {projection:?}, {order:?}: {forms:?}, {difference:.1e}"
                    );
                    // So far away that perspective bends no splat.
                    assert_eq!([none[0], none[2], forms[2]], [0; 3], "affine is what is asked for");
                    // That order goes by slopes of depths, which points don't have.
                    let has_points = kind == Kind::Surface || order != Order::PerPixel;
                    let points_expected = if has_points { 100..4000 } else { 0..1 };
                    assert!(points_expected.contains(&forms[0]), "{kind:?}, {order:?}: {forms:?}");
                    // Opacities end where they fall below the tolerance: one that ends in a pixel is that much.
                    let of_ends = if let Kind::Opacity(_) = kind { tolerance } else { 0.0 };
                    assert!(
                        difference <= tolerance / 4.0 + of_ends,
                        "{kind:?}, {projection:?}, {order:?}: {difference}"
                    );
                }
            }
        }
    }
}

#[test]
fn forms_are_what_is_asked_for() {
    let clouds = KINDS.map(|kind| field(kind, 500, 0.2));
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let forms =
            |footprint| draw(&clouds, &camera(projection, 10.0), &drawn_as(footprint, Order::Centers)).1;
        assert_eq!(forms(FootprintForm::Point)[1..], [0, 0]);
        assert_eq!(forms(FootprintForm::Exact)[0], 0);
        assert_eq!(forms(FootprintForm::Affine)[0], 0);
        let auto = forms(FootprintForm::Auto);
        // Their sum is what is drawn, whatever the form.
        assert!(
            auto.iter().sum::<u64>().abs_diff(forms(FootprintForm::Affine).iter().sum()) <= 2,
            "{auto:?}"
        );
    }
}

#[test]
fn a_splat_at_the_camera_plane_is_no_point() {
    let near = cloud(
        Kind::Extinction,
        &[((TO_EYE * 10.0).as_vec3() + Vec3::Z * 0.3, Mat3::from_diagonal(Vec3::splat(0.5)))],
        0.5,
        vec![[1.0; 3]],
    );
    let camera = camera(Projection::Perspective, 10.0);
    let (_, forms) = draw(&[near], &camera, &drawn_as(FootprintForm::Point, Order::Centers));
    assert_eq!(forms, [0, 0, 1]);
}

#[test]
fn forms_have_their_colours() {
    // A small splat, a large one aslant, and one so near that perspective bends it: red, green, blue.
    let camera = camera(Projection::Perspective, 10.0);
    let shapes = [
        Mat3::from_diagonal(Vec3::splat(0.01 * PIXEL)),
        Mat3::from_diagonal(Vec3::new(0.9, 0.3, 0.02) * PIXEL),
        Mat3::from_diagonal(Vec3::new(0.5, 2.0, 1.0)),
    ];
    for (form, shape) in shapes.into_iter().enumerate() {
        for kind in [Kind::Extinction, Kind::Surface] {
            let cloud = cloud(kind, &[(Vec3::ZERO, shape)], 0.5, vec![[0.3, 0.6, 0.9]]);
            let settings = RenderSettings {
                color_by_form: true,
                shade: true,
                tolerance: 8.0 / 255.0,
                ..drawn_as(FootprintForm::Auto, Order::Centers)
            };
            let (frame, forms) = draw(&[cloud], &camera, &settings);
            assert_eq!(forms[form], 1, "{kind:?}: {forms:?}");
            let pixel = frame.color.iter().copied().max_by(|a, b| a[3].total_cmp(&b[3])).unwrap();
            for channel in 0..3 {
                let expected = if channel == form { pixel[3] } else { 0.0 };
                assert!((pixel[channel] - expected).abs() <= 1e-6, "{kind:?}, form {form}: {pixel:?}");
            }
        }
    }
}
