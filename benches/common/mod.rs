//! What the benchmarks draw: a table of works, each a scene and the frames that are made of it.

mod hidden;
pub(crate) mod surfels;
pub(crate) mod volumes;

use glam::DVec3;
use oblate::chart::scenes::gaussians;
use oblate::engine::{
    Blend, Camera, Channels, Cloud, FootprintForm, Light, Order, Pose, RenderSettings, Scene, Splats,
};
use volumes::{
    ANEURISM, ANEURISM_FROM_25, CHECKERS, ENGINE, ENGINE_FROM_71, GLASS, checker_box, engine_surface,
    kernels, volume,
};

/// A scene and its frames.
pub(crate) struct Work {
    pub(crate) name: &'static str,
    /// The file that it is made of.
    data: Option<&'static str>,
    /// Makes the scene.
    pub(crate) scene: fn() -> Scene,
    pub(crate) frames: Vec<Frame>,
}

/// How a scene is drawn.
pub(crate) struct Frame {
    pub(crate) name: &'static str,
    pub(crate) camera: Camera,
    pub(crate) settings: RenderSettings,
}

impl Work {
    fn new(name: &'static str, scene: fn() -> Scene, frames: Vec<Frame>) -> Self {
        Self { name, data: None, scene, frames }
    }

    fn of(self, file: &'static str) -> Self {
        Self { data: Some(file), ..self }
    }

    /// Whether its file is there; says so if not.
    pub(crate) fn is_available(&self) -> bool {
        let missing = self.data.map(volumes::data).filter(|path| !path.is_file());
        if let Some(path) = &missing {
            eprintln!("{} is missing: {} is skipped", path.display(), self.name);
        }
        missing.is_none()
    }
}

/// All of them. T1 is a volume, T2 an iso-surface, T3 trained splats and T4 opaque surfels, both in Morton order, T4 in random
/// order, too, hidden what lies mostly behind other surfels, with and without occlusion; Y03 are the frames of Yuan, Chen et al.,
/// *Hybrid Forward Resampling and Volume Rendering*, 2003, figure 9, at 400²: their voxels, in looks of ours, as splats, as
/// each form that serves, and as points.
pub(crate) fn works() -> Vec<Work> {
    let shaded = RenderSettings {
        blend: Blend::Display,
        background: [0.0, 0.0, 0.0, 1.0],
        channels: Channels::Color,
        ..RenderSettings::default()
    };
    let unshaded = RenderSettings { shade: false, ..shaded };
    let form = |footprint| RenderSettings { footprint, order: Order::Centers, ..shaded };
    let ordered = |order| RenderSettings { order, ..shaded };
    let frame = |name, camera, settings| Frame { name, camera, settings };
    let [small, large] = [400, 1024].map(|side| volume_camera(ENGINE_EXTENT, side));
    let both = || vec![frame("1024", large, shaded), frame("400", small, shaded)];
    let y03 = |extent| {
        let frame =
            |name, footprint| frame(name, volume_camera(extent, 400), RenderSettings { footprint, ..shaded });
        vec![
            frame("splats", FootprintForm::Affine),
            frame("auto", FootprintForm::Auto),
            frame("points", FootprintForm::Point),
        ]
    };
    let forms = || {
        vec![
            frame("auto", trained_camera(), form(FootprintForm::Auto)),
            frame("affine", trained_camera(), form(FootprintForm::Affine)),
            frame("exact", trained_camera(), form(FootprintForm::Exact)),
            frame("per pixel", trained_camera(), ordered(Order::PerPixel)),
            frame("slabs 2", trained_camera(), ordered(Order::Slabs { thickness: 2.0 })),
        ]
    };
    let hides = |camera| {
        let all = RenderSettings { occlusion: false, ..shaded };
        vec![frame("occlusion", camera, shaded), frame("all", camera, all)]
    };
    let surfels = || vec![frame("1024", surfel_camera(), shaded)];
    vec![
        Work::new(
            "T1",
            || lit(vec![kernels(&volume(ENGINE), GLASS)]),
            vec![
                frame("shaded 1024", large, shaded),
                frame("centers 1024", large, ordered(Order::Centers)),
                frame("per pixel 1024", large, ordered(Order::PerPixel)),
                frame("slabs 2.45 1024", large, ordered(Order::Slabs { thickness: 2.45 })),
                frame("slabs 1 1024", large, ordered(Order::Slabs { thickness: 1.0 })),
                frame("shaded 400", small, shaded),
                frame("centers 400", small, ordered(Order::Centers)),
                frame("unshaded 1024", large, unshaded),
                frame("unshaded 400", small, unshaded),
            ],
        )
        .of(ENGINE),
        Work::new("T1 with T2 inside", engine_with_surface, both()).of(ENGINE),
        Work::new("T2", || unlit(engine_surface(&volume(ENGINE))), both()).of(ENGINE),
        Work::new("T3 opacity", || unlit(gaussians::cloud(trained())), forms()),
        Work::new("T3 extinction", trained_extinction, forms()),
        Work::new(
            "T4 1 M",
            || surfel_scene(surfels::torus_and_sphere(1_000_000).in_morton_order()),
            surfels(),
        ),
        Work::new(
            "T4 5 M",
            || surfel_scene(surfels::torus_and_sphere(5_000_000).in_morton_order()),
            surfels(),
        ),
        Work::new("T4 1 M random order", || surfel_scene(surfels::torus_and_sphere(1_000_000)), surfels()),
        Work::new("T4 5 M random order", || surfel_scene(surfels::torus_and_sphere(5_000_000)), surfels()),
        Work::new("hidden spheres", || clouds(hidden::nested_spheres()), hides(spheres_camera())),
        Work::new("hidden room", || clouds(hidden::room_of_armadillos()), hides(room_camera()))
            .of(hidden::ARMADILLO),
        Work::new("Y03 engine", || lit(vec![kernels(&volume(ENGINE), ENGINE_FROM_71)]), y03(ENGINE_EXTENT))
            .of(ENGINE),
        Work::new(
            "Y03 aneurism",
            || lit(vec![kernels(&volume(ANEURISM), ANEURISM_FROM_25)]),
            y03(DVec3::splat(255.0)),
        )
        .of(ANEURISM),
        Work::new(
            "Y03 checker box",
            || lit(vec![kernels(&checker_box(), CHECKERS)]),
            y03(DVec3::splat(99.0)),
        ),
    ]
}

const TRAINED: usize = 1_000_000;

/// From the first voxel's centre to the last one's.
const ENGINE_EXTENT: DVec3 = DVec3::new(255.0, 255.0, 127.0);

/// From the middle of the engine to the eye.
const TO_EYE: DVec3 = DVec3::new(330.0, -412.5, 288.75);

fn camera(eye: DVec3, target: DVec3, up: DVec3, side: u32) -> Camera {
    let pose = Pose::look_at(eye, target, up).expect("eye and target differ");
    Camera::perspective(pose, 30f64.to_radians(), [side; 2]).expect("the size is in range")
}

/// Sees a volume as T1 sees the engine.
fn volume_camera(extent: DVec3, side: u32) -> Camera {
    let middle = extent / 2.0;
    let eye = middle + TO_EYE * (extent.length() / ENGINE_EXTENT.length());
    camera(eye, middle, DVec3::Z, side)
}

fn trained_camera() -> Camera {
    camera(DVec3::new(2.6, -2.6, -5.2), DVec3::new(0.0, -0.6, 0.0), -DVec3::Y, 1024)
}

fn spheres_camera() -> Camera {
    camera(DVec3::new(0.0, 0.5, -4.2), DVec3::ZERO, DVec3::Y, 1024)
}

fn room_camera() -> Camera {
    camera(DVec3::new(0.1, 0.15, -1.2), DVec3::new(0.1, 0.0, 2.0), DVec3::Y, 1024)
}

fn surfel_camera() -> Camera {
    camera(DVec3::new(3.0, -3.6, 2.6), DVec3::new(0.0, 0.0, 0.2), DVec3::Z, 1024)
}

/// Under one light from the camera of the volumes.
fn lit(clouds: Vec<Cloud>) -> Scene {
    Scene { clouds, lights: vec![Light::Directional { towards: TO_EYE, color: [1.0; 3] }] }
}

/// Under the light of scenes without any.
fn unlit(cloud: Cloud) -> Scene {
    Scene { clouds: vec![cloud], lights: Vec::new() }
}

fn surfel_scene(splats: Splats) -> Scene {
    unlit(Cloud::new(splats).expect("the numbers are finite"))
}

fn clouds(clouds: Vec<Cloud>) -> Scene {
    Scene { clouds, lights: Vec::new() }
}

fn engine_with_surface() -> Scene {
    let volume = volume(ENGINE);
    lit(vec![kernels(&volume, GLASS), engine_surface(&volume)])
}

fn trained() -> Splats {
    gaussians::trained(TRAINED).in_morton_order()
}

fn trained_extinction() -> Scene {
    let splats = trained();
    unlit(gaussians::cloud(gaussians::as_extinction(splats, &trained_camera(), &RenderSettings::default())))
}
