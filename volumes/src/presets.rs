//! Transfer functions by name, fitted to a volume.

use crate::histogram::{Histogram, fitting_histogram};
use crate::transfer::{ColorSpace, ControlPoint, StrengthKind, TransferError, TransferFunction};
use crate::volume::Volume;

/// Optical depth of what a preset shows, along a ray through all of it drawn together into a block: 5 % of
/// the light comes through, so front and back both show.
const OPTICAL_DEPTH: f64 = 3.0;
/// The share of what is shown that may lie above the preset's last stop.
const TOP: f64 = 0.999;

/// Place along the shown values from 0 to 1; red, green, blue in sRGB; extinction relative to the others'.
type Stop = (f32, [f32; 3], f32);

/// A transfer function's looks; [`Preset::fit`] gives it a volume's values and lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// What it is called at the command line.
    pub name: &'static str,
    /// What it looks like, in a few words.
    pub description: &'static str,
    stops: &'static [Stop],
}

/// The presets; the first is the default.
pub const PRESETS: [Preset; 5] = [
    Preset {
        name: "amber",
        description: "pale blue haze, amber bodies, glowing cores",
        stops: &[
            (0.0, [0.42, 0.48, 0.60], 0.0),
            (0.2, [0.50, 0.52, 0.58], 0.08),
            (0.45, [0.72, 0.60, 0.44], 0.25),
            (0.7, [0.93, 0.85, 0.72], 0.5),
            (0.85, [0.96, 0.48, 0.20], 0.9),
            (1.0, [1.00, 0.42, 0.14], 1.0),
        ],
    },
    Preset {
        name: "grey",
        description: "dark to white, as the values are",
        stops: &[(0.0, [0.10, 0.10, 0.10], 0.0), (1.0, [1.00, 1.00, 1.00], 1.0)],
    },
    Preset {
        name: "bone",
        description: "ivory where values are high, faint flesh below: for CT",
        stops: &[
            (0.0, [0.70, 0.36, 0.28], 0.0),
            (0.2, [0.80, 0.50, 0.38], 0.05),
            (0.4, [0.86, 0.62, 0.48], 0.07),
            (0.5, [0.93, 0.84, 0.70], 0.45),
            (1.0, [1.00, 0.98, 0.92], 1.0),
        ],
    },
    Preset {
        name: "fire",
        description: "dark red over orange to white",
        stops: &[
            (0.0, [0.25, 0.02, 0.05], 0.0),
            (0.35, [0.75, 0.12, 0.05], 0.2),
            (0.7, [1.00, 0.58, 0.10], 0.5),
            (1.0, [1.00, 0.96, 0.75], 1.0),
        ],
    },
    Preset {
        name: "cool",
        description: "deep blue over turquoise to white",
        stops: &[
            (0.0, [0.08, 0.12, 0.40], 0.0),
            (0.35, [0.10, 0.38, 0.65], 0.2),
            (0.7, [0.25, 0.75, 0.72], 0.5),
            (1.0, [0.95, 1.00, 0.95], 1.0),
        ],
    },
];

/// The preset called `name`.
pub fn preset(name: &str) -> Option<&'static Preset> {
    PRESETS.iter().find(|preset| preset.name == name)
}

impl Preset {
    /// The transfer function of this preset for `volume`.
    ///
    /// The background is the lower of the two classes of [`Histogram::classes`]; up to two standard deviations
    /// above its mean all is transparent. From there to the 99.9 % quantile of the rest the stops are spread.
    /// Extinction is scaled so that the shown samples, if they were drawn together into one block, had an
    /// optical depth of 3 along a ray through it: sparse volumes get strong samples, full ones faint samples.
    ///
    /// # Errors
    /// When the volume is so small or large that its extinctions are no finite f32.
    pub fn fit(&self, volume: &Volume) -> Result<TransferFunction, TransferError> {
        let place = |share: f32, [start, top]: [f32; 2]| {
            (f64::from(start) + f64::from(share) * (f64::from(top) - f64::from(start))) as f32
        };
        let histogram = fitting_histogram(volume);
        let shown = histogram.as_ref().map_or([0.0, 1.0], shown_range);
        let relative = self.function(1.0, |share| place(share, shown))?;
        let (mut count, mut sum) = (0.0, 0.0);
        for (bin, &n) in histogram.iter().flat_map(|h| h.counts().iter().enumerate()) {
            let value = histogram.as_ref().map_or(0.0, |h| h.center(bin));
            if value > shown[0] {
                count += n as f64;
                sum += n as f64 * f64::from(relative.at(value).extinction);
            }
        }
        let block = (count * volume.voxel_volume()).cbrt();
        let scale = if sum > 0.0 { OPTICAL_DEPTH * count / (sum * block) } else { 1.0 };
        self.function(scale, |share| place(share, shown))
    }

    fn function(&self, scale: f64, value: impl Fn(f32) -> f32) -> Result<TransferFunction, TransferError> {
        let point = |&(share, color, relative): &Stop| ControlPoint {
            value: value(share),
            color,
            strength: (f64::from(relative) * scale) as f32,
        };
        let mut points: Vec<ControlPoint> = self.stops.iter().map(point).collect();
        // Where f32 cannot tell the values of two stops apart, the upper counts.
        points.reverse();
        points.dedup_by_key(|point| point.value);
        points.reverse();
        TransferFunction::new(points, StrengthKind::Extinction, ColorSpace::Srgb)
    }
}

/// The values that a preset spreads over: from the end of the background to the top.
fn shown_range(histogram: &Histogram) -> [f32; 2] {
    let [low, high] = histogram.range();
    // One value only: that is what there is to show.
    let start = histogram.classes().map_or(low.next_down(), |classes| {
        (classes.low_mean + 2.0 * classes.low_deviation).clamp(low, classes.threshold)
    });
    let top = histogram.quantile_above(start, TOP);
    if top > start { [start, top] } else { [start, high.max(start.next_up())] }
}
