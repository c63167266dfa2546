//! The polygons in which sheets of a surface cross the cells' edges: areas, centroids, covariances.
//!
//! A polygon is a fan of triangles around the mean of its vertices. All that is asked of it are sums over its sides, and each side
//! lies on a face of the cell; so there is no walk around the polygon, and the six faces of all cells are alike.

use super::lanes::*;

/// Maps from cells to the world, whose unit of length is the grid's longest step; matrices by rows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Geometry {
    pub(super) steps: [[f32; 3]; 3],
    /// Takes vector areas: the cofactors of the steps, their sign that of their determinant.
    pub(super) areas: [[f32; 3]; 3],
    /// Takes gradients, up to a factor.
    pub(super) gradients: [[f32; 3]; 3],
    /// Takes a gradient in cells to the direction in cells that is steepest in the world.
    pub(super) descent: [[f32; 3]; 3],
    /// Polygons of less area are none.
    pub(super) least_area: f32,
    /// The length of the unit.
    pub(super) unit: f32,
}

/// See the module.
#[derive(Clone, Copy)]
pub(super) struct Polygon<S: Simd> {
    /// By area, in cell coordinates.
    pub(super) centroid: F3<S>,
    pub(super) area: F<S>,
    /// In the world, towards lower values.
    pub(super) vector_area: F3<S>,
    /// Of its points about the centroid in cell coordinates, by their area in the world: xx, yy, zz, yz, zx, xy.
    pub(super) covariance: [F<S>; 6],
}

impl<S: Simd> Polygon<S> {
    /// A point, which is none.
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        let zero = splat(simd, 0.0);
        let nowhere = [zero; 3];
        Self { centroid: nowhere, area: zero, vector_area: nowhere, covariance: [zero; 6] }
    }
}

/// Which edges are crossed, and where: by axis, and by whether they are upper along the next axis (1) and the one after (2).
struct Crossings<S: Simd> {
    /// From 0 to 1 along the edge; 0 where it isn't crossed.
    at: [[F<S>; 4]; 3],
    /// The upper end is inside, the lower isn't.
    up: [[M<S>; 4]; 3],
    down: [[M<S>; 4]; 3],
}

impl<S: Simd> Crossings<S> {
    #[inline(always)]
    fn new(simd: S, values: &[F<S>; 8], sheets: S::u32s) -> Self {
        let none = S::mask32s::splat(simd, false);
        let zero = splat(simd, 0.0);
        let mut inside = [none; 8];
        for (corner, inside) in inside.iter_mut().enumerate() {
            *inside = (sheets & (1 << corner)).simd_gt(S::u32s::splat(simd, 0));
        }
        let mut found = Self { at: [[zero; 4]; 3], up: [[none; 4]; 3], down: [[none; 4]; 3] };
        for axis in 0..3 {
            for number in 0..4 {
                let lower = (number & 1) << ((axis + 1) % 3) | (number >> 1) << ((axis + 2) % 3);
                let upper = lower | 1 << axis;
                let (up, down) = (!inside[lower] & inside[upper], inside[lower] & !inside[upper]);
                let (a, b) = (values[lower], values[upper]);
                let at = a * reciprocal(simd, a - b);
                found.at[axis][number] = select::<S>(up | down, at, zero);
                found.up[axis][number] = up;
                found.down[axis][number] = down;
            }
        }
        found
    }

    #[inline(always)]
    fn mean(&self, simd: S) -> F3<S> {
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let (mut sum, mut count) = ([zero; 3], zero);
        for axis in 0..3 {
            for number in 0..4 {
                let here = select::<S>(self.up[axis][number] | self.down[axis][number], one, zero);
                count += here;
                sum[axis] += self.at[axis][number];
                if number & 1 == 1 {
                    sum[(axis + 1) % 3] += here;
                }
                if number & 2 == 2 {
                    sum[(axis + 2) % 3] += here;
                }
            }
        }
        scale::<S>(sum, reciprocal(simd, count))
    }
}

/// Sums over the sides of polygons.
struct Sums<S: Simd> {
    mean: F3<S>,
    /// Twice the area.
    area: F<S>,
    vector_area: F3<S>,
    /// Six times the first moment about the mean.
    first: F3<S>,
    /// 16 times the second: xx, yy, zz, yz, zx, xy.
    second: [F<S>; 6],
}

impl<S: Simd> Sums<S> {
    /// Adds a side from p to q on a face across `AXIS`.
    #[inline(always)]
    fn add<const AXIS: usize>(&mut self, simd: S, geometry: &Geometry, [p, q]: [F3<S>; 2]) {
        let (u, v) = ((AXIS + 1) % 3, (AXIS + 2) % 3);
        let (a, b) = (sub::<S>(p, self.mean), sub::<S>(q, self.mean));
        // With d = a + b and c = a − b, a aᵀ + b bᵀ + d dᵀ = 3 (d dᵀ + c cᵀ/3)/2, and c has no part across the face.
        let d = [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        let (c_u, c_v) = (a[u] - b[u], a[v] - b[v]);
        let mut cross = [a[AXIS]; 3];
        cross[AXIS] = a[u].mul_sub(b[v], a[v] * b[u]);
        cross[u] *= c_v;
        cross[v] *= -c_u;
        let twice = times(simd, &geometry.areas, cross);
        let weight = dot::<S>(twice, twice).sqrt();
        self.area += weight;
        for (sum, twice) in self.vector_area.iter_mut().zip(twice) {
            *sum += twice;
        }
        let weighted = scale::<S>(d, weight);
        for (sum, weighted) in self.first.iter_mut().zip(weighted) {
            *sum += weighted;
        }
        let third = weight * (1.0 / 3.0);
        let (wc_u, wc_v) = (third * c_u, third * c_v);
        for axis in 0..3 {
            let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
            self.second[axis] = weighted[axis].mul_add(d[axis], self.second[axis]);
            self.second[3 + axis] = weighted[j].mul_add(d[k], self.second[3 + axis]);
        }
        self.second[u] = wc_u.mul_add(c_u, self.second[u]);
        self.second[v] = wc_v.mul_add(c_v, self.second[v]);
        self.second[3 + AXIS] = wc_u.mul_add(c_v, self.second[3 + AXIS]);
    }

    /// Adds the sides on the lower or upper face across `AXIS`.
    #[inline(always)]
    fn add_face<const AXIS: usize, const UPPER: usize>(
        &mut self,
        simd: S,
        geometry: &Geometry,
        crossings: &Crossings<S>,
    ) {
        let Crossings { at, up, down } = crossings;
        let (u, v) = ((AXIS + 1) % 3, (AXIS + 2) % 3);
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        // The face's edges, counter-clockwise seen from the axis' end, from the one along u through its corner (0, 0).
        let (south, east, north, west) = (2 * UPPER, UPPER + 2, 2 * UPPER + 1, UPPER);
        // Where this way comes inside, and where it leaves.
        let (enters_s, leaves_s) = (up[u][south], down[u][south]);
        let (enters_e, leaves_e) = (up[v][east], down[v][east]);
        let (enters_n, leaves_n) = (down[u][north], up[u][north]);
        let enters_w = down[v][west];
        let (s, e, n, w) = (at[u][south], at[v][east], at[u][north], at[v][west]);
        let face = Face::<S> { u, v, across: splat(simd, UPPER as f32) };
        // A corner is cut off from where its way comes inside to where it leaves. Faces without any give (0, 0) twice.
        let from = face.at(
            select::<S>(enters_s, s, select::<S>(enters_e, one, select::<S>(enters_n, n, zero))),
            select::<S>(enters_s, zero, select::<S>(enters_e, e, select::<S>(enters_n, one, w))),
        );
        let to = face.at(
            select::<S>(leaves_e, one, select::<S>(leaves_n, n, select::<S>(leaves_s, s, zero))),
            select::<S>(leaves_e, e, select::<S>(leaves_n, one, select::<S>(leaves_s, zero, w))),
        );
        let side = |a, b| if UPPER == 1 { [a, b] } else { [b, a] };
        self.add::<AXIS>(simd, geometry, side(from, to));
        // Of two diagonal corners the one above was cut off at the east; the other is at the west.
        let (rising, falling) = (enters_e & enters_w, enters_s & enters_n);
        if (rising | falling).any_true() {
            let from = face.at(select::<S>(falling, n, zero), select::<S>(falling, one, w));
            let to = face.at(select::<S>(rising, s, zero), select::<S>(rising, zero, w));
            self.add::<AXIS>(simd, geometry, side(from, to));
        }
    }
}

/// Puts points of a face into the cell.
struct Face<S: Simd> {
    u: usize,
    v: usize,
    across: F<S>,
}

impl<S: Simd> Face<S> {
    #[inline(always)]
    fn at(&self, u: F<S>, v: F<S>) -> F3<S> {
        let mut point = [self.across; 3];
        point[self.u] = u;
        point[self.v] = v;
        point
    }
}

/// The polygons of sheets in cells of these values at the corners.
#[inline(always)]
pub(super) fn polygon<S: Simd>(
    simd: S,
    geometry: &Geometry,
    values: &[F<S>; 8],
    sheets: S::u32s,
) -> Polygon<S> {
    let crossings = Crossings::new(simd, values, sheets);
    let zero = splat(simd, 0.0);
    let mean = crossings.mean(simd);
    let mut sums = Sums { mean, area: zero, vector_area: [zero; 3], first: [zero; 3], second: [zero; 6] };
    sums.add_face::<0, 0>(simd, geometry, &crossings);
    sums.add_face::<0, 1>(simd, geometry, &crossings);
    sums.add_face::<1, 0>(simd, geometry, &crossings);
    sums.add_face::<1, 1>(simd, geometry, &crossings);
    sums.add_face::<2, 0>(simd, geometry, &crossings);
    sums.add_face::<2, 1>(simd, geometry, &crossings);
    // Of a polygon without an area, too, all numbers are finite.
    let share = reciprocal(simd, sums.area.max(splat(simd, 1e-30)));
    let offset = scale::<S>(sums.first, share * (1.0 / 3.0));
    let eighth = share * 0.125;
    let mut covariance = sums.second;
    for axis in 0..3 {
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
        covariance[axis] = covariance[axis].mul_sub(eighth, offset[axis] * offset[axis]);
        covariance[3 + axis] = covariance[3 + axis].mul_sub(eighth, offset[j] * offset[k]);
    }
    Polygon {
        centroid: [mean[0] + offset[0], mean[1] + offset[1], mean[2] + offset[2]],
        area: sums.area * 0.5,
        vector_area: sums.vector_area,
        covariance,
    }
}
