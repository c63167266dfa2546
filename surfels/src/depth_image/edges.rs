//! Which neighbouring pixels show one surface.

use super::RgbdImage;
use rayon::prelude::*;

/// Depths of neighbours that differ by at most so many pixel widths belong to one surface, whatever it is like beyond them: up to
/// 84.6° to the ray. Depth cameras count in steps of several pixel widths.
const STEP: f32 = 10.6;

/// Where the surface goes on as it began on one side, up to so many: 88°.
const STEEPEST: f32 = 28.6;

/// How far, in pixel widths, depths may lie off what goes on as it began; and as a share of the step.
const OFF: [f32; 2] = [0.5, 0.1];

/// Links between the pixels of a depth image.
pub(super) struct Edges {
    width: usize,
    /// Bit 0: linked with the pixel to the right; bit 1: with the one below.
    links: Vec<u8>,
}

impl Edges {
    pub(super) fn of(image: &RgbdImage, depths: &[f32]) -> Self {
        let [width, height] = image.size;
        let focal = image.intrinsics.focal.as_vec2();
        let mut links = vec![0; width * height];
        links.par_chunks_mut(width).enumerate().for_each(|(row, links)| {
            let at = row * width;
            let own = &depths[at..at + width];
            let of_row = |row: usize| depths.get(row * width..(row + 1) * width);
            let neighbor = |x: usize| own.get(x).copied().unwrap_or(0.0);
            for (x, link) in links.iter_mut().enumerate() {
                let run = [neighbor(x.wrapping_sub(1)), own[x], neighbor(x + 1), neighbor(x + 2)];
                *link = u8::from(are_linked(run, focal.x));
            }
            let Some(below) = of_row(row + 1) else { return };
            let (above, second) = (row.checked_sub(1).and_then(of_row), of_row(row + 2));
            for (x, link) in links.iter_mut().enumerate() {
                let before = above.map_or(0.0, |above| above[x]);
                let after = second.map_or(0.0, |second| second[x]);
                *link |= u8::from(are_linked([before, own[x], below[x], after], focal.y)) << 1;
            }
        });
        Self { width, links }
    }

    /// Whether a pixel shows the surface that its right neighbour shows.
    pub(super) fn right(&self, at: usize) -> bool {
        self.links[at] & 1 != 0
    }

    /// Whether a pixel shows the surface that the one below shows.
    pub(super) fn below(&self, at: usize) -> bool {
        self.links[at] & 2 != 0
    }

    /// Whether a pixel is linked to its left, right, upper and lower neighbours.
    pub(super) fn around(&self, at: usize) -> [bool; 4] {
        let (column, row) = (at % self.width, at / self.width);
        [
            column > 0 && self.right(at - 1),
            self.right(at),
            row > 0 && self.below(at - self.width),
            self.below(at),
        ]
    }
}

/// Whether the second and third of four depths along a line of pixels are of one surface. In 1/z planes are linear, and so is what goes
/// on as it began.
fn are_linked([before, near, far, after]: [f32; 4], focal: f32) -> bool {
    if near <= 0.0 || far <= 0.0 {
        return false;
    }
    // Pixel widths at the nearer of both.
    let widths = focal / near.min(far);
    let step = (far - near).abs() * widths;
    if step <= STEP {
        return true;
    }
    if step > STEEPEST {
        return false;
    }
    let goes_on = |from: f32, by: f32, to: f32| {
        from > 0.0 && {
            let expected = 2.0 / by - 1.0 / from;
            expected > 0.0 && (1.0 / expected - to).abs() * widths <= OFF[0] + OFF[1] * step
        }
    };
    goes_on(before, near, far) || goes_on(after, far, near)
}
