//! The estimator without any order against R1, which integrates: they share how a splat is met, and no more. And what is
//! drawn against both.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DVec3, Vec3};
use oblate_engine::cloud::oblate_factor;
use oblate_engine::reference::{Estimate, stochastic};
use oblate_engine::{
    Blend, Camera, Cloud, Frame, Light, Material, OpacityFilter, Order, Pose, ReferenceKind, RenderSettings,
    Scene, SceneError, Shapes, Splats, Strength, reference, render,
};
use scenes::*;

/// A standard error of 1/128 at even odds.
const SAMPLES: u32 = 4096;

/// A level of a picture with 8 bits.
const LEVEL: f64 = 1.0 / 255.0;

/// How far a picture may be off by itself.
#[derive(Clone, Copy)]
struct Own {
    /// At a pixel.
    largest: f64,
    /// In the mean of a channel over all pixels.
    mean: f64,
}

/// R1 is right to 1e-5, and its pixels are f32.
const OF_R1: Own = Own { largest: 1.1e-5, mean: 1.1e-5 };

/// What is drawn is asked to be within a level of R1 at a pixel, and within a tenth of that in the mean. At even odds the
/// standard error of a pixel is two levels, so that most of what is allowed there is chance; that of the mean over a
/// picture is a tenth of a level too.
const OF_ORDERS: Own = Own { largest: LEVEL, mean: LEVEL / 10.0 };

/// How far an estimate is from a picture.
#[derive(Debug)]
struct Found {
    /// Shares of channels beyond three and six standard errors.
    beyond: [f64; 2],
    largest: f64,
    /// Mean differences, and in units of their standard errors, for each channel.
    mean: [f64; 4],
    bias: [f64; 4],
}

/// Compares at some pixels; errors count from where the picture's own end.
fn compare_at(places: &[usize], estimate: &Estimate, frame: &Frame, own: Own) -> Found {
    let mut found = Found { beyond: [0.0; 2], largest: 0.0, mean: [0.0; 4], bias: [0.0; 4] };
    let pixels = places.len() as f64;
    let mut variance = [0.0; 4];
    for place in places.iter().copied() {
        for (channel, error) in estimate.standard_error[place].iter().enumerate() {
            let off = estimate.color[place][channel] - f64::from(frame.color[place][channel]);
            let errors = (off.abs() - own.largest).max(0.0) / error.max(f64::MIN_POSITIVE);
            for (beyond, limit) in found.beyond.iter_mut().zip([3.0, 6.0]) {
                *beyond += if errors > limit { 0.25 / pixels } else { 0.0 };
            }
            found.largest = found.largest.max(errors);
            found.mean[channel] += off / pixels;
            variance[channel] += (error / pixels).powi(2);
        }
    }
    for (channel, variance) in variance.into_iter().enumerate() {
        let off = (found.mean[channel].abs() - own.mean).max(0.0);
        found.bias[channel] = off / variance.sqrt().max(f64::MIN_POSITIVE);
    }
    found
}

fn compare(estimate: &Estimate, frame: &Frame) -> Found {
    compare_at(&(0..frame.color.len()).collect::<Vec<_>>(), estimate, frame, OF_R1)
}

fn r1(scene: &Scene, camera: &Camera, settings: &RenderSettings) -> Frame {
    reference(scene, camera, settings, ReferenceKind::R1, &|_| ()).unwrap()
}

/// Of independent channels 0.27 % are beyond three errors, and the mean of all is beyond 4.5 with a probability of
/// 7e-6.
fn assert_close(name: &str, found: &Found) {
    println!(
        "{name}: {:.2} % beyond 3, largest {:.1}, mean {:.6?}, bias {:.1?}",
        100.0 * found.beyond[0],
        found.largest,
        found.mean,
        found.bias
    );
    assert!(found.beyond[0] <= 0.005 && found.beyond[1] == 0.0, "{name}: {found:?}");
    assert!(found.bias.iter().all(|bias| *bias < 4.5), "{name}: {found:?}");
}

/// Estimates a scene, and compares R1 with that, and what orders draw where there are no edges.
fn assert_converges(name: &str, scene: &Scene, camera: &Camera, settings: &RenderSettings, orders: &[Order]) {
    let frame = r1(scene, camera, settings);
    let estimate = stochastic(scene, camera, settings, SAMPLES, 1).unwrap();
    let lit = frame.color.iter().filter(|pixel| (0.02..0.98).contains(&pixel[0])).count();
    assert!(lit > frame.color.len() / 8, "{name}: only {lit} pixels tell anything");
    assert_close(name, &compare(&estimate, &frame));
    let places = smooth(&frame, &scene.clouds, camera);
    assert!(places.len() > frame.color.len() * 7 / 10, "{name}: only {} pixels are no edges", places.len());
    for order in orders {
        // Less than a level: a kernel of opacity ends where it falls below the tolerance, and several end in a pixel.
        let settings = RenderSettings { order: *order, tolerance: LEVEL / 8.0, ..*settings };
        let drawn = render(scene, camera, &settings, &()).unwrap();
        assert_close(&format!("{name}, {order:?}"), &compare_at(&places, &estimate, &drawn, OF_ORDERS));
    }
}

const THICK: Order = Order::Slabs { thickness: 2.0 };
const THIN: Order = Order::Slabs { thickness: 1.0 };

fn at(x: f64, y: f64, z: f64, cloud: &Cloud) -> Cloud {
    cloud.clone().transformed(tilted(0.0, DVec3::new(x, y, z)))
}

/// A plane through the origin that lets a share through.
fn quad(opacity: f32, degrees: f64) -> Cloud {
    let mut splats = plane(40, 0.06, [0.9, 0.8, 0.1]).splats();
    if let Strength::Surface(surface) = &mut splats.strength {
        surface.opacities = Some(vec![opacity; splats.centers.len()]);
    }
    splats.material = Material::default();
    Cloud::new(splats).unwrap().transformed(tilted(degrees, DVec3::ZERO))
}

/// Elongated kernels of many colours on a sphere, with opacities.
fn trained(count: usize) -> Cloud {
    let place = |i: usize| {
        let angle = i as f32 * 2.399;
        Vec3::new(angle.cos(), (i as f32 / count as f32 - 0.5) * 2.0, angle.sin()) * 0.8
    };
    Cloud::new(Splats {
        centers: (0..count).map(place).collect(),
        shapes: Shapes::Each(
            (0..count).map(|i| oblate_factor(place(i), 0.25, 1.0 + (i % 4) as f32)).collect(),
        ),
        strength: Strength::Opacity {
            peaks: (0..count).map(|i| 0.3 + 0.1 * (i % 6) as f32).collect(),
            filter: OpacityFilter::Classic,
            least: 0.0,
        },
        colors: (0..count).map(|i| [(i % 2) as f32, (i % 3) as f32 / 2.0, (i % 5) as f32 / 4.0]).collect(),
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })
    .unwrap()
}

fn view() -> Camera {
    looking_from(DVec3::new(2.0, 1.5, -4.0), 28)
}

fn scene(clouds: Vec<Cloud>) -> Scene {
    Scene { clouds, lights: Vec::new() }
}

fn blue_fog(extinction: f64) -> Cloud {
    fog([12; 3], DVec3::splat(0.17), extinction, [0.2, 0.4, 0.9])
}

#[test]
fn opaque_mesh_in_fog() {
    let scene = scene(vec![blue_fog(0.7), sphere(1500, 0.7, [0.9, 0.4, 0.1])]);
    assert_converges("opaque mesh in fog", &scene, &view(), &unshaded(), &[THICK, THIN]);
}

/// Kernels that a translucent quad goes through, drawn in orders.
fn check_quad(orders: &[Order]) {
    let color = |red: f32| [red, 0.5, 1.0 - red];
    let ball = |x, z, red| {
        at(x, 0.2 * x, z, &kernels(vec![Vec3::ZERO], oblate_factor(Vec3::X, 0.4, 1.6), 1.5, color(red)))
    };
    let mut clouds = vec![quad(0.4, 30.0)];
    clouds.extend([ball(-0.4, -0.6, 1.0), ball(0.3, -0.2, 0.0), ball(0.0, 0.1, 0.8), ball(-0.2, 0.7, 0.1)]);
    // Lit, so that layers and kernels are shaded; the background shows through.
    let lights = vec![
        Light::Ambient { color: [0.4; 3] },
        Light::Point { position: DVec3::new(1.0, 3.0, -3.0), color: [1.0, 0.9, 0.8] },
    ];
    let settings = RenderSettings { background: [0.1, 0.3, 0.2, 0.6], ..RenderSettings::default() };
    let scene = Scene { clouds, lights };
    assert_converges("translucent quad between kernels", &scene, &view(), &settings, orders);
}

#[test]
fn translucent_quad_between_kernels() {
    check_quad(&[]);
}

#[test]
fn kernels_that_are_cut_are_drawn_where_they_are() {
    check_quad(&[THIN]);
    check_inside(true, &[THIN]);
}

#[test]
fn cloud_inside_a_volume() {
    let scene = scene(vec![trained(30), blue_fog(0.8)]);
    // Kernels of the cloud are as thin as a quarter of a slab of two σ, each in a colour of its own.
    assert_converges("cloud inside a volume", &scene, &view(), &unshaded(), &[THIN]);
}

#[test]
fn two_volumes_that_overlap() {
    let red = fog([9; 3], DVec3::splat(0.2), 1.2, [0.9, 0.3, 0.1]);
    let scene = scene(vec![at(0.4, 0.2, -0.3, &red), at(-0.4, 0.0, 0.2, &blue_fog(0.9))]);
    assert_converges("two volumes that overlap", &scene, &view(), &unshaded(), &[THICK, THIN]);
}

#[test]
fn one_surface_before_another_in_fog() {
    let near = at(-0.5, 0.1, -0.7, &sphere(600, 0.4, [0.9, 0.2, 0.6]));
    let scene = scene(vec![
        blue_fog(0.3),
        near,
        at(0.0, 0.0, 0.5, &quad(0.7, -20.0)),
        at(0.3, 0.0, 1.0, &sphere(900, 0.6, [0.3, 0.9, 0.2])),
    ]);
    assert_converges("one surface before another", &scene, &view(), &unshaded(), &[THICK, THIN]);
}

/// A camera amid all that there is, its rays parallel or not, drawn in orders.
fn check_inside(is_parallel: bool, orders: &[Order]) {
    let ball = at(0.5, 0.2, 0.6, &sphere(400, 0.3, [0.9, 0.3, 0.1]));
    let scene = scene(vec![blue_fog(0.5), trained(30), quad(0.5, 50.0), ball]);
    let pose = Pose::look_at(DVec3::new(0.1, 0.2, -0.35), DVec3::new(0.2, 0.1, 1.0), DVec3::Y).unwrap();
    let camera = if is_parallel {
        Camera::orthographic(pose, 1.6, [28; 2]).unwrap().with_near(0.2).unwrap()
    } else {
        Camera::perspective(pose, 1.2, [28; 2]).unwrap()
    };
    let name = format!("camera inside all, parallel {is_parallel}");
    assert_converges(&name, &scene, &camera, &unshaded(), orders);
}

#[test]
fn camera_inside_all() {
    check_inside(false, &[THIN]);
    check_inside(true, &[]);
}

#[test]
fn kernels_that_are_ordered_by_their_centres() {
    let settings = RenderSettings { background: [0.3, 0.1, 0.5, 0.4], ..unshaded() };
    for blend in [Blend::Linear, Blend::Display] {
        let settings = RenderSettings { blend, ..settings };
        let scene = scene(vec![trained(40)]);
        assert_converges("by centres", &scene, &view(), &settings, &[Order::Centers]);
    }
    let inside = looking_from(DVec3::new(0.3, 0.2, -0.5), 28).with_near(0.2).unwrap();
    let alone = scene(vec![trained(40)]);
    assert_converges("by centres, inside", &alone, &inside, &settings, &[Order::Centers]);
    // Kernels that surfaces go through.
    let cut = scene(vec![quad(0.5, 50.0), trained(40), at(0.3, 0.2, 0.5, &quad(0.3, -20.0))]);
    assert_converges("by centres between surfaces", &cut, &view(), &settings, &[Order::Centers]);
}

#[test]
fn a_wrong_picture_is_told() {
    // A quad that lies farther to the front of its fog.
    let scene_of = |z: f64| scene(vec![blue_fog(1.0), at(0.0, 0.0, z, &quad(0.6, 0.0))]);
    let right = stochastic(&scene_of(0.0), &view(), &unshaded(), SAMPLES, 1).unwrap();
    let moved = compare(&right, &r1(&scene_of(-0.2), &view(), &unshaded()));
    println!("moved: {moved:?}");
    assert!(moved.beyond[0] > 0.1 && moved.bias.iter().any(|bias| *bias > 20.0), "{moved:?}");
    // A fog thinner by a hundredth is off by less than an error of a pixel: no pixel need show it, but the mean does.
    let thinner = scene(vec![blue_fog(0.99), quad(0.6, 0.0)]);
    let thinner = compare(&right, &r1(&thinner, &view(), &unshaded()));
    println!("thinner: {thinner:?}");
    assert!(thinner.bias.iter().any(|bias| *bias > 4.5), "{thinner:?}");
}

#[test]
fn more_samples_err_less_and_seeds_differ() {
    let scene = scene(vec![trained(20), blue_fog(0.8)]);
    let camera = looking_from(DVec3::new(2.0, 1.5, -4.0), 12);
    let estimate = |samples, seed| stochastic(&scene, &camera, &unshaded(), samples, seed).unwrap();
    let [few, many] = [1000, 16_000].map(|samples| {
        let errors = estimate(samples, 1).standard_error;
        errors.iter().map(|error| error[3]).sum::<f64>() / errors.len() as f64
    });
    // A quarter, but for the nine samples that are added: 9/1000 of a variance.
    assert!((few / many - 4.0).abs() < 0.1, "{few} {many}");
    let frame = |samples, seed| estimate(samples, seed).color;
    assert!(frame(10, 1) != frame(10, 2));
    // No number of threads changes a bit.
    let estimates = [1, 2, 5].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| estimate(50, 7))
    });
    assert!(estimates[0] == estimates[1] && estimates[0] == estimates[2]);
    assert_eq!((estimates[0].width, estimates[0].height, estimates[0].color.len()), (12, 12, 144));
}

#[test]
fn what_cannot_differ_has_no_error() {
    // Nothing, and behind it a background that is half there.
    let settings = RenderSettings { background: [0.2, 0.4, 0.6, 0.5], ..unshaded() };
    let empty = stochastic(&Scene::default(), &camera(1.0, 3), &settings, 5, 0).unwrap();
    for (color, error) in empty.color.iter().zip(&empty.standard_error) {
        assert_eq!(*error, [0.0; 4]);
        for (value, expected) in color.iter().zip([0.1, 0.2, 0.3, 0.5]) {
            assert!((value - expected).abs() < 1e-7);
        }
    }
    // A kernel that hardly anything is stopped by: its mean is 0, its error is not.
    let faint = scene(vec![kernels(vec![Vec3::ZERO], oblate_factor(Vec3::Z, 0.5, 1.0), 1e-6, [1.0; 3])]);
    let estimate = stochastic(&faint, &camera(5.0, 1), &unshaded(), 100, 0).unwrap();
    assert_eq!(estimate.color[0], [0.0; 4]);
    // 4.5 of 109: √(4.5 · 104.5/109³).
    let expected = (4.5f64 * 104.5 / 109f64.powi(3)).sqrt();
    assert!(estimate.standard_error[0].iter().all(|error| (error - expected).abs() < 1e-12));
}

#[test]
fn wrong_numbers_are_refused() {
    for samples in [0, (1 << 24) + 1] {
        let refused = stochastic(&Scene::default(), &camera(1.0, 1), &unshaded(), samples, 0);
        assert!(matches!(refused, Err(SceneError::Setting { what: "number of samples", .. })), "{refused:?}");
    }
    let wrong = RenderSettings { low_pass: -1.0, ..unshaded() };
    assert!(stochastic(&Scene::default(), &camera(1.0, 1), &wrong, 1, 0).is_err());
}
