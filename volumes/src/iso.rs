//! Volumes to surfels of the surface at a value.

use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;
use thiserror::Error;

use oblate_engine::{Cloud, CloudError, Material, Shapes, Splats, Strength, Surface};

use crate::brick::{Brick, MORTON, brick_bases};
use crate::cell::{Cell, FACE_CORNERS, LOOPS};
use crate::volume::Volume;

/// Standard deviation of a surfel in its plane, in steps of the grid.
pub const SURFEL_SIGMA: f64 = 0.8;
/// The least summed coverage of iso-surfels on smooth surfaces whose radius of curvature is at least eight
/// steps, three radii away from borders (`tests/coverage.rs` measures it on planes and spheres).
pub const COVERAGE_FLOOR: f32 = 0.97;

/// Bricks that one task turns into surfels.
const BRICKS_A_TASK: usize = 32;

/// How [`iso_surfels`] makes surfels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IsoSettings {
    /// Linear Rec. 709 colour of the surface.
    pub color: [f32; 3],
    /// Opacity of the surface from 0 to 1.
    pub opacity: f32,
    /// Radius over thickness of a surfel: from 1 (round) to infinity (flat).
    pub flattening: f32,
    /// How the surface answers light.
    pub material: Material,
}

/// Light grey, opaque, flat.
impl Default for IsoSettings {
    fn default() -> Self {
        Self { color: [0.6; 3], opacity: 1.0, flattening: f32::INFINITY, material: Material::default() }
    }
}

/// Why there are no iso-surfels.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum IsoError {
    /// A setting is outside its range.
    #[error("{what} is {value}; {expected}")]
    Setting {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What would be right.
        expected: &'static str,
    },
    /// The surfels do not make a cloud.
    #[error(transparent)]
    Cloud(#[from] CloudError),
}

/// Surfels of the surface at which the volume's trilinear interpolant is `iso`; empty if it nowhere is.
///
/// In each cell of eight samples of which some are inside (value ≥ `iso`) and some are not, every polygon of
/// edge crossings becomes a surfel (Co, Hamann, Joy, *Iso-splatting: A Point-based Alternative to Isosurface
/// Visualization*, 2003, with areas so that summed coverage is 1: Zwicker et al., *EWA Volume Splatting*,
/// 2001, section 5):
/// - its centre goes from the polygon's centroid onto the surface along the gradient;
/// - its area is the polygon's in the world;
/// - its normal is that of the grid's central differences, interpolated, and points to lower values;
/// - its kernel has [`SURFEL_SIGMA`] in the index space's tangent plane and is taken to the world by the
///   grid's steps, so that summed coverage is the same for every spacing and direction.
///
/// Cells with a sample that is not finite hold no surface. The surface is closed if it ends neither there nor
/// at the grid's border. The cloud's space has the world's axes and its origin at sample (0, 0, 0); surfels are
/// in Morton order of their cells.
///
/// # Errors
/// When `iso` is not finite, a setting is outside its range, an area or a place is no finite f32, or there
/// are 2³² surfels or more.
pub fn iso_surfels(volume: &Volume, iso: f32, settings: &IsoSettings) -> Result<Cloud, IsoError> {
    let check = |what, value, right, expected| {
        if right { Ok(()) } else { Err(IsoError::Setting { what, value, expected }) }
    };
    check("the iso-value", iso, iso.is_finite(), "it must be finite")?;
    let opaque = (0.0..=1.0).contains(&settings.opacity);
    check("the opacity", settings.opacity, opaque, "it is from 0 to 1")?;
    check("the flattening", settings.flattening, settings.flattening >= 1.0, "it is at least 1")?;

    let sampler = Sampler {
        volume,
        iso,
        steps: volume.steps(),
        gradients_to_world: volume.gradients_to_world(),
        flattening: f64::from(settings.flattening),
    };
    let batches: Vec<Batch> = brick_bases(volume.dims())
        .par_chunks(BRICKS_A_TASK)
        .map_init(Brick::default, |brick, bases| {
            let mut batch = Batch::default();
            for &base in bases {
                brick.load(volume, base);
                if brick.range[0] < iso && iso <= brick.range[1] {
                    sampler.add_brick(brick, base, &mut batch);
                }
            }
            batch
        })
        .collect();

    let mut all = Batch::default();
    for batch in batches {
        all.centers.extend(batch.centers);
        all.factors.extend(batch.factors);
        all.areas.extend(batch.areas);
        all.normals.extend(batch.normals);
        all.open |= batch.open;
    }
    let count = all.centers.len();
    let columns = [sampler.steps.x_axis, sampler.steps.y_axis, sampler.steps.z_axis];
    let longest_step = columns.into_iter().fold(0.0, |longest: f64, step| longest.max(step.length()));
    let cloud = Cloud::new(Splats {
        centers: all.centers,
        shapes: Shapes::Each(all.factors),
        strength: Strength::Surface(Surface {
            areas: all.areas,
            opacities: (settings.opacity < 1.0).then(|| vec![settings.opacity; count]),
            depth_tolerance: (SURFEL_SIGMA * longest_step) as f32,
            coverage_floor: COVERAGE_FLOOR,
            closed: !all.open,
        }),
        colors: vec![settings.color; count],
        normals: Some(all.normals),
        material: settings.material,
    })?;
    Ok(cloud.transformed(DAffine3::from_translation(volume.frame().origin)))
}

/// Arrays of surfels in the making.
#[derive(Default)]
struct Batch {
    centers: Vec<Vec3>,
    factors: Vec<Mat3>,
    areas: Vec<f32>,
    normals: Vec<Vec3>,
    /// Whether the surface ends somewhere.
    open: bool,
}

/// What every cell needs to know.
struct Sampler<'a> {
    volume: &'a Volume,
    iso: f32,
    /// From index space to the world, without the origin.
    steps: DMat3,
    gradients_to_world: DMat3,
    flattening: f64,
}

impl Sampler<'_> {
    fn add_brick(&self, brick: &Brick, base: [usize; 3], batch: &mut Batch) {
        let dims = self.volume.dims();
        for local in MORTON {
            let index = [0, 1, 2].map(|axis| base[axis] + usize::from(local[axis]));
            if (0..3).any(|axis| index[axis] + 1 >= dims[axis]) {
                continue;
            }
            let place = Brick::place(local);
            let (mut inside, mut outside) = (0_u8, 0_u8);
            for corner in 0..8 {
                let value = brick.value(Brick::corner(place, corner));
                inside |= u8::from(value >= self.iso) << corner;
                outside |= u8::from(value < self.iso) << corner;
            }
            if inside == 0 || outside == 0 {
                continue;
            }
            let border = (0..6).any(|face| {
                let axis = face / 2;
                let at_border = if face % 2 == 0 { index[axis] == 0 } else { index[axis] + 2 == dims[axis] };
                at_border && inside & FACE_CORNERS[face] != 0 && outside & FACE_CORNERS[face] != 0
            });
            if inside | outside == u8::MAX {
                self.add_cell(brick, place, (index, inside), batch);
                batch.open |= border;
            } else {
                batch.open = true;
            }
        }
    }

    fn add_cell(&self, brick: &Brick, place: usize, (index, inside): ([usize; 3], u8), batch: &mut Batch) {
        let iso = f64::from(self.iso);
        let cell =
            Cell([0, 1, 2, 3, 4, 5, 6, 7].map(|c| f64::from(brick.value(Brick::corner(place, c))) - iso));
        for edges in LOOPS[usize::from(inside)].iter() {
            let Some(polygon) = cell.polygon(edges, self.steps) else { continue };
            let p = cell.onto_surface(polygon.centroid, self.steps);
            let to_world = |gradient: DVec3| -(self.gradients_to_world * gradient).normalize_or_zero();
            // Interpolated differences can vanish, or point the wrong way, where the field varies from sample
            // to sample; the interpolant's own gradient and the polygon are the safe steps.
            let candidates = [
                to_world(interpolated_differences(brick, place, p)),
                to_world(cell.interpolate(p).1),
                polygon.vector_area.normalize_or_zero(),
            ];
            let normal = candidates.into_iter().find(|n| n.dot(polygon.vector_area) > 0.0);
            let Some(normal) = normal else { continue };
            let position = DVec3::from(index.map(|i| i as f64)) + p;
            batch.centers.push((self.steps * position).as_vec3());
            batch.factors.push(self.factor(normal).as_mat3());
            batch.areas.push(polygon.area as f32);
            batch.normals.push(normal.as_vec3());
        }
    }

    /// The half-axes of a round surfel of the index space's tangent plane, taken to the world.
    fn factor(&self, normal: DVec3) -> DMat3 {
        // Normals go to index space by the transpose of what takes steps to the world.
        let (t1, t2) = (self.steps.transpose() * normal).normalize().any_orthonormal_pair();
        let (u, v) = (self.steps * t1 * SURFEL_SIGMA, self.steps * t2 * SURFEL_SIGMA);
        // One Jacobi rotation makes the two conjugate half-axes orthogonal.
        let (sine, cosine) = (0.5 * (2.0 * u.dot(v)).atan2(u.dot(u) - v.dot(v))).sin_cos();
        let (a, b) = (u * cosine + v * sine, v * cosine - u * sine);
        let thickness = b.length().min(a.length()) / self.flattening;
        let b = if a.cross(b).dot(normal) < 0.0 { -b } else { b };
        DMat3::from_cols(a, b, normal * thickness)
    }
}

/// The grid's differences at a cell's corners, interpolated at `p`: a gradient per sample step.
fn interpolated_differences(brick: &Brick, place: usize, p: DVec3) -> DVec3 {
    (0..8).fold(DVec3::ZERO, |sum, corner| {
        let share = |axis: usize| if corner >> axis & 1 == 1 { p[axis] } else { 1.0 - p[axis] };
        let differences = brick.differences(Brick::corner(place, corner)).map(f64::from);
        sum + DVec3::from(differences) * (share(0) * share(1) * share(2))
    })
}
