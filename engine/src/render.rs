//! The main path: cull ► footprint ► order ► bin ► (raster ► layers ► composite ► resolve) for each tile.

use crate::bin::{TILE, TileLists};
use crate::camera::Camera;
use crate::composite::{Compositor, Runs};
use crate::cull::visible_ranges;
use crate::footprint::{Kind, Lens, Records, project};
use crate::frame::Frame;
use crate::layers::{Cuts, LayerBuilder};
use crate::observer::{Counts, Observer, Stage};
use crate::order::by_distance;
use crate::raster::{Fragments, Rasterizer, Sample, Tile};
use crate::resolve::{Pixel, Resolver, store};
use crate::scene::{Light, RenderSettings, Scene};
use crate::shade::Shader;
use glam::DVec3;
use rayon::prelude::*;
use thiserror::Error;

/// Why a scene cannot be drawn.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RenderError {
    /// A setting is outside its range.
    #[error("{what} is {value}; {expected}")]
    Setting {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// A light is not finite or points nowhere.
    #[error("light {index} is {light:?}; its numbers must be finite and its direction not zero")]
    Light {
        /// Its number in the scene.
        index: usize,
        /// The light.
        light: Light,
    },
    /// More clouds or splats than ids can name.
    #[error("the scene has {clouds} clouds with {splats} splats; at most 65535 and 4294967294 can be named")]
    Count {
        /// Clouds in the scene.
        clouds: usize,
        /// Splats in all of them.
        splats: usize,
    },
}

/// Draws a scene, on the threads of the current rayon pool; the picture does not depend on how many.
///
/// # Errors
/// When a setting is outside its documented range or the scene has more splats than ids can name.
pub fn render(
    scene: &Scene,
    camera: &Camera,
    settings: &RenderSettings,
    observer: &dyn Observer,
) -> Result<Frame, RenderError> {
    let splats = validate(scene, settings)?;
    let watch = |stage, run: &mut dyn FnMut()| {
        observer.begin(stage);
        run();
        observer.end(stage);
    };
    let (mut visible, mut records) = (Vec::new(), Records::default());
    let (mut order, mut lists) = (Vec::new(), None);
    watch(Stage::Cull, &mut || visible = visible_ranges(scene, camera, settings));
    watch(Stage::Footprint, &mut || records = project(scene, camera, settings, &visible));
    watch(Stage::Order, &mut || order = by_distance(&records));
    watch(Stage::Bin, &mut || lists = Some(TileLists::new(camera.size(), &order, &records.rects)));

    let [width, height] = camera.size().map(|side| side as usize);
    let mut frame = Frame::new(width, height);
    let mut fragments = 0;
    if let Some(lists) = lists {
        let drawer = TileDrawer::new(scene, camera, settings, &records);
        let tiles: Vec<(Tile, Vec<Pixel>, u64)> = (0..lists.columns * lists.rows)
            .into_par_iter()
            .map_init(Scratch::new, |scratch, index| {
                let (column, row) = (index % lists.columns, index / lists.columns);
                let origin = [column * TILE, row * TILE];
                let tile =
                    Tile { origin, size: [(width - origin[0]).min(TILE), (height - origin[1]).min(TILE)] };
                let (pixels, count) = drawer.draw(tile, lists.tile(column, row), scratch, observer);
                (tile, pixels, count)
            })
            .collect();
        for (tile, pixels, count) in &tiles {
            store(&mut frame, *tile, pixels);
            fragments += count;
        }
    }
    observer.counts(Counts { splats: splats as u64, visible: records.records.len() as u64, fragments });
    Ok(frame)
}

/// Checks the settings and counts the splats.
fn validate(scene: &Scene, settings: &RenderSettings) -> Result<usize, RenderError> {
    let check = |what, value: f64, ok: bool, expected| {
        if ok { Ok(()) } else { Err(RenderError::Setting { what, value, expected }) }
    };
    let RenderSettings { low_pass, tolerance, cutoff, .. } = *settings;
    check("low-pass variance", low_pass, (0.0..=1e6).contains(&low_pass), "it must be from 0 to 1e6 px²")?;
    check("tolerance", tolerance, (0.0..=1.0).contains(&tolerance), "it must be from 0 to 1")?;
    check("cut-off", cutoff, cutoff > 0.0 && cutoff <= 100.0, "it must be above 0 and at most 100")?;
    for value in settings.background.map(f64::from) {
        check("background", value, value.is_finite(), "it must be finite")?;
    }
    for (index, light) in scene.lights.iter().enumerate() {
        let (place, color) = match *light {
            Light::Ambient { color } => (DVec3::ONE, color),
            Light::Directional { towards, color } => (towards.normalize_or_zero(), color),
            Light::Point { position, color } => (position, color),
        };
        let points_nowhere = matches!(light, Light::Directional { .. }) && place == DVec3::ZERO;
        if !place.is_finite() || points_nowhere || color.iter().any(|c| !c.is_finite()) {
            return Err(RenderError::Light { index, light: *light });
        }
    }
    let (clouds, splats) = (scene.clouds.len(), scene.clouds.iter().map(|cloud| cloud.len()).sum());
    if clouds > usize::from(u16::MAX) || splats >= u32::MAX as usize {
        return Err(RenderError::Count { clouds, splats });
    }
    Ok(splats)
}

/// Buffers of one thread.
struct Scratch {
    samples: Vec<Sample>,
    fragments: Fragments,
    cuts: Cuts,
    runs: Runs,
}

impl Scratch {
    fn new() -> Self {
        Self { samples: Vec::new(), fragments: Fragments::default(), cuts: Cuts::new(), runs: Runs::new() }
    }
}

/// Fragments are composited after this many: few enough to stay in the cache.
const BATCH: usize = 4096;

/// Draws tiles.
struct TileDrawer<'a> {
    records: &'a Records,
    rasterizer: Rasterizer<'a>,
    layers: LayerBuilder<'a>,
    compositor: Compositor<'a>,
    resolver: Resolver<'a>,
}

impl<'a> TileDrawer<'a> {
    fn new(scene: &Scene, camera: &Camera, settings: &'a RenderSettings, records: &'a Records) -> Self {
        let lens = Lens::new(camera, settings.low_pass);
        let near = camera.near() as f32;
        // A quarter of the tolerance: what is behind it changes no channel by more.
        let spent = (settings.tolerance / 4.0) as f32;
        let shaders =
            scene.clouds.iter().map(|cloud| Shader::new(scene, camera, cloud.splats().material)).collect();
        let camera_to_world = camera.pose().world_to_camera.matrix3.transpose();
        Self {
            records,
            rasterizer: Rasterizer { records, lens, cutoff: settings.cutoff as f32, near },
            layers: LayerBuilder::new(&scene.clouds, records, spent),
            compositor: Compositor { records, near, spent },
            resolver: Resolver { shaders, settings, lens, camera_to_world },
        }
    }

    /// A tile's pixels and the number of its fragments and samples.
    fn draw(
        &self,
        tile: Tile,
        list: &[u32],
        scratch: &mut Scratch,
        observer: &dyn Observer,
    ) -> (Vec<Pixel>, u64) {
        let Scratch { samples, fragments, cuts, runs } = scratch;
        let kind = |index: &u32| self.records.records[*index as usize].kind;
        samples.clear();
        runs.clear();

        observer.begin(Stage::Raster);
        for index in list.iter().filter(|index| kind(index) == Kind::Surface) {
            self.rasterizer.samples(*index, tile, samples);
        }
        observer.end(Stage::Raster);
        let mut count = samples.len() as u64;

        observer.begin(Stage::Layers);
        self.layers.build(samples, cuts);
        observer.end(Stage::Layers);

        let mut volume = list.iter().filter(|index| kind(index) != Kind::Surface).peekable();
        while volume.peek().is_some() {
            observer.begin(Stage::Raster);
            fragments.clear();
            while fragments.fragments.len() < BATCH
                && let Some(index) = volume.next()
            {
                self.rasterizer.fragments(*index, tile, fragments);
            }
            observer.end(Stage::Raster);
            count += fragments.fragments.len() as u64;
            observer.begin(Stage::Composite);
            self.compositor.add(fragments, cuts, runs);
            let done = runs.all_spent(tile.pixels(), self.compositor.spent);
            observer.end(Stage::Composite);
            if done {
                break;
            }
        }

        observer.begin(Stage::Resolve);
        let pixels = self.resolver.tile(tile, cuts, runs);
        observer.end(Stage::Resolve);
        (pixels, count)
    }
}
