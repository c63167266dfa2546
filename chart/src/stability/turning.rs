//! Case 4: turning.

use super::setups::*;
use super::{Case, Findings};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use oblate_engine::{Camera, Cloud, Frame, OpacityFilter, Order, ReferenceKind, Shapes, Strength};

pub(super) const CASE: Case = Case {
    number: 4,
    title: "Turning",
    criterion: "Three elongated splats go through one another, all centres at one depth, an optical depth of 1 each, in red, green and blue; they turn by 90° in steps of 0.05°. No pixel changes in a step by more than 2/255 beyond what the truth's changes by; nor does a checker box whose view crosses 45°. Trained Gaussians are defined by the order of their centres and pop in the default, too: by 0.2.",
    run,
};

const SLABS: Order = Order::Slabs { thickness: Order::THICKNESS };
/// A sheet for each layer of a lattice as [`fog`] makes it.
const SHEETS: Order = Order::AxisSheets { spacing: 1.0 / 0.7 };
const SIDE: u32 = 16;

/// How a frame is made.
#[derive(Clone, Copy)]
enum How {
    Truth,
    Default,
    In(Order),
}

fn frame(how: How, cloud: Cloud, camera: &Camera) -> Frame {
    let scene = scene(vec![cloud]);
    match how {
        How::Truth => truth(&scene, camera, &nothing_but(SLABS), ReferenceKind::R1),
        How::Default => draw(&scene, camera, &unshaded()),
        How::In(order) => draw(&scene, camera, &ordered(order)),
    }
}

/// The largest change of a channel from each frame to the next.
fn changes(frames: impl Iterator<Item = Frame>) -> Vec<f64> {
    let mut last: Option<Frame> = None;
    let mut changes = Vec::new();
    for frame in frames {
        changes.extend(last.as_ref().map(|last| apart(last, &frame).max_error));
        last = Some(frame);
    }
    changes
}

/// A star of three needles that faces the camera after half of its turn.
fn star(is_trained: bool) -> Cloud {
    let shape = |i: usize| {
        let angle = i as f32 * std::f32::consts::PI / 3.0;
        Mat3::from_rotation_z(angle) * Mat3::from_diagonal(Vec3::new(0.45, 0.12, 0.12))
    };
    let factors: Vec<Mat3> = (0..3).map(shape).collect();
    let strength = if is_trained {
        let peaks = vec![1.0 - (-1f32).exp(); 3];
        Strength::Opacity { peaks, filter: OpacityFilter::Compensated, least: 0.0 }
    } else {
        Strength::Extinction { masses: factors.iter().map(|factor| mass_of(1.0, *factor)).collect() }
    };
    let colors = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    splats([-0.2, 0.0, 0.2].map(|x| Vec3::X * x).to_vec(), Shapes::Each(factors), strength, colors)
}

/// Turns it by 90° in steps of 0.05°: what each step changes.
fn turn(how: How, is_trained: bool) -> Vec<f64> {
    let camera = looking_from(DVec3::NEG_Z * 5.0, SIDE);
    let star = star(is_trained);
    let angles = (-900..=900).map(|step| (0.05 * f64::from(step)).to_radians());
    // Askew, so that nothing is symmetric.
    let turned = |angle| DMat3::from_rotation_x(0.3) * DMat3::from_rotation_y(angle);
    changes(
        angles.map(|angle| frame(how, star.clone().transformed(DAffine3::from_mat3(turned(angle))), &camera)),
    )
}

/// 16³ kernels in cubes of 4³ that alternate, seen so many degrees off an axis.
fn box_turn(how: How, angles: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut splats = fog([16; 3], DVec3::ONE, 0.25, [0.0; 3]).splats();
    let cube = |x: f32| (x / 4.0 + 100.0).floor() as i32;
    let color = |p: &Vec3| {
        if (cube(p.x) + cube(p.y) + cube(p.z)) % 2 == 0 { [0.9, 0.7, 0.1] } else { [0.1, 0.2, 0.6] }
    };
    splats.colors = splats.centers.iter().map(color).collect();
    let checkers = Cloud::new(splats).expect("colours are in range");
    changes(angles.map(|degrees| {
        let angle = degrees.to_radians();
        let camera = looking_from(DVec3::new(-angle.sin() * 48.0, 12.0, -angle.cos() * 48.0), 8);
        frame(how, checkers.clone(), &camera)
    }))
}

/// By how much two round splats, white and black, change a pixel when turning by 0.1° puts the other one's centre in front.
fn swap(how: How, depth: f32, is_trained: bool) -> f64 {
    let strength = if is_trained {
        Strength::Opacity {
            peaks: vec![1.0 - (-depth).exp(); 2],
            filter: OpacityFilter::Compensated,
            least: 0.0,
        }
    } else {
        Strength::Extinction { masses: vec![mass_of(depth, Mat3::IDENTITY); 2] }
    };
    let centers = vec![Vec3::X * -0.05, Vec3::X * 0.05];
    let pair = splats(centers, Shapes::Shared(Mat3::IDENTITY), strength, vec![[1.0; 3], [0.0; 3]]);
    // An odd number of pixels, so that one sees both centres.
    let camera = looking_from(DVec3::NEG_Z * 20.0, 41);
    let frames = [-0.05_f64, 0.05].map(|degrees| {
        let turn = DAffine3::from_rotation_y(degrees.to_radians());
        frame(how, pair.clone().transformed(turn), &camera)
    });
    apart(&frames[0], &frames[1]).max_error
}

/// A way to draw a turn, and the splats.
struct Way {
    name: &'static str,
    role: Role,
    how: How,
    is_trained: bool,
}

impl Way {
    /// Trained Gaussians are defined by the order of their centres.
    fn pops(&self) -> bool {
        self.is_trained || self.role == Role::Baseline
    }
}

const fn way(name: &'static str, role: Role, how: How, is_trained: bool) -> Way {
    Way { name, role, how, is_trained }
}

const WAYS: [Way; 5] = [
    way("truth", Role::Truth, How::Truth, false),
    way("default", Role::Default, How::Default, false),
    way("by depth in each pixel", Role::Baseline, How::In(Order::PerPixel), false),
    way("sorted centres", Role::Baseline, How::In(Order::Centers), false),
    way("default, trained Gaussians", Role::Default, How::Default, true),
];

fn run() -> Findings {
    let turns = WAYS.map(|way| (turn(way.how, way.is_trained), way));
    // Angles of 1.5° at a time, in which a pop is one of thirty steps.
    let curve = |(changes, way): &(Vec<f64>, Way)| {
        let points = changes.chunks(30).enumerate();
        let points =
            points.map(|(i, some)| [-45.0 + 1.5 * i as f64 + 0.75, largest(some.iter().copied()).max(FLOOR)]);
        Curve::new(way.name, way.role, points)
    };
    let y = || Axis::log("largest change of a channel in a step");
    let least = largest(turns[0].0.iter().copied());
    let turning = Panel {
        title: "Three needles through one another turn".into(),
        x: Axis::linear("angle, degrees"),
        y: y(),
        bound: Some(least + 2.0 * LEVEL),
        curves: turns.iter().map(curve).collect(),
    };

    let depths = || ratios(24, [0.03, 5.0]);
    let popping = |way: &Way| {
        let points = depths().map(|depth| [depth, swap(way.how, depth as f32, way.is_trained).max(FLOOR)]);
        Curve::new(way.name, way.role, points)
    };
    let estimate = depths().map(|depth| [depth, (-depth).exp_m1().powi(2)]);
    let estimate = Curve::new("α₁α₂|Δc|", Role::Estimate, estimate);
    let swapping = Panel {
        title: "Two splats whose order of centres changes, white and black".into(),
        x: Axis::log("optical depth of each"),
        y: Axis::log("change of a channel"),
        bound: Some(2.0 * LEVEL),
        curves: WAYS.iter().map(popping).chain([estimate.clone()]).collect(),
    };
    let off = swapping.curves[3].points.iter().zip(&estimate.points);
    let off = largest(off.map(|(found, estimate)| (found[1] / estimate[1] - 1.0).abs()));

    let angles = || steps(15, [44.65, 45.35]);
    let boxes = [
        ("truth", Role::Truth, How::Truth),
        ("default", Role::Default, How::Default),
        ("sorted centres", Role::Baseline, How::In(Order::Centers)),
        ("sheets across an axis (EWA)", Role::Baseline, How::In(SHEETS)),
    ]
    .map(|(name, role, how)| (name, role, box_turn(how, angles())));
    let box_least = largest(boxes[0].2.iter().copied());
    let crossing = Panel {
        title: "A checker box turns by 0.05° a step past 45°".into(),
        x: Axis::linear("angle, degrees"),
        y: y(),
        bound: Some(box_least + 2.0 * LEVEL),
        curves: boxes
            .iter()
            .map(|(name, role, changes)| {
                Curve::new(*name, *role, angles().skip(1).zip(changes).map(|(x, y)| [x, y.max(FLOOR)]))
            })
            .collect(),
    };

    let mut verdicts = Vec::new();
    for (changes, way) in &turns[1..] {
        let found = largest(changes.iter().copied()) - least;
        let verdict =
            at_most(way.role, way.name, "needles: largest step beyond the truth's", found, 2.0 * LEVEL);
        verdicts.push(if way.pops() { failing(verdict) } else { verdict });
    }
    for (name, role, changes) in &boxes[1..] {
        let found = largest(changes.iter().copied()) - box_least;
        let verdict =
            at_most(*role, name, "checker box: largest step beyond the truth's", found, 2.0 * LEVEL);
        verdicts.push(if name.starts_with("sheets") { failing(verdict) } else { verdict });
    }
    verdicts.push(at_most(Role::Estimate, "α₁α₂|Δc|", "off what sorted centres jump by, share", off, 0.05));
    Findings { panels: vec![turning, swapping, crossing], verdicts }
}
