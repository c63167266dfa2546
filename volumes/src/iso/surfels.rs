//! Surfels as they are found, and as a cloud.

use std::ops::Range;

use bytemuck::allocation::cast_vec;
use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use oblate_engine::{Closed, Cloud, Shapes, Splats, Strength, Surface, SurfelLook, SurfelPlaces};

use super::block::{Block, Chunk};
use super::surfel::IsoSurfel;
use super::{IRREGULAR_COVERAGE_FLOOR, ISO_COVERAGE_FLOOR, IsoError, IsoSettings};
use crate::volume::GridFrame;

/// A little more than the largest standard deviation of a surfel, in steps: no polygon in a cell has much more than 1/6 as
/// its variance along an axis, to which the blur adds 0.16.
const SURFEL_RADIUS: f64 = 0.6;

/// The standard deviation of a surfel along its longer half-axis, in steps, on average.
const MEAN_RADIUS: f64 = 0.5;

/// The surfels of a surface: 40 bytes each, in chunks of 128, block of cells by block, in Morton order of bricks of 8×8×8 cells, and in these cube
/// by cube of 2×2×2.
#[derive(Clone, Debug, PartialEq)]
pub struct IsoSurfels {
    pub(super) blocks: Vec<Block>,
    pub(super) closed: Closed,
    pub(super) frame: GridFrame,
    /// Whether its cells were cubes of index space that lie elsewhere.
    pub(super) irregular: bool,
}

impl Default for IsoSurfels {
    fn default() -> Self {
        Self { blocks: Vec::new(), closed: Closed::EVERYWHERE, frame: GridFrame::default(), irregular: false }
    }
}

impl IsoSurfels {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.blocks.iter().map(Block::len).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All of them, in order.
    pub fn iter(&self) -> impl Iterator<Item = IsoSurfel> + '_ {
        self.blocks.iter().flat_map(Block::iter)
    }

    /// Whether the body of values from `iso` on ends nowhere: neither at the grid's border nor beside values that are not finite.
    pub fn is_closed(&self) -> bool {
        self.closed.is_everywhere()
    }

    /// From where no backs are seen: where the body ends at the grid's border, from this side of those of its faces.
    pub fn closed(&self) -> &Closed {
        &self.closed
    }

    /// The area of the surface, in squared world units: the sum of its polygons'.
    pub fn area(&self) -> f64 {
        // A sum for each block, so that its order is the same for any number of threads.
        let of_block = |block: &Block| {
            let areas = block.chunks().iter().flat_map(Chunk::areas);
            areas.map(|area| f64::from(*area)).sum::<f64>()
        };
        // A sum of none is −0.
        self.blocks.par_iter().map(of_block).collect::<Vec<_>>().into_iter().sum::<f64>() + 0.0
    }

    /// Where the grid lies; surfels are relative to its sample (0, 0, 0).
    pub fn frame(&self) -> GridFrame {
        self.frame
    }

    /// The same surface elsewhere: each surfel as `to` makes it, relative to the frame's origin; what it makes nothing of is left out. The
    /// frame's spacing becomes that of surfels as long as these are, on average by area.
    pub(crate) fn mapped(self, frame: GridFrame, to: impl Fn(IsoSurfel) -> Option<IsoSurfel> + Sync) -> Self {
        // Faces of the grid may be bent.
        let closed = if self.is_closed() { Closed::EVERYWHERE } else { Closed::Sided };
        let blocks: Vec<Block> =
            self.blocks.into_par_iter().map(|block| block.iter().filter_map(&to).collect()).collect();
        let of_block = |[areas, lengths]: [f64; 2], surfel: IsoSurfel| {
            let area = f64::from(surfel.area);
            [areas + area, lengths + area * f64::from(surfel.half_axes[0].length())]
        };
        let [areas, lengths] = blocks.iter().flat_map(Block::iter).fold([0.0; 2], of_block);
        let spacing = if areas > 0.0 { lengths / areas / MEAN_RADIUS } else { 1.0 };
        Self { blocks, closed, irregular: true, frame: GridFrame { spacing: DVec3::splat(spacing), ..frame } }
    }

    /// Backs are seen through what is translucent.
    fn closed_if(&self, settings: &IsoSettings) -> Closed {
        if settings.opacity < 1.0 { Closed::Sided } else { self.closed.clone() }
    }

    fn coverage_floor(&self) -> f32 {
        if self.irregular { IRREGULAR_COVERAGE_FLOOR } else { ISO_COVERAGE_FLOOR }
    }

    /// As splats, relative to the grid's sample (0, 0, 0).
    pub fn splats(&self, settings: &IsoSettings) -> Splats {
        self.splats_of(&self.blocks, settings)
    }

    /// The same in parts, so that not all of them are in memory, in order: those of a block of at most 32³ cells each.
    pub fn parts<'a>(&'a self, settings: &'a IsoSettings) -> impl Iterator<Item = Splats> + 'a {
        let blocks = self.blocks.iter().filter(|block| block.len() > 0);
        blocks.map(|block| self.splats_of(std::slice::from_ref(block), settings))
    }

    fn splats_of(&self, blocks: &[Block], settings: &IsoSettings) -> Splats {
        let len = blocks.iter().map(Block::len).sum();
        let mut arrays = Arrays::new(len);
        arrays.fill(blocks, settings.flattening, settings.color);
        Splats {
            centers: cast_vec(arrays.centers),
            shapes: Shapes::Each(cast_vec(arrays.factors)),
            strength: Strength::Surface(Surface {
                areas: arrays.areas,
                opacities: (settings.opacity < 1.0).then(|| vec![settings.opacity; len]),
                depth_tolerance: self.depth_tolerance(),
                coverage_floor: self.coverage_floor(),
                closed: self.closed_if(settings),
            }),
            colors: cast_vec(arrays.colors),
            harmonics: None,
            normals: Some(cast_vec(arrays.normals)),
            material: settings.material,
        }
    }

    /// As a cloud in the world: its space has the world's axes and its origin at sample (0, 0, 0).
    ///
    /// # Errors
    /// When a setting is outside its range, or there are 2³² surfels or more.
    pub fn cloud(&self, settings: &IsoSettings) -> Result<Cloud, IsoError> {
        let mut cloud = Cloud::default();
        self.renew_cloud(&mut cloud, settings)?;
        Ok(cloud)
    }

    /// Makes a cloud what [`Self::cloud`] gives, in the memory that the cloud has ([`Cloud::renew`]): for values that are moved.
    ///
    /// # Errors
    /// Those of [`Self::cloud`]. Then the cloud is as it was, or empty.
    pub fn renew_cloud(&self, cloud: &mut Cloud, settings: &IsoSettings) -> Result<(), IsoError> {
        settings.check()?;
        let look = SurfelLook {
            color: Some(settings.color),
            opacity: settings.opacity,
            depth_tolerance: self.depth_tolerance(),
            coverage_floor: self.coverage_floor(),
            closed: self.closed_if(settings),
            material: settings.material,
        };
        let chunks: Vec<&Chunk> = self.blocks.iter().flat_map(Block::chunks).collect();
        let next_end = |end: &mut usize, chunk: &&Chunk| {
            *end += chunk.len();
            Some(*end)
        };
        let ends: Vec<usize> = chunks.iter().scan(0, next_end).collect();
        let surfels = |numbers: Range<usize>, places: &mut SurfelPlaces| {
            let first = ends.partition_point(|end| *end <= numbers.start);
            let begin = first.checked_sub(1).map_or(0, |before| ends[before]);
            // All but the first chunk are taken from their beginning, and the last as far as there is room.
            let mut from = numbers.start - begin;
            for (chunk, end) in chunks[first..].iter().zip(&ends[first..]) {
                chunk.put(from, settings.flattening, places);
                from = 0;
                if *end >= numbers.end {
                    break;
                }
            }
        };
        cloud.renew(self.len(), &look, surfels)?;
        *cloud = std::mem::take(cloud).transformed(DAffine3::from_translation(self.frame.origin));
        Ok(())
    }

    /// About a surfel's radius.
    fn depth_tolerance(&self) -> f32 {
        let steps = self.frame.direction * glam::DMat3::from_diagonal(self.frame.spacing);
        let columns = [steps.x_axis, steps.y_axis, steps.z_axis];
        let longest_step = columns.into_iter().fold(0.0, |longest: f64, step| longest.max(step.length()));
        (SURFEL_RADIUS * longest_step) as f32
    }
}

/// Numbers of splats. They come as zeros, which systems give for nothing.
struct Arrays {
    centers: Vec<f32>,
    factors: Vec<f32>,
    areas: Vec<f32>,
    normals: Vec<f32>,
    colors: Vec<f32>,
}

impl Arrays {
    fn new(len: usize) -> Self {
        Self {
            centers: vec![0.0; 3 * len],
            factors: vec![0.0; 9 * len],
            areas: vec![0.0; len],
            normals: vec![0.0; 3 * len],
            colors: vec![0.0; 3 * len],
        }
    }

    fn fill(&mut self, blocks: &[Block], flattening: f32, color: [f32; 3]) {
        let mut rest = (
            &mut self.centers[..],
            &mut self.factors[..],
            &mut self.areas[..],
            &mut self.normals[..],
            &mut self.colors[..],
        );
        let mut parts = Vec::with_capacity(blocks.len());
        for block in blocks {
            let n = block.len();
            let (centers, factors, areas, normals, colors) = rest;
            let (centers, factors) = (centers.split_at_mut(3 * n), factors.split_at_mut(9 * n));
            let (areas, normals, colors) =
                (areas.split_at_mut(n), normals.split_at_mut(3 * n), colors.split_at_mut(3 * n));
            parts.push((block, centers.0, factors.0, areas.0, normals.0, colors.0));
            rest = (centers.1, factors.1, areas.1, normals.1, colors.1);
        }
        parts.into_par_iter().for_each(|(block, centers, factors, areas, normals, colors)| {
            let vectors = centers.chunks_exact_mut(3).zip(normals.chunks_exact_mut(3));
            let numbers = factors.chunks_exact_mut(9).zip(areas).zip(colors.chunks_exact_mut(3));
            for ((surfel, (center, to_normal)), ((factor, area), to_color)) in
                block.iter().zip(vectors).zip(numbers)
            {
                center.copy_from_slice(&surfel.center.to_array());
                factor.copy_from_slice(&surfel.factor(flattening).to_cols_array());
                *area = surfel.area;
                to_normal.copy_from_slice(&surfel.normal().to_array());
                to_color.copy_from_slice(&color);
            }
        });
    }
}
