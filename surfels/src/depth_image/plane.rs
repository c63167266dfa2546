//! The plane around a pixel.

use super::edges::Edges;
use rayon::prelude::*;

/// How far support reaches from a pixel, in pixels.
pub(super) const REACH: usize = 2;

/// Added to the second moments, in px²: where support tells nothing of a slope, it is 0.
const RIDGE: f32 = 1e-3;

/// The surface about a pixel's centre: 1/z = `inverse` + `slope` · (x, y), which is how a plane is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Plane {
    /// 0 where the depth is unknown.
    pub(super) inverse: f32,
    /// A pixel to the right, a pixel down.
    pub(super) slope: [f32; 2],
}

/// The plane of each pixel: the least squares in 1/z over the pixels around it that show its surface, which are those that links lead to, first
/// along the column and then along rows (Zhang, Lu, Lafruit, *Cross-Based Local Stereo Matching Using Orthogonal Integral Images*, 2009).
pub(super) fn planes(width: usize, depths: &[f32], edges: &Edges) -> Vec<Plane> {
    let height = depths.len() / width;
    let rows: Vec<Moments> = (0..height).into_par_iter().flat_map_iter(|row| {
        (0..width).map(move |column| Moments::along_row(depths, edges, [column, row], width))
    }).collect();
    let mut planes = vec![Plane::default(); depths.len()];
    planes.par_chunks_mut(width).enumerate().for_each(|(row, planes)| {
        for (column, plane) in planes.iter_mut().enumerate() {
            let at = row * width + column;
            if depths[at] > 0.0 {
                let mut sum = rows[at];
                for up in 1..=REACH.min(row) {
                    let above = at - up * width;
                    if !edges.below(above) { break }
                    sum.add(&rows[above], -(up as f32));
                }
                for down in 1..=REACH {
                    let below = at + down * width;
                    if !edges.below(below - width) { break }
                    sum.add(&rows[below], down as f32);
                }
                *plane = sum.plane();
            }
        }
    });
    planes
}

/// Sums over supporting pixels, x and y measured from the pixel's centre.
#[derive(Clone, Copy, Default)]
struct Moments {
    count: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    /// Of the inverse depth, alone and times x and y.
    d: f32,
    dx: f32,
    dy: f32,
}

impl Moments {
    fn along_row(depths: &[f32], edges: &Edges, [column, row]: [usize; 2], width: usize) -> Self {
        let at = row * width + column;
        let mut sum = Self::default();
        if depths[at] <= 0.0 {
            return sum;
        }
        let mut add = |x: f32, depth: f32| {
            let d = 1.0 / depth;
            sum.count += 1.0;
            sum.x += x;
            sum.xx += x * x;
            sum.d += d;
            sum.dx += d * x;
        };
        add(0.0, depths[at]);
        for left in 1..=REACH.min(column) {
            if !edges.right(at - left) { break }
            add(-(left as f32), depths[at - left]);
        }
        for right in 1..=REACH {
            if !edges.right(at + right - 1) { break }
            add(right as f32, depths[at + right]);
        }
        sum
    }

    /// Adds those of a row that is `y` pixels further down.
    fn add(&mut self, row: &Self, y: f32) {
        self.count += row.count;
        self.x += row.x;
        self.y += row.count * y;
        self.xx += row.xx;
        self.xy += row.x * y;
        self.yy += row.count * y * y;
        self.d += row.d;
        self.dx += row.dx;
        self.dy += row.d * y;
    }

    fn plane(&self) -> Plane {
        let (x, y, d) = (self.x / self.count, self.y / self.count, self.d / self.count);
        let xx = self.xx - self.count * x * x + RIDGE;
        let yy = self.yy - self.count * y * y + RIDGE;
        let xy = self.xy - self.count * x * y;
        let dx = self.dx - self.count * d * x;
        let dy = self.dy - self.count * d * y;
        let determinant = xx * yy - xy * xy;
        let slope = [(dx * yy - dy * xy) / determinant, (dy * xx - dx * xy) / determinant];
        Plane { inverse: d - slope[0] * x - slope[1] * y, slope }
    }
}
