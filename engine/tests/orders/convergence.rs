//! Slabs go to the integral as they get thinner, and are ahead of sorting long before.

use super::scenes::{looking_from, tilted};
use super::*;

/// What is left of the error where it is not the order's: the reference's steps and single precision.
const FLOOR: f64 = 2e-5;

fn view() -> Camera {
    looking_from(DVec3::new(2.5, 2.0, -4.5), 32)
}

/// Mean errors against R1 of sorted centres and of slabs so thick.
fn errors(clouds: &[Cloud], camera: &Camera, thicknesses: &[f64]) -> (f64, Vec<f64>) {
    let r1 = truth(clouds, camera, &nothing_but(SLABS));
    let error = |order| apart(&draw(clouds.to_vec(), camera, &nothing_but(order)), &r1).mean_error;
    (
        error(Order::Centers),
        thicknesses.iter().map(|thickness| error(Order::Slabs { thickness: *thickness })).collect(),
    )
}

fn listed(errors: &[f64]) -> String {
    errors.iter().map(|error| format!("{error:.2e} ")).collect()
}

#[test]
fn slabs_of_a_smooth_volume_converge_with_the_square_of_their_thickness() {
    let clouds = [haze(14, 0.16, 3.0)];
    let thicknesses = [2.0, 1.0, 0.5];
    let (_, found) = errors(&clouds, &view(), &thicknesses);
    println!("slabs of {thicknesses:?} {}", listed(&found));
    assert!(found[0] > 4.0 * FLOOR, "nothing is left to fall");
    assert!(found.windows(2).all(|pair| pair[1] <= pair[0] / 4.0 + FLOOR), "{found:?}");
}

#[test]
fn slabs_of_a_smooth_volume_are_ahead_of_sorted_centers() {
    for extinction in [1.0, 10.0] {
        let clouds = [haze(14, 0.16, extinction)];
        let thicknesses = [2.45, 2.0, 1.5, 1.0];
        let (centers, found) = errors(&clouds, &view(), &thicknesses);
        println!(
            "extinction {extinction}: centers {centers:.2e}, slabs of {thicknesses:?} {}",
            listed(&found)
        );
        for (bound, error) in [0.7, 1.0 / 8.0, 1.0 / 40.0, 1.0 / 50.0].into_iter().zip(found) {
            assert!(error <= bound * centers, "{error} is not {bound} of {centers}");
        }
    }
}

#[test]
fn slabs_of_any_thickness_up_to_two_are_the_integral() {
    // As anyone draws them, in either form of the footprint: a kernel lies in one slab or in sixty.
    let clouds = [haze(8, 0.25, 1.0).transformed(tilted(10.0, DVec3::new(0.123, 0.057, 0.0)))];
    let camera = looking_from(DVec3::new(1.0, 2.0, -20.0), 24);
    let r1 = truth(&clouds, &camera, &ordered(SLABS));
    let mut wrong = Vec::new();
    for thickness in [0.1, 0.2, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.8, 1.0, 1.3, 1.5, 1.6, 2.0] {
        for footprint in [FootprintForm::Affine, FootprintForm::Auto, FootprintForm::Exact] {
            let settings = RenderSettings { footprint, ..ordered(Order::Slabs { thickness }) };
            let found = apart(&draw(clouds.to_vec(), &camera, &settings), &r1).max_error;
            println!("slabs of {thickness}, {footprint:?}: {found:.5}");
            if found > LEVEL {
                wrong.push(format!("{thickness}, {footprint:?}: {found:.4}"));
            }
        }
    }
    assert!(wrong.is_empty(), "slabs of {wrong:?}");
}

/// Extinction kernels of all sizes in a ball. A ray passes about forty, with an optical depth of 5 in all.
fn mixed_sizes() -> Cloud {
    let indices = 0..2000;
    let mass = |i: usize| mass_of(0.05 + 0.15 * spread(i, 0.414_214), any_shape(i));
    splats(
        indices.clone().map(in_ball).collect(),
        indices.clone().map(any_shape).collect(),
        Strength::Extinction { masses: indices.clone().map(mass).collect() },
        indices.map(any_color).collect(),
    )
}

#[test]
fn slabs_are_ahead_for_kernels_of_all_sizes() {
    let motley = mixed_sizes();
    let alike = painted(&motley, |p| shades(p * 3.0));
    for (name, cloud, least) in [("neighbours alike", alike, 10.0), ("motley", motley, 10.0)] {
        let thicknesses = [2.45, 2.0, 1.0, 0.5];
        let (centers, found) = errors(&[cloud], &view(), &thicknesses);
        println!("{name}: centers {centers:.2e}, slabs of {thicknesses:?} {}", listed(&found));
        assert!(found[1] <= centers / least, "{name}: {centers} is not {least} times {}", found[1]);
    }
}
