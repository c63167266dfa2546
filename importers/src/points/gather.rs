//! Points as readers find them to a cloud.

use crate::file::File;
use crate::{Content, ImportError, Note, Opened, Place};
use glam::{DVec3, Vec3};
use oblate_engine::color::srgb_to_linear;
use oblate_surfels::PointCloud;

/// What points of a file have besides their places.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Has {
    pub(crate) colors: bool,
    pub(crate) intensities: bool,
    pub(crate) normals: bool,
    pub(crate) radii: bool,
}

/// A point; what the file's points haven't is not looked at.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Point {
    pub(crate) position: DVec3,
    /// In any unit until [`Gather::decode_colors`].
    pub(crate) color: [f32; 3],
    pub(crate) intensity: f32,
    pub(crate) normal: Vec3,
    pub(crate) radius: f32,
}

/// Puts points together.
pub(crate) struct Gather {
    cloud: PointCloud,
    not_finite: usize,
    /// The farthest that rounding to single precision moved a coordinate.
    moved: f64,
    pub(crate) notes: Vec<Note>,
}

impl Gather {
    /// With room for `count` points, which must have been compared with the size of the file.
    pub(crate) fn new(count: usize, has: Has) -> Self {
        fn room<T>(has: bool, count: usize) -> Option<Vec<T>> {
            has.then(|| Vec::with_capacity(count))
        }
        let cloud = PointCloud {
            positions: Vec::with_capacity(count),
            colors: room(has.colors, count),
            intensities: room(has.intensities, count),
            normals: room(has.normals, count),
            radii: room(has.radii, count),
            ..PointCloud::default()
        };
        Self { cloud, not_finite: 0, moved: 0.0, notes: Vec::new() }
    }

    pub(crate) fn put(&mut self, point: &Point) {
        let cloud = &mut self.cloud;
        let origin = if cloud.positions.is_empty() { point.position.trunc() } else { cloud.origin };
        let position = (point.position - origin).as_vec3();
        let color = cloud.colors.is_none() || point.color.iter().all(|c| c.is_finite());
        let intensity = cloud.intensities.is_none() || point.intensity.is_finite();
        if !(position.is_finite() && color && intensity) {
            self.not_finite += 1;
            return;
        }
        let exact = point.position - origin;
        self.moved = self.moved.max((exact - position.as_dvec3()).abs().max_element());
        cloud.origin = origin;
        cloud.positions.push(position);
        cloud.colors.iter_mut().for_each(|colors| colors.push(point.color));
        cloud.intensities.iter_mut().for_each(|intensities| intensities.push(point.intensity));
        let normal = if point.normal.is_finite() { point.normal } else { Vec3::ZERO };
        cloud.normals.iter_mut().for_each(|normals| normals.push(normal));
        let radius = if point.radius.is_finite() { point.radius } else { 0.0 };
        cloud.radii.iter_mut().for_each(|radii| radii.push(radius));
    }

    /// The largest of all colours' channels; 0 without any.
    pub(crate) fn brightest(&self) -> f32 {
        self.cloud.colors.iter().flatten().flatten().copied().fold(0.0, f32::max)
    }

    /// The smallest of all colours' channels, if that is below 0.
    pub(crate) fn darkest(&self) -> f32 {
        self.cloud.colors.iter().flatten().flatten().copied().fold(0.0, f32::min)
    }

    /// The least of `whites`, which rise, that no colour exceeds.
    pub(crate) fn white(&self, whites: &[f32]) -> Option<f32> {
        let brightest = self.brightest();
        whites.iter().copied().find(|white| brightest <= *white)
    }

    /// Makes display-encoded colours linear, `white` being the value of the brightest; without one they are none.
    pub(crate) fn decode_colors(&mut self, white: Option<f32>) {
        match (white, &mut self.cloud.colors) {
            (Some(white), Some(colors)) => {
                colors.iter_mut().flatten().for_each(|channel| *channel = srgb_to_linear(*channel / white));
            }
            (_, colors) => *colors = None,
        }
    }

    /// Where the scanner stood.
    pub(crate) fn set_viewpoint(&mut self, viewpoint: DVec3) {
        self.cloud.viewpoint = Some(viewpoint);
    }

    /// The cloud, if there is a point.
    pub(crate) fn finish(mut self, file: &File) -> Result<Opened, ImportError> {
        if self.not_finite > 0 {
            let of = self.not_finite + self.cloud.positions.len();
            let what = format!("{} of {of} points, with numbers that are not finite", self.not_finite);
            self.notes.push(Note::LeftOut(what));
        }
        if self.cloud.positions.is_empty() {
            let left_out: Vec<String> = self.notes.iter().map(Note::to_string).collect();
            let why = if left_out.is_empty() { "it has 0 rows".into() } else { left_out.join("; ") };
            let problem = format!("there are no points in it, at least one is needed: {why}");
            return Err(file.malformed(Place::Whole, problem));
        }
        let spacing = spacing(&self.cloud.positions);
        if spacing > 0.0 && self.moved > VISIBLE * spacing {
            let what = format!(
                "places, by up to {:.1e} where points are about {spacing:.1e} apart: they are kept in single precision, as \
                 distances from the first point",
                self.moved
            );
            self.notes.push(Note::Rounded(what));
        }
        Ok(Opened::noting(Content::Points(self.cloud), self.notes))
    }
}

/// Share of their spacing that points may be moved by without a word.
const VISIBLE: f64 = 0.01;

/// About how far apart points of a surface are that lies within the middle 98 % of each coordinate: strays don't count.
fn spacing(positions: &[Vec3]) -> f64 {
    let extent = |axis: usize| {
        let mut values: Vec<f32> = positions.iter().map(|position| position[axis]).collect();
        let (low, high) = (values.len() / 100, values.len() - 1 - values.len() / 100);
        let low = *values.select_nth_unstable_by(low, f32::total_cmp).1;
        let high = *values.select_nth_unstable_by(high, f32::total_cmp).1;
        f64::from(high) - f64::from(low)
    };
    extent(0).max(extent(1)).max(extent(2)) / (positions.len() as f64).sqrt()
}
