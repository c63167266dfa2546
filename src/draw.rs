//! A scene to a frame, once or many times.

use crate::description::{PictureOptions, Reference};
use crate::notation::Rgba;
use crate::progress::Console;
use crate::stats::{FrameTimes, StageClock};
use anyhow::{Result, ensure};
use oblate::engine::reference::{ReferenceKind, reference};
use oblate::engine::{Blend, Camera, FootprintForm, Frame, RenderSettings, Scene, render};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

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
}

impl Drawing {
    /// The options, which were checked, with their defaults.
    pub(crate) fn new(options: &PictureOptions) -> Result<Self> {
        let defaults = RenderSettings::default();
        let low_pass = options.low_pass.unwrap_or(defaults.low_pass);
        let choice = options.reference.unwrap_or_default();
        ensure!(options.samples.is_none() || choice == Reference::R2, "--samples is for --reference r2");
        let samples = options.samples.unwrap_or(SAMPLES);
        Ok(Self {
            size: options.size.unwrap_or([SIDE; 2]),
            settings: RenderSettings {
                footprint: options.footprint.map_or(FootprintForm::default(), Into::into),
                low_pass,
                blend: options.blend.map_or(Blend::default(), Into::into),
                shade: options.shade.unwrap_or(true),
                background: options.background.unwrap_or(Rgba::from_bytes(BACKGROUND)).0,
                ..defaults
            },
            reference: match choice {
                Reference::Off => None,
                Reference::R1 => Some(ReferenceKind::R1),
                Reference::R2 => Some(ReferenceKind::R2 { samples }),
            },
        })
    }

    /// Draws a frame and measures it.
    pub(crate) fn draw(
        &self,
        scene: &Scene,
        camera: &Camera,
        console: Console,
    ) -> Result<(Frame, FrameTimes)> {
        let clock = StageClock::default();
        let task = console.task("drawing");
        let begun = Instant::now();
        let frame = match self.reference {
            None => render(scene, camera, &self.settings, &clock)?,
            Some(kind) => {
                let most = AtomicU64::new(0);
                let progress = |rows: usize| {
                    let rows = most.fetch_max(rows as u64, Ordering::Relaxed).max(rows as u64);
                    task.at(rows, u64::from(self.size[1]));
                };
                reference(scene, camera, &self.settings, kind, &progress)?
            }
        };
        let times = clock.finish(begun.elapsed(), rayon::current_num_threads());
        Ok((frame, times))
    }
}

/// Draws `repeats` frames (at least 1) after one that warms up; gives the last, and the times of all but the
/// first.
pub(crate) fn draw_repeatedly(
    drawing: &Drawing,
    scene: &Scene,
    camera: &Camera,
    repeats: usize,
    console: Console,
) -> Result<(Frame, Vec<FrameTimes>)> {
    let (mut frame, _) = drawing.draw(scene, camera, console)?;
    let mut times = Vec::new();
    for _ in 0..repeats {
        let (next, time) = drawing.draw(scene, camera, console)?;
        frame = next;
        times.push(time);
    }
    Ok((frame, times))
}
