//! What others do with depth images, to compare with.
//!
//! All take an image and the new view, a pinhole camera, and give a picture whose pixels are opaque where anything was written. None of them knows
//! how large a pixel is on the surface that it shows, but [`triangles`].

mod mesh;
mod points;
mod softmax;

pub use mesh::triangles;
pub use points::{mcmillan, nearest, supersampled};
pub use softmax::softmax;

use oblate_engine::{Camera, Frame};
use oblate_surfels::{DepthError, RgbdImage};

/// Where the pixels of an image are seen from elsewhere.
struct Seen<'a> {
    image: &'a RgbdImage,
    /// Depths along the axis; 0 where unknown.
    depths: Vec<f32>,
    to_view: glam::DAffine3,
    view: &'a Camera,
}

impl<'a> Seen<'a> {
    fn new(image: &'a RgbdImage, view: &'a Camera) -> Result<Self, DepthError> {
        image.check()?;
        let to_view = view.pose().world_to_camera * image.pose.world_to_camera.inverse();
        Ok(Self { image, depths: image.depths_along_axis(), to_view, view })
    }

    /// The place in the new picture and the depth there of what the image sees at `place` in a depth; `None` behind the camera.
    fn place(&self, place: glam::DVec2, depth: f32) -> Option<([f64; 2], f32)> {
        let there = self.to_view.transform_point3(self.image.ray(place) * f64::from(depth));
        let intrinsics = self.view.intrinsics();
        let at = intrinsics.focal * there.truncate() / there.z + intrinsics.center;
        (depth > 0.0 && there.z > 0.0).then(|| (at.to_array(), there.z as f32))
    }

    /// The same of a pixel's centre.
    fn pixel(&self, at: usize) -> Option<([f64; 2], f32)> {
        let width = self.image.size[0];
        let place = [at % width, at / width].map(|x| x as f64 + 0.5);
        self.place(place.into(), self.depths[at])
    }

    fn frame(&self) -> Frame {
        let [width, height] = self.view.size();
        Frame::new(width as usize, height as usize)
    }
}

/// Writes what is nearer than what is there.
fn write(frame: &mut Frame, [x, y]: [i64; 2], depth: f32, color: [f32; 3]) {
    let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
    if x < frame.width && y < frame.height {
        let at = y * frame.width + x;
        if depth < frame.depth[at] {
            frame.depth[at] = depth;
            frame.color[at] = [color[0], color[1], color[2], 1.0];
        }
    }
}
