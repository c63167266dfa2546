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
use crate::scene::{RenderSettings, Scene};
use crate::shade::Shader;
use crate::validate::SceneError;
use rayon::prelude::*;

/// Draws a scene, on the threads of the current rayon pool; the picture does not depend on how many.
///
/// # Errors
/// When a setting, a light or a transform is outside its documented range, or the scene has more clouds or
/// splats than ids can name.
pub fn render(
    scene: &Scene,
    camera: &Camera,
    settings: &RenderSettings,
    observer: &dyn Observer,
) -> Result<Frame, SceneError> {
    settings.validate()?;
    let splats = scene.validate()?;
    let visible = watched(observer, Stage::Cull, || visible_ranges(scene, camera, settings));
    let records = watched(observer, Stage::Footprint, || project(scene, camera, settings, &visible));
    let order = watched(observer, Stage::Order, || by_distance(&records));
    let lists = watched(observer, Stage::Bin, || TileLists::new(camera.size(), &order, &records.rects));

    let [width, height] = camera.size().map(|side| side as usize);
    let mut frame = Frame::new(width, height);
    let mut fragments = 0;
    let drawer = TileDrawer::new(scene, camera, settings, &records);
    let tiles: Vec<(Tile, Vec<Pixel>, u64)> = (0..lists.columns * lists.rows)
        .into_par_iter()
        .map_init(Scratch::new, |scratch, index| {
            let (column, row) = (index % lists.columns, index / lists.columns);
            let origin = [column * TILE, row * TILE];
            let tile = Tile { origin, size: [(width - origin[0]).min(TILE), (height - origin[1]).min(TILE)] };
            let (pixels, count) = drawer.draw(tile, lists.tile(column, row), scratch, observer);
            (tile, pixels, count)
        })
        .collect();
    for (tile, pixels, count) in &tiles {
        store(&mut frame, *tile, pixels);
        fragments += count;
    }
    observer.counts(Counts { splats: splats as u64, visible: records.records.len() as u64, fragments });
    Ok(frame)
}

fn watched<T>(observer: &dyn Observer, stage: Stage, run: impl FnOnce() -> T) -> T {
    observer.begin(stage);
    let value = run();
    observer.end(stage);
    value
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
        // A quarter of the tolerance: what is behind changes a channel by at most that share of its brightness.
        let spent = (settings.tolerance / 4.0) as f32;
        let shaders = scene.clouds.iter().map(|cloud| Shader::new(scene, camera, cloud.material())).collect();
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
