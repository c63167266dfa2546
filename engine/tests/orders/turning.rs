//! Nothing pops: what turns changes as smoothly as the integral does.

use super::scenes::{camera, looking_from};
use super::*;
use glam::{DAffine3, DMat3};
use oblate_engine::Pose;

/// The largest change of a channel from one frame to the next, over all of them.
fn largest_step(frames: &[Frame]) -> f64 {
    frames.windows(2).map(|pair| apart(&pair[0], &pair[1]).max_error).fold(0.0, f64::max)
}

/// Turns a cloud by 90° about an upright line in steps of 0.05°. Sorted centres pop; `orders` may change by two levels
/// more than R1.
fn check(name: &str, cloud: &Cloud, orders: &[Order]) {
    let view = camera(5.0, 16);
    let frames = |frame: &dyn Fn(Cloud) -> Frame| -> Vec<Frame> {
        let angles = (-900..=900).map(|step| (0.05 * f64::from(step)).to_radians());
        // Askew, so that nothing is symmetric.
        let turn = |angle| DMat3::from_rotation_x(0.3) * DMat3::from_rotation_y(angle);
        angles.map(|angle| frame(cloud.clone().transformed(DAffine3::from_mat3(turn(angle))))).collect()
    };
    let least = largest_step(&frames(&|cloud| truth(&[cloud], &view, &ordered(SLABS))));
    for order in GENERAL {
        let found = largest_step(&frames(&|cloud| draw(vec![cloud], &view, &ordered(order))));
        println!("{name}, {order:?}: largest step {found:.5}, R1's {least:.5}");
        assert!(order != Order::Centers || found > least + 10.0 * LEVEL, "{name}: sorted centres don't pop");
        let is_bound = orders.contains(&order);
        assert!(!is_bound || found <= least + 2.0 * LEVEL, "{name}, {order:?}: {found}, R1's {least}");
    }
}

/// Three kernels in red, green and blue, with an optical depth of 1 across their third axis.
fn three(centers: [Vec3; 3], factor: impl Fn(usize) -> Mat3) -> Cloud {
    let factors: Vec<Mat3> = (0..3).map(factor).collect();
    let masses = factors.iter().map(|factor| mass_of(1.0, *factor)).collect();
    let colors = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    splats(centers.to_vec(), factors, Strength::Extinction { masses }, colors)
}

#[test]
fn elongated_splats_that_interpenetrate_turn_without_a_jump_in_slabs() {
    // A star: all middles are at one depth when it faces the camera. Sorting, by whatever depth, jumps at the pixels
    // where the depths of two such kernels cross.
    let star = three([-0.2, 0.0, 0.2].map(|x| Vec3::X * x), |i| {
        let angle = i as f32 * std::f32::consts::PI / 3.0;
        Mat3::from_rotation_z(angle) * Mat3::from_diagonal(Vec3::new(0.45, 0.12, 0.12))
    });
    check("star", &star, &[SLABS]);
}

#[test]
fn elongated_splats_side_by_side_turn_without_a_jump() {
    // Slats of a blind, 4.3 of their thicknesses one behind the other. Which is in front is the same for all views,
    // but which middle is nearer changes at 15°, when all are at one depth.
    let along = Mat3::from_rotation_y(75_f32.to_radians()) * Vec3::Z * 0.5;
    let slats = three([-along, Vec3::ZERO, along], |_| Mat3::from_diagonal(Vec3::new(0.2, 0.45, 0.03)));
    check("slats", &slats, &[Order::PerPixel, SLABS]);
}

#[test]
fn a_camera_that_turns_in_place_changes_no_order_of_centers() {
    // The first is nearer by 1 % of the distance; which has the smaller depth changes as the camera turns.
    let place =
        |degrees: f32, distance: f32| Mat3::from_rotation_y(degrees.to_radians()) * Vec3::Z * distance;
    let centers = vec![place(-8.0, 5.0), place(8.0, 5.05)];
    let strength = Strength::Opacity { peaks: vec![0.7; 2], filter: OpacityFilter::Compensated, least: 0.0 };
    let factor = Mat3::from_diagonal(Vec3::new(0.8, 0.8, 0.3));
    let pair = splats(centers, vec![factor; 2], strength, vec![[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
    let settings = RenderSettings { low_pass: 0.0, ..nothing_but(Order::Centers) };
    let [width, height] = [41, 9];
    for direction in [-4.0, 0.0, 3.0_f64] {
        // Each column in turn looks in this direction.
        let colors: Vec<[f32; 4]> = (0..width)
            .map(|column| {
                let ahead = Pose::look_at(DVec3::ZERO, DVec3::Z, DVec3::Y).unwrap();
                let lens = Camera::perspective(ahead, 0.25, [width, height]).unwrap().intrinsics();
                let aside = ((f64::from(column) + 0.5 - lens.center.x) / lens.focal.x).atan();
                // In the picture the right is −x.
                let angle = direction.to_radians() + aside;
                let pose =
                    Pose::look_at(DVec3::ZERO, DMat3::from_rotation_y(angle) * DVec3::Z, DVec3::Y).unwrap();
                let camera = Camera::perspective(pose, 0.25, [width, height]).unwrap();
                let frame = draw(vec![pair.clone()], &camera, &settings);
                frame.color[(height / 2 * width + column) as usize]
            })
            .collect();
        let first = colors[0];
        assert!(first[0] > 0.2 && first[2] > 0.1, "{first:?}");
        let largest = colors.iter().flat_map(|c| (0..4).map(|i| (c[i] - first[i]).abs())).fold(0.0, f32::max);
        println!("{direction}°: {largest:e} from {first:?}");
        // Single precision.
        assert!(largest <= 1e-4, "{direction}°: {largest}");
    }
}

#[test]
fn a_checker_box_crosses_45_degrees_without_a_jump() {
    // 20³ kernels in cubes of 5³ that alternate: a third of the light passes a cube.
    let side = 20;
    let cube = |x: f32| (x / 5.0 + 100.0).floor() as i32;
    let checkers = painted(&fog([side; 3], DVec3::ONE, 0.2, [0.0; 3]), |p| {
        if (cube(p.x) + cube(p.y) + cube(p.z)) % 2 == 0 { [0.9, 0.7, 0.1] } else { [0.1, 0.2, 0.6] }
    });
    let views: Vec<Camera> = (-3..=3)
        .map(|step| {
            let angle = (45.0 + 0.2 * f64::from(step)).to_radians();
            looking_from(DVec3::new(-angle.sin() * 60.0, 15.0, -angle.cos() * 60.0), 20)
        })
        .collect();
    let steps = |order: Option<Order>| -> f64 {
        let frame = |view: &Camera| match order {
            None => truth(std::slice::from_ref(&checkers), view, &ordered(SLABS)),
            Some(order) => draw(vec![checkers.clone()], view, &ordered(order)),
        };
        largest_step(&views.iter().map(frame).collect::<Vec<_>>())
    };
    let least = steps(None);
    for order in [Order::Centers, Order::PerPixel, SLABS, SHEETS] {
        let found = steps(Some(order));
        println!("{order:?}: largest step {found:.5}, R1's {least:.5}");
        if order == SHEETS {
            assert!(found >= 4.0 * least, "axis-aligned sheets do not pop: {found}, R1's {least}");
        } else {
            assert!(found <= 2.0 * least, "{order:?}: {found}, R1's {least}");
        }
    }
}
