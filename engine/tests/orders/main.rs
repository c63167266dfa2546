//! What each order of compositing keeps to, with the numbers in the tests. R1, the integral along the rays, is the
//! measure; what a test prints says how far each order is from it.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod baselines;
mod convergence;
mod depths;
mod mixed;
mod overlaps;
#[path = "../scenes/mod.rs"]
mod scenes;
mod sheets;
mod trained_scenes;
mod turning;

use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{
    Camera, Channels, Cloud, FootprintForm, Frame, Material, Metrics, OpacityFilter, Order, Pixels,
    ReferenceKind, RenderSettings, Scene, Shapes, Splats, Strength, compare, reference,
};
use scenes::{draw, fog, unshaded};

/// A level of a picture with 8 bits.
const LEVEL: f64 = 1.0 / 255.0;

const SLABS: Order = Order::Slabs { thickness: 2.0 };
/// A sheet a voxel for lattices as `fog` makes them.
const SHEETS: Order = Order::AxisSheets { spacing: 1.0 / 0.7 };
/// Those that any cloud can be drawn in.
const GENERAL: [Order; 3] = [Order::Centers, Order::PerPixel, SLABS];

/// Colours as they are, in this order.
fn ordered(order: Order) -> RenderSettings {
    RenderSettings { order, ..unshaded() }
}

/// Exact footprints, cut off where nothing is left of kernels, nothing left out behind: what remains of the error is
/// the order's.
fn nothing_but(order: Order) -> RenderSettings {
    RenderSettings { footprint: FootprintForm::Exact, cutoff: 30.0, tolerance: 0.0, ..ordered(order) }
}

/// What R1 sees.
fn truth(clouds: &[Cloud], camera: &Camera, settings: &RenderSettings) -> Frame {
    let scene = Scene { clouds: clouds.to_vec(), lights: Vec::new() };
    reference(&scene, camera, settings, ReferenceKind::R1, &|_| ()).unwrap()
}

/// How far two frames are apart at some of their pixels.
fn apart_at(places: &[usize], a: &Frame, b: &Frame) -> Metrics {
    let [a, b] = [a, b].map(|frame| places.iter().flat_map(|i| frame.color[*i]).collect::<Vec<f32>>());
    let picture = |values| Pixels { width: places.len(), height: 1, channels: 4, values };
    compare(picture(&a), picture(&b)).unwrap()
}

/// How far two frames are apart.
fn apart(a: &Frame, b: &Frame) -> Metrics {
    apart_at(&(0..a.color.len()).collect::<Vec<_>>(), a, b)
}

/// A cloud in the colours of its centres.
fn painted(cloud: &Cloud, color: impl Fn(Vec3) -> [f32; 3]) -> Cloud {
    let mut splats = cloud.splats();
    splats.colors = splats.centers.iter().map(|center| color(*center)).collect();
    Cloud::new(splats).unwrap()
}

/// Colours that turn along each axis, once in 2π.
fn shades(p: Vec3) -> [f32; 3] {
    (p + Vec3::new(0.0, 1.0, 2.0)).to_array().map(|angle| 0.5 + 0.4 * angle.sin())
}

/// A cube of fog whose colours turn along each axis, once through it.
fn haze(side: usize, spacing: f64, extinction: f64) -> Cloud {
    let turn = std::f32::consts::TAU / (side as f32 * spacing as f32);
    painted(&fog([side; 3], DVec3::splat(spacing), extinction, [0.0; 3]), |p| shades(p * turn))
}

/// Kernels with a colour and a strength each.
fn splats(centers: Vec<Vec3>, factors: Vec<Mat3>, strength: Strength, colors: Vec<[f32; 3]>) -> Cloud {
    let (shapes, material) = (Shapes::Each(factors), Material::UNLIT);
    Cloud::new(Splats { centers, shapes, strength, colors, harmonics: None, normals: None, material })
        .unwrap()
}

/// The mass of a kernel whose optical depth is `depth` where a ray passes its middle along the third column of
/// `factor`, across the others.
fn mass_of(depth: f32, factor: Mat3) -> f32 {
    depth * std::f32::consts::TAU * factor.x_axis.length() * factor.y_axis.length()
}

/// Numbers from 0 to 1 that are spread evenly but in no order.
fn spread(index: usize, stride: f32) -> f32 {
    (index as f32 * stride + 0.5).fract()
}

/// A rotation for each index.
fn turned(index: usize) -> Mat3 {
    let angle = |stride| spread(index, stride) * std::f32::consts::TAU;
    Mat3::from_euler(glam::EulerRot::ZYX, angle(0.618_034), angle(0.754_878), angle(0.569_840))
}

/// A place in a ball of radius 1 for each index.
fn in_ball(index: usize) -> Vec3 {
    turned(index + 1000) * Vec3::Z * spread(index, 0.819_173).cbrt()
}

/// Half-axes for each index that are log-normal, each by itself: median 0.1, 0.6 in the logarithm.
fn any_shape(index: usize) -> Mat3 {
    // The sum of four numbers that are evenly spread, of variance 1/12 each, is close to normal.
    let normal = |k: usize| {
        let sum: f32 = (0..4).map(|j| spread(index * 12 + k * 4 + j, 0.618_034) - 0.5).sum();
        sum * 3.0_f32.sqrt()
    };
    turned(index) * Mat3::from_diagonal(Vec3::from([0, 1, 2].map(|k| 0.1 * (0.6 * normal(k)).exp())))
}

/// A colour for each index.
fn any_color(index: usize) -> [f32; 3] {
    [0.618_034, 0.754_878, 0.569_840].map(|stride| spread(index, stride))
}

/// Elongated kernels with opacities, as trained scenes have them, in a ball of radius 0.9.
fn trained() -> Cloud {
    let indices = 0..40;
    let center = |i: usize| turned(i) * Vec3::Z * 0.9 * spread(i, 0.819_173).cbrt();
    let factor = |i: usize| turned(i + 100) * Mat3::from_diagonal(Vec3::new(0.3, 0.15, 0.15));
    splats(
        indices.clone().map(center).collect(),
        indices.clone().map(factor).collect(),
        Strength::Opacity {
            peaks: indices.clone().map(|i| 0.1 + 0.3 * spread(i, 0.414_214)).collect(),
            filter: OpacityFilter::Compensated,
            least: Strength::LEAST_OF_TRAINED,
        },
        indices.map(|i| shades(center(i) * 4.0)).collect(),
    )
}
