//! Summed coverage of iso-surfels.
mod common;
use common::*;
use glam::DVec3;
use oblate_volumes::{COVERAGE_FLOOR, IsoSettings, iso_surfels};

#[test]
fn planes() {
    let mut random = Random(7);
    for (name, frame) in frames() {
        let dims = [28, 28, 28];
        let center = middle(dims, frame);
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        for trial in 0..40 {
            let normal = if trial == 0 { DVec3::Z } else { random.direction() };
            let off = random.next();
            let volume = sampled(dims, frame, |p| normal.dot(p - center) - off);
            let s = surfels(&iso_surfels(&volume, 0.0, &IsoSettings::default()).unwrap());
            let (t1, t2) = normal.any_orthonormal_pair();
            for _ in 0..100 {
                let p = center + normal * off + t1 * (random.next() - 0.5) * 3.0 + t2 * (random.next() - 0.5) * 3.0;
                let w = coverage(&s, p, normal, 1e9);
                low = low.min(w);
                high = high.max(w);
            }
        }
        println!("{name}: {low} {high} {COVERAGE_FLOOR}");
    }
}

#[test]
fn spheres() {
    let mut random = Random(8);
    for (name, frame) in frames() {
      for r in [5.0, 8.0, 12.0] {
        let dims = [36, 36, 36];
        let center = middle(dims, frame) + DVec3::new(0.3,0.1,-0.2);
        let r = r * frame.spacing.max_element();
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
            let volume = sampled(dims, frame, |p| r - (p - center).length());
            let cloud = iso_surfels(&volume, 0.0, &IsoSettings::default()).unwrap();
            let s = surfels(&cloud);
            let area: f64 = s.iter().map(|s| s.3).sum::<f64>()/(4.0*std::f64::consts::PI*r*r);
            for _ in 0..3000 {
                let n = random.direction();
                let p = center + n * r;
                let w = coverage(&s, p, n, r);
                low = low.min(w);
                high = high.max(w);
            }
        println!("{name} r {r}: n {} area {area} {low} {high} closed {}", s.len(), surface(&cloud).closed);
      }
    }
}
