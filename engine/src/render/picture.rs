//! A picture from the lists of its tiles.

use super::tiles::{self, Place, TileBuffers, TileDrawer};
use super::{Renderer, Shared};
use crate::camera::Camera;
use crate::composite::{Compositor, lead};
use crate::footprint::Records;
use crate::frame::{BAND, Channels, Clear, FrameRows};
use crate::lattice::HIGHEST_END;
use crate::layers::LayerBuilder;
use crate::pass::Pass;
use crate::raster::{KernelLens, Surfaces, SurfelLens, reach_to_cuts};
use crate::resolve::Resolver;
use crate::scene::Baseline;
use crate::tile::Tile;
use std::mem::take;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// Where a round's pixels go.
#[derive(Clone, Copy)]
struct Target<'a> {
    bands: &'a [Mutex<FrameRows<'a>>],
    clear: &'a Clear,
}

impl<'a> Target<'a> {
    /// Where a tile is written, of so many columns.
    fn place(&self, tile_side: usize, [columns, _]: [usize; 2], index: usize) -> Place<'a> {
        Place { index, bands: &self.bands[index / columns * (tile_side / BAND)..], clear: self.clear }
    }
}

impl Renderer {
    /// Columns and rows of tiles.
    pub(super) fn tiles(&self, camera: &Camera) -> [usize; 2] {
        camera.size().map(|length| (length as usize).div_ceil(self.tile_side))
    }

    /// Draws the tiles that changed.
    pub(super) fn draw(&mut self, pass: Pass, shared: Shared) {
        let [columns, _] = self.tiles(shared.view.camera);
        if pass == Pass::Volumes {
            self.lattice.mark(self.occlusion.changed(), columns);
        }
        // All else is only read by the threads.
        let (mut threads, mut frame) = (take(&mut self.threads), take(&mut self.frame));
        // What it says is of that frame: after a panic both are new.
        let clear = take(&mut self.clear);
        let bands: Vec<_> = frame.bands(BAND).map(Mutex::new).collect();
        let target = Target { bands: &bands, clear: &clear };
        match pass {
            Pass::Surfaces => self.draw_surfaces(shared, &mut threads, target),
            Pass::Volumes => self.draw_volumes(shared, &mut threads, target),
        }
        (self.threads, self.frame, self.clear) = (threads, frame, clear);
    }

    /// Draws the surfaces of tiles, or keeps their cuts where volumes follow.
    fn draw_surfaces(&self, shared: Shared, threads: &mut Vec<Mutex<TileBuffers>>, target: Target) {
        let drawer = self.tile_drawer(shared);
        let tiles @ [columns, rows] = self.tiles(shared.view.camera);
        tiles::for_each(threads, columns * rows, |index, buffers| {
            if !self.occlusion.changed()[index] {
                return;
            }
            let tile = (self.tile(shared, index), self.surfaces_of(index));
            let count = if self.visible.volumes.is_empty() {
                drawer.draw_surfaces(tile, buffers, target.place(self.tile_side, tiles, index))
            } else {
                drawer.keep_cuts(tile, buffers, (&self.cuts, index))
            };
            store(&self.counts[index], [count, 0]);
        });
    }

    /// Draws the volumes of tiles, and what surfaces they have: first those of the lattice, if it is used.
    fn draw_volumes(&self, shared: Shared, threads: &mut Vec<Mutex<TileBuffers>>, target: Target) {
        let Self { lattice, cuts, counts, occlusion, .. } = self;
        let drawer = self.tile_drawer(shared);
        let lists = &self.drawn.volumes.lists;
        let tiles @ [columns, rows] = self.tiles(shared.view.camera);
        let counts = &counts[columns * rows..];
        let (counts, counts_of_lattice) = counts.split_at(columns * rows);
        tiles::for_each(threads, lattice.tiles(), |index, buffers| {
            if lattice.is_changed(index) {
                let has_surfaces = lattice.parts(index, tiles).any(|part| !self.surfaces_of(part).is_empty());
                let listed = (lists.tile(index), has_surfaces);
                store(&counts_of_lattice[index], drawer.sample((lattice, index), listed, buffers));
            }
        });
        tiles::for_each(threads, columns * rows, |index, buffers| {
            let tile = self.tile(shared, index);
            if occlusion.changed()[index] || lattice.is_stale(tile) {
                let listed = if lattice.is_used() { lattice.tile_of(tile) } else { index };
                let lists = [self.surfaces_of(index), lists.tile(listed)];
                let more = (cuts, lattice, target.place(self.tile_side, tiles, index));
                store(&counts[index], drawer.draw((tile, lists), buffers, more));
            }
        });
    }

    /// A tile of the picture.
    fn tile(&self, shared: Shared, index: usize) -> Tile {
        let camera = shared.view.camera;
        let [columns, _] = self.tiles(camera);
        let picture = camera.size().map(|length| length as usize);
        Tile::new([index % columns, index / columns], self.tile_side, picture)
    }

    /// The surfaces that a tile draws.
    fn surfaces_of(&self, index: usize) -> &[AtomicU32] {
        // Lists are those of an earlier frame where this one has no surfaces.
        if self.visible.surfaces.is_empty() { &[] } else { self.drawn.surfaces.lists.tile(index) }
    }

    fn all_have_sides(&self) -> bool {
        self.visible.surfaces.iter().all(|range| self.cloud_surfaces[range.cloud].has_sides)
    }

    fn tile_drawer<'a>(&'a self, shared: Shared<'a>) -> TileDrawer<'a> {
        let Shared { view, closing, plane, observer } = shared;
        let (camera, settings) = (view.camera, view.settings);
        let (surfaces, volumes) = (&self.drawn.surfaces.records, &self.drawn.volumes.records);
        let lens = view.lens();
        let near = camera.near() as f32;
        // A quarter of the tolerance: what is behind changes a channel by at most that share of its brightness.
        let least_transmittance = (settings.tolerance / 4.0) as f32;
        let Records { octets, own_rects, .. } = surfaces;
        TileDrawer {
            layers: LayerBuilder {
                surfaces: Surfaces {
                    octets,
                    own_rects,
                    clouds: &self.cloud_surfaces,
                    all_have_sides: self.all_have_sides(),
                },
                lens: SurfelLens::new(&lens, near, settings.outline as f32),
                least_transmittance,
            },
            compositor: Compositor {
                records: &volumes.records,
                rects: &volumes.rects,
                lens: KernelLens {
                    lens,
                    near,
                    cutoff: settings.cutoff as f32,
                    closing,
                    is_taylor: settings.baseline == Some(Baseline::Taylor),
                    reach_to_cuts: reach_to_cuts(settings.tolerance),
                    narrowest: 0.0,
                    highest_end: (HIGHEST_END * settings.tolerance) as f32,
                },
                least_transmittance,
                lead: lead(&self.visible.volumes, settings, lens.projection),
                keeps_depth: settings.channels == Channels::All,
            },
            resolver: Resolver {
                scene: view.scene,
                lights: &self.lights,
                octets,
                settings,
                lens,
                plane,
                camera_to_world: camera.pose().world_to_camera.matrix3.transpose(),
            },
            looked: self.occlusion.looked(),
            observer,
            level: self.level,
        }
    }
}

/// Keeps what a tile was evaluated at.
fn store(counts: &[AtomicU64; 2], found: [u64; 2]) {
    counts.iter().zip(found).for_each(|(count, own)| count.store(own, Relaxed));
}
