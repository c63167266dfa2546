#[path = "../tests/support/mod.rs"]
mod support;
use glam::*;
use oblate_surfels::*;
use std::f64::consts::*;
use support::*;
fn report(name: &str, cloud: &Cloud, want: f64, s: f64, at: impl Fn(usize) -> Option<(DVec3, DVec3)>) {
    let f = Finder::new(cloud, 5.0 * 0.7 * s);
    let mut w: Vec<f64> = (0..20000).filter_map(|i| at(i)).map(|(p, n)| f.coverage(p, n)).collect();
    w.sort_by(f64::total_cmp);
    let q = |x: f64| w[((w.len() - 1) as f64 * x) as usize];
    let m = w.iter().sum::<f64>() / w.len() as f64;
    let sd = (w.iter().map(|x| (x - m) * (x - m)).sum::<f64>() / w.len() as f64).sqrt();
    println!(
        "{name:10} n {:7} ({:.3}) Σw {:.3} .1% {:.3} 1% {:.3} 50% {:.3} 99% {:.3} 99.9% {:.3} max {:.3} sd {sd:.4} area {:.2e}",
        cloud.len(),
        cloud.len() as f64 / want,
        q(0.),
        q(0.001),
        q(0.01),
        q(0.5),
        q(0.99),
        q(0.999),
        q(1.),
        0.0
    );
}
use oblate_engine::Cloud;
fn main() {
    let arg = std::env::args().nth(1);
    let set = SamplerSettings::default();
    if let Some(n) = arg {
        let n: usize = n.parse().unwrap();
        let knot = mesh_of(primitives::torus_knot(2, 3, 0.25, [1000, 100]), DAffine3::IDENTITY);
        let square = mesh_of(primitives::plane(1), DAffine3::IDENTITY);
        for m in [knot, square] {
            let t = std::time::Instant::now();
            let c = sample(&m, Density::Count(n), &set).unwrap();
            println!("{} in {:?} area err {:.1e}", c.len(), t.elapsed(), total_area(&c) / m.area() - 1.0);
        }
        return;
    }
    let n = 30000;
    let quick = std::env::var("QUICK").is_ok();
    for cells in if quick { vec![1] } else { vec![1, 13, 600] } {
        let m = mesh_of(primitives::plane(cells), DAffine3::from_rotation_x(0.3));
        let c = sample(&m, Density::Count(n), &set).unwrap();
        let s = (m.area() / n as f64).sqrt();
        report(&format!("plane{cells}"), &c, n as f64, s, |i| {
            let [u, v] = quasirandom(i);
            let e = 1.0 - 3.0 * 0.8 * s;
            let t = DAffine3::from_rotation_x(0.3);
            Some((
                t.transform_point3(dvec3((2. * u - 1.) * e, 0., (2. * v - 1.) * e)),
                t.transform_vector3(DVec3::Y),
            ))
        });
    }
    if quick {
        return;
    }
    for seg in [40, 400, 1000] {
        let m = mesh_of(primitives::sphere(seg), DAffine3::IDENTITY);
        let c = sample(&m, Density::Count(n), &set).unwrap();
        let s = (m.area() / n as f64).sqrt();
        report(&format!("sphere{seg}"), &c, n as f64, s, |i| {
            let [u, v] = quasirandom(i);
            let z = 2. * u - 1.;
            let r = (1. - z * z).sqrt();
            let p = dvec3(r * (TAU * v).cos(), z, r * (TAU * v).sin());
            Some((p, p))
        });
    }
    let m = mesh_of(primitives::torus_knot(1, 0, 0.3, [300, 100]), DAffine3::IDENTITY);
    for n in [3000, 30000] {
        let c = sample(&m, Density::Count(n), &set).unwrap();
        let s = (m.area() / n as f64).sqrt();
        report("torus", &c, n as f64, s, |i| {
            let [u, v] = quasirandom(i);
            let (a, b) = (TAU * u, TAU * v);
            let nn = dvec3(a.cos() * b.cos(), b.sin(), a.sin() * b.cos());
            Some((dvec3(a.cos(), 0., a.sin()) + nn * 0.3, nn))
        });
    }
}
