//! From which pixel filter on a splat may stand for a family.
//!
//! A family and the splat that stands for it agree in mass, mean and covariance, so what differs are higher moments, and they
//! fade with the standard deviation of what smooths them, σ² = h² + the least variance of the members themselves, h being the
//! pixel's filter. In a pixel a family is seen with a weight τ = m/(2π(ℓ² + h²)), its optical depth or coverage, ℓ² the
//! variance of the whole. Where Σ τ = 1, families with errors of either sign add up to √(τ/2) of one family's error: the sum of
//! the squared weights of Gaussian footprints.
//!
//! The factors are fitted: pictures of volumes and surfaces with and without levels, from 1 to 1/16 of their size.
//! Random signs would ask for 0.7 of a dipole and 0.2 of a third moment; neighbours of real scenes cancel better. Lattices don't:
//! the factor of fourth cumulants is that of a plane's coverage where levels meet.

use super::family::{Family, eigenvalues, frobenius_squared, outer};
use super::{Orientation, Shown};
use crate::cloud::{Material, OpacityFilter};
use crate::columns::{CHILDREN, Columns, Kind, SurfaceKind};
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// Of Σ w (c − c̄) δ for the radiance c, by 1/σ.
const DIPOLE: f64 = 0.05;
/// The same for normals, whose change of a radian changes the light by its diffuse and glossy parts.
const TURNING: f64 = 0.35;
/// Of third moments, by 1/σ³.
const THIRD: f64 = 0.02;
/// Of fourth cumulants, by 1/σ⁴, of volumes and of surfaces, where nothing else lies behind.
const FOURTH: [f64; 2] = [0.02, 0.3];
/// Of the spread of colours where the front hides the rest, which no distance changes.
const HIDDEN: f64 = 4.0;
/// Of the spread of normals: light on both sides is no linear function of them.
const SHADING: f64 = 0.2;
/// Of the area seen of a family that the merged surfel shows too much or too little of.
const LOST: f64 = 20.0;
/// 1 − |N|/Σa of families that are seen as their vector areas are.
const FLAT: f64 = 1e-4;
/// Of the part of a bent family that a silhouette loses: √(1 − |N|/Σa) of its length, by 1/σ; and by 1 over the coverage floor, since the
/// lower that is, the steeper outlines are.
const BEND: f64 = 0.8;
/// Of how far a family spreads along its normal, in depth tolerances: which samples are of a layer depends on the first of them, and
/// no distance changes that.
const LAYER: f64 = 4.0;
/// Of τ²: what overlaps hides itself, but one splat's opacity is a sum.
const OVERLAP: f64 = 0.15;
/// Sub-pixel splats of [`OpacityFilter::Classic`] are not dimmed, so that nothing can stand for them. They are merged only to
/// keep to a budget.
const CLASSIC: f64 = 1e3;

/// What makes pictures of a family and of the splat that stands for it differ.
#[derive(Debug)]
pub(super) struct Terms {
    /// The variance by which the members themselves smooth.
    own: f64,
    /// ℓ².
    lateral: f64,
    /// τ (ℓ² + h²).
    depth: f64,
    /// By 1, 1/σ, 1/σ³ and 1/σ⁴; families differ in sign.
    random: [f64; 4],
    /// By 1/σ, and by τ²; families have one sign.
    bend: f64,
    overlap: f64,
    factor: f64,
}

impl Terms {
    /// Of a family whose merged splat has the given strength and, if it is of a surface, the given orientation; `normals` are the members'
    /// for shading, as they are averaged.
    pub(super) fn new(
        columns: &Columns,
        family: &Family,
        normals: [DVec3; CHILDREN],
        (strength, orientation): (f64, &Orientation),
    ) -> Self {
        let is_surface = matches!(columns.kind, Kind::Surface(_));
        let color = family.color(is_surface);
        let normal: DVec3 = family.members().iter().zip(normals).map(|(m, n)| m.share * n).sum();
        let mut dipoles = [DVec3::ZERO; 3];
        let (mut turning, mut turned) = (DMat3::ZERO, 0.0);
        let (mut colors, mut widths) = (DVec3::ZERO, 0.0);
        let mut third = [0.0; TRIPLES.len()];
        for (m, n) in family.members().iter().zip(normals) {
            let away = m.center - family.center;
            let differs = m.color - color;
            for (dipole, differs) in dipoles.iter_mut().zip(differs.to_array()) {
                *dipole += m.share * differs * away;
            }
            colors += m.share * differs * differs;
            turning += m.share * outer(n - normal, away);
            turned += m.share * (n - normal).length_squared();
            let wider = m.covariance - family.within;
            widths += m.share * frobenius_squared(wider);
            for (sum, (_, [i, j, k])) in third.iter_mut().zip(TRIPLES) {
                let crossed =
                    away[i] * wider.col(j)[k] + away[j] * wider.col(i)[k] + away[k] * wider.col(i)[j];
                *sum += m.share * (away[i] * away[j] * away[k] + crossed);
            }
        }
        let Material { emission, ambient, diffuse, specular, exponent } = columns.material;
        let lit = f64::from(emission + ambient + diffuse);
        let brightest = color.max_element().max(0.0);
        // Light per radian; a highlight is 1/√exponent wide.
        let per_radian = f64::from(diffuse) * brightest + f64::from(specular * exponent.sqrt());
        // Opacity is a channel, too.
        let channel = (lit * brightest).max(1.0);
        let dipole = lit * dipoles.iter().map(|d| d.length()).fold(0.0, f64::max);
        let turning = per_radian * frobenius_squared(turning).sqrt();
        let third: f64 = third.iter().zip(TRIPLES).map(|(t, (times, _))| times * t * t).sum();
        // Of two points at ±δ it is −2δ⁴; a mixture of two widths has 3 times the variance of the widths.
        let fourth = 2.0 * frobenius_squared(family.between) + 3.0 * widths;

        let [_, middle, least] = eigenvalues(family.within);
        let lateral = trace(family.covariance()) / if is_surface { 2.0 } else { 3.0 };
        let depth = match columns.kind {
            Kind::Extinction | Kind::Surface(_) => strength / TAU,
            Kind::Opacity { .. } => strength * lateral,
        };
        let mut terms = Self {
            own: if is_surface { middle } else { least },
            lateral,
            depth,
            random: [
                0.0,
                DIPOLE * dipole + TURNING * turning,
                THIRD * third.sqrt() * channel,
                FOURTH[usize::from(is_surface)] * fourth * channel,
            ],
            bend: 0.0,
            overlap: 0.0,
            factor: 1.0,
        };
        if let Kind::Surface(SurfaceKind { depth_tolerance, coverage_floor, ref closed, .. }) = columns.kind {
            let bent = (1.0 - orientation.mean.length()).max(0.0);
            let facing = orientation.mean.normalize_or(DVec3::Z);
            let through = facing.dot(family.between * facing).max(0.0).sqrt();
            let lost = if bent > FLAT {
                lost(family, orientation, if closed.has_sides() { Shown::Fronts } else { Shown::Both })
            } else {
                0.0
            };
            terms.random[0] =
                LOST * lost + LAYER * (through / f64::from(depth_tolerance).max(f64::MIN_POSITIVE)).min(1.0);
            terms.bend = BEND / f64::from(coverage_floor) * 2.0 * (trace(family.between) * bent).sqrt();
        } else {
            let hidden = (depth / lateral.max(f64::MIN_POSITIVE)).min(1.0);
            terms.random[0] =
                SHADING * turned * per_radian + HIDDEN * hidden * lit * colors.max_element().sqrt();
        }
        if let Kind::Opacity { filter, .. } = columns.kind {
            terms.overlap = OVERLAP;
            terms.factor = if filter == OpacityFilter::Classic { CLASSIC } else { 1.0 };
        }
        terms
    }

    /// The error of a channel that one pixel in a thousand has, for a filter of this standard deviation; falls with it.
    fn error(&self, filter: f64) -> f64 {
        let variance = self.own + filter * filter;
        let sigma = variance.sqrt();
        let depth = self.depth / (self.lateral + filter * filter);
        let [flat, first, third, fourth] = self.random;
        let one = flat + (first + (third + fourth / sigma) / variance) / sigma;
        one * (0.5 * depth).min(1.0).sqrt() + self.bend / sigma + self.overlap * depth * depth.min(1.0)
    }

    /// The least filter at which the error is below what a tolerance allows.
    pub(super) fn need(&self, tolerance: f64) -> f32 {
        let target = (255.0 * tolerance).powf(OF_TOLERANCE) / 255.0;
        if self.error(0.0) <= target {
            return 0.0;
        }
        // Errors that are no number are too large.
        let suffices = |filter: f64| self.error(filter) <= target;
        let mut high = self.lateral.sqrt().max(1e-30);
        while !suffices(high) && high < f64::from(f32::MAX) {
            high *= 2.0;
        }
        let mut low = 0.5 * high;
        while suffices(low) && low > 1e-38 {
            (low, high) = (0.5 * low, low);
        }
        for _ in 0..BISECTIONS {
            let middle = (low * high).sqrt();
            if suffices(middle) { high = middle } else { low = middle }
        }
        (high * self.factor).min(f64::from(f32::MAX)) as f32
    }
}

/// At 1/255, for which they are fitted, errors may be all of a tolerance, and more of smaller and less of larger ones by this power: where
/// few families differ in sign, as in a scanned brain that hides most of itself, 8/255 are 1.5 times what is said.
const OF_TOLERANCE: f64 = 0.8;

/// To 1 %.
const BISECTIONS: usize = 6;

/// By how much what is seen of a family is off, as a share of its area, at most: how it is seen from fourteen sides. Where fronts are told from backs
/// each have to be right, and the backs are fronts from the opposite side.
fn lost(family: &Family, orientation: &Orientation, shown: Shown) -> f64 {
    let off = |u: DVec3| {
        let own = family.average(|m| m.orientation.seen_from(u, shown));
        (orientation.seen_from(u, shown) - own).abs()
    };
    SIDES.into_iter().flat_map(|u| [off(u), off(-u)]).fold(0.0, f64::max)
}

/// A cube's faces and corners, each and its opposite once.
const SIDES: [DVec3; 7] = {
    const R: f64 = 0.577_350_269_189_625_8;
    [
        DVec3::X,
        DVec3::Y,
        DVec3::Z,
        DVec3::new(R, R, R),
        DVec3::new(-R, R, R),
        DVec3::new(R, -R, R),
        DVec3::new(R, R, -R),
    ]
};

fn trace(m: DMat3) -> f64 {
    m.x_axis.x + m.y_axis.y + m.z_axis.z
}

/// The distinct components of a symmetric tensor of the third order, and how often each occurs.
const TRIPLES: [(f64, [usize; 3]); 10] = [
    (1.0, [0, 0, 0]),
    (1.0, [1, 1, 1]),
    (1.0, [2, 2, 2]),
    (3.0, [0, 0, 1]),
    (3.0, [0, 0, 2]),
    (3.0, [1, 1, 0]),
    (3.0, [1, 1, 2]),
    (3.0, [2, 2, 0]),
    (3.0, [2, 2, 1]),
    (6.0, [0, 1, 2]),
];
