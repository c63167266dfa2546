//! A point has the energy of its splat, wherever between pixels it lies.

use super::*;
use oblate_engine::Pose;

/// Sees a square of 16 pixels, one a unit, along parallel rays.
fn parallel() -> Camera {
    let pose = Pose::look_at(DVec3::new(0.0, 0.0, -10.0), DVec3::ZERO, DVec3::Y).unwrap();
    Camera::orthographic(pose, 16.0, [16; 2]).unwrap()
}

/// The sum of all opacities, of one splat with these half-axes, in pixels, and a peak so small that opacities are what they are
/// of, at an offset between pixels.
fn energy(kind: Kind, factor: Mat3, offset: [f64; 2], order: Order) -> f64 {
    let center = DVec3::new(offset[0], offset[1], 0.0).as_vec3();
    let peak = 1e-4 / factor.x_axis.length().min(1.0).powi(2);
    let cloud = cloud(kind, &[(center, factor)], peak.min(0.9), vec![[1.0; 3]]);
    // Opacities end where they fall below the tolerance.
    let settings = RenderSettings { tolerance: 1e-9, ..drawn_as(FootprintForm::Point, order) };
    let (frame, forms) = draw(&[cloud], &parallel(), &settings);
    assert_eq!(forms, [1, 0, 0]);
    let sum: f64 = frame.color.iter().map(|pixel| f64::from(pixel[3])).sum();
    sum / f64::from(peak.min(0.9))
        / f64::from(std::f32::consts::TAU * factor.x_axis.length() * factor.y_axis.length())
}

#[test]
fn a_point_keeps_its_energy_between_pixels() {
    // Summed over pixel centres a Gaussian of variance V ripples by 4 e^{−2π²V}: 1.1 % at 0.3 px². Its mean over all offsets is its
    // integral. Opacities are not raised by what is cut off, e^{−ρ/2}.
    let sizes = [0.01, 0.1, 0.5, 1.0_f32];
    for kind in [Kind::Extinction, Kind::Opacity(OpacityFilter::Compensated), Kind::Surface] {
        for order in ORDERS {
            for size in sizes {
                let kept = if let Kind::Opacity(_) = kind { 1.0 - (-12.25 / 2.0_f64).exp() } else { 1.0 };
                let factor = Mat3::from_diagonal(Vec3::new(size, 0.6 * size, 0.1 * size));
                let (mut sum, mut worst) = (0.0, 0.0_f64);
                for i in 0..64 {
                    let offset = [i % 8, i / 8].map(|k| f64::from(k) / 8.0 + 0.03);
                    let found = energy(kind, factor, offset, order) / kept;
                    worst = worst.max((found - 1.0).abs());
                    sum += found / 64.0;
                }
                println!("{kind:?}, {order:?}, {size} px: mean off by {:.1e}, worst {worst:.1e}", sum - 1.0);
                assert!(worst <= 0.011, "{kind:?}, {order:?}, {size} px: {worst}");
                assert!((sum - 1.0).abs() <= 1e-3, "{kind:?}, {order:?}, {size} px: {sum}");
            }
        }
    }
}

#[test]
fn a_classic_point_has_the_energy_of_its_splat() {
    // The classic filter widens a splat and keeps its peak: its energy is what the splat's affine form has.
    let kind = Kind::Opacity(OpacityFilter::Classic);
    for size in [0.1, 1.0_f32] {
        let factor = Mat3::from_diagonal(Vec3::new(size, 0.3 * size, 0.1));
        let cloud = cloud(kind, &[(Vec3::new(0.2, 0.3, 0.0), factor)], 1e-3, vec![[1.0; 3]]);
        let sum = |footprint| {
            let settings = RenderSettings { tolerance: 1e-9, ..drawn_as(footprint, Order::Centers) };
            let (frame, _) = draw(std::slice::from_ref(&cloud), &parallel(), &settings);
            frame.color.iter().map(|pixel| f64::from(pixel[3])).sum::<f64>()
        };
        let ratio = sum(FootprintForm::Point) / sum(FootprintForm::Affine);
        // Both ripple by the filter's share.
        assert!((ratio - 1.0).abs() <= 0.012, "{size} px: {ratio}");
    }
}
