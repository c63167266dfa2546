//! The memory that surfels of a cloud are put in, row by row.

use super::Surfel;
use crate::cloud::CloudError;
use crate::columns::{BLOCKS_A_TASK, Column, Columns, Factors, LANES, Lanes};
use crate::simd::{Level, dispatch};
use glam::{Mat3, Vec3};
use rayon::prelude::*;
use std::ops::Range;
use std::slice;

/// Surfels that a thread makes at a time.
pub(super) const TOGETHER: usize = BLOCKS_A_TASK * LANES;

/// Consecutive samples of a surface, each number in a row of its own; all rows are of one length.
#[derive(Clone, Copy, Debug)]
pub struct SurfelRows<'a> {
    /// x, y and z of centres in cloud space.
    pub centers: [&'a [f32]; 3],
    /// The first two columns of the factors of covariances, as in [`crate::Shapes`], one after the other: half-axes in cloud space, whose normal is
    /// the surface's.
    pub half_axes: [&'a [f32]; 6],
    /// The third columns, along the normal; without them surfels are flat.
    pub through: Option<[&'a [f32]; 3]>,
    /// The surface areas that they stand for, in squared world units; at least 0.
    pub areas: &'a [f32],
    /// Linear Rec. 709; not read where the look has one for all.
    pub colors: [&'a [f32]; 3],
}

/// The numbers of surfels, in blocks.
pub(super) struct CloudRows {
    pub(super) centers: Vec<[Lanes; 3]>,
    pub(super) flat: Vec<[Lanes; 6]>,
    pub(super) areas: Vec<[Lanes; 1]>,
    /// Empty where all have one.
    pub(super) colors: Vec<[Lanes; 3]>,
}

/// Where the surfels of a range go.
#[derive(Debug)]
pub struct SurfelPlaces<'a> {
    /// How many there are room for, and how many have come.
    len: usize,
    found: usize,
    centers: &'a mut [[Lanes; 3]],
    flat: &'a mut [[Lanes; 6]],
    areas: &'a mut [[Lanes; 1]],
    /// Empty where all have one.
    colors: &'a mut [[Lanes; 3]],
    /// The third columns of factors, unless all are flat so far.
    through: Option<Vec<[Lanes; 3]>>,
}

impl CloudRows {
    /// Room for blocks of surfels, old numbers in it.
    pub(super) fn in_memory_of(columns: Columns, blocks: usize, has_colors: bool) -> Self {
        let Columns { centers, factors, strengths, colors, .. } = columns;
        let flat = match factors {
            Factors::Each { flat, .. } => flat,
            Factors::Shared(_) => Column::default(),
        };
        let has = |has_any: bool| if has_any { blocks } else { 0 };
        Self {
            centers: room(centers, blocks),
            flat: room(flat, blocks),
            areas: room(strengths.into_each(), blocks),
            colors: room(colors.into_each(), has(has_colors)),
        }
    }

    /// Places for `count` surfels, as many together as a thread makes at a time, and their numbers.
    pub(super) fn tasks(
        &mut self,
        count: usize,
    ) -> impl IndexedParallelIterator<Item = (Range<usize>, SurfelPlaces<'_>)> {
        let Self { centers, flat, areas, colors } = self;
        let tasks = centers.len().div_ceil(BLOCKS_A_TASK);
        let mut colors: Vec<&mut [[Lanes; 3]]> = colors.chunks_mut(BLOCKS_A_TASK).collect();
        colors.resize_with(tasks, Default::default);
        let places = centers.par_chunks_mut(BLOCKS_A_TASK).zip(areas.par_chunks_mut(BLOCKS_A_TASK));
        let places = places.zip(flat.par_chunks_mut(BLOCKS_A_TASK)).zip(colors);
        places.enumerate().map(move |(task, (((centers, areas), flat), colors))| {
            let numbers = task * TOGETHER..count.min((task + 1) * TOGETHER);
            let len = numbers.len();
            (numbers, SurfelPlaces { len, found: 0, centers, flat, areas, colors, through: None })
        })
    }
}

/// As many blocks, in the memory of a column if there is enough. Else they come as zeros, which systems give for nothing: each place is
/// touched once, by the thread that fills it.
fn room<const N: usize>(column: Column<N>, blocks: usize) -> Vec<[Lanes; N]> {
    let mut room = column.into_blocks();
    if room.capacity() < blocks {
        return vec![[[0.0; LANES]; N]; blocks];
    }
    room.resize(blocks, [[0.0; LANES]; N]);
    room
}

impl SurfelPlaces<'_> {
    /// Puts surfels behind those that have come; what there is no room for is left out. Rows of different lengths are refused: nothing
    /// more is taken then, and what is missing of the range is an error.
    pub fn put(&mut self, rows: &SurfelRows) {
        let SurfelRows { centers, half_axes, through, areas, colors } = rows;
        let has_colors = !self.colors.is_empty();
        let colors_of_each: &[&[f32]] = if has_colors { colors } else { &[] };
        let through_of_each: &[&[f32]] = through.as_ref().map_or(&[], |through| through);
        let mut all = centers.iter().chain(half_axes).chain(through_of_each).chain(colors_of_each);
        if !all.all(|row| row.len() == areas.len()) {
            self.len = self.found;
        }
        let len = areas.len().min(self.len - self.found);
        let places = self.found..self.found + len;
        dispatch!(Level::best(), _simd => {
            copy(self.centers, places.clone(), centers);
            copy(self.flat, places.clone(), half_axes);
            copy(self.areas, places.clone(), &[areas]);
            if has_colors {
                copy(self.colors, places.clone(), colors);
            }
        });
        if let Some(rows) = through
            && rows.iter().any(|row| row[..len].iter().any(|number| *number != 0.0))
        {
            let through = self.through.get_or_insert_with(|| vec![[[0.0; LANES]; 3]; self.centers.len()]);
            copy(through, places.clone(), rows);
        }
        self.found = places.end;
    }

    /// Puts one surfel there.
    pub(super) fn put_one(&mut self, surfel: &Surfel) {
        let Surfel { center, factor, area, color } = surfel;
        let [a, b, c, d, e, f, through @ ..] = factor.to_cols_array();
        self.put(&SurfelRows {
            centers: center.to_array().each_ref().map(slice::from_ref),
            half_axes: [a, b, c, d, e, f].each_ref().map(slice::from_ref),
            through: Some(through.each_ref().map(slice::from_ref)),
            areas: slice::from_ref(area),
            colors: color.each_ref().map(slice::from_ref),
        });
    }

    /// Gives the third columns of factors unless all are flat, when all have come and nothing is wrong with any.
    pub(super) fn finish(mut self, numbers: Range<usize>) -> Result<Option<Vec<[Lanes; 3]>>, CloudError> {
        let found = self.found;
        if !dispatch!(Level::best(), _simd => self.are_right()) {
            (0..found).try_for_each(|place| self.get(place).check(numbers.start + place))?;
        }
        if found < numbers.len() {
            let (found, expected) = (numbers.start + found, numbers.end);
            return Err(CloudError::Length { array: "surfels", found, expected });
        }
        // The last block is filled up with its last splat.
        if !found.is_multiple_of(LANES) {
            let last = self.get(found - 1);
            self.len = found.next_multiple_of(LANES);
            (found..self.len).for_each(|_| self.put_one(&last));
        }
        Ok(self.through)
    }

    /// Whether nothing is wrong, not even with what was there before.
    #[inline(always)]
    fn are_right(&self) -> bool {
        let Self { centers, flat, areas, colors, through, .. } = self;
        are_finite(centers)
            && are_finite(flat)
            && are_finite(areas)
            && are_finite(colors)
            && through.as_deref().is_none_or(are_finite)
            && areas.as_flattened().as_flattened().iter().fold(true, |all, area| all & (*area >= 0.0))
    }

    /// A surfel as it was put in its place; black where all have one colour.
    fn get(&self, place: usize) -> Surfel {
        let (block, lane) = (place / LANES, place % LANES);
        let [a, b, c, d, e, f] = self.flat[block].map(|row| row[lane]);
        let [g, h, i] = self.through.as_ref().map_or([0.0; 3], |through| through[block].map(|row| row[lane]));
        Surfel {
            center: Vec3::from(self.centers[block].map(|row| row[lane])),
            factor: Mat3::from_cols_array(&[a, b, c, d, e, f, g, h, i]),
            area: self.areas[block][0][lane],
            color: self.colors.get(block).map_or([0.0; 3], |color| color.map(|row| row[lane])),
        }
    }
}

/// Puts the beginnings of rows in places of blocks.
#[inline(always)]
fn copy<const N: usize>(blocks: &mut [[Lanes; N]], places: Range<usize>, rows: &[&[f32]; N]) {
    let (first, lane) = (places.start / LANES, places.start % LANES);
    let head = places.len().min((LANES - lane) % LANES);
    let blocks = &mut blocks[first..];
    for (i, row) in rows.iter().enumerate() {
        let (head, rest) = row[..places.len()].split_at(head);
        let (whole, tail) = rest.as_chunks::<LANES>();
        // Loops, since to call what copies takes longer than that.
        for (at, number) in head.iter().enumerate() {
            blocks[0][i][(lane + at) % LANES] = *number;
        }
        let blocks = &mut blocks[(lane + head.len()) / LANES..];
        for (block, whole) in blocks.iter_mut().zip(whole) {
            block[i] = *whole;
        }
        for (at, number) in tail.iter().enumerate() {
            blocks[whole.len()][i][at % LANES] = *number;
        }
    }
}

#[inline(always)]
fn are_finite<const N: usize>(blocks: &[[Lanes; N]]) -> bool {
    blocks.as_flattened().as_flattened().iter().fold(true, |all, number| all & number.is_finite())
}
