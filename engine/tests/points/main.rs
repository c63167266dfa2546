//! Points: what round footprints keep of splats, and where they may stand for them.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod choice;
mod dolly;
mod energy;
#[path = "../scenes/mod.rs"]
mod scenes;

use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{
    Camera, Closed, Cloud, Counts, FootprintForm, Frame, Material, Observer, OpacityFilter, Order,
    RenderSettings, Renderer, Scene, Shapes, Splats, Strength, Surface,
};
use scenes::unshaded;
use std::sync::Mutex;

/// Every order that any cloud can be drawn in.
const ORDERS: [Order; 3] = [Order::Centers, Order::PerPixel, Order::Slabs { thickness: 2.0 }];

/// Colours as they are, in an order and a form.
fn drawn_as(footprint: FootprintForm, order: Order) -> RenderSettings {
    RenderSettings { footprint, order, ..unshaded() }
}

/// Remembers the counts.
#[derive(Default)]
struct Remember(Mutex<Counts>);

impl Observer for Remember {
    fn counts(&self, counts: Counts) {
        *self.0.lock().unwrap() = counts;
    }
}

/// A picture and how many splats of each form it took: points, affine, exact.
fn draw(clouds: &[Cloud], camera: &Camera, settings: &RenderSettings) -> (Frame, [u64; 3]) {
    let (mut renderer, counts) = (Renderer::new(), Remember::default());
    let scene = Scene { clouds: clouds.to_vec(), lights: Vec::new() };
    renderer.render(&scene, camera, settings, &counts).unwrap();
    let forms = counts.0.lock().unwrap().forms;
    (renderer.into_frame(), forms)
}

/// What a cloud's strengths are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Extinction,
    Opacity(OpacityFilter),
    Surface,
}

const KINDS: [Kind; 4] = [
    Kind::Extinction,
    Kind::Opacity(OpacityFilter::Classic),
    Kind::Opacity(OpacityFilter::Compensated),
    Kind::Surface,
];

/// Splats with a shape and a colour each. A splat's peak optical depth or coverage, were it seen along its third axis without a
/// filter, is `peak`.
fn cloud(kind: Kind, splats: &[(Vec3, Mat3)], peak: f32, colors: Vec<[f32; 3]>) -> Cloud {
    let strengths: Vec<f32> = splats
        .iter()
        .map(|(_, factor)| {
            let area = std::f32::consts::TAU * factor.x_axis.length() * factor.y_axis.length();
            if let Kind::Opacity(_) = kind { peak } else { peak * area }
        })
        .collect();
    let strength = match kind {
        Kind::Extinction => Strength::Extinction { masses: strengths },
        Kind::Opacity(filter) => Strength::Opacity { peaks: strengths, filter, least: 0.0 },
        Kind::Surface => Strength::Surface(Surface {
            areas: strengths,
            opacities: None,
            depth_tolerance: 1.0,
            coverage_floor: 1.0,
            closed: Closed::Nowhere,
        }),
    };
    Cloud::new(Splats {
        centers: splats.iter().map(|(center, _)| *center).collect(),
        shapes: Shapes::Each(splats.iter().map(|(_, factor)| *factor).collect()),
        strength,
        colors,
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })
    .unwrap()
}

/// Numbers from 0 to 1 that are spread evenly but in no order.
fn spread(index: usize, stride: f64) -> f64 {
    (index as f64 * stride + 0.5).fract()
}

/// A rotation for each index.
fn turned(index: usize) -> Mat3 {
    let angle = |stride| (spread(index, stride) * std::f64::consts::TAU) as f32;
    Mat3::from_euler(glam::EulerRot::ZYX, angle(0.618_034), angle(0.754_878), angle(0.569_84))
}

/// A place in a cube of side 2 for each index.
fn place(index: usize) -> DVec3 {
    DVec3::from([0.754_877_67, 0.569_840_29, 0.437_016_02].map(|stride| 2.0 * spread(index, stride) - 1.0))
}

/// A colour for each index.
fn color(index: usize) -> [f32; 3] {
    [0.127, 0.311, 0.233].map(|stride| spread(index, stride) as f32)
}

/// The largest difference of a channel.
fn apart(a: &Frame, b: &Frame) -> f64 {
    let pixels = a.color.iter().flatten().zip(b.color.iter().flatten());
    pixels.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
}
