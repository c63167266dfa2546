//! Clouds of surfels that are made one after the other, without arrays in between.

use crate::closed::Closed;
use crate::cloud::{Cloud, CloudError, Material, check_material, check_names, check_surface, wrong};
use crate::columns::{BLOCKS_A_TASK, Column, Columns, Factors, Kind, LANES, Lanes, Repeated, SurfaceKind};
use glam::{Mat3, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// A sample of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Surfel {
    /// Its centre in cloud space.
    pub center: Vec3,
    /// The factor of its covariance, as in [`crate::Shapes`]; its normal is that of the first two half-axes.
    pub factor: Mat3,
    /// The surface area that it stands for, in squared world units; at least 0.
    pub area: f32,
    /// Linear Rec. 709 colour, finite; not read where the look has one for all.
    pub color: [f32; 3],
}

/// What the surfels of a cloud share; as in [`crate::Surface`] and [`crate::Splats`].
#[derive(Clone, Debug, PartialEq)]
pub struct SurfelLook {
    /// Linear Rec. 709 colour of all; without it each has its own.
    pub color: Option<[f32; 3]>,
    /// Opacity of the surface in [0, 1].
    pub opacity: f32,
    /// World units.
    pub depth_tolerance: f32,
    /// In (0, 1].
    pub coverage_floor: f32,
    /// From where backs are dropped.
    pub closed: Closed,
    /// How the surface answers light.
    pub material: Material,
}

/// Surfels that a thread makes at a time.
const TOGETHER: usize = BLOCKS_A_TASK * LANES;

impl Cloud {
    /// The cloud of `count` surfels in one look, each of which is lit by the normal of its shape: equal to that of
    /// [`Cloud::new`] of arrays without normals, in a fraction of the time. `surfels` gives those with the numbers of a range,
    /// in order, and is asked by several threads at once, for each range once.
    ///
    /// # Errors
    /// Those of [`Cloud::new`], and when a range has fewer surfels than numbers.
    pub fn of_surfels<I: Iterator<Item = Surfel>>(
        count: usize,
        look: &SurfelLook,
        surfels: impl Fn(Range<usize>) -> I + Sync,
    ) -> Result<Self, CloudError> {
        let mut cloud = Self::default();
        cloud.renew(count, look, surfels)?;
        Ok(cloud)
    }

    /// Becomes what [`Cloud::of_surfels`] gives, in the memory that it has if no clone shares it: for surfaces that change from one
    /// picture to the next. Without it allocators may get all memory anew from the system each time.
    ///
    /// # Errors
    /// Those of [`Cloud::of_surfels`]. Then it is empty.
    pub fn renew<I: Iterator<Item = Surfel>>(
        &mut self,
        count: usize,
        look: &SurfelLook,
        surfels: impl Fn(Range<usize>) -> I + Sync,
    ) -> Result<(), CloudError> {
        let old = std::mem::take(self);
        check_names(count)?;
        look.check()?;
        let mut rows = Rows::in_memory_of(old.into_columns(), count.div_ceil(LANES), look.color.is_none());
        let fill = |(task, mut rows): (usize, RowsMut)| {
            let numbers = task * TOGETHER..count.min((task + 1) * TOGETHER);
            rows.fill(surfels(numbers.clone()).take(numbers.len()), numbers)
        };
        let filled: Vec<Result<Option<Vec<[Lanes; 3]>>, CloudError>> =
            rows.tasks().enumerate().map(fill).collect();
        let through = filled.into_iter().collect::<Result<Vec<_>, _>>()?;
        let Rows { centers, flat, areas, colors } = rows;
        let SurfelLook { color, opacity, depth_tolerance, coverage_floor, ref closed, material } = *look;
        *self = Self::of_columns(Columns {
            len: count,
            factors: Factors::Each { flat: Column::of_blocks(flat), through: joined(through, centers.len()) },
            centers: Column::of_blocks(centers),
            kind: Kind::Surface(SurfaceKind::of_samples(depth_tolerance, coverage_floor, closed.clone())),
            strengths: Repeated::Each(Column::of_blocks(areas)),
            opacities: (opacity < 1.0).then(|| Column::alike(count, [opacity])),
            colors: Repeated::Each(
                color.map_or_else(|| Column::of_blocks(colors), |color| Column::alike(count, color)),
            ),
            harmonics: None,
            normals: None,
            orientations: None,
            grains: None,
            material,
        });
        Ok(())
    }
}

/// The third columns of factors from those of each task, which has none where all are flat.
fn joined(tasks: Vec<Option<Vec<[Lanes; 3]>>>, blocks: usize) -> Column<3> {
    let flat = [[0.0; LANES]; 3];
    if tasks.iter().all(Option::is_none) {
        return Column::alike(blocks, [0.0; 3]);
    }
    let mut all = Vec::with_capacity(blocks);
    for (task, own) in tasks.into_iter().enumerate() {
        let end = blocks.min((task + 1) * BLOCKS_A_TASK);
        all.extend(own.unwrap_or_default());
        all.resize(end, flat);
    }
    Column::of_blocks(all)
}

impl SurfelLook {
    fn check(&self) -> Result<(), CloudError> {
        if let Some(color) = self.color
            && !color.iter().all(|c| c.is_finite())
        {
            return Err(wrong(0, "colour", format!("{color:?}"), "it must be finite"));
        }
        if !(0.0..=1.0).contains(&self.opacity) {
            return Err(wrong(0, "opacities", self.opacity.to_string(), "an opacity is from 0 to 1"));
        }
        check_material(self.material)?;
        self.closed.check()?;
        check_surface(self.depth_tolerance, self.coverage_floor)
    }
}

impl Surfel {
    /// Says what is wrong with the one that has this number.
    fn check(&self, index: usize) -> Result<(), CloudError> {
        let Self { center, factor, area, color } = self;
        if !center.is_finite() {
            return Err(wrong(index, "centre", format!("{center:?}"), "it must be finite"));
        }
        if !factor.is_finite() {
            return Err(wrong(index, "shape", format!("{factor:?}"), "it must be finite"));
        }
        if !(0.0..=f32::MAX).contains(area) {
            return Err(wrong(index, "areas", area.to_string(), "an area is finite and at least 0"));
        }
        if !color.iter().all(|c| c.is_finite()) {
            return Err(wrong(index, "colour", format!("{color:?}"), "it must be finite"));
        }
        Ok(())
    }
}

/// The numbers of surfels, in blocks.
struct Rows {
    centers: Vec<[Lanes; 3]>,
    flat: Vec<[Lanes; 6]>,
    areas: Vec<[Lanes; 1]>,
    /// Empty where all have one.
    colors: Vec<[Lanes; 3]>,
}

/// Those of a task.
struct RowsMut<'a> {
    centers: &'a mut [[Lanes; 3]],
    flat: &'a mut [[Lanes; 6]],
    areas: &'a mut [[Lanes; 1]],
    colors: &'a mut [[Lanes; 3]],
}

impl Rows {
    /// Room for blocks of surfels, old numbers in it.
    fn in_memory_of(columns: Columns, blocks: usize, has_colors: bool) -> Self {
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

    fn tasks(&mut self) -> impl IndexedParallelIterator<Item = RowsMut<'_>> {
        let Self { centers, flat, areas, colors } = self;
        let tasks = centers.len().div_ceil(BLOCKS_A_TASK);
        let mut colors: Vec<&mut [[Lanes; 3]]> = colors.chunks_mut(BLOCKS_A_TASK).collect();
        colors.resize_with(tasks, Default::default);
        let places = centers.par_chunks_mut(BLOCKS_A_TASK).zip(areas.par_chunks_mut(BLOCKS_A_TASK));
        places
            .zip(flat.par_chunks_mut(BLOCKS_A_TASK))
            .zip(colors)
            .map(|(((centers, areas), flat), colors)| RowsMut { centers, flat, areas, colors })
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

impl RowsMut<'_> {
    /// Puts surfels in their places; gives the third columns of their factors unless all are flat.
    fn fill(
        &mut self,
        surfels: impl Iterator<Item = Surfel>,
        numbers: Range<usize>,
    ) -> Result<Option<Vec<[Lanes; 3]>>, CloudError> {
        let (mut found, mut through) = (0, None);
        surfels.for_each(|surfel| {
            self.put(found, &surfel, &mut through);
            found += 1;
        });
        if !self.are_right(through.as_deref()) {
            (0..found)
                .try_for_each(|place| self.get(place, through.as_deref()).check(numbers.start + place))?;
        }
        if found < numbers.len() {
            let (found, expected) = (numbers.start + found, numbers.end);
            return Err(CloudError::Length { array: "surfels", found, expected });
        }
        // The last block is filled up with its last splat.
        if found % LANES != 0 {
            let last = self.get(found - 1, through.as_deref());
            (found..found.next_multiple_of(LANES)).for_each(|place| self.put(place, &last, &mut through));
        }
        Ok(through)
    }

    /// Whether nothing is wrong, not even with what was there before.
    fn are_right(&self, through: Option<&[[Lanes; 3]]>) -> bool {
        let Self { centers, flat, areas, colors } = self;
        are_finite(centers)
            && are_finite(flat)
            && are_finite(areas)
            && are_finite(colors)
            && through.is_none_or(are_finite)
            && areas.as_flattened().as_flattened().iter().fold(true, |all, area| all & (*area >= 0.0))
    }

    /// A surfel as it was put in its place; black where all have one colour.
    fn get(&self, place: usize, through: Option<&[[Lanes; 3]]>) -> Surfel {
        let (block, lane) = (place / LANES, place % LANES);
        let [a, b, c, d, e, f] = self.flat[block].map(|row| row[lane]);
        let [g, h, i] = through.map_or([0.0; 3], |through| through[block].map(|row| row[lane]));
        Surfel {
            center: Vec3::from(self.centers[block].map(|row| row[lane])),
            factor: Mat3::from_cols_array(&[a, b, c, d, e, f, g, h, i]),
            area: self.areas[block][0][lane],
            color: self.colors.get(block).map_or([0.0; 3], |color| color.map(|row| row[lane])),
        }
    }

    #[inline(always)]
    fn put(&mut self, place: usize, surfel: &Surfel, through: &mut Option<Vec<[Lanes; 3]>>) {
        let (block, lane) = (place / LANES, place % LANES);
        let Surfel { center, factor, area, color } = surfel;
        let [a, b, c, d, e, f, third @ ..] = factor.to_cols_array();
        set(&mut self.centers[block], lane, center.to_array());
        set(&mut self.areas[block], lane, [*area]);
        set(&mut self.flat[block], lane, [a, b, c, d, e, f]);
        if !self.colors.is_empty() {
            set(&mut self.colors[block], lane, *color);
        }
        if third != [0.0; 3] {
            let through = through.get_or_insert_with(|| vec![[[0.0; LANES]; 3]; self.centers.len()]);
            set(&mut through[block], lane, third);
        }
    }
}

fn are_finite<const N: usize>(blocks: &[[Lanes; N]]) -> bool {
    blocks.as_flattened().as_flattened().iter().fold(true, |all, number| all & number.is_finite())
}

#[inline(always)]
fn set<const N: usize>(rows: &mut [Lanes; N], lane: usize, numbers: [f32; N]) {
    for (row, number) in rows.iter_mut().zip(numbers) {
        row[lane % LANES] = number;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{Shapes, Splats, Strength, Surface};
    use glam::{DAffine3, DVec3};

    const LOOK: SurfelLook = SurfelLook {
        color: Some([0.5, 0.25, 1.0]),
        opacity: 0.75,
        depth_tolerance: 0.5,
        coverage_floor: 0.9,
        closed: Closed::EVERYWHERE,
        material: Material::UNLIT,
    };

    /// Different ones, flat or not.
    fn surfel(index: usize, thickness: f32) -> Surfel {
        let x = index as f32;
        let factor = Mat3::from_cols(Vec3::X * (1.0 + x), Vec3::Y * 2.0, Vec3::Z * thickness);
        Surfel { center: Vec3::new(x, -x, 1.0), factor, area: 0.5 * x, color: [0.5 * x, 1.0, 0.0] }
    }

    fn arrays(count: usize, thickness: f32, look: &SurfelLook) -> Splats {
        let all = || (0..count).map(|i| surfel(i, thickness));
        Splats {
            centers: all().map(|surfel| surfel.center).collect(),
            shapes: Shapes::Each(all().map(|surfel| surfel.factor).collect()),
            strength: Strength::Surface(Surface {
                areas: all().map(|surfel| surfel.area).collect(),
                opacities: Some(vec![LOOK.opacity; count]),
                depth_tolerance: LOOK.depth_tolerance,
                coverage_floor: LOOK.coverage_floor,
                closed: LOOK.closed,
            }),
            colors: all().map(|surfel| look.color.unwrap_or(surfel.color)).collect(),
            harmonics: None,
            normals: None,
            material: LOOK.material,
        }
    }

    #[test]
    fn a_cloud_of_surfels_is_that_of_their_arrays() {
        for count in [0, 1, 7, 8, 9, 16, TOGETHER, 2 * TOGETHER + 3] {
            for thickness in [0.0, 0.25] {
                for look in [LOOK, SurfelLook { color: None, ..LOOK }] {
                    let made = Cloud::of_surfels(count, &look, |range| range.map(|i| surfel(i, thickness)));
                    let (made, arrays) = (made.unwrap(), arrays(count, thickness, &look));
                    assert_eq!(made.splats(), arrays, "{count}");
                    assert_eq!(made, Cloud::new(arrays).unwrap(), "{count}");
                }
            }
        }
    }

    #[test]
    fn a_renewed_cloud_is_a_new_one() {
        let mut cloud = Cloud::default();
        for is_shared in [false, true] {
            for (count, thickness, color) in [
                (3 * TOGETHER + 1, 0.0, None),
                (2 * TOGETHER + 3, 0.25, LOOK.color),
                (TOGETHER, 0.0, LOOK.color),
                (9, 0.5, None),
                (TOGETHER + 9, 0.0, None),
            ] {
                let clone = is_shared.then(|| (cloud.clone(), cloud.splats()));
                let look = SurfelLook { color, ..LOOK };
                cloud = cloud.transformed(DAffine3::from_scale(DVec3::splat(2.0)));
                cloud.renew(count, &look, |range| range.map(|i| surfel(i, thickness))).unwrap();
                assert_eq!(cloud, Cloud::new(arrays(count, thickness, &look)).unwrap(), "{count}");
                assert!(clone.is_none_or(|(clone, before)| clone.splats() == before), "{count}");
            }
        }
        let short = |range: Range<usize>| range.skip(1).map(|i| surfel(i, 0.0));
        assert!(cloud.renew(TOGETHER, &LOOK, short).is_err());
        assert!(cloud.is_empty());
    }

    #[test]
    fn only_parts_that_are_not_flat_have_third_columns() {
        let count = 3 * TOGETHER + 3;
        let mixed = |index: usize| surfel(index, if index / TOGETHER == 1 { 0.5 } else { 0.0 });
        let cloud = Cloud::of_surfels(count, &LOOK, |range| range.map(mixed)).unwrap();
        (0..count).for_each(|index| assert_eq!(cloud.factor(index), mixed(index).factor, "{index}"));
    }

    #[test]
    fn the_first_surfel_that_is_wrong_is_refused() {
        type Spoil = fn(&mut Surfel);
        let count = 2 * TOGETHER + 3;
        let look = SurfelLook { color: None, ..LOOK };
        let made = |bad: Spoil, at: [usize; 2]| {
            Cloud::of_surfels(count, &look, move |range| {
                range.map(move |i| {
                    let mut surfel = surfel(i, 0.0);
                    if at.contains(&i) {
                        bad(&mut surfel);
                    }
                    surfel
                })
            })
        };
        let cases: [(Spoil, &str); 4] = [
            (|surfel| surfel.center.y = f32::NAN, "centre"),
            (|surfel| surfel.factor.y_axis.x = f32::INFINITY, "shape"),
            (|surfel| surfel.area = -1.0, "areas"),
            (|surfel| surfel.color[1] = f32::NAN, "colour"),
        ];
        for (bad, name) in cases {
            let first = TOGETHER + 5;
            match made(bad, [count - 1, first]) {
                Err(CloudError::Value { index, what, .. }) => assert_eq!((index, what), (first, name)),
                other => panic!("{name}: {:?}", other.err()),
            }
        }
        let gray = |range: Range<usize>| range.map(|i| Surfel { color: [f32::NAN; 3], ..surfel(i, 0.0) });
        assert!(Cloud::of_surfels(count, &LOOK, gray).is_ok(), "their own colours are not used");
        let short = Cloud::of_surfels(count, &LOOK, |range| range.skip(1).map(|i| surfel(i, 0.0)));
        assert!(matches!(short, Err(CloudError::Length { array: "surfels", .. })));
        let dark = SurfelLook { color: Some([f32::NAN; 3]), ..LOOK };
        assert!(Cloud::of_surfels(1, &dark, |range| range.map(|i| surfel(i, 0.0))).is_err());
        let ghost = SurfelLook { opacity: f32::NAN, ..LOOK };
        assert!(Cloud::of_surfels(1, &ghost, |range| range.map(|i| surfel(i, 0.0))).is_err());
    }
}
