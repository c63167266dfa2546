//! Which of eight splats are seen, and their records to the next places.

use super::WideProjector;
use super::forms::{Along, Forms};
use super::geometry::{Footprints, Placed};
use super::hidden::Hiding;
use super::looks::Looks;
use crate::columns::{self, LANES, Lanes};
use crate::cull::VisibleRange;
use crate::footprint::record::{Form, Kind, MOST_SLABS, NO_END, Record, Rect, Tag};
use crate::footprint::scalar::{MOST_AMPLITUDE, MOST_SUMMED, OPAQUE_AMPLITUDE};
use crate::footprint::{Places, touched};
use crate::simd::*;

/// The least and the greatest distance so far, lane by lane.
pub(super) type Ends<S> = [V<S>; 2];

/// What is drawn of eight splats, besides their footprints and looks.
struct Drawn<S: Simd> {
    visible: u32,
    exact: M<S>,
    /// As bits.
    forms: [u32; Form::ALL.len()],
    /// Of amplitudes, or slabs and ends.
    slope: [V<S>; 2],
    /// Left, top, right and bottom in pixels.
    edges: [V<S>; 4],
}

impl WideProjector<'_> {
    #[inline(always)]
    pub(super) fn push<S: Simd>(
        &self,
        simd: S,
        (range, first, chosen): (&VisibleRange, usize, u32),
        (placed, footprints, looks, forms): (&Placed<S>, &Footprints<S>, &Looks<S>, &Forms<S>),
        (out, ends, hiding): (&mut Places, &mut Ends<S>, Option<&Hiding>),
    ) {
        let Forms { point, exact, ref along } = *forms;
        let limits = (exact, looks.cutoff);
        let [left, right] = self.bounds(simd, 0, (placed, footprints), limits);
        let [top, bottom] = self.bounds(simd, 1, (placed, footprints), limits);
        let z = placed.center[2];
        let zero = splat(simd, 0.0);
        let reach = (footprints.zz * self.cutoff).sqrt();
        let mut seen = footprints.is_simple
            & looks.is_seen
            & left.simd_lt(right)
            & top.simd_lt(bottom)
            & (z + reach).simd_gt(splat(simd, self.near));
        // Wholly behind the camera.
        let behind = if self.perspective { (z + reach).simd_le(zero) } else { M::splat(simd, false) };
        let mut visible = seen.to_bitmask() as u32 & chosen;
        let edges = [left, top, right, bottom];
        if let Some(hiding) = hiding {
            let hidden = hiding.hidden(simd, self, visible, (placed, footprints, &edges));
            out.tally.behind_cuts += hidden.count_ones();
            visible &= !hidden;
            seen = M::from_bitmask(simd, visible.into());
        }
        let hard = !(footprints.is_simple | behind).to_bitmask() as u32 & chosen;
        let [points, exacts] = [point, exact].each(
            #[inline(always)]
            |form| form.to_bitmask() as u32,
        );
        let forms = [points, !(points | exacts), exacts];
        for (count, form) in out.tally.forms.iter_mut().zip(forms) {
            *count += (form & visible).count_ones();
        }
        if range.is_surface {
            if visible | hard != 0 {
                out.begin_octet(self.scalar.cloud_index, range.ids(first));
                if visible != 0 {
                    let drawn = Drawn { visible, exact, forms, slope: looks.slope, edges };
                    self.write_octet(simd, (first / LANES, drawn), (placed, footprints, looks), out);
                }
                if hard != 0 {
                    self.put_scalar((first, hard), out);
                }
                out.end_octet();
            }
            return;
        }
        let start = out.run.len;
        if visible != 0 {
            let closing = self.scalar.view.closing;
            let (mut distance, mut slope) =
                (if self.perspective { dot(placed.center, placed.center).sqrt() } else { z }, looks.slope);
            if closing.has_slabs() {
                let [first, last] = self.slabs(simd, placed, exact, along);
                let (more, most) = (last - first, splat(simd, MOST_SLABS));
                slope = [first, more + more.simd_lt(most).select(slope[1], splat(simd, NO_END))];
                distance = first;
            }
            ends[0] = seen.select(distance, ends[0]).min(ends[0]);
            ends[1] = seen.select(distance, ends[1]).max(ends[1]);
            let drawn = Drawn { visible, exact, forms, slope, edges };
            self.write(simd, (drawn, distance), (placed, footprints, looks), out);
            out.run.len = start + visible.count_ones() as usize;
        }
        if hard != 0 {
            self.insert_scalar(first, (visible, hard), (start, out));
        }
    }

    /// The slabs that kernels may touch, first and last, or twice where among slabs those are that are composited whole.
    #[inline(always)]
    fn slabs<S: Simd>(&self, simd: S, placed: &Placed<S>, exact: M<S>, along: &Along<S>) -> [V<S>; 2] {
        let Along { distance, sigma, variance } = *along;
        let closing = &self.scalar.view.closing;
        if closing.takes_whole(&self.scalar.columns.kind) {
            return [closing.center_among_slabs(simd, distance); 2];
        }
        let variance = exact.select(sigma.mul_add(sigma, variance), variance);
        let reach = (variance * self.cutoff).sqrt();
        closing.numbers(simd, placed.center, (distance, sigma, reach))
    }

    /// Projects what is left to the scalar projection; records keep the order of splats.
    #[cold]
    fn insert_scalar(
        &self,
        first: usize,
        (visible, mut hard): (u32, u32),
        (start, out): (usize, &mut Places),
    ) {
        let mut inserted = 0;
        while hard != 0 {
            let lane = hard.trailing_zeros();
            hard &= hard - 1;
            if let Some(kernel) = self.scalar.project_splat(first + lane as usize) {
                out.push(kernel);
                let smaller = visible & ((1 << lane) - 1);
                out.move_last_to(start + smaller.count_ones() as usize + inserted);
                inserted += 1;
            }
        }
    }

    /// Amplitudes as large as sums can take, and colours.
    #[inline(always)]
    fn bounded<S: Simd>(
        &self,
        simd: S,
        (amplitude, mut color): (V<S>, V3<S>),
        forms: [u32; Form::ALL.len()],
    ) -> (V<S>, V3<S>) {
        if self.scalar.view.settings.color_by_form {
            for (channel, form) in color.iter_mut().zip(forms) {
                let own = M::from_bitmask(simd, form.into());
                *channel = own.select(splat(simd, 1.0), splat(simd, 0.0));
            }
        }
        let [red, green, blue] = color;
        let brightest =
            red.abs().max(green.abs()).max(blue.abs()).max(splat(simd, MOST_SUMMED / MOST_AMPLITUDE));
        let most = (splat(simd, MOST_SUMMED) / brightest).max(splat(simd, OPAQUE_AMPLITUDE));
        (amplitude.max(-most).min(most), color)
    }

    #[inline(always)]
    fn write<S: Simd>(
        &self,
        simd: S,
        (drawn, distance): (Drawn<S>, V<S>),
        (placed, footprints, looks): (&Placed<S>, &Footprints<S>, &Looks<S>),
        out: &mut Places,
    ) {
        let Drawn { visible, exact, forms, slope: slabs, edges } = drawn;
        let mut amplitude = looks.amplitude;
        let mut kind = Kind::Opacity;
        if matches!(self.scalar.columns.kind, columns::Kind::Extinction) {
            kind = Kind::Extinction;
            // The exact form multiplies by |v| at the pixel.
            let length = dot(placed.ray, placed.ray).sqrt();
            amplitude = exact.select(amplitude, amplitude * length);
        }
        let [mean, slope] = [footprints.mean, footprints.depth_slope];
        let [a, b, c] = footprints.conic_root;
        let (amplitude, [red, green, blue]) = self.bounded(simd, (amplitude, looks.color), forms);
        let quads = [
            rows(simd, [mean[0], mean[1], placed.center[2], amplitude]),
            rows(simd, [a, b, c, footprints.sigma_z]),
            rows(simd, [slope[0], slope[1], slabs[0], slabs[1]]),
            rows(simd, [red, green, blue, splat(simd, 0.0)]),
        ];
        let tags = Form::ALL.map(|form| Tag { cloud: self.scalar.cloud_index, kind, form });
        let [min, max] = corners(edges);
        let distance: Lanes = distance.into();
        let start = out.run.len;
        let places = start..start + LANES;
        let (records, rects) = (&mut out.records[places.clone()], &mut out.rects[places.clone()]);
        let distances = &mut out.distances[places];
        let mut next = 0;
        for lane in 0..LANES {
            // Every splat is written; the next one takes the place of one that isn't seen.
            let place = next % LANES;
            set_numbers(
                &mut records[place],
                quads.each_ref().each(
                    #[inline(always)]
                    |quad| &quad[lane],
                ),
            );
            records[place].tag = tags[((forms[1] >> lane & 1) | (forms[2] >> lane & 1) << 1) as usize];
            set_corners(&mut rects[place], min[lane], max[lane]);
            *distances[place].get_mut() = distance[lane].to_bits();
            next += (visible >> lane & 1) as usize;
        }
    }

    /// Writes the surfels of a block to the octet that has begun.
    #[inline(always)]
    fn write_octet<S: Simd>(
        &self,
        simd: S,
        (block, drawn): (usize, Drawn<S>),
        (placed, footprints, looks): (&Placed<S>, &Footprints<S>, &Looks<S>),
        out: &mut Places,
    ) {
        let Drawn { visible, exact: _, forms: [points, _, exacts], slope, edges: [left, top, right, bottom] } =
            drawn;
        let (amplitude, color) = self.bounded(simd, (looks.amplitude, looks.color), drawn.forms);
        let place = out.run.len;
        let octet = &mut out.octets[place];
        store(&mut octet.mean, footprints.mean);
        octet.depth = placed.center[2].into();
        octet.amplitude = amplitude.into();
        store(&mut octet.conic_root, footprints.conic_root);
        octet.sigma_z = footprints.sigma_z.into();
        store(&mut octet.depth_slope, footprints.depth_slope);
        store(&mut octet.amplitude_slope, slope);
        store(&mut octet.normal, looks.normal);
        octet.seen = visible as u8;
        (octet.points, octet.exact) = ((points & visible) as u8, (exacts & visible) as u8);
        let opacity = match &self.scalar.columns.opacities {
            Some(opacities) => V::simd_from(simd, opacities.block(block)[0]),
            None => splat(simd, 1.0),
        };
        let look = [color[0], color[1], color[2], opacity];
        octet.first_look = look.each(
            #[inline(always)]
            |number| number.as_slice()[0],
        );
        let alike = [0, 1, 2, 3].each(
            #[inline(always)]
            |i| look[i].simd_eq(splat(simd, octet.first_look[i])),
        );
        octet.are_alike = (alike[0] & alike[1] & alike[2] & alike[3]).all_true();
        if !octet.are_alike {
            store(&mut octet.looks, look);
        }
        let seen = M::from_bitmask(simd, visible.into());
        let (zero, beyond) = (splat(simd, 0.0), splat(simd, f32::from(u16::MAX)));
        let min = [left, top].each(
            #[inline(always)]
            |edge| seen.select(edge, beyond).reduce_min(),
        );
        let max = [right, bottom].each(
            #[inline(always)]
            |edge| seen.select(edge, zero).reduce_max(),
        );
        let side = self.scalar.view.tile_side;
        let own = (right - left + side) * (bottom - top + side);
        let sum = seen.select(own, zero).as_slice().iter().sum::<f32>();
        let are_apart = touched([max[0] - min[0], max[1] - min[1]], side) > sum;
        let around = Rect { min: min.map(|edge| edge as u16), max: max.map(|edge| edge as u16) };
        out.rects[place] = if are_apart { Rect::NONE } else { around };
        let [min, max] = corners([left, top, right, bottom]);
        for (lane, rect) in out.own_rects[place].iter_mut().enumerate() {
            set_corners(rect, min[lane], max[lane]);
        }
    }
}

#[inline(always)]
fn store<S: Simd, const N: usize>(columns: &mut [Lanes; N], numbers: [V<S>; N]) {
    for (column, numbers) in columns.iter_mut().zip(numbers) {
        *column = numbers.into();
    }
}

/// Number by number, which compilers put together again.
#[inline(always)]
fn set_numbers(record: &mut Record, [place, shape, slope, color]: [&[f32; 4]; 4]) {
    record.mean[0] = place[0];
    record.mean[1] = place[1];
    record.depth = place[2];
    record.amplitude = place[3];
    record.conic_root[0] = shape[0];
    record.conic_root[1] = shape[1];
    record.conic_root[2] = shape[2];
    record.sigma_z = shape[3];
    record.depth_slope[0] = slope[0];
    record.depth_slope[1] = slope[1];
    record.amplitude_slope_or_slabs[0] = slope[2];
    record.amplitude_slope_or_slabs[1] = slope[3];
    record.color[0] = color[0];
    record.color[1] = color[1];
    record.color[2] = color[2];
}

/// First corners, and those behind the last pixels, of a column and a row in 16 bits each.
#[inline(always)]
fn corners<S: Simd>(edges: [V<S>; 4]) -> [[i32; LANES]; 2] {
    let [left, top, right, bottom] = edges.each(
        #[inline(always)]
        |edge| edge.to_int::<i32x8<S>>(),
    );
    [(left | top << 16).into(), (right | bottom << 16).into()]
}

/// As [`corners`] gives them.
#[inline(always)]
fn set_corners(rect: &mut Rect, min: i32, max: i32) {
    rect.min[0] = min as u16;
    rect.min[1] = (min >> 16) as u16;
    rect.max[0] = max as u16;
    rect.max[1] = (max >> 16) as u16;
}
