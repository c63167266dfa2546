//! Iso-surfels of curvilinear grids: those of the values in index space, taken to where the cells lie.

use glam::{DMat3, DVec3};

use super::IrregularVolume;
use super::local::cofactors;
use crate::iso::{Interpolation, IsoError, IsoExtractor, IsoSurfel, IsoSurfels};
use crate::volume::GridFrame;

/// A cell's corners as bits: 1 along the first axis, 2 along the second, 4 along the third.
const CORNERS: usize = 8;

/// A place in a cell of a curvilinear grid, and the grid there.
struct Place {
    /// In the world.
    point: DVec3,
    /// Derivatives of the trilinear map of the cell, by its indices.
    steps: DMat3,
    /// The differences between samples on both sides, interpolated: normals are right by them where those of the values are.
    smooth_steps: DMat3,
    /// Derivatives of the values' trilinear interpolant, by the cell's indices.
    gradient: DVec3,
}

impl IrregularVolume {
    /// Surfels of the surface at which the field is `iso`: see [`iso_surfels`](crate::iso_surfels). Scattered samples, which have no cells, have none.
    ///
    /// # Errors
    /// When `iso` is not finite.
    pub fn iso_surfels(&self, iso: f32, interpolation: Interpolation) -> Result<IsoSurfels, IsoError> {
        Ok(self.in_world(IsoExtractor::new(&self.samples).extract(iso, interpolation)?))
    }

    /// The iso-surfels of [`Self::samples`] in the world, for one who has an [`IsoExtractor`] of those.
    ///
    /// They are those of index space, where cells are cubes, taken to the world by the trilinear maps of their cells, x(ξ): a centre to x(ξ),
    /// half-axes by the map's derivative, areas by its cofactors. Normals go by the inverse transpose of the interpolated differences of points,
    /// so that those of linear fields are exact whatever the grid. They are relative to the origin of [`IsoSurfels::frame`], whose spacing is
    /// that of the surface's cells, on average by area.
    #[must_use]
    pub fn in_world(&self, of_samples: IsoSurfels) -> IsoSurfels {
        let frame = GridFrame { origin: self.middle(), ..GridFrame::default() };
        of_samples.mapped(frame, |surfel| self.moved(&surfel))
    }

    /// A surfel of index space in the world, relative to the middle; `None` where cells have collapsed.
    fn moved(&self, surfel: &IsoSurfel) -> Option<IsoSurfel> {
        let step = self.samples.frame().spacing.x;
        let place = self.place(surfel.center.as_dvec3() / step)?;
        let normal = surfel.normal().as_dvec3();
        // The polygon's own side, which the interpolant's slope is across.
        let down = (-place.gradient).normalize_or_zero();
        let across = if down.dot(normal) > 0.1 { down } else { normal };
        let cofactors = cofactors(place.steps);
        let area = f64::from(surfel.area) / (step * step) * (cofactors * across).length();

        let by_cell = along(place.steps, across)?;
        let by_differences = along(place.smooth_steps, normal).filter(|smooth| smooth.dot(by_cell) > 0.0);
        let normal_in_world = by_differences.unwrap_or(by_cell);
        // Half-axes lie across the normal: along it back to the polygon's plane, to the world, and along the normal there.
        let to_world = |axis: glam::Vec3| {
            let axis = axis.as_dvec3() / step;
            let in_polygon = axis - normal * (axis.dot(across) / normal.dot(across));
            let v = place.steps * in_polygon;
            v - normal_in_world * v.dot(normal_in_world)
        };
        let half_axes = principal(surfel.half_axes.map(to_world), normal_in_world);
        let center = place.point - self.middle();
        let surfel = IsoSurfel {
            center: center.as_vec3(),
            half_axes: half_axes.map(|axis| axis.as_vec3()),
            area: area as f32,
        };
        let is_surfel = surfel.normal().is_finite() && surfel.center.is_finite() && surfel.area > 0.0;
        (is_surfel && surfel.area.is_finite()).then_some(surfel)
    }

    /// What the grid is like at `index`, in sample indices.
    fn place(&self, index: DVec3) -> Option<Place> {
        let dims = self.samples.dims();
        let base: [usize; 3] =
            std::array::from_fn(|axis| (index[axis].max(0.0) as usize).min(dims[axis] - 2));
        let share = index - DVec3::from(base.map(|i| i as f64));
        let mut place = Place {
            point: DVec3::ZERO,
            steps: DMat3::ZERO,
            smooth_steps: DMat3::ZERO,
            gradient: DVec3::ZERO,
        };
        for corner in 0..CORNERS {
            let bits = [0, 1, 2].map(|axis| corner >> axis & 1);
            let at = [0, 1, 2].map(|axis| base[axis] + bits[axis]);
            let sides = [0, 1, 2].map(|axis| if bits[axis] == 1 { share[axis] } else { 1.0 - share[axis] });
            let weight = sides[0] * sides[1] * sides[2];
            let number = self.samples.place(at);
            let (point, value) = (self.points[number], f64::from(self.samples.voxels().get(number)));
            place.point += point * weight;
            place.smooth_steps += self.grid_steps(at).0 * weight;
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
