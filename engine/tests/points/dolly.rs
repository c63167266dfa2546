//! Nothing flickers where splats become points: a slow dolly changes the picture as it does without points.

use super::scenes::{fog, looking_from, plane};
use super::*;

/// The largest changes of a channel from frame to frame of a dolly away from the origin, by 4 % a frame; and how many frames show points and
/// others side by side.
fn steps(cloud: &Cloud, footprint: FootprintForm, order: Order) -> (Vec<f64>, usize) {
    let mut mixed = 0;
    let frames: Vec<Frame> = (0..60)
        .map(|step| {
            let distance = 8.0 * 1.04f64.powi(step);
            let eye = DVec3::new(0.3, 0.4, -1.0).normalize() * distance;
            let (frame, forms) =
                draw(std::slice::from_ref(cloud), &looking_from(eye, 48), &drawn_as(footprint, order));
            mixed += usize::from(forms[0] > 0 && forms[1] + forms[2] > 0);
            frame
        })
        .collect();
    (frames.windows(2).map(|pair| apart(&pair[0], &pair[1])).collect(), mixed)
}

#[test]
fn nothing_steps_where_splats_become_points() {
    let mist = fog([20; 3], DVec3::splat(0.1), 0.8, [0.9, 0.5, 0.2]);
    let sheet = plane(40, 0.06, [0.2, 0.9, 0.5]);
    for (name, cloud) in [("mist", mist), ("sheet", sheet)] {
        for order in ORDERS {
            let (auto, mixed) = steps(&cloud, FootprintForm::Auto, order);
            let (affine, _) = steps(&cloud, FootprintForm::Affine, order);
            let is_by_slopes = name == "mist" && order == Order::PerPixel;
            assert!(mixed >= 1 || is_by_slopes, "{name}, {order:?}: no frame shows both");
            // Two frames that are each within a quarter of the tolerance.
            for (frame, (auto, affine)) in auto.iter().zip(&affine).enumerate() {
                assert!(
                    *auto <= affine * 2.0 && *auto <= affine + 2.0 / 4.0 / 255.0,
                    "{name}, {order:?}, frame {frame}: {auto}, affine {affine}"
                );
            }
            let largest = |steps: &[f64]| steps.iter().copied().fold(0.0, f64::max);
            println!(
                "{name}, {order:?}: {:.4}, affine {:.4}, {mixed} mixed",
                largest(&auto),
                largest(&affine)
            );
        }
    }
}
