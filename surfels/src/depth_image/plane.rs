//! The plane around a pixel.

use super::edges::Edges;
use super::lanes::*;

/// How far support reaches from a pixel, in pixels.
const REACH: usize = BORDER;

/// Added to the second moments, in px²: where support tells nothing of a slope, it is 0.
const RIDGE: f32 = 1e-3;

/// The surfaces about pixels' centres: 1/z = `inverse` + `slope` · (x, y), which is how a plane is seen.
pub(super) struct Planes<S: Simd> {
    /// Of no meaning where the depth is unknown.
    pub(super) inverse: F<S>,
    /// A pixel to the right, a pixel down.
    pub(super) slope: [F<S>; 2],
}

/// Sums over supporting pixels of a row, x measured from the pixel's own centre; d = 1/z.
struct RowSums<S: Simd> {
    count: F<S>,
    x: F<S>,
    xx: F<S>,
    d: F<S>,
    dx: F<S>,
}

impl<S: Simd> Planes<S> {
    /// Those of the pixels from a place on, a multiple of [`LANES`] from the row's first: the least squares in 1/z over those up to two
    /// pixels away that show a pixel's surface, to which links lead first along the column and then along rows (Zhang, Lu, Lafruit,
    /// *Cross-Based Local Stereo Matching Using Orthogonal Integral Images*, 2009).
    #[inline(always)]
    pub(super) fn at(simd: S, (inverses, edges): (&Bordered, &Edges), place: usize) -> Self {
        let (stride, images) = (inverses.stride, (inverses, edges));
        let mut total = Sums::of(simd, RowSums::at(simd, images, place));
        let (mut above, mut below) = (splat(simd, 1.0), splat(simd, 1.0));
        for far in 1..=REACH {
            above *= edges.below.load(simd, place - far * stride);
            below *= edges.below.load(simd, place + (far - 1) * stride);
            total.add(RowSums::at(simd, images, place - far * stride), -(far as f32), above);
            total.add(RowSums::at(simd, images, place + far * stride), far as f32, below);
        }
        total.plane(simd)
    }
}

impl<S: Simd> RowSums<S> {
    #[inline(always)]
    fn at(simd: S, (inverses, edges): (&Bordered, &Edges), place: usize) -> Self {
        let (one, zero) = (splat(simd, 1.0), splat(simd, 0.0));
        let mut sums = Self { count: one, x: zero, xx: zero, d: inverses.load(simd, place), dx: zero };
        let (mut left, mut right) = (one, one);
        for step in 1..=REACH {
            let far = step as f32;
            left *= edges.right.load(simd, place - step);
            right *= edges.right.load(simd, place + step - 1);
            let before = left * inverses.load(simd, place - step);
            let after = right * inverses.load(simd, place + step);
            sums.count += left + right;
            sums.x += (right - left) * far;
            sums.xx += (left + right) * (far * far);
            sums.d += before + after;
            sums.dx += (after - before) * far;
        }
        sums
    }
}

/// Sums over all supporting pixels.
struct Sums<S: Simd> {
    /// Those that know no y.
    row: RowSums<S>,
    y: F<S>,
    xy: F<S>,
    yy: F<S>,
    dy: F<S>,
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    fn of(simd: S, row: RowSums<S>) -> Self {
        let zero = splat(simd, 0.0);
        Self { row, y: zero, xy: zero, yy: zero, dy: zero }
    }

    /// Adds a share of those of a row that is `y` pixels further down.
    #[inline(always)]
    fn add(&mut self, row: RowSums<S>, y: f32, share: F<S>) {
        let [count, x, d] = [share * row.count, share * row.x, share * row.d];
        self.row.count += count;
        self.row.x += x;
        self.row.xx += share * row.xx;
        self.row.d += d;
        self.row.dx += share * row.dx;
        self.y += count * y;
        self.xy += x * y;
        self.yy += count * (y * y);
        self.dy += d * y;
    }

    #[inline(always)]
    fn plane(self, simd: S) -> Planes<S> {
        let Self { row: RowSums { count, x, xx, d, dx }, y, xy, yy, dy } = self;
        let per_count = splat(simd, 1.0) / count;
        let (x, y, d) = (x * per_count, y * per_count, d * per_count);
        let xx = xx - count * x * x + RIDGE;
        let yy = yy - count * y * y + RIDGE;
        let xy = xy - count * x * y;
        let (dx, dy) = (dx - count * d * x, dy - count * d * y);
        let per_determinant = splat(simd, 1.0) / (xx * yy - xy * xy);
        let slope = [(dx * yy - dy * xy) * per_determinant, (dy * xx - dx * xy) * per_determinant];
        Planes { inverse: d - slope[0] * x - slope[1] * y, slope }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth_image::edges::Steps;
    use crate::depth_image::tests::{image, plane};
    use oblate_engine::simd::{Level, dispatch};

    /// Planes are found as they are, at borders and beside unknown depths, too.
    #[test]
    fn a_plane_is_found() {
        let image = image([9, 7], plane([0.3, -0.5, 2.0]));
        let mut inverses: Vec<f32> = image.depths.iter().map(|depth| 1.0 / depth).collect();
        for hole in [31, 40] {
            inverses[hole] = 0.0;
        }
        let bordered = Bordered::of(9, &inverses);
        let edges = Edges::of(Level::best(), ([9, 7], &bordered), &Steps::of(&image), Edges::default());
        let slope = [0.3, -0.5].map(|n| (n / image.intrinsics.focal.x) as f32);
        for (at, inverse) in inverses.iter().enumerate().filter(|(_, inverse)| **inverse > 0.0) {
            let (column, place) = (at % 9, bordered.place([0, at / 9]));
            let plane = dispatch!(Level::best(), simd => {
                let planes = Planes::at(simd, (&bordered, &edges), place);
                [planes.inverse[column], planes.slope[0][column], planes.slope[1][column]]
            });
            // The ridge takes 1e-3 of at least 2 px² from a slope; 1/z itself is the mean of such errors times 2 px at most.
            let about =
                |a: f32, b: f32, scale: f32| assert!((a - b).abs() < 1e-3 * scale, "{at}: {a} for {b}");
            about(plane[0], *inverse, 2.0 * slope[1].abs());
            about(plane[1], slope[0], slope[1].abs());
            about(plane[2], slope[1], slope[1].abs());
        }
    }
}
