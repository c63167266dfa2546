//! Which kernels lie behind all cuts of the pixels that they touch.

use super::WideProjector;
use super::geometry::{Footprints, Placed};
use crate::columns::{LANES, Lanes};
use crate::cull::VisibleRange;
use crate::footprint::Rect;
use crate::occlusion::Looked;
use crate::raster::KERNEL_REACH;
use crate::simd::*;

/// What is drawn of surfaces, and how far kernels of a range reach.
pub(super) struct Hiding<'a> {
    looked: &'a Looked,
    /// In camera space; and this times the length of the longest ray with z = 1, see [`WideProjector::reach`].
    reach: f32,
    across: f32,
    /// Towards the eye.
    before: f32,
}

impl<'a> Hiding<'a> {
    /// `None` where nothing is hidden from a range.
    pub(super) fn new(projector: &WideProjector<'a>, range: &VisibleRange) -> Option<Self> {
        let looked = projector.scalar.view.looked.filter(|_| !range.is_surface)?;
        let reach = range.reach - range.radius;
        // See `composite::lead`.
        let before = (reach * (KERNEL_REACH / f64::from(projector.cutoff).sqrt()).hypot(1.0)) as f32;
        let across = projector.reach(range);
        Some(Self { looked, reach: reach as f32, across, before })
    }

    /// Whether all of a block's kernels do, as far as that can be told of them together.
    ///
    /// With p a point within R of a centre c with the ray v, |p_xy/p_z − v_xy| ≤ R |v|/(c_z − R); the affine form is no wider.
    #[inline(always)]
    pub(super) fn hides_block<S: Simd>(
        &self,
        _: S,
        projector: &WideProjector,
        Placed { center, ray, .. }: &Placed<S>,
    ) -> bool {
        let z = center[2].reduce_min();
        let before_eye = if projector.perspective { z - self.reach } else { 1.0 };
        let mut rect = Rect::default();
        for axis in 0..2 {
            let (focal, principal) = (projector.focal[axis], projector.principal[axis]);
            let across = if projector.perspective { ray[axis] } else { center[axis] };
            let half = focal * self.across / before_eye + 1.0;
            let last = projector.scalar.view.camera.size()[axis] as f32;
            let pixel = |end: f32| end.mul_add(focal, principal).clamp(-1e6, 1e6);
            let (low, high) = (pixel(across.reduce_min()) - half, pixel(across.reduce_max()) + half);
            rect.min[axis] = low.max(0.0) as u16;
            rect.max[axis] = high.ceil().clamp(0.0, last) as u16;
            // Or none of it is a number.
            if rect.min[axis] >= rect.max[axis] {
                return false;
            }
        }
        before_eye > 0.0 && self.looked.hides_kernel(&rect, z - self.before)
    }

    /// Which kernels of a set do, with the left, top, right and bottom edges of their pixels.
    #[inline(always)]
    pub(super) fn hidden<S: Simd>(
        &self,
        simd: S,
        projector: &WideProjector,
        mut set: u32,
        (placed, footprints, edges): (&Placed<S>, &Footprints<S>, &[V<S>; 4]),
    ) -> u32 {
        let Footprints { zz, sigma_z, .. } = *footprints;
        // What the slope of the depth adds to σ_z over the footprint.
        let along = ((zz - sigma_z * sigma_z).max(splat(simd, 0.0)) * projector.cutoff).sqrt();
        let before = sigma_z.mul_add(splat(simd, KERNEL_REACH as f32), along);
        let nearest: Lanes = (placed.center[2] - before).into();
        let edges: [[i32; LANES]; 4] = edges.each(
            #[inline(always)]
            |edge| edge.to_int::<i32x8<S>>().into(),
        );
        let mut hidden = 0;
        while set != 0 {
            let lane = set.trailing_zeros() as usize % LANES;
            set &= set - 1;
            let [left, top, right, bottom] = edges.map(|edge| edge[lane] as u16);
            let rect = Rect { min: [left, top], max: [right, bottom] };
            hidden |= u32::from(self.looked.hides_kernel(&rect, nearest[lane])) << lane;
        }
        hidden
    }
}
