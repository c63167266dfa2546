//! The wide projection against its specification, splat by splat.

use super::*;
use crate::camera::{Pose, Projection};
use crate::cloud::{Cloud, Harmonics, Material, Shapes, Splats, Strength, Surface};
use crate::columns::LANES;
use crate::scene::{Blend, FootprintForm};
use glam::{DAffine3, DMat3, DVec2, DVec3, Vec3};
use proptest::prelude::*;

/// Roundings of single precision that one number goes through, at most, times their size.
const EPSILON: f64 = 16.0 * 6e-8;

/// A splat as the camera sees it.
#[derive(Clone, Debug)]
struct Seen {
    /// From the middle of the picture, 1 at its border.
    place: [f64; 2],
    log_depth: f64,
    log_pixels: f64,
    /// Its longer half-axis over the other.
    stretch: f64,
    /// The shorter half-axis over the thickness.
    flattening: f64,
    normal: [f64; 3],
    edge_on: bool,
    strength: f32,
    color: [f32; 3],
    shading: [f32; 3],
}

fn seen() -> impl Strategy<Value = Seen> {
    let place = prop::array::uniform2(prop_oneof![4 => -1.0..1.0, 1 => 0.9..1.3, 1 => -1.3..-0.9]);
    let sizes = (0.0..3.0, -4.6..5.7, prop_oneof![Just(1.0), 1.0..20.0]);
    let flattening = prop_oneof![Just(1.0), 1.0..30.0, Just(f64::INFINITY)];
    let directions = (prop::array::uniform3(-1.0..1.0), any::<bool>());
    let looks = (
        prop_oneof![8 => 0.001..1.0_f32, 1 => Just(0.0_f32)],
        prop::array::uniform3(0.0..1.0_f32),
        prop::array::uniform3(-1.0..1.0_f32),
    );
    (place, sizes, flattening, directions, looks).prop_map(
        |(
            place,
            (log_depth, log_pixels, stretch),
            flattening,
            (normal, edge_on),
            (strength, color, shading),
        )| {
            Seen {
                place,
                log_depth,
                log_pixels,
                stretch,
                flattening,
                normal,
                edge_on,
                strength,
                color,
                shading,
            }
        },
    )
}

#[derive(Clone, Debug)]
struct Setup {
    projection: Projection,
    kind: usize,
    shared: bool,
    transform: usize,
    degree: u8,
    near: f64,
    settings: RenderSettings,
}

fn setup() -> impl Strategy<Value = Setup> {
    let projection = prop_oneof![3 => Just(Projection::Perspective), 1 => Just(Projection::Orthographic)];
    let forms = prop_oneof![
        2 => Just(FootprintForm::Auto),
        1 => Just(FootprintForm::Affine),
        1 => Just(FootprintForm::Exact)
    ];
    let blend = prop_oneof![Just(Blend::Linear), Just(Blend::Display)];
    let filters = prop_oneof![1 => Just(0.0), 3 => Just(0.3), 1 => Just(1.0)];
    let tolerances = prop_oneof![Just(1.0 / 255.0), Just(0.05), Just(1e-4)];
    (
        (projection, 0..4_usize, any::<bool>(), 0..4_usize, 0..4_u8, prop_oneof![Just(0.0), Just(2.0)]),
        (forms, blend, filters, tolerances, any::<bool>()),
    )
        .prop_map(
            |(
                (projection, kind, shared, transform, degree, near),
                (footprint, blend, low_pass, tolerance, shade),
            )| {
                let settings = RenderSettings {
                    footprint,
                    blend,
                    low_pass,
                    tolerance,
                    shade,
                    ..RenderSettings::default()
                };
                Setup { projection, kind, shared, transform, degree, near, settings }
            },
        )
}

/// Even, moved, mirrored and larger, stretched unevenly.
fn transform(number: usize) -> DAffine3 {
    let turned = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-1.1);
    match number {
        0 => DAffine3::IDENTITY,
        1 => DAffine3::from_mat3_translation(turned, DVec3::new(3.0, -2.0, 5.0)),
        2 => DAffine3::from_mat3(turned * DMat3::from_diagonal(DVec3::new(-2.5, 2.5, 2.5))),
        _ => DAffine3::from_mat3(turned * DMat3::from_diagonal(DVec3::new(0.5, 2.0, 1.3))),
    }
}

const SIZE: [u32; 2] = [200, 144];

fn camera(setup: &Setup) -> Camera {
    let pose = Pose::look_at(DVec3::new(4.0, -3.0, 2.0), DVec3::new(1.0, 2.0, 0.5), DVec3::Z).unwrap();
    let camera = match setup.projection {
        Projection::Perspective => Camera::perspective(pose, 0.9, SIZE),
        Projection::Orthographic => Camera::orthographic(pose, 6.0, SIZE),
    };
    camera.unwrap().with_near(setup.near).unwrap()
}

/// Centre and half-axes in camera space.
fn placed(seen: &Seen, camera: &Camera) -> CameraSplat {
    let focal = camera.intrinsics().focal.x;
    let slope = DVec2::from(seen.place) * DVec2::new(100.0, 72.0) / focal;
    let z = seen.log_depth.exp();
    let perspective = camera.projection() == Projection::Perspective;
    let (center, ray) =
        if perspective { (slope.extend(1.0) * z, slope.extend(1.0)) } else { (slope.extend(z), DVec3::Z) };
    let radius = seen.log_pixels.exp() * camera.pixel_width_at(z);
    let normal = DVec3::from(seen.normal).try_normalize().unwrap_or(DVec3::Z);
    let normal = if seen.edge_on { normal.cross(ray).try_normalize().unwrap_or(DVec3::X) } else { normal };
    let tangent = normal.any_orthonormal_vector();
    let thickness = radius / seen.stretch / seen.flattening;
    let across = normal.cross(tangent) * (radius / seen.stretch);
    CameraSplat { center, factor: DMat3::from_cols(tangent * radius, across, normal * thickness) }
}

fn cloud(setup: &Setup, splats: &[Seen], camera: &Camera) -> Cloud {
    let place = transform(setup.transform);
    let from_camera = (camera.pose().world_to_camera * place).inverse();
    let seen: Vec<CameraSplat> = splats.iter().map(|seen| placed(seen, camera)).collect();
    let factor = |splat: &CameraSplat| {
        let mut factor = (from_camera.matrix3 * splat.factor).as_mat3();
        if from_camera.matrix3.determinant() < 0.0 {
            factor.z_axis = -factor.z_axis;
        }
        factor
    };
    let strengths: Vec<f32> = splats.iter().map(|seen| seen.strength).collect();
    let strength = match setup.kind {
        0 => Strength::Extinction { masses: strengths },
        1 => Strength::Opacity { peaks: strengths },
        kind => Strength::Surface(Surface {
            areas: strengths.clone(),
            opacities: Some(strengths),
            depth_tolerance: 0.1,
            coverage_floor: 0.9,
            closed: kind == 3,
        }),
    };
    let per_splat = Harmonics::count(setup.degree);
    let harmonics = (setup.degree > 0).then(|| Harmonics {
        degree: setup.degree,
        coefficients: (0..splats.len() * per_splat)
            .map(|i| [0.3, 0.5, 0.7].map(|k| ((i as f32 + 1.0) * k).sin() * 0.3))
            .collect(),
    });
    let shading = |seen: &Seen| Vec3::from(seen.shading).normalize_or_zero();
    Cloud::new(Splats {
        centers: seen.iter().map(|splat| from_camera.transform_point3(splat.center).as_vec3()).collect(),
        shapes: if setup.shared {
            Shapes::Shared(factor(&seen[0]))
        } else {
            Shapes::Each(seen.iter().map(factor).collect())
        },
        strength,
        colors: splats.iter().map(|seen| seen.color).collect(),
        harmonics,
        normals: Some(splats.iter().map(shading).collect()),
        material: Material::default(),
    })
    .unwrap()
    .transformed(place)
}

/// The splats that the wide projection shows, each at its number.
fn wide(level: Level, projector: &Projector, middle: Vec3, is_surface: bool) -> Vec<Option<Projected>> {
    let wide = WideProjector::new(projector);
    let mut before = 0;
    (1..=projector.cloud.len())
        .map(|count| {
            // The splats up to this one: if there is one more than without it, it is the last.
            let (mut records, mut rects) = (vec![Record::BLANK; LANES], vec![Rect::default(); LANES]);
            let keys: Vec<AtomicU64> = (0..LANES).map(|_| AtomicU64::new(0)).collect();
            let mut samples = vec![SurfaceSample::default(); LANES];
            let run = Run { start: 0, len: 0, keys: [u32::MAX, 0] };
            let mut places =
                Places { records: &mut records, rects: &mut rects, keys: &keys, samples: &mut samples, run };
            let range = VisibleRange {
                cloud: 0,
                splats: 0..count,
                first_id: 0,
                center: middle,
                distances: [0.0, f32::INFINITY],
                is_surface,
            };
            wide.project(level, &range, &mut places);
            let len = places.run.len;
            let is_new = len > std::mem::replace(&mut before, len);
            is_new.then(|| {
                let bits = (keys[len - 1].load(Ordering::Relaxed) >> 32) as u32;
                let distance = f32::from_bits(if bits >> 31 == 0 { !bits } else { bits & !(1 << 31) });
                Projected {
                    record: records[len - 1],
                    rect: rects[len - 1],
                    distance,
                    sample: samples[len - 1],
                }
            })
        })
        .collect()
}

/// How far single precision may be from double, for one splat.
struct Bounds {
    /// Camera-space lengths.
    position: f64,
    mean: f64,
    /// Half-axes in pixels.
    axis: f64,
    /// Relative, of b relative to a.
    root: [f64; 3],
    slope: f64,
    sigma: f64,
    /// Of the line integral, relative; of a filter's attenuation, in itself.
    integral: f64,
    attenuation: f64,
    /// Relative, of the squared longest half-axis and √|V|.
    curvature: f64,
}

impl Bounds {
    /// With V = Σvvᵀ + h² the covariance in pixels, S = √|V|, T² its trace, Z the spread along z, and e the error of
    /// a component of v: S is the length of the vector (nᵢⱼ, h vᵢ, h²), hence off by at most 2√3 T e + √6 h e, and so
    /// on for each root of a sum of squares; V⁻¹s is off by what its numerator is, 2√3 Te·2TZ + 4SeZ + 2h²eZ, over S².
    fn new(splat: &CameraSplat, footprint: &Footprint, lens: &Lens, extent: f64) -> Self {
        let perspective = lens.projection == Projection::Perspective;
        let focal = lens.focal.x;
        let (ray, zeta, ratio) = if perspective {
            (footprint.center_ray.length(), splat.center.z.abs(), extent / splat.center.z.abs())
        } else {
            (0.0, 1.0, 1.0)
        };
        let h = lens.low_pass;
        let largest = (0..3).map(|i| splat.factor.col(i).length()).fold(0.0, f64::max);
        let spread = splat.factor.row(2).length();
        let e = EPSILON * largest * (1.0 + ray) * focal / zeta * ratio;
        let [a, b, c] = footprint.conic_root;
        let s = 1.0 / (a * c);
        let root_y = 1.0 / c;
        let t = (root_y * root_y + (b * b + c * c) * s * s).sqrt();
        let of_y = 2.0 * e / root_y + EPSILON;
        let of_s = e * (3.5 * t + 2.5 * h) / s + EPSILON;
        let numerator = spread * e * (7.0 * t * t + 4.0 * s + 2.0 * h * h);
        let slope = numerator / (s * s) + footprint.depth_slope.length() * (2.0 * of_s + EPSILON);
        let volume = spread * (3.5 * t * e + 4.0 * h * e + EPSILON * (h * h + s));
        Self {
            position: EPSILON * extent,
            mean: EPSILON * (focal * (1.0 + ray) * ratio * if perspective { 1.0 } else { extent } + 200.0),
            axis: 2.0 * e,
            root: [of_y + of_s, (2.5 * t * e * c / s) / a + (of_y + of_s) * (b / a).abs(), of_y],
            slope,
            sigma: volume / s + footprint.sigma_z * (of_s + EPSILON),
            integral: of_s + 2.0 * EPSILON * ratio * (1.0 + ray),
            attenuation: 3.5 * t * e / s + of_s,
            curvature: spread * t * slope / (zeta * zeta),
        }
    }
}

fn check(setup: &Setup, splats: &[Seen]) -> Result<(), TestCaseError> {
    let camera = camera(setup);
    let cloud = cloud(setup, splats, &camera);
    let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
    let shaders = [Shader::new(&scene, &camera, Material::default())];
    let view = SceneView {
        scene: &scene,
        camera: &camera,
        settings: &setup.settings,
        shaders: &shaders,
        level: Level::Baseline,
    };
    let projector = view.projector(0);
    let cloud = projector.cloud;
    let middle = (0..cloud.len()).map(|i| cloud.center(i)).sum::<Vec3>() / cloud.len() as f32;
    let is_surface = setup.kind >= 2;
    let scale =
        projector.cloud_to_camera.matrix3.to_cols_array().iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
        for (index, found) in wide(level, &projector, middle, is_surface).iter().enumerate() {
            let splat = CameraSplat {
                center: projector.cloud_to_camera.transform_point3(cloud.center(index).as_dvec3()),
                factor: projector.cloud_to_camera.matrix3 * cloud.factor(index).as_dmat3(),
            };
            // What is rounded on the way to the centre.
            let from_middle = f64::from((cloud.center(index) - middle).length()) * scale;
            let extent =
                splat.center.length() + from_middle + f64::from(cloud.center(index).length()) * scale;
            let expected = projector.project_splat(index, 0);
            compare(&(setup, &projector, splat, extent), index, found.as_ref(), expected.as_ref())
                .map_err(|error| TestCaseError::fail(format!("{level:?}, splat {index}: {error}")))?;
        }
    }
    Ok(())
}

/// Names what differs by more than it may.
fn compare(
    (setup, projector, splat, extent): &(&Setup, &Projector, CameraSplat, f64),
    index: usize,
    found: Option<&Projected>,
    expected: Option<&Projected>,
) -> Result<(), String> {
    let (lens, settings) = (&projector.view.lens, &setup.settings);
    let Some(footprint) = Footprint::new(splat, lens) else {
        return if found.is_none() { Ok(()) } else { Err("shows what has no area".to_owned()) };
    };
    let bounds = Bounds::new(splat, &footprint, lens, *extent);
    let perspective = lens.projection == Projection::Perspective;
    let (Some(a), Some(b)) = (found, expected) else {
        let Some(only) = found.or(expected) else { return Ok(()) };
        // One alone: where its rectangle is next to empty, it ends at the near plane, or it is seen edge-on.
        let is_slim = (0..2).any(|axis| only.rect.max[axis] - only.rect.min[axis] <= 1);
        let end = footprint.depth_range(settings.cutoff)[1] - projector.view.camera.near();
        let ends_at_near = end.abs() <= 2.0 * bounds.position + EPSILON * extent;
        let normal = (projector.normal_to_camera * scalar_normal(projector, index)).normalize_or_zero();
        let ray = if perspective { footprint.center_ray } else { DVec3::Z };
        let is_edge_on = setup.kind == 3
            && normal.dot(ray).abs()
                <= EPSILON * 2.0 * ray.length() * extent / splat.center.z.abs().min(*extent);
        let is_faint = setup.kind == 1
            && f64::from(only.record.amplitude) <= settings.tolerance + bounds.attenuation + EPSILON;
        let is_next_to_nothing = f64::from(only.record.amplitude).abs() < 1e-30;
        if is_slim || ends_at_near || is_edge_on || is_faint || is_next_to_nothing {
            return Ok(());
        }
        let side = if found.is_some() { "the wide" } else { "the scalar" };
        return Err(format!("only {side} projection shows {:?}, {:?}", only.record, only.rect));
    };
    let (x, y) = (&a.record, &b.record);
    let close = |what: &str, x: f32, y: f32, bound: f64| {
        let error = (f64::from(x) - f64::from(y)).abs();
        let bound = bound + EPSILON * f64::from(y).abs();
        if error <= bound {
            Ok(())
        } else {
            Err(format!("{what}: {x:e} for {y:e}, off by {error:.2e}, bound {bound:.2e}"))
        }
    };
    for axis in 0..2 {
        close("mean", x.mean[axis], y.mean[axis], bounds.mean)?;
        close("depth slope", x.depth_slope[axis], y.depth_slope[axis], bounds.slope)?;
    }
    for i in 0..3 {
        let unit = if i == 1 { x.conic_root[0] } else { y.conic_root[i] };
        close("conic root", x.conic_root[i], y.conic_root[i], bounds.root[i] * f64::from(unit))?;
    }
    close("depth", x.depth, y.depth, bounds.position)?;
    close("σ_z", x.sigma_z, y.sigma_z, bounds.sigma)?;
    close("distance", a.distance, b.distance, bounds.position)?;
    if x.tag.form != y.tag.form {
        // Both forms are right where the estimate meets its share of the tolerance.
        let error = footprint.affine_error(setup.kind == 0, lens);
        let slack = 0.01 * error + 2.0 * bounds.curvature.sqrt() + bounds.curvature + EPSILON;
        let off = (error - settings.tolerance / 4.0).abs();
        return if off <= slack {
            Ok(())
        } else {
            Err(format!("{:?} for {:?} at an error of {error:e}", x.tag, y.tag))
        };
    }
    if x.tag != y.tag {
        return Err(format!("{:?} for {:?}", x.tag, y.tag));
    }
    let coverage = f64::from(y.amplitude.abs()).max(
        f64::from(Vec3::from([y.amplitude_slope[0], y.amplitude_slope[1], 0.0]).length()) * lens.focal.x,
    );
    let ratio = if perspective { extent / splat.center.z.abs() } else { 1.0 };
    let amplitude = match setup.kind {
        1 => bounds.attenuation + EPSILON,
        _ => coverage * (bounds.integral + EPSILON * 2.0 * ratio * footprint.center_ray.length()),
    };
    close("amplitude", x.amplitude, y.amplitude, amplitude)?;
    for axis in 0..2 {
        close("amplitude slope", x.amplitude_slope[axis], y.amplitude_slope[axis], amplitude / lens.focal.x)?;
    }
    compare_looks(setup, projector, (splat, index, *extent), (a, b))?;
    compare_rects(setup, (&footprint, &bounds, ratio), (a, b))
}

fn scalar_normal(projector: &Projector, index: usize) -> DVec3 {
    let factor = projector.cloud.factor(index).as_dmat3();
    factor.x_axis.cross(factor.y_axis)
}

/// A direction is off by some roundings of what it is the difference of; a function of degree 3 changes by at most 6 a
/// unit, the curve of sRGB by at most 13, a highlight of exponent 20 by as much.
fn compare_looks(
    setup: &Setup,
    projector: &Projector,
    (splat, index, extent): (&CameraSplat, usize, f64),
    (a, b): (&Projected, &Projected),
) -> Result<(), String> {
    let normal = projector.cloud.columns().normal(index).as_dvec3();
    let normal = (projector.normal_to_camera * normal).normalize_or_zero();
    let own = (projector.normal_to_camera * scalar_normal(projector, index)).normalize_or_zero();
    let to_eye =
        if setup.projection == Projection::Perspective { -splat.center.normalize() } else { -DVec3::Z };
    let bound = 20.0 * EPSILON * (1.0 + 15.0 * 0.3) * extent / splat.center.length().min(extent);
    let turns = if setup.kind >= 2 { normal.dot(own) } else { normal.dot(to_eye) };
    if turns.abs() < 1e-4 && normal != DVec3::ZERO {
        // Either side may be the one that is seen.
        return Ok(());
    }
    for channel in 0..3 {
        let (x, y) = (a.record.color[channel], b.record.color[channel]);
        if f64::from((x - y).abs()) > bound * f64::from(1.0 + y.abs()) {
            return Err(format!("colour {:?} for {:?}, bound {bound:.2e}", a.record.color, b.record.color));
        }
    }
    if setup.kind < 2 {
        // Volumes have no samples.
        return Ok(());
    }
    let (x, y) = (Vec3::from(a.sample.normal), Vec3::from(b.sample.normal));
    if f64::from(x.distance(y)) > 4.0 * EPSILON
        || a.sample.opacity != b.sample.opacity
        || a.sample.id != b.sample.id
    {
        return Err(format!("{:?} for {:?}", a.sample, b.sample));
    }
    Ok(())
}

/// Rectangles differ by a pixel, or by what the exact form makes of rounding where the kernel nears the camera plane.
fn compare_rects(
    setup: &Setup,
    (footprint, bounds, ratio): (&Footprint, &Bounds, f64),
    (a, b): (&Projected, &Projected),
) -> Result<(), String> {
    let mut cutoff = setup.settings.cutoff;
    if setup.kind == 1 {
        cutoff = cutoff.min(2.0 * (f64::from(b.record.amplitude) / setup.settings.tolerance).ln()).max(0.0);
    }
    let exact = b.record.tag.form == Form::Exact;
    let [_, half] = footprint.bounds(cutoff, exact);
    if !half.is_finite() {
        return if a.rect == b.rect { Ok(()) } else { Err(format!("{:?} for {:?}", a.rect, b.rect)) };
    }
    let near = footprint.depth_range(cutoff);
    let reach = (near[1] - near[0]) * 0.5 * footprint.inverse_depth;
    let widening = if exact { 1.0 / (1.0 - reach * reach) } else { 1.0 };
    // A cut-off that nears 0 moves by as much as its peak does.
    let of_cutoff = if setup.kind == 1 {
        2.0 * bounds.attenuation / f64::from(b.record.amplitude) + EPSILON
    } else {
        0.0
    };
    for axis in 0..2 {
        let root = half[axis];
        let of_half = bounds.axis * cutoff.sqrt()
            + root * EPSILON
            + (half[axis].powi(2) * of_cutoff / cutoff.max(1e-9)).sqrt();
        let slack =
            bounds.mean + widening * (of_half + half[axis] * EPSILON * ratio * widening * (1.0 + reach));
        let slack = if exact { slack + widening * root.sqrt() * bounds.axis.sqrt() } else { slack };
        let allowed = 1 + slack.min(1e6) as i32;
        for (x, y) in [(a.rect.min, b.rect.min), (a.rect.max, b.rect.max)] {
            if (i32::from(x[axis]) - i32::from(y[axis])).abs() > allowed {
                return Err(format!("{:?} for {:?}, {allowed} pixels allowed", a.rect, b.rect));
            }
        }
    }
    Ok(())
}

#[test]
fn what_is_fainter_than_the_tolerance_is_not_drawn() {
    let setup = Setup {
        projection: Projection::Perspective,
        kind: 1,
        shared: false,
        transform: 0,
        degree: 0,
        near: 0.0,
        settings: RenderSettings { tolerance: 0.05, ..RenderSettings::default() },
    };
    let splat = Seen {
        place: [0.0; 2],
        log_depth: 0.0,
        log_pixels: 0.0,
        stretch: 1.0,
        flattening: 1.0,
        normal: [0.0; 3],
        edge_on: false,
        strength: 0.001,
        color: [0.5; 3],
        shading: [0.0; 3],
    };
    let camera = camera(&setup);
    let scene = Scene { clouds: vec![cloud(&setup, &[splat], &camera)], lights: Vec::new() };
    let shaders = [Shader::new(&scene, &camera, Material::default())];
    let settings = &setup.settings;
    let view =
        SceneView { scene: &scene, camera: &camera, settings, shaders: &shaders, level: Level::Baseline };
    let projector = view.projector(0);
    let middle = projector.cloud.center(0);
    assert!(wide(Level::Baseline, &projector, middle, false)[0].is_none(), "the wide projection shows it");
    if let Some(shown) = projector.project_splat(0, 0) {
        panic!("the scalar projection shows it in {:?}", shown.rect);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn eight_splats_are_projected_as_one_is(setup in setup(), splats in prop::collection::vec(seen(), 1..=LANES)) {
        check(&setup, &splats)?;
    }
}
