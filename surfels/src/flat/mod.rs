//! Fewer surfels where a surface is flat.
//!
//! Surfels in a cube are one patch. A patch that keeps to the bounds becomes one surfel; another is parted in two, across the direction
//! in which its normals change most, and each half is tried again. `patch` has a patch's moments, its plane and where it is
//! parted; `neighborhood` finds what lies around a place; `support` asks whether a merged kernel, which reaches beyond its
//! patch, stays on the flat surface, and evens out what kernels of different sizes cover.

mod neighborhood;
mod patch;
mod support;

use crate::flat::neighborhood::Neighborhood;
use crate::flat::patch::{Bounds, Patch, Sample};
use glam::DVec3;
use oblate_engine::{Cloud, CloudError, Shapes, Splats, Strength, Surface};
use rayon::prelude::*;
use thiserror::Error;

/// Sides of cubes in mean distances between surfels: of the largest patches, and of the cells in which neighbours are looked for.
const CUBE: f64 = 8.0;
const CELL: f64 = 2.0;

/// How far a merged surfel may be from any that it stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// From its plane to their centres, in the cloud's units.
    pub distance: f64,
    /// Between its normal and theirs, in radians.
    pub angle: f64,
    /// Between its colour and theirs, the largest channel's, opacity included.
    pub color: f64,
}

/// A cloud of fewer surfels.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged {
    /// The surfels, in Morton order.
    pub cloud: Cloud,
    /// The largest deviations that there are.
    pub largest: Deviation,
    /// How many of them stand for several.
    pub merged: usize,
}

/// Why surfels can't be merged.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum MergeError {
    /// The cloud has kernels.
    #[error("the splats are no surfels: only samples of a surface are merged")]
    NotSurface,
    /// A bound that bounds nothing.
    #[error("the largest {what} is {value}; it must be finite and at least 0")]
    Bound {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f64,
    },
    /// The merged surfels leave single precision's range.
    #[error(transparent)]
    Cloud(#[from] CloudError),
}

/// Merges neighbouring surfels of a surface where one stands for them within the bounds.
///
/// A merged surfel has its patch's area and mean, its surfels' mean covariance and twice that of their centres, the direction of its vector area, its mean colour, opacity and (not unit)
/// normal. Its kernel reaches a little beyond its patch, as its surfels' do: of what these cover of the surface within the bounds of its
/// plane it loses at most a share of 0.06 for each radian of the largest angle, a hundredth at 10°. Kernels of patches do not cover quite evenly: areas are raised until
/// about 0.95 of what was covered at each sample is. Their sum grows, by up to a fifth on bent surfaces.
///
/// It takes about 10 microseconds of a core for each surfel. The result is the same for any number of threads. Levels of detail
/// are to be made again.
///
/// # Errors
/// When the cloud is no surface, or a bound is negative or not finite.
pub fn merge_flat(cloud: &Cloud, bounds: Deviation) -> Result<Merged, MergeError> {
    for (what, value) in
        [("distance", bounds.distance), ("angle", bounds.angle), ("difference of colours", bounds.color)]
    {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(MergeError::Bound { what, value });
        }
    }
    let splats = cloud.splats();
    let Strength::Surface(surface) = &splats.strength else { return Err(MergeError::NotSurface) };
    let samples = samples(&splats, surface);
    let bounds = Bounds { most: bounds, cosine: bounds.angle.min(std::f64::consts::PI).cos() };
    let (cubes, around) = (Neighborhood::new(&samples, CUBE), Neighborhood::new(&samples, CELL));
    let patches: Vec<Patch> = cubes
        .cubes()
        .into_par_iter()
        .flat_map_iter(|cube| {
            let mut patches = Vec::new();
            part(cubes.indices(cube).to_vec(), &bounds, &around, &mut patches);
            patches
        })
        .collect();
    let areas = support::evened(&patches, &around);
    let largest = patches.iter().fold(Deviation::default(), |largest, patch| largest.or(&patch.deviation));
    let merged = patches.iter().filter(|patch| patch.members.len() > 1).count();
    let splats = merged_splats(&splats, surface, (&patches, &areas), largest.distance);
    Ok(Merged { cloud: Cloud::new(splats)?.transformed(cloud.cloud_to_world()), largest, merged })
}

impl Deviation {
    /// The larger of each.
    fn or(self, other: &Self) -> Self {
        Self {
            distance: self.distance.max(other.distance),
            angle: self.angle.max(other.angle),
            color: self.color.max(other.color),
        }
    }

    fn is_within(&self, bounds: &Self) -> bool {
        self.distance <= bounds.distance && self.angle <= bounds.angle && self.color <= bounds.color
    }
}

/// Parts samples into patches that each become a surfel.
fn part(mut members: Vec<u32>, bounds: &Bounds, around: &Neighborhood<'_>, found: &mut Vec<Patch>) {
    let patch = Patch::new(members, around.samples);
    let alone = patch.members.len() == 1;
    if alone || patch.deviation.is_within(&bounds.most) && support::is_flat_around(&patch, bounds, around) {
        found.push(patch);
        return;
    }
    let across = patch.fastest_change(around.samples, bounds.most.angle);
    members = patch.members;
    let middle = members.len() / 2;
    let along = |index: &u32| around.samples[*index as usize].center.dot(across);
    members.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)).then(a.cmp(b)));
    let rest = members.split_off(middle);
    part(members, bounds, around, found);
    part(rest, bounds, around, found);
}

fn samples(splats: &Splats, surface: &Surface) -> Vec<Sample> {
    let sample = |index: usize| {
        let factor = splats.shapes.factor(index).as_dmat3();
        let [u, v] = [factor.x_axis, factor.y_axis];
        let normal = splats.normals.as_ref().map_or(DVec3::ZERO, |normals| normals[index].as_dvec3());
        Sample {
            center: splats.centers[index].as_dvec3(),
            half_axes: [u, v],
            plane: u.cross(v).normalize_or_zero(),
            normal: if normal == DVec3::ZERO { u.cross(v).normalize_or_zero() } else { normal },
            area: f64::from(surface.areas[index]),
            color: splats.colors[index],
            opacity: surface.opacities.as_ref().map_or(1.0, |opacities| opacities[index]),
        }
    };
    (0..splats.centers.len()).into_par_iter().map(sample).collect()
}

fn merged_splats(
    before: &Splats,
    surface: &Surface,
    (patches, areas): (&[Patch], &[f64]),
    distance: f64,
) -> Splats {
    Splats {
        centers: patches.iter().map(|patch| patch.mean.center.as_vec3()).collect(),
        shapes: Shapes::Each(
            patches
                .iter()
                .map(|patch| match patch.members[..] {
                    // Nothing of it changes, its thickness neither.
                    [alone] => before.shapes.factor(alone as usize),
                    _ => patch.mean.factor().as_mat3(),
                })
                .collect(),
        ),
        strength: Strength::Surface(Surface {
            areas: areas.iter().map(|area| *area as f32).collect(),
            opacities: surface
                .opacities
                .as_ref()
                .map(|_| patches.iter().map(|patch| patch.mean.opacity).collect()),
            depth_tolerance: surface.depth_tolerance + distance as f32,
            coverage_floor: surface.coverage_floor,
            closed: surface.closed.clone(),
        }),
        colors: patches.iter().map(|patch| patch.mean.color).collect(),
        harmonics: None,
        normals: Some(patches.iter().map(|patch| patch.mean.normal.as_vec3()).collect()),
        material: before.material,
    }
    .in_morton_order()
}
