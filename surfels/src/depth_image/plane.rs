//! The plane around a pixel.

use super::edges::Edges;
use rayon::prelude::*;

/// How far support reaches from a pixel, in pixels.
const REACH: usize = 2;

/// Added to the second moments, in px²: where support tells nothing of a slope, it is 0.
const RIDGE: f32 = 1e-3;

/// Rows that a thread takes at a time.
const BAND: usize = 16;

/// Sums over supporting pixels, x and y measured from the pixel's own centre; d = 1/z.
const MOMENTS: usize = 9;
const COUNT: usize = 0;
const X: usize = 1;
const Y: usize = 2;
const XX: usize = 3;
const XY: usize = 4;
const YY: usize = 5;
const D: usize = 6;
const DX: usize = 7;
const DY: usize = 8;

/// The surface about a pixel's centre: 1/z = `inverse` + `slope` · (x, y), which is how a plane is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Plane {
    /// Of no meaning where the depth is unknown.
    pub(super) inverse: f32,
    /// A pixel to the right, a pixel down.
    pub(super) slope: [f32; 2],
}

/// The plane of each pixel: the least squares in 1/z over those up to two pixels away that show its surface, to which links lead first along the
/// column and then along rows (Zhang, Lu, Lafruit, *Cross-Based Local Stereo Matching Using Orthogonal Integral Images*, 2009).
pub(super) fn planes(width: usize, depths: &[f32], edges: &Edges) -> Vec<Plane> {
    let height = depths.len() / width;
    let mut planes = vec![Plane::default(); depths.len()];
    planes.par_chunks_mut(BAND * width).enumerate().for_each(|(band, planes)| {
        let first = band * BAND;
        let rows = first.saturating_sub(REACH)..(first + BAND + REACH).min(height);
        let mut sums = Vec::with_capacity(rows.len());
        sums.extend(rows.clone().map(|row| along_row(width, depths, edges, row)));
        let mut total = vec![[0.0; MOMENTS]; width];
        for (row, planes) in planes.chunks_mut(width).enumerate().map(|(row, planes)| (first + row, planes)) {
            total.copy_from_slice(&sums[row - rows.start]);
            let mut add = |other: usize, y: f32, shares: &[f32]| {
                for ((total, sum), share) in total.iter_mut().zip(&sums[other - rows.start]).zip(shares) {
                    add(total, sum, y, *share);
                }
            };
            let mut shares = vec![1.0; width];
            for up in 1..=REACH.min(row) {
                edges.below(row - up, &mut shares);
                add(row - up, -(up as f32), &shares);
            }
            shares.fill(1.0);
            for down in (1..=REACH).take_while(|down| row + down < height) {
                edges.below(row + down - 1, &mut shares);
                add(row + down, down as f32, &shares);
            }
            for (plane, total) in planes.iter_mut().zip(&total) {
                *plane = plane_of(total);
            }
        }
    });
    planes
}

/// Those of the pixels of a row that support each of it.
fn along_row(width: usize, depths: &[f32], edges: &Edges, row: usize) -> Vec<[f32; MOMENTS]> {
    let depths = &depths[row * width..(row + 1) * width];
    // Zeros at both ends, where links lead nowhere.
    let mut inverse = vec![0.0; width + 2 * REACH];
    let mut link = vec![0.0; width + 2 * REACH];
    for (inverse, depth) in inverse[REACH..].iter_mut().zip(depths) {
        *inverse = if *depth > 0.0 { 1.0 / depth } else { 0.0 };
    }
    edges.right(row, &mut link[REACH..REACH + width]);
    let pixel = |x: usize| {
        let own = inverse[x + REACH];
        let mut sum = [0.0; MOMENTS];
        (sum[COUNT], sum[D]) = (1.0, own);
        let (mut left, mut right) = (1.0, 1.0);
        for step in 1..=REACH {
            let far = step as f32;
            left *= link[x + REACH - step];
            right *= link[x + REACH + step - 1];
            let (before, after) = (left * inverse[x + REACH - step], right * inverse[x + REACH + step]);
            sum[COUNT] += left + right;
            sum[X] += far * (right - left);
            sum[XX] += far * far * (left + right);
            sum[D] += before + after;
            sum[DX] += far * (after - before);
        }
        sum
    };
    (0..width).map(pixel).collect()
}

/// Adds a share of those of a row that is `y` pixels further down.
#[inline(always)]
fn add(total: &mut [f32; MOMENTS], row: &[f32; MOMENTS], y: f32, share: f32) {
    let row = row.map(|sum| share * sum);
    for i in [COUNT, X, XX, D, DX] {
        total[i] += row[i];
    }
    total[Y] += row[COUNT] * y;
    total[XY] += row[X] * y;
    total[YY] += row[COUNT] * y * y;
    total[DY] += row[D] * y;
}

fn plane_of(sums: &[f32; MOMENTS]) -> Plane {
    let [count, x, y, xx, xy, yy, d, dx, dy] = *sums;
    let (x, y, d) = (x / count, y / count, d / count);
    let xx = xx - count * x * x + RIDGE;
    let yy = yy - count * y * y + RIDGE;
    let xy = xy - count * x * y;
    let (dx, dy) = (dx - count * d * x, dy - count * d * y);
    let determinant = xx * yy - xy * xy;
    let slope = [(dx * yy - dy * xy) / determinant, (dy * xx - dx * xy) / determinant];
    Plane { inverse: d - slope[0] * x - slope[1] * y, slope }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth_image::edges::Steps;
    use crate::depth_image::tests::{image, plane};

    /// Planes are found as they are, at borders and beside unknown depths, too.
    #[test]
    fn a_plane_is_found() {
        let image = image([9, 7], plane([0.3, -0.5, 2.0]));
        let mut depths = image.depths.clone();
        for hole in [31, 40] {
            depths[hole] = 0.0;
        }
        let edges = Edges::of(9, &depths, &Steps::of(&image));
        let planes = planes(9, &depths, &edges);
        let slope = [0.3, -0.5].map(|n| (n / image.intrinsics.focal.x) as f32);
        for (at, plane) in planes.iter().enumerate().filter(|(at, _)| depths[*at] > 0.0) {
            // The ridge takes 1e-3 of at least 2 px² from a slope; 1/z itself is the mean of such errors times 2 px at most.
            let about =
                |a: f32, b: f32, scale: f32| assert!((a - b).abs() < 1e-3 * scale, "{at}: {a} for {b}");
            about(plane.inverse, 1.0 / image.depths[at], 2.0 * slope[1].abs());
            about(plane.slope[0], slope[0], slope[1].abs());
            about(plane.slope[1], slope[1], slope[1].abs());
        }
    }
}
