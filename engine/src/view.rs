//! What is drawn, from where and how.

use crate::camera::Camera;
use crate::footprint::Lens;
use crate::scene::{RenderSettings, Scene};

/// A scene as a camera sees it, drawn as settings say.
#[derive(Clone, Copy)]
pub(crate) struct SceneView<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) camera: &'a Camera,
    pub(crate) settings: &'a RenderSettings,
}

impl SceneView<'_> {
    /// The camera with the pixels' filter.
    pub(crate) fn lens(&self) -> Lens {
        Lens::new(self.camera, self.settings.low_pass)
    }
}
