//! What a picture is, written pixel by pixel in double precision: the records that the footprint stage made, the layer
//! rule, shares between cuts by Φ, and compositing from near to far. Tiles, blocks, polynomials and early
//! ends are the drawer's own affair and must not show.

mod scenes;
mod sheets;

use super::*;
use crate::camera::{Pose, Projection};
use crate::closed::Closed;
use crate::cloud::{Cloud, Strength};
use crate::columns::LANES;
use crate::footprint::{Form, Kind, Lens, Record, Records, Rect};
use crate::frame::LEAST_VISIBLE;
use crate::order::Keys;
use crate::scene::{FootprintForm, Order};
use glam::{DVec2, DVec3};
use scenes::{fog, sheet, trained};
use sheets::shown;
use std::f64::consts::LN_2;

/// Layers that a pixel may have.
const MOST_LAYERS: usize = 64;

/// A footprint at one pixel.
struct Hit {
    r: f64,
    z: f64,
    sigma_z: f64,
    scale: f64,
    /// What rounding does to r: its linear form is a difference of two products.
    doubt: f64,
}

fn hit(record: &Record, u: DVec2) -> Hit {
    let [a, b, c] = record.conic_root.map(f64::from);
    let q = (a * u.x + b * u.y).powi(2) + (c * u.y).powi(2);
    let rise = DVec2::from(record.depth_slope.map(f64::from)).dot(u);
    let (d, sigma_z) = (f64::from(record.depth), f64::from(record.sigma_z));
    let (r, z, scale) = match record.tag.form {
        Form::Point | Form::Affine => (q, d + rise, 1.0),
        Form::Exact => {
            let t = 1.0 - rise / d;
            let den = t * t + (sigma_z / d).powi(2) * q;
            (q / den, d * t / den, 1.0 / den.sqrt())
        }
    };
    let doubt = 2.0 * q.sqrt() * 2.0 * 6e-8 * ((a * u.x).abs() + (b * u.y).abs()) + 4e-7 * r;
    Hit { r, z, sigma_z: sigma_z * scale, scale, doubt }
}

fn contains(rect: &Rect, pixel: [usize; 2]) -> bool {
    (0..2).all(|axis| (usize::from(rect.min[axis])..usize::from(rect.max[axis])).contains(&pixel[axis]))
}

fn phi(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

/// A surface layer.
struct SpecifiedCut {
    z: f64,
    alpha: f64,
    color: DVec3,
    id: u32,
}

/// A surface splat at one pixel.
#[derive(Clone, Copy)]
struct Sample {
    is_back: bool,
    has_sides: bool,
    z: f64,
    nearest: f64,
    farthest: f64,
    plane: f64,
    coverage: f64,
    even: f64,
    opacity: f64,
    color: DVec3,
    id: u32,
    tolerance: f64,
    floor: f64,
}

/// A pixel, and what rounding may do to it at most.
struct Pixel {
    color: [f64; 4],
    cuts: Vec<SpecifiedCut>,
    bound: f64,
}

/// A scene's records and the pictures they make.
struct Specification<'a> {
    camera: &'a Camera,
    settings: &'a RenderSettings,
    lens: Lens,
    surfaces: &'a Records,
    volumes: &'a Records,
    /// Places of surfaces in their order, and of volumes from near to far.
    surface_order: Vec<usize>,
    volume_order: Vec<usize>,
    clouds: &'a [CloudSurface],
}

fn taken(records: &Records) -> Vec<usize> {
    records.runs.iter().flat_map(|run| run.start..run.start + run.len).collect()
}

/// The share of a pixel that fronts and backs cover together: the lesser lies in the greater, but for what is little beside it.
fn together(sides: [f64; 2]) -> f64 {
    let [most, least] = [sides[0].max(sides[1]), sides[0].min(sides[1])];
    if most > 0.0 { (most + least * (1.0 - least / most).powi(8)).min(1.0) } else { 0.0 }
}

impl<'a> Specification<'a> {
    fn new(
        [surfaces, volumes]: [&'a Records; 2],
        (view, closing): (SceneView<'a>, Closing),
        clouds: &'a [CloudSurface],
    ) -> Self {
        let mut volume_order = taken(volumes);
        let keys = Keys::of(&volumes.runs, closing.alike());
        let key = |place: usize| keys.key(f32::from_bits(volumes.distances[place].load(Relaxed)));
        volume_order.sort_by_key(|place| (key(*place), *place));
        Self {
            camera: view.camera,
            settings: view.settings,
            lens: view.lens(),
            surfaces,
            volumes,
            surface_order: taken(surfaces)
                .into_iter()
                .flat_map(|octet| octet * LANES..(octet + 1) * LANES)
                .collect(),
            volume_order,
            clouds,
        }
    }

    fn least_transmittance(&self) -> f64 {
        self.settings.tolerance / 4.0
    }

    /// `None` where rounding alone says which samples make a layer.
    fn pixel(&self, pixel: [usize; 2]) -> Option<Pixel> {
        let cuts = self.cuts(pixel)?;
        let (runs, bound) = self.runs(pixel, &cuts);
        let (mut color, mut through) = (DVec3::ZERO, 1.0);
        for (segment, (sent, lets)) in runs.into_iter().enumerate() {
            color += through * sent;
            through *= lets;
            if let Some(cut) = cuts.get(segment) {
                color += through * cut.alpha * cut.color;
                through *= 1.0 - cut.alpha;
            }
        }
        let [red, green, blue, alpha] = self.settings.background.map(f64::from);
        color += through * alpha * DVec3::new(red, green, blue);
        through *= 1.0 - alpha;
        Some(Pixel { color: [color.x, color.y, color.z, 1.0 - through], cuts, bound })
    }

    fn samples(&self, pixel: [usize; 2]) -> Option<Vec<Sample>> {
        let center = DVec2::new(pixel[0] as f64, pixel[1] as f64) + 0.5;
        let (cutoff, near) = (self.settings.outline, self.camera.near());
        let mut samples = Vec::new();
        for place in &self.surface_order {
            let octet = &self.surfaces.octets[*place / LANES];
            let rect = &self.surfaces.own_rects[*place / LANES][*place % LANES];
            let Some((record, sample)) = octet.get(*place % LANES).filter(|_| contains(rect, pixel)) else {
                continue;
            };
            let u = center - DVec2::from(record.mean.map(f64::from));
            let Hit { r, z, sigma_z, scale, doubt } = hit(&record, u);
            if (r - cutoff).abs() <= 2e-5 + doubt || (z - near).abs() <= 1e-5 * z.abs() {
                return None;
            }
            if r > cutoff || z <= near {
                continue;
            }
            // n·v changes linearly along the picture, and with it where the plane is.
            let facing = f64::from(record.amplitude);
            let change = DVec2::from(record.amplitude_slope_or_slabs.map(f64::from)).dot(u);
            let depth = f64::from(record.depth);
            let is_perspective = self.camera.projection() == Projection::Perspective;
            let zeta = if is_perspective { depth } else { 1.0 };
            let divisor = if is_perspective { facing + change } else { facing };
            // The planes of surfels much smaller than the filter are followed to 45° instead of 86°, and layers of theirs are thicker.
            let [a, _, c] = record.conic_root.map(f64::from);
            let of_filter = (self.lens.filter_sigma.powi(2) * a * c).min(1.0);
            let smallness = of_filter.powi(4);
            let filter_sigma = self.lens.filter_sigma / self.lens.focal.min_element() * zeta.abs();
            let limit = (15.0 - 14.0 * smallness) * cutoff.sqrt() * filter_sigma;
            let offset = depth - zeta * change / divisor - z;
            let offset = if offset.is_nan() { -limit } else { offset.clamp(-limit, limit) };
            // n·v where it is seen; the affine form leaves its change out.
            let peak = if record.tag.form == Form::Exact {
                (facing * depth / z).abs() * scale
            } else {
                facing.abs()
            };
            let surface = self.clouds[record.tag.cloud as usize];
            let (tolerance, floor) = (f64::from(surface.depth_tolerance), f64::from(surface.coverage_floor));
            let most_even = floor.max(0.96);
            let shows_back = if is_perspective { facing * depth > 0.0 } else { facing > 0.0 };
            samples.push(Sample {
                is_back: shows_back,
                has_sides: surface.has_sides,
                z,
                nearest: z + offset.min(0.0) - 3.0 * sigma_z,
                farthest: z + offset.max(0.0) + smallness * filter_sigma,
                plane: z + offset,
                coverage: peak * (-0.5 * r).exp(),
                even: most_even - (most_even - floor) * (1.0 - of_filter).sqrt(),
                opacity: f64::from(sample.opacity),
                color: DVec3::from(record.color.map(f64::from)),
                id: octet.id(*place % LANES),
                tolerance,
                floor,
            });
        }
        Some(samples)
    }

    /// Near to far: each takes the samples whose spans come within its first one's limit, the last one that a pixel may
    /// have all that is left.
    fn cuts(&self, pixel: [usize; 2]) -> Option<Vec<SpecifiedCut>> {
        let mut left = self.samples(pixel)?;
        let mut cuts: Vec<SpecifiedCut> = Vec::new();
        // The shares that fronts and backs cover, what they cover together, and what that lets through.
        let (mut sides, mut all, mut veiled) = ([0.0_f64; 2], 0.0, 0.0);
        let mut seen = 1.0;
        while !left.is_empty() && cuts.len() < MOST_LAYERS && seen > self.least_transmittance() {
            let last = cuts.len() + 1 == MOST_LAYERS;
            let first = left.iter().copied().reduce(|a, b| if b.z < a.z { b } else { a })?;
            let limit = first.farthest + first.tolerance;
            let is_close = |z: f64, to: f64| (z - to).abs() <= 4e-6 * z.abs();
            for other in left.iter().filter(|other| other.id != first.id) {
                // Two that come first leave open which limit counts.
                let is_alike = is_close(other.farthest, first.farthest) && other.has_sides == first.has_sides;
                let two_first = is_close(other.z, first.z) && !is_alike;
                if two_first || !last && is_close(other.nearest, limit) {
                    return None;
                }
            }
            let (taken, behind): (Vec<Sample>, Vec<Sample>) =
                left.into_iter().partition(|sample| last || sample.nearest <= limit);
            left = behind;
            let total: f64 = taken.iter().map(|sample| sample.coverage).sum();
            let mean = |of: fn(&Sample) -> f64| taken.iter().map(|s| s.coverage * of(s)).sum::<f64>() / total;
            let clear = 1.0 - mean(|s| s.opacity).min(1.0);
            // As many sheets as it covers its share of the pixel times, but for what a single one may.
            let even = mean(|s| s.even * (1.0 - s.opacity)) / clear;
            let of_side = |is_back: bool| -> f64 {
                taken.iter().filter(|s| s.is_back == is_back).map(|s| s.coverage).sum()
            };
            let own = if first.has_sides { [of_side(false), of_side(true)] } else { [total, 0.0] };
            let coverage = own[0].max(own[1]).min(1.0);
            let times = total / coverage;
            let more = even * times - 1.0;
            let twice_beyond = 2.0 * (more - (1.0 - even));
            let sheets = 1.0 + twice_beyond.min(more).max(0.0);
            // Of several sheets what each lets through multiplies.
            let squares = mean(|s| (1.0 - s.opacity).powi(2));
            let variance = if clear > 0.0 { (squares / clear.powi(2) - 1.0).max(0.0) } else { 0.0 };
            let product = (1.0 - twice_beyond.min(times / even - 1.0).max(0.0) * variance).max(0.0);
            let opacity = 1.0 - clear.powf(sheets) * product;
            let (before, covered) = (seen, all);
            sides = [0, 1].map(|side| (sides[side] + own[side]).min(1.0));
            all = together(sides).max(covered);
            let again = if covered > 0.0 { (coverage - (all - covered)).max(0.0) / covered } else { 0.0 };
            veiled = veiled * (1.0 - opacity * again) + (all - covered) * (1.0 - opacity);
            seen = 1.0 - all + veiled;
            if (seen / self.least_transmittance() - 1.0).abs() < 0.01 {
                return None;
            }
            let z = mean(|s| s.z).max(cuts.last().map_or(f64::NEG_INFINITY, |cut| cut.z));
            let shown = shown(&first, &taken)?;
            let weights = || taken.iter().map(|s| s.coverage * s.opacity * shown(s));
            let color = taken.iter().zip(weights()).map(|(s, weight)| s.color * weight).sum::<DVec3>()
                / weights().sum::<f64>().max(1e-300);
            let alpha = if before > 0.0 { 1.0 - seen / before } else { 1.0 };
            cuts.push(SpecifiedCut { z, alpha, color, id: first.id });
        }
        Some(cuts)
    }

    /// What each segment sends and lets through, and what rounding may do to the pixel:
    /// - each opacity is right to 1e-4 of itself (2e-5 by its polynomial, 3e-6 by the exponential, the rest by
    ///   rounding), and to what rounding does to r;
    /// - a kernel whose outline runs through the pixel may be there or not;
    /// - a share is right to 0.4 of what rounding does to depths over σ_z, and what is 4σ_z away counts as none;
    /// - behind a transmittance of `least_transmittance` anything may be left out;
    /// - sums and means of layers are right to 2e-5.
    fn runs(&self, pixel: [usize; 2], cuts: &[SpecifiedCut]) -> (Vec<(DVec3, f64)>, f64) {
        let center = DVec2::new(pixel[0] as f64, pixel[1] as f64) + 0.5;
        let (cutoff, near) = (self.settings.cutoff, self.camera.near());
        let mut runs = vec![(DVec3::ZERO, 1.0); cuts.len() + 1];
        let mut bound = 2e-5;
        for place in &self.volume_order {
            let record = &self.volumes.records[*place];
            if !contains(&self.volumes.rects[*place], pixel) {
                continue;
            }
            if runs[0].1 < 1.05 * self.least_transmittance() {
                bound += runs[0].1;
                break;
            }
            let u = center - DVec2::from(record.mean.map(f64::from));
            let Hit { r, z, sigma_z, scale, doubt } = hit(record, u);
            let is_doubtful = (r - cutoff).abs() <= 4e-4 + doubt;
            if r > cutoff && !is_doubtful {
                continue;
            }
            let w = f64::from(record.amplitude) * (-0.5 * r).exp();
            let (tau, is_doubtful) = match record.tag.kind {
                Kind::Opacity => {
                    let end = 2.0 * LN_2 * f64::from(record.end());
                    let is_borderline = (r - end).abs() <= 4e-4 + doubt;
                    if r > end && !is_borderline {
                        continue;
                    }
                    (-(-w).ln_1p(), is_doubtful || is_borderline)
                }
                _ if record.tag.form == Form::Exact => {
                    (w * scale * self.lens.ray(center).length(), is_doubtful)
                }
                _ => (w, is_doubtful),
            };
            let color = DVec3::from(record.color.map(f64::from));
            let of_share = if cuts.is_empty() && z - 5.0 * sigma_z > near {
                0.0
            } else {
                (0.4 * 2e-6 * z.abs() / sigma_z.max(1e-20)).min(1.0) + 7e-5
            };
            let mut from = near;
            for (segment, (sent, through)) in runs.iter_mut().enumerate() {
                let to = cuts.get(segment).map_or(f64::INFINITY, |cut| cut.z);
                let share =
                    (phi((to - z) / sigma_z.max(1e-20)) - phi((from - z) / sigma_z.max(1e-20))).max(0.0);
                let alpha = -(-tau * share).exp_m1();
                bound += *through * (alpha * (1e-4 + doubt) + (tau * of_share).min(1.0));
                if is_doubtful {
                    bound += *through * alpha;
                }
                *sent += *through * alpha * color;
                *through *= 1.0 - alpha;
                from = to;
            }
        }
        (runs, bound)
    }
}

#[test]
fn pictures_are_what_is_specified() {
    let pose = Pose::look_at(DVec3::new(1.2, 0.9, -4.0), DVec3::ZERO, DVec3::Y).unwrap();
    let perspective = Camera::perspective(pose, 0.5, [45, 37]).unwrap();
    let parallel = Camera::orthographic(pose, 2.2, [45, 37]).unwrap();
    let fine =
        RenderSettings { tolerance: 1e-5, shade: false, order: Order::Centers, ..RenderSettings::default() };
    let usual = RenderSettings { tolerance: 1.0 / 255.0, background: [0.1, 0.2, 0.3, 1.0], ..fine };
    let opaque = || sheet(1.0, 35.0, 0.2);
    let two = || [sheet(0.5, -20.0, -0.4), opaque()];
    let forms = [FootprintForm::Point, FootprintForm::Affine, FootprintForm::Exact];
    let twelve: Vec<Cloud> = (0..12).map(|i| sheet(0.3, 25.0, 0.15 * f64::from(i) - 0.8)).collect();
    let with = |cloud: Cloud, sheets: &[Cloud]| [&[cloud], sheets].concat();
    let mut cases: Vec<(&str, Vec<Cloud>, Camera, RenderSettings)> = Vec::new();
    for footprint in forms {
        let (fine, usual) = (RenderSettings { footprint, ..fine }, RenderSettings { footprint, ..usual });
        cases.extend([
            ("fog", vec![fog(0.01)], perspective, fine),
            ("thick fog", vec![fog(1.0)], perspective, fine),
            ("thinnest fog", vec![fog(1e-9)], perspective, fine),
            ("fog at the near plane", vec![fog(0.01)], perspective.with_near(4.2).unwrap(), fine),
            ("fog, parallel", vec![fog(0.01)], parallel, fine),
            ("fog without a filter", vec![fog(0.01)], perspective, RenderSettings { low_pass: 0.0, ..fine }),
            ("trained", vec![trained()], perspective, usual),
            (
                "trained without a filter",
                vec![trained()],
                perspective,
                RenderSettings { low_pass: 0.0, ..usual },
            ),
            ("trained at the near plane", vec![trained()], perspective.with_near(4.2).unwrap(), usual),
            ("a sheet", vec![opaque()], perspective, usual),
            ("two sheets", two().to_vec(), perspective, usual),
            ("fog with a sheet", with(fog(0.02), &[opaque()]), perspective, fine),
            ("fog with two sheets", with(fog(0.02), &two()), perspective, fine),
            ("fog with two sheets, parallel", with(fog(0.02), &two()), parallel, fine),
            ("thick fog with two sheets", with(fog(1.0), &two()), perspective, fine),
            ("twelve sheets", twelve.clone(), perspective, fine),
            ("fog with twelve sheets", with(fog(0.002), &twelve), perspective, fine),
            ("trained with a sheet far behind", with(trained(), &[sheet(1.0, 0.0, 3.0)]), perspective, usual),
            ("trained with two sheets", with(trained(), &two()), perspective, usual),
        ]);
    }
    // Rays half as long again as they are deep.
    let near_pose = Pose::look_at(DVec3::new(0.4, 0.3, -2.0), DVec3::ZERO, DVec3::Y).unwrap();
    let wide = Camera::perspective(near_pose, 1.3, [45, 37]).unwrap();
    let each_in_its_own = RenderSettings { footprint: FootprintForm::Auto, tolerance: 0.1, ..usual };
    cases.extend([
        ("fog in two forms", vec![fog(0.02)], wide, each_in_its_own),
        ("thick fog in two forms", vec![fog(0.3)], wide, each_in_its_own),
        ("thick fog in two forms with two sheets", with(fog(0.3), &two()), wide, each_in_its_own),
    ]);
    // Fronts and backs that end in the picture, in one layer and in two, whose sides are known or aren't.
    let sided = |sheet: Cloud| {
        let mut splats = sheet.splats();
        if let Strength::Surface(surface) = &mut splats.strength {
            surface.closed = Closed::Sided;
        }
        Cloud::new(splats).unwrap().transformed(sheet.cloud_to_world())
    };
    let back = |opacity: f32, shift: f64| sheet(opacity, 180.0, shift);
    let small = Camera::orthographic(pose, 4.0, [45, 37]).unwrap();
    for opacity in [1.0, 0.4] {
        for shift in [0.01, 0.5] {
            let sheets =
                || [sheet(opacity, 0.0, 0.0), back(0.7 * opacity, shift), sheet(opacity, 20.0, 2.0 * shift)];
            cases.extend([
                ("a fold and a sheet", sheets().map(&sided).to_vec(), small, fine),
                ("what may be a fold and a sheet", sheets().to_vec(), small, fine),
                (
                    "a front and what may be its back",
                    [vec![sided(sheet(opacity, 0.0, 0.0))], vec![back(opacity, shift)]].concat(),
                    small,
                    usual,
                ),
                ("fog with a fold", with(fog(0.02), &sheets().map(&sided)), perspective, fine),
            ]);
        }
    }
    for [cutoff, outline] in [[20.0, 6.0], [6.0, 20.0]] {
        let (fine, usual) =
            (RenderSettings { cutoff, outline, ..fine }, RenderSettings { cutoff, outline, ..usual });
        cases.extend([
            ("fog that ends elsewhere than two sheets", with(fog(0.02), &two()), perspective, fine),
            ("trained that end elsewhere than two sheets", with(trained(), &two()), perspective, usual),
        ]);
    }
    let mut failures = Vec::new();
    for (name, clouds, camera, settings) in &cases {
        let scene = Scene { clouds: clouds.clone(), lights: Vec::new() };
        for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
            let report = compare(&scene, camera, settings, level);
            println!("{name}, {:?}, {level:?}: {}", settings.footprint, report.summary);
            if let Some(failure) = report.failure {
                failures.push(format!("{name}, {:?}, {level:?}: {failure}", settings.footprint));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

struct Report {
    summary: String,
    failure: Option<String>,
}

fn compare(scene: &Scene, camera: &Camera, settings: &RenderSettings, level: Level) -> Report {
    let mut renderer = Renderer::with(level, 16);
    renderer.render(scene, camera, settings, &()).unwrap();
    // The renderer's own distances are used up by sorting.
    let mut volumes = Records::default();
    let view = SceneView { scene, camera, settings };
    let closing = Closing::new(view, &renderer.visible.volumes).unwrap();
    let (lights, looked) = (&renderer.lights, None);
    let projector = SceneProjector { view, lights, closing, looked, tile_side: 16, level };
    let all: Vec<u32> = (0..renderer.visible.volumes.len() as u32).collect();
    volumes.append(&projector, &renderer.visible.volumes, &all);
    let records = [&renderer.drawn.surfaces.records, &volumes];
    let specification = Specification::new(records, (view, closing), &renderer.cloud_surfaces);
    let frame = &renderer.frame;
    let (mut worst, mut share, mut seen, mut doubtful) = (0.0_f64, 0.0_f64, 0, 0);
    let (mut failure, mut failed) = (None, 0);
    for place in 0..frame.width * frame.height {
        let pixel = [place % frame.width, place / frame.width];
        let Some(expected) = specification.pixel(pixel) else {
            doubtful += 1;
            continue;
        };
        seen += usize::from(expected.color[3] > 0.0);
        let found = frame.color[place].map(f64::from);
        let error = (0..4).map(|i| (found[i] - expected.color[i]).abs()).fold(0.0, f64::max);
        (worst, share) = (worst.max(error), share.max(error / expected.bound));
        let (depth, id) = expected
            .cuts
            .iter()
            .find(|cut| cut.alpha >= f64::from(LEAST_VISIBLE))
            .map_or((f64::INFINITY, Frame::NO_ID), |cut| (cut.z, cut.id));
        let depth_found = f64::from(frame.depth[place]);
        let is_depth_off = depth != depth_found && (depth - depth_found).abs() > 1e-5 * depth;
        if error > expected.bound || is_depth_off {
            failed += 1;
            failure.get_or_insert_with(|| {
                let Pixel { color, bound, .. } = &expected;
                format!("pixel {pixel:?} is {found:?}, z {depth_found}, not {color:?}, z {depth}, id {id}; bound {bound:.1e}")
            });
        }
    }
    if doubtful > frame.color.len() / 20 || seen < 100 {
        failure.get_or_insert(format!("{doubtful} pixels doubtful, {seen} seen"));
    }
    let summary =
        format!("largest error {worst:.1e}, {share:.2} of its bound; {doubtful} doubtful, {failed} wrong");
    Report { summary, failure }
}
