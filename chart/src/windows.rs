//! The parts of a picture that references draw.

use glam::{DVec2, UVec2};
use oblate_engine::Camera;

/// A part of a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    pub(crate) low: UVec2,
    pub(crate) size: UVec2,
}

/// Parts of a picture beside and below each other.
pub(crate) struct Windows {
    /// By rows; all of one size.
    pub(crate) parts: Vec<Window>,
    /// How many are in a row, and how many rows there are.
    count: UVec2,
}

/// Windows along a side of a picture.
const ALONG: u32 = 4;

impl Windows {
    /// Sixteen squares, together `side` pixels high, each in a random place of its share of the picture: figures are to tell of all of it.
    pub(crate) fn spread(camera: &Camera, side: u32) -> Self {
        let whole = UVec2::from(camera.size());
        let size = UVec2::splat(side / ALONG).min(whole);
        let part = |number: u32| {
            let place = UVec2::new(number % ALONG, number / ALONG);
            // Weyl's sequence: even, and in step with nothing in the picture.
            let step = f64::from(place.x * ALONG + place.y) * DVec2::new(0.754_877_67, 0.569_840_29);
            let share = (place.as_dvec2() + step.fract()) / f64::from(ALONG);
            Window { low: ((whole - size).as_dvec2() * share).as_uvec2(), size }
        };
        Self { parts: (0..ALONG * ALONG).map(part).collect(), count: UVec2::splat(ALONG) }
    }

    pub(crate) fn whole(camera: &Camera) -> Self {
        Self { parts: vec![Window { low: UVec2::ZERO, size: camera.size().into() }], count: UVec2::ONE }
    }

    /// Pixels in a row and rows of all together.
    pub(crate) fn size(&self) -> [usize; 2] {
        (self.parts[0].size * self.count).to_array().map(|side| side as usize)
    }

    /// The parts of a picture that they show.
    pub(crate) fn cut<T: Copy>(&self, whole: &[T], width: usize) -> Vec<T> {
        self.joined(|number, [x, y]| {
            let [left, top] = self.parts[number].low.to_array().map(|v| v as usize);
            whole[(top + y) * width + left + x]
        })
    }

    /// What one of them shows, out of the picture of all.
    pub(crate) fn part<T: Copy>(&self, joined: &[T], number: usize) -> Vec<T> {
        let [across, _] = self.count.to_array().map(|count| count as usize);
        let [w, h] = self.parts[0].size.to_array().map(|side| side as usize);
        let first = number / across * h * across * w + number % across * w;
        (0..h).flat_map(|row| joined[first + row * across * w..][..w].iter().copied()).collect()
    }

    /// A picture of what each of them shows at a column and a row of its own.
    pub(crate) fn joined<T>(&self, pixel: impl Fn(usize, [usize; 2]) -> T) -> Vec<T> {
        let [across, _] = self.count.to_array().map(|count| count as usize);
        let own = self.parts[0].size.to_array().map(|side| side as usize);
        let [width, height] = self.size();
        let at = |place: usize| {
            let [x, y] = [place % width, place / width];
            pixel(y / own[1] * across + x / own[0], [x % own[0], y % own[1]])
        };
        (0..width * height).map(at).collect()
    }
}

impl Window {
    /// Draws a line around it, white and black by turns, where the picture has room for one.
    pub(crate) fn frame(&self, values: &mut [[f32; 3]], size: [usize; 2]) {
        let [low, high] = [self.low.as_ivec2() - 1, (self.low + self.size).as_ivec2()];
        let lines = (low.x..=high.x).flat_map(|x| [[x, low.y], [x, high.y]]);
        let columns = (low.y..=high.y).flat_map(|y| [[low.x, y], [high.x, y]]);
        for [x, y] in lines.chain(columns) {
            let [Ok(column), Ok(row)] = [x, y].map(usize::try_from) else { continue };
            if column < size[0] && row < size[1] {
                let is_white = (x + y).rem_euclid(8) < 4;
                values[row * size[0] + column] = [if is_white { 1.0 } else { 0.0 }; 3];
            }
        }
    }
}
