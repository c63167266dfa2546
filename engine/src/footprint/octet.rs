//! What layers keep of surfels: eight neighbours together, as they are projected and as tiles take them in.

use super::Projected;
use super::record::{Form, Record, Rect};
use crate::columns::{LANES, Lanes};
use std::mem::offset_of;

/// Eight consecutive surfels of a cloud, number by number: eight cache lines, and more where their looks differ. Of those that aren't
/// seen numbers mean nothing.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Octet {
    /// As in [`Record`].
    pub(crate) mean: [Lanes; 2],
    pub(crate) depth: Lanes,
    pub(crate) amplitude: Lanes,
    pub(crate) conic_root: [Lanes; 3],
    pub(crate) sigma_z: Lanes,
    pub(crate) depth_slope: [Lanes; 2],
    pub(crate) amplitude_slope: [Lanes; 2],
    /// Unit shading normals in camera space, or shorter ones of splats that stand for others.
    pub(crate) normal: [Lanes; 3],
    /// Which are seen, and of these the points and those in the exact form.
    pub(crate) seen: u8,
    pub(crate) points: u8,
    pub(crate) exact: u8,
    /// Whether all have the colour and the opacity of the first.
    pub(crate) are_alike: bool,
    /// The cloud in the scene.
    pub(crate) cloud: u32,
    /// The first surfel's number in the scene, and from each to the next.
    pub(crate) ids: [u32; 2],
    /// Base colour, in the blend space, and opacity of the first.
    pub(crate) first_look: [f32; 4],
    /// Of each, where they aren't alike.
    pub(crate) looks: [Lanes; 4],
}

const _: () = assert!(offset_of!(Octet, looks) == 8 * 64 && LANES == u8::BITS as usize);

/// What tiles list of surfaces: all of an octet, or, where its surfels lie apart, one of these.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Part(pub(crate) u32);

/// Parts that an octet may have.
const PARTS: u32 = LANES as u32 + 1;

impl Part {
    /// Octets whose parts have numbers.
    pub(crate) const MOST_OCTETS: usize = (u32::MAX / PARTS) as usize;

    /// Those of the octet at a place that are to be listed, with a rectangle that is none if its surfels lie apart.
    pub(crate) fn of(place: usize, octet: &Octet, rect: &Rect) -> impl Iterator<Item = Self> + use<> {
        let first = place as u32 * PARTS;
        let mut codes = if *rect == Rect::NONE { u32::from(octet.seen) << 1 } else { 1 };
        std::iter::from_fn(move || {
            let code = codes.trailing_zeros();
            codes &= codes.wrapping_sub(1);
            (code < PARTS).then(|| Self(first + code))
        })
    }

    /// The place of the octet.
    #[inline(always)]
    pub(crate) fn place(self) -> u32 {
        self.0 / PARTS
    }

    /// Which of its surfels it is; `None`: all.
    #[inline(always)]
    pub(crate) fn lane(self) -> Option<usize> {
        (self.0 % PARTS).checked_sub(1).map(|lane| lane as usize)
    }
}

impl Octet {
    /// None seen.
    pub(crate) const NONE: Self = Self {
        mean: [[0.0; LANES]; 2],
        depth: [0.0; LANES],
        amplitude: [0.0; LANES],
        conic_root: [[0.0; LANES]; 3],
        sigma_z: [0.0; LANES],
        depth_slope: [[0.0; LANES]; 2],
        amplitude_slope: [[0.0; LANES]; 2],
        normal: [[0.0; LANES]; 3],
        seen: 0,
        points: 0,
        exact: 0,
        are_alike: false,
        cloud: 0,
        ids: [0; 2],
        first_look: [0.0; 4],
        looks: [[0.0; LANES]; 4],
    };

    /// The number in the scene of a surfel.
    pub(crate) fn id(&self, lane: usize) -> u32 {
        self.ids[0] + lane as u32 * self.ids[1]
    }

    /// Base colour and opacity of a surfel.
    pub(crate) fn look(&self, lane: usize) -> [f32; 4] {
        if self.are_alike { self.first_look } else { self.looks.map(|look| look[lane % LANES]) }
    }

    /// Puts a surfel of its cloud in.
    pub(super) fn put(&mut self, lane: usize, splat: &Projected) {
        if self.are_alike {
            self.looks = self.first_look.map(|number| [number; LANES]);
            self.are_alike = false;
        }
        let Record { mean, depth, amplitude, conic_root, sigma_z, depth_slope, color, tag, .. } =
            splat.record;
        let lane = lane % LANES;
        let set = |columns: &mut [Lanes], numbers: &[f32]| {
            columns.iter_mut().zip(numbers).for_each(|(column, number)| column[lane] = *number);
        };
        set(&mut self.mean, &mean);
        set(&mut self.conic_root, &conic_root);
        set(&mut self.depth_slope, &depth_slope);
        set(&mut self.amplitude_slope, &splat.record.amplitude_slope_or_slabs);
        set(&mut self.normal, &splat.sample.normal);
        let [red, green, blue] = color;
        set(&mut self.looks, &[red, green, blue, splat.sample.opacity]);
        (self.depth[lane], self.amplitude[lane], self.sigma_z[lane]) = (depth, amplitude, sigma_z);
        let bit = |is_set: bool| u8::from(is_set) << lane;
        self.seen |= bit(true);
        self.points = self.points & !bit(true) | bit(tag.form == Form::Point);
        self.exact = self.exact & !bit(true) | bit(tag.form == Form::Exact);
    }
}

#[cfg(test)]
impl Octet {
    /// An octet of one surfel.
    pub(crate) fn of_one(record: Record, sample: super::SurfaceSample) -> Self {
        let mut octet = Self { cloud: record.tag.cloud.into(), ..Self::NONE };
        octet.put(0, &Projected { record, rect: Rect::NONE, distance: 0.0, sample });
        octet
    }

    /// A surfel as it was put in, if it is seen.
    pub(crate) fn get(&self, lane: usize) -> Option<(Record, super::SurfaceSample)> {
        use super::record::{Kind, Tag};
        if self.seen >> lane & 1 == 0 {
            return None;
        }
        let has = |bits: u8| bits >> lane & 1 != 0;
        let form = match (has(self.points), has(self.exact)) {
            (true, _) => Form::Point,
            (_, true) => Form::Exact,
            _ => Form::Affine,
        };
        let [red, green, blue, opacity] = self.look(lane);
        let record = Record {
            mean: self.mean.map(|column| column[lane]),
            depth: self.depth[lane],
            amplitude: self.amplitude[lane],
            conic_root: self.conic_root.map(|column| column[lane]),
            sigma_z: self.sigma_z[lane],
            depth_slope: self.depth_slope.map(|column| column[lane]),
            amplitude_slope_or_slabs: self.amplitude_slope.map(|column| column[lane]),
            color: [red, green, blue],
            tag: Tag { cloud: self.cloud as u16, kind: Kind::Surface, form },
        };
        let normal = self.normal.map(|column| column[lane]);
        Some((record, super::SurfaceSample { normal, opacity }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_those_of_an_octet() {
        let octet = Octet { seen: 0b1010_0001, ..Octet::NONE };
        let rect = Rect { min: [0; 2], max: [1; 2] };
        for place in [0, 1, 7, 12_345, Part::MOST_OCTETS - 1] {
            let parts = |rect: Rect| -> Vec<(usize, Option<usize>)> {
                Part::of(place, &octet, &rect).map(|part| (part.place() as usize, part.lane())).collect()
            };
            assert_eq!(parts(rect), [(place, None)]);
            assert_eq!(parts(Rect::NONE), [0, 5, 7].map(|lane| (place, Some(lane))));
        }
    }
}
