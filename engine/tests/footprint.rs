//! The footprint against brute force: the Gaussian's own quadratic form along the ray, in f64.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

use glam::{DMat3, DQuat, DVec2, DVec3};
use oblate_engine::Projection;
use oblate_engine::footprint::{CameraSplat, Footprint, Form, Hit, Lens, Record};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

const CUTOFF: f64 = 12.25;

fn lens(low_pass_variance: f64) -> Lens {
    Lens {
        focal: DVec2::new(900.0, 1100.0),
        principal: DVec2::new(512.0, 384.0),
        projection: Projection::Perspective,
        filter_sigma: low_pass_variance.sqrt(),
    }
}

/// Σ': the covariance plus the pixels' filter in the image plane.
fn filtered_covariance(splat: &CameraSplat, lens: &Lens) -> DMat3 {
    let depth = if lens.projection == Projection::Perspective { splat.center.z } else { 1.0 };
    let filter = (lens.filter_sigma * depth / lens.focal).extend(0.0);
    splat.factor * splat.factor.transpose() + DMat3::from_diagonal(filter * filter)
}

/// Hit and line integral of unit mass by the definition; Σ' must be invertible.
fn brute_force(splat: &CameraSplat, lens: &Lens, pixel: DVec2) -> (Hit, f64) {
    let covariance = filtered_covariance(splat, lens);
    let precision = covariance.inverse();
    let across = (pixel - lens.principal) / lens.focal;
    let (origin, v) = match lens.projection {
        Projection::Perspective => (DVec3::ZERO, across.extend(1.0)),
        Projection::Orthographic => (across.extend(0.0), DVec3::Z),
    };
    let to_center = splat.center - origin;
    let weight = v.dot(precision * v);
    let z = v.dot(precision * to_center) / weight;
    let offset = v * z - to_center;
    let (r, sigma_z) = (offset.dot(precision * offset), weight.sqrt().recip());
    let peak = 1.0 / (TAU.powf(1.5) * covariance.determinant().sqrt());
    let integral = peak * (-0.5 * r).exp() * TAU.sqrt() * sigma_z * v.length();
    (Hit { r, z, sigma_z, scale: 0.0 }, integral)
}

/// A splat with its footprint radius in pixels, flattening s from 1 to ∞ and any orientation.
fn any_splat() -> impl Strategy<Value = CameraSplat> {
    let flattening =
        prop_oneof![Just(1.0), 1.0..20.0, (1.0..4.0f64).prop_map(|e| 10f64.powf(e)), Just(f64::INFINITY)];
    let center = (-0.55..0.55f64, -0.35..0.35f64, 0.5..50.0f64);
    (center, -1.0..2.0f64, 0.2..1.0f64, flattening, [-1.0..1.0f64, -1.0..1.0, -1.0..1.0, 0.05..1.0]).prop_map(
        |((x, y, depth), log_radius_px, aspect, flattening, q)| {
            let radius = (10f64.powf(log_radius_px) * depth / 1000.0).min(depth / 8.0);
            let [a, b] = [radius, radius * aspect];
            let rotation = DMat3::from_quat(DQuat::from_xyzw(q[0], q[1], q[2], q[3]).normalize());
            let factor = rotation * DMat3::from_diagonal(DVec3::new(a, b, b / flattening));
            CameraSplat { center: DVec3::new(x * depth, y * depth, depth), factor }
        },
    )
}

fn integral(footprint: &Footprint, lens: &Lens, hit: Hit, pixel: DVec2) -> f64 {
    footprint.unit_integral * lens.ray(pixel).length() * hit.scale * (-0.5 * hit.r).exp()
}

fn within(found: f64, expected: f64, tolerance: f64, what: &str) -> Result<(), TestCaseError> {
    prop_assert!(
        (found - expected).abs() <= tolerance,
        "{what}: {found} instead of {expected}, off by {:e}",
        (found - expected).abs()
    );
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn exact_form_is_the_gaussian_along_the_ray(
        splat in any_splat(),
        at in (-3.0..3.0f64, 0.0..TAU),
        variance in prop_oneof![Just(0.3), Just(1.0), Just(0.05)],
    ) {
        let lens = lens(variance);
        let footprint = Footprint::new(&splat, &lens).unwrap();
        let [_, half] = footprint.bounds(1.0, true);
        let u = DVec2::from_angle(at.1) * at.0 * half;
        let pixel = footprint.mean + u;
        let hit = footprint.exact(u);
        let (expected, expected_integral) = brute_force(&splat, &lens, pixel);
        // The inverse of Σ' loses up to its condition, (100 px / 0.2 px)² · 2e-16.
        prop_assume!(expected.r < 40.0 && hit.scale < 50.0);
        within(hit.r, expected.r, 1e-6 * (1.0 + expected.r), "r")?;
        within(hit.z, expected.z, 1e-6 * splat.center.z, "z")?;
        within(hit.sigma_z, expected.sigma_z, 1e-6 * (expected.sigma_z + 1e-3 * splat.center.z), "σ_z")?;
        let found = integral(&footprint, &lens, hit, pixel);
        within(found / expected_integral, 1.0, 1e-6 * (1.0 + expected.r), "line integral")?;
    }

    #[test]
    fn flat_and_unfiltered_is_a_disc_in_its_plane(splat in any_splat(), at in (0.0..3.0f64, 0.0..TAU)) {
        let lens = lens(0.0);
        let flat = DMat3::from_cols(splat.factor.x_axis, splat.factor.y_axis, DVec3::ZERO);
        let splat = CameraSplat { factor: flat, ..splat };
        let normal = flat.x_axis.cross(flat.y_axis).normalize();
        let facing = normal.dot(splat.center.normalize()).abs();
        prop_assume!(facing > 1e-3);
        let footprint = Footprint::new(&splat, &lens).unwrap();
        // A point of the disc and the pixel that sees it.
        let on_disc = DVec2::from_angle(at.1) * at.0;
        let point = splat.center + flat.x_axis * on_disc.x + flat.y_axis * on_disc.y;
        let u = point.truncate() / point.z * lens.focal + lens.principal - footprint.mean;
        let hit = footprint.exact(u);
        within(hit.r, at.0 * at.0, 1e-6 / facing, "r")?;
        within(hit.z, point.z, 1e-6 * point.z, "z")?;
        prop_assert_eq!(hit.sigma_z, 0.0);
    }

    #[test]
    fn conic_is_the_inverse_of_the_projected_covariance(splat in any_splat()) {
        let lens = lens(0.3);
        let footprint = Footprint::new(&splat, &lens).unwrap();
        let d = splat.center;
        let covariance = filtered_covariance(&splat, &lens);
        let rows = [
            DVec3::new(lens.focal.x / d.z, 0.0, -lens.focal.x * d.x / (d.z * d.z)),
            DVec3::new(0.0, lens.focal.y / d.z, -lens.focal.y * d.y / (d.z * d.z)),
        ];
        let v = |i: usize, j: usize| rows[i].dot(covariance * rows[j]);
        let determinant = v(0, 0) * v(1, 1) - v(0, 1) * v(0, 1);
        let [a, b, c] = footprint.conic_root;
        let scale = a * a + b * b + c * c;
        within(a * a, v(1, 1) / determinant, 1e-9 * scale, "Q_xx")?;
        within(a * b, -v(0, 1) / determinant, 1e-9 * scale, "Q_xy")?;
        within(b * b + c * c, v(0, 0) / determinant, 1e-9 * scale, "Q_yy")?;
    }

    #[test]
    fn bounds_never_cut(splat in any_splat(), at in 0.0..TAU, exact in any::<bool>()) {
        let lens = lens(0.3);
        let footprint = Footprint::new(&splat, &lens).unwrap();
        prop_assume!(!footprint.crosses_camera_plane(CUTOFF));
        let [center, half] = footprint.bounds(CUTOFF, exact);
        let r = |u: DVec2| if exact { footprint.exact(u).r } else { footprint.affine(u).r };
        // Walking outwards from the rectangle's border never comes within the cut-off again, and each side
        // is touched: a rectangle 1 % smaller would cut.
        let direction = DVec2::from_angle(at);
        let border = direction * (half / direction.abs()).min_element();
        for step in 0..40 {
            let u = center + border * (1.0 + 1e-9 + 0.05 * f64::from(step)) - footprint.mean;
            prop_assert!(r(u) >= CUTOFF * (1.0 - 1e-6), "r = {} at {step}", r(u));
        }
        for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
            let mut nearest = f64::INFINITY;
            for i in -2000..=2000 {
                let mut u = DVec2::ZERO;
                u[axis] = center[axis] + sign * half[axis] * 0.99 - footprint.mean[axis];
                u[1 - axis] = center[1 - axis] + half[1 - axis] * f64::from(i) / 2000.0 - footprint.mean[1 - axis];
                nearest = nearest.min(r(u));
            }
            prop_assert!(nearest < CUTOFF, "axis {axis} is too wide: r = {nearest}");
        }
    }

    #[test]
    fn orthographic_affine_is_exact(splat in any_splat(), at in (0.0..3.0f64, 0.0..TAU)) {
        // 20 px a unit keeps the filter's share of Σ' far from the inverse's rounding.
        let lens = Lens { projection: Projection::Orthographic, focal: DVec2::new(20.0, 25.0), ..lens(0.3) };
        let footprint = Footprint::new(&splat, &lens).unwrap();
        let [_, half] = footprint.bounds(1.0, true);
        let u = DVec2::from_angle(at.1) * at.0 * half;
        // Where Σ' is nearly singular the brute force is the one that fails.
        let covariance = filtered_covariance(&splat, &lens);
        let size = covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z;
        prop_assume!(covariance.determinant() > 1e-8 * size.powi(3));
        let (expected, expected_integral) = brute_force(&splat, &lens, footprint.mean + u);
        prop_assume!(expected.r < 40.0);
        let tolerance = 1e-6 * (1.0 + expected.r);
        for hit in [footprint.affine(u), footprint.exact(u)] {
            within(hit.r, expected.r, tolerance, "r")?;
            within(hit.z, expected.z, 1e-6 * splat.center.z, "z")?;
            within(hit.sigma_z, expected.sigma_z, 1e-6 * (expected.sigma_z + 1e-3 * splat.center.z), "σ_z")?;
            let found = footprint.unit_integral * hit.scale * (-0.5 * hit.r).exp();
            within(found / expected_integral, 1.0, tolerance, "line integral")?;
        }
    }
}

/// The largest error of a record against its footprint, over random splats of a radius in pixels.
fn record_error(radius_px: f64, edge_on: bool) -> [f64; 3] {
    // A radius of at most a twentieth of the distance: larger kernels cross the camera plane.
    let focal = (20.0 * radius_px).max(1000.0);
    let lens = Lens { focal: DVec2::splat(focal), ..lens(0.3) };
    let mut random = Random(radius_px.to_bits() ^ 0x9e37);
    let (mut worst, mut hits) = ([0.0_f64; 3], 0);
    for _ in 0..3000 {
        let depth = 10.0;
        let center = DVec3::new(random.between(-5.0, 5.0), random.between(-3.0, 3.0), depth);
        let view = center.normalize();
        let mut normal = random.direction();
        if edge_on {
            normal = (normal - view * normal.dot(view) * (1.0 - random.between(0.0, 1e-3))).normalize();
        }
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let radius = radius_px * depth / focal;
        let flattening = [1.0, 3.0, 30.0, 1e3, f64::INFINITY][(random.next() * 5.0) as usize];
        let factor = DMat3::from_cols(tangent * radius, bitangent * radius, normal * radius / flattening);
        let splat = CameraSplat { center, factor };
        let footprint = Footprint::new(&splat, &lens).unwrap();
        assert!(!footprint.crosses_camera_plane(CUTOFF));
        let record = Record::geometry(&footprint, Form::Exact);
        for _ in 0..20 {
            // A point of the kernel, so that thin footprints are met.
            let inside = factor * random.direction() * random.between(0.0, 3.4);
            let seen = center + inside;
            let pixel = seen.truncate() / seen.z * lens.focal
                + lens.principal
                + DVec2::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0));
            let u = pixel - footprint.mean;
            let u = DVec2::new(f64::from(u.x as f32), f64::from(u.y as f32));
            let expected = footprint.exact(u);
            if expected.r > CUTOFF {
                continue;
            }
            hits += 1;
            let found = record.hit(u.x as f32, u.y as f32);
            let kernel = |r: f64, scale: f64| scale * (-0.5 * r).exp();
            let peak = expected.scale.max(1.0);
            let amplitude =
                kernel(f64::from(found.r), f64::from(found.scale)) - kernel(expected.r, expected.scale);
            worst[0] = worst[0].max(amplitude.abs() / peak);
            worst[1] = worst[1].max((f64::from(found.z) - expected.z).abs() / expected.z.abs());
            worst[2] = worst[2].max((f64::from(found.sigma_z) - expected.sigma_z).abs() / expected.z.abs());
        }
    }
    assert!(hits > 10_000, "only {hits} pixels were met");
    worst
}

#[test]
fn single_precision_holds() {
    for (radius, tolerance) in [(1.0, 1e-5), (10.0, 1e-5), (100.0, 1e-5), (1000.0, 1e-3)] {
        for edge_on in [false, true] {
            let worst = record_error(radius, edge_on);
            println!("radius {radius} px, edge-on {edge_on}: kernel, z, σ_z {worst:?}");
            assert!(worst.iter().all(|e| *e <= tolerance), "{radius} px, edge-on {edge_on}: {worst:?}");
        }
    }
}

/// A small generator for tests that need reproducible numbers and percentiles.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    fn direction(&mut self) -> DVec3 {
        let z = self.between(-1.0, 1.0);
        (DVec2::from_angle(self.between(0.0, TAU)) * (1.0 - z * z).sqrt()).extend(z)
    }
}

/// Random splats whose κ is below 0.1 with the measured and the estimated error of the affine form.
fn affine_errors(count: usize) -> Vec<[f64; 4]> {
    let lens = lens(0.0);
    let mut random = Random(7);
    let mut rows = Vec::new();
    while rows.len() < count {
        let direction = DVec3::new(random.between(-1.2, 1.2), random.between(-1.0, 1.0), 1.0);
        let size = 10f64.powf(random.between(-3.0, -0.5));
        let radii =
            DVec3::new(1.0, 10f64.powf(random.between(-1.5, 0.0)), 10f64.powf(random.between(-3.0, 0.0)));
        let axis = random.direction();
        let rotation = DMat3::from_axis_angle(axis, random.between(0.0, PI));
        let splat = CameraSplat { center: direction, factor: rotation * DMat3::from_diagonal(radii * size) };
        let Some(footprint) = Footprint::new(&splat, &lens) else { continue };
        let estimate = footprint.affine_error(true, &lens);
        let kappa_only = footprint.affine_peak_error();
        if kappa_only > 0.1159 || footprint.crosses_camera_plane(36.0) {
            continue;
        }
        // Integrate over the whitened plane: u = M⁻¹ s.
        let [a, b, c] = footprint.conic_root;
        let (mut difference, mut total, mut peak) = (0.0, 0.0, 0.0_f64);
        let center = footprint.center_ray.length();
        const STEPS: i32 = 40;
        for i in -STEPS..STEPS {
            for j in -STEPS..STEPS {
                let s = (DVec2::new(f64::from(i), f64::from(j)) + 0.5) * (5.5 / f64::from(STEPS));
                let y = s.y / c;
                let u = DVec2::new((s.x - b * y) / a, y);
                let (hit, plain) = (footprint.exact(u), footprint.affine(u));
                let affine = (-0.5 * plain.r).exp();
                let alpha = (-0.5 * hit.r).exp();
                let exact = alpha * hit.scale * lens.ray(footprint.mean + u).length() / center;
                difference += (exact - affine).abs();
                total += affine;
                peak = peak.max((alpha - affine).abs());
            }
        }
        rows.push([difference / total, estimate, peak, kappa_only]);
    }
    rows
}

#[test]
fn error_estimates_hold() {
    let rows = affine_errors(10_000);
    let mut shares: Vec<f64> = rows.iter().map(|row| row[0] / row[1]).collect();
    shares.sort_by(f64::total_cmp);
    let at = |share: f64| shares[(share * (shares.len() - 1) as f64) as usize];
    println!("energy share, measured/estimated: median {}, 99 % {}, largest {}", at(0.5), at(0.99), at(1.0));
    assert!(at(0.99) <= 1.0, "the bound holds for 99 %: {}", at(0.99));
    assert!(at(0.5) >= 0.5, "it is not more than twice too careful in the median: {}", at(0.5));

    let mut peaks: Vec<f64> = rows.iter().map(|row| row[2] / row[3]).collect();
    peaks.sort_by(f64::total_cmp);
    println!("peak: {} to {}", peaks[0], peaks[peaks.len() - 1]);
    assert!(peaks[0] >= 0.8 && peaks[peaks.len() - 1] <= 1.05, "{} to {}", peaks[0], peaks[peaks.len() - 1]);
}

#[test]
fn outline_of_a_sphere_is_the_exact_ellipse() {
    // The cone tangent to a sphere of radius R around d: v·d = |v| √(|d|² − R²).
    let lens = lens(0.0);
    let center = DVec3::new(2.0, -1.0, 4.0);
    let (sigma, k) = (0.3, 3.0_f64);
    let splat = CameraSplat { center, factor: DMat3::from_diagonal(DVec3::splat(sigma)) };
    let footprint = Footprint::new(&splat, &lens).unwrap();
    let radius = k * sigma;
    let half_angle = (radius / center.length()).asin();
    let axis = center.normalize();
    let (side, up) = axis.any_orthonormal_pair();
    for i in 0..64 {
        let turn = f64::from(i) * TAU / 64.0;
        let v = axis * half_angle.cos() + (side * turn.cos() + up * turn.sin()) * half_angle.sin();
        let pixel = v.truncate() / v.z * lens.focal + lens.principal;
        let r = footprint.exact(pixel - footprint.mean).r;
        assert!((r - k * k).abs() < 1e-9, "{turn}: r = {r}");
    }
}

#[test]
fn energy_of_one_splat_is_kept_at_every_size() {
    // Σ over pixel centres of τ for mass 1, σ from 1/16 to 16 px, for sub-pixel positions.
    let lens = lens(0.3);
    let depth = 10.0;
    let gain = 1.0 / (1.0 - (-0.5 * CUTOFF).exp());
    let mut worst = 0.0_f64;
    for step in 0..=16 {
        let sigma_px = 2f64.powf(f64::from(step) / 2.0 - 4.0);
        for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
            let pixel = DVec2::new(512.0 + f64::from(i) / 4.0, 384.0 + f64::from(j) / 4.0);
            let center = ((pixel - lens.principal) / lens.focal).extend(1.0) * depth;
            let sigma =
                DVec3::new(sigma_px / lens.focal.x, sigma_px / lens.focal.y, sigma_px / 1000.0) * depth;
            let splat = CameraSplat { center, factor: DMat3::from_diagonal(sigma) };
            let footprint = Footprint::new(&splat, &lens).unwrap();
            let [middle, half] = footprint.bounds(CUTOFF, false);
            let (low, high) = ((middle - half).floor(), (middle + half).ceil());
            let mut sum = 0.0;
            for y in low.y as i32..=high.y as i32 {
                for x in low.x as i32..=high.x as i32 {
                    let hit = footprint.affine(DVec2::new(f64::from(x), f64::from(y)) + 0.5 - footprint.mean);
                    if hit.r <= CUTOFF {
                        sum += footprint.unit_integral
                            * footprint.center_ray.length()
                            * gain
                            * (-0.5 * hit.r).exp();
                    }
                }
            }
            let expected = footprint.center_ray.length() * lens.focal.x * lens.focal.y / (depth * depth);
            worst = worst.max((sum / expected - 1.0).abs());
        }
    }
    println!("largest error of the pixel sum: {worst}");
    assert!(worst <= 0.012, "{worst}");
}

#[test]
fn kernels_around_the_camera_plane_stay_finite_and_right() {
    let lens = lens(0.3);
    let sigma = 0.5;
    let passing = (-60..=20).map(|step| DVec3::new(0.3, 0.2, f64::from(step) / 20.0));
    for center in passing.chain([DVec3::ZERO, DVec3::new(0.0, 0.0, 1e-30)]) {
        let splat = CameraSplat { center, factor: DMat3::from_diagonal(DVec3::splat(sigma)) };
        let Some(footprint) = Footprint::new(&splat, &lens) else { panic!("lost at {center}") };
        for pixel in [DVec2::new(512.0, 384.0), DVec2::new(10.0, 700.0), DVec2::new(1000.0, 3.0)] {
            let record = Record::geometry(&footprint, Form::Exact);
            let u = pixel - footprint.mean;
            let found = record.hit(u.x as f32, u.y as f32);
            let v = lens.ray(pixel);
            // The filter is far below a pixel's share of such a kernel: plain geometry is the answer.
            let z = v.dot(center) / v.length_squared();
            let r = (v * z - center).length_squared() / (sigma * sigma);
            let kernel = |r: f64| (-0.5 * r).exp();
            // The move off the camera plane is 3e-4 σ, 1.8e-4 of the peak; f32 loses u ≈ 1e6 px · 6e-8 nearby.
            assert!(
                (kernel(f64::from(found.r)) - kernel(r)).abs() < 2e-3,
                "kernel at {center}, {pixel}: r = {} instead of {r}",
                found.r
            );
            assert!((f64::from(found.z) - z).abs() < 2e-3 * sigma, "z at {center}: {} for {z}", found.z);
        }
    }
}
