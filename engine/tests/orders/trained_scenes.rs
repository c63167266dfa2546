//! Kernels with opacities, as training makes them: whole at their centres beside others, spread along the ray in slabs of their own.

use super::scenes::{kernels, looking_from, plane, smooth, tilted};
use super::*;
use oblate_engine::simd::Level;
use oblate_engine::{Pose, Renderer};

/// Kernels of all shapes in a ball; their opacities are from 0.1 to 0.95. Colours go by the place, or each has its own.
fn scene(is_motley: bool) -> Cloud {
    let indices = 0..2000;
    let color = |i: usize| if is_motley { any_color(i) } else { shades(in_ball(i) * 3.0) };
    splats(
        indices.clone().map(in_ball).collect(),
        indices.clone().map(any_shape).collect(),
        Strength::Opacity {
            peaks: indices.clone().map(|i| 0.1 + 0.85 * spread(i, 0.414_214)).collect(),
            filter: OpacityFilter::Compensated,
            least: 0.0,
        },
        indices.map(color).collect(),
    )
}

#[test]
fn slabs_of_trained_kernels_are_ahead_of_sorted_centers() {
    let camera = looking_from(DVec3::new(2.5, 2.0, -4.5), 32);
    // Where slabs are asked for and there is no extinction, R1 spreads opacities along the ray.
    for (name, is_motley, least) in [("neighbours alike", false, 10.0), ("motley", true, 6.0)] {
        let cloud = scene(is_motley);
        let r1 = truth(std::slice::from_ref(&cloud), &camera, &nothing_but(SLABS));
        let error = |order| apart(&draw(vec![cloud.clone()], &camera, &nothing_but(order)), &r1).mean_error;
        let thicknesses = [2.45, 2.0, 1.0];
        let [whole, tent, thin] = thicknesses.map(|thickness| error(Order::Slabs { thickness }));
        let centers = error(Order::Centers);
        println!("{name}: centers {centers:.2e}, slabs of {thicknesses:?} {whole:.2e} {tent:.2e} {thin:.2e}");
        assert!(tent <= centers / least, "{name}: {centers} is not {least} times {tent}");
        assert!(thin <= centers / 100.0, "{name}: {centers} is not a hundred times {thin}");
    }
}

/// One that lies astray, beside the picture, takes no digits from the others, with which it is in a cluster.
#[test]
fn a_stray_kernel_leaves_others_as_they_are() {
    let cloud = scene(true);
    let alone = cloud.splats();
    for astray in [Vec3::NEG_Y * 1e7, Vec3::new(1e10, 3.0, -1e9)] {
        let mut splats = cloud.splats();
        splats.centers[7] = astray;
        let mut without = alone.clone();
        without.centers[7] = Vec3::new(0.0, -30.0, 0.0);
        for camera in
            [looking_from(DVec3::new(2.5, 2.0, -4.5), 32), looking_from(DVec3::new(0.2, 0.1, -0.3), 32)]
        {
            let [with, without] = [&splats, &without].map(|splats| {
                draw(vec![Cloud::new(splats.clone()).unwrap()], &camera, &nothing_but(Order::Centers))
            });
            let largest = apart(&with, &without).max_error;
            // Roundings of places told from elsewhere, 1e-7 of distances, in pixels of 1e-2 over kernels as small.
            assert!(largest < 1e-4, "{astray}: {largest}");
        }
    }
}

/// A volume, with a kernel in it that reaches over more slabs than are open at once.
fn volume() -> [Cloud; 2] {
    let wide = kernels(vec![Vec3::new(0.2, -0.1, 0.3)], Mat3::IDENTITY * 0.5, 0.4, [0.3, 0.9, 0.5]);
    let aside = tilted(30.0, DVec3::new(0.9, -0.8, 0.4));
    [haze(8, 0.19, EXTINCTION).transformed(aside), wide.transformed(aside)]
}

const EXTINCTION: f64 = 3.0;
/// σ of the volume's kernels.
const SIGMA: f64 = 0.7 * 0.19;

/// What else is in a scene shows trained kernels as these are without it.
#[test]
fn trained_kernels_look_beside_others_as_they_do_alone() {
    let camera = looking_from(DVec3::new(2.5, 2.0, -4.5), 48);
    let cloud = scene(true);
    let sheet = plane(24, 0.06, [0.2, 0.9, 0.3]).transformed(tilted(30.0, DVec3::new(0.9, -0.8, 0.4)));
    for (others, order) in [(vec![sheet], Order::Auto), (volume()[..1].to_vec(), SLABS)] {
        let settings = nothing_but(order);
        let alone = draw(vec![cloud.clone()], &camera, &nothing_but(Order::Auto));
        let clouds = [vec![cloud.clone()], others.clone()].concat();
        let [by_themselves, all] = [others, clouds.clone()].map(|clouds| draw(clouds, &camera, &settings));
        let empty: Vec<usize> = (0..all.color.len()).filter(|i| by_themselves.color[*i][3] == 0.0).collect();
        assert!((500..all.color.len() - 300).contains(&empty.len()), "{} pixels are beside", empty.len());
        let moved = apart_at(&empty, &alone, &all).max_error;
        assert!(moved <= 1e-6, "pixels beside the others change by {moved}, {order:?}");
        assert!(apart(&all, &alone).max_error > 0.1, "the others hide nothing");
        if order == Order::Auto {
            let found = apart(&all, &truth(&clouds, &camera, &settings)).max_error;
            println!("beside R1: {found:.2e} at most");
            assert!(found <= 2e-5, "{found}");
        }
    }
}

/// Slabs are closed up to where trained kernels are, as if what is in one were even. Of a volume before them that is off by at most δ²/8 of
/// the slope of its extinction, which is steepest at its border, φ(0)/σ of it; also where a surface or the near plane cuts it off in a slab.
#[test]
fn volumes_around_trained_kernels_are_their_integral_in_thin_slabs() {
    let outside = DVec3::new(2.5, 2.0, -4.5);
    let inside = DVec3::new(0.4, -0.5, 0.1);
    let pose = Pose::look_at(outside, DVec3::ZERO, DVec3::Y).unwrap();
    let cameras = [
        ("outside", looking_from(outside, 32)),
        ("parallel", Camera::orthographic(pose, 2.5, [32; 2]).unwrap()),
        ("near plane", looking_from(outside, 32).with_near(5.2).unwrap()),
        ("inside", looking_from(inside, 32).with_near(0.15).unwrap()),
    ];
    let mut glass = plane(24, 0.06, [0.9, 0.8, 0.2]).splats();
    if let Strength::Surface(surface) = &mut glass.strength {
        surface.opacities = Some(vec![0.5; surface.areas.len()]);
    }
    let glass = Cloud::new(glass).unwrap().transformed(tilted(-40.0, DVec3::new(0.2, 0.1, 0.2)));
    let kernels = [vec![scene(true)], volume().to_vec()].concat();
    let cut = [kernels.clone(), vec![glass]].concat();
    for (name, camera) in &cameras {
        // Kernels that a surface cuts are within 1e-3 of their integral in any slabs.
        for (what, clouds, rest) in [("whole", &kernels, 2e-4), ("cut", &cut, 1e-3)] {
            let expected = truth(clouds, camera, &nothing_but(SLABS));
            let places = smooth(&expected, clouds, camera);
            let mut before = f64::INFINITY;
            for thickness in [1.0, 0.5, 0.25] {
                let settings = nothing_but(Order::Slabs { thickness });
                let found = apart_at(&places, &draw(clouds.clone(), camera, &settings), &expected);
                let found = found.max_error;
                println!("{name}, {what}, slabs of {thickness}: {found:.1e}");
                let steepest = 0.399 * EXTINCTION / SIGMA;
                let bound = (thickness * SIGMA).powi(2) / 8.0 * steepest;
                assert!(
                    found <= bound + rest,
                    "{name}, {what}, slabs of {thickness}: {found} is not {bound}"
                );
                let most = before / 2.5 + rest;
                assert!(found <= most, "{name}, {what}, slabs of {thickness}: {found} is not {most}");
                before = found;
            }
        }
    }
    // Where fewer sums are in registers.
    for (what, clouds) in [("whole", kernels), ("cut", cut)] {
        let scene = Scene { clouds, lights: Vec::new() };
        let settings =
            RenderSettings { channels: Channels::All, ..nothing_but(Order::Slabs { thickness: 0.5 }) };
        let frames: Vec<Frame> = Level::ALL
            .into_iter()
            .filter(|level| level.is_available())
            .map(|level| {
                Renderer::with(level, 32).render(&scene, &cameras[0].1, &settings, &()).unwrap().clone()
            })
            .collect();
        for frame in &frames[1..] {
            let found = apart(frame, &frames[0]).max_error;
            assert!(found <= 1e-5, "{what}: instruction sets differ by {found}");
        }
    }
}
