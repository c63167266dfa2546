//! Sixteen records, number by number.

use crate::footprint::{Form, Kind, MOST_END, Record};
use crate::simd::*;

/// Where the kind and the form are among the bits of a tag.
const KIND: u32 = u32::from_ne_bytes([0, 0, 0xff, 0]);
const FORM: u32 = u32::from_ne_bytes([0, 0, 0, 0xff]);

/// Brings listed records into the cache. The loop over them is so short that most are on their way at once.
#[inline(always)]
pub(super) fn touch(records: &[Record], list: &[u32]) {
    let one_of = |number: &u32| records[*number as usize].depth.to_bits();
    std::hint::black_box(list.iter().fold(0, |all, number| all | one_of(number)));
}

/// The numbers of sixteen records as they are.
pub(super) struct Sixteen<S: Simd> {
    pub(super) mean: [W<S>; 2],
    pub(super) depth: W<S>,
    pub(super) amplitude: W<S>,
    pub(super) conic_root: [W<S>; 3],
    pub(super) sigma_z: W<S>,
    pub(super) depth_slope: [W<S>; 2],
    /// Where opacities end, as powers of 1/2.
    pub(super) ends: W<S>,
    pub(super) color: [W<S>; 3],
    tags: u32x16<S>,
}

impl<S: Simd> Sixteen<S> {
    /// A register for each record, turned into one for each number.
    #[inline(always)]
    pub(super) fn of<'a>(simd: S, record: impl Fn(usize) -> &'a Record) -> Self {
        const NUMBERS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
        let rows = NUMBERS.each(
            #[inline(always)]
            |number| W::simd_from(simd, *record(number).numbers()),
        );
        // In the order of a record's fields.
        let [x, y, depth, amplitude, a, b, c, sigma_z, across, down, _, followers, red, green, blue, tags] =
            columns(rows);
        Self {
            mean: [x, y],
            depth,
            amplitude,
            conic_root: [a, b, c],
            sigma_z,
            depth_slope: [across, down],
            ends: (followers - followers.floor()) * MOST_END,
            color: [red, green, blue],
            tags: tags.to_bits(),
        }
    }

    /// Those of a kind.
    #[inline(always)]
    pub(super) fn of_kind(&self, simd: S, kind: Kind) -> u64 {
        let own = u32x16::simd_from(simd, u32::from_ne_bytes([0, 0, kind as u8, 0]));
        (self.tags & KIND).simd_eq(own).to_bitmask()
    }

    /// Those in a form.
    #[inline(always)]
    pub(super) fn in_form(&self, simd: S, form: Form) -> u64 {
        let own = u32x16::simd_from(simd, u32::from_ne_bytes([0, 0, 0, form as u8]));
        (self.tags & FORM).simd_eq(own).to_bitmask()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footprint::Tag;

    #[test]
    fn every_number_is_in_its_place() {
        let kinds = [Kind::Extinction, Kind::Opacity, Kind::Surface];
        let records: [Record; 16] = std::array::from_fn(|i| {
            let number = |place: usize| (100 * i + place) as f32;
            Record {
                mean: [number(0), number(1)],
                depth: number(2),
                amplitude: number(3),
                conic_root: [number(4), number(5), number(6)],
                sigma_z: number(7),
                depth_slope: [number(8), number(9)],
                amplitude_slope_or_slabs: [number(10), number(11) + i as f32 / 32.0],
                color: [number(12), number(13), number(14)],
                tag: Tag { cloud: u16::MAX - i as u16, kind: kinds[i % 3], form: Form::ALL[i / 3 % 3] },
            }
        });
        for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
            dispatch!(level, simd => {
                let all = Sixteen::of(simd, |i| &records[i]);
                let Sixteen { mean: [x, y], conic_root: [a, b, c], depth_slope: [across, down], .. } = all;
                let [red, green, blue] = all.color;
                let numbers = [
                    (x, 0), (y, 1), (all.depth, 2), (all.amplitude, 3), (a, 4), (b, 5), (c, 6), (all.sigma_z, 7),
                    (across, 8), (down, 9), (red, 12), (green, 13), (blue, 14),
                ];
                let ends: [f32; 16] = all.ends.into();
                assert_eq!(ends, records.each_ref().map(Record::end), "{level:?}");
                for (found, place) in numbers {
                    let expected: [f32; 16] = std::array::from_fn(|i| (100 * i + place) as f32);
                    let found: [f32; 16] = found.into();
                    assert_eq!(found, expected, "{level:?}, number {place}");
                }
                let set = |has: &dyn Fn(Tag) -> bool| (0..16).map(|i| u64::from(has(records[i].tag)) << i).sum::<u64>();
                for kind in kinds {
                    assert_eq!(all.of_kind(simd, kind), set(&|tag| tag.kind == kind), "{level:?}, {kind:?}");
                }
                for form in Form::ALL {
                    assert_eq!(all.in_form(simd, form), set(&|tag| tag.form == form), "{level:?}, {form:?}");
                }
            });
        }
    }
}
