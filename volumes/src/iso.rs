//! Volumes to surfels of the surface at a value.

use std::array;

use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use thiserror::Error;

use oblate_engine::{Cloud, CloudError, Material, Shapes, Splats, Strength, Surface};

use crate::brick::{Brick, MORTON, SIDE, walk_bricks};
use crate::cell::{Cell, FACE_CORNERS, LOOPS, Polygon};
use crate::volume::Volume;

/// Standard deviation, in steps of the grid, of the Gaussian that blurs the polygon that a surfel stands for.
///
/// The polygons tile the surface, so each one blurred by the same Gaussian would cover it evenly. A surfel has
/// the covariance of its blurred polygon; only third moments and above are lost. On planes summed coverage
/// stays within 1 % of 1, with a surfel's standard deviation near 0.7 steps on average. (Round surfels of
/// 0.8 steps, for all their greater blur, vary by 3 %.)
pub const SURFEL_BLUR: f64 = 0.65;
/// About the largest standard deviation of a surfel, in steps: no polygon in a cell has much more than 1/6 as
/// its variance along an axis.
const SURFEL_RADIUS: f64 = 0.8;
/// The least summed coverage of iso-surfels on surfaces whose radius of curvature is at least five of the
/// grid's longest steps, three radii away from borders. On a sphere of radius r it falls by 3σ²/r², since
/// surfels are flat, and by the polygons' lack of area.
pub const COVERAGE_FLOOR: f32 = 0.9;

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
/// - its kernel has the covariance of the polygon blurred by [`SURFEL_BLUR`], in index space's measure, so that
///   summed coverage is as even for every spacing and direction.
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
    let batches = walk_bricks(volume, |brick, base, batch: &mut Batch| {
        if brick.range[0] < iso && iso <= brick.range[1] {
            sampler.add_brick(brick, base, batch);
        }
    });

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
            depth_tolerance: (SURFEL_RADIUS * longest_step) as f32,
            coverage_floor: COVERAGE_FLOOR,
            closed: !all.open,
        }),
        colors: vec![settings.color; count],
        harmonics: None,
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
        let crossed = crossed_cells(brick, self.iso);
        for local in MORTON {
            let index = [0, 1, 2].map(|axis| base[axis] + usize::from(local[axis]));
            let crossed = crossed[usize::from(local[2])][usize::from(local[1])] >> local[0] & 1 == 1;
            if !crossed || (0..3).any(|axis| index[axis] + 1 >= dims[axis]) {
                continue;
            }
            let place = Brick::place(local);
            let (mut inside, mut outside) = (0_u8, 0_u8);
            for corner in 0..8 {
                let value = brick.value(Brick::corner(place, corner));
                inside |= u8::from(value >= self.iso) << corner;
                outside |= u8::from(value < self.iso) << corner;
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
            let p = cell.onto_surface(polygon.centroid, self.gradients_to_world);
            let facing = |normal: &DVec3| normal.dot(polygon.vector_area) > 0.0;
            let downhill = |gradient: DVec3| {
                Some(-(self.gradients_to_world * gradient).normalize_or_zero()).filter(facing)
            };
            // Interpolated differences can vanish, or point the wrong way, where the field varies from sample
            // to sample; the interpolant's own gradient and the polygon are the safe steps.
            let normal = downhill(interpolated_differences(brick, place, p))
                .or_else(|| downhill(cell.interpolate(p).1))
                .or_else(|| polygon.vector_area.try_normalize());
            let Some(normal) = normal else { continue };
            let position = DVec3::from(index.map(|i| i as f64)) + p;
            batch.centers.push((self.steps * position).as_vec3());
            batch.factors.push(self.factor(&polygon, normal).as_mat3());
            batch.areas.push(polygon.area as f32);
            batch.normals.push(normal.as_vec3());
        }
    }

    /// The half-axes of a surfel: the Gaussian in its plane with the covariance of its polygon blurred by
    /// [`SURFEL_BLUR`].
    fn factor(&self, polygon: &Polygon, normal: DVec3) -> DMat3 {
        let (t1, t2) = normal.any_orthonormal_pair();
        // Normals go to index space by the transpose of what takes steps to the world.
        let (s1, s2) = (self.steps.transpose() * normal).normalize().any_orthonormal_pair();
        let (u, v) = (self.steps * s1 * SURFEL_BLUR, self.steps * s2 * SURFEL_BLUR);
        let covariance =
            |a: DVec3, b: DVec3| a.dot(u) * u.dot(b) + a.dot(v) * v.dot(b) + a.dot(polygon.covariance * b);
        let (c11, c12, c22) = (covariance(t1, t1), covariance(t1, t2), covariance(t2, t2));
        let (sine, cosine) = (0.5 * (2.0 * c12).atan2(c11 - c22)).sin_cos();
        let (mean, spread) = (0.5 * (c11 + c22), (0.5 * (c11 - c22)).hypot(c12));
        let (a, b) = ((mean + spread).sqrt(), (mean - spread).max(0.0).sqrt());
        let (e1, e2) = (t1 * cosine + t2 * sine, t2 * cosine - t1 * sine);
        DMat3::from_cols(e1 * a, e2 * b, normal * (b / self.flattening))
    }
}

/// The cells that have a corner inside and one outside: bit i of row (k, j).
fn crossed_cells(brick: &Brick, iso: f32) -> [[u16; SIDE]; SIDE] {
    let mut sides = [[[0; 2]; SIDE + 1]; SIDE + 1];
    for (k, plane) in sides.iter_mut().enumerate() {
        for (j, row) in plane.iter_mut().enumerate() {
            for (i, &value) in brick.row(j, k).iter().enumerate() {
                row[0] |= u16::from(value >= iso) << i;
                row[1] |= u16::from(value < iso) << i;
            }
        }
    }
    array::from_fn(|k| {
        array::from_fn(|j| {
            let any = |side: usize| {
                let rows = sides[k][j][side] | sides[k][j + 1][side] | sides[k + 1][j][side];
                let rows = rows | sides[k + 1][j + 1][side];
                rows | rows >> 1
            };
            any(0) & any(1)
        })
    })
}

/// The grid's differences at a cell's corners, interpolated at `p`: a gradient per sample step.
fn interpolated_differences(brick: &Brick, place: usize, p: DVec3) -> DVec3 {
    (0..8).fold(DVec3::ZERO, |sum, corner| {
        let share = |axis: usize| if corner >> axis & 1 == 1 { p[axis] } else { 1.0 - p[axis] };
        let differences = brick.differences(Brick::corner(place, corner)).map(f64::from);
        sum + DVec3::from(differences) * (share(0) * share(1) * share(2))
    })
}
