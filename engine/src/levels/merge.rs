//! Four splats to one that stands for them: their mass, mean and covariance; of surfaces their area and how their normals are spread.

use super::family::{Family, Member, mean_shadow, outer};
use super::need::Terms;
use super::{Level, Orientation, clusters, range_of};
use crate::cloud::{Harmonics, OpacityFilter, Shapes, Splats, Strength, Surface};
use crate::color::{linear_to_srgb, srgb_to_linear};
use crate::columns::{CHILDREN, Column, Columns, Kind, SurfaceKind};
use glam::{DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

/// A splat that stands for a family.
struct Merged {
    /// Of the members, as in [`Member`].
    shares: [f32; CHILDREN],
    center: Vec3,
    factor: Mat3,
    strength: f32,
    opacity: f32,
    color: [f32; 3],
    normal: Vec3,
    orientation: Orientation,
    /// Of a surface σ₁σ₂, and see [`Columns::grains`].
    kernel: f64,
    grain: f32,
    /// See [`Columns::opacities_of_own`].
    opacity_of_own: f32,
    need: f32,
}

/// The next coarser level: each splat stands for four consecutive ones of the level below, the last for those that are left.
pub(super) fn coarser(below: &Level, tolerance: f64) -> Level {
    let columns = &below.columns;
    let families = |number: usize| {
        let start = number * CHILDREN;
        start..columns.len.min(start + CHILDREN)
    };
    let count = columns.len.div_ceil(CHILDREN);
    let merged = |number: usize| {
        let least = families(number).map(|index| below.need(index)).fold(0.0, f32::max);
        Merged::new(columns, &Family::new(columns, families(number)), (tolerance, least))
    };
    let merged: Vec<Merged> = (0..count).into_par_iter().with_min_len(FAMILIES_A_TASK).map(merged).collect();
    let column = |value: fn(&Merged) -> f32| merged.iter().map(value).collect::<Vec<f32>>();
    let strengths = column(|m| m.strength);
    let mut above = Columns::new(Splats {
        centers: merged.iter().map(|m| m.center).collect(),
        shapes: Shapes::Each(merged.iter().map(|m| m.factor).collect()),
        strength: match columns.kind {
            Kind::Extinction => Strength::Extinction { masses: strengths },
            // What its members lack where they end it lacks all over; it is as narrow as they.
            Kind::Opacity { filter, .. } => Strength::Opacity { peaks: strengths, filter, least: 0.0 },
            Kind::Surface(SurfaceKind { depth_tolerance, coverage_floor, ref closed, .. }) => {
                let opacities = columns.opacities.as_ref().map(|_| column(|m| m.opacity));
                Strength::Surface(Surface {
                    areas: strengths,
                    opacities,
                    depth_tolerance,
                    coverage_floor,
                    closed: closed.clone(),
                })
            }
        },
        colors: merged.iter().map(|m| m.color).collect(),
        harmonics: columns.harmonics.as_ref().map(|harmonics| {
            let per_splat = Harmonics::count(harmonics.degree);
            let mut coefficients = vec![[0.0; 3]; count * per_splat];
            coefficients.par_chunks_mut(per_splat).enumerate().for_each(|(number, sums)| {
                for (share, index) in merged[number].shares.iter().zip(families(number)) {
                    for (sum, coefficient) in sums.iter_mut().zip(harmonics.row(index)) {
                        for (sum, value) in sum.iter_mut().zip(coefficient) {
                            *sum += share * value;
                        }
                    }
                }
            });
            Harmonics { degree: harmonics.degree, coefficients }
        }),
        // Of surfaces they are those of shapes where there are no others, and means are shorter.
        normals: (columns.normals.is_some() || matches!(columns.kind, Kind::Surface(_)))
            .then(|| merged.iter().map(|m| m.normal).collect()),
        material: columns.material,
    });
    if let Kind::Surface(surface) = &mut above.kind {
        // Opacity by how many sheets there are asks for coverage as even as the cloud's own.
        if columns.opacities.is_none() {
            surface.overlap = overlap(&merged);
        }
        let orientations = merged.iter().map(|m| m.orientation.numbers()).collect();
        above.orientations = Some(Column::new(orientations, |numbers| *numbers));
        above.grains = Some(Column::new(column(|m| m.grain), |grain| [*grain]));
    }
    if let Kind::Opacity { filter: OpacityFilter::Classic, .. } = columns.kind {
        above.opacities_of_own = Some(Column::new(column(|m| m.opacity_of_own), |sum| [*sum]));
    }
    let needs = column(|m| m.need);
    let (mut clusters, bounds) = clusters(&above);
    for cluster in &mut clusters {
        cluster.needs = range_of(needs[cluster.splats.clone()].iter().copied());
    }
    let median_sigma = above.median_sigma();
    let needs = Some(Column::new(needs, |need| [*need]));
    Level { columns: above, clusters, bounds, median_sigma, needs, tolerance }
}

/// The variance of what is even along a cell of length 1. Where families clump their cells have gaps, which are samples' own.
const OF_A_CELL: f64 = 1.0 / 12.0;

/// How cells of merged surfels overlap, in the mean of a level by area. Families that are scattered far apart count as if theirs were whole.
fn overlap(merged: &[Merged]) -> f32 {
    let parts =
        merged.iter().map(|m| (f64::from(m.strength), m.kernel)).map(|(area, own)| [area, own.min(area)]);
    let [areas, kernels] = parts.fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    (kernels / areas).max(OF_A_CELL) as f32
}

/// The least number of families that a thread merges at a time.
const FAMILIES_A_TASK: usize = 256;

impl Merged {
    /// The splat for a family whose members need `least` at most, at a tolerance.
    fn new(columns: &Columns, family: &Family, (tolerance, least): (f64, f32)) -> Self {
        let covariance = family.covariance();
        let (strength, factor);
        let mut normals;
        let (mut orientation, mut kernel, mut grain) = (Orientation::default(), 0.0, 1.0);
        match columns.kind {
            Kind::Extinction => {
                normals = turned(family, |m| m.normal);
                strength = family.weight;
                factor = lower_factor(covariance);
            }
            Kind::Opacity { .. } => {
                normals = turned(family, |m| m.normal);
                let shadow = mean_shadow(covariance);
                strength = if shadow > 0.0 { (family.weight / shadow).min(1.0) } else { 0.0 };
                factor = lower_factor(covariance);
            }
            Kind::Surface(SurfaceKind { ref closed, .. }) => {
                // What has no sides has none that all normals are on.
                let own = |m: &Member| m.orientation.mean;
                let means = if closed.has_sides() { each(family, own) } else { turned(family, own) };
                normals = each(family, |m| m.normal);
                for ((normal, mean), m) in normals.iter_mut().zip(means).zip(family.members()) {
                    *normal *= if mean.dot(m.orientation.mean) < 0.0 { -1.0 } else { 1.0 };
                }
                orientation = Orientation::of_family(family, means);
                strength = family.weight;
                factor = facing_factor(covariance, orientation.mean.normalize_or(DVec3::Z));
                kernel = factor.x_axis.cross(factor.y_axis).length();
                grain = (family.average(|m| m.kernel_of_own) / kernel.max(f64::MIN_POSITIVE)).min(1.0).sqrt()
                    as f32;
            }
        }
        let mut normal: DVec3 =
            family.members().iter().zip(normals).map(|(m, normal)| m.share * normal).sum();
        if !matches!(columns.kind, Kind::Surface(_)) {
            // Short normals are means of many; what has none, and returns no light, has no part in it.
            let lit = family.average(|m| if m.normal == DVec3::ZERO { 0.0 } else { 1.0 });
            normal /= lit.max(f64::MIN_POSITIVE);
        }
        let color = if matches!(columns.kind, Kind::Opacity { .. }) {
            // Trained colours are mixed as they are seen.
            let encoded = family.mean(|m| m.color.map(|c| f64::from(linear_to_srgb(c as f32))));
            encoded.to_array().map(|c| srgb_to_linear(c as f32))
        } else {
            family.color(matches!(columns.kind, Kind::Surface(_))).as_vec3().to_array()
        };
        let terms = Terms::new(columns, family, normals, (strength, &orientation));
        let mut shares = [0.0; CHILDREN];
        shares.iter_mut().zip(family.members()).for_each(|(share, m)| *share = m.share as f32);
        Self {
            shares,
            center: family.center.as_vec3(),
            factor: factor.as_mat3(),
            strength: strength.min(f64::from(f32::MAX)) as f32,
            opacity: family.average(|m| m.opacity).min(1.0) as f32,
            color,
            normal: normal.as_vec3(),
            orientation,
            kernel,
            grain,
            opacity_of_own: family.opacity_of_own() as f32,
            need: terms.need(tolerance).max(least),
        }
    }
}

fn each(family: &Family, vector: impl Fn(&Member) -> DVec3) -> [DVec3; CHILDREN] {
    let mut vectors = [DVec3::ZERO; CHILDREN];
    vectors.iter_mut().zip(family.members()).for_each(|(place, member)| *place = vector(member));
    vectors
}

/// Vectors of which it doesn't matter which way they point, pointing the same way; the others are zero.
fn turned(family: &Family, vector: impl Fn(&Member) -> DVec3) -> [DVec3; CHILDREN] {
    let mut sum = DVec3::ZERO;
    let mut turned = [DVec3::ZERO; CHILDREN];
    for (turned, member) in turned.iter_mut().zip(family.members()) {
        let vector = vector(member);
        *turned = if vector.dot(sum) < 0.0 { -vector } else { vector };
        sum += member.share * *turned;
    }
    turned
}

/// The lower triangular F of F Fᵀ = Σ, which may be singular.
fn lower_factor(m: DMat3) -> DMat3 {
    let x = column_through(m, DVec3::X);
    let rest = m - outer(x, x);
    let y = column_through(rest, DVec3::Y).with_x(0.0);
    let rest = rest - outer(y, y);
    DMat3::from_cols(x, y, DVec3::Z * rest.z_axis.z.max(0.0).sqrt())
}

/// F of F Fᵀ = Σ whose first two columns span the plane of a unit normal, and turn around it.
fn facing_factor(m: DMat3, normal: DVec3) -> DMat3 {
    let z = column_through(m, normal);
    let rest = m - outer(z, z);
    let u = normal.any_orthonormal_vector();
    let v = normal.cross(u);
    let [uu, uv, vv] = [u.dot(rest * u), u.dot(rest * v), v.dot(rest * v)];
    let long = uu.max(0.0).sqrt();
    let slant = if long > 0.0 { uv / long } else { 0.0 };
    // A normal needs two directions, even where rounding leaves one.
    let short = (vv - slant * slant).max(1e-12 * (uu + vv)).max(0.0).sqrt();
    DMat3::from_cols(u * long + v * slant, v * short, z)
}

/// Σ n/√(nᵀΣn): what Σ loses with it annihilates n.
fn column_through(m: DMat3, n: DVec3) -> DVec3 {
    let along = m * n;
    let variance = n.dot(along);
    if variance > 0.0 { along / variance.sqrt() } else { DVec3::ZERO }
}
