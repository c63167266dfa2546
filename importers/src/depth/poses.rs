//! Files to poses.

use crate::file::{File, quoted};
use crate::{ImportError, Place};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use oblate_engine::Pose;
use std::path::Path;

/// Which picture a pose belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stamp {
    /// The file says nothing: it is the one that the file's name says, or they are in the order of the pictures.
    Unsaid,
    /// When it was taken, in seconds; finite.
    Time(f64),
    /// Its number.
    Frame(u64),
}

/// Where the camera stood when a picture was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedPose {
    /// Which picture it was.
    pub stamp: Stamp,
    /// Where the camera stood.
    pub pose: Pose,
}

/// How far entries of RᵀR may be from those of the identity: axes that are 1e-3 longer or shorter, or 1e-3 from a right angle, are as many digits
/// as files have. Beyond it is no rotation that was rounded.
const ROUNDED: f64 = 2e-3;

/// Numbers of a line, at most: more are counted only.
const COLUMNS: usize = 8;

/// Reads poses, all of them from the camera to the world, with x right, y down, z forward in camera space:
///
/// | lines | format |
/// |---|---|
/// | four of four numbers | matrices, row by row, of 7-Scenes (`frame-000000.pose.txt`); several one after the other |
/// | eight numbers | TUM's trajectories: time, position, quaternion x y z w |
/// | three whole numbers, then four lines of four | logs of Redwood, Open3D, Tanks and Temples: the first number is the frame's; the second must be the same, the third says nothing |
///
/// Empty lines, and those that begin with `#`, say nothing. Rotations that are rounded off by up to 1e-3 become the nearest ones.
///
/// # Errors
/// When the file cannot be read, is none of the above or has no poses; with the line where a number is none or not finite, or a matrix is no rigid
/// motion: scaled, sheared or mirrored, or one that was lost, of which 7-Scenes says so by numbers that are none.
pub fn read_poses(path: impl AsRef<Path>) -> Result<Vec<TimedPose>, ImportError> {
    let file = File::read(path.as_ref())?;
    let mut lines = Lines { file: &file, lines: file.text().split(|&b| b == b'\n').enumerate() };
    let (mut poses, mut columns) = (Vec::new(), None);
    while let Some(line) = lines.next()? {
        let columns = *columns.get_or_insert(line.length);
        let (stamp, pose) = match columns {
            _ if line.length != columns => {
                let problem = format!("{} numbers; poses before it begin with {columns}", line.length);
                return Err(file.malformed(Place::Line(line.number), problem));
            }
            4 => (Stamp::Unsaid, matrix(&mut lines, &line)?),
            3 => {
                let frame = frame(&file, &line)?;
                let Some(first) = lines.next()? else {
                    let problem = "a matrix of four lines follows; the file ends here";
                    return Err(file.malformed(Place::Line(line.number), problem));
                };
                (frame, matrix(&mut lines, &first)?)
            }
            8 => moment(&file, &line)?,
            _ => {
                let feature = format!(
                    "{columns} numbers; poses are 4x4 matrices, trajectories of TUM (8) or logs of Redwood (3 before a matrix)"
                );
                return Err(file.unsupported(Place::Line(line.number), feature));
            }
        };
        poses.push(TimedPose { stamp, pose });
    }
    if poses.is_empty() {
        return Err(file.malformed(Place::Whole, "there are no poses in it, at least one is needed"));
    }
    Ok(poses)
}

/// The stamp of a log's matrix.
fn frame(file: &File, line: &Line) -> Result<Stamp, ImportError> {
    let [first, second, _] = [0, 1, 2].map(|column| line.numbers[column]);
    let whole = |number: f64| number >= 0.0 && number.fract() == 0.0 && number <= f64::from(u32::MAX);
    if !(whole(first) && whole(second)) {
        let problem = format!("{first} and {second}; a log has the number of a frame, twice, from 0 on");
        return Err(file.malformed(Place::Line(line.number), problem));
    }
    if first != second {
        let feature = format!("a motion between {first} and {second}; poses have the same number twice");
        return Err(file.unsupported(Place::Line(line.number), feature));
    }
    Ok(Stamp::Frame(first as u64))
}

/// A line of a trajectory.
fn moment(file: &File, line: &Line) -> Result<(Stamp, Pose), ImportError> {
    let [time, x, y, z, qx, qy, qz, qw] = line.numbers;
    let turn = DQuat::from_xyzw(qx, qy, qz, qw);
    let length = turn.length();
    if (length - 1.0).abs() > 0.5 * ROUNDED {
        let problem = format!("a quaternion of length {length}; rotations have 1");
        return Err(file.malformed(Place::Line(line.number), problem));
    }
    let to_world = DAffine3::from_rotation_translation(turn.normalize(), DVec3::new(x, y, z));
    Ok((Stamp::Time(time), Pose { world_to_camera: to_world.inverse() }))
}

/// The matrix that begins with `first`.
fn matrix<'a>(
    lines: &mut Lines<'a, impl Iterator<Item = (usize, &'a [u8])>>,
    first: &Line,
) -> Result<Pose, ImportError> {
    let file = lines.file;
    let mut rows = [[0.0; 4]; 4];
    let mut line = *first;
    for (index, row) in rows.iter_mut().enumerate() {
        if index > 0 {
            let Some(next) = lines.next()? else {
                let problem = format!("a matrix ends after {index} of four lines");
                return Err(file.malformed(Place::Line(line.number), problem));
            };
            line = next;
        }
        if line.length != row.len() {
            let problem = format!("{} numbers; a line of a 4x4 matrix has 4", line.length);
            return Err(file.malformed(Place::Line(line.number), problem));
        }
        row.copy_from_slice(&line.numbers[..4]);
    }
    let malformed = |number: usize, problem: String| Err(file.malformed(Place::Line(number), problem));
    if rows[3].iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(found, right)| (found - right).abs() > 1e-6) {
        return malformed(line.number, format!("{:?}; the last line of a rigid motion is 0 0 0 1", rows[3]));
    }
    let axes = DMat3::from_cols_array_2d(&[0, 1, 2].map(|row| [0, 1, 2].map(|column| rows[row][column])))
        .transpose();
    let gram = axes.transpose() * axes;
    let off =
        (gram - DMat3::IDENTITY).to_cols_array().into_iter().fold(0.0, |most: f64, o| most.max(o.abs()));
    if !gram.is_finite() || off > ROUNDED {
        let lengths = [gram.x_axis.x, gram.y_axis.y, gram.z_axis.z].map(f64::sqrt);
        let problem = format!(
            "the matrix is no rotation: its columns have the lengths {lengths:.4?} and RᵀR is {off:.4} off the identity; 1 and 0 are right"
        );
        return malformed(first.number, problem);
    }
    if axes.determinant() < 0.0 {
        return malformed(first.number, "the matrix mirrors; a rigid motion has the determinant 1".into());
    }
    let to_world = DAffine3 {
        matrix3: nearest_rotation(axes),
        translation: DVec3::new(rows[0][3], rows[1][3], rows[2][3]),
    };
    Ok(Pose { world_to_camera: to_world.inverse() })
}

/// The rotation nearest to one that was rounded, by Newton's iteration for the polar factor [Higham, *Computing the Polar Decomposition*, 1986],
/// R ← (R + R⁻ᵀ)/2: each step squares the error, so that 1e-3 is 1e-6, 1e-12 and nothing.
fn nearest_rotation(axes: DMat3) -> DMat3 {
    (0..4).fold(axes, |near, _| (near + near.inverse().transpose()) * 0.5)
}

/// The numbers of a line.
#[derive(Clone, Copy)]
struct Line {
    /// The first is 1.
    number: usize,
    numbers: [f64; COLUMNS],
    length: usize,
}

/// Lines with numbers.
struct Lines<'a, L> {
    file: &'a File,
    lines: L,
}

impl<'a, L: Iterator<Item = (usize, &'a [u8])>> Lines<'a, L> {
    fn next(&mut self) -> Result<Option<Line>, ImportError> {
        for (index, text) in self.lines.by_ref() {
            if text.trim_ascii_start().starts_with(b"#") {
                continue;
            }
            let mut line = Line { number: index + 1, numbers: [0.0; COLUMNS], length: 0 };
            for word in text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()) {
                let number = str::from_utf8(word).ok().and_then(|word| word.parse().ok());
                let Some(number) = number.filter(|number: &f64| number.is_finite()) else {
                    let problem = format!("{} is no finite number", quoted(&String::from_utf8_lossy(word)));
                    return Err(self.file.malformed(Place::Line(line.number), problem));
                };
                if let Some(place) = line.numbers.get_mut(line.length) {
                    *place = number;
                }
                line.length += 1;
            }
            if line.length > 0 {
                return Ok(Some(line));
            }
        }
        Ok(None)
    }
}
