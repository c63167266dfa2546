//! The main path: cull ► footprint ► order ► bin ► (raster ► layers ► composite ► resolve) for each tile, first of surfaces and then of
//! volumes, of which nothing is listed that lies behind opaque surfaces; again for what was wrongly left out as hidden (`occlusion`),
//! most often not at all. Volumes that are wide in the picture are drawn at every second
//! pixel first (`lattice`).

mod drawn;
mod picture;
mod tiles;

use crate::camera::{Camera, Projection};
use crate::closing::Closing;
use crate::cull::{VisibleRange, find_affordable, touched_pixels};
use crate::cuts::KeptCuts;
use crate::footprint::SceneProjector;
use crate::frame::{Clear, Frame};
use crate::lattice::Lattice;
use crate::observer::{Counts, Observer, Stage};
use crate::occlusion::{Occlusion, Visible};
use crate::order::Sorter;
use crate::pass::{Pass, PerPass};
use crate::raster::CloudSurface;
use crate::scene::{RenderSettings, Scene};
use crate::shade::Lights;
use crate::simd::Level;
use crate::tile::BLOCK_SIDE;
use crate::validate::SceneError;
use crate::view::SceneView;
use drawn::Drawn;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use tiles::TileBuffers;

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

/// Where rays are parallel, what is farther away than so many times its own depth is told from a plane before it: down to a millionth of that depth.
const MANY_TIMES: f64 = 16.0;

/// What the passes of a frame share.
#[derive(Clone, Copy)]
struct Shared<'a> {
    view: SceneView<'a>,
    closing: Closing,
    /// The z of the plane that depths are told from.
    plane: f32,
    observer: &'a dyn Observer,
}

/// Draws frame after frame, and keeps its buffers from one to the next.
pub struct Renderer {
    level: Level,
    tile_side: usize,
    /// Whether the side is chosen for each frame.
    chooses_tiles: bool,
    visible: PerPass<Vec<VisibleRange>>,
    occlusion: Occlusion,
    lights: Lights,
    /// One a cloud, of those that may be visible.
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
            lights: Lights::default(),
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
        let mut view = SceneView { scene, camera, settings };
        let culled = watched(observer, Stage::Cull, || self.cull(view));
        let plane = self.plane_before_all(camera);
        let from_plane = camera.seen_from_plane(plane);
        if plane != 0.0 {
            view.camera = &from_plane;
            let PerPass { surfaces, volumes } = &mut self.visible;
            surfaces.iter_mut().chain(volumes).for_each(|range| range.tell_from_plane(plane));
        }
        if self.chooses_tiles {
            self.tile_side = self.choose_tile_side(camera);
        }
        let closing = Closing::new(view, &self.visible.volumes)?;
        let shared = Shared { view, closing, plane: plane as f32, observer };
        self.lattice.begin(view, &self.visible, self.tile_side);
        self.prepare(view);
        let has_surfaces = !self.visible.surfaces.is_empty();
        if has_surfaces {
            self.draw_pass(Pass::Surfaces, shared);
        }
        // The background alone is drawn as volumes are.
        if !has_surfaces || !self.visible.volumes.is_empty() {
            self.draw_pass(Pass::Volumes, shared);
        }
        let sum = |i: usize| self.counts.iter().map(|counts| counts[i].load(Relaxed)).sum();
        let visible = Visible { view, closing, ranges: &self.visible };
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
    fn cull(&mut self, view: SceneView) -> u64 {
        let PerPass { surfaces, volumes } = &mut self.visible;
        let culled = find_affordable(view, volumes);
        surfaces.clear();
        surfaces.extend(volumes.extract_if(.., |range| range.is_surface));
        // Near surfaces hide far ones: what comes first is drawn first.
        surfaces.sort_by(|a, b| a.distances[0].total_cmp(&b.distances[0]));
        culled
    }

    /// Where rays are parallel a plane before all that is seen, from which single precision knows depths well: 0, but if that is many times as far
    /// away as what is seen is deep. It stays while that moves a little.
    fn plane_before_all(&self, camera: &Camera) -> f64 {
        let ends = |range: &VisibleRange| [-1.0, 1.0].map(|to| to * range.reach + range.center_in_camera.z);
        let ends = || self.visible.iter().flatten().map(ends);
        let near = ends().map(|[near, _]| near).fold(f64::INFINITY, f64::min);
        let far = ends().map(|[_, far]| far).fold(f64::NEG_INFINITY, f64::max);
        let step = (MANY_TIMES * (far - near)).log2().ceil().exp2();
        let is_far = near > step && step > 0.0 && camera.projection() == Projection::Orthographic;
        if is_far { (near / step).floor() * step } else { 0.0 }
    }

    /// Smaller tiles where all that is seen lies in a few: threads take tiles.
    fn choose_tile_side(&self, camera: &Camera) -> usize {
        let pixels = touched_pixels(camera, self.visible.iter().flatten());
        let is_too_large = |side: &usize| pixels < ((LEAST_TILES * side * side) as f64);
        [32, 16].into_iter().find(|side| !is_too_large(side)).unwrap_or(8)
    }

    /// Readies what the rounds of a frame share.
    fn prepare(&mut self, SceneView { scene, camera, settings }: SceneView) {
        self.lights = Lights::new(scene, camera);
        self.cloud_surfaces.clear();
        self.cloud_surfaces.resize(scene.clouds.len(), CloudSurface::default());
        for range in &self.visible.surfaces {
            let known = &mut self.cloud_surfaces[range.cloud];
            if *known == CloudSurface::default() {
                *known = CloudSurface::of(&scene.clouds[range.cloud]);
            }
        }
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

    /// Draws surfaces, whose cuts are kept where there are volumes, or volumes; again where something was wrongly left out.
    fn draw_pass(&mut self, pass: Pass, shared: Shared) {
        let Shared { view, closing, observer, .. } = shared;
        let visible = Visible { view, closing, ranges: &self.visible };
        watched(observer, Stage::Cull, || self.occlusion.begin_pass(pass, visible));
        loop {
            watched(observer, Stage::Footprint, || self.project(pass, shared));
            self.list(pass, shared);
            self.draw(pass, shared);
            let visible = Visible { view, closing, ranges: &self.visible };
            let occlusion = &mut self.occlusion;
            if !watched(observer, Stage::Cull, || occlusion.find_missing(pass, visible)) {
                break;
            }
        }
    }

    /// Projects what is new in a round.
    fn project(&mut self, pass: Pass, Shared { view, closing, .. }: Shared) {
        let hides = pass == Pass::Volumes && view.settings.occlusion && !self.visible.surfaces.is_empty();
        let looked = hides.then_some(self.occlusion.looked());
        let (lights, level) = (&self.lights, self.level);
        let tile_side = self.tile_side;
        let projector = SceneProjector { view, lights, closing, looked, tile_side, level };
        self.drawn[pass].append(&projector, &self.visible[pass], self.occlusion.next());
    }

    /// Lists what each tile draws in a round, in its order.
    fn list(&mut self, pass: Pass, Shared { view, closing, observer, .. }: Shared) {
        let size = view.camera.size();
        match pass {
            Pass::Surfaces => {
                self.drawn.surfaces.list_by_cluster(observer, (size, self.tile_side), &mut self.scratch);
            }
            Pass::Volumes => {
                let is_last = !self.occlusion.leaves_out(pass);
                let buffers = (&mut self.sorter, &mut self.scratch);
                let side = self.lattice.listed_side(self.tile_side);
                self.drawn.volumes.list_by_distance((observer, closing, is_last), (size, side), buffers);
            }
        }
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
