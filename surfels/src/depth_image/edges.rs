//! Which neighbouring pixels show one surface.

use super::RgbdImage;
use rayon::prelude::*;

/// Depths of neighbours that differ by at most so many pixel widths belong to one surface, whatever it is like beyond them: up to
/// 84.6° to the ray. Depth cameras count in steps of several pixel widths.
const STEP: f32 = 10.6;

/// Where the surface goes on as it began on one side, up to so many: 88°.
pub(super) const STEEPEST: f32 = 28.6;

/// How far, in pixel widths, depths may lie off what goes on as it began; and as a share of the step.
const OFF: [f32; 2] = [0.5, 0.1];

/// Scattered depths are of one surface up to 72° to the ray, in pixel widths a pixel; in any case where they differ by a tenth, as rows of laser scanners on
/// the ground do, and never where they differ by more than a quarter.
const SLOPE: f32 = 3.0;
const SHARES: [f32; 2] = [0.1, 0.25];

/// Tells steps from surfaces.
#[derive(Clone, Copy)]
pub(super) struct Steps {
    /// Focal lengths in pixels.
    focal: [f32; 2],
}

impl Steps {
    pub(super) fn of(image: &RgbdImage) -> Self {
        Self { focal: image.intrinsics.focal.as_vec2().to_array() }
    }

    /// Whether depths in one pixel, or in neighbours, are of one surface.
    pub(super) fn are_one_surface(&self, [a, b]: [f32; 2]) -> bool {
        (a - b).abs() * self.focal[0].min(self.focal[1]) <= STEP * a.min(b)
    }

    /// Whether depths that are several pixels apart are taken for one surface, with nothing known between them.
    pub(super) fn may_go_on(&self, [a, b]: [f32; 2], pixels: f32) -> bool {
        let slope = SLOPE * pixels / self.focal[0].min(self.focal[1]);
        (a - b).abs() <= slope.clamp(SHARES[0], SHARES[1]) * a.min(b)
    }

    /// Whether the second and third of four depths along a line of pixels are of one surface. In 1/z planes are linear, and so is what
    /// goes on as it began.
    fn are_linked(&self, [before, near, far, after]: [f32; 4], axis: usize) -> bool {
        if near <= 0.0 || far <= 0.0 {
            return false;
        }
        // Pixel widths at the nearer of both.
        let widths = self.focal[axis] / near.min(far);
        let step = (far - near).abs() * widths;
        if step <= STEP {
            return true;
        }
        if step > STEEPEST {
            return false;
        }
        let goes_on = |from: f32, by: f32, to: f32| {
            let expected = 2.0 / by - 1.0 / from;
            from > 0.0 && expected > 0.0 && (1.0 / expected - to).abs() * widths <= OFF[0] + OFF[1] * step
        };
        goes_on(before, near, far) || goes_on(after, far, near)
    }
}

/// Links between the pixels of a depth image.
pub(super) struct Edges {
    width: usize,
    /// Of each pixel [`Self::RIGHT`], [`Self::BELOW`].
    links: Vec<u8>,
}

impl Edges {
    /// It shows the surface that the pixel to the right shows.
    const RIGHT: u8 = 1;
    /// It shows the surface that the pixel below shows.
    const BELOW: u8 = 2;

    /// `depths` are along the axis, 0 where unknown.
    pub(super) fn of(width: usize, depths: &[f32], steps: &Steps) -> Self {
        let height = depths.len() / width;
        let unknown = vec![0.0; width];
        let row_of = |row: usize| if row < height { &depths[row * width..][..width] } else { &unknown[..] };
        let mut links = vec![0; depths.len()];
        links.par_chunks_mut(width).enumerate().for_each(|(row, links)| {
            let own = row_of(row);
            let [above, below, second] = [row.wrapping_sub(1), row + 1, row + 2].map(row_of);
            let across = |x: usize| own.get(x).copied().unwrap_or(0.0);
            for (x, link) in links.iter_mut().enumerate() {
                let right = [across(x.wrapping_sub(1)), own[x], across(x + 1), across(x + 2)];
                let down = [above[x], own[x], below[x], second[x]];
                let right = if steps.are_linked(right, 0) { Self::RIGHT } else { 0 };
                *link = right | if steps.are_linked(down, 1) { Self::BELOW } else { 0 };
            }
        });
        Self { width, links }
    }

    /// 1 for each pixel of a row that is linked with the one to its right, 0 for others.
    pub(super) fn right(&self, row: usize, are_linked: &mut [f32]) {
        for (linked, link) in are_linked.iter_mut().zip(&self.links[row * self.width..]) {
            *linked = f32::from(link & Self::RIGHT);
        }
    }

    /// Multiplies by 1 where a pixel of a row is linked with the one below, by 0 elsewhere.
    pub(super) fn below(&self, row: usize, are_linked: &mut [f32]) {
        for (linked, link) in are_linked.iter_mut().zip(&self.links[row * self.width..]) {
            *linked *= f32::from((link & Self::BELOW) >> 1);
        }
    }

    /// Whether a pixel is linked with its left, right, upper and lower neighbours.
    pub(super) fn around(&self, at: usize) -> [bool; 4] {
        let own = self.links[at];
        [
            !at.is_multiple_of(self.width) && self.links[at - 1] & Self::RIGHT != 0,
            own & Self::RIGHT != 0,
            at >= self.width && self.links[at - self.width] & Self::BELOW != 0,
            own & Self::BELOW != 0,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_told_from_steps() {
        let focal = 500.0;
        let wall = 2.0;
        let widths = |n: f32| n * wall / focal;
        let steps = Steps { focal: [focal; 2] };
        let linked = |depths: [f32; 4]| steps.are_linked(depths, 0);
        assert!(linked([wall; 4]));
        // What a depth camera counts in is no edge, a step of more is one, whichever side it is on.
        assert!(linked([wall, wall, wall + widths(5.0), wall + widths(5.0)]));
        assert!(!linked([wall, wall, wall + widths(12.0), wall + widths(12.0)]));
        assert!(!linked([wall + widths(12.0), wall + widths(12.0), wall, wall]));
        // A floor seen at a grazing angle: 1/z is linear.
        let floor = |x: f32| 1.0 / (0.5 - x * 0.02);
        assert!(
            linked([0.0, 1.0, 2.0, 3.0].map(floor)) && (floor(2.0) - floor(1.0)) * focal / floor(1.0) > STEP
        );
        // And where it ends at an edge.
        assert!(linked([0.0, floor(1.0), floor(2.0), floor(3.0)]));
        assert!(!linked([0.0, floor(1.0), floor(2.0), 0.0]));
        // Steeper than 88° nothing is one.
        let sheer = |x: f32| 1.0 / (0.5 - x * 0.06);
        assert!(!linked([0.0, 1.0, 2.0, 3.0].map(sheer)));
        // Unknown depths are linked to nothing.
        assert!(!linked([wall, wall, 0.0, wall]) && !linked([wall, 0.0, wall, wall]));
    }
}
