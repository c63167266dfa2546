//! Which of eight splats are seen, and their records to the next places.

use super::WideProjector;
use super::forms::{Along, Forms};
use super::geometry::{Footprints, Placed};
use super::hidden::Hiding;
use super::looks::Looks;
use crate::columns::{self, LANES, Lanes};
use crate::cull::VisibleRange;
use crate::footprint::record::{Form, Kind, Record, Rect, Tag};
use crate::footprint::scalar::{MOST_AMPLITUDE, MOST_SUMMED, OPAQUE_AMPLITUDE};
use crate::footprint::{Places, SurfaceSample};
use crate::simd::*;

/// The least and the greatest distance so far, lane by lane.
pub(super) type Ends<S> = [V<S>; 2];

/// What is drawn of eight splats, besides their footprints and looks.
struct Drawn<S: Simd> {
    visible: u32,
    exact: M<S>,
    /// As bits.
    forms: [u32; Form::ALL.len()],
    /// What they are sorted by.
    distance: V<S>,
    /// Of amplitudes, or the slabs.
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
        let start = out.run.len;
        if visible != 0 {
            let closing = self.scalar.view.closing;
            let (mut distance, mut slope) =
                (if self.perspective { dot(placed.center, placed.center).sqrt() } else { z }, looks.slope);
            if !range.is_surface && closing.has_slabs() {
                slope = self.slabs(simd, placed, exact, along);
                distance = slope[0];
            }
            ends[0] = seen.select(distance, ends[0]).min(ends[0]);
            ends[1] = seen.select(distance, ends[1]).max(ends[1]);
            let [points, exacts] = [point, exact].each(
                #[inline(always)]
                |form| form.to_bitmask() as u32,
            );
            let forms = [points, !(points | exacts), exacts];
            for (count, form) in out.tally.forms.iter_mut().zip(forms) {
                *count += (form & visible).count_ones();
            }
            let drawn = Drawn { visible, exact, forms, distance, slope, edges };
            self.write(simd, drawn, (placed, footprints, looks), out);
            if range.is_surface {
                self.write_samples(simd, (range, first, visible), looks.normal, (start, out.samples));
            }
            out.run.len = start + visible.count_ones() as usize;
        }
        if hard != 0 {
            self.insert_scalar(range, first, (visible, hard), (start, out));
        }
    }

    /// The slabs that kernels may touch, first and last.
    #[inline(always)]
    fn slabs<S: Simd>(&self, simd: S, placed: &Placed<S>, exact: M<S>, along: &Along<S>) -> [V<S>; 2] {
        let Along { distance, sigma, variance } = *along;
        let variance = exact.select(sigma.mul_add(sigma, variance), variance);
        let reach = (variance * self.cutoff).sqrt();
        self.scalar.view.closing.numbers(simd, placed.center, (distance, sigma, reach))
    }

    /// Projects what is left to the scalar projection; records keep the order of splats.
    #[cold]
    fn insert_scalar(
        &self,
        range: &VisibleRange,
        first: usize,
        (visible, mut hard): (u32, u32),
        (start, out): (usize, &mut Places),
    ) {
        let mut inserted = 0;
        while hard != 0 {
            let lane = hard.trailing_zeros();
            hard &= hard - 1;
            let before = out.run.len;
            self.push_scalar(range, first + lane as usize, out);
            if out.run.len > before {
                let smaller = visible & ((1 << lane) - 1);
                out.move_last_to(start + smaller.count_ones() as usize + inserted);
                inserted += 1;
            }
        }
    }

    #[inline(always)]
    fn write<S: Simd>(
        &self,
        simd: S,
        drawn: Drawn<S>,
        (placed, footprints, looks): (&Placed<S>, &Footprints<S>, &Looks<S>),
        out: &mut Places,
    ) {
        let Drawn { visible, exact, forms, distance, slope: other, edges } = drawn;
        let mut amplitude = looks.amplitude;
        let kind = match self.scalar.columns.kind {
            columns::Kind::Extinction => Kind::Extinction,
            columns::Kind::Opacity(_) => Kind::Opacity,
            columns::Kind::Surface(_) => Kind::Surface,
        };
        if kind == Kind::Extinction {
            // The exact form multiplies by |v| at the pixel.
            let length = dot(placed.ray, placed.ray).sqrt();
            amplitude = exact.select(amplitude, amplitude * length);
        }
        let [mean, slope] = [footprints.mean, footprints.depth_slope];
        let [a, b, c] = footprints.conic_root;
        let mut color = looks.color;
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
        amplitude = amplitude.max(-most).min(most);
        let quads = [
            rows(simd, [mean[0], mean[1], placed.center[2], amplitude]),
            rows(simd, [a, b, c, footprints.sigma_z]),
            rows(simd, [slope[0], slope[1], other[0], other[1]]),
            rows(simd, [red, green, blue, splat(simd, 0.0)]),
        ];
        let tags = Form::ALL.map(|form| Tag { cloud: self.scalar.cloud_index, kind, form });
        let [left, top, right, bottom] = edges.each(
            #[inline(always)]
            |edge| edge.to_int::<i32x8<S>>(),
        );
        let corners: [[i32; LANES]; 2] = [(left | top << 16).into(), (right | bottom << 16).into()];
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
            set_corners(&mut rects[place], corners[0][lane], corners[1][lane]);
            *distances[place].get_mut() = distance[lane].to_bits();
            next += (visible >> lane & 1) as usize;
        }
    }

    #[inline(always)]
    fn write_samples<S: Simd>(
        &self,
        simd: S,
        (range, first, visible): (&VisibleRange, usize, u32),
        [x, y, z]: V3<S>,
        (start, samples): (usize, &mut [SurfaceSample]),
    ) {
        let columns = self.scalar.columns;
        let normals = rows(simd, [x, y, z, splat(simd, 0.0)]);
        let mut next = start;
        for (lane, normal) in normals.iter().enumerate() {
            if visible >> lane & 1 != 0 {
                samples[next] = SurfaceSample {
                    normal: [normal[0], normal[1], normal[2]],
                    opacity: columns.opacity(first + lane),
                    id: range.id(first + lane),
                };
                next += 1;
            }
        }
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

/// Corners of a column and a row in 16 bits each.
#[inline(always)]
fn set_corners(rect: &mut Rect, min: i32, max: i32) {
    rect.min[0] = min as u16;
    rect.min[1] = (min >> 16) as u16;
    rect.max[0] = max as u16;
    rect.max[1] = (max >> 16) as u16;
}

/// Four numbers of each of eight splats, splat by splat.
#[inline(always)]
fn rows<S: Simd>(_: S, columns: [V<S>; 4]) -> [[f32; 4]; LANES] {
    let [a, b, c, d] = columns;
    let (ac, bd) = ([a.zip_low(c), a.zip_high(c)], [b.zip_low(d), b.zip_high(d)]);
    let pairs = [ac[0].zip_low(bd[0]), ac[0].zip_high(bd[0]), ac[1].zip_low(bd[1]), ac[1].zip_high(bd[1])];
    let [p, q, r, s] = pairs.each(
        #[inline(always)]
        |pair| pair.split(),
    );
    [p.0, p.1, q.0, q.1, r.0, r.1, s.0, s.1].each(
        #[inline(always)]
        |row| row.into(),
    )
}
