//! A step edge of a depth image, seen from elsewhere: a part of case 12.

use super::Verdict;
use super::setups::*;
use crate::baselines;
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DAffine3, DVec2};
use oblate_engine::{Camera, Frame, Intrinsics, Pose};
use oblate_surfels::{DEPTH_LOW_PASS, DepthError, DepthKind, DepthSettings, RgbdImage, depth_surfels};

/// Pixels along a side of the image, and of the new view of its middle.
const IMAGE: usize = 96;
const VIEW: u32 = 48;
/// Of the image, in pixels.
const FOCAL: f64 = 96.0;
/// The new view is as far beside the image, in depths of the near wall: what is there moves by nearly ten pixels.
const BESIDE: f64 = 0.1;
/// Nearer to an edge, in pixels of the image, nothing is asked for: pixels of the image are on one of its sides as a whole.
const MARGIN: f64 = 2.0;
/// Seen in the same size and enlarged.
const ZOOMS: [f64; 2] = [1.0, 4.0];

const RED: [f32; 3] = [1.0, 0.0, 0.0];
const GREEN: [f32; 3] = [0.0, 1.0, 0.0];

/// Draws the new view of an image.
type Draw = fn(&RgbdImage, &Camera) -> Result<Frame, DepthError>;

fn surfels(image: &RgbdImage, view: &Camera) -> Result<Frame, DepthError> {
    let settings = oblate_engine::RenderSettings { low_pass: DEPTH_LOW_PASS, ..unshaded() };
    Ok(draw(&scene(vec![depth_surfels(image, &DepthSettings::default())?]), view, &settings))
}

const CUT_SHEET: &str = "triangles, not over 5 %";

const WAYS: [(&str, Role, Draw); 6] = [
    ("surfels of the pixels", Role::Default, surfels),
    ("nearest writes", Role::Baseline, |image, view| baselines::nearest(image, view, 1)),
    ("3×3 writes", Role::Baseline, |image, view| baselines::nearest(image, view, 3)),
    ("triangles over every edge", Role::Baseline, |image, view| {
        baselines::triangles(image, view, f32::INFINITY)
    }),
    (CUT_SHEET, Role::Baseline, |image, view| baselines::triangles(image, view, 0.05)),
    ("softmax splatting", Role::Baseline, baselines::softmax),
];

/// How far a direction, x and y where z is 1, is from the edge as the image sees it, which leans; negative on the near wall.
fn beyond_edge(direction: DVec2) -> f64 {
    direction.dot(DVec2::new(1.0, -0.3).normalize())
}

/// What a camera at the origin sees of a wall at 1 that ends, and of one far behind it.
fn image(far: f64) -> RgbdImage {
    let center = DVec2::splat(IMAGE as f64 / 2.0);
    let is_far: Vec<bool> = (0..IMAGE * IMAGE)
        .map(|i| DVec2::new((i % IMAGE) as f64, (i / IMAGE) as f64) + 0.5)
        .map(|pixel| beyond_edge((pixel - center) / FOCAL) > 0.0)
        .collect();
    RgbdImage {
        size: [IMAGE; 2],
        colors: is_far.iter().map(|is_far| if *is_far { GREEN } else { RED }).collect(),
        depths: is_far.iter().map(|is_far| if *is_far { far as f32 } else { 1.0 }).collect(),
        kind: DepthKind::AlongAxis,
        intrinsics: Intrinsics { focal: DVec2::splat(FOCAL), center },
        pose: Pose { world_to_camera: DAffine3::IDENTITY },
    }
}

/// The largest error of red, green and coverage, away from the edges, of what is seen from both sides: from one the far wall
/// goes behind the near one, from the other there is a gap between them that the image doesn't show. Where depths differ by
/// less than 1.8 times the gap is narrower than both margins, and walls alone are compared.
fn error(draw: Draw, far: f64, zoom: f64) -> f64 {
    let image = image(far);
    let of = |beside: f64| {
        let size = (f64::from(VIEW) * zoom) as u32;
        let center = DVec2::splat(f64::from(size) / 2.0);
        let camera = ahead(FOCAL * zoom, center, size);
        let pose = Pose { world_to_camera: DAffine3::from_translation(glam::DVec3::NEG_X * beside) };
        let camera = Camera::from_intrinsics(pose, camera.intrinsics(), camera.projection(), [size; 2]);
        let frame = draw(&image, &camera.expect("the pose is rigid")).expect("every pixel has a depth");
        let errors = pixel_centers(size).zip(&frame.color).filter_map(|(pixel, found)| {
            let direction = (pixel - center) / (FOCAL * zoom);
            let [near, behind] = [1.0, far].map(|depth| beyond_edge(direction + DVec2::X * beside / depth));
            let is_near = near < 0.0;
            // The far wall's edge matters where the near one doesn't hide it.
            let is_clear = near.abs() > MARGIN / FOCAL && (is_near || behind.abs() > MARGIN / FOCAL);
            let right = match (is_near, behind > 0.0) {
                (true, _) => [RED[0], RED[1], 1.0],
                (_, true) => [GREEN[0], GREEN[1], 1.0],
                _ => [0.0; 3],
            };
            let off = right.iter().zip([found[0], found[1], found[3]]).map(|(a, b)| f64::from((a - b).abs()));
            // What is no number is wrong.
            is_clear.then(|| largest(off.map(|off| if off.is_nan() { f64::INFINITY } else { off })))
        });
        largest(errors)
    };
    of(BESIDE).max(of(-BESIDE)).max(FLOOR)
}

/// The verdicts and the curves of all ways.
pub(super) fn run() -> (Vec<Verdict>, Panel) {
    let (mut verdicts, mut curves) = (Vec::new(), Vec::new());
    for (name, role, draw) in WAYS {
        let points: Vec<[f64; 2]> = ratios(25, [1.01, 8.0])
            .map(|far| [far, largest(ZOOMS.map(|zoom| error(draw, far, zoom)))])
            .collect();
        let worst = largest(points.iter().map(|p| p[1]));
        let figure = "step of a depth image, 1 and 4 times as large";
        let verdict = at_most(role, name, figure, worst, LEVEL);
        // A sheet with a gap where depths jump is right at a step; what it lacks are surfaces as steep as that.
        let is_right = role == Role::Default || name == CUT_SHEET;
        verdicts.push(if is_right { verdict } else { failing(verdict) });
        curves.push(Curve::new(name, role, points));
    }
    let panel = Panel::of_errors(
        "A step of a depth image, seen from beside",
        Axis::log("depth of the far wall over the near one's"),
        "largest error away from the edges",
        LEVEL,
        curves,
    );
    (verdicts, panel)
}
