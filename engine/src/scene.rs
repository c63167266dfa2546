//! What is drawn, under which light, and how.

use crate::cloud::Cloud;
use crate::frame::Channels;
use glam::DVec3;

/// Clouds and lights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The clouds; all mix in one picture.
    pub clouds: Vec<Cloud>,
    /// The lights. Without any, white ambient light and a white headlight along the view axis shine.
    pub lights: Vec<Light>,
}

/// A light; colours are linear Rec. 709 times intensity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// The same from everywhere.
    Ambient {
        /// Its colour.
        color: [f32; 3],
    },
    /// Parallel light.
    Directional {
        /// Towards the light in the world, any length above 0.
        towards: DVec3,
        /// Its colour.
        color: [f32; 3],
    },
    /// A point that shines without falling off.
    Point {
        /// Where it is in the world.
        position: DVec3,
        /// Its colour.
        color: [f32; 3],
    },
}

/// Which form of the footprint is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FootprintForm {
    /// For each splat the cheaper form whose error stays within its share of the tolerance.
    #[default]
    Auto,
    /// Zwicker, Pfister, van Baar, Gross, *EWA Volume Splatting*, 2001: the perspective denominator dropped.
    Affine,
    /// Exact perspective.
    Exact,
}

/// The space that colours are shaded and blended in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Blend {
    /// Linear light.
    #[default]
    Linear,
    /// Display-encoded sRGB, as volume renderers and trained scenes do it.
    Display,
}

/// How a scene is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderSettings {
    /// The form of the footprint.
    pub footprint: FootprintForm,
    /// Variance of the low-pass filter in squared pixels, at least 0.
    pub low_pass: f64,
    /// The space of shading and blending.
    pub blend: Blend,
    /// Whether light acts; without it colours are shown as they are.
    pub shade: bool,
    /// Behind everything: linear Rec. 709, not premultiplied, and alpha.
    pub background: [f32; 4],
    /// The largest error of a channel that is aimed at; shared out between the stages.
    pub tolerance: f64,
    /// Squared Mahalanobis radius at which kernels are cut off; their mass is renormalised.
    pub cutoff: f64,
    /// What the frame holds.
    pub channels: Channels,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            footprint: FootprintForm::Auto,
            low_pass: 0.3,
            blend: Blend::Linear,
            shade: true,
            background: [0.0; 4],
            tolerance: 1.0 / 255.0,
            cutoff: 12.25,
            channels: Channels::All,
        }
    }
}
