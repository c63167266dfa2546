//! What the rasterizer and the references can draw: checked once, by one rule, before either begins.

use crate::scene::{Light, Order, RenderSettings, Scene};
use glam::DVec3;
use thiserror::Error;

/// Why a scene cannot be drawn.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SceneError {
    /// A setting is outside its range.
    #[error("{what} is {value}; {expected}")]
    Setting {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// A light is not finite or points nowhere.
    #[error("light {index} is {light:?}; its numbers must be finite and its direction not zero")]
    Light {
        /// Its number in the scene.
        index: usize,
        /// The light.
        light: Light,
    },
    /// A cloud's transform is not finite.
    #[error("the transform of cloud {cloud} is not finite")]
    Transform {
        /// Its number in the scene.
        cloud: usize,
    },
    /// Sheets were asked for where there is no grid.
    #[error(
        "there are no sheets: the first cloud of kernels is empty, or its kernels don't share one shape as a grid's do"
    )]
    NoGrid,
    /// More clouds or splats than ids can name.
    #[error("the scene has {clouds} clouds with {splats} splats; at most 65535 and 4294967294 can be named")]
    Count {
        /// Clouds in the scene.
        clouds: usize,
        /// Splats in all of them.
        splats: usize,
    },
}

/// Passes where `ok`.
pub(crate) fn check(
    what: &'static str,
    value: f64,
    ok: bool,
    expected: &'static str,
) -> Result<(), SceneError> {
    if ok { Ok(()) } else { Err(SceneError::Setting { what, value, expected }) }
}

impl RenderSettings {
    /// Checks every number.
    ///
    /// # Errors
    /// When one is outside its documented range.
    pub fn validate(&self) -> Result<(), SceneError> {
        let Self { low_pass, tolerance, cutoff, end_share, outline, level_of_detail, .. } = *self;
        check(
            "low-pass variance",
            low_pass,
            (0.0..=1e6).contains(&low_pass),
            "it must be from 0 to 1e6 px²",
        )?;
        check("tolerance", tolerance, (0.0..=1.0).contains(&tolerance), "it must be from 0 to 1")?;
        check("end share", end_share, (0.0..=1.0).contains(&end_share), "it must be from 0 to 1")?;
        check(
            "width of filters for levels of detail",
            level_of_detail,
            (0.0..=1e6).contains(&level_of_detail),
            "it must be from 0 to 1e6 times what it is",
        )?;
        for (what, radius) in [("cut-off", cutoff), ("outline of surfels", outline)] {
            check(what, radius, (1.0..=100.0).contains(&radius), "it must be from 1 to 100")?;
        }
        let length = match self.order {
            Order::Slabs { thickness } => Some(("thickness of slabs", thickness)),
            Order::Shells { thickness } => Some(("thickness of shells", thickness)),
            Order::AxisSheets { spacing } => Some(("spacing of sheets", spacing)),
            Order::Auto | Order::Centers | Order::PerPixel => None,
        };
        if let Some((what, length)) = length {
            check(what, length, (1e-3..=1e6).contains(&length), "it must be from 0.001 to 1e6")?;
        }
        let [red, green, blue, alpha] = self.background.map(f64::from);
        for channel in [red, green, blue] {
            check("background", channel, channel.is_finite(), "it must be finite")?;
        }
        check("background's alpha", alpha, (0.0..=1.0).contains(&alpha), "it must be from 0 to 1")
    }
}

impl Scene {
    /// The number of splats; checks the lights and the places of the clouds.
    ///
    /// # Errors
    /// When a light or a transform is not finite, a light points nowhere, or ids cannot name all splats.
    pub fn validate(&self) -> Result<usize, SceneError> {
        for (index, light) in self.lights.iter().enumerate() {
            let (place, color) = match *light {
                Light::Ambient { color } => (DVec3::ONE, color),
                Light::Directional { towards, color } => (towards.normalize_or_zero(), color),
                Light::Point { position, color } => (position, color),
            };
            let points_nowhere = matches!(light, Light::Directional { .. }) && place == DVec3::ZERO;
            if !place.is_finite() || points_nowhere || color.iter().any(|c| !c.is_finite()) {
                return Err(SceneError::Light { index, light: *light });
            }
        }
        if let Some(cloud) = self.clouds.iter().position(|cloud| !cloud.cloud_to_world().is_finite()) {
            return Err(SceneError::Transform { cloud });
        }
        let (clouds, splats) = (self.clouds.len(), self.clouds.iter().map(|cloud| cloud.len()).sum());
        if clouds > usize::from(u16::MAX) || splats >= u32::MAX as usize {
            return Err(SceneError::Count { clouds, splats });
        }
        Ok(splats)
    }
}
