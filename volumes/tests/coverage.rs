//! Summed coverage Σw of iso-surfels, by brute force: it is what keeps a surface free of holes.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use common::*;
use glam::DVec3;
use oblate_volumes::{ISO_COVERAGE_FLOOR, IsoSettings, iso_surfels};

/// A layer counts as more than one sheet where it covers farther above 1 than the floor is below (`engine/src/layers.rs`).
const CEILING: f64 = 2.0 - ISO_COVERAGE_FLOOR as f64;

/// On planes of any tilt, in any frame, Σw is 1 within 11 %: what the polygons' third moments and above, of up to a step in
/// length, are when a blur of 0.4 steps has smoothed them. (A blur of 0.65 leaves 0.7 %, and a surface that is softer for it.)
#[test]
fn planes_are_covered_evenly() {
    let mut random = Random(7);
    for (name, frame) in frames() {
        let dims = [24; 3];
        let center = middle(dims, frame);
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        for trial in 0..24 {
            let normal = if trial == 0 { DVec3::Z } else { random.direction() };
            let offset = frame.spacing.min_element() * random.next();
            let volume = sampled(dims, frame, |p| offset - normal.dot(p - center));
            let surfels = surfels(&iso_surfels(&volume, 0.0, &IsoSettings::default()).unwrap());
            let (t1, t2) = normal.any_orthonormal_pair();
            for _ in 0..60 {
                let aside = t1 * (random.next() - 0.5) + t2 * (random.next() - 0.5);
                let point = center + normal * offset + aside * 3.0 * frame.spacing.max_element();
                let w = coverage(&surfels, point, normal, f64::INFINITY);
                (low, high) = (low.min(w), high.max(w));
            }
        }
        println!("planes, {name}: summed coverage {low:.4} to {high:.4}");
        assert!(low >= 0.89 && high <= 1.11, "{name}: {low} to {high}");
    }
}

/// Spheres down to the radius that `ISO_COVERAGE_FLOOR` is promised for: closed, covered, of the right area.
#[test]
fn spheres_are_covered_down_to_the_promised_curvature() {
    let mut random = Random(8);
    for (name, frame) in frames() {
        let longest = frame.spacing.max_element();
        for steps in [5.0, 8.0] {
            let radius = steps * longest;
            let (dims, center) = grid_around(frame, radius);
            let volume = sampled(dims, frame, |p| radius - (p - center).length());
            let cloud = iso_surfels(&volume, 0.0, &IsoSettings::default()).unwrap();
            assert!(surface(&cloud).closed.is_everywhere(), "{name}");
            assert_eq!(surface(&cloud).coverage_floor, ISO_COVERAGE_FLOOR);
            let surfels = surfels(&cloud);
            let area =
                surfels.iter().map(|s| s.3).sum::<f64>() / (4.0 * std::f64::consts::PI * radius * radius);
            let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
            for _ in 0..1000 {
                let normal = random.direction();
                let w = coverage(&surfels, center + normal * radius, normal, radius);
                (low, high) = (low.min(w), high.max(w));
            }
            println!(
                "sphere of {steps} steps, {name}: area {area:.4}, summed coverage {low:.4} to {high:.4}"
            );
            // Where a flat polygon with circumradius ρ stands for a piece of a sphere, the piece leans by up to
            // ρ/r: the area lacks less than ρ²/(2r²), and a cell's largest polygon, 1 by √2, has ρ² = 3/4.
            assert!(area <= 1.0 && area >= 1.0 - 0.375 / (steps * steps), "{name}, {steps} steps: {area}");
            assert!(
                low >= f64::from(ISO_COVERAGE_FLOOR) && high <= CEILING,
                "{name}, {steps} steps: {low} to {high}"
            );
        }
    }
}
