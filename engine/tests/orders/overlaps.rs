//! Kernels in the same place: how they add up, and that nobody has to be first.

use super::*;
use glam::DAffine3;
use oblate_engine::Pose;

/// The optical depth of the thin layers of fog: an opacity of 0.0039.
const THIN: f64 = 0.003_907_624;

/// A camera with parallel rays along +z and pixels of the width 0.1; the middle of the picture is at the origin.
fn parallel(size: u32) -> Camera {
    let pose = Pose::look_at(DVec3::NEG_Z * 20.0, DVec3::ZERO, DVec3::Y).unwrap();
    Camera::orthographic(pose, 0.1 * f64::from(size), [size; 2]).unwrap()
}

/// Two round kernels of σ = 1, `apart` of each other along a line that is oblique to the view.
fn pair(apart: f32, depth: f32) -> Cloud {
    let towards = Vec3::new(0.5, 0.2, 1.0).normalize() * apart;
    let masses = vec![mass_of(depth, Mat3::IDENTITY), mass_of(depth, Mat3::IDENTITY)];
    let colors = vec![[1.0, 0.2, 0.0], [0.0, 0.3, 1.0]];
    splats(
        vec![towards * -0.5, towards * 0.5],
        vec![Mat3::IDENTITY; 2],
        Strength::Extinction { masses },
        colors,
    )
}

/// The same splats in another order.
fn reversed(cloud: &Cloud) -> Cloud {
    let mut splats = cloud.splats();
    splats.centers.reverse();
    splats.colors.reverse();
    match &mut splats.shapes {
        Shapes::Each(factors) => factors.reverse(),
        Shapes::Shared(_) => (),
    }
    match &mut splats.strength {
        Strength::Extinction { masses } => masses.reverse(),
        Strength::Opacity { peaks, .. } => peaks.reverse(),
        Strength::Surface(_) => unreachable!(),
    }
    Cloud::new(splats).unwrap().transformed(cloud.cloud_to_world())
}

#[test]
fn what_all_pixels_share_out_alike_is_as_if_each_did_it_by_itself() {
    // Kernels that are all but round are all but equally far at all pixels of parallel rays: longer by 3e-6 along an axis that is turned by 10°, by
    // 1e-6σ at a σ of the footprint from its middle, up to 2.6e-6 of the spread and its planes. At a tolerance of 1e-6 (8.7e-6 of them) one number
    // a slab does, at 1e-9 it is found pixel by pixel.
    // Of three sizes, they touch from two to a dozen slabs, one after the other.
    let sizes = [haze(12, 0.7, 0.5), haze(9, 0.93, 0.3), haze(6, 1.4, 0.3)];
    let stretched = DAffine3::from_scale(DVec3::new(1.0, 1.0, 1.0 + 3e-6));
    let clouds = sizes.map(|cloud| cloud.transformed(scenes::tilted(10.0, DVec3::ZERO) * stretched));
    let camera = parallel(64);
    for thickness in [2.45, 2.0, 1.86, 1.7, 1.6, 1.5, 1.2, 0.8] {
        let settings = RenderSettings {
            footprint: FootprintForm::Affine,
            // Interpolation is for colours alone.
            interpolation: false,
            tolerance: 1e-6,
            ..ordered(Order::Slabs { thickness })
        };
        let alike = draw(clouds.to_vec(), &camera, &settings);
        let apart_from = |other: &Frame| apart(&alike, other).max_error;
        let by_pixel = RenderSettings { tolerance: 1e-9, ..settings };
        let by_pixel = draw(clouds.to_vec(), &camera, &by_pixel);
        let found = apart_from(&by_pixel);
        // Roundings of sums of a hundred kernels.
        assert!(found <= 2e-5, "slabs of {thickness}: {found:e}");
        // Of slabs that are thinner none touches so few.
        assert_eq!(found > 0.0, thickness >= 1.5, "slabs of {thickness}: both ways are one");
        let depths = alike.expected_depth.iter().zip(&by_pixel.expected_depth);
        let off = depths.map(|(a, b)| if a == b { 0.0 } else { (a - b).abs() });
        let farthest = off.fold(0.0, |most: f32, off| if off <= most { most } else { off });
        // The same of z, which is 20.
        assert!(farthest <= 4e-4, "slabs of {thickness}: {farthest:e}");
        let colors = RenderSettings { channels: Channels::Color, ..settings };
        let found = apart_from(&draw(clouds.to_vec(), &camera, &colors));
        assert!(found <= 2e-5, "slabs of {thickness}, colours alone: {found:e}");
        let thicker = RenderSettings { order: Order::Slabs { thickness: 3.0 }, ..settings };
        assert!(
            apart_from(&draw(clouds.to_vec(), &camera, &thicker)) > 1e-3,
            "slabs of {thickness} don't show"
        );
    }
}

/// One kernel has the optical depth that it has, however many slabs share it, and in however many pieces it comes.
#[test]
fn a_kernel_by_itself_is_as_dense_in_slabs_of_any_thickness() {
    let camera = scenes::looking_from(DVec3::new(1.0, 2.0, -20.0), 24);
    for (index, form) in (0..12).zip([FootprintForm::Affine, FootprintForm::Exact].into_iter().cycle()) {
        let factor = turned(index) * Mat3::from_diagonal(Vec3::new(0.2, 0.3, 1.5));
        let masses = vec![mass_of(6.0, factor)];
        let kernel =
            vec![splats(vec![Vec3::ZERO], vec![factor], Strength::Extinction { masses }, vec![[1.0; 3]])];
        let alone = |order| {
            let settings = RenderSettings { footprint: form, tolerance: 1e-9, ..ordered(order) };
            draw(kernel.clone(), &camera, &settings)
        };
        let whole = alone(Order::Centers);
        assert!(whole.color.iter().any(|color| color[3] > 0.3), "{index}: it hardly shows");
        // In units of its median σ, 0.3: the thinnest are a 400th of its length.
        for thickness in [0.03, 0.1, 0.3, 0.7, 1.0, 1.5, 2.0] {
            let found = apart(&whole, &alone(Order::Slabs { thickness })).max_error;
            // A slab is closed within 5e-6 of its optical depth; thin opacities are within 2e-5 of a quarter at most.
            assert!(found <= 2e-5, "{index}, {form:?}, slabs of {thickness}: {found:e}");
        }
    }
}

/// Where an opacity ends is kept with how many slabs share it: of hundreds of thousands a cut-off takes its place.
#[test]
fn an_opacity_by_itself_is_as_dense_in_slabs_of_any_thickness() {
    let camera = scenes::looking_from(DVec3::Z * -20.0, 48);
    let strength = Strength::Opacity {
        peaks: vec![0.9],
        filter: OpacityFilter::Classic,
        least: Strength::LEAST_OF_TRAINED,
    };
    // The filter widens it to a pixel.
    let factor = Mat3::from_diagonal(Vec3::new(0.01, 0.01, 3.0));
    let kernel = vec![splats(vec![Vec3::ZERO], vec![factor], strength, vec![[1.0; 3]])];
    let alone = |order| draw(kernel.clone(), &camera, &RenderSettings { tolerance: 1e-5, ..ordered(order) });
    let whole = alone(Order::Centers);
    assert!(whole.color.iter().any(|color| color[3] > 0.3), "it hardly shows");
    // In units of its median σ, 0.01: from hundreds of slabs over its length to millions. Where it ends it is 1/255; the cut-off leaves less.
    let least = f64::from(Strength::LEAST_OF_TRAINED);
    for (thickness, most) in [(2.0, 2e-5), (1.2, 2e-5), (0.1, least), (0.001, least)] {
        let found = apart(&whole, &alone(Order::Slabs { thickness })).max_error;
        assert!(found <= most, "slabs of {thickness}: {found:e}");
    }
}

#[test]
fn interpenetrating_kernels_are_the_integral_in_thin_slabs() {
    let eye = DVec3::new(1.0, 2.0, -20.0);
    let camera = scenes::looking_from(eye, 24);
    let mut worst = [0.0_f64; 4];
    for apart_by in [0.0, 0.25, 0.5, 1.0, 2.0, 3.0] {
        for depth in [0.1, 0.5, 1.0, 2.0, 4.0] {
            let clouds = vec![pair(apart_by, depth)];
            let thin = Order::Slabs { thickness: 0.4 };
            let r1 = truth(&clouds, &camera, &nothing_but(thin));
            let orders = [Order::Centers, Order::PerPixel, SLABS, thin];
            for (worst, order) in worst.iter_mut().zip(orders) {
                *worst = worst.max(apart(&draw(clouds.clone(), &camera, &nothing_but(order)), &r1).max_error);
            }
        }
    }
    println!(
        "largest error: centers {:.4}, per pixel {:.4}, slabs of 2 {:.4}, of 0.4 {:.5}",
        worst[0], worst[1], worst[2], worst[3]
    );
    assert!(worst[3] <= LEVEL, "{}", worst[3]);
    assert!(worst[0] > 10.0 * LEVEL, "whole kernels are right: {}", worst[0]);
}

#[test]
fn thin_slabs_are_the_integral_wherever_they_lie() {
    // What lies beyond the slabs that a kernel touches is in the first and the last of them: it shows in dense kernels.
    let camera = parallel(5);
    let pair = |z: f32, apart: f32, depth: f32| {
        let mass = mass_of(depth, Mat3::IDENTITY);
        let cloud = scenes::kernels(vec![Vec3::Z * z, Vec3::Z * (z + apart)], Mat3::IDENTITY, mass, [0.0; 3]);
        vec![painted(&cloud, |p| if p.z == z { [1.0; 3] } else { [0.0; 3] })]
    };
    for thickness in [1.0, 0.5] {
        let settings = nothing_but(Order::Slabs { thickness });
        let mut worst = 0.0_f64;
        for apart_by in [0.25, 0.5, 1.0, 2.0, 3.0] {
            for depth in [0.3, 1.0, 4.0] {
                let r1 = truth(&pair(0.0, apart_by, depth), &camera, &settings);
                for place in 0..8 {
                    let z = thickness as f32 * place as f32 / 8.0;
                    let found = apart(&draw(pair(z, apart_by, depth), &camera, &settings), &r1);
                    worst = worst.max(found.max_error);
                }
            }
        }
        println!("slabs of {thickness}: {worst:.5}");
        assert!(worst <= LEVEL, "slabs of {thickness}: {worst}");
    }
}

#[test]
fn the_order_of_input_changes_nothing() {
    let camera = scenes::looking_from(DVec3::new(1.0, 2.0, -20.0), 24);
    let slabs = [2.0, 0.4].map(|thickness| Order::Slabs { thickness });
    let orders = [Order::Centers, Order::PerPixel, SHEETS, slabs[0], slabs[1]];
    let check = |name: &str, cloud: &Cloud, orders: &[Order]| {
        for order in orders {
            let frames =
                [cloud.clone(), reversed(cloud)].map(|cloud| draw(vec![cloud], &camera, &ordered(*order)));
            let found = apart(&frames[0], &frames[1]).max_error;
            println!("{name}, {order:?}: {found:e}");
            // Sums in another order are rounded differently; what is sorted has one order.
            let rounding =
                if matches!(order, Order::Slabs { .. } | Order::AxisSheets { .. }) { 1e-6 } else { 0.0 };
            assert!(found <= rounding, "{name}, {order:?}: {found}");
        }
    };
    for apart_by in [0.5, 1.0, 3.0] {
        for depth in [0.1, 4.0] {
            check(&format!("{apart_by} apart, optical depth {depth}"), &pair(apart_by, depth), &GENERAL);
        }
    }
    // In one place nobody is first, and only what needs no order can do without.
    check("one place", &pair(0.0, 2.0), &slabs);
    check("trained kernels", &trained(), &GENERAL);
    // A lattice that nothing is symmetric to: kernels at one distance are for none to put in order.
    let shifted = haze(8, 0.25, 1.0).transformed(scenes::tilted(10.0, DVec3::new(0.123, 0.057, 0.0)));
    check("haze", &shifted, &orders);
}

#[test]
fn shells_are_as_right_as_sorted_centers() {
    let camera = scenes::looking_from(DVec3::new(1.0, 2.0, -20.0), 24);
    let thin = Order::Shells { thickness: 1e-3 };
    for extinction in [0.3, 1.0, 3.0] {
        let cloud =
            haze(8, 0.25, extinction).transformed(scenes::tilted(10.0, DVec3::new(0.123, 0.057, 0.0)));
        let settings = nothing_but(Order::Centers);
        let r1 = truth(std::slice::from_ref(&cloud), &camera, &settings);
        let sorted = draw(vec![cloud.clone()], &camera, &settings);
        let of_sorted = apart(&sorted, &r1).mean_error;
        for cloud in [cloud.clone(), reversed(&cloud)] {
            let found = draw(vec![cloud.clone()], &camera, &nothing_but(Order::Shells { thickness: 1.0 }));
            let of_shells = apart(&found, &r1).mean_error;
            println!("extinction {extinction}: {of_shells:.5}, sorted centres {of_sorted:.5}");
            assert!(apart(&found, &sorted).max_error > 0.0, "nothing is in another order");
            assert!(of_shells <= 1.25 * of_sorted, "extinction {extinction}: {of_shells}, not {of_sorted}");
            let found = draw(vec![cloud], &camera, &nothing_but(thin));
            assert_eq!(apart(&found, &sorted).max_error, 0.0, "thin shells");
        }
    }
}

#[test]
fn layers_of_thin_fog_add_up() {
    // Discs of σ = 1, ten pixels, that the filter widens.
    let camera = parallel(4);
    let variance = 1.0 + 0.3 * 0.1 * 0.1;
    for count in [10, 32, 100, 320, 1000] {
        let mass = (THIN * std::f64::consts::TAU * variance) as f32;
        let centers = (0..count).map(|i| Vec3::Z * 0.003 * i as f32).collect();
        let layers = kernels_of(centers, mass);
        for order in GENERAL.into_iter().chain([SHEETS]) {
            let frame = draw(vec![layers.clone()], &camera, &ordered(order));
            let worst = (0..16).map(|i| {
                let [x, y] = [i % 4, i / 4].map(|k| (f64::from(k) - 1.5) * 0.1);
                let depth = f64::from(count) * THIN * (-0.5 * (x * x + y * y) / variance).exp();
                (1.0 - f64::from(frame.color[i as usize][3]) - (-depth).exp()).abs()
            });
            let worst = worst.fold(0.0, f64::max);
            println!("{count} layers, {order:?}: {worst:.6}");
            // What the cut-off's renormalisation adds, 0.22 % of the optical depth, is 8e-4 at most.
            assert!(worst <= 1e-3, "{count} layers, {order:?}: {worst}");
        }
    }
}

/// Round kernels of σ = 1.
fn kernels_of(centers: Vec<Vec3>, mass: f32) -> Cloud {
    scenes::kernels(centers, Mat3::IDENTITY, mass, [0.9, 0.6, 0.3])
}

#[test]
fn a_kernel_may_be_split() {
    // Beside another one that it goes through.
    let camera = parallel(24);
    let other = kernels_of(vec![Vec3::new(0.5, 0.3, 0.8)], mass_of(1.5, Mat3::IDENTITY));
    for order in GENERAL.into_iter().chain([SHEETS]) {
        let split = |count: usize| {
            let mass = mass_of(2.0, Mat3::IDENTITY) / count as f32;
            let parts = painted(&kernels_of(vec![Vec3::ZERO; count], mass), |_| [0.1, 0.2, 0.9]);
            draw(vec![parts, other.clone()], &camera, &ordered(order))
        };
        let whole = split(1);
        for count in [2, 7, 100] {
            let found = apart(&split(count), &whole).max_error;
            println!("{order:?}, {count} parts: {found:e}");
            assert!(found <= LEVEL, "{order:?}, {count} parts: {found}");
        }
    }
}

#[test]
fn kernels_that_are_cut_are_the_integral_in_thin_slabs() {
    // Two kernels of σ = 0.4 whose middles lie to either side of a cut, 1.5 σ apart.
    let camera = scenes::camera(20.0, 16);
    let shape = Mat3::from_diagonal(Vec3::splat(0.4));
    let kernel = |z: f32, color| scenes::kernels(vec![Vec3::Z * z], shape, mass_of(1.5, shape), color);
    let both = || vec![kernel(-0.3, [1.0, 0.2, 0.0]), kernel(0.3, [0.0, 0.3, 1.0])];
    let sheet = |opacity: f32| {
        let mut splats = scenes::plane(60, 0.06, [0.9, 0.8, 0.2]).splats();
        let Strength::Surface(surface) = &mut splats.strength else { unreachable!() };
        surface.opacities = Some(vec![opacity; surface.areas.len()]);
        Cloud::new(splats).unwrap()
    };
    let thin = nothing_but(Order::Slabs { thickness: 0.25 });
    let found = |name: &str, clouds: Vec<Cloud>, camera: &Camera| {
        let found = apart(&draw(clouds.clone(), camera, &thin), &truth(&clouds, camera, &thin)).max_error;
        println!("{name}: {found:.5}");
        found
    };
    let whole = found("not cut", both(), &camera);
    let near = found("by the near plane", both(), &camera.with_near(20.0).unwrap());
    let [opaque, translucent] =
        [1.0, 0.4].map(|opacity| found("by a sheet", [both(), vec![sheet(opacity)]].concat(), &camera));
    assert!(whole <= 1e-3 && near <= 1e-3 && opaque <= 1e-3 && translucent <= 1e-3);
}

#[test]
fn kernels_keep_their_order_beside_dust() {
    // Red before blue, and dust beside them whose size asks for slabs so thin that no numbers are left for where they are;
    // in the same cloud, and in one of its own.
    let camera = scenes::looking_from(DVec3::new(0.0, 0.0, -5.0), 12);
    let shape = |sigma: f32| Mat3::from_diagonal(Vec3::splat(sigma));
    let things = [(Vec3::NEG_Z, 0.2, [1.0, 0.0, 0.0]), (Vec3::Z, 0.2, [0.0, 0.0, 1.0])];
    let dust = (0..5).map(|i| (Vec3::new(50.0 + i as f32, 0.0, 0.0), 1e-7, [0.0; 3]));
    let cloud = |splats_of: Vec<(Vec3, f32, [f32; 3])>| {
        let factors: Vec<Mat3> = splats_of.iter().map(|(_, sigma, _)| shape(*sigma)).collect();
        let masses = factors.iter().map(|factor| mass_of(2.0, *factor)).collect();
        let (centers, colors) = splats_of.iter().map(|(center, _, color)| (*center, *color)).unzip();
        splats(centers, factors, Strength::Extinction { masses }, colors)
    };
    let alone = vec![cloud(things.to_vec())];
    let expected = truth(&alone, &camera, &nothing_but(SLABS));
    for clouds in [
        vec![cloud(things.into_iter().chain(dust.clone()).collect())],
        vec![cloud(things.to_vec()), cloud(dust.collect())],
    ] {
        let found = apart(&draw(clouds, &camera, &nothing_but(SLABS)), &expected).max_error;
        println!("beside dust: {found:.5}");
        // Apart as they are, nothing mixes.
        assert!(found <= LEVEL, "{found}");
    }
}
