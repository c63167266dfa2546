//! From where surfaces are closed.

use crate::clip::HalfSpace;
use crate::cloud::{CloudError, wrong};
use glam::{DAffine3, DVec3};

/// From where a surface is closed: what of its splats faces away from an eye there is not drawn.
///
/// Whoever is outside of a body sees its fronts alone: an eye outside of the box around it is, and its near plane, too, if that doesn't cut the box.
/// The box is that around its splats' centres, and reaches to the planes at which the body ends.
/// Of a body that ends at planes, as an iso-surface does at the border of its grid,
/// backs are seen through those planes only: a ray that begins within all of the half-spaces leaves each at most once, so it enters the
/// body through a front.
#[derive(Clone, Debug, PartialEq)]
pub enum Closed {
    /// Backs may be seen from anywhere, and neighbours may face opposite ways: of points, and of meshes whose triangles turn to and fro. All of them
    /// count as fronts where they cover a pixel together.
    Nowhere,
    /// Backs may be seen from anywhere, but neighbours face the same way. So a front and a back are neighbours only where the sheet folds back from the
    /// eye, and there one hides the other up to the same line: a pixel in which both end is covered as far as by either, not by both together.
    Sided,
    /// Nobody outside of the body and within all of the half-spaces, in the space of the splats, sees backs. Where there are no
    /// half-spaces that is everybody outside.
    Within(Vec<HalfSpace>),
    /// Backs are not shown, wherever the eye is: of a sheet that has one side only, as a depth image and one-sided materials have.
    OneSided,
}

impl Closed {
    /// A closed body.
    pub const EVERYWHERE: Self = Self::Within(Vec::new());

    /// Whether backs are seen from nowhere outside.
    pub fn is_everywhere(&self) -> bool {
        matches!(self, Self::OneSided) || *self == Self::EVERYWHERE
    }

    /// Of a surface made of this one and another.
    #[must_use]
    pub fn and(self, other: &Self) -> Self {
        match (self, other) {
            (Self::Within(mut own), Self::Within(others)) => {
                let new = others.iter().filter(|plane| !own.contains(plane)).copied().collect::<Vec<_>>();
                own.extend(new);
                Self::Within(own)
            }
            (Self::OneSided, Self::OneSided) => Self::OneSided,
            (Self::Nowhere, _) | (_, Self::Nowhere) => Self::Nowhere,
            _ => Self::Sided,
        }
    }

    /// Whether neighbours face the same way.
    pub(crate) fn has_sides(&self) -> bool {
        *self != Self::Nowhere
    }

    /// Whether there is an eye that no backs are shown to.
    pub(crate) fn hides_backs(&self) -> bool {
        matches!(self, Self::Within(_) | Self::OneSided)
    }

    /// Whether no backs are seen by a camera at the origin that looks along z, outside of the body; where rays are parallel by one far behind
    /// it.
    pub(crate) fn is_for(&self, camera_to_cloud: &DAffine3, is_perspective: bool) -> bool {
        let (eye, nearness) = if is_perspective {
            (camera_to_cloud.translation, 1.0)
        } else {
            (camera_to_cloud.matrix3 * DVec3::NEG_Z, 0.0)
        };
        match self {
            Self::Nowhere | Self::Sided => false,
            Self::OneSided => true,
            Self::Within(planes) => {
                planes.iter().all(|plane| plane.normal.dot(eye) >= plane.offset * nearness)
            }
        }
    }

    /// The corners of a box around a body by those of the box around its surface: it reaches to the planes that it ends at.
    pub(crate) fn around(&self, [low, high]: [DVec3; 2]) -> [DVec3; 2] {
        let Self::Within(planes) = self else { return [low, high] };
        planes.iter().fold([low, high], |[low, high], plane| {
            let onto = |corner: DVec3| {
                let beyond = plane.normal.dot(corner) - plane.offset;
                corner - plane.normal * (beyond / plane.normal.length_squared())
            };
            let corner =
                |number: usize| DVec3::from([0, 1, 2].map(|axis| [low, high][number >> axis & 1][axis]));
            (0..8).map(corner).map(onto).fold([low, high], |[low, high], p| [low.min(p), high.max(p)])
        })
    }

    /// Of a surface that is moved.
    #[must_use]
    pub fn translated(mut self, by: DVec3) -> Self {
        if let Self::Within(planes) = &mut self {
            planes.iter_mut().for_each(|plane| plane.offset += plane.normal.dot(by));
        }
        self
    }

    pub(crate) fn check(&self) -> Result<(), CloudError> {
        let Self::Within(planes) = self else { return Ok(()) };
        let is_right = |plane: &HalfSpace| {
            plane.normal.is_finite() && plane.normal != DVec3::ZERO && plane.offset.is_finite()
        };
        match planes.iter().find(|plane| !is_right(plane)) {
            Some(plane) => {
                let expected = "a half-space has a finite normal that is not zero, and a finite offset";
                Err(wrong(0, "ends", format!("{plane:?}"), expected))
            }
            None => Ok(()),
        }
    }
}

impl From<bool> for Closed {
    fn from(is_closed: bool) -> Self {
        if is_closed { Self::EVERYWHERE } else { Self::Nowhere }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    fn looking_along_z_from(eye: DVec3) -> DAffine3 {
        DAffine3::from_mat3_translation(DMat3::IDENTITY, eye)
    }

    #[test]
    fn backs_are_seen_through_planes_alone() {
        let above = HalfSpace { normal: DVec3::new(0.0, 0.0, 2.0), offset: 2.0 };
        let right = HalfSpace { normal: DVec3::X, offset: -1.0 };
        let closed = Closed::Within(vec![above, right]);
        for (eye, expected) in [
            (DVec3::new(0.0, 9.0, 1.5), true),
            (DVec3::new(0.0, 9.0, 0.5), false),
            (DVec3::new(-2.0, 9.0, 1.5), false),
        ] {
            let camera = looking_along_z_from(eye);
            assert_eq!(closed.is_for(&camera, true), expected, "{eye}");
            // Its rays come from below the plane, wherever it is.
            assert!(!closed.is_for(&camera, false), "{eye}");
            let by = DVec3::new(3.0, 4.0, 5.0);
            let moved = looking_along_z_from(eye + by);
            assert_eq!(closed.clone().translated(by).is_for(&moved, true), expected, "{eye}");
            assert!(Closed::EVERYWHERE.is_for(&camera, true) && !Closed::Sided.is_for(&camera, true));
        }
        let downwards = DAffine3::from_axis_angle(DVec3::X, std::f64::consts::PI);
        assert!(closed.is_for(&downwards, false));
        let along_x = DAffine3::from_axis_angle(DVec3::Y, std::f64::consts::FRAC_PI_2);
        assert!(!Closed::Within(vec![right]).is_for(&along_x, false));
        // Rays along a plane don't go through it.
        let beside = HalfSpace { normal: DVec3::Y, offset: 5.0 };
        assert!(Closed::Within(vec![beside]).is_for(&along_x, false));
    }

    #[test]
    fn parts_end_where_each_of_them_does() {
        let plane = |x: f64| HalfSpace { normal: DVec3::X, offset: x };
        let [a, b] = [1.0, 2.0].map(|x| Closed::Within(vec![plane(x)]));
        assert_eq!(a.clone().and(&b), Closed::Within(vec![plane(1.0), plane(2.0)]));
        assert_eq!(a.clone().and(&a), a);
        assert_eq!(Closed::EVERYWHERE.and(&b), b);
        assert_eq!(a.and(&Closed::Sided), Closed::Sided);
        assert_eq!(Closed::OneSided.and(&Closed::Nowhere), Closed::Nowhere);
    }

    #[test]
    fn a_body_reaches_to_the_planes_at_which_it_ends() {
        // A hilly ground over z = 0, which goes on to x = 9.
        let ground = HalfSpace { normal: DVec3::Z * 2.0, offset: 0.0 };
        let side = HalfSpace { normal: DVec3::NEG_X, offset: -9.0 };
        let surface = [DVec3::new(1.0, 1.0, 3.0), DVec3::new(8.0, 5.0, 4.0)];
        let around = |closed: Closed| closed.around(surface);
        let body = around(Closed::Within(vec![ground, side]));
        assert_eq!(body, [DVec3::new(1.0, 1.0, 0.0), DVec3::new(9.0, 5.0, 4.0)]);
        assert_eq!(around(Closed::EVERYWHERE), surface);
        assert_eq!(around(Closed::OneSided), surface);
    }

    #[test]
    fn wrong_planes_are_refused() {
        for (normal, offset) in [(DVec3::ZERO, 0.0), (DVec3::NAN, 0.0), (DVec3::X, f64::INFINITY)] {
            let closed = Closed::Within(vec![HalfSpace { normal, offset }]);
            assert!(closed.check().is_err(), "{normal} {offset}");
        }
    }
}
