//! Iso-surfels of curvilinear grids: those of the values in index space, taken to where the cells lie.

use glam::{DMat3, DVec3, Vec3};

use super::local::cofactors;
use super::refinement::Refinement;
use super::{Arrangement, IrregularVolume};
use crate::iso::{Interpolation, IsoError, IsoExtractor, IsoSurfel, IsoSurfels};
use crate::volume::{GridFrame, Volume, VolumeError};

/// A cell's corners as bits: 1 along the first axis, 2 along the second, 4 along the third.
const CORNERS: usize = 8;

/// By how many steps surfels may be beside their cells.
const NUDGE: f64 = 2e-3;

/// A place in a cell of a curvilinear grid, and the grid there.
struct Place {
    /// In the world.
    point: DVec3,
    /// Derivatives of the trilinear map of the cell, by its indices.
    steps: DMat3,
    /// Derivatives of the values' trilinear interpolant, by the cell's indices.
    gradient: DVec3,
    /// The differences between samples on both sides, interpolated, of points and of values: normals are by these.
    smooth: (DMat3, DVec3),
}

/// An irregular volume ready to become iso-surfels at one value after another.
///
/// Surfels are found in index space, where cells are cubes, and taken to the world by the trilinear maps of their cells, x(ξ): a centre to x(ξ),
/// half-axes by the map's derivative, areas by its cofactors. Normals go by the differences of values and of points alike, interpolated, so that those
/// of linear fields are exact whatever the grid. A trilinear cell longer than a 128th of the grid's diagonal is searched in parts: one
/// surfel for all of it would be seen for what it is.
#[derive(Clone, Debug)]
pub struct IrregularExtractor<'a> {
    volume: &'a IrregularVolume,
    refinement: Refinement,
    interpolation: Interpolation,
    extractor: Option<IsoExtractor<Volume>>,
}

impl<'a> IrregularExtractor<'a> {
    /// Looks through the samples. Scattered ones, which have no cells, have no surfaces.
    ///
    /// # Errors
    /// None but those of [`Volume::new`], which samples of a volume do not have.
    pub fn new(volume: &'a IrregularVolume, interpolation: Interpolation) -> Result<Self, VolumeError> {
        let refinement = match (volume.arrangement, interpolation) {
            (Arrangement::Curvilinear, Interpolation::Trilinear) => Refinement::of(volume),
            // A spline through what is trilinear would be no smoother.
            _ => Refinement::none(volume),
        };
        let has_cells = volume.arrangement == Arrangement::Curvilinear;
        let extractor = has_cells.then(|| refinement.samples(volume)).transpose()?.map(IsoExtractor::new);
        Ok(Self { volume, refinement, interpolation, extractor })
    }

    /// Surfels of the surface at which the field is `iso`: see [`iso_surfels`](crate::iso_surfels).
    ///
    /// They are relative to the origin of [`IsoSurfels::frame`], whose spacing is that of the surface's cells, on average by area.
    ///
    /// # Errors
    /// When `iso` is not finite.
    pub fn extract(&self, iso: f32) -> Result<IsoSurfels, IsoError> {
        let frame = GridFrame { origin: self.volume.middle(), ..GridFrame::default() };
        let of_samples = match &self.extractor {
            Some(extractor) => extractor.extract(iso, self.interpolation)?,
            None => IsoSurfels::default(),
        };
        Ok(of_samples.mapped(frame, |surfel| self.in_world(&surfel)))
    }

    /// A surfel of index space in the world, relative to the middle; `None` where cells have collapsed.
    fn in_world(&self, surfel: &IsoSurfel) -> Option<IsoSurfel> {
        let [index, part] = self.refinement.in_volume(surfel.center.as_dvec3());
        // Of a surfel on the face that it shares with a cell beside a missing sample.
        let aside = |by: f64| self.volume.place_at(index + DVec3::splat(by));
        let place = aside(0.0).or_else(|| aside(-NUDGE)).or_else(|| aside(NUDGE))?;
        let steps = place.steps * DMat3::from_diagonal(part);
        let normal = surfel.normal().as_dvec3();
        // The polygon's own side, which the interpolant's slope is across.
        let down = (-place.gradient * part).normalize_or_zero();
        let across = if down.dot(normal) > 0.1 { down } else { normal };
        let area = f64::from(surfel.area) * (cofactors(steps) * across).length();

        let by_cell = along(steps, across)?;
        let (smooth_steps, rises) = place.smooth;
        let smooth_down = if self.interpolation == Interpolation::Tricubic { normal } else { -rises };
        let by_differences = along(smooth_steps, smooth_down).filter(|smooth| smooth.dot(by_cell) > 0.0);
        let normal_in_world = by_differences.unwrap_or(by_cell);
        // Half-axes lie across the normal: along it back to the polygon's plane, to the world, and along the normal there.
        let to_world = |axis: Vec3| {
            let axis = axis.as_dvec3();
            let v = steps * (axis - normal * (axis.dot(across) / normal.dot(across)));
            v - normal_in_world * v.dot(normal_in_world)
        };
        let half_axes = principal(surfel.half_axes.map(to_world), normal_in_world);
        let surfel = IsoSurfel {
            center: (place.point - self.volume.middle()).as_vec3(),
            half_axes: half_axes.map(|axis| axis.as_vec3()),
            area: area as f32,
        };
        let is_surfel = surfel.normal().is_finite() && surfel.center.is_finite() && surfel.area > 0.0;
        (is_surfel && surfel.area.is_finite()).then_some(surfel)
    }
}

impl IrregularVolume {
    /// Surfels of the surface at which the field is `iso`: see [`IrregularExtractor`], which gives those of one value after another.
    ///
    /// # Errors
    /// When `iso` is not finite.
    pub fn iso_surfels(&self, iso: f32, interpolation: Interpolation) -> Result<IsoSurfels, IsoError> {
        IrregularExtractor::new(self, interpolation)?.extract(iso)
    }

    /// What the grid is like at `index`, in sample indices.
    fn place_at(&self, index: DVec3) -> Option<Place> {
        let dims = self.samples.dims();
        let base: [usize; 3] =
            std::array::from_fn(|axis| (index[axis].max(0.0) as usize).min(dims[axis] - 2));
        let share = index - DVec3::from(base.map(|i| i as f64));
        let mut place = Place {
            point: DVec3::ZERO,
            steps: DMat3::ZERO,
            gradient: DVec3::ZERO,
            smooth: (DMat3::ZERO, DVec3::ZERO),
        };
        for corner in 0..CORNERS {
            let bits = [0, 1, 2].map(|axis| corner >> axis & 1);
            let at = [0, 1, 2].map(|axis| base[axis] + bits[axis]);
            let sides = [0, 1, 2].map(|axis| if bits[axis] == 1 { share[axis] } else { 1.0 - share[axis] });
            let weight = sides[0] * sides[1] * sides[2];
            let number = self.samples.place(at);
            let (point, value) = (self.points[number], f64::from(self.samples.voxels().get(number)));
            place.point += point * weight;
            let (steps, rises) = self.grid_steps(at);
            place.smooth = (place.smooth.0 + steps * weight, place.smooth.1 + rises * weight);
            for axis in 0..3 {
                let sign = if bits[axis] == 1 { 1.0 } else { -1.0 };
                let slope = sign * sides[(axis + 1) % 3] * sides[(axis + 2) % 3];
                *place.steps.col_mut(axis) += point * slope;
                place.gradient[axis] += value * slope;
            }
        }
        (place.point.is_finite() && place.steps.is_finite() && place.gradient.is_finite()).then_some(place)
    }
}

/// The unit normal in the world of a plane that has `normal` in index space; a covector, so that mirrored cells do not turn it round.
fn along(steps: DMat3, normal: DVec3) -> Option<DVec3> {
    let sign = if steps.determinant() < 0.0 { -1.0 } else { 1.0 };
    (cofactors(steps) * normal * sign).try_normalize()
}

/// The half-axes of the Gaussian that two conjugate ones across `normal` have, longer one first: a rotation of one-sided Jacobi. Their
/// cross product is along the normal.
fn principal([a, b]: [DVec3; 2], normal: DVec3) -> [DVec3; 2] {
    let angle = 0.5 * (2.0 * a.dot(b)).atan2(a.length_squared() - b.length_squared());
    let (sine, cosine) = angle.sin_cos();
    let (long, short) = (a * cosine + b * sine, b * cosine - a * sine);
    // Rounding leaves what two axes of very different lengths have in common.
    let short = short - long * (short.dot(long) / long.length_squared());
    [long, if long.cross(short).dot(normal) < 0.0 { -short } else { short }]
}
