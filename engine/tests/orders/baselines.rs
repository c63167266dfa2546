//! Ways that others go, and by how much they are behind; what an order refuses and counts.

use super::scenes::{camera, kernels, looking_from, plane};
use super::*;
use oblate_engine::{Baseline, Counts, Observer, Pose, SceneError, render};
use std::sync::Mutex;

/// Mean errors against R1 as the settings have it, and with a baseline.
fn errors(cloud: &Cloud, camera: &Camera, settings: &RenderSettings, baseline: Baseline) -> [f64; 2] {
    let clouds = [cloud.clone()];
    let r1 = truth(&clouds, camera, settings);
    [None, Some(baseline)].map(|baseline| {
        let settings = RenderSettings { baseline, ..*settings };
        apart(&draw(clouds.to_vec(), camera, &settings), &r1).mean_error
    })
}

#[test]
fn taylors_opacity_is_worse_than_the_exponential() {
    // Parallel rays, to which the affine form is exact.
    let pose = Pose::look_at(DVec3::new(2.5, 2.0, -4.5), DVec3::ZERO, DVec3::Y).unwrap();
    let camera = Camera::orthographic(pose, 3.0, [32; 2]).unwrap();
    let settings = RenderSettings { footprint: FootprintForm::Affine, ..nothing_but(Order::Centers) };
    // The denser the volume the more of the error is the order's, which both have: 2.4 and 1.6 times.
    for (extinction, least) in [(1.0, 2.0), (10.0, 1.4)] {
        let cloud = haze(14, 0.16, extinction);
        let [ours, taylors] = errors(&cloud, &camera, &settings, Baseline::Taylor);
        println!("extinction {extinction}: {ours:.2e}, Taylor's {taylors:.2e}, {:.2} times", taylors / ours);
        assert!(taylors >= least * ours, "extinction {extinction}: {taylors} is not {least} times {ours}");
    }
}

#[test]
fn taylors_opacity_is_that_of_exact_footprints_too() {
    let camera = looking_from(DVec3::new(2.5, 2.0, -4.5), 16);
    let settings = nothing_but(Order::Centers);
    let [ours, taylors] = errors(&haze(14, 0.16, 10.0), &camera, &settings, Baseline::Taylor);
    assert!(taylors > 1.2 * ours, "{taylors} {ours}");
}

/// Half of an optical depth of 100 is 50, of which Taylor's opacity is 1 as of the whole: nothing of the sheet shows. Rounding alone.
#[test]
fn taylors_opacity_of_a_share_is_that_of_its_optical_depth() {
    let sigma = 0.3;
    let mass = 100.0 * std::f32::consts::TAU * sigma * sigma;
    let dense = kernels(vec![Vec3::ZERO], Mat3::from_diagonal(Vec3::splat(sigma)), mass, [0.2, 0.6, 0.9]);
    for order in [Order::Centers, Order::PerPixel] {
        for footprint in [FootprintForm::Affine, FootprintForm::Exact] {
            let settings = RenderSettings { footprint, baseline: Some(Baseline::Taylor), ..ordered(order) };
            let frame =
                draw(vec![dense.clone(), plane(100, 0.05, [1.0, 0.5, 0.0])], &camera(5.0, 33), &settings);
            let found = frame.color[16 * 33 + 16];
            let off = found.iter().zip([0.2, 0.6, 0.9, 1.0]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 1e-5, "{order:?}, {footprint:?}: {found:?}");
        }
    }
}

#[test]
fn shares_as_they_are_spread_kernels_that_slabs_spread_again() {
    let camera = looking_from(DVec3::new(2.5, 2.0, -4.5), 32);
    for extinction in [1.0, 10.0] {
        let cloud = haze(14, 0.16, extinction);
        // 44 and 16 times are found, 97 and 37.
        for (thickness, least) in [(2.0, 10.0), (1.5, 25.0)] {
            let settings = nothing_but(Order::Slabs { thickness });
            let [ours, others] = errors(&cloud, &camera, &settings, Baseline::UncorrectedShares);
            println!(
                "extinction {extinction}, slabs of {thickness}: {ours:.2e}, as they are {others:.2e}, {:.1} times",
                others / ours
            );
            assert!(
                others >= least * ours,
                "{extinction}, {thickness}: {others} is not {least} times {ours}"
            );
        }
    }
}

#[test]
fn sheets_need_a_grid() {
    let camera = camera(6.0, 8);
    let sheets = |clouds: &[&Cloud]| {
        let scene = Scene { clouds: clouds.iter().copied().cloned().collect(), lights: Vec::new() };
        render(&scene, &camera, &ordered(SHEETS), &()).map(|_| ())
    };
    let grid = haze(4, 0.3, 1.0);
    let size = |i: usize| Mat3::from_diagonal(Vec3::splat(0.1 + 0.01 * i as f32));
    let shapes = Shapes::Each((0..grid.len()).map(size).collect());
    let motley = Cloud::new(Splats { shapes, ..grid.splats() }).unwrap();
    // Whose third axis is nowhere.
    let flat = kernels(vec![Vec3::ZERO; 3], Mat3::from_diagonal(Vec3::new(0.1, 0.1, 0.0)), 0.1, [1.0; 3]);
    let refused: [&[&Cloud]; 5] = [&[&motley], &[&trained()], &[&motley, &grid], &[&flat], &[]];
    for clouds in refused {
        assert_eq!(sheets(clouds), Err(SceneError::NoGrid));
    }
    assert_eq!(sheets(&[&grid]), Ok(()));
    // The first cloud's grid does for all.
    assert_eq!(sheets(&[&grid, &motley]), Ok(()));
}

/// Keeps what it is told.
#[derive(Default)]
struct Counter(Mutex<Counts>);

impl Observer for Counter {
    fn counts(&self, counts: Counts) {
        *self.0.lock().unwrap() = counts;
    }
}

/// Pixels of kernels that come late.
fn late(cloud: &Cloud, order: Order) -> u64 {
    let counter = Counter::default();
    let scene = Scene { clouds: vec![cloud.clone()], lights: Vec::new() };
    render(&scene, &camera(6.0, 32), &ordered(order), &counter).unwrap();
    counter.0.into_inner().unwrap().late
}

/// Long thin kernels that lean across the view, side by side and through one another: each is before all others at one
/// end, and behind them at the other.
fn leaning(count: usize) -> Cloud {
    let place = |i: usize| Vec3::X * ((i as f32 + 0.5) / count as f32 - 0.5);
    let lean = Mat3::from_rotation_y(0.5) * Mat3::from_diagonal(Vec3::new(0.02, 0.3, 0.6));
    kernels((0..count).map(place).collect(), lean, 0.01, [0.9, 0.5, 0.1])
}

#[test]
fn kernels_come_late_where_more_go_through_one_another_than_a_window_holds() {
    for (count, is_late) in [(8, false), (9, true), (100, true)] {
        let cloud = leaning(count);
        for order in [Order::Centers, SLABS] {
            assert_eq!(late(&cloud, order), 0, "{count} kernels, {order:?}");
        }
        let late = late(&cloud, Order::PerPixel);
        println!("{count} kernels: {late} pixels come late");
        assert_eq!(late > 0, is_late, "{count} kernels: {late}");
    }
}
