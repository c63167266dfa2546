//! Ways of drawing beside the one that is right, in windows.

use super::windows::OTHERS;
use crate::camera::Camera;
use crate::color::linear_to_srgb;
use crate::frame::Channels;
use crate::observer::{Counts, Observer};
use crate::render::Renderer;
use crate::scene::{Blend, Order, RenderSettings, Scene};
use crate::validate::SceneError;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, OnceLock, PoisonError};

/// The share of the pixels that must keep to the limit for other windows to be asked: few windows can't tell how many of the others don't.
const RARE: f64 = 0.99;

/// The share of the tolerance that no pixel of the first windows may be off by more than where more than one in a thousand is off by too much,
/// whatever others show.
const MOST_OF_FIRST: f64 = 2.0;

/// The share that 99.9 % of the pixels of all windows must keep to, whatever is tried: the first see too few of the largest errors, which
/// lie together.
pub(super) const MOST_OF_ALL: f64 = 0.8;

/// Work, in about nanoseconds, that drawing the first windows in the finest way may take; where each takes more than its share, there are fewer.
const MOST_WORK: u64 = 300_000_000;

/// Of a splat, as of one around the eye, and of one of its pixels, as in several slabs.
const WORK_OF_SPLAT: u64 = 256;
const WORK_OF_FRAGMENT: u64 = 4;

/// Windows that tell how many there should be, and that are looked at in any case.
const LEAST_WINDOWS: usize = 8;

/// A pixel in the space of blending.
pub(super) type Pixel = [f32; 4];

/// Windows of a scene, drawn as is right.
pub(super) struct Trial<'a> {
    scene: &'a Scene,
    /// The first, and the others, which are asked before anything is taken.
    windows: [&'a [Camera]; 2],
    right: RenderSettings,
    truth: Vec<Pixel>,
    /// The other windows, drawn as is right: a third of them each.
    more_truth: [OnceLock<Vec<Pixel>>; OTHERS as usize],
    /// Where nothing is seen.
    empty: Pixel,
    /// Those that draw none at the moment.
    renderers: Mutex<Vec<Renderer>>,
    work: Work,
}

/// What was drawn so far, counted and not timed.
#[derive(Default)]
struct Work(AtomicU64);

impl Observer for Work {
    fn counts(&self, counts: Counts) {
        self.0.fetch_add(WORK_OF_SPLAT * counts.visible + WORK_OF_FRAGMENT * counts.fragments, Relaxed);
    }
}

impl<'a> Trial<'a> {
    /// Windows of which any first few are spread over the picture.
    pub(super) fn new(
        scene: &'a Scene,
        windows: [&'a [Camera]; 2],
        right: RenderSettings,
    ) -> Result<Self, SceneError> {
        let (truth, more_truth, renderers, work) = Default::default();
        let mut trial = Self { scene, windows, right, truth, more_truth, empty: [0.0; 4], renderers, work };
        // Nothing has no order; some orders need a grid.
        let of_nothing = RenderSettings { order: Order::Auto, ..right };
        let [first, others] = windows;
        trial.empty = trial.drawn(&Scene::default(), &first[..1], &of_nothing)?[0];
        let least = LEAST_WINDOWS.min(first.len());
        *trial.work.0.get_mut() = 0;
        trial.truth = trial.drawn(scene, &first[..least], &right)?;
        let own = *trial.work.0.get_mut() / least as u64;
        let affordable = (MOST_WORK / own.max(1)).clamp(least as u64, first.len() as u64) as usize;
        trial.windows = [&first[..affordable], &others[..others.len() * affordable / first.len()]];
        trial.truth.extend(trial.drawn(scene, &first[least..affordable], &right)?);
        Ok(trial)
    }

    /// How many pixels of the first windows show anything.
    pub(super) fn shown(&self) -> usize {
        self.truth.iter().filter(|pixel| **pixel != self.empty).count()
    }

    /// The pixels of the first windows drawn with settings.
    pub(super) fn first(&self, settings: &RenderSettings) -> Result<Vec<Pixel>, SceneError> {
        self.drawn(self.scene, self.windows[0], settings)
    }

    /// What a share `rank` of the pixels that show anything differ by at most.
    pub(super) fn difference(&self, rank: f64, [truth, found]: [&[Pixel]; 2]) -> f64 {
        keep_to(&mut self.errors(truth, found), rank)
    }

    /// Whether all pixels of the first windows are off by at most a share of the tolerance, and 99.9 % of those of all windows by at most
    /// [`MOST_OF_ALL`]; or, where at most one in a thousand of the first is off by more, or a few are, but by no more than [`MOST_OF_FIRST`],
    /// 99.9 % of all by at most the share: of all windows together a thousand pixels must then show something.
    pub(super) fn is_within(&self, share: f64, settings: &RenderSettings) -> Result<bool, SceneError> {
        self.are_within(share, settings, &self.first(settings)?)
    }

    /// As [`Self::is_within`], where the first windows are drawn already.
    pub(super) fn are_within(
        &self,
        share: f64,
        settings: &RenderSettings,
        first: &[Pixel],
    ) -> Result<bool, SceneError> {
        let [limit, of_first, of_all] =
            [share, MOST_OF_FIRST, MOST_OF_ALL].map(|share| share * settings.tolerance);
        let mut errors = self.errors(&self.truth, first);
        let largest = keep_to(&mut errors, 1.0);
        let limit = if largest <= limit {
            of_all
        } else {
            // Of fewer than a thousand pixels in all windows, of which the others are expected to show as much, the largest error counts.
            let are_enough = (1 + OTHERS as usize) * errors.len() >= 1000;
            let are_few = keep_to(&mut errors, RARE) <= limit && largest <= of_first;
            if !are_enough || keep_to(&mut errors, 0.999) > limit && !are_few {
                return Ok(false);
            }
            limit
        };
        let pixels: u32 =
            self.windows.into_iter().flatten().map(|window| window.size().iter().product::<u32>()).sum();
        // As many as may be off if every pixel shows something: once more are, the answer is no.
        let most_off = pixels as usize - rank(pixels as usize, 0.999);
        let more = self.windows[1];
        let part = more.len().div_ceil(self.more_truth.len()).max(1);
        for (windows, truth) in more.chunks(part).zip(&self.more_truth) {
            if errors.iter().filter(|error| f64::from(**error) > limit).count() > most_off {
                return Ok(false);
            }
            let truth = match truth.get() {
                Some(truth) => truth,
                None => {
                    let drawn = self.drawn(self.scene, windows, &self.right)?;
                    truth.get_or_init(|| drawn)
                }
            };
            errors.extend(self.errors(truth, &self.drawn(self.scene, windows, settings)?));
        }
        Ok(keep_to(&mut errors, 0.999) <= limit)
    }

    /// The largest error of a channel in each pixel that shows anything.
    fn errors(&self, truth: &[Pixel], found: &[Pixel]) -> Vec<f32> {
        let shown = truth.iter().zip(found).filter(|(a, b)| **a != self.empty || **b != self.empty);
        let largest = |(a, b): (&Pixel, &Pixel)| (0..4).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
        shown.map(largest).collect()
    }

    /// The pixels of windows.
    fn drawn(
        &self,
        scene: &Scene,
        windows: &[Camera],
        settings: &RenderSettings,
    ) -> Result<Vec<Pixel>, SceneError> {
        let settings = RenderSettings {
            channels: Channels::Color,
            // Windows are too small for it, and it keeps to a share of its own.
            interpolation: false,
            // A share of the whole picture's would mean nothing here.
            budget: None,
            // Nor would what is off in a picture of forms say anything of the scene's.
            color_by_form: false,
            ..*settings
        };
        let idle = || self.renderers.lock().unwrap_or_else(PoisonError::into_inner);
        let window = |camera: &Camera| {
            // A thread that waits for others may begin another window before this one is done.
            let mut renderer = idle().pop().unwrap_or_default();
            let color = renderer.render(scene, camera, &settings, &self.work)?.color.clone();
            idle().push(renderer);
            Ok(color)
        };
        let frames: Vec<Vec<Pixel>> = windows.par_iter().map(window).collect::<Result<_, SceneError>>()?;
        let encode = |[r, g, b, a]: Pixel| {
            if settings.blend == Blend::Linear || a <= 0.0 {
                return [r, g, b, a];
            }
            let [r, g, b] = [r, g, b].map(|c| a * linear_to_srgb(c / a));
            [r, g, b, a]
        };
        Ok(frames.into_iter().flatten().map(encode).collect())
    }
}

/// What a share of errors keep to.
fn keep_to(errors: &mut [f32], share: f64) -> f64 {
    errors.sort_by(f32::total_cmp);
    let last = rank(errors.len(), share).checked_sub(1);
    last.map_or(0.0, |last| f64::from(errors[last]))
}

/// How many of so many are a share, rounded up.
fn rank(count: usize, share: f64) -> usize {
    (count as f64 * share).ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::super::windows::windows;
    use super::*;
    use crate::camera::Pose;
    use crate::cloud::{Cloud, Material, OpacityFilter, Shapes, Splats, Strength};
    use crate::view::SceneView;
    use glam::{DVec3, Mat3, Vec3};

    /// Of splats around the eye every window shows all.
    #[test]
    fn there_are_fewer_windows_where_each_shows_much() {
        let pose = Pose::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let camera = Camera::perspective(pose, 1.0, [480; 2]).unwrap();
        let settings = RenderSettings { order: Order::Centers, ..RenderSettings::default() };
        let of = |count: usize| {
            let centers = (0..count).map(|i| Vec3::splat(1e-3) * (i as f32).sin()).collect();
            let strength =
                Strength::Opacity { peaks: vec![0.5; count], filter: OpacityFilter::Classic, least: 0.0 };
            let (shapes, colors) = (Shapes::Shared(Mat3::IDENTITY), vec![[0.5; 3]; count]);
            let (harmonics, normals, material) = (None, None, Material::UNLIT);
            let splats = Splats { centers, shapes, strength, colors, harmonics, normals, material };
            Scene { clouds: vec![Cloud::new(splats).unwrap()], lights: Vec::new() }
        };
        let counts = [1000, 30_000].map(|count| {
            let scene = of(count);
            let view = SceneView { scene: &scene, camera: &camera, settings: &settings };
            let [first, others] = windows(view).unwrap();
            assert_eq!([first.len(), others.len()], [64, 192]);
            let trial = Trial::new(&scene, [&first, &others], settings).unwrap();
            let [first, others] = trial.windows;
            assert_eq!([trial.truth.len(), others.len()], [36 * first.len(), 3 * first.len()]);
            assert_eq!(trial.truth, trial.first(&settings).unwrap());
            first.len()
        });
        assert!(counts[0] == 64 && (8..=300_000_000 / (256 * 30_000)).contains(&counts[1]), "{counts:?}");
    }
}
