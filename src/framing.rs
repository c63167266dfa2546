//! Cameras for scenes whose viewer said little about them.

use crate::description::CameraOptions;
use crate::notation::comma_list;
use anyhow::{Context, Result, bail};
use glam::{DMat3, DVec2, DVec3};
use oblate::engine::{Camera, Pose};
use rayon::prelude::*;

/// Share of half the picture that stays free on each side of the points of a framed scene; what is about them has it.
const MARGIN: f64 = 0.06;

/// Eye and target are rounded to this share of the distance between them, the target to a quarter of a pixel if that is less.
const ROUNDING: f64 = 1e-4;

/// Vertical angle of view in degrees.
const FOV: f64 = 30.0;

/// A camera with every choice made; writes itself as options.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct View {
    eye: DVec3,
    target: DVec3,
    up: DVec3,
    lens: Lens,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Lens {
    /// Vertical angle in degrees.
    Angle(f64),
    /// Height of the view in world units.
    Height(f64),
}

impl View {
    /// Completes the options, which were checked, so that what has this `reach` fills a picture of `size`. `up` counts where
    /// the options say none.
    pub(crate) fn complete(
        options: &CameraOptions,
        reach: Reach<'_>,
        up: DVec3,
        size: [u32; 2],
    ) -> Result<Self> {
        let fov = options.fov.unwrap_or(FOV);
        let [eye, target, up_given] = [options.eye, options.target, options.up].map(|v| v.map(DVec3::from));
        let middle = middle(reach);

        if let (Some(eye), Some(target)) = (eye, target)
            && eye == target
        {
            bail!("camera: eye and target are both {eye}; they must differ");
        }
        // The direction from the target to the eye.
        let outward = match eye {
            Some(eye) => eye - target.unwrap_or(middle),
            None => {
                let custom = up;
                let up = up_given.unwrap_or(custom).normalize_or(DVec3::Y);
                // What a viewer says of up is about the picture; custom is about the thing.
                let against = up.dot(custom);
                let on_its_head = against < 0.0 || (against == 0.0 && up.y + up.z < 0.0);
                three_quarter(up, if on_its_head { -up } else { up })
            }
        };
        let up = up_given.unwrap_or_else(|| not_along(outward, up));
        let pose = Pose::look_at(outward, DVec3::ZERO, up).context("camera")?;
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let whole = (fov.to_radians() / 2.0).tan() * DVec2::new(aspect, 1.0);
        let tangents = [whole * (1.0 - MARGIN), whole];
        let framed = Framed { rotation: pose.world_to_camera.matrix3, middle, reach, tangents };
        let [framed_eye, framed_target] = match (eye, target) {
            (Some(eye), _) => [eye, middle],
            (None, Some(target)) => [framed.back_from(target), target],
            (None, None) => framed.fitted(),
        };
        let distance = eye.unwrap_or(framed_eye).distance(target.unwrap_or(framed_target));
        let step = ROUNDING * distance;
        // Where the eye is moved, the view turns about the target; where that is, it goes aside.
        let pixel = options.orthographic.unwrap_or(2.0 * whole.y * distance) / f64::from(size[1]);
        Ok(Self {
            eye: eye.unwrap_or_else(|| rounded(framed_eye, step)),
            target: target.unwrap_or_else(|| rounded(framed_target, step.min(pixel / 4.0))),
            up,
            lens: options.orthographic.map_or(Lens::Angle(fov), Lens::Height),
        })
    }

    /// The camera for a picture of `size`.
    pub(crate) fn camera(&self, size: [u32; 2]) -> Result<Camera> {
        let pose = Pose::look_at(self.eye, self.target, self.up).context("camera")?;
        match self.lens {
            Lens::Angle(degrees) => Camera::perspective(pose, degrees.to_radians(), size),
            Lens::Height(height) => Camera::orthographic(pose, height, size),
        }
        .context("camera")
    }
}

impl std::fmt::Display for View {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let list = |v: DVec3| comma_list(&v.to_array());
        write!(f, "--eye {} --target {} --up {}", list(self.eye), list(self.target), list(self.up))?;
        match self.lens {
            Lens::Angle(degrees) => write!(f, " --fov {degrees}"),
            Lens::Height(height) => write!(f, " --orthographic {height}"),
        }
    }
}

/// How far what is to be seen, in world space, reaches along each of some directions: points, and what is about them; −∞
/// where there is nothing.
pub(crate) type Reach<'a> = &'a dyn Fn(&[DVec3]) -> Vec<[f64; 2]>;

/// The farthest of the points along each of some directions, and how far that is; −∞ without points.
pub(crate) fn farthest(
    points: impl ParallelIterator<Item = DVec3>,
    directions: &[DVec3],
) -> Vec<(f64, DVec3)> {
    let none = || vec![(f64::NEG_INFINITY, DVec3::ZERO); directions.len()];
    let with = |mut farthest: Vec<(f64, DVec3)>, p: DVec3| {
        for (own, direction) in farthest.iter_mut().zip(directions) {
            let along = p.dot(*direction);
            if along > own.0 {
                *own = (along, p);
            }
        }
        farthest
    };
    let farther = |a: (f64, DVec3), b: (f64, DVec3)| if b.0 > a.0 { b } else { a };
    let both = |a: Vec<_>, b: Vec<_>| a.into_iter().zip(b).map(|(a, b)| farther(a, b)).collect();
    points.fold(none, with).reduce(none, both)
}

/// Directions that an outline is taken in: any is within 0.24 radians of one of them, so that an outline of a ball reaches at most
/// 2.9 % less far than the ball, which the margin has room for.
const OUTLINE: usize = 128;

/// The farthest of the points in each of many directions, evenly spread: so few that many copies of them are soon seen.
pub(crate) fn outline(points: impl ParallelIterator<Item = DVec3>) -> Vec<DVec3> {
    // A spiral of golden angles on the sphere.
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let direction = |i: usize| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / OUTLINE as f64;
        (DVec2::from_angle(golden_angle * i as f64) * (1.0 - z * z).sqrt()).extend(z)
    };
    let directions: [DVec3; OUTLINE] = std::array::from_fn(direction);
    let farthest = farthest(points, &directions);
    let mut outline: Vec<DVec3> =
        farthest.into_iter().filter(|(along, _)| along.is_finite()).map(|(_, p)| p).collect();
    outline.dedup();
    outline
}

/// The middle of the bounds; the origin where there is nothing.
fn middle(reach: Reach<'_>) -> DVec3 {
    let ends = reach(&[DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z]);
    let ends: Vec<f64> = ends.into_iter().map(|[points, _]| points).collect();
    let (high, low) = (DVec3::from_slice(&ends[..3]), -DVec3::from_slice(&ends[3..]));
    if low.is_finite() && high.is_finite() { (low + high) / 2.0 } else { DVec3::ZERO }
}

/// What is seen by a camera that is turned and whose place is wanted.
struct Framed<'a> {
    /// Rows: right, down, forward.
    rotation: DMat3,
    middle: DVec3,
    reach: Reach<'a>,
    /// Slopes of the frame's sides, right and down: the points', and those of what is about them.
    tangents: [DVec2; 2],
}

impl Framed<'_> {
    /// The largest x − t z, −x − t z, y − t z and −y − t z in camera axes, seen from a place, each with the t of its axis: of points, and
    /// of what is about them; −∞ where there is nothing.
    fn sides(&self, from: DVec3) -> [[f64; 4]; 2] {
        let [right, down, forward] = [0, 1, 2].map(|axis| self.rotation.row(axis));
        let directions = self.tangents.map(|tangent| {
            let [back_x, back_y] = [tangent.x, tangent.y].map(|t| -t * forward);
            [right + back_x, -right + back_x, down + back_y, -down + back_y]
        });
        let reach = (self.reach)(directions.as_flattened());
        let along =
            |part: usize, side: usize| reach[4 * part + side][part] - directions[part][side].dot(from);
        std::array::from_fn(|part| std::array::from_fn(|side| along(part, side)))
    }

    /// The nearest eye from which everything projects into the frame, and the point of its axis at the
    /// depth of the middle.
    ///
    /// A point at (x, z) is inside if |x − e_x| ≤ t (z − e_z), that is x − t z ≤ e_x − t e_z and
    /// −x − t z ≤ −e_x − t e_z: with the largest left sides a and b, e_z ≤ −(a + b)/2t, and
    /// e_x = (a − b)/2 keeps the same distance from both sides. Points and what is about them have a, b and t each, of which
    /// the nearest side counts.
    fn fitted(&self) -> [DVec3; 2] {
        let [points, about] = self.sides(DVec3::ZERO);
        let depth = |side: usize, axis: usize| {
            let [t, u] = self.tangents.map(|tangent| tangent[axis]);
            let pairs = [
                (points, points, t + t),
                (points, about, t + u),
                (about, points, u + t),
                (about, about, u + u),
            ];
            pairs.map(|(a, b, sum)| -(a[side] + b[side + 1]) / sum).into_iter().fold(f64::INFINITY, f64::min)
        };
        let z = depth(0, 0).min(depth(2, 1));
        let place = |side: usize, axis: usize| {
            let [t, u] = self.tangents.map(|tangent| tangent[axis]);
            let nearest = |side: usize| {
                if about[side] + u * z > points[side] + t * z { (about[side], u) } else { (points[side], t) }
            };
            let ((a, t), (b, u)) = (nearest(side), nearest(side + 1));
            (a - b) / 2.0 + (t - u) * z / 2.0
        };
        let center = self.rotation * self.middle;
        // A single point needs no distance, but for roundings, and none at all has no place: stand one unit away.
        let roundings = 1e-14 * center.length() / self.tangents[0].min_element();
        let seen = z.is_finite() && center.z - z > roundings;
        let eye = if seen { DVec3::new(place(0, 0), place(2, 1), z) } else { center - DVec3::Z };
        let to_world = self.rotation.transpose();
        [to_world * eye, to_world * DVec3::new(eye.x, eye.y, center.z)]
    }

    /// The nearest eye on the axis through `target` from which everything projects into the frame.
    fn back_from(&self, target: DVec3) -> DVec3 {
        let back = |([right, left, down, up], tangent): ([f64; 4], DVec2)| {
            (right.max(left) / tangent.x).max(down.max(up) / tangent.y)
        };
        let sides = self.sides(target).into_iter().zip(self.tangents);
        let distance = sides.map(back).fold(0.0, f64::max);
        let distance = if distance > 0.0 && distance.is_finite() { distance } else { 1.0 };
        target - self.rotation.row(2) * distance
    }
}

/// The direction to an eye that sees front, right side and top of a thing that stands upright where `upright` is up: its
/// front looks to +Z when that is +Y (as in glTF), to −Y when it is +Z. There it stays when `up` turns it on its head.
fn three_quarter(up: DVec3, upright: DVec3) -> DVec3 {
    let across = (DVec3::X - up * up.x).try_normalize().filter(|_| up.x.abs() < 0.999).unwrap_or(DVec3::Z);
    let front = across.cross(upright);
    0.55 * up.cross(front) + 0.45 * up + 0.8 * front
}

/// `up`, or another axis where it would leave the roll open.
fn not_along(direction: DVec3, up: DVec3) -> DVec3 {
    let parallel = up.normalize_or(DVec3::Y).cross(direction.normalize_or(DVec3::Z)).length() < 1e-3;
    if !parallel {
        up
    } else if up == DVec3::Z {
        DVec3::Y
    } else {
        DVec3::NEG_Z
    }
}

/// Digits down to a step or finer: short to print, and used as printed.
fn rounded(v: DVec3, step: f64) -> DVec3 {
    let per_step = 10f64.powi((step.log10().floor() as i32).saturating_neg());
    // Dividing by a power of ten gives the double nearest to the decimal, which prints in few digits.
    let rounded = if per_step >= 1.0 { (v * per_step).round() / per_step } else { v.round() };
    if rounded.is_finite() { rounded } else { v }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [200, 100];

    fn cube(low: f64, high: f64) -> Vec<DVec3> {
        (0..8)
            .map(|i| DVec3::from([i & 1, i >> 1 & 1, i >> 2].map(|b| if b == 1 { high } else { low })))
            .collect()
    }

    fn complete(options: &CameraOptions, points: &[DVec3], up: DVec3) -> View {
        about(options, (points, 0.0), up)
    }

    /// A view of balls about points.
    fn about(options: &CameraOptions, (points, radius): (&[DVec3], f64), up: DVec3) -> View {
        let reach = |directions: &[DVec3]| -> Vec<[f64; 2]> {
            let ends = farthest(points.par_iter().copied(), directions).into_iter().zip(directions);
            ends.map(|((along, _), direction)| [along, along + radius * direction.length()]).collect()
        };
        View::complete(options, &reach, up, SIZE).unwrap()
    }

    /// Bounds of the projections in units of half the picture.
    fn extent(view: &View, points: &[DVec3]) -> (DVec2, DVec2) {
        let camera = view.camera(SIZE).unwrap();
        let half = DVec2::new(f64::from(SIZE[0]), f64::from(SIZE[1])) / 2.0;
        points.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| {
            let c = camera.pose().world_to_camera.transform_point3(*p);
            assert!(c.z > 0.0);
            let seen = (c.truncate() / c.z * camera.intrinsics().focal) / half;
            (low.min(seen), high.max(seen))
        })
    }

    #[test]
    fn the_scene_fills_the_picture() {
        let points = cube(-3.0, 7.0);
        for up in [DVec3::Y, DVec3::Z, DVec3::new(1.0, 0.2, -1.0), DVec3::X] {
            let view = complete(&CameraOptions::default(), &points, up);
            let (low, high) = extent(&view, &points);
            // The binding side is the height here; rounding moves points by
            // 1e-4 of the distance at most, which is 1e-4 / tan(15°) = 4e-4 of half the picture.
            let bound = 1.0 - MARGIN;
            assert!((low.y + bound).abs() < 1e-3 && (high.y - bound).abs() < 1e-3, "{low} {high}");
            assert!(low.x > -bound && high.x < bound, "{low} {high}");
        }
    }

    #[test]
    fn small_angles_see_it_in_the_middle() {
        let points = cube(0.311, 0.727);
        for options in [
            CameraOptions { fov: Some(0.01), ..Default::default() },
            CameraOptions { fov: Some(0.001), eye: Some([3e4, 1e4, 2e4]), ..Default::default() },
        ] {
            let view = complete(&options, &points, DVec3::Y);
            let (low, high) = extent(&view, &points);
            // In pixels: a quarter, rounded.
            let off = (low + high) / 2.0 * DVec2::new(100.0, 50.0);
            assert!(off.abs().max_element() < 0.3, "{view}: {low} to {high}");
        }
    }

    #[test]
    fn what_is_small_and_far_from_the_origin_fills_the_picture() {
        // Doubles are 2e-6 apart there, 1e-5 of the cube.
        let points = cube(1e10, 1e10 + 0.15);
        let (low, high) = extent(&complete(&CameraOptions::default(), &points, DVec3::Y), &points);
        let bound = 1.0 - MARGIN;
        assert!((low.y + bound).abs() < 1e-3 && (high.y - bound).abs() < 1e-3, "{low} {high}");
    }

    #[test]
    fn a_target_alone_is_kept_in_the_middle() {
        let points = cube(-1.0, 1.0);
        let options = CameraOptions { target: Some([0.5, 0.0, 0.0]), ..Default::default() };
        let view = complete(&options, &points, DVec3::Y);
        assert_eq!(view.target, DVec3::new(0.5, 0.0, 0.0));
        let (low, high) = extent(&view, &points);
        let reach = low.abs().max(high.abs()).max_element();
        assert!((reach - (1.0 - MARGIN)).abs() < 1e-3, "{reach}");
    }

    #[test]
    fn what_is_about_points_stays_in_the_picture() {
        let options = CameraOptions::default();
        let targeted = CameraOptions { target: Some([2.0, 0.0, 1.0]), ..options };
        // A ball alone is as high as the picture: its sine is that of half the angle of view.
        let view = about(&options, (&[DVec3::ONE], 0.5), DVec3::Y);
        let distance = 0.5 / (FOV / 2.0).to_radians().sin();
        assert!((view.eye.distance(DVec3::ONE) - distance).abs() < 1e-3 * distance, "{view}");
        // Of many balls only the margin counts.
        let points = cube(-3.0, 7.0);
        assert_eq!(about(&options, (&points, 0.1), DVec3::Y), complete(&options, &points, DVec3::Y));
        for options in [options, targeted] {
            let camera = about(&options, (&points, 2.0), DVec3::Y).camera(SIZE).unwrap();
            let half = DVec2::new(f64::from(SIZE[0]), f64::from(SIZE[1])) / 2.0 / camera.intrinsics().focal;
            // How far beyond each side the farthest ball is; half of the angle's cosine makes slopes distances.
            let beyond = |axis: usize| {
                let centers = points.iter().map(|p| camera.pose().world_to_camera.transform_point3(*p));
                let off = centers.map(|c| (c[axis].abs() - half[axis] * c.z) / half[axis].hypot(1.0) + 2.0);
                off.fold(f64::NEG_INFINITY, f64::max)
            };
            let most = beyond(0).max(beyond(1));
            // Rounding moves the eye by 1e-4 of the distance, which is 50 or so.
            assert!(most.abs() < 1e-2, "{most}");
        }
    }

    #[test]
    fn the_front_is_seen_either_way_up() {
        for (up, front) in [(DVec3::Z, DVec3::NEG_Y), (DVec3::Y, DVec3::Z)] {
            let upright = up;
            for up in [up, -up] {
                let outward = three_quarter(up, upright);
                assert!((outward.dot(front) - 0.8).abs() < 1e-12 && (outward.dot(up) - 0.45).abs() < 1e-12);
                // The right side in the picture, whatever it is called in the world.
                assert!((outward.dot(up.cross(front)) - 0.55).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn custom_that_is_said_changes_nothing() {
        let points = cube(-1.0, 2.0);
        for up in [DVec3::Y, DVec3::Z, DVec3::NEG_Y] {
            let said = CameraOptions { up: Some(up.to_array()), ..CameraOptions::default() };
            assert_eq!(complete(&said, &points, up), complete(&CameraOptions::default(), &points, up));
            // Upside down the same side is seen.
            let turned = CameraOptions { up: Some((-up).to_array()), ..CameraOptions::default() };
            let [upright, turned] = [said, turned].map(|options| complete(&options, &points, up));
            let front = DVec3::X.cross(up);
            assert!((upright.eye - upright.target).dot(front) > 0.0);
            assert!((turned.eye - turned.target).dot(front) > 0.0);
        }
        // Where custom says nothing of it, −z is down.
        let down = CameraOptions { up: Some([0.0, 0.0, -1.0]), ..CameraOptions::default() };
        let view = complete(&down, &points, DVec3::Y);
        assert!((view.eye - view.target).y < 0.0);
    }

    #[test]
    fn an_eye_alone_looks_at_the_middle_even_from_above() {
        let options = CameraOptions { eye: Some([2.0, 50.0, 2.0]), ..Default::default() };
        let view = complete(&options, &cube(0.0, 4.0), DVec3::Y);
        assert_eq!(view.target, DVec3::splat(2.0));
        assert!(view.camera(SIZE).is_ok());
    }

    #[test]
    fn degenerate_scenes_have_a_camera() {
        for points in [vec![], vec![DVec3::ONE], vec![DVec3::splat(1e6); 3]] {
            let view = complete(&CameraOptions::default(), &points, DVec3::Z);
            assert!(view.camera(SIZE).is_ok(), "{view:?}");
        }
    }

    #[test]
    fn an_outline_reaches_as_far_as_what_it_is_of() {
        let ball = |i: i32| {
            let turn = f64::from(i) * 0.1;
            DVec3::new(turn.sin() * (turn * 7.3).cos(), turn.cos(), turn.sin() * (turn * 7.3).sin()) * 3.0
        };
        let outline = outline((0..20_000).into_par_iter().map(ball));
        assert!(outline.len() <= OUTLINE);
        for direction in (0..500).map(|i| ball(37 * i) / 3.0) {
            let reach = outline.iter().map(|p| p.dot(direction)).fold(0.0, f64::max);
            // cos 0.24 of the radius; points are 0.02 or so apart.
            assert!((0.97 * 3.0..3.001).contains(&reach), "{reach} along {direction}");
        }
        assert!(super::outline(rayon::iter::empty()).is_empty());
    }

    #[test]
    fn it_prints_as_it_is_used() {
        let view = complete(&CameraOptions::default(), &cube(0.0, 100.0), DVec3::Z);
        let text = view.to_string();
        let words: Vec<&str> = text.split(' ').collect();
        let again = CameraOptions {
            eye: Some(crate::notation::triple(words[1]).unwrap()),
            target: Some(crate::notation::triple(words[3]).unwrap()),
            up: Some(crate::notation::triple(words[5]).unwrap()),
            fov: Some(words[7].parse().unwrap()),
            orthographic: None,
        };
        assert_eq!(complete(&again, &[], DVec3::Y), view);
        assert!(text.len() < 100, "{text}");
    }
}
