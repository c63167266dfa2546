//! Pixels written as they come.

use super::{Seen, write};
use oblate_engine::{Camera, Frame};
use oblate_surfels::{DepthError, RgbdImage};

/// Each pixel is written at the nearest one of the new view, or into the `side`² about it, over what is farther: 1 leaves cracks, 3 fills
/// most of them and frays edges.
///
/// # Errors
/// When the image is not one.
pub fn nearest(image: &RgbdImage, view: &Camera, side: usize) -> Result<Frame, DepthError> {
    let seen = Seen::new(image, view)?;
    let mut frame = seen.frame();
    let reach = side as i64 / 2;
    for at in 0..seen.depths.len() {
        let Some((place, depth)) = seen.pixel(at) else { continue };
        let [x, y] = place.map(|c| c.floor() as i64);
        for y in y - reach..=y + reach {
            for x in x - reach..=x + reach {
                write(&mut frame, [x, y], depth, image.colors[at]);
            }
        }
    }
    Ok(frame)
}

/// Each pixel is written at the nearest one, over whatever is there, in an order in which what is nearer comes later: towards the epipole, or
/// away from it where that lies behind (McMillan, *A List-Priority Rendering Algorithm for Redisplaying Projected Surfaces*, 1995).
///
/// # Errors
/// When the image is not one.
pub fn mcmillan(image: &RgbdImage, view: &Camera) -> Result<Frame, DepthError> {
    let seen = Seen::new(image, view)?;
    let mut frame = seen.frame();
    let eye = image.pose.world_to_camera.transform_point3(view.pose().eye());
    let scale = if eye.z.abs() > 1e-12 { eye.z } else { 1e-12 };
    let epipole = image.intrinsics.focal * eye.truncate() / scale + image.intrinsics.center;
    let along = |count: usize, epipole: f64| {
        let mut order: Vec<usize> = (0..count).collect();
        let distance = |i: &usize| (*i as f64 + 0.5 - epipole).abs();
        order.sort_by(|a, b| distance(b).total_cmp(&distance(a)));
        if eye.z < 0.0 {
            order.reverse();
        }
        order
    };
    let [width, height] = image.size;
    let columns = along(width, epipole.x);
    for row in along(height, epipole.y) {
        for column in &columns {
            let at = row * width + column;
            let Some((place, depth)) = seen.pixel(at) else { continue };
            let [x, y] = place.map(|c| c.floor() as i64);
            let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { continue };
            if x < frame.width && y < frame.height {
                let to = y * frame.width + x;
                let [red, green, blue] = image.colors[at];
                frame.depth[to] = depth;
                frame.color[to] = [red, green, blue, 1.0];
            }
        }
    }
    Ok(frame)
}

/// Each pixel becomes `side`² of bilinear colour and depth, each written at the nearest pixel of the new view: the remedy for cracks
/// of Yuan, Chen et al., *Hybrid Forward Resampling and Volume Rendering*, 2003, figure 5a.
///
/// # Errors
/// When the image is not one.
pub fn supersampled(image: &RgbdImage, view: &Camera, side: usize) -> Result<Frame, DepthError> {
    let seen = Seen::new(image, view)?;
    let mut frame = seen.frame();
    let [width, height] = image.size;
    for row in 0..height * side {
        for column in 0..width * side {
            let place = [column, row].map(|c| (c as f64 + 0.5) / side as f64);
            let Some((depth, color)) = bilinear(&seen, place) else { continue };
            let Some((to, depth)) = seen.place(place.into(), depth) else { continue };
            write(&mut frame, to.map(|c| c.floor() as i64), depth, color);
        }
    }
    Ok(frame)
}

/// Depth and colour at a place; `None` where none of the four pixels has a depth.
fn bilinear(seen: &Seen, place: [f64; 2]) -> Option<(f32, [f32; 3])> {
    let [width, height] = seen.image.size;
    let [x, y] = place.map(|c| c - 0.5);
    let (mut depth, mut color, mut sum) = (0.0, [0.0; 3], 0.0);
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let (cx, cy) = (x.floor() + f64::from(dx), y.floor() + f64::from(dy));
        let weight = ((1.0 - (x - cx).abs()) * (1.0 - (y - cy).abs())) as f32;
        let at =
            cy.clamp(0.0, height as f64 - 1.0) as usize * width + cx.clamp(0.0, width as f64 - 1.0) as usize;
        if seen.depths[at] > 0.0 && weight > 0.0 {
            sum += weight;
            depth += weight * seen.depths[at];
            for (sum, c) in color.iter_mut().zip(seen.image.colors[at]) {
                *sum += weight * c;
            }
        }
    }
    (sum > 0.0).then(|| (depth / sum, color.map(|c| c / sum)))
}
