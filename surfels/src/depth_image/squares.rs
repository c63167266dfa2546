//! The order in which pixels become surfels.

use rayon::prelude::*;

/// Column and row of a pixel, of which images have 65,535 at most.
pub(super) type Pixel = [u16; 2];

/// Pixels along the side of a square.
pub(super) const SIDE: usize = 8;

/// The places in a square along a Morton curve.
const CURVE: [[u8; 2]; SIDE * SIDE] = {
    let mut curve = [[0; 2]; SIDE * SIDE];
    let mut step = 0;
    while step < curve.len() {
        let mut bit = 0;
        while 1 << (2 * bit) < curve.len() {
            curve[step][0] |= ((step >> (2 * bit) & 1) << bit) as u8;
            curve[step][1] |= ((step >> (2 * bit + 1) & 1) << bit) as u8;
            bit += 1;
        }
        step += 1;
    }
    curve
};

/// The pixels whose depths are known, above 0, square by square and in these along a Morton curve: what follows each other lies together in
/// the picture, where eight surfels at a time are looked at.
pub(super) fn in_squares(width: usize, depths: &[f32]) -> Vec<Pixel> {
    let of_rows = |(number, rows): (usize, &[f32])| {
        let (mut known, mut count) = (vec![Pixel::default(); rows.len() + 1], 0);
        for first in (0..width).step_by(SIDE) {
            let mut bits = [0_u8; SIDE];
            for (bits, row) in bits.iter_mut().zip(rows.chunks_exact(width)) {
                let depths = row[first..].iter().take(SIDE);
                *bits = depths.rev().fold(0, |bits, depth| bits << 1 | u8::from(*depth > 0.0));
            }
            let corner = [first, number * SIDE].map(|x| x as u16);
            // Without a branch: the next one takes the place of one that is unknown.
            for [x, y] in CURVE {
                known[count] = [corner[0] + u16::from(x), corner[1] + u16::from(y)];
                count += usize::from(bits[usize::from(y)] >> x & 1);
            }
        }
        known.truncate(count);
        known
    };
    let known = depths.par_chunks(SIDE * width).enumerate().map(of_rows);
    known.collect::<Vec<_>>().concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each pixel whose depth is known comes once, in images of any side, and eight that follow each other in a whole square are beside
    /// each other.
    #[test]
    fn known_pixels_come_once() {
        for [width, height] in [[1, 2], [7, 3], [8, 8], [21, 17], [64, 24]] {
            let depths: Vec<f32> = (0..width * height).map(|at| (at % 5 % 2) as f32).collect();
            let mut places: Vec<usize> = in_squares(width, &depths)
                .iter()
                .map(|[column, row]| usize::from(*row) * width + usize::from(*column))
                .collect();
            places.sort_unstable();
            let known: Vec<usize> = (0..depths.len()).filter(|at| depths[*at] > 0.0).collect();
            assert_eq!(places, known, "{width}×{height}");
        }
        for eight in in_squares(24, &[1.0; 24 * 16]).chunks(8) {
            let sides = [0, 1].map(|axis| {
                let along = || eight.iter().map(|pixel| pixel[axis]);
                along().max().unwrap() - along().min().unwrap()
            });
            assert_eq!(sides, [3, 1]);
        }
    }
}
