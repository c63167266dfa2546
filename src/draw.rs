//! A scene to a frame, once or many times.

use crate::description::{PictureOptions, Reference, Show};
use crate::notation::Rgba;
use crate::progress::Console;
use crate::stats::{FrameTimes, StageClock, timed};
use anyhow::{Result, ensure};
use oblate::chart::methods::way;
use oblate::engine::reference::{ReferenceKind, reference};
use oblate::engine::{
    Blend, Camera, Channels, FootprintForm, Frame, RenderSettings, Renderer, Scene, settle,
};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Pixels along a side where nothing is said.
const SIDE: u32 = 1024;
const BACKGROUND: [u8; 4] = [0x20, 0x20, 0x20, 0xff];
const SAMPLES: u32 = 64;

/// How a frame is drawn, every choice made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Drawing {
    pub(crate) size: [u32; 2],
    pub(crate) settings: RenderSettings,
    pub(crate) reference: Option<ReferenceKind>,
    /// How many pictures are measured, after one that warms up; `None` draws one and measures nothing.
    pub(crate) measured: Option<usize>,
}

impl Drawing {
    /// The options, which were checked, with their defaults, for a frame with these channels.
    pub(crate) fn new(options: &PictureOptions, channels: Channels) -> Result<Self> {
        let defaults = RenderSettings::default();
        let low_pass = options.low_pass.unwrap_or(defaults.low_pass);
        let choice = options.reference.unwrap_or_default();
        ensure!(options.samples.is_none() || choice == Reference::R2, "--samples is for --reference r2");
        ensure!(options.thickness_has_use(), "--slab-thickness is for --order slabs");
        ensure!(options.budget_has_use(), "--budget is kept by --level-of-detail on");
        for (what, is_asked) in
            [("--budget", options.budget.is_some()), ("--show forms", options.show == Some(Show::Forms))]
        {
            ensure!(
                !is_asked || choice == Reference::Off,
                "{what} is not for a reference, which draws every splat as it is"
            );
        }
        let samples = options.samples.unwrap_or(SAMPLES);
        Ok(Self {
            size: options.size.unwrap_or([SIDE; 2]),
            settings: RenderSettings {
                footprint: options.footprint.map_or(FootprintForm::default(), Into::into),
                low_pass,
                blend: options.blend.map_or(Blend::default(), Into::into),
                order: options.order(),
                shade: options.shade.unwrap_or(true),
                background: options.background.unwrap_or(Rgba::from_bytes(BACKGROUND)).0,
                tolerance: options.tolerance.map_or(defaults.tolerance, |tolerance| tolerance.0),
                level_of_detail: if options.level_of_detail == Some(false) {
                    0.0
                } else {
                    defaults.level_of_detail
                },
                budget: options.budget,
                occlusion: options.occlusion.unwrap_or(defaults.occlusion),
                interpolation: options.interpolation.unwrap_or(defaults.interpolation),
                color_by_form: options.show == Some(Show::Forms),
                channels,
                ..defaults
            },
            reference: match choice {
                Reference::Off => None,
                Reference::R1 => Some(ReferenceKind::R1),
                Reference::R2 => Some(ReferenceKind::R2 { samples }),
            },
            measured: None,
        })
    }

    /// How often the picture is drawn.
    pub(crate) fn pictures(&self) -> usize {
        1 + self.measured.unwrap_or(0)
    }

    /// Settles what is left to the engine; says how and how long that took. A reference has nothing to settle.
    pub(crate) fn settle(
        &mut self,
        scene: &Scene,
        camera: &Camera,
        console: Console,
    ) -> Result<Option<(String, Duration)>> {
        if self.reference.is_some() {
            return Ok(None);
        }
        let _task = console.task("trying ways to draw");
        let (settings, time) = timed(|| Ok(settle(scene, camera, &self.settings)?))?;
        self.settings = settings;
        Ok(Some((way(&settings), time)))
    }

    /// Draws a frame, as often as it is asked for; gives the last, and the times of those that are measured.
    pub(crate) fn draw(
        &self,
        scene: &Scene,
        camera: &Camera,
        console: Console,
    ) -> Result<(Frame, Vec<FrameTimes>)> {
        let _task = self.reference.is_none().then(|| console.task("drawing"));
        let mut renderer = Renderer::new();
        let mut frame = None;
        let mut times = Vec::new();
        for _ in 0..self.pictures() {
            let clock = StageClock::default();
            let begun = Instant::now();
            match self.reference {
                None => drop(renderer.render(scene, camera, &self.settings, &clock)?),
                Some(kind) => frame = Some(self.draw_reference(scene, camera, kind, console)?),
            }
            times.push(clock.finish(begun.elapsed(), rayon::current_num_threads()));
        }
        let first = usize::from(self.measured.is_some());
        Ok((frame.unwrap_or_else(|| renderer.into_frame()), times.split_off(first)))
    }

    fn draw_reference(
        &self,
        scene: &Scene,
        camera: &Camera,
        kind: ReferenceKind,
        console: Console,
    ) -> Result<Frame> {
        let task = console.task("drawing");
        let most = AtomicU64::new(0);
        let progress = |rows: usize| {
            let rows = most.fetch_max(rows as u64, Ordering::Relaxed).max(rows as u64);
            task.at(rows, u64::from(self.size[1]));
        };
        Ok(reference(scene, camera, &self.settings, kind, &progress)?)
    }
}
