//! What is left to the engine, settled by trial: beside the finest way, and wherever a scene is in the picture.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{
    Cloud, FootprintForm, Material, OpacityFilter, Order, RenderSettings, Scene, Shapes, Splats, Strength,
    settle,
};
use scenes::{draw, unshaded};

/// Places in the unit ball by Weyl's sequence, as many as a cube of `count` gives.
fn in_ball(count: usize) -> Vec<Vec3> {
    let steps = [0.819_172_5, 0.671_043_6, 0.549_700_5];
    let place = |i: usize| Vec3::from(steps.map(|step: f64| (2.0 * (i as f64 * step).fract() - 1.0) as f32));
    (0..count).map(place).filter(|place| place.length() < 1.0).collect()
}

/// Round white kernels.
fn white(centers: Vec<Vec3>, sigma: f32, strength: Strength) -> Cloud {
    let colors = vec![[1.0; 3]; centers.len()];
    Cloud::new(Splats {
        centers,
        shapes: Shapes::Shared(Mat3::from_diagonal(Vec3::splat(sigma))),
        strength,
        colors,
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })
    .unwrap()
}

/// The error that 99.9 % of the pixels keep to that show anything.
fn error(truth: &[[f32; 4]], found: &[[f32; 4]]) -> f64 {
    let shown = truth.iter().zip(found).filter(|(a, b)| a[3] + b[3] > 0.0);
    let largest = |(a, b): (&[f32; 4], &[f32; 4])| (0..4).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
    let mut errors: Vec<f32> = shown.map(largest).collect();
    errors.sort_by(f32::total_cmp);
    f64::from(errors[errors.len() * 999 / 1000])
}

/// Nearly a hundred to the pixel in a small picture of a ball: each may lack little where it ends, but together they lack much.
#[test]
fn what_crowds_lack_where_they_end_stays_within_the_tolerance() {
    let centers = in_ball(200_000);
    let count = centers.len();
    let crowd = white(
        centers,
        0.004,
        Strength::Opacity { peaks: vec![0.1; count], filter: OpacityFilter::Classic, least: 0.0 },
    );
    let camera = scenes::camera(4.6, 48);
    let tolerance = 8.0 / 255.0;
    let left_open = RenderSettings { tolerance, ..unshaded() };
    let finest = RenderSettings {
        footprint: FootprintForm::Exact,
        order: Order::Centers,
        tolerance: 1e-6,
        cutoff: 30.0,
        ..unshaded()
    };
    let scene = Scene { clouds: vec![crowd.clone()], lights: Vec::new() };
    let color = |settings: &RenderSettings| draw(vec![crowd.clone()], &camera, settings).color;
    let truth = color(&finest);
    // Where they end is left open where the way is said, too.
    let said = RenderSettings { footprint: finest.footprint, order: finest.order, ..left_open };
    for asked in [left_open, said] {
        let settled = settle(&scene, &camera, &asked).unwrap();
        let [usual, settled] = [asked, settled].map(|settings| error(&truth, &color(&settings)));
        assert!(usual > tolerance, "nothing is shown of what ends lack");
        assert!(settled <= tolerance, "{settled} is more than {tolerance}");
        // What is said is not changed.
        let nearer = RenderSettings { cutoff: 6.0, ..asked };
        assert_eq!(settle(&scene, &camera, &nearer).unwrap().cutoff, 6.0);
    }
}

/// Hundreds to the pixel, each so faint that even a 64th of the tolerance takes much of it away, or all.
#[test]
fn faint_crowds_end_finer() {
    let centers = in_ball(40_000);
    let count = centers.len();
    let scene = |peak: f32| Scene {
        clouds: vec![white(
            centers.clone(),
            0.1,
            Strength::Opacity { peaks: vec![peak; count], filter: OpacityFilter::Classic, least: 0.0 },
        )],
        lights: Vec::new(),
    };
    let camera = scenes::camera(4.6, 48);
    for (peak, tolerance) in [(0.002, 8.0 / 255.0), (0.002, 64.0 / 255.0), (1e-4, 4.0 / 255.0)] {
        let scene = scene(peak);
        let color = |settings: &RenderSettings| draw(scene.clouds.clone(), &camera, settings).color;
        let truth = color(&RenderSettings {
            footprint: FootprintForm::Exact,
            order: Order::Centers,
            tolerance: 1e-7,
            cutoff: 30.0,
            ..unshaded()
        });
        let left_open = RenderSettings { tolerance, ..unshaded() };
        let settled = settle(&scene, &camera, &left_open).unwrap();
        let [finest_usual, settled_error] = [1.0 / 64.0, settled.end_share]
            .map(|end_share| error(&truth, &color(&RenderSettings { end_share, ..settled })));
        println!("{peak} at {tolerance}: {finest_usual} → {settled_error}, {settled:?}");
        assert!(finest_usual > tolerance, "{finest_usual} is no more than {tolerance}");
        assert!(
            settled.end_share < 1.0 / 64.0 && settled_error <= tolerance,
            "{settled_error} at {tolerance}"
        );
    }
}

/// What the filter dims ends by itself where it would without a filter: from afar nothing is left out of what is far below that.
#[test]
fn what_a_filter_dims_shows_from_afar() {
    let centers = in_ball(20_000);
    let count = centers.len();
    let strength = Strength::Opacity {
        peaks: vec![0.3; count],
        filter: OpacityFilter::Compensated,
        least: Strength::LEAST_OF_TRAINED,
    };
    let cloud = white(centers, 0.01, strength);
    // 0.09 pixels: the filter leaves 1/40 of a peak.
    let camera = scenes::camera(4.6, 24);
    let truth = {
        let settings = RenderSettings { tolerance: 1e-7, cutoff: 30.0, ..unshaded() };
        draw(vec![cloud.clone()], &camera, &settings).color
    };
    assert!(truth.iter().any(|pixel| pixel[3] > 0.2), "it hardly shows");
    for tolerance in [1.0 / 255.0, 8.0 / 255.0] {
        let left_open = RenderSettings { tolerance, ..unshaded() };
        let scene = Scene { clouds: vec![cloud.clone()], lights: Vec::new() };
        let settled = settle(&scene, &camera, &left_open).unwrap();
        let [usual, found] = [0.25, settled.end_share].map(|end_share| {
            let settings = RenderSettings { end_share, ..settled };
            error(&truth, &draw(vec![cloud.clone()], &camera, &settings).color)
        });
        assert!(usual > tolerance && found <= tolerance, "{usual} → {found} at {tolerance}");
    }
}

/// Dense kernels in two colours, which sorted centres get wrong, a tenth as wide as the picture and in its corner.
#[test]
fn what_is_small_in_the_picture_is_looked_at() {
    let centers = in_ball(20_000);
    let count = centers.len();
    let sigma = 0.06f32;
    let colors = (0..count).map(|i| [[1.0, 0.1, 0.0], [0.0, 0.2, 1.0]][i % 2]).collect();
    let dense = Cloud::new(Splats {
        centers,
        shapes: Shapes::Shared(Mat3::from_diagonal(Vec3::splat(sigma))),
        strength: Strength::Extinction { masses: vec![0.6 * sigma * sigma; count] },
        colors,
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })
    .unwrap();
    let scene = Scene { clouds: vec![dense.clone()], lights: Vec::new() };
    let amid_nothing = scenes::camera(4.6, 48).part([-400, -37], [480, 480]).unwrap();
    let settled = settle(&scene, &amid_nothing, &unshaded()).unwrap();
    let finest = RenderSettings {
        footprint: FootprintForm::Exact,
        order: Order::Slabs { thickness: 0.25 },
        tolerance: 1e-6,
        cutoff: 30.0,
        ..unshaded()
    };
    let quickest = RenderSettings {
        order: Order::Shells { thickness: 0.5 },
        footprint: FootprintForm::Affine,
        ..unshaded()
    };
    let [truth, found, quick] =
        [finest, settled, quickest].map(|settings| draw(vec![dense.clone()], &amid_nothing, &settings).color);
    let [found, quick] = [error(&truth, &found), error(&truth, &quick)];
    assert!(quick > unshaded().tolerance, "the quickest way would do: {quick}");
    assert!(found <= unshaded().tolerance, "{found}, in {:?}", settled.order);
}

/// Thin fog all over the picture, and in it a dense wall in two colours, a sixtieth of the picture or, at its border, less, of which the windows that
/// are looked at first show little: by them shells would do for one wall, and near ends for another.
#[test]
fn what_few_windows_miss_is_looked_for() {
    let (affine, exact) = (FootprintForm::Affine, FootprintForm::Exact);
    let slabs = |thickness| Order::Slabs { thickness };
    let drawn_in = |order, cutoff, footprint| RenderSettings { order, cutoff, footprint, ..unshaded() };
    let finest = RenderSettings { tolerance: 1e-6, ..drawn_in(slabs(0.25), 30.0, exact) };
    let shells = drawn_in(Order::Shells { thickness: 0.5 }, 12.25, affine);
    for (wall, too_quick) in [(5, shells), (29, drawn_in(slabs(1.5), 9.0, affine))] {
        let mut splats = scenes::fog([64, 64, 8], DVec3::ONE, 0.01, [0.5; 3]).splats();
        let Strength::Extinction { masses } = &mut splats.strength else { unreachable!("so is fog") };
        for ((center, color), mass) in splats.centers.iter().zip(&mut splats.colors).zip(masses) {
            let cell = (*center + 31.5).round().as_ivec3();
            if (wall..wall + 2).contains(&cell.x) && (24..40).contains(&cell.y) {
                *mass = 0.5;
                *color = [[0.9, 0.1, 0.0], [0.0, 0.2, 0.9]][(cell.z % 2) as usize];
            }
        }
        let cloud = Cloud::new(splats).unwrap();
        let scene = Scene { clouds: vec![cloud.clone()], lights: Vec::new() };
        let camera = scenes::camera(100.0, 256);
        let settled = settle(&scene, &camera, &unshaded()).unwrap();
        let [truth, found, quick] =
            [finest, settled, too_quick].map(|settings| draw(vec![cloud.clone()], &camera, &settings).color);
        let [found, quick] = [error(&truth, &found), error(&truth, &quick)];
        assert!(quick > 2.0 * unshaded().tolerance, "what few windows take would do: {quick}");
        let what = format!("{:?} to ρ = {}", settled.order, settled.cutoff);
        assert!(found <= unshaded().tolerance, "{found}, {what}");
    }
}

/// Beside the picture there is nothing to try: all stays as it is. The form is tried of an order that needs a grid, too.
#[test]
fn what_can_not_be_tried_stays_as_it_is() {
    let fog = scenes::fog([8; 3], DVec3::ONE, 0.1, [1.0; 3]);
    let scene = Scene { clouds: vec![fog], lights: Vec::new() };
    let beside = scenes::camera(40.0, 48).part([1000, 0], [48, 48]).unwrap();
    assert_eq!(settle(&scene, &beside, &unshaded()).unwrap(), unshaded());
    let order = Order::AxisSheets { spacing: 1.0 };
    let sheets = RenderSettings { order, ..unshaded() };
    let settled = settle(&scene, &scenes::camera(40.0, 48), &sheets).unwrap();
    assert!(settled.order == order && settled.footprint != FootprintForm::Auto, "{settled:?}");
}

/// A sphere in checks, whose colours differ from surfel to surfel at their borders: the nearer surfels end, the more it changes.
#[test]
fn surfels_end_as_near_as_the_tolerance_allows() {
    let mut splats = scenes::sphere(20_000, 1.0, [1.0; 3]).splats();
    for (color, center) in splats.colors.iter_mut().zip(&splats.centers) {
        let cell = (*center * 4.0).floor().element_sum() as i32;
        *color = [[0.9, 0.3, 0.1], [0.1, 0.4, 0.9]][cell.rem_euclid(2) as usize];
    }
    let sphere = Cloud::new(splats).unwrap();
    let scene = Scene { clouds: vec![sphere.clone()], lights: Vec::new() };
    let camera = scenes::camera(6.0, 128);
    let truth = draw(vec![sphere.clone()], &camera, &unshaded()).color;
    let mut outlines = Vec::new();
    for levels in [1.0, 8.0, 16.0, 32.0] {
        let tolerance = levels / 255.0;
        let settled = settle(&scene, &camera, &RenderSettings { tolerance, ..unshaded() }).unwrap();
        let found = error(&truth, &draw(vec![sphere.clone()], &camera, &settled).color);
        assert!(found <= tolerance, "{found} is more than {tolerance}, to ρ = {}", settled.outline);
        outlines.push(settled.outline);
    }
    let usual = unshaded().outline;
    assert!(
        outlines[0] == usual && outlines[3] < usual && outlines.is_sorted_by(|a, b| a >= b),
        "{outlines:?}"
    );
    // What is said is not changed.
    let said = RenderSettings { outline: 16.0, tolerance: 32.0 / 255.0, ..unshaded() };
    assert_eq!(settle(&scene, &camera, &said).unwrap().outline, 16.0);
}

/// Levels of detail are coarser than their needs ask for where that keeps to the tolerance, as on a plain sphere, and finer where they don't: of
/// two walls in two colours close to each other another may be the first when some of their surfels are merged.
#[test]
fn levels_are_as_coarse_as_the_tolerance_allows() {
    let plain = scenes::sphere(100_000, 1.0, [0.8; 3]);
    let mut walls = plain.splats();
    for (i, (center, color)) in walls.centers.iter_mut().zip(&mut walls.colors).enumerate() {
        *center *= [1.0, 0.98][i % 2];
        *color = [[0.9, 0.1, 0.1], [0.1, 0.1, 0.9]][i % 2];
    }
    if let Strength::Surface(surface) = &mut walls.strength {
        surface.areas.iter_mut().for_each(|area| *area *= 2.0);
        surface.closed = false.into();
    }
    let walls = Cloud::new(walls).unwrap();
    let camera = scenes::camera(40.0, 256);
    for tolerance in [2.0 / 255.0, 8.0 / 255.0] {
        for (cloud, is_plain) in [(&plain, true), (&walls, false)] {
            let cloud = cloud.clone().with_levels_for(tolerance);
            let left_open = RenderSettings { tolerance, ..unshaded() };
            let scene = Scene { clouds: vec![cloud.clone()], lights: Vec::new() };
            let settled = settle(&scene, &camera, &left_open).unwrap();
            let [truth, found, usual] = [0.0, settled.level_of_detail, 1.0].map(|level_of_detail| {
                let settings = RenderSettings { level_of_detail, ..settled };
                draw(vec![cloud.clone()], &camera, &settings).color
            });
            let [found, usual] = [error(&truth, &found), error(&truth, &usual)];
            assert!(found <= tolerance, "{found} is more than {tolerance}");
            assert_eq!(settled.level_of_detail > 1.0, is_plain, "{settled:?}");
            assert_eq!(usual <= tolerance, is_plain, "{usual} for {tolerance}");
            // What is said is not changed, and a budget says it, too.
            let said = RenderSettings { level_of_detail: 0.0, ..left_open };
            assert_eq!(settle(&scene, &camera, &said).unwrap().level_of_detail, 0.0);
            let budget = RenderSettings { budget: Some(50_000), ..left_open };
            assert_eq!(settle(&scene, &camera, &budget).unwrap().level_of_detail, 1.0);
            // A picture of forms shows those of the scene's.
            let forms = RenderSettings { color_by_form: true, ..left_open };
            let expected = RenderSettings { color_by_form: true, ..settled };
            assert_eq!(settle(&scene, &camera, &forms).unwrap(), expected);
        }
    }
}

/// A dense lattice in layers of two colours, far away: slabs that are thick enough for every splat would leave too little of the tolerance to levels.
#[test]
fn slabs_are_thin_enough_for_levels() {
    let side = 64;
    let place =
        |i: usize| [i % side, i / side % side, i / side / side].map(|k| 2.0 * k as f32 / side as f32 - 1.0);
    let centers: Vec<Vec3> =
        (0..side * side * side).map(|i| Vec3::from(place(i))).filter(|place| place.length() < 1.0).collect();
    let sigma = 1.2 / side as f32;
    let is_red = |place: &Vec3| (12.0 * place.dot(Vec3::new(0.3, 0.2, 1.0))).sin() > 0.0;
    let lattice = Cloud::new(Splats {
        shapes: Shapes::Shared(Mat3::from_diagonal(Vec3::splat(sigma))),
        strength: Strength::Extinction { masses: vec![2.0 * sigma * sigma; centers.len()] },
        colors: centers
            .iter()
            .map(|place| [[0.1, 0.3, 0.9], [0.9, 0.2, 0.1]][usize::from(is_red(place))])
            .collect(),
        centers,
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })
    .unwrap();
    let camera = scenes::camera(9.0, 96);
    let tolerance = 9.0 / 255.0;
    let lattice = lattice.with_levels_for(tolerance);
    let left_open = RenderSettings { tolerance, ..unshaded() };
    let scene = Scene { clouds: vec![lattice.clone()], lights: Vec::new() };
    let settled = settle(&scene, &camera, &left_open).unwrap();
    assert_eq!((settled.order, settled.level_of_detail), (Order::Slabs { thickness: 1.86 }, 1.0));

    let color = |settings: &RenderSettings| draw(vec![lattice.clone()], &camera, settings).color;
    let finest = RenderSettings {
        order: Order::Slabs { thickness: 0.25 },
        footprint: FootprintForm::Exact,
        cutoff: 30.0,
        level_of_detail: 0.0,
        ..settled
    };
    let truth = color(&finest);
    let off_by = |thickness: f64, level_of_detail: f64| {
        let settings = RenderSettings { order: Order::Slabs { thickness }, level_of_detail, ..settled };
        error(&truth, &color(&settings)) / tolerance
    };
    // Ways may be off by 0.6 of the tolerance.
    assert!(off_by(2.45, 0.0) < 0.6, "thick slabs are not even taken for every splat");
    assert!(off_by(2.45, settled.level_of_detail) > 0.6, "thick slabs would have done");
    let found = off_by(1.86, settled.level_of_detail);
    assert!(found < 0.6, "{found} of the tolerance");
}
