//! Files to intrinsics.

use crate::file::File;
use crate::{ImportError, Place};
use glam::{DVec2, dvec2};
use oblate_engine::Intrinsics;
use serde::Deserialize;
use std::path::Path;

/// What Open3D writes of a `PinholeCameraIntrinsic`.
#[derive(Deserialize)]
struct Pinhole {
    width: u32,
    height: u32,
    /// Column by column.
    intrinsic_matrix: [f64; 9],
}

/// Reads the size of a camera's pictures and its intrinsics, from the JSON that Open3D writes of a `PinholeCameraIntrinsic`.
///
/// There the centre of the first pixel is (0, 0), as in most data sets and in OpenCV. Here it is (0.5, 0.5): half a pixel is added to the principal point.
///
/// # Errors
/// When the file cannot be read or is no such JSON; when a side is 0, a focal length is not finite and above 0, or the matrix has other entries
/// than those of focal lengths and a principal point.
pub fn read_intrinsics(path: impl AsRef<Path>) -> Result<([usize; 2], Intrinsics), ImportError> {
    let file = File::read(path.as_ref())?;
    let camera: Pinhole = serde_json::from_slice(file.text()).map_err(|error| {
        let problem =
            format!("no PinholeCameraIntrinsic of Open3D, with width, height and intrinsic_matrix: {error}");
        file.malformed(Place::Line(error.line()), problem)
    })?;
    let wrong = |part: &str, problem: String| Err(file.malformed(Place::Part(part.into()), problem));
    if camera.width == 0 || camera.height == 0 {
        return wrong(
            "width and height",
            format!("{} and {}; both are above 0", camera.width, camera.height),
        );
    }
    let [fx, _, _, skew, fy, _, cx, cy, _] = camera.intrinsic_matrix;
    if camera.intrinsic_matrix != [fx, 0.0, 0.0, skew, fy, 0.0, cx, cy, 1.0] {
        let problem = format!("{:?}; column by column it is fx 0 0 0 fy 0 cx cy 1", camera.intrinsic_matrix);
        return wrong("intrinsic_matrix", problem);
    }
    if skew != 0.0 {
        let feature = format!("the skew is {skew}; only cameras without are read");
        return Err(file.unsupported(Place::Part("intrinsic_matrix".into()), feature));
    }
    if !(fx.is_finite() && fy.is_finite() && fx > 0.0 && fy > 0.0 && cx.is_finite() && cy.is_finite()) {
        let problem = format!(
            "focal lengths {fx} and {fy}, principal point ({cx}, {cy}); all are finite, the first two above 0"
        );
        return wrong("intrinsic_matrix", problem);
    }
    let intrinsics = Intrinsics { focal: dvec2(fx, fy), center: dvec2(cx, cy) + DVec2::splat(0.5) };
    Ok(([camera.width as usize, camera.height as usize], intrinsics))
}
