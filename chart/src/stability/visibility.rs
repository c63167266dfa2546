//! Case 12: which surface is seen.

use super::setups::*;
use super::{Case, Findings, step_edge};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DVec2, DVec3, Mat3, Vec3};
use oblate_engine::{Camera, Cloud, FootprintForm, Frame, Pose, ReferenceKind, RenderSettings, Strength};
use oblate_surfels::{Density, Mesh, SamplerSettings, primitives, sample};

pub(super) const CASE: Case = Case {
    number: 12,
    title: "Which surface is seen",
    criterion: "Of two parallel sheets the back one shows through by at most 1/255 where it is two or more surfel radii behind, tilted by up to 88°; the front one lets at most 1/255 through. A closed surface has no hole pixel from a quarter of a pixel a surfel to sixteen. A disc on its edge is drawn as the sliver that it is. A depth image with a step, seen from beside, shows what it has seen and nothing else, but for two pixels along the edges.",
    run,
};

const SIZE: u32 = 16;
/// Between surfels; a pixel is 1 wide.
const SPACING: f32 = 1.5;
const RADIUS: f64 = 0.8 * SPACING as f64;
const CUTOFF: f64 = 12.25;

/// A sheet that fills the picture when it is tilted about the x axis, so many radii behind along its normal, in surfels
/// `spacing` apart.
fn sheet(degrees: f64, radii: f64, spacing: f32, color: [f32; 3]) -> Cloud {
    let tilt = Mat3::from_rotation_x(degrees.to_radians() as f32);
    let behind = (radii * 0.8) as f32 * spacing;
    // No border is seen.
    let reach = |length: f32| (length / spacing).ceil() as i32 + 6;
    let half = SIZE as f32 / 2.0 + 4.0;
    let (across, along) = (reach(half), reach((half + behind) / degrees.to_radians().cos() as f32));
    let points: Vec<_> = (-along..=along)
        .flat_map(|j| (-across..=across).map(move |i| Vec3::new(i as f32, j as f32, 0.0) * spacing))
        .map(|p| (tilt * (p + Vec3::Z * behind), tilt * Vec3::NEG_Z))
        .collect();
    surfels(&points, spacing * spacing, color)
}

fn parallel(height: f64, size: u32) -> Camera {
    let pose = Pose::look_at(DVec3::NEG_Z * 2000.0, DVec3::ZERO, DVec3::Y).expect("it looks ahead");
    Camera::orthographic(pose, height, [size; 2]).expect("the height is in range")
}

/// What a pixel of others has: red, green and coverage.
type Sums = [f64; 3];

/// Surface splatting in passes, in f64: the nearest centre of the splats that reach a pixel and ε, then all that is not
/// farther, divided by their weights where there is more than one; without a depth, all that there is. Surfels lie where their centres do.
/// Botsch, Hornung, Zwicker, Kobbelt, *High-Quality Surface Splatting on Today's GPUs*, 2005.
fn passes(clouds: &[Cloud], camera: &Camera, epsilon: Option<f64>) -> Vec<Sums> {
    let size = camera.size()[0] as usize;
    let focal = camera.intrinsics().focal.x;
    let mut fragments: Vec<Vec<(f64, f64, [f32; 3])>> = vec![Vec::new(); size * size];
    for cloud in clouds {
        let splats = cloud.splats();
        let Strength::Surface(surface) = &splats.strength else { continue };
        for (i, center) in splats.centers.iter().enumerate() {
            let to_camera = camera.pose().world_to_camera;
            let at = to_camera.transform_point3(cloud.cloud_to_world().transform_point3(center.as_dvec3()));
            let factor = (to_camera.matrix3 * splats.shapes.factor(i).as_dmat3()) * focal;
            let [a, b] = [factor.x_axis, factor.y_axis];
            let [xx, xy, yy] = [a.x * a.x + b.x * b.x, a.x * a.y + b.x * b.y, a.y * a.y + b.y * b.y];
            let (xx, yy) = (xx + 0.3, yy + 0.3);
            let determinant = xx * yy - xy * xy;
            let facing = a.cross(b).normalize().z.abs();
            let peak = f64::from(surface.areas[i]) * focal * focal * facing
                / (std::f64::consts::TAU * determinant.sqrt());
            let mean = at.truncate() * focal + camera.intrinsics().center;
            let half = DVec2::new(xx, yy).map(|v| (CUTOFF * v).sqrt());
            let range = |low: f64, high: f64| {
                (low - 0.5).ceil().max(0.0) as usize
                    ..((high - 0.5).floor() + 1.0).clamp(0.0, size as f64) as usize
            };
            for y in range(mean.y - half.y, mean.y + half.y) {
                for x in range(mean.x - half.x, mean.x + half.x) {
                    let u = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - mean;
                    let r = (yy * u.x * u.x - 2.0 * xy * u.x * u.y + xx * u.y * u.y) / determinant;
                    if r <= CUTOFF {
                        fragments[y * size + x].push((at.z, peak * (-0.5 * r).exp(), splats.colors[i]));
                    }
                }
            }
        }
    }
    let pixel = |fragments: Vec<(f64, f64, [f32; 3])>| {
        let first = fragments.iter().map(|f| f.0).fold(f64::INFINITY, f64::min);
        let limit = epsilon.map_or(f64::INFINITY, |epsilon| first + epsilon);
        let mut sums = [0.0; 3];
        for (_, weight, [red, green, _]) in fragments.iter().filter(|f| f.0 <= limit) {
            sums[0] += weight * f64::from(*red);
            sums[1] += weight * f64::from(*green);
            sums[2] += weight;
        }
        sums.map(|sum| sum / sums[2].max(1.0))
    };
    fragments.into_iter().map(pixel).collect()
}

fn ours(clouds: &[Cloud], camera: &Camera, settings: &RenderSettings) -> Vec<Sums> {
    let frame = draw(&scene(clouds.to_vec()), camera, settings);
    frame.color.iter().map(|c| [0, 1, 3].map(|i| f64::from(c[i]))).collect()
}

/// Ways to draw surfels: by the engine, or in passes with an ε in radii.
#[derive(Clone, Copy)]
enum Way {
    Engine(RenderSettings),
    Passes(f64),
    Blending,
}

impl Way {
    fn draw(&self, clouds: &[Cloud], camera: &Camera) -> Vec<Sums> {
        match self {
            Self::Engine(settings) => ours(clouds, camera, settings),
            Self::Passes(radii) => passes(clouds, camera, Some(radii * RADIUS)),
            Self::Blending => passes(clouds, camera, None),
        }
    }
}

fn leak(way: &Way, degrees: f64, radii: f64) -> f64 {
    let clouds =
        [sheet(degrees, 0.0, SPACING, [1.0, 0.0, 0.0]), sheet(degrees, radii, SPACING, [0.0, 1.0, 0.0])];
    largest(way.draw(&clouds, &parallel(SIZE.into(), SIZE)).iter().map(|sums| sums[1])).max(FLOOR)
}

fn hole(way: &Way, degrees: f64) -> f64 {
    let clouds = [sheet(degrees, 0.0, SPACING, [1.0, 0.0, 0.0])];
    largest(way.draw(&clouds, &parallel(SIZE.into(), SIZE)).iter().map(|sums| 1.0 - sums[2])).max(FLOOR)
}

/// The share of pixels within a sphere's outline, three pixels from it, that let more than 1/255 through, where `zoom` pixels
/// are a surfel's spacing.
fn holes(sphere: &Cloud, zoom: f64, covered: impl Fn(&[Cloud], &Camera) -> Vec<f64>) -> [f64; 2] {
    let spacing = (4.0 * std::f64::consts::PI / sphere.len() as f64).sqrt();
    let pixel = spacing / zoom;
    let size = (2.0 / pixel).ceil() as u32 + 4;
    let camera = parallel(f64::from(size) * pixel, size);
    let alphas = covered(std::slice::from_ref(sphere), &camera);
    let middle = f64::from(size) / 2.0;
    let is_inside = |i: usize| {
        let at = DVec2::new((i % size as usize) as f64, (i / size as usize) as f64) + 0.5 - middle;
        at.length() < 1.0 / pixel - 3.0
    };
    let inside: Vec<f64> = (0..alphas.len()).filter(|i| is_inside(*i)).map(|i| alphas[i]).collect();
    let open = inside.iter().filter(|alpha| **alpha < 1.0 - LEVEL).count();
    [zoom, open as f64 / inside.len().max(1) as f64]
}

/// Points drawn as squares of 3×3 pixels.
fn squares(clouds: &[Cloud], camera: &Camera) -> Vec<f64> {
    let size = camera.size()[0] as i32;
    let mut covered = vec![0.0; (size * size) as usize];
    for center in clouds.iter().flat_map(|cloud| cloud.splats().centers) {
        let p = camera.pose().world_to_camera.transform_point3(center.as_dvec3()).truncate();
        let at = (p * camera.intrinsics().focal.x + camera.intrinsics().center).floor().as_ivec2();
        for (x, y) in (-1..2).flat_map(|y| (-1..2).map(move |x| (at.x + x, at.y + y))) {
            if (0..size).contains(&x) && (0..size).contains(&y) {
                covered[(y * size + x) as usize] = 1.0;
            }
        }
    }
    covered
}

/// A disc of σ = 2 px, turned by degrees: how much more of it is drawn than R1 has, in shares of its area seen from the front.
/// With `floor` it is never smaller than σ = √½ px, as in Huang, Yu, Chen, Geiger, Gao, *2D Gaussian Splatting for
/// Geometrically Accurate Radiance Fields*, 2024.
fn too_much(degrees: f64, settings: Option<&RenderSettings>) -> f64 {
    let normal = Mat3::from_rotation_x(degrees.to_radians() as f32) * Vec3::NEG_Z;
    let (radius, camera) = (2.0_f64, parallel(40.0, 40));
    let area = (radius / 0.8).powi(2);
    let disc = scene(vec![surfels(&[(Vec3::new(0.2, 0.3, 0.0), normal)], area as f32, [1.0; 3])]);
    let sum = |frame: Frame| alphas(&frame).iter().sum::<f64>();
    let expected = sum(truth(&disc, &camera, &unshaded(), ReferenceKind::R1));
    let found = settings.map_or_else(
        || {
            let cos = degrees.to_radians().cos().abs().max(1e-12);
            let pixel = |i: u32| {
                let u = DVec2::new(f64::from(i % 40), f64::from(i / 40)) + 0.5 - DVec2::new(20.2, 19.7);
                let on_disc = (u.x * u.x + (u.y / cos).powi(2)) / (radius * radius);
                (-0.5 * on_disc.min(2.0 * u.length_squared())).exp()
            };
            // Its weights at the front are peaks of 1 where ours are areas.
            (0..1600).map(pixel).sum::<f64>() * area / (std::f64::consts::TAU * radius * radius)
        },
        |settings| sum(draw(&disc, &camera, settings)),
    );
    (found - expected) / area
}

fn run() -> Findings {
    let exact = RenderSettings { footprint: FootprintForm::Exact, ..unshaded() };
    let ways = [
        ("default", Role::Default, Way::Engine(unshaded())),
        ("exact", Role::Ours, Way::Engine(exact)),
        ("z-buffer, ε of a radius", Role::Baseline, Way::Passes(1.0)),
        ("z-buffer, ε of 4 radii", Role::Baseline, Way::Passes(4.0)),
        ("no depth", Role::Baseline, Way::Blending),
    ];
    let mesh = Mesh { primitives: vec![primitives::sphere(96)] };
    let ball = sample(&mesh, Density::Count(600), &SamplerSettings::default()).expect("a sphere has surfels");
    let (mut verdicts, mut leaks, mut fronts, mut coverages) = (vec![], vec![], vec![], vec![]);
    for (name, role, way) in &ways {
        let of = |figure: &str, found: f64| {
            let verdict = at_most(*role, name, figure, found, LEVEL);
            if *role == Role::Baseline && found > LEVEL { failing(verdict) } else { verdict }
        };
        let tilts = [0.0, 30.0, 60.0, 65.0, 75.0, 85.0, 88.0];
        let behind = |radii: f64| largest(tilts.iter().map(|tilt| leak(way, *tilt, radii)));
        // A layer reaches a radius and, where the sheet is tilted, as far as the pixel's filter sees along it: at 60 to 75° that
        // comes to 2.2 radii for surfels of 1.2 px.
        let at_two = of("back sheet seen, 2 radii behind", behind(2.0));
        verdicts.push(if *role == Role::Baseline { at_two } else { failing(at_two) });
        verdicts.push(of("back sheet seen, 2.2 to 5 radii behind", largest([2.2, 3.0, 5.0].map(behind))));
        let distances = steps(39, [0.5, 10.0]);
        leaks.push(Curve::new(*name, *role, distances.map(|radii| [radii, leak(way, 0.0, radii)])));
        if *role == Role::Default {
            let points = steps(39, [0.5, 10.0]).map(|radii| [radii, leak(way, 65.0, radii)]);
            leaks.push(Curve::new("default, tilted by 65°", *role, points));
        }
        let over_tilts: Vec<[f64; 2]> = steps(45, [0.0, 88.0]).map(|tilt| [tilt, hole(way, tilt)]).collect();
        verdicts
            .push(of("seen through the front sheet, up to 88°", largest(over_tilts.iter().map(|p| p[1]))));
        fronts.push(Curve::new(*name, *role, over_tilts));
    }
    let zooms: Vec<f64> = ratios(25, [0.25, 16.0]).collect();
    let mut cover = |name: &str, role, covered: &dyn Fn(&[Cloud], &Camera) -> Vec<f64>| {
        let points: Vec<[f64; 2]> = zooms.iter().map(|zoom| holes(&ball, *zoom, covered)).collect();
        let worst = largest(points.iter().map(|p| p[1]));
        coverages.push(Curve::new(name, role, points.into_iter().map(|[x, y]| [x, y.max(1e-5)])));
        at_most(role, name, "share of hole pixels, zoom ¼ to 16", worst, 0.0)
    };
    let engine = |settings: RenderSettings| {
        move |clouds: &[Cloud], camera: &Camera| alphas(&draw(&scene(clouds.to_vec()), camera, &settings))
    };
    verdicts.push(cover("default", Role::Default, &engine(unshaded())));
    verdicts.push(cover("exact", Role::Ours, &engine(exact)));
    verdicts.push(failing(cover("squares of 3 pixels", Role::Baseline, &squares)));

    let discs = |name: &str, role, settings: Option<RenderSettings>| {
        let error = |degrees| [degrees, too_much(degrees, settings.as_ref()).abs().max(FLOOR)];
        Curve::new(name, role, steps(37, [81.0, 99.0]).map(error))
    };
    let slivers = vec![
        discs("default", Role::Default, Some(unshaded())),
        discs("exact", Role::Ours, Some(exact)),
        discs("never below σ = √½ px", Role::Baseline, None),
    ];
    for curve in &slivers {
        let worst = largest(curve.points.iter().map(|p| p[1]));
        let verdict =
            at_most(curve.role, &curve.name, "disc near its edge drawn too large, share", worst, 0.01);
        verdicts.push(if curve.role == Role::Baseline { failing(verdict) } else { verdict });
    }
    let (of_steps, steps_of_depth) = step_edge::run();
    verdicts.extend(of_steps);
    let panel = Panel::of_errors;
    let panels = vec![
        panel(
            "Two parallel sheets, seen from the front and at a slant",
            Axis::linear("distance in surfel radii"),
            "largest share of the back sheet",
            LEVEL,
            leaks,
        ),
        panel(
            "One sheet, tilted",
            Axis::linear("tilt in degrees"),
            "largest share let through",
            LEVEL,
            fronts,
        ),
        panel(
            "A sphere of 600 surfels",
            Axis::log("pixels a surfel"),
            "share of hole pixels",
            1e-5,
            coverages,
        ),
        panel(
            "A disc of σ = 2 px turns past its edge",
            Axis::linear("tilt in degrees"),
            "error of its area, share of the front's",
            0.01,
            slivers,
        ),
        steps_of_depth,
    ];
    Findings { panels, verdicts }
}
