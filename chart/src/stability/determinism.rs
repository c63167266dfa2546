//! Case 13: the same picture every time.

use super::setups::*;
use super::{Case, Findings};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::DVec3;
use oblate_engine::{Camera, Cloud, Frame, Order, RenderSettings, Scene, Shapes, Splats, Strength};
use rayon::ThreadPoolBuilder;

pub(super) const CASE: Case = Case {
    number: 13,
    title: "The same picture every time",
    criterion: "One to sixteen threads draw the same picture to the last bit. Splats in another order make the same picture to 10⁻⁵, also where half of them share their places with another; put in Morton order first, where none do, they make it to the last bit. Trained splats in one place, which are composited one after the other by definition, come as they are listed.",
    run,
};

/// A share of a scene's splats, trained ones or of a medium as dense, lie in the places of others, in other colours.
fn with_ties(share: f64, are_trained: bool) -> Vec<Splats> {
    let mut splats = trained(400, 0.2).splats();
    if let (Strength::Opacity { peaks, .. }, Shapes::Each(factors)) = (&splats.strength, &splats.shapes)
        && !are_trained
    {
        let masses = peaks.iter().zip(factors).map(|(peak, factor)| mass_of(-(-peak).ln_1p(), *factor));
        splats.strength = Strength::Extinction { masses: masses.collect() };
    }
    for i in 0..splats.centers.len() / 2 {
        if spread(i, 0.618) < share {
            let other = i + splats.centers.len() / 2;
            splats.centers[other] = splats.centers[i];
            if let Shapes::Each(factors) = &mut splats.shapes {
                factors[other] = factors[i];
            }
            splats.colors[i] = [1.0, 0.2, 0.0];
            splats.colors[other] = [0.0, 0.4, 1.0];
        }
    }
    vec![splats, haze(9, 0.25, 0.6).splats()]
}

/// The same splats in another order, which a seed says.
fn shuffled(splats: &Splats, seed: usize) -> Splats {
    let order = shuffle(splats.centers.len(), seed);
    let take = |values: &[f32]| order.iter().map(|i| values[*i]).collect();
    Splats {
        centers: order.iter().map(|i| splats.centers[*i]).collect(),
        colors: order.iter().map(|i| splats.colors[*i]).collect(),
        shapes: match &splats.shapes {
            Shapes::Shared(factor) => Shapes::Shared(*factor),
            Shapes::Each(factors) => Shapes::Each(order.iter().map(|i| factors[*i]).collect()),
        },
        strength: match &splats.strength {
            Strength::Extinction { masses } => Strength::Extinction { masses: take(masses) },
            Strength::Opacity { peaks, filter, least } => {
                Strength::Opacity { peaks: take(peaks), filter: *filter, least: *least }
            }
            Strength::Surface(surface) => Strength::Surface(surface.clone()),
        },
        ..splats.clone()
    }
}

/// Indices in an order that looks random.
fn shuffle(count: usize, seed: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| {
        let key = |i: usize| spread(i * 7919 + seed * 104_729, 0.618_033_988_75);
        key(*a).total_cmp(&key(*b))
    });
    order
}

fn scene_of(splats: Vec<Splats>) -> Scene {
    scene(
        splats.into_iter().map(|splats| Cloud::new(splats).expect("splats of cases are in range")).collect(),
    )
}

fn view() -> Camera {
    looking_from(DVec3::new(2.1, 1.7, -3.6), 48)
}

/// Values whose bits differ, of all channels that a frame has.
fn differing(a: &Frame, b: &Frame) -> f64 {
    let bits = |frame: &Frame| {
        let channels = frame.color.iter().flatten().chain(&frame.expected_depth).chain(&frame.median_depth);
        let numbers = channels.chain(frame.normal.iter().flatten()).map(|value| value.to_bits());
        numbers.chain(frame.id.iter().copied()).collect::<Vec<u32>>()
    };
    bits(a).iter().zip(bits(b)).filter(|(a, b)| **a != *b).count() as f64
}

/// The picture by so many threads.
fn by(threads: usize, scene: &Scene, settings: &RenderSettings) -> Frame {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be had");
    pool.install(|| draw(scene, &view(), settings))
}

/// The opacity behind optical depths that each of so many threads adds up by itself, in f32.
fn sum_of_threads(threads: usize) -> f64 {
    let depths: Vec<f32> = (0..4096).map(|i| (spread(i, 0.754_877_67) * 4e-4) as f32).collect();
    let part = |part: &[f32]| part.iter().fold(0.0, |sum: f32, depth| sum + depth);
    let sum = depths.chunks(4096_usize.div_ceil(threads)).map(part).fold(0.0, |sum: f32, part| sum + part);
    f64::from(-(-sum).exp_m1())
}

/// Colours of ties over each other by a sort that keeps no order among equals, before and after a shuffle: the largest
/// difference. α = ½; `share` of 64 splats lie in pairs.
fn unstable(share: f64) -> f64 {
    let splat = |i: usize| {
        let depth = if spread(i / 2, 0.618) < share { i / 2 * 2 } else { i };
        (depth, f64::from((i % 2) as u32))
    };
    let splats: Vec<(usize, f64)> = (0..64).map(splat).collect();
    let color = |order: Vec<usize>| {
        let mut sorted: Vec<(usize, f64)> = order.into_iter().map(|i| splats[i]).collect();
        sorted.sort_unstable_by_key(|splat| splat.0);
        sorted.iter().rev().fold(0.0, |behind, (_, color)| 0.5 * behind + 0.5 * color)
    };
    let still = color((0..64).collect());
    largest((1..9).map(|seed| (color(shuffle(64, seed)) - still).abs()))
}

fn run() -> Findings {
    // Without an early end, which a tolerance allows: where it comes depends on what comes before.
    let thin = RenderSettings { tolerance: 0.0, ..ordered(Order::Slabs { thickness: 0.5 }) };
    let methods = [
        ("default", Role::Default, unshaded()),
        ("by centres", Role::Ours, ordered(Order::Centers)),
        ("pixel by pixel", Role::Ours, ordered(Order::PerPixel)),
        ("trained, slabs of 0.5 σ, tolerance 0", Role::Ours, thin),
    ];
    let sheet = moved(translucent(&plane(40, 0.06, [0.9, 0.8, 0.2]), 0.6), DVec3::new(0.1, 0.0, 0.2));
    let mixed = |splats: Vec<Splats>| {
        let mut scene = scene_of(splats);
        scene.clouds.push(sheet.clone());
        scene
    };
    let (mut verdicts, mut threads_curves, mut tie_curves) = (Vec::new(), Vec::new(), Vec::new());
    let still = mixed(with_ties(0.5, true));
    for (name, role, settings) in &methods {
        let alone = by(1, &still, settings);
        let frames: Vec<(usize, Frame)> =
            (1..17).map(|threads| (threads, by(threads, &still, settings))).collect();
        let worst = largest(frames.iter().map(|(_, frame)| differing(&alone, frame)));
        verdicts.push(at_most(*role, name, "values that 1 to 16 threads change", worst, 0.0));
        let off =
            |(threads, frame): &(usize, Frame)| [*threads as f64, apart(&alone, frame).max_error.max(FLOOR)];
        threads_curves.push(Curve::new(*name, *role, frames.iter().map(off)));

        let are_trained = *role != Role::Default;
        let with_ties = |share| with_ties(share, are_trained);
        let reordered = |share: f64, morton: bool, found: fn(&Frame, &Frame) -> f64| {
            let put = |splats: Splats| if morton { splats.in_morton_order() } else { splats };
            let first = draw(&mixed(with_ties(share).into_iter().map(put).collect()), &view(), settings);
            let other = |seed| {
                let splats = with_ties(share).iter().map(|splats| put(shuffled(splats, seed))).collect();
                found(&first, &draw(&mixed(splats), &view(), settings))
            };
            largest((1..3).map(other))
        };
        let off = |a: &Frame, b: &Frame| apart(a, b).max_error;
        // Orders that tell one kernel from the next take equally distant ones, of the lattice too, as they come. Slabs add up what
        // lies in them: a hundred terms, each right to 6·10⁻⁸.
        let is_sorted = matches!(settings.order, Order::Centers | Order::PerPixel);
        let shares = [
            (0.0, "shuffled, no pairs", is_sorted),
            (0.5, "shuffled, half in pairs", is_sorted || are_trained),
        ];
        for (share, what, fails) in shares {
            let figure = format!("{what}: largest difference");
            let verdict = at_most(*role, name, &figure, reordered(share, false, off), 1e-5);
            verdicts.push(if fails { failing(verdict) } else { verdict });
        }
        let in_morton_order = reordered(0.0, true, differing);
        verdicts.push(at_most(
            *role,
            name,
            "shuffled, then in Morton order: values changed",
            in_morton_order,
            0.0,
        ));
        if tie_curves.len() < 2 {
            let shares = steps(11, [0.0, 1.0]);
            tie_curves.push(Curve::new(
                *name,
                *role,
                shares.map(|s| [s, reordered(s, false, off).max(FLOOR)]),
            ));
        }
    }
    let alone = sum_of_threads(1);
    let sums = (1..17).map(|threads| [threads as f64, (sum_of_threads(threads) - alone).abs().max(FLOOR)]);
    let sums = Curve::new("each thread its own sum", Role::Baseline, sums);
    let changed = sums.points.iter().filter(|p| p[1] > FLOOR).count();
    let name = "each thread its own sum";
    verdicts.push(failing(at_most(Role::Baseline, name, "of 16 sums, how many change", changed as f64, 0.0)));
    threads_curves.push(sums);
    let name = "unstable sort";
    let figure = "shuffled, half in pairs: largest difference";
    verdicts.push(failing(at_most(Role::Baseline, name, figure, unstable(0.5), 1e-5)));
    let points = steps(11, [0.0, 1.0]).map(|share| [share, unstable(share).max(FLOOR)]);
    tie_curves.push(Curve::new(name, Role::Baseline, points));

    let panels = vec![
        Panel {
            title: "More threads".into(),
            x: Axis::linear("threads"),
            y: Axis::log("largest difference from one thread (10⁻⁹: none)"),
            bound: None,
            curves: threads_curves,
        },
        Panel {
            title: "The same splats in another order".into(),
            x: Axis::linear("share of splats that lie in pairs in one place"),
            y: Axis::log("largest difference (10⁻⁹: none)"),
            bound: Some(1e-5),
            curves: tie_curves,
        },
    ];
    Findings { panels, verdicts }
}
