//! How a kernel, or what surfaces leave of it, is spread over slabs.

use crate::closing::{self, BOX, Slabs, share_of_box, share_of_normal};
use crate::raster::SlabShare;
use crate::simd::*;

/// A kernel at pixels, or what a segment has of it.
#[derive(Clone, Copy)]
pub(super) struct Matter<S: Simd> {
    pub(super) optical_depth: W<S>,
    /// From the eye to where it is densest.
    pub(super) distance: W<S>,
    /// See [`z_per_length`].
    pub(super) z_per_length: W<S>,
    /// 1/σ of the spread.
    pub(super) inverse: W<S>,
    /// The distances between which all of it lies, of a share.
    pub(super) segment: Option<[W<S>; 2]>,
}

impl<S: Simd> Matter<S> {
    /// The mean z of what lies in a slab from a distance on: as of a box with the σ of the spread.
    #[inline(always)]
    pub(super) fn depth_in<const DEPTH: bool>(&self, simd: S, (from, thickness): (f32, f32)) -> W<S> {
        if !DEPTH {
            return self.distance;
        }
        let (begin, end) = (W::simd_from(simd, from), W::simd_from(simd, from + thickness));
        let half = W::simd_from(simd, 0.5 * BOX) / self.inverse;
        // Of a share what is within the segment, which the spread may not reach.
        let [begin, end] = self
            .segment
            .map_or([begin, end], |[from, to]| [begin.max(from).min(end), end.min(to).max(begin)]);
        let ends = [self.distance - half, self.distance + half].each(
            #[inline(always)]
            |end_of_box| end_of_box.max(begin).min(end),
        );
        self.z_per_length * (ends[0] + ends[1]) * 0.5
    }
}

/// What z is for each of rays' lengths, if depth is asked for.
#[inline(always)]
pub(super) fn z_per_length<S: Simd, const DEPTH: bool>(simd: S, ray_length: W<S>) -> W<S> {
    if DEPTH { W::simd_from(simd, 1.0) / ray_length } else { ray_length }
}

/// The share of a kernel before a distance.
pub(super) struct Cumulative<S: Simd> {
    normal_part: f32,
    cut: Option<CutOff<S>>,
}

/// Where a segment cuts a kernel, in its σ; its share is spread over the slabs between, as much as the kernel is there.
struct CutOff<S: Simd> {
    /// The spread that is shared out is narrower than the kernel, and may not reach the segment at all: then it is moved
    /// so far that a part of it does.
    shift: W<S>,
    from: W<S>,
    to: W<S>,
    /// What lies before the segment, and 1 over what lies in it.
    passed: W<S>,
    scale: W<S>,
}

impl<S: Simd> Cumulative<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, share: &SlabShare, matter: &Matter<S>) -> Self {
        let normal_part = share.normal_part;
        let Some([from, to]) = matter.segment else { return Self { normal_part, cut: None } };
        let [from, to] = [(from - matter.distance) * matter.inverse, (to - matter.distance) * matter.inverse];
        // A box ends at √3, and a tenth of it is beyond 1.4; 0.6 % of a normal distribution is beyond 2.5.
        let reach = W::simd_from(simd, normal_part.mul_add(2.5 - 1.4, 1.4));
        let zero = W::simd_from(simd, 0.0);
        let shift = (-reach - to).max(zero) + (reach - from).min(zero);
        let [from, to] = [from + shift, to + shift];
        let passed = share_before(simd, from, normal_part);
        let own = (share_before(simd, to, normal_part) - passed).max(W::simd_from(simd, 1e-6));
        Self { normal_part, cut: Some(CutOff { shift, from, to, passed, scale: reciprocal(simd, own) }) }
    }

    /// Before x of its σ.
    #[inline(always)]
    pub(super) fn before(&self, simd: S, x: W<S>) -> W<S> {
        match &self.cut {
            None => share_before(simd, x, self.normal_part),
            Some(CutOff { shift, from, to, passed, scale }) => {
                let x = (x + *shift).max(*from).min(*to);
                (share_before(simd, x, self.normal_part) - *passed) * *scale
            }
        }
    }
}

/// What slabs have of a kernel, one after the other.
pub(super) struct Shares<S: Simd> {
    matter: Matter<S>,
    cumulative: Cumulative<S>,
    /// Where the next slab begins, and how thick slabs are, in σ of the kernel.
    begin: W<S>,
    step: W<S>,
    /// The optical depth that slabs have had.
    passed: W<S>,
}

impl<S: Simd> Shares<S> {
    /// Those of a kernel, or of a piece of one, that begins in a slab; which slab is next isn't said yet.
    #[inline(always)]
    pub(super) fn new(
        simd: S,
        (share, matter): (&SlabShare, Matter<S>),
        (slabs, slab): (&Slabs, u32),
    ) -> Self {
        let cumulative = Cumulative::new(simd, share, &matter);
        let zero = W::simd_from(simd, 0.0);
        let step = matter.inverse * slabs.thickness();
        let mut shares = Self { matter, cumulative, begin: zero, step, passed: zero };
        if share.goes_on {
            shares.go_to(simd, slabs, slab);
            shares.passed = shares.before(simd);
        }
        shares
    }

    /// The next slab is this one, which also has what those that are passed over would have.
    #[inline(always)]
    pub(super) fn go_to(&mut self, simd: S, slabs: &Slabs, slab: u32) {
        self.begin = (W::simd_from(simd, slabs.begin(slab)) - self.matter.distance) * self.matter.inverse;
    }

    /// The optical depth before the next slab.
    #[inline(always)]
    fn before(&self, simd: S) -> W<S> {
        self.matter.optical_depth * self.cumulative.before(simd, self.begin)
    }

    /// What no slab has had yet until the end of the next, all that is left if it `gets_rest`; and its mean z in that slab.
    #[inline(always)]
    pub(super) fn next<const DEPTH: bool>(
        &mut self,
        simd: S,
        (slabs, slab): (&Slabs, u32),
        gets_rest: bool,
    ) -> (W<S>, W<S>) {
        self.begin += self.step;
        let until = if gets_rest { self.matter.optical_depth } else { self.before(simd) };
        // No share is negative, which rounding may make it: of a large enough optical depth it would be a light.
        let own = (until - self.passed).max(W::simd_from(simd, 0.0));
        self.passed = until;
        (own, self.matter.depth_in::<DEPTH>(simd, (slabs.begin(slab), slabs.thickness())))
    }
}

/// The share of a kernel before x of its σ.
#[inline(always)]
fn share_before<S: Simd>(simd: S, x: W<S>, normal_part: f32) -> W<S> {
    if normal_part == 1.0 {
        return share_of_normal(simd, x);
    }
    if normal_part == 0.0 {
        return share_of_box(simd, x);
    }
    closing::share_before(simd, x, W::simd_from(simd, normal_part))
}
