//! Clouds of surfels that are made one after the other, without arrays in between.

mod places;

use crate::closed::Closed;
use crate::cloud::{Cloud, CloudError, Material, check_material, check_names, check_surface, wrong};
use crate::columns::{
    BLOCKS_A_TASK, Colors, Column, Columns, Factors, Kind, LANES, Lanes, Repeated, SurfaceKind,
};
use glam::{Mat3, Vec3};
use places::CloudRows;
pub use places::{SurfelPlaces, SurfelRows};
use rayon::prelude::*;
use std::ops::Range;

/// A sample of a surface, with the numbers of [`SurfelRows`].
#[derive(Clone, Copy, Debug, PartialEq)]
struct Surfel {
    center: Vec3,
    factor: Mat3,
    area: f32,
    color: [f32; 3],
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

impl Cloud {
    /// The cloud of `count` surfels in one look, each of which is lit by the normal of its shape: equal to that of
    /// [`Cloud::new`] of arrays without normals, in a fraction of the time. `surfels` puts those with the numbers of a range in their
    /// places, in order, and is asked by several threads at once, for each range once.
    ///
    /// # Errors
    /// Those of [`Cloud::new`], and when a range has fewer surfels than numbers.
    pub fn of_surfels(
        count: usize,
        look: &SurfelLook,
        surfels: impl Fn(Range<usize>, &mut SurfelPlaces) + Sync,
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
    pub fn renew(
        &mut self,
        count: usize,
        look: &SurfelLook,
        surfels: impl Fn(Range<usize>, &mut SurfelPlaces) + Sync,
    ) -> Result<(), CloudError> {
        let old = std::mem::take(self);
        check_names(count)?;
        look.check()?;
        let mut rows =
            CloudRows::in_memory_of(old.into_columns(), count.div_ceil(LANES), look.color.is_none());
        let fill = |(numbers, mut places): (Range<usize>, SurfelPlaces)| {
            surfels(numbers.clone(), &mut places);
            places.finish(numbers)
        };
        let filled: Vec<Result<Option<Vec<[Lanes; 3]>>, CloudError>> = rows.tasks(count).map(fill).collect();
        let through = filled.into_iter().collect::<Result<Vec<_>, _>>()?;
        let CloudRows { centers, flat, areas, colors } = rows;
        let SurfelLook { color, opacity, depth_tolerance, coverage_floor, ref closed, material } = *look;
        *self = Self::of_columns(Columns {
            len: count,
            factors: Factors::Each { flat: Column::of_blocks(flat), through: joined(through, centers.len()) },
            centers: Column::of_blocks(centers),
            kind: Kind::Surface(SurfaceKind::of_samples(depth_tolerance, coverage_floor, closed.clone())),
            strengths: Repeated::Each(Column::of_blocks(areas)),
            opacities: (opacity < 1.0).then(|| Column::alike(count, [opacity])),
            colors: Colors::new(Repeated::Each(
                color.map_or_else(|| Column::of_blocks(colors), |color| Column::alike(count, color)),
            )),
            harmonics: None,
            normals: None,
            orientations: None,
            grains: None,
            opacities_of_own: None,
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

#[cfg(test)]
mod tests {
    use super::places::TOGETHER;
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

    /// Puts those with the numbers of a range, as many at a time as one wouldn't think.
    fn put(places: &mut SurfelPlaces, numbers: Range<usize>, surfel: impl Fn(usize) -> Surfel) {
        let mut lens = [1, 7, 8, 3, 64, 21].into_iter().cycle();
        let mut all = numbers.map(surfel);
        loop {
            let some: Vec<Surfel> = all.by_ref().take(lens.next().unwrap()).collect();
            if some.is_empty() {
                break;
            }
            let row = |number: fn(&Surfel) -> f32| some.iter().map(number).collect::<Vec<f32>>();
            let factors: [Vec<f32>; 9] =
                std::array::from_fn(|i| some.iter().map(|surfel| surfel.factor.to_cols_array()[i]).collect());
            let [a, b, c, d, e, f, through @ ..] = factors.each_ref().map(|row| &row[..]);
            let centers: [fn(&Surfel) -> f32; 3] = [|s| s.center.x, |s| s.center.y, |s| s.center.z];
            let colors: [fn(&Surfel) -> f32; 3] = [|s| s.color[0], |s| s.color[1], |s| s.color[2]];
            places.put(&SurfelRows {
                centers: centers.map(row).each_ref().map(|row| &row[..]),
                half_axes: [a, b, c, d, e, f],
                // Flat ones by themselves have none, now and then.
                through: (some.len() > 3 || some.iter().any(|s| s.factor.z_axis != Vec3::ZERO))
                    .then_some(through),
                areas: &row(|surfel| surfel.area),
                colors: colors.map(row).each_ref().map(|row| &row[..]),
            });
        }
    }

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
                    let surfels = |numbers: Range<usize>, places: &mut SurfelPlaces| {
                        put(places, numbers, |i| surfel(i, thickness))
                    };
                    let made = Cloud::of_surfels(count, &look, surfels);
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
                cloud
                    .renew(count, &look, |numbers, places| put(places, numbers, |i| surfel(i, thickness)))
                    .unwrap();
                assert_eq!(cloud, Cloud::new(arrays(count, thickness, &look)).unwrap(), "{count}");
                assert!(clone.is_none_or(|(clone, before)| clone.splats() == before), "{count}");
            }
        }
        let short = |range: Range<usize>, places: &mut SurfelPlaces| {
            range.skip(1).for_each(|i| places.put_one(&surfel(i, 0.0)));
        };
        assert!(cloud.renew(TOGETHER, &LOOK, short).is_err());
        assert!(cloud.is_empty());
    }

    #[test]
    fn only_parts_that_are_not_flat_have_third_columns() {
        let count = 3 * TOGETHER + 3;
        let mixed = |index: usize| surfel(index, if index / TOGETHER == 1 { 0.5 } else { 0.0 });
        let cloud = Cloud::of_surfels(count, &LOOK, |numbers, places| put(places, numbers, mixed)).unwrap();
        (0..count).for_each(|index| assert_eq!(cloud.factor(index), mixed(index).factor, "{index}"));
    }

    #[test]
    fn the_first_surfel_that_is_wrong_is_refused() {
        type Spoil = fn(&mut Surfel);
        let count = 2 * TOGETHER + 3;
        let look = SurfelLook { color: None, ..LOOK };
        let made = |bad: Spoil, at: [usize; 2]| {
            let own = |i| {
                let mut surfel = surfel(i, 0.0);
                if at.contains(&i) {
                    bad(&mut surfel);
                }
                surfel
            };
            Cloud::of_surfels(count, &look, |numbers, places| put(places, numbers, own))
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
        let gray = |i| Surfel { color: [f32::NAN; 3], ..surfel(i, 0.0) };
        let of_gray = Cloud::of_surfels(count, &LOOK, |numbers, places| put(places, numbers, gray));
        assert!(of_gray.is_ok(), "their own colours are not used");
        let flat = |i| surfel(i, 0.0);
        let short = Cloud::of_surfels(count, &LOOK, |numbers, places| {
            put(places, numbers.start + 1..numbers.end, flat)
        });
        assert!(matches!(short, Err(CloudError::Length { array: "surfels", .. })));
        let dark = SurfelLook { color: Some([f32::NAN; 3]), ..LOOK };
        assert!(Cloud::of_surfels(1, &dark, |numbers, places| put(places, numbers, flat)).is_err());
        let ghost = SurfelLook { opacity: f32::NAN, ..LOOK };
        assert!(Cloud::of_surfels(1, &ghost, |numbers, places| put(places, numbers, flat)).is_err());
    }

    #[test]
    fn what_there_is_no_room_for_is_left_out_and_uneven_rows_are_refused() {
        let count = TOGETHER + 5;
        let flat = |i| surfel(i, 0.0);
        let more = |i| if i < count { flat(i) } else { Surfel { area: f32::NAN, ..flat(0) } };
        let made = Cloud::of_surfels(count, &LOOK, |numbers: Range<usize>, places| {
            // Of the first range surplus ones are right, but the next range's.
            put(places, numbers.start..numbers.end + 3, more);
        });
        assert_eq!(made.unwrap(), Cloud::new(arrays(count, 0.0, &LOOK)).unwrap());
        let row = [1.0; TOGETHER + 9];
        for uneven in 0..14 {
            let rows = |numbers: Range<usize>, places: &mut SurfelPlaces| {
                let of = |number: usize| &row[..numbers.len() + usize::from(number == uneven)];
                places.put(&SurfelRows {
                    centers: [0, 1, 2].map(of),
                    half_axes: [3, 4, 5, 6, 7, 8].map(of),
                    through: Some([9, 10, 11].map(of)),
                    areas: of(12),
                    colors: [&[]; 3],
                });
                // Nor is what comes behind.
                put(places, numbers, flat);
            };
            let made = Cloud::of_surfels(count, &LOOK, rows);
            assert_eq!(made.is_ok(), uneven == 13, "{uneven}");
            assert!(uneven == 13 || matches!(made, Err(CloudError::Length { array: "surfels", .. })));
        }
    }
}
