//! Depth images seen from elsewhere, beside what is really there.

use glam::{DAffine3, DMat3, DVec2, DVec3};
use oblate_engine::color::linear_to_srgb;
use oblate_engine::{
    Blend, Camera, Cloud, Frame, Intrinsics, Pose, Projection, RenderSettings, Scene, render,
};
use oblate_surfels::{
    DEPTH_LOW_PASS, DepthError, DepthKind, DepthSampler, DepthSettings, RgbdImage, Room, depth_surfels,
    fill_disocclusions, merged_depth_surfels,
};
use proptest::prelude::*;

const SIZE: [u32; 2] = [96, 72];

fn at(place: DVec3, turn: f64) -> Pose {
    let rotation = DMat3::from_rotation_y(turn);
    Pose { world_to_camera: DAffine3::from_mat3_translation(rotation, -(rotation * place)) }
}

fn camera(pose: Pose, focal: f64, size: [u32; 2]) -> Camera {
    let center = DVec2::new(f64::from(size[0]), f64::from(size[1])) / 2.0;
    let intrinsics = Intrinsics { focal: DVec2::splat(focal), center };
    Camera::from_intrinsics(pose, intrinsics, Projection::Perspective, size).expect("a camera")
}

/// What a ray sees: the distance in lengths of its direction, and a colour.
type Sight<'a> = &'a dyn Fn(DVec3, DVec3) -> Option<(f64, [f32; 3])>;

fn direction(camera: &Camera, place: DVec2) -> DVec3 {
    let Intrinsics { focal, center } = camera.intrinsics();
    camera.pose().world_to_camera.matrix3.transpose() * ((place - center) / focal).extend(1.0)
}

fn pixels(camera: &Camera) -> impl Iterator<Item = DVec2> + use<> {
    let [width, height] = camera.size();
    (0..height).flat_map(move |y| (0..width).map(move |x| DVec2::new(f64::from(x), f64::from(y))))
}

/// The image that a camera takes: what is at the centres of its pixels.
fn image(camera: &Camera, see: Sight) -> RgbdImage {
    let eye = camera.pose().eye();
    let seen: Vec<_> = pixels(camera).map(|pixel| see(eye, direction(camera, pixel + 0.5))).collect();
    RgbdImage {
        size: camera.size().map(|side| side as usize),
        colors: seen.iter().map(|seen| seen.map_or([0.0; 3], |(_, color)| color)).collect(),
        depths: seen.iter().map(|seen| seen.map_or(0.0, |(depth, _)| depth as f32)).collect(),
        kind: DepthKind::AlongAxis,
        intrinsics: camera.intrinsics(),
        pose: camera.pose(),
    }
}

/// The picture under a Gaussian filter of a variance in px², by 16 × 16 places for each pixel within 3.5 px.
fn picture(camera: &Camera, variance: f64, see: Sight) -> Vec<[f32; 3]> {
    let eye = camera.pose().eye();
    let filtered = |pixel: DVec2| {
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for place in 0..256 {
            let off = (DVec2::new(f64::from(place % 16), f64::from(place / 16)) + 0.5) / 16.0 - 0.5;
            let off = off * 7.0 * variance.sqrt();
            let weight = (-0.5 * off.length_squared() / variance).exp();
            let (_, color) = see(eye, direction(camera, pixel + 0.5 + off)).unwrap_or_default();
            sum = std::array::from_fn(|i| sum[i] + weight * f64::from(linear_to_srgb(color[i])));
            total += weight;
        }
        sum.map(|sum| (sum / total) as f32)
    };
    pixels(camera).map(filtered).collect()
}

fn settings() -> RenderSettings {
    RenderSettings {
        low_pass: DEPTH_LOW_PASS,
        blend: Blend::Display,
        shade: false,
        ..RenderSettings::default()
    }
}

fn drawn(clouds: Vec<Cloud>, camera: &Camera) -> Frame {
    render(&Scene { clouds, lights: Vec::new() }, camera, &settings(), &()).expect("the scene is right")
}

fn warped(image: &RgbdImage, camera: &Camera) -> Frame {
    drawn(vec![depth_surfels(image, &DepthSettings::default()).expect("the image is right")], camera)
}

/// Display-encoded.
fn shown(frame: &Frame) -> Vec<[f32; 3]> {
    frame.color.iter().map(|[r, g, b, _]| [r, g, b].map(|c| linear_to_srgb(*c))).collect()
}

fn psnr(pairs: impl Iterator<Item = ([f32; 3], [f32; 3])>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in pairs {
        sum += (0..3).map(|i| f64::from(a[i] - b[i]).powi(2)).sum::<f64>();
        count += 3.0;
    }
    10.0 * (count / sum).log10()
}

fn colors_psnr(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    assert_eq!(a.len(), b.len());
    psnr(a.iter().copied().zip(b.iter().copied()))
}

/// Smooth colours: waves of 0.2 and more.
fn waves(p: DVec3) -> [f32; 3] {
    let wave = |k: DVec3, phase: f64| 0.35 + 0.25 * (k.dot(p) + phase).sin();
    [DVec3::new(28.0, 9.0, 3.0), DVec3::new(-7.0, 30.0, 5.0), DVec3::new(11.0, -8.0, 20.0)]
        .map(|k| wave(k, k.x) as f32)
}

/// A tilted wall.
fn wall(eye: DVec3, direction: DVec3) -> Option<(f64, [f32; 3])> {
    let normal = DVec3::new(0.2, -0.1, 0.5);
    let distance = (1.0 - normal.dot(eye)) / normal.dot(direction);
    (distance > 0.0).then(|| (distance, waves(eye + distance * direction)))
}

/// The wall, and a pane a metre away whose edges stand upright.
fn pane(eye: DVec3, direction: DVec3) -> Option<(f64, [f32; 3])> {
    let distance = (1.0 - eye.z) / direction.z;
    let place = eye + distance * direction;
    if (-0.2..0.1).contains(&place.x) && distance > 0.0 {
        Some((distance, [0.9; 3]))
    } else {
        wall(eye, direction)
    }
}

fn front() -> Camera {
    camera(at(DVec3::ZERO, 0.0), 96.0, SIZE)
}

/// Seen from where it was taken an image is itself: kernels and filter blur waves of at least 9 px by 4 % of an amplitude of 0.25 at most.
#[test]
fn an_image_is_itself() {
    let image = image(&front(), &wall);
    let frame = warped(&image, &front());
    assert!(frame.color.iter().all(|pixel| pixel[3] > 0.999));
    let truth: Vec<[f32; 3]> = image.colors.iter().map(|color| color.map(linear_to_srgb)).collect();
    let db = colors_psnr(&shown(&frame), &truth);
    println!("{db:.1} dB");
    assert!(db > 38.0, "{db}");
}

#[test]
fn depths_along_rays_are_depths() {
    let along_axis = image(&front(), &wall);
    let lengths = pixels(&front()).map(|pixel| direction(&front(), pixel + 0.5).length() as f32);
    let depths = along_axis.depths.iter().zip(lengths).map(|(depth, length)| depth * length).collect();
    let along_rays = RgbdImage { depths, kind: DepthKind::AlongRay, ..along_axis.clone() };
    let [a, b] =
        [along_axis, along_rays].map(|image| depth_surfels(&image, &DepthSettings::default()).unwrap());
    for i in 0..a.len() {
        assert!((a.center(i) - b.center(i)).length() < 1e-5 * a.center(i).length(), "{i}");
    }
}

/// No cracks, and at least 35 dB: magnified eight times, minified to an eighth, from the side.
#[test]
fn scales() {
    // The eight times larger picture shows the middle; waves of 0.2 are 9 px in the image, and as many as 1.2 in the small picture.
    let side = at(DVec3::new(0.15, -0.1, 0.2), 0.1);
    let cases = [("magnified", 8.0 * 96.0, SIZE), ("minified", 12.0, [12, 9]), ("as it is", 96.0, SIZE)];
    let wide = camera(at(DVec3::ZERO, 0.0), 8.0 * 96.0, [8 * 128, 8 * 96]);
    let small = camera(at(DVec3::ZERO, 0.0), 96.0, [128, 96]);
    for (name, focal, size) in cases {
        let new = camera(side, focal, size);
        let source = if name == "minified" { &wide } else { &small };
        let new = if name == "minified" { camera(side, 96.0, [128, 96]) } else { new };
        let frame = warped(&image(source, &wall), &new);
        let truth = picture(&new, 0.3, &wall);
        let shown = shown(&frame);
        // What the image shows of the wall, two pixels within.
        let seen: Vec<bool> = pixels(&new)
            .map(|pixel| {
                let ray = direction(&new, pixel + 0.5);
                let (distance, _) = wall(new.pose().eye(), ray).unwrap();
                let place = new.pose().eye() + distance * ray;
                let Intrinsics { focal, center } = source.intrinsics();
                let there = focal * place.truncate() / place.z + center;
                let margin = 2.0 * (focal.x / 96.0).max(1.0);
                let inside =
                    |axis: usize| (margin..f64::from(source.size()[axis]) - margin).contains(&there[axis]);
                inside(0) && inside(1)
            })
            .collect();
        let open = frame.color.iter().zip(&seen).filter(|(pixel, seen)| **seen && pixel[3] < 0.999).count();
        let both = shown.iter().zip(&truth).zip(&seen).filter(|(_, seen)| **seen);
        let db = psnr(both.map(|((a, b), _)| (*a, *b)));
        let count = seen.iter().filter(|seen| **seen).count();
        println!("{name}: {db:.1} dB over {count} pixels, {open} open");
        assert!(count > seen.len() / 2, "{name}: {count}");
        assert_eq!(open, 0, "{name}");
        assert!(db >= 35.0, "{name}: {db}");
    }
}

/// From pixel to pixel the picture changes as what is seen does.
#[test]
fn motion_is_steady() {
    let source = camera(at(DVec3::ZERO, 0.0), 144.0, [192, 120]);
    let image = image(&source, &pane);
    // A pixel a frame at a depth of 2.
    let views: Vec<Camera> = (0..12)
        .map(|k| camera(at(DVec3::new(0.1 + f64::from(k) * 2.0 / 96.0, 0.0, 0.3), 0.02), 96.0, SIZE))
        .collect();
    let frames: Vec<Frame> = views.iter().map(|view| warped(&image, view)).collect();
    let ours: Vec<_> = frames.iter().map(shown).collect();
    let truth: Vec<_> = views.iter().map(|view| picture(view, 0.3, &pane)).collect();
    for (number, pair) in frames.windows(2).enumerate() {
        // Where both frames show something.
        let open = |at: &usize| pair.iter().all(|frame| frame.color[*at][3] > 0.98);
        let change = |pictures: &[Vec<[f32; 3]>]| {
            let seen = (0..pair[0].color.len()).filter(open);
            let mut changes: Vec<f32> = seen
                .map(|at| (0..3).map(|i| (pictures[0][at][i] - pictures[1][at][i]).abs()).fold(0.0, f32::max))
                .collect();
            changes.sort_by(f32::total_cmp);
            let square = changes.iter().map(|c| f64::from(c * c)).sum::<f64>() / changes.len() as f64;
            [square.sqrt(), f64::from(changes[changes.len() * 999 / 1000])]
        };
        let (ours, truth) = (change(&ours[number..]), change(&truth[number..]));
        println!("{number}: rms and 99.9 % {ours:.3?}, really {truth:.3?}");
        assert!((0..2).all(|i| ours[i] <= 2.0 * truth[i]), "{number}: {ours:?} {truth:?}");
    }
}

/// Edges stay where they are, and nothing is stretched from one surface to the other.
#[test]
fn depth_edges() {
    let source = camera(at(DVec3::ZERO, 0.0), 192.0, [192, 120]);
    let image = image(&source, &pane);
    for shift in [0.11, 0.173, -0.12] {
        let eye = DVec3::new(shift, 0.0, 0.0);
        let new = camera(at(eye, 0.0), 192.0, [192, 120]);
        let frame = warped(&image, &new);
        for row in 10..110 {
            let alpha = |x: usize| frame.color[row * 192 + x][3];
            let is_pane = |x: usize| frame.median_depth[row * 192 + x] < 1.2;
            let covered: Vec<usize> = (0..192).filter(|x| is_pane(*x)).collect();
            // From the pane's first sample to its last, as the image has them: pixels that begin at whole numbers of it.
            let edge = |x: f64| {
                let first = (192.0 * x + 96.0 - 0.5).ceil();
                (first - 96.0 - 192.0 * shift) + 96.0
            };
            let [left, right] = [edge(-0.2), edge(0.1)];
            let [first, end] = [covered[0] as f64, covered[covered.len() - 1] as f64 + 1.0];
            assert_eq!(covered.len() as f64, end - first, "{shift}, row {row}: the pane has gaps");
            assert!(
                (first - left).abs() <= 1.0 && (end - right).abs() <= 1.0,
                "{shift}, row {row}: {first}..{end} for {left}..{right}"
            );
            // The wall that the pane hid from the image is not made up: beside it 192 · |shift| · (1 − 1/z) px are open.
            let beside = if shift > 0.0 { right + 2.0..right + 6.0 } else { left - 6.0..left - 2.0 };
            for x in beside.start as usize..beside.end as usize {
                assert!(alpha(x) < 1e-3, "{shift}, row {row}: pixel {x} has {}", alpha(x));
            }
        }
    }
}

/// A red pane before a green wall, and above both a sky, however far: from beside the pane hides the wall.
#[test]
fn what_is_far_leaves_what_is_near_as_it_is() {
    let source = camera(at(DVec3::ZERO, 0.0), 240.0, [256, 128]);
    let new = camera(at(DVec3::new(0.6, 0.0, 0.0), 0.0), 240.0, [256, 128]);
    for sky in [6.0, 1e3, 1e6, 9e9, 1e10, 1e30] {
        let mut image = image(&source, &|_, ray| {
            let is_sky = ray.y < -32.0 / 240.0;
            let is_pane = !is_sky && (-32.0..32.0).contains(&(240.0 * ray.x));
            Some(match (is_sky, is_pane) {
                (true, _) => (sky, [0.0, 0.0, 1.0]),
                (_, true) => (4.0, [1.0, 0.0, 0.0]),
                _ => (6.0, [0.0, 1.0, 0.0]),
            })
        });
        // Nor does it matter how near single pixels seem, where nobody looks here.
        image.depths[..40].fill(1e-6);
        // 0.6 · 240/4 = 36 px farther left than in the image, from 60 to 124. Its edges are cut a pixel wide.
        let frame = warped(&image, &new);
        for x in (50..59).chain(61..123) {
            let [red, green, blue, alpha] = frame.color[80 * 256 + x];
            let is_pane = x > 60;
            let depth = frame.median_depth[80 * 256 + x];
            let wanted = if is_pane { [1.0, 0.0, 4.0] } else { [0.0, 1.0, 6.0] };
            let found = [red, green, depth];
            // Planes are exact; what a kernel leaves beyond two pixels, 4.4 of its σ, is 1e-5, and a layer's mean is as far from its plane.
            let is_off = (0..3).any(|i| (found[i] - wanted[i]).abs() > 0.01);
            assert!(!is_off && blue < 0.01 && alpha > 0.99, "sky at {sky:e}, pixel {x}: {found:?}, {alpha}");
        }
        // From where the image was taken all of it is there, but for a sky that is none.
        let own = warped(&image, &source);
        for (pixel, color) in own.color.iter().enumerate().skip(256) {
            // Along its edge the wall leans into a sky that is none.
            let [is_sky, is_edge] = [pixel / 256 < 29, pixel / 256 < 34];
            if !is_sky && is_edge {
                continue;
            }
            let expected = if is_sky && sky >= 1e10 { 0.0 } else { 1.0 };
            // Known pixels grow by 0.75 pixels into unknown ones, half of the next row and a tenth for unevenness, and leave a hundredth farther: so do near ones.
            let off = match (expected, pixel / 256, pixel % 256) {
                (0.0, 1, ..43) => 0.6,
                (0.0, 2, ..43) => 0.02,
                _ => 0.01,
            };
            assert!((color[3] - expected).abs() < off, "sky at {sky:e}: pixel {pixel} is {color:?}");
        }
    }
}

/// What lies behind the pane is filled from the wall beside it.
#[test]
fn disocclusions_are_filled_from_the_background() {
    let source = camera(at(DVec3::ZERO, 0.0), 192.0, [192, 120]);
    let grey = |eye: DVec3, direction: DVec3| {
        pane(eye, direction)
            .map(|(distance, color)| (distance, if color == [0.9; 3] { color } else { [0.2; 3] }))
    };
    let image = image(&source, &grey);
    let new = camera(at(DVec3::new(0.11, 0.0, 0.0), 0.0), 192.0, [192, 120]);
    let mut frame = warped(&image, &new);
    let open = |frame: &Frame| frame.color.iter().filter(|pixel| pixel[3] < 0.5).count();
    let before = open(&frame);
    let filled = fill_disocclusions(&mut frame);
    println!("{filled} of {before} filled, {} left", open(&frame));
    // 12 px or so beside the pane; what comes in at the right of the picture has nothing on its other side.
    assert_eq!(before - open(&frame), filled);
    assert!(filled > 8 * 100);
    for y in 10..110 {
        for x in 100..150 {
            let at = y * 192 + x;
            assert!(frame.color[at][3] >= 0.98, "{x}, {y}: {:?}", frame.color[at]);
            let truth =
                grey(new.pose().eye(), direction(&new, DVec2::new(x as f64, y as f64) + 0.5)).unwrap();
            let is_wall = truth.0 > 1.2 && frame.median_depth[at] > 1.2;
            if is_wall {
                // The pane's colour is nowhere in it. Beside the pane alone the wall ends: its depth goes on as it is, while it has a
                // slope of 0.2 z in x: over 12 px at a depth of 2, 2.5 %.
                assert!((frame.color[at][0] - 0.2).abs() < 0.02, "{x}, {y}: {:?}", frame.color[at]);
                let depth = f64::from(frame.median_depth[at]);
                assert!((depth / truth.0 - 1.0).abs() < 0.03, "{x}, {y}: {depth} for {}", truth.0);
            }
        }
    }
}

/// A plane of one depth in fifty is a plane again, and a step between two stays one.
#[test]
fn scattered_depths_become_dense() {
    let full = image(&front(), &wall);
    let keep = |at: usize| {
        (at as u32).wrapping_mul(2_654_435_761).rotate_left(15).wrapping_mul(2_246_822_519).is_multiple_of(50)
    };
    let sparse = |image: &RgbdImage| RgbdImage {
        depths: image
            .depths
            .iter()
            .enumerate()
            .map(|(at, depth)| if keep(at) { *depth } else { 0.0 })
            .collect(),
        ..image.clone()
    };
    let dense = sparse(&full).densified().unwrap();
    let known = dense.depths.iter().filter(|depth| **depth > 0.0).count();
    assert!(known > full.depths.len() * 9 / 10, "{known}");
    for (dense, full) in dense.depths.iter().zip(&full.depths).filter(|(dense, _)| **dense > 0.0) {
        // Exact but for rounding: 1/z is linear.
        assert!((dense / full - 1.0).abs() < 1e-5, "{dense} for {full}");
    }
    let steps = sparse(&image(&front(), &pane)).densified().unwrap();
    // The wall begins at a depth of 1.6.
    let between: Vec<f32> =
        steps.depths.iter().copied().filter(|depth| *depth > 1.01 && *depth < 1.6).collect();
    assert!(between.is_empty(), "{} {:?}", between.len(), &between[..9]);
}

/// Two images of one surface cover it once, and the one that has more of it counts for more.
#[test]
fn several_views_share_a_surface() {
    let far = camera(at(DVec3::new(0.1, 0.0, -2.0), 0.0), 96.0, SIZE);
    let near = camera(at(DVec3::new(-0.1, 0.0, 0.3), 0.0), 96.0, SIZE);
    let new = camera(at(DVec3::new(0.0, 0.0, 0.5), 0.0), 120.0, SIZE);
    let images = [image(&near, &wall), image(&far, &wall)];
    let clouds = merged_depth_surfels(&images, &new, &DepthSettings::default()).unwrap();
    let truth = picture(&new, 0.3, &wall);
    let error = |clouds: Vec<Cloud>| {
        let frame = drawn(clouds, &new);
        let inner =
            (0..truth.len()).filter(|at| (10..86).contains(&(at % 96)) && (10..62).contains(&(at / 96)));
        let inner: Vec<usize> = inner.collect();
        assert!(inner.iter().all(|at| frame.color[*at][3] > 0.999));
        let shown = shown(&frame);
        psnr(inner.iter().map(|at| (shown[*at], truth[*at])))
    };
    let alone = |image: &RgbdImage| {
        vec![depth_surfels(image, &DepthSettings::default()).expect("the image is right")]
    };
    let [near_db, far_db, both_db] = [error(alone(&images[0])), error(alone(&images[1])), error(clouds)];
    println!("near {near_db:.1}, far {far_db:.1}, both {both_db:.1} dB");
    assert!(both_db > far_db + 3.0 && both_db > near_db - 3.0, "{near_db} {far_db} {both_db}");
}

/// The room from elsewhere: no hole where a surface goes on, and closer to it than the image's own resampling asks for.
#[test]
fn the_room() {
    let [from, to] = [Room.camera(320).unwrap(), Room.other_camera(320).unwrap()];
    let image = Room.image(&from);
    let frame = warped(&image, &to);
    let target = Room.image(&to);
    let truth: Vec<_> = Room.picture(&to, 8);
    let to_source = from.pose().world_to_camera * to.pose().world_to_camera.inverse();
    let Intrinsics { focal, center } = from.intrinsics();
    let [width, height] = image.size;
    let seen_well = |at: usize| {
        // The nearest nine pixels of the image see the same place.
        let place = DVec2::new((at % width) as f64, (at / width) as f64) + 0.5;
        let p = to_source.transform_point3(target.ray(place) * f64::from(target.depths[at]));
        let there = focal * p.truncate() / p.z + center;
        (-1..=1).all(|dy| {
            (-1..=1).all(|dx| {
                let (x, y) = (there.x.floor() as i64 + dx, there.y.floor() as i64 + dy);
                let inside = (0..width as i64).contains(&x) && (0..height as i64).contains(&y);
                inside && (f64::from(image.depths[(y * width as i64 + x) as usize]) / p.z - 1.0).abs() < 0.03
            })
        })
    };
    let seen: Vec<usize> = (0..width * height).filter(|at| seen_well(*at)).collect();
    let holes = seen.iter().filter(|at| frame.color[**at][3] < 0.98).count();
    let shown = shown(&frame);
    let db = psnr(seen.iter().map(|at| (shown[*at], truth[*at].map(linear_to_srgb))));
    println!("{db:.2} dB over {} pixels, {holes} holes", seen.len());
    assert_eq!(holes, 0);
    assert!(seen.len() > width * height / 2);
    // Cubes' edges, of 120 levels, one pixel in eight: displaced by up to half a pixel, since the image has them by points. Measured 30.1.
    assert!(db > 29.0, "{db}");
}

#[test]
fn wrong_images_are_refused() {
    let right = image(&front(), &wall);
    let error = |spoil: &dyn Fn(&mut RgbdImage)| {
        let mut image = right.clone();
        spoil(&mut image);
        let made = depth_surfels(&image, &DepthSettings::default());
        let error = made.expect_err("it is wrong");
        assert_eq!(image.densified().expect_err("it is wrong").to_string(), error.to_string());
        error
    };
    assert!(matches!(error(&|i| i.size = [0, 72]), DepthError::Camera(_)));
    assert!(matches!(error(&|i| i.size = [usize::MAX, 72]), DepthError::Camera(_)));
    assert!(matches!(error(&|i| i.intrinsics.focal.x = 0.0), DepthError::Camera(_)));
    assert!(matches!(error(&|i| i.intrinsics.center.y = f64::NAN), DepthError::Camera(_)));
    assert!(matches!(error(&|i| i.pose.world_to_camera.matrix3 *= 2.0), DepthError::Camera(_)));
    assert!(matches!(error(&|i| i.size = [72, 72]), DepthError::Length { array: "colours", .. }));
    assert!(matches!(error(&|i| i.depths.truncate(5)), DepthError::Length { array: "depths", .. }));
    assert_eq!(error(&|i| i.colors[100] = [f32::NAN; 3]), DepthError::Color { column: 4, row: 1 });
    assert_eq!(error(&|i| i.depths.fill(-1.0)), DepthError::NoDepth);
    assert_eq!(error(&|i| i.depths.fill(1e-40)), DepthError::NoDepth, "no inverse is finite");
}

/// What a sampler and clouds keep of other images, of other sizes and numbers, isn't seen.
#[test]
fn a_kept_sampler_makes_what_a_new_one_does() {
    let views = [80, 41, 80, 96].map(|width| Room.camera(width).expect("a camera"));
    let images = views.each_ref().map(|view| Room.image(view));
    let mut holes = images[2].clone();
    for at in (0..holes.depths.len()).filter(|at| at % 3 == 0 || *at > 2000) {
        holes.depths[at] = f32::NAN;
    }
    let [first, small, _, large] = images;
    let sequences = [
        vec![first.clone()],
        vec![holes.clone()],
        vec![small.clone(), first],
        vec![large, holes],
        vec![small],
    ];
    let (mut sampler, mut clouds) = (DepthSampler::default(), Vec::new());
    for images in sequences {
        sampler.sample(&mut clouds, &images, &views[0], &DepthSettings::default()).unwrap();
        let new = merged_depth_surfels(&images, &views[0], &DepthSettings::default()).unwrap();
        assert!(clouds == new, "{:?}", images.iter().map(|image| image.size).collect::<Vec<_>>());
        // Nor is what couldn't be made.
        let wrong =
            [images[0].clone(), RgbdImage { depths: vec![0.0; images[0].depths.len()], ..images[0].clone() }];
        let refused = sampler.sample(&mut clouds, &wrong, &views[0], &DepthSettings::default());
        assert_eq!((refused, clouds.len()), (Err(DepthError::NoDepth), 0));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever the depths are, there is a surfel for each that is one, and a picture.
    #[test]
    fn any_depths_are_drawn(depths in prop::collection::vec(depth(), 12 * 9), filled in any::<bool>()) {
        let source = camera(at(DVec3::ZERO, 0.0), 12.0, [12, 9]);
        let image = RgbdImage { depths, ..image(&source, &wall) };
        let known = image.depths.iter().filter(|depth| **depth > 0.0 && **depth < 1e10).count();
        let made = depth_surfels(&image, &DepthSettings::default());
        if known == 0 {
            prop_assert_eq!(made.err(), Some(DepthError::NoDepth));
            return Ok(());
        }
        let Ok(cloud) = made else {
            // Beyond what areas can be in single precision.
            prop_assert!(image.depths.iter().any(|depth| *depth < 1e-15 && *depth > 0.0));
            return Ok(());
        };
        prop_assert_eq!(cloud.len(), known);
        let mut frame = drawn(vec![cloud], &camera(at(DVec3::new(0.1, 0.0, 0.0), 0.1), 12.0, [16, 12]));
        if filled {
            fill_disocclusions(&mut frame);
        }
        prop_assert!(frame.color.iter().all(|pixel| pixel.iter().all(|c| c.is_finite())));
        let dense = image.densified().unwrap();
        prop_assert!(dense.depths.iter().all(|depth| depth.is_finite() && *depth >= 0.0));
    }
}

/// Depths, and what sensors give for them.
fn depth() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => 0.5_f32..5.0,
        2 => Just(0.0_f32),
        1 => prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(-1.0), Just(65.535), Just(1e-30), Just(1e30), Just(f32::MAX)],
    ]
}
