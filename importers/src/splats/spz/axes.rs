//! Systems of axes that the file may be in.

use crate::splats::Trained;
use crate::splats::trained::MOST_HARMONICS;

/// Signs that take splats from a file's axes to those of 3DGS .ply files (x right, y down, z ahead), and back.
///
/// Mirrored half-axes make the same Gaussian, so that a turn stays one: its vector part changes with the products of
/// the other two signs. A harmonic changes with the signs of the coordinates that it is odd in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Axes {
    center: [f32; 3],
    rotation: [f32; 3],
    harmonics: [f32; MOST_HARMONICS],
}

impl Axes {
    /// Right, up, back: what the format means where nothing else is said.
    pub(crate) fn of_format() -> Self {
        Self::new([1.0, -1.0, -1.0])
    }

    /// By the format's number of a system, of which 1 to 8 are told by bits: right, up and front, or left, down
    /// and back.
    pub(super) fn numbered(number: u32) -> Option<Self> {
        let bits = number.checked_sub(1).filter(|bits| *bits < 8)?;
        let sign = |positive: bool| if positive { 1.0 } else { -1.0 };
        Some(Self::new([sign(bits & 1 != 0), sign(bits & 2 == 0), sign(bits & 4 != 0)]))
    }

    fn new([x, y, z]: [f32; 3]) -> Self {
        let harmonics = [y, z, x, x * y, y * z, 1.0, x * z, 1.0, y, x * y * z, y, z, x, z, x];
        Self { center: [x, y, z], rotation: [y * z, x * z, x * y], harmonics }
    }

    /// To the axes of .ply files, or back.
    pub(crate) fn apply(&self, record: &mut Trained) {
        let [_, vector @ ..] = &mut record.rotation;
        (record.center.iter_mut().zip(self.center)).for_each(|(value, sign)| *value *= sign);
        (vector.iter_mut().zip(self.rotation)).for_each(|(value, sign)| *value *= sign);
        for (color, sign) in record.harmonics.iter_mut().zip(self.harmonics) {
            *color = color.map(|coefficient| coefficient * sign);
        }
    }
}
