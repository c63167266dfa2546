//! The two passes of a frame.

use std::ops::{Index, IndexMut};

/// Surfaces are drawn first: volumes lie before and behind their cuts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pass {
    Surfaces,
    Volumes,
}

impl Pass {
    /// In the order of drawing.
    pub(crate) const BOTH: [Self; 2] = [Self::Surfaces, Self::Volumes];
}

/// One for each pass.
#[derive(Clone, Debug, Default)]
pub(crate) struct PerPass<T> {
    pub(crate) surfaces: T,
    pub(crate) volumes: T,
}

impl<T> PerPass<T> {
    /// Both, in the order of drawing.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &T> {
        [&self.surfaces, &self.volumes].into_iter()
    }
}

impl<T> Index<Pass> for PerPass<T> {
    type Output = T;

    fn index(&self, pass: Pass) -> &T {
        match pass {
            Pass::Surfaces => &self.surfaces,
            Pass::Volumes => &self.volumes,
        }
    }
}

impl<T> IndexMut<Pass> for PerPass<T> {
    fn index_mut(&mut self, pass: Pass) -> &mut T {
        match pass {
            Pass::Surfaces => &mut self.surfaces,
            Pass::Volumes => &mut self.volumes,
        }
    }
}
