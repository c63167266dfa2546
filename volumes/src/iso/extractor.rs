//! A volume, ready for one value after another.

use std::borrow::Borrow;

use oblate_engine::simd::dispatch;
use rayon::prelude::*;

use super::block::Block;
use super::cells::{Scratch, Search};
use super::ends::Ends;
use super::hierarchy::Hierarchy;
use super::polygon::Geometry;
use super::slab::{Scalar, with_slab};
use super::surfel::Interpolation;
use super::surfels::IsoSurfels;
use super::{IsoError, check};
use crate::volume::{GridFrame, Volume};

/// A volume ready to become iso-surfels at one value after another, as while a user moves the value.
///
/// It knows the smallest and largest values in each brick of 8×8×8 cells (8 bytes a brick), and in blocks of 4×4×4 bricks, so that
/// bricks without the surface are not looked at.
///
/// ```
/// # use oblate_volumes::{Interpolation, IsoExtractor, IsoSurfels, shepp_logan};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let volume = shepp_logan(32)?;
/// let extractor = IsoExtractor::new(&volume);
/// let mut surfels = IsoSurfels::default();
/// for value in [0.1, 0.2, 0.3] {
///     extractor.extract_into(value, Interpolation::Trilinear, &mut surfels)?;
///     assert!(surfels.area() > 0.0);
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct IsoExtractor<V> {
    volume: V,
    hierarchy: Hierarchy,
}

impl<V: Borrow<Volume>> IsoExtractor<V> {
    /// Looks through the samples of a `Volume`, of a reference to one, or of an `Arc` of one.
    pub fn new(volume: V) -> Self {
        let (dims, voxels) = (volume.borrow().dims(), volume.borrow().voxels());
        let hierarchy = with_slab!(voxels, dims, 0, slab => Hierarchy::new(slab, [0, dims[2]]));
        Self { volume, hierarchy }
    }

    /// The volume.
    pub fn volume(&self) -> &Volume {
        self.volume.borrow()
    }

    /// The surfels of the surface at `value`: see [`iso_surfels`](super::iso_surfels).
    ///
    /// # Errors
    /// When `value` is not finite, or single precision has no room for the grid's lengths or areas.
    pub fn extract(&self, value: f32, interpolation: Interpolation) -> Result<IsoSurfels, IsoError> {
        let mut surfels = IsoSurfels::default();
        self.extract_into(value, interpolation, &mut surfels)?;
        Ok(surfels)
    }

    /// As [`Self::extract`], over surfels that are there: their memory is used again, which is quicker than to ask for more.
    ///
    /// # Errors
    /// As [`Self::extract`]; then nothing has changed.
    pub fn extract_into(
        &self,
        value: f32,
        interpolation: Interpolation,
        surfels: &mut IsoSurfels,
    ) -> Result<(), IsoError> {
        let volume = self.volume();
        let dims = volume.dims();
        let geometry = geometry(volume.frame(), dims, value)?;
        with_slab!(volume.voxels(), dims, 0, slab => {
            let search = Search::new(slab, &self.hierarchy, &geometry, (value, interpolation));
            surfels.closed = find(&search, &mut surfels.blocks).closed(volume.frame(), dims);
        });
        (surfels.frame, surfels.irregular) = (volume.frame(), false);
        Ok(())
    }
}

/// The maps of a grid, where it and the value allow surfels in single precision.
pub(super) fn geometry(frame: GridFrame, dims: [usize; 3], value: f32) -> Result<Geometry, IsoError> {
    check("the iso-value", value, value.is_finite(), "it must be finite")?;
    let steps = frame.direction * glam::DMat3::from_diagonal(frame.spacing);
    let geometry = Geometry::new(steps);
    let columns = [steps.x_axis, steps.y_axis, steps.z_axis];
    let extent = (0..3).map(|axis| columns[axis].length() * dims[axis] as f64).sum::<f64>();
    let step = f64::from(geometry.unit);
    // Areas of the smallest polygons are millionths of faces.
    let [shortest, farthest] = [1e-15, 1e18];
    if frame.spacing.min_element() < shortest || extent > farthest || !extent.is_finite() {
        let expected = "steps must be at least 1e-15, and the grid reach at most 1e18";
        return Err(IsoError::Extent { step, extent, expected });
    }
    Ok(geometry)
}

/// Finds the surfels of all blocks; says where the body ends.
pub(super) fn find<T: Scalar>(search: &Search<'_, T>, found: &mut Vec<Block>) -> Ends {
    let blocks = search.hierarchy.blocks(search.value);
    found.resize_with(blocks.len(), Block::default);
    let level = search.level;
    let one = |scratch: &mut Scratch, (to, block): (&mut Block, &[usize; 3])| {
        std::mem::swap(&mut scratch.surfels, to);
        dispatch!(level, simd => scratch.block(simd, search, *block));
        std::mem::swap(&mut scratch.surfels, to);
        scratch.ends
    };
    let ends = found.par_iter_mut().zip(&blocks).map_init(Scratch::new, one);
    ends.reduce(Ends::default, Ends::and).and(Ends::of_corners(search.slab, search.value))
}

#[cfg(test)]
mod tests {
    use super::super::IsoSurfels;
    use super::*;
    use crate::phantom::marschner_lobb;
    use crate::volume::Voxels;
    use oblate_engine::simd::Level;

    /// Surfels differ between levels of SIMD by roundings of single precision, in numbers of at most 99, and by what they do to the
    /// last of Newton's steps; all are there on all.
    #[test]
    fn levels_agree() {
        let volume = marschner_lobb(100).unwrap();
        let Voxels::F32(samples) = volume.voxels() else { panic!("the phantom has f32 samples") };
        let (dims, frame) = (volume.dims(), GridFrame::default());
        let slab = crate::iso::slab::Slab { samples: &samples[..], dims, first: 0 };
        let hierarchy = Hierarchy::new(slab, [0, dims[2]]);
        let geometry = geometry(frame, dims, 0.5).unwrap();
        for interpolation in [Interpolation::Trilinear, Interpolation::Tricubic] {
            let on = |level: Level| {
                let search =
                    Search { level, ..Search::new(slab, &hierarchy, &geometry, (0.5, interpolation)) };
                let mut found = IsoSurfels { frame, ..IsoSurfels::default() };
                found.closed = find(&search, &mut found.blocks).closed(frame, dims);
                found
            };
            let levels = Level::ALL.into_iter().filter(|level| level.is_available());
            let all: Vec<IsoSurfels> = levels.map(on).collect();
            for other in &all[1..] {
                assert_eq!(all[0].len(), other.len());
                let mut far = 0;
                for (a, b) in all[0].iter().zip(other.iter()) {
                    let is_near = (a.center - b.center).length() < 1e-3
                        && (a.area - b.area).abs() < 1e-4
                        && a.normal().dot(b.normal()) > 0.9999;
                    far += usize::from(!is_near);
                }
                // Where the field is flat a rounding may lead to another zero.
                assert!(far * 1000 <= other.len(), "{far} of {}", other.len());
            }
        }
    }
}
