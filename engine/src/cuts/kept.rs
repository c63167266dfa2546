//! The cuts of all tiles of a picture, from when its surfaces are drawn to when its volumes are.

use super::{Cut, Cuts, TileCuts};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Cuts lie in pieces of so many, which go from tile to tile: what one frame needs more in a tile another one needed elsewhere.
const PIECE: usize = 16;

/// The most layers that are kept of a block of pixels, in the mean of a picture: 80 bytes a pixel. The cuts of tiles that find no room are
/// made again.
const MOST_LAYERS: usize = 2;

type Piece = Box<[Cut; PIECE]>;

/// The cuts of a tile, if there are any and they found room.
#[derive(Default)]
struct KeptTile {
    pieces: Vec<Piece>,
    used: usize,
    sums: Option<TileCuts>,
}

/// Pieces that are in no tile, how many there are in all, and may be.
#[derive(Default)]
struct Pool {
    free: Vec<Piece>,
    count: usize,
    most: usize,
}

/// The cuts of a picture.
#[derive(Default)]
pub(crate) struct KeptCuts {
    tiles: Vec<Mutex<KeptTile>>,
    pool: Mutex<Pool>,
}

impl KeptCuts {
    /// Forgets what there is, for a picture of so many tiles, each of so many blocks.
    pub(crate) fn clear(&mut self, tiles: usize, blocks: usize) {
        let pool = self.pool.get_mut().unwrap_or_else(PoisonError::into_inner);
        for tile in &mut self.tiles {
            tile.get_mut().unwrap_or_else(PoisonError::into_inner).give_back(pool);
        }
        pool.most = pool.count.max((MOST_LAYERS * tiles * blocks).div_ceil(PIECE));
        self.tiles.resize_with(tiles.max(self.tiles.len()), Mutex::default);
    }

    /// Keeps a tile's cuts in place of those that it had, if there is room.
    pub(crate) fn keep(&self, tile: usize, cuts: &Cuts) {
        let mut kept = lock(&self.tiles[tile]);
        let count = cuts.used.div_ceil(PIECE);
        {
            let mut pool = lock(&self.pool);
            kept.give_back(&mut pool);
            if count == 0 || !pool.has(count) {
                return;
            }
            let first = pool.free.len() - count;
            kept.pieces.extend(pool.free.drain(first..));
        }
        for (piece, cuts) in kept.pieces.iter_mut().zip(cuts.cuts[..cuts.used].chunks(PIECE)) {
            piece[..cuts.len()].copy_from_slice(cuts);
        }
        (kept.used, kept.sums) = (cuts.used, Some(cuts.sums));
    }

    /// Gives a tile's cuts, if it has some and they were kept.
    pub(crate) fn restore(&self, tile: usize, cuts: &mut Cuts) -> bool {
        let kept = lock(&self.tiles[tile]);
        let Some(sums) = kept.sums else { return false };
        cuts.cuts.clear();
        for piece in &kept.pieces {
            cuts.cuts.extend_from_slice(&piece[..]);
        }
        (cuts.used, cuts.sums) = (kept.used, sums);
        true
    }
}

impl KeptTile {
    fn give_back(&mut self, pool: &mut Pool) {
        pool.free.append(&mut self.pieces);
        (self.used, self.sums) = (0, None);
    }
}

impl Pool {
    /// Whether as many pieces are free, some of which may be new.
    fn has(&mut self, count: usize) -> bool {
        let missing = count.saturating_sub(self.free.len());
        if missing > self.most - self.count {
            return false;
        }
        if missing > 0 {
            // An eighth more than there were: frames differ.
            let new = missing.max(self.count / 8).min(self.most - self.count);
            self.free.extend((0..new).map(|_| Box::new([Cut::NONE; PIECE])));
            self.count += new;
        }
        true
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::*;

    /// As many cuts in one block, the depth of each of which is its number.
    fn cuts(count: usize) -> Cuts {
        let mut cuts = Cuts::new();
        for number in 0..count {
            cuts.next().depth.0.fill(number as f32);
            dispatch!(Level::Baseline, simd => cuts.keep(simd, 3));
        }
        cuts
    }

    fn depths(cuts: &Cuts) -> Vec<f32> {
        cuts.layers(3).map(|cut| cut.depth.0[0]).collect()
    }

    #[test]
    fn what_is_kept_comes_back() {
        let mut kept = KeptCuts::default();
        let mut found = cuts(7);
        kept.clear(4, 64);
        for (tile, count) in [(0, 1), (1, 100), (2, 0), (1, 33)] {
            kept.keep(tile, &cuts(count));
            assert_eq!(kept.restore(tile, &mut found), count > 0);
            if count > 0 {
                assert_eq!(depths(&found), depths(&cuts(count)));
            }
        }
        assert!(!kept.restore(3, &mut found));
        kept.clear(4, 64);
        assert!(!kept.restore(1, &mut found));
        // Pieces of one tile serve another.
        let before = lock(&kept.pool).count;
        kept.keep(3, &cuts(90));
        assert!(kept.restore(3, &mut found));
        assert_eq!((depths(&found).len(), lock(&kept.pool).count), (90, before));
    }

    #[test]
    fn what_finds_no_room_is_not_kept() {
        // Room for two layers of sixteen blocks: for two pieces.
        let mut kept = KeptCuts::default();
        kept.clear(2, 8);
        let mut found = Cuts::new();
        kept.keep(0, &cuts(20));
        kept.keep(1, &cuts(1));
        assert!(kept.restore(0, &mut found) && !kept.restore(1, &mut found));
        kept.keep(0, &cuts(16));
        kept.keep(1, &cuts(17));
        assert!(kept.restore(0, &mut found) && !kept.restore(1, &mut found));
        kept.keep(1, &cuts(16));
        assert!(kept.restore(0, &mut found) && kept.restore(1, &mut found));
        assert_eq!(lock(&kept.pool).count, 2);
    }
}
