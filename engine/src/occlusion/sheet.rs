//! Where the surfels of a range are seen, as told by some of them.

use super::bounds::Sight;
use super::facing::Facing;
use super::looked::CELL;
use crate::columns::LANES;
use crate::cull::VisibleRange;
use crate::raster::SURFEL_REACH;
use glam::{DVec3, Vec3};

/// Blocks of eight splats that speak for a range.
pub(super) const SAMPLED: usize = 8;

/// How many times as large as what it stands for a patch is taken to be: few blocks are no even cover otherwise.
const SPREAD: f64 = 2.5;

/// A square of the picture that a block speaks for, or one of its surfels where they are not neighbours.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Patch {
    /// Its middle and half its side, in pixels.
    pub(super) center: [f32; 2],
    pub(super) half: f32,
    /// How often it is covered.
    pub(super) covered: f32,
    /// z between which its surfels matter.
    pub(super) depths: [f32; 2],
}

/// What a range of surfels covers.
#[derive(Clone, Debug, Default)]
pub(super) struct Sheet {
    pub(super) patches: Vec<Patch>,
    /// How far a splat reaches, in pixels.
    pub(super) reach: f32,
    /// How often the rectangle around them is covered, which counts as a cell at least.
    pub(super) coverage: f32,
    /// Whether all surfels face away, and are not drawn.
    pub(super) is_turned_away: bool,
}

impl Sheet {
    /// Turns into that of a range of surfels; translucent ones count by how much of the way to `least_transmittance` they go.
    pub(super) fn spread(
        &mut self,
        sight: &Sight,
        facing: &Facing,
        (range, least_transmittance): (&VisibleRange, f64),
    ) {
        let scale = sight.pixels_at(range.center_in_camera).sqrt();
        self.reach = (sight.root_cutoff * range.filtered(sight) * scale) as f32;
        self.patches.clear();
        let blocks = sampled(range, SAMPLED);
        let share = range.splats.len() as f64 / (LANES * blocks.clone().count()).max(1) as f64;
        let mut area = 0.0;
        for block in blocks {
            let shown = facing.block(range, block, least_transmittance);
            let mut whole = Shown::default();
            shown.iter().for_each(|own| whole.add(own));
            area += f64::from(whole.area) * share * scale * scale;
            let together = whole.patch(sight, range, share);
            let is_near = |own: &Shown| {
                let pixel = sight.pixel((own.moment / own.area).as_dvec3());
                (0..2).all(|axis| (pixel[axis] as f32 - together.center[axis]).abs() <= together.half)
            };
            let seen = || shown.iter().filter(|own| own.area > 0.0);
            if whole.area > 0.0 && seen().all(is_near) {
                self.patches.push(together);
            } else {
                self.patches.extend(seen().map(|own| own.patch(sight, range, share)));
            }
        }
        let ends = [0, 1].map(|axis| {
            let of = |patch: &Patch| [patch.center[axis] - patch.half, patch.center[axis] + patch.half];
            let around = |[a, b]: [f32; 2], [c, d]: [f32; 2]| [a.min(c), b.max(d)];
            self.patches
                .iter()
                .map(of)
                .reduce(around)
                .map_or(CELL as f32, |[from, to]| (to - from).max(CELL as f32))
        });
        self.coverage = area as f32 / (ends[0] * ends[1]);
        self.is_turned_away = area == 0.0 && facing.is_turned_away(range);
    }
}

/// What is seen of a surfel, or of several.
#[derive(Default)]
pub(super) struct Shown {
    /// Along the ray through the middle of the range, as a share of z²; the same times opacities.
    pub(super) area: f32,
    pub(super) opaque: f32,
    /// What they have, seen from where they face.
    pub(super) whole: f32,
    /// Σ area · place, in camera space.
    pub(super) moment: Vec3,
}

impl Shown {
    fn add(&mut self, other: &Self) {
        self.area += other.area;
        self.opaque += other.opaque;
        self.whole += other.whole;
        self.moment += other.moment;
    }

    /// The patch of a block that speaks for `share` as many surfels.
    fn patch(&self, sight: &Sight, range: &VisibleRange, share: f64) -> Patch {
        let center = (self.moment / self.area).as_dvec3();
        let own = center.z.max(f64::MIN_POSITIVE);
        let pixel = sight.pixel(center);
        let [area, whole] = [self.area, self.whole].map(f64::from);
        let cosine = (area / (whole * sight.ray(center).length())).min(1.0);
        let slope = (1.0 - cosine * cosine).max(0.0).sqrt();
        let tilted = (0.5 * (SPREAD * whole * share).sqrt() * slope).min(range.radius);
        let around = (SURFEL_REACH + sight.root_cutoff) * range.filtered(sight);
        let area = SPREAD * area * share * sight.pixels_at(DVec3::new(0.0, 0.0, own));
        Patch {
            center: pixel.map(|length| length as f32),
            half: (0.5 * area.sqrt()) as f32,
            covered: self.opaque / self.area / SPREAD as f32,
            depths: [center.z - tilted - around, center.z + tilted + around].map(|z| z as f32),
        }
    }
}

/// At most `most` blocks of a range, evenly spread.
pub(super) fn sampled(range: &VisibleRange, most: usize) -> impl Iterator<Item = usize> + Clone + use<> {
    let blocks = range.splats.start / LANES..range.splats.end.div_ceil(LANES);
    let step = blocks.len().div_ceil(most).max(1);
    blocks.skip(step / 2).step_by(step)
}
