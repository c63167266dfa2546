//! What lies behind edges, guessed from the background beside it, and depths between scattered ones.

use super::edges::Steps;
use super::scattered::Scattered;
use super::{DepthError, RgbdImage};
use glam::DVec2;
use oblate_engine::Frame;

/// A pixel of less opacity is a hole.
const HOLE: f32 = 0.5;

/// A pixel of more has the colour of what is seen there alone.
const COVERED: f32 = 0.98;

/// Depths across a hole that differ by a larger share are of two surfaces.
const STEP: f32 = 0.05;

/// Fills what a warped picture doesn't show: holes between covered pixels become what is interpolated between natural neighbours among the
/// pixels at their borders (colours, and 1/z), or, outside the convex hull of those, what the nearest is. Where the border is of two surfaces,
/// one farther than the other, only the farther counts. What has nothing covered on both sides, along its row or its column, is beside what was
/// warped and stays transparent.
///
/// The frame must have depths ([`oblate_engine::Channels::All`]); filled pixels have no normal and no id. Gives the number of filled pixels.
pub fn fill_disocclusions(frame: &mut Frame) -> usize {
    let [width, height] = [frame.width, frame.height];
    if frame.median_depth.len() < width * height {
        return 0;
    }
    let extent = Extent::of(frame);
    let mut component = vec![0_u32; width * height];
    let (mut filled, mut count) = (0, 0);
    for start in 0..width * height {
        if component[start] == 0 && frame.color[start][3] < HOLE {
            count += 1;
            let hole = Hole::around(frame, &mut component, (start, count));
            filled += hole.fill(frame, &extent);
        }
    }
    filled
}

/// From where to where rows and columns are covered.
struct Extent {
    /// The first covered pixel and the one behind the last; of one that isn't covered nothing is between.
    rows: Vec<[usize; 2]>,
    columns: Vec<[usize; 2]>,
}

impl Extent {
    fn of(frame: &Frame) -> Self {
        let nothing = [usize::MAX, 0];
        let mut extent = Self { rows: vec![nothing; frame.height], columns: vec![nothing; frame.width] };
        for (at, _) in frame.color.iter().enumerate().filter(|(_, pixel)| pixel[3] >= COVERED) {
            let (x, y) = (at % frame.width, at / frame.width);
            for ([first, end], place) in [(&mut extent.rows[y], x), (&mut extent.columns[x], y)] {
                (*first, *end) = ((*first).min(place), (*end).max(place + 1));
            }
        }
        extent
    }

    /// Whether something is covered on both sides of a pixel.
    fn surrounds(&self, [x, y]: [usize; 2]) -> bool {
        let is_between = |[first, end]: [usize; 2], place: usize| (first..end).contains(&place);
        is_between(self.rows[y], x) || is_between(self.columns[x], y)
    }
}

/// Connected pixels that show nothing, and the covered ones beside them.
struct Hole {
    pixels: Vec<usize>,
    border: Vec<usize>,
}

impl Hole {
    fn around(frame: &Frame, component: &mut [u32], (start, name): (usize, u32)) -> Self {
        let (mut pixels, mut border) = (vec![start], Vec::new());
        component[start] = name;
        let mut next = 0;
        while let Some(at) = pixels.get(next).copied() {
            next += 1;
            for beside in beside([frame.width, frame.height], at).into_iter().flatten() {
                if component[beside] == name {
                    continue;
                }
                let alpha = frame.color[beside][3];
                // Half-covered pixels are gone through: their colours are right, and so are those behind them.
                let is_open = component[beside] == 0 && alpha < COVERED;
                component[beside] = if is_open || alpha >= COVERED { name } else { component[beside] };
                if is_open {
                    pixels.push(beside);
                } else if alpha >= COVERED {
                    border.push(beside);
                }
            }
        }
        Self { pixels, border }
    }

    fn fill(&self, frame: &mut Frame, extent: &Extent) -> usize {
        let size = [frame.width, frame.height];
        let far: Vec<usize> = self.border.iter().copied().filter(|at| !self.is_before(frame, *at)).collect();
        let place = |at: &usize| DVec2::new((at % size[0]) as f64, (at / size[0]) as f64);
        let Ok(scattered) = Scattered::new(far.iter().map(place)) else { return 0 };
        let is_inside = |at: &&usize| extent.surrounds([*at % size[0], *at / size[0]]);
        let pixels: Vec<usize> = self.pixels.iter().filter(is_inside).copied().collect();
        let places: Vec<DVec2> = pixels.iter().map(place).collect();
        let mean = |shares: &[(usize, f64)]| {
            let mean =
                |of: &dyn Fn(usize) -> f32| shares.iter().map(|(n, share)| *share as f32 * of(far[*n])).sum();
            let color: [f32; 3] = [0, 1, 2].map(|i| mean(&|at| frame.color[at][i] / frame.color[at][3]));
            let inverse: f32 = mean(&|at| 1.0 / frame.median_depth[at]);
            (color, 1.0 / inverse)
        };
        let between = scattered.at_each(&places, mean);
        let values = places.iter().zip(between).map(|(place, value)| {
            value.or_else(|| scattered.nearest(*place).map(|nearest| mean(&[(nearest, 1.0)])))
        });
        let values: Vec<_> = values.collect();
        let mut filled = 0;
        for (at, value) in pixels.iter().zip(values) {
            let Some((color, depth)) = value else { continue };
            let pixel = &mut frame.color[*at];
            let through = 1.0 - pixel[3];
            for (sum, c) in pixel.iter_mut().zip([color[0], color[1], color[2], 1.0]) {
                *sum += through * c;
            }
            if through > 1.0 - HOLE {
                filled += 1;
                frame.depth[*at] = depth;
                frame.median_depth[*at] = depth;
                frame.expected_depth[*at] = depth;
            }
        }
        filled
    }

    /// Whether a pixel of the border is of something in front of what is on the other sides of the hole.
    fn is_before(&self, frame: &Frame, at: usize) -> bool {
        let (mut nearer, mut crossings) = (0, 0);
        let size = [frame.width as i64, frame.height as i64];
        let start = [at as i64 % size[0], at as i64 / size[0]];
        for [dx, dy] in [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]] {
            let inside = |[x, y]: [i64; 2]| {
                ((0..size[0]).contains(&x) && (0..size[1]).contains(&y)).then(|| (y * size[0] + x) as usize)
            };
            let mut place = [start[0] + dx, start[1] + dy];
            let is_hole = |at: usize| frame.color[at][3] < COVERED;
            if !inside(place).is_some_and(is_hole) {
                continue;
            }
            while inside(place).is_some_and(is_hole) {
                place = [place[0] + dx, place[1] + dy];
            }
            if let Some(across) = inside(place) {
                crossings += 1;
                nearer += usize::from(frame.median_depth[across] > (1.0 + STEP) * frame.median_depth[at]);
            }
        }
        2 * nearer > crossings
    }
}

/// Left, right, above, below.
fn beside([width, height]: [usize; 2], at: usize) -> [Option<usize>; 4] {
    let (column, row) = (at % width, at / width);
    [
        (column > 0).then(|| at - 1),
        (column + 1 < width).then(|| at + 1),
        (row > 0).then(|| at - width),
        (row + 1 < height).then(|| at + width),
    ]
}

impl RgbdImage {
    /// The same image with depths between its scattered ones, such as those of a laser scanner or of structure from motion: at each pixel without a
    /// depth the mean in 1/z over its natural neighbours, of those that are of the nearest one's surface. Outside their convex hull nothing is
    /// known.
    ///
    /// # Errors
    /// When the image is none or has no depth.
    pub fn densified(&self) -> Result<Self, DepthError> {
        self.check()?;
        let mut depths = self.depths_along_axis();
        let width = self.size[0];
        let place = |at: &usize| DVec2::new((at % width) as f64, (at / width) as f64);
        let (known, unknown): (Vec<usize>, Vec<usize>) = (0..depths.len()).partition(|at| depths[*at] > 0.0);
        if known.is_empty() {
            return Err(DepthError::NoDepth);
        }
        // Whole numbers of at most 65535 can be inserted.
        let Ok(scattered) = Scattered::new(known.iter().map(place)) else { return Err(DepthError::NoDepth) };
        let steps = Steps::of(self);
        let queries: Vec<DVec2> = unknown.iter().map(place).collect();
        let values = scattered.at_each(&queries, |shares| {
            let (nearest, _) =
                shares.iter().fold((0, 0.0), |most, one| if one.1 > most.1 { *one } else { most });
            let own = (depths[known[nearest]], place(&known[nearest]));
            let (mut sum, mut total) = (0.0, 0.0);
            for (number, share) in shares {
                let other = (depths[known[*number]], place(&known[*number]));
                if steps.may_go_on([own.0, other.0], (own.1 - other.1).length() as f32) {
                    sum += share / f64::from(other.0);
                    total += share;
                }
            }
            (total / sum) as f32
        });
        for (at, value) in unknown.iter().zip(values) {
            depths[*at] = value.unwrap_or(0.0);
        }
        Ok(Self { depths, kind: super::DepthKind::AlongAxis, ..self.clone() })
    }
}
