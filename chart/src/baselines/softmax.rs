//! Softmax splatting.

use super::Seen;
use oblate_engine::{Camera, Frame};
use oblate_surfels::{DepthError, RgbdImage};

/// Each pixel is shared out bilinearly among four of the new view, weighted by e^{20/z}, z in metres, in place of a test of depths
/// (Niklaus, Liu, *Softmax Splatting for Video Frame Interpolation*, 2020); where anything was written, weights are normalized.
///
/// # Errors
/// When the image is not one.
pub fn softmax(image: &RgbdImage, view: &Camera) -> Result<Frame, DepthError> {
    let seen = Seen::new(image, view)?;
    let mut frame = seen.frame();
    let places: Vec<_> = (0..seen.depths.len()).map(|at| seen.pixel(at)).collect();
    let nearest = places.iter().flatten().map(|(_, depth)| *depth).fold(f32::INFINITY, f32::min);
    let mut depths = vec![0.0; frame.color.len()];
    for (place, color) in places.iter().zip(&image.colors) {
        let Some((place, depth)) = place else { continue };
        let importance = (f64::from(20.0 / depth) - f64::from(20.0 / nearest)).exp();
        let [x, y] = place.map(|c| c - 0.5);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (cx, cy) = (x.floor() + dx, y.floor() + dy);
            if (0.0..frame.width as f64).contains(&cx) && (0.0..frame.height as f64).contains(&cy) {
                let weight = ((1.0 - (x - cx).abs()) * (1.0 - (y - cy).abs()) * importance) as f32;
                let at = cy as usize * frame.width + cx as usize;
                for (sum, c) in frame.color[at].iter_mut().zip([color[0], color[1], color[2], 1.0]) {
                    *sum += weight * c;
                }
                depths[at] += weight * depth;
            }
        }
    }
    for (at, color) in frame.color.iter_mut().enumerate() {
        if color[3] > 0.0 {
            frame.depth[at] = depths[at] / color[3];
            *color = color.map(|sum| sum / color[3]);
        }
    }
    Ok(frame)
}
