//! A depth image of a room, seen from elsewhere.

use super::{Known, Other, Remake, Scale, Subject, SubjectError};
use crate::baselines;
use glam::DVec2;
use oblate_engine::{Blend, Camera, Frame, RenderSettings, Scene};
use oblate_surfels::{DEPTH_LOW_PASS, DepthError, DepthSettings, RgbdImage, Room, depth_surfels};

/// What another method draws.
type Draw = fn(&RgbdImage, &Camera) -> Result<Frame, DepthError>;

const OTHERS: [(&str, Draw); 6] = [
    ("nearest writes", |image, view| baselines::nearest(image, view, 1)),
    ("3×3 writes", |image, view| baselines::nearest(image, view, 3)),
    ("McMillan's order", baselines::mcmillan),
    ("triangles", |image, view| baselines::triangles(image, view, 0.05)),
    ("texels 3×3", |image, view| baselines::supersampled(image, view, 3)),
    ("softmax splatting", baselines::softmax),
];

pub(super) fn warp(scale: Scale) -> Result<Subject, SubjectError> {
    let width = scale.pick(640, 240);
    let (camera, view) = (Room.camera(width)?, Room.other_camera(width)?);
    let image = Room.image(&camera);
    let frame = pictured(&Room.picture(&view, 8), &view);
    let counts = shown_by(&camera, &view);
    let scene = |image: &RgbdImage| -> Result<Scene, DepthError> {
        Ok(Scene { clouds: vec![depth_surfels(image, &DepthSettings::default())?], lights: Vec::new() })
    };
    let first = scene(&image)?;
    let source = image.clone();
    // What was made once can be made again.
    let remake: Remake = Box::new(move || scene(&source).unwrap_or_default());
    let other = |(name, draw): &(&str, Draw)| {
        let (image, draw) = (image.clone(), *draw);
        let blank = pictured(&vec![[0.0; 3]; counts.len()], &view);
        let draw = Box::new(move || draw(&image, &view).unwrap_or_else(|_| blank.clone()));
        Other { name: (*name).into(), draw }
    };
    let others = OTHERS.iter().map(other).collect();
    let name = "the room, traced".into();
    Ok(Subject {
        name: "warp".into(),
        about: "A photograph with depths, seen from a quarter of a metre beside it; making the surfels counts as drawing. What is right is \
                known: the room itself, traced. What the photograph does not show is not counted in the errors."
            .into(),
        scene: first,
        camera: view,
        settings: RenderSettings {
            low_pass: DEPTH_LOW_PASS,
            blend: Blend::Display,
            shade: false,
            background: [0.0, 0.0, 0.0, 1.0],
            ..RenderSettings::default()
        },
        peers: Vec::new(),
        known: Some(Known { name, frame, counts, others, remake: Some(remake) }),
    })
}

fn pictured(colors: &[[f32; 3]], camera: &Camera) -> Frame {
    let [width, height] = camera.size().map(|side| side as usize);
    let color = colors.iter().map(|[r, g, b]| [*r, *g, *b, 1.0]).collect();
    Frame { color, ..Frame::new(width, height) }
}

/// Which pixels of a view show what the camera sees.
fn shown_by(camera: &Camera, view: &Camera) -> Vec<bool> {
    let [width, height] = view.size().map(|side| side as usize);
    let eye = view.pose().eye();
    let to_world = view.pose().world_to_camera.matrix3.inverse();
    let (own, other) = (camera.intrinsics(), view.intrinsics());
    let size = DVec2::from(camera.size().map(f64::from));
    let is_shown = |at: usize| {
        let pixel = DVec2::new((at % width) as f64, (at / width) as f64) + 0.5;
        let ray = to_world * ((pixel - other.center) / other.focal).extend(1.0);
        let Some(hit) = Room.hit(eye, ray) else { return false };
        let place = eye + hit.distance * ray;
        let from = camera.pose().eye();
        let there = camera.pose().world_to_camera.transform_point3(place);
        let seen = own.focal * there.truncate() / there.z + own.center;
        let is_inside = there.z > 0.0 && seen.cmpge(DVec2::ZERO).all() && seen.cmplt(size).all();
        // What hides a place is nearer by more than a thousandth.
        is_inside && Room.hit(from, place - from).is_some_and(|first| first.distance > 0.999)
    };
    (0..width * height).map(is_shown).collect()
}
