//! A patch of neighbouring surfels: the one that stands for them, and how far it is from them.

use super::Deviation;
use glam::{DMat2, DMat3, DVec2, DVec3};

/// How much wider than its surfels' centres a patch's kernel is, as a variance. With 1 it has the covariance of its surfels' kernels, and squares of side L have
/// σ = 0.3 L and leave gaps of a third between them; with 2 it is 0.41 L and they are even within 0.14.
const SPREAD: f64 = 2.0;

/// Rounds of the power iteration that finds a direction; it need not be exact.
const ROUNDS: usize = 8;

/// What extent counts beside the change of normals where a patch is parted: normals that keep to a tenth of their bound leave
/// the longest side to decide.
const EXTENT_SHARE: f64 = 0.01;

/// A surfel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) center: DVec3,
    pub(super) half_axes: [DVec3; 2],
    /// The unit normal of its half-axes.
    pub(super) plane: DVec3,
    /// Its shading normal.
    pub(super) normal: DVec3,
    pub(super) area: f64,
    pub(super) color: [f32; 3],
    pub(super) opacity: f32,
}

impl Sample {
    /// Half-axes as columns, flat.
    pub(super) fn factor(&self) -> DMat3 {
        DMat3::from_cols(self.half_axes[0], self.half_axes[1], DVec3::ZERO)
    }

    /// What merging this one into `merged` would change.
    pub(super) fn deviation_from(&self, merged: &Self) -> Deviation {
        let angle = |a: DVec3, b: DVec3| a.cross(b).length().atan2(a.dot(b));
        Deviation {
            distance: (self.center - merged.center).dot(merged.plane).abs(),
            angle: angle(self.normal, merged.normal).max(angle(self.plane, merged.plane)),
            color: self.color_from(merged),
        }
    }

    fn color_from(&self, merged: &Self) -> f64 {
        let color = |channel: usize| f64::from((self.color[channel] - merged.color[channel]).abs());
        color(0).max(color(1)).max(color(2)).max(f64::from((self.opacity - merged.opacity).abs()))
    }

    /// Whether the deviation is within bounds, `bounds.cosine` being that of the angle.
    pub(super) fn is_within(&self, bounds: &Bounds, merged: &Self) -> bool {
        let turned =
            |a: DVec3, b: DVec3| a.dot(b) >= bounds.cosine * (a.length_squared() * b.length_squared()).sqrt();
        (self.center - merged.center).dot(merged.plane).abs() <= bounds.most.distance
            && turned(self.plane, merged.plane)
            && turned(self.normal, merged.normal)
            && self.color_from(merged) <= bounds.most.color
    }
}

/// The largest deviations, ready to be compared with.
pub(super) struct Bounds {
    pub(super) most: Deviation,
    /// Of the largest angle.
    pub(super) cosine: f64,
}

/// Samples and the surfel that stands for them.
pub(super) struct Patch {
    pub(super) members: Vec<u32>,
    pub(super) mean: Sample,
    pub(super) deviation: Deviation,
}

impl Patch {
    /// `members` are at least one, of `samples`.
    pub(super) fn new(members: Vec<u32>, samples: &[Sample]) -> Self {
        if let [alone] = members[..] {
            return Self { mean: samples[alone as usize], deviation: Deviation::default(), members };
        }
        let all = || members.iter().map(|index| &samples[*index as usize]);
        let area: f64 = all().map(|s| s.area).sum();
        let share = |s: &Sample| if area > 0.0 { s.area / area } else { 1.0 / members.len() as f64 };
        let center = all().map(|s| s.center * share(s)).sum::<DVec3>();
        let vector_area = all().map(|s| s.plane * share(s)).sum::<DVec3>();
        let plane = vector_area.normalize_or_zero();
        let (u, v) = plane.try_normalize().unwrap_or(DVec3::Z).any_orthonormal_pair();
        let flat = |d: DVec3| DVec2::new(u.dot(d), v.dot(d));
        let outer = |d: DVec2| DMat2::from_cols(d * d.x, d * d.y);
        let covariance = all().fold(DMat2::ZERO, |sum, s| {
            let own = outer(flat(s.half_axes[0])) + outer(flat(s.half_axes[1]));
            sum + (outer(flat(s.center - center)) * SPREAD + own) * share(s)
        });
        let [along, aside] = half_axes(covariance).map(|axis| u * axis.x + v * axis.y);
        let opacity: f64 = all().map(|s| f64::from(s.opacity) * share(s)).sum();
        // As layers take colours: what is clear has none.
        let shown =
            |s: &Sample| if opacity > 0.0 { f64::from(s.opacity) / opacity * share(s) } else { share(s) };
        let color =
            |channel: usize| all().map(|s| f64::from(s.color[channel]) * shown(s)).sum::<f64>() as f32;
        let mean = Sample {
            center,
            half_axes: [along, aside],
            plane,
            normal: all().map(|s| s.normal * share(s)).sum(),
            area,
            color: [color(0), color(1), color(2)],
            opacity: opacity as f32,
        };
        let deviation = all().fold(Deviation::default(), |largest, s| largest.or(&s.deviation_from(&mean)));
        Self { members, mean, deviation }
    }

    /// The direction in which normals change most, in units of `angle`, or where they hardly do, in which the patch is longest:
    /// the first eigenvector of BᵀB/(angle² tr C) + a little C, with B = Σ a (n − n̄) dᵀ and C = Σ a d dᵀ.
    pub(super) fn fastest_change(&self, samples: &[Sample], angle: f64) -> DVec3 {
        let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
        let zero = (DMat3::ZERO, DMat3::ZERO, 0.0);
        let (change, extent, area) = self.members.iter().fold(zero, |(change, extent, area), index| {
            let s = &samples[*index as usize];
            // Samples without area have places, too.
            let weight = s.area + f64::MIN_POSITIVE;
            let d = s.center - self.mean.center;
            let turned = s.plane - self.mean.plane;
            (change + outer(turned, d) * weight, extent + outer(d, d) * weight, area + weight)
        });
        let (change, extent) = (change * (1.0 / area), extent * (1.0 / area));
        let squared = (extent.x_axis.x + extent.y_axis.y + extent.z_axis.z).max(f64::MIN_POSITIVE);
        let least = EXTENT_SHARE * angle * angle + 1e-12;
        let both = change.transpose() * change * (1.0 / squared) + extent * least;
        let longest = [DVec3::X, DVec3::Y, DVec3::Z][DVec3::new(
            both.x_axis.length_squared(),
            both.y_axis.length_squared(),
            both.z_axis.length_squared(),
        )
        .max_position()];
        (0..ROUNDS).fold(longest, |direction, _| (both * direction).try_normalize().unwrap_or(direction))
    }
}

/// The half-axes of the ellipse of a covariance, the longer one first.
fn half_axes(covariance: DMat2) -> [DVec2; 2] {
    let (a, b, c) = (covariance.x_axis.x, covariance.x_axis.y, covariance.y_axis.y);
    let (mean, difference) = (0.5 * (a + c), 0.5 * (a - c));
    let root = difference.hypot(b);
    let direction = DVec2::from_angle(0.5 * b.atan2(difference));
    [direction * (mean + root).sqrt(), direction.perp() * (mean - root).max(0.0).sqrt()]
}
