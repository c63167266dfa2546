//! The main path: cull ► footprint ► order ► bin ► (raster ► layers ► composite ► resolve) for each tile, first of surfaces and then of
//! volumes, of which nothing is listed that lies behind opaque surfaces; again for what was wrongly left out as hidden (`occlusion`),
//! most often not at all. Volumes that are wide in the picture are drawn at every second
//! pixel first (`lattice`).

mod tiles;

use crate::bin::TileLists;
use crate::camera::Camera;
use crate::closing::Closing;
use crate::composite::{Compositor, lead};
use crate::cull::{VisibleRange, find_affordable, touched_pixels};
use crate::cuts::KeptCuts;
use crate::footprint::{Lens, Part, Records, SceneView};
use crate::frame::{BAND, Channels, Clear, Frame, FrameRows};
use crate::grow::grow;
use crate::lattice::Lattice;
use crate::layers::LayerBuilder;
use crate::observer::{Counts, Observer, Stage};
use crate::occlusion::{Occlusion, Visible};
use crate::order::{Keys, Sorter};
use crate::pass::{Pass, PerPass};
use crate::raster::{CloudSurface, KernelLens, Surfaces, SurfelLens, reach_to_cuts};
use crate::resolve::Resolver;
use crate::scene::{Baseline, RenderSettings, Scene};
use crate::shade::Shader;
use crate::simd::Level;
use crate::tile::{BLOCK_SIDE, Tile};
use crate::validate::SceneError;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use tiles::{Place, TileBuffers, TileDrawer};

/// Draws a scene, on the threads of the current rayon pool; the picture does not depend on how many.
///
/// # Errors
/// When a setting, a light or a transform is outside its documented range, the scene has more clouds or
/// splats than ids can name, or [`Order::AxisSheets`](crate::Order::AxisSheets) is asked for where there is no grid.
pub fn render(
    scene: &Scene,
    camera: &Camera,
    settings: &RenderSettings,
    observer: &dyn Observer,
) -> Result<Frame, SceneError> {
    let mut renderer = Renderer::new();
    renderer.render(scene, camera, settings, observer)?;
    Ok(renderer.into_frame())
}

/// Tiles that what is seen is in at least, as far as tiles can be small.
const LEAST_TILES: usize = 64;

/// Draws frame after frame, and keeps its buffers from one to the next.
pub struct Renderer {
    level: Level,
    tile_side: usize,
    /// Whether the side is chosen for each frame.
    chooses_tiles: bool,
    visible: PerPass<Vec<VisibleRange>>,
    occlusion: Occlusion,
    shaders: Vec<Shader>,
    cloud_surfaces: Vec<CloudSurface>,
    drawn: PerPass<Drawn>,
    cuts: KeptCuts,
    lattice: Lattice,
    scratch: Vec<AtomicU64>,
    sorter: Sorter,
    threads: Vec<Mutex<TileBuffers>>,
    /// Of each tile's surfaces, of its volumes, and of each of the lattice's: pixels that were evaluated, and those where kernels came
    /// late.
    counts: Vec<[AtomicU64; 2]>,
    frame: Frame,
    clear: Clear,
}

/// What is drawn in a pass: records and who needs them where.
#[derive(Default)]
struct Drawn {
    records: Records,
    /// For each run of records its range's place among the visible ones.
    ranks: Vec<u32>,
    /// Parts of octets, or distances, of which sorting makes the order, where more records may come.
    order: Vec<AtomicU32>,
    lists: TileLists,
}

impl Default for Renderer {
    fn default() -> Self {
        Self::new()
    }
}

impl Renderer {
    /// A renderer for this processor, with tiles as large as there are enough of in what is seen.
    pub fn new() -> Self {
        Self { chooses_tiles: true, ..Self::with(Level::best(), 32) }
    }

    /// A renderer that uses the instructions of a level and tiles of the given side in pixels: 8, 16 or 32. A level that
    /// the processor lacks is [`Level::Baseline`]. Pictures differ by rounding, and by what is left out behind the opaque, a
    /// quarter of the tolerance at most.
    ///
    /// # Panics
    /// When the side is another.
    pub fn with(level: Level, tile_side: usize) -> Self {
        assert!([8, 16, 32].contains(&tile_side), "tiles have a side of 8, 16 or 32 pixels, not {tile_side}");
        Self {
            level,
            tile_side,
            chooses_tiles: false,
            visible: PerPass::default(),
            occlusion: Occlusion::default(),
            shaders: Vec::new(),
            cloud_surfaces: Vec::new(),
            drawn: PerPass::default(),
            cuts: KeptCuts::default(),
            lattice: Lattice::default(),
            scratch: Vec::new(),
            sorter: Sorter::default(),
            threads: Vec::new(),
            counts: Vec::new(),
            frame: Frame::default(),
            clear: Clear::default(),
        }
    }

    /// Draws a scene as [`render`] does; the frame is the renderer's until the next one.
    ///
    /// # Errors
    /// Those of [`render`].
    pub fn render(
        &mut self,
        scene: &Scene,
        camera: &Camera,
        settings: &RenderSettings,
        observer: &dyn Observer,
    ) -> Result<&Frame, SceneError> {
        settings.validate()?;
        let splats = scene.validate()?;
        // The colours of forms are shown as they are.
        let settings = &RenderSettings { shade: settings.shade && !settings.color_by_form, ..*settings };
        let culled = watched(observer, Stage::Cull, || self.cull(scene, camera, settings));
        if self.chooses_tiles {
            self.tile_side = self.choose_tile_side(camera);
        }
        let closing = Closing::new(scene, camera, settings, &self.visible.volumes)?;
        self.lattice.begin((scene, camera, settings), &self.visible, self.tile_side);
        self.prepare(scene, camera, settings);
        let has_surfaces = !self.visible.surfaces.is_empty();
        if has_surfaces {
            self.draw_pass(Pass::Surfaces, (scene, camera), (settings, closing), observer);
        }
        // The background alone is drawn as volumes are.
        if !has_surfaces || !self.visible.volumes.is_empty() {
            self.draw_pass(Pass::Volumes, (scene, camera), (settings, closing), observer);
        }
        let sum = |i: usize| self.counts.iter().map(|counts| counts[i].load(Relaxed)).sum();
        let visible = Visible { scene, camera, settings, closing, ranges: &self.visible };
        let [surfaces, volumes] = Pass::BOTH.map(|pass| self.drawn[pass].records.forms());
        let drawn = self.drawn.iter().zip(self.visible.iter());
        observer.counts(Counts {
            splats: splats as u64,
            culled,
            occluded: self.occlusion.count(visible) + self.drawn.volumes.records.behind_cuts(),
            visible: surfaces.iter().chain(&volumes).sum(),
            merged: drawn.map(|(drawn, ranges)| drawn.merged(ranges)).sum(),
            forms: std::array::from_fn(|form| surfaces[form] + volumes[form]),
            fragments: sum(0),
            late: sum(1),
        });
        Ok(&self.frame)
    }

    /// The last frame.
    pub fn into_frame(self) -> Frame {
        self.frame
    }

    /// Finds what may be visible; gives how many splats lie outside the picture.
    fn cull(&mut self, scene: &Scene, camera: &Camera, settings: &RenderSettings) -> u64 {
        let PerPass { surfaces, volumes } = &mut self.visible;
        let culled = find_affordable(scene, camera, settings, volumes);
        surfaces.clear();
        surfaces.extend(volumes.extract_if(.., |range| range.is_surface));
        // Near surfaces hide far ones: what comes first is drawn first.
        surfaces.sort_by(|a, b| a.distances[0].total_cmp(&b.distances[0]));
        culled
    }

    /// Smaller tiles where all that is seen lies in a few: threads take tiles.
    fn choose_tile_side(&self, camera: &Camera) -> usize {
        let pixels = touched_pixels(camera, self.visible.iter().flatten());
        let is_too_large = |side: &usize| pixels < ((LEAST_TILES * side * side) as f64);
        [32, 16].into_iter().find(|side| !is_too_large(side)).unwrap_or(8)
    }

    /// Readies what the rounds of a frame share.
    fn prepare(&mut self, scene: &Scene, camera: &Camera, settings: &RenderSettings) {
        self.shaders.clear();
        self.shaders.extend(scene.clouds.iter().map(|cloud| Shader::new(scene, camera, cloud.material())));
        self.cloud_surfaces.clear();
        self.cloud_surfaces.extend(scene.clouds.iter().map(CloudSurface::of));
        self.drawn.surfaces.clear();
        self.drawn.volumes.clear();
        self.frame.resize(camera.size().map(|length| length as usize), settings.channels);
        self.clear.begin(&self.frame, self.tile_side, settings);
        self.occlusion.begin(camera.size(), self.tile_side);
        let tiles = self.tiles(camera).iter().product();
        let kept = if self.visible.iter().any(Vec::is_empty) { 0 } else { tiles };
        self.cuts.clear(kept, (self.tile_side / BLOCK_SIDE).pow(2));
        self.counts.clear();
        self.counts.resize_with(2 * tiles + self.lattice.tiles(), Default::default);
    }

    /// Columns and rows of tiles.
    fn tiles(&self, camera: &Camera) -> [usize; 2] {
        camera.size().map(|length| (length as usize).div_ceil(self.tile_side))
    }

    /// Draws surfaces, whose cuts are kept where there are volumes, or volumes; again where something was wrongly left out.
    fn draw_pass(
        &mut self,
        pass: Pass,
        (scene, camera): (&Scene, &Camera),
        (settings, closing): (&RenderSettings, Closing),
        observer: &dyn Observer,
    ) {
        let visible = Visible { scene, camera, settings, closing, ranges: &self.visible };
        watched(observer, Stage::Cull, || self.occlusion.begin_pass(pass, visible));
        loop {
            watched(observer, Stage::Footprint, || self.project(pass, (scene, camera), (settings, closing)));
            let size = (camera.size(), self.tile_side);
            match pass {
                Pass::Surfaces => {
                    self.drawn.surfaces.list_by_cluster(observer, size, &mut self.scratch);
                }
                Pass::Volumes => {
                    let is_last = !self.occlusion.leaves_out(pass);
                    let buffers = (&mut self.sorter, &mut self.scratch);
                    let size = (size.0, self.lattice.listed_side(self.tile_side));
                    self.drawn.volumes.list_by_distance((observer, closing, is_last), size, buffers);
                }
            }
            self.draw(pass, camera, (settings, closing), observer);
            let visible = Visible { scene, camera, settings, closing, ranges: &self.visible };
            let occlusion = &mut self.occlusion;
            if !watched(observer, Stage::Cull, || occlusion.find_missing(pass, visible)) {
                break;
            }
        }
    }

    /// Projects what is new in a round.
    fn project(
        &mut self,
        pass: Pass,
        (scene, camera): (&Scene, &Camera),
        (settings, closing): (&RenderSettings, Closing),
    ) {
        let hides = pass == Pass::Volumes && settings.occlusion && !self.visible.surfaces.is_empty();
        let looked = hides.then_some(self.occlusion.looked());
        let (shaders, level) = (&self.shaders, self.level);
        let tile_side = self.tile_side;
        let view = SceneView { scene, camera, settings, shaders, closing, looked, tile_side, level };
        self.drawn[pass].append(&view, &self.visible[pass], self.occlusion.next());
    }

    /// Draws the tiles that changed.
    fn draw(
        &mut self,
        pass: Pass,
        camera: &Camera,
        (settings, closing): (&RenderSettings, Closing),
        observer: &dyn Observer,
    ) {
        let picture = camera.size().map(|length| length as usize);
        let [columns, rows] = self.tiles(camera);
        let Self { visible, drawn, cuts, occlusion, lattice, counts, .. } = self;
        let Self { shaders, cloud_surfaces: clouds, level, tile_side: side, clear, .. } = self;
        let PerPass { surfaces, volumes } = &*drawn;
        let lens = Lens::new(camera, settings.low_pass);
        let near = camera.near() as f32;
        // A quarter of the tolerance: what is behind changes a channel by at most that share of its brightness.
        let least_transmittance = (settings.tolerance / 4.0) as f32;
        let Records { octets, own_rects, .. } = &surfaces.records;
        let drawer = TileDrawer {
            layers: LayerBuilder {
                surfaces: Surfaces { octets, own_rects, clouds },
                lens: SurfelLens::new(&lens, near, settings.outline as f32),
                least_transmittance,
            },
            compositor: Compositor {
                records: &volumes.records.records,
                rects: &volumes.records.rects,
                lens: KernelLens {
                    lens,
                    near,
                    cutoff: settings.cutoff as f32,
                    least_alpha: settings.least_opacity() as f32,
                    closing,
                    is_taylor: settings.baseline == Some(Baseline::Taylor),
                    reach_to_cuts: reach_to_cuts(settings.tolerance),
                    narrowest: 0.0,
                    // An interpolation across the border is off by a half of it.
                    highest_end: (settings.tolerance / 2.0) as f32,
                },
                least_transmittance,
                lead: lead(&visible.volumes, settings, lens.projection),
                keeps_depth: settings.channels == Channels::All,
            },
            resolver: Resolver {
                shaders,
                octets,
                settings,
                lens,
                camera_to_world: camera.pose().world_to_camera.matrix3.transpose(),
            },
            looked: occlusion.looked(),
            observer,
            level: *level,
        };
        let bands: Vec<Mutex<FrameRows>> = self.frame.bands(BAND).map(Mutex::new).collect();
        let clear = &*clear;
        let place_of =
            |index: usize| Place { index, bands: &bands[index / columns * (*side / BAND)..], clear };
        let tile_of = |index: usize| Tile::new([index % columns, index / columns], *side, picture);
        let store = |counts: &[AtomicU64; 2], found: [u64; 2]| {
            counts.iter().zip(found).for_each(|(sum, own)| sum.store(own, Relaxed));
        };
        let (counts_of_surfaces, counts) = counts.split_at(columns * rows);
        let (counts, counts_of_lattice) = counts.split_at(columns * rows);
        // Lists are those of an earlier frame where this one has no surfaces.
        let surfaces_of =
            |index: usize| if visible.surfaces.is_empty() { &[] } else { surfaces.lists.tile(index) };
        if pass == Pass::Surfaces {
            tiles::for_each(&mut self.threads, columns * rows, |index, buffers| {
                if !occlusion.changed()[index] {
                    return;
                }
                let tile = (tile_of(index), surfaces_of(index));
                let found = if visible.volumes.is_empty() {
                    drawer.draw_surfaces(tile, buffers, place_of(index))
                } else {
                    drawer.keep_cuts(tile, buffers, (cuts, index))
                };
                store(&counts_of_surfaces[index], [found, 0]);
            });
            return;
        }
        lattice.mark(occlusion.changed(), columns);
        tiles::for_each(&mut self.threads, lattice.tiles(), |index, buffers| {
            if lattice.is_changed(index) {
                let has_surfaces =
                    lattice.parts(index, [columns, rows]).any(|part| !surfaces_of(part).is_empty());
                let lists = (volumes.lists.tile(index), has_surfaces);
                store(&counts_of_lattice[index], drawer.sample((lattice, index), lists, buffers));
            }
        });
        tiles::for_each(&mut self.threads, columns * rows, |index, buffers| {
            let tile = tile_of(index);
            if occlusion.changed()[index] || lattice.is_stale(tile) {
                let listed = if lattice.is_used() { lattice.tile_of(tile) } else { index };
                let lists = [surfaces_of(index), volumes.lists.tile(listed)];
                let more = (&*cuts, &*lattice, place_of(index));
                store(&counts[index], drawer.draw((tile, lists), buffers, more));
            }
        });
    }
}

impl Drawn {
    fn clear(&mut self) {
        self.records.clear();
        self.ranks.clear();
    }

    /// Projects those of the visible ranges that are `chosen`, and keeps all in the order of the ranges.
    fn append(&mut self, view: &SceneView, visible: &[VisibleRange], chosen: &[u32]) {
        let is_first = self.ranks.is_empty();
        self.records.append(view, visible, chosen);
        self.ranks.extend(chosen);
        if !is_first && !chosen.is_empty() {
            self.records.sort_runs(&mut self.ranks);
        }
    }

    /// How many of the splats that are drawn stand for others.
    fn merged(&self, visible: &[VisibleRange]) -> u64 {
        self.records.count(|run| visible[self.ranks[run] as usize].level > 0)
    }

    /// Lists octets by clusters, which come from near to far.
    fn list_by_cluster(
        &mut self,
        observer: &dyn Observer,
        size: ([u32; 2], usize),
        scratch: &mut Vec<AtomicU64>,
    ) {
        let Self { records, order, lists, .. } = self;
        watched(observer, Stage::Bin, || {
            let count = records.list_parts(order);
            grow(scratch, count, AtomicU64::default);
            lists.fill(size, &order[..count], |part| records.rect_of(Part(part)), scratch);
        });
    }

    /// Lists records by their distance, or by their first slab.
    fn list_by_distance(
        &mut self,
        (observer, closing, is_last): (&dyn Observer, Closing, bool),
        size: ([u32; 2], usize),
        (sorter, scratch): (&mut Sorter, &mut Vec<AtomicU64>),
    ) {
        let Records { distances, runs, rects, .. } = &self.records;
        grow(scratch, self.records.len(), AtomicU64::default);
        let distances = if is_last {
            distances
        } else {
            grow(&mut self.order, distances.len(), AtomicU32::default);
            for run in runs {
                let places = run.start..run.start + run.len;
                for (kept, distance) in self.order[places.clone()].iter().zip(&distances[places]) {
                    kept.store(distance.load(Relaxed), Relaxed);
                }
            }
            &self.order
        };
        let keys = match closing {
            _ if closing.is_mixed() => Keys::of_fractions(runs),
            _ if closing.has_slabs() => Keys::OF_NUMBERS,
            _ => Keys::of(runs, closing.alike()),
        };
        let order = watched(observer, Stage::Order, || sorter.sort((runs, keys), distances, scratch));
        watched(observer, Stage::Bin, || {
            self.lists.fill(size, order, |place| rects[place as usize], scratch)
        });
    }
}

fn watched<T>(observer: &dyn Observer, stage: Stage, run: impl FnOnce() -> T) -> T {
    observer.begin(stage);
    let value = run();
    observer.end(stage);
    value
}

#[cfg(test)]
mod specification;
