//! A fixed frame for counting instructions; `.ci/instructions` runs it under callgrind.
//!
//! `instructions SCENE` draws a scene twice on one thread and prints how many splats and pixels that took. In the second
//! frame the functions below mark where each stage begins and ends.

#[path = "../../chart/src/scenes/random.rs"]
#[allow(unreachable_pub, reason = "the file is public where it lives")]
mod random;

use glam::{DVec3, Mat3, Vec3};
use oblate_engine::cloud::oblate_factor;
use oblate_engine::simd::Level;
use oblate_engine::{
    Blend, Camera, Channels, Closed, Cloud, Counts, FootprintForm, Harmonics, Material, Observer,
    OpacityFilter, Order, Pose, RenderSettings, Renderer, Scene, Shapes, Splats, Stage, Strength, Surface,
};
use random::Random;
use std::f32::consts::PI;
use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

const SPLATS: usize = 20_000;
const SURFELS: usize = 10_000;

/// Tells callgrind of stages.
struct Marker {
    is_measured: AtomicBool,
}

impl Observer for Marker {
    fn begin(&self, _: Stage) {
        if self.is_measured.load(Relaxed) {
            marks::begin();
        }
    }

    fn end(&self, stage: Stage) {
        if self.is_measured.load(Relaxed) {
            match stage {
                Stage::Footprint => marks::footprint(),
                Stage::Order => marks::order(),
                Stage::Bin => marks::bin(),
                Stage::Layers | Stage::Composite => marks::raster(),
                _ => {}
            }
        }
    }

    fn counts(&self, counts: Counts) {
        if self.is_measured.load(Relaxed) {
            let Counts { splats, visible, fragments, .. } = counts;
            println!("{:?} {splats} {visible} {fragments}", Level::best());
        }
    }
}

/// Functions that stay functions, with bodies of their own.
mod marks {
    use super::black_box;

    macro_rules! marks {
        ($($name:ident $number:literal)*) => {$(
            #[inline(never)]
            pub(super) fn $name() {
                black_box($number);
            }
        )*};
    }

    marks! { begin 1 footprint 2 order 3 bin 4 raster 5 }
}

fn main() {
    // All work on the main thread: another one that waits would count instructions too.
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread()
        .build_global()
        .expect("no pool was made before");
    let name = std::env::args().nth(1).unwrap_or_default();
    let affine = RenderSettings {
        footprint: FootprintForm::Affine,
        blend: Blend::Display,
        channels: Channels::Color,
        order: Order::Centers,
        // Of every pixel; but for one scene.
        interpolation: false,
        ..RenderSettings::default()
    };
    let ordered = |order| RenderSettings { order, ..affine };
    let exact = RenderSettings { footprint: FootprintForm::Exact, ..affine };
    let (clouds, settings) = match name.as_str() {
        "affine" => (vec![splats(false)], affine),
        "exact" => (vec![splats(false)], exact),
        "harmonics" => (vec![splats(true)], affine),
        "surfels" => (vec![ball()], affine),
        "apart" => (vec![cloud(sphere())], affine),
        "grid" => (vec![grid()], affine),
        "mixed" => (vec![grid(), ball()], affine),
        "window" => (vec![splats(false)], ordered(Order::PerPixel)),
        "slabs" => (vec![grid()], ordered(Order::Slabs { thickness: 2.0 })),
        "slabs-by-threes" => (vec![grid()], ordered(Order::Slabs { thickness: 1.5 })),
        "thin-slabs" => (vec![grid()], ordered(Order::Slabs { thickness: 1.0 })),
        "lattice" => {
            // A wider filter makes kernels wide enough.
            let slabs = ordered(Order::Slabs { thickness: 2.0 });
            (vec![grid()], RenderSettings { interpolation: true, low_pass: 1.0, ..slabs })
        }
        "mixed-slabs" => (vec![grid(), ball()], ordered(Order::Slabs { thickness: 2.0 })),
        _ => panic!("there is no scene {name:?}; they are listed in .ci/instructions"),
    };
    let scene = Scene { clouds, lights: Vec::new() };
    let pose = Pose::look_at(DVec3::new(2.0, -4.0, 2.0), DVec3::ZERO, DVec3::Z).expect("it looks somewhere");
    let camera = Camera::perspective(pose, 30f64.to_radians(), [256; 2]).expect("the size is in range");
    let marker = Marker { is_measured: AtomicBool::new(false) };
    let mut renderer = Renderer::new();
    for is_measured in [false, true] {
        marker.is_measured.store(is_measured, Relaxed);
        renderer.render(&scene, &camera, &settings, &marker).expect("it can be drawn");
    }
}

fn cloud(splats: Splats) -> Cloud {
    Cloud::new(splats).expect("the numbers are finite")
}

/// Flat splats of all sizes about 2 pixels and all opacities, as training makes them.
fn splats(with_harmonics: bool) -> Cloud {
    let mut random = Random(1);
    let coefficients: Vec<_> = (0..15 * SPLATS).map(|_| (random.normals() * 0.04).to_array()).collect();
    let mut factor = || {
        let axes = oblate_factor(random.direction(), 1.0, 4.0);
        let scales = (random.normals() * 0.5).to_array().map(|log| 0.012 * log.exp());
        axes * Mat3::from_diagonal(scales.into())
    };
    let factors = (0..SPLATS).map(|_| factor()).collect();
    let mut cube = || Vec3::from_array([0, 1, 2].map(|_| random.uniform(-0.7, 0.7)));
    cloud(Splats {
        centers: (0..SPLATS).map(|_| cube()).collect(),
        shapes: Shapes::Each(factors),
        strength: Strength::Opacity {
            peaks: (0..SPLATS).map(|_| random.uniform(0.05, 0.95)).collect(),
            filter: OpacityFilter::Compensated,
            least: 0.0,
        },
        colors: vec![[0.5, 0.4, 0.3]; SPLATS],
        harmonics: with_harmonics.then_some(Harmonics { degree: 3, coefficients }),
        normals: None,
        material: Material::UNLIT,
    })
}

/// A closed sphere of opaque surfels, a pixel apart, in the order in which samplers give them.
fn ball() -> Cloud {
    cloud(sphere().in_morton_order())
}

/// The same, in random order.
fn sphere() -> Splats {
    let mut random = Random(2);
    let normals: Vec<Vec3> = (0..SURFELS).map(|_| random.direction()).collect();
    let radius = 0.3;
    let area = 4.0 * PI * radius * radius / SURFELS as f32;
    let sigma = area.sqrt();
    Splats {
        centers: normals.iter().map(|normal| *normal * radius).collect(),
        shapes: Shapes::Each(normals.iter().map(|n| oblate_factor(*n, sigma, f32::INFINITY)).collect()),
        strength: Strength::Surface(Surface {
            areas: vec![area; SURFELS],
            opacities: None,
            depth_tolerance: 2.0 * sigma,
            coverage_floor: 0.5,
            closed: Closed::EVERYWHERE,
        }),
        colors: vec![[0.5, 0.4, 0.3]; SURFELS],
        harmonics: None,
        normals: Some(normals),
        material: Material::default(),
    }
}

/// A lit block of kernels on a grid, around the sphere, as transparent as glass.
fn grid() -> Cloud {
    const SIDE: usize = 27;
    let width = 0.7;
    let step = width / SIDE as f32;
    let place = |i: usize| Vec3::from_array([i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE].map(|i| i as f32));
    let centers: Vec<Vec3> = (0..SIDE.pow(3)).map(|i| (place(i) - (SIDE - 1) as f32 / 2.0) * step).collect();
    let count = centers.len();
    // An optical depth of 2 from face to face.
    let mass = 2.0 / width * step.powi(3);
    cloud(Splats {
        normals: Some(centers.iter().map(|center| center.normalize_or(Vec3::Z)).collect()),
        centers,
        shapes: Shapes::Shared(Mat3::from_diagonal(Vec3::splat(0.7 * step))),
        strength: Strength::Extinction { masses: vec![mass; count] },
        colors: vec![[0.5, 0.4, 0.3]; count],
        harmonics: None,
        material: Material::default(),
    })
}
