//! A depth image as a mesh of triangles.

use super::{Seen, write};
use oblate_engine::{Camera, Frame};
use oblate_surfels::{DepthError, RgbdImage};

/// Two triangles for each four pixels, with colours in between, sampled at the centres of the new view's pixels. Triangles whose depths
/// differ by more than a share of the nearest are left out: 0.05 is usual, infinity draws a sheet over every edge.
///
/// # Errors
/// When the image is not one.
pub fn triangles(image: &RgbdImage, view: &Camera, largest_step: f32) -> Result<Frame, DepthError> {
    let seen = Seen::new(image, view)?;
    let mut frame = seen.frame();
    let [width, height] = image.size;
    let corners: Vec<_> = (0..seen.depths.len()).map(|at| seen.pixel(at)).collect();
    for row in 0..height - 1 {
        for column in 0..width - 1 {
            let at = row * width + column;
            let quad = [at, at + 1, at + width, at + width + 1];
            for triangle in [[quad[0], quad[1], quad[2]], [quad[1], quad[3], quad[2]]] {
                let depths = triangle.map(|at| seen.depths[at]);
                let nearest = depths.into_iter().fold(f32::INFINITY, f32::min);
                let farthest = depths.into_iter().fold(0.0, f32::max);
                if nearest <= 0.0 || farthest - nearest > largest_step * nearest {
                    continue;
                }
                if let [Some(a), Some(b), Some(c)] = triangle.map(|at| corners[at]) {
                    fill(&mut frame, [a, b, c], triangle.map(|at| image.colors[at]));
                }
            }
        }
    }
    Ok(frame)
}

fn fill(frame: &mut Frame, corners: [([f64; 2], f32); 3], colors: [[f32; 3]; 3]) {
    let [a, b, c] = corners.map(|(place, _)| glam::DVec2::from(place));
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let columns =
        (low.x - 0.5).ceil().max(0.0) as i64..=((high.x - 0.5).floor().min(frame.width as f64 - 1.0) as i64);
    for y in
        (low.y - 0.5).ceil().max(0.0) as i64..=((high.y - 0.5).floor().min(frame.height as f64 - 1.0) as i64)
    {
        for x in columns.clone() {
            let p = glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let shares =
                [(c - b).perp_dot(p - b), (a - c).perp_dot(p - c), (b - a).perp_dot(p - a)].map(|s| s / area);
            if shares.iter().any(|share| *share < 0.0) {
                continue;
            }
            // 1/z is linear in the picture, and so is a colour over z.
            let over: [f32; 3] = std::array::from_fn(|i| shares[i] as f32 / corners[i].1);
            let depth = 1.0 / over.iter().sum::<f32>();
            let color = std::array::from_fn(|channel| {
                (0..3).map(|i| over[i] * colors[i][channel]).sum::<f32>() * depth
            });
            write(frame, [x, y], depth, color);
        }
    }
}
