//! Voxels to bytes, a piece at a time.

use oblate_volumes::Voxels;

/// Bytes that are made at a time, a multiple of every number's size.
pub(crate) const PIECE: usize = 1 << 20;

/// How samples are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    /// As they are.
    Raw,
    /// By the format's form of deflate (RFC 1951).
    Deflated,
}

/// Bytes of one sample.
pub(crate) fn size(voxels: &Voxels) -> usize {
    match voxels {
        Voxels::U8(_) => 1,
        Voxels::U16(_) | Voxels::I16(_) => 2,
        Voxels::F32(_) => 4,
    }
}

/// The samples as little-endian bytes, in pieces of [`PIECE`] bytes of which the last may be shorter.
pub(crate) fn pieces(voxels: &Voxels) -> impl Fn(usize) -> Vec<u8> + Sync {
    fn bytes<const N: usize, T: Copy>(values: &[T], piece: usize, to_bytes: fn(T) -> [u8; N]) -> Vec<u8> {
        let count = PIECE / N;
        let first = (piece * count).min(values.len());
        let last = (first + count).min(values.len());
        values[first..last].iter().flat_map(|value| to_bytes(*value)).collect()
    }
    move |piece| match voxels {
        Voxels::U8(values) => bytes(values, piece, u8::to_le_bytes),
        Voxels::U16(values) => bytes(values, piece, u16::to_le_bytes),
        Voxels::I16(values) => bytes(values, piece, i16::to_le_bytes),
        Voxels::F32(values) => bytes(values, piece, f32::to_le_bytes),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use glam::{DMat3, DQuat, DVec3};
    use oblate_volumes::{GridFrame, Volume};
    use proptest::prelude::*;
    use proptest::test_runner::TestCaseError;

    /// Volumes of every number type, of more samples than a piece holds where `large`.
    pub(crate) fn volumes(frame: GridFrame, large: bool) -> Vec<Volume> {
        let dims = if large { [513, 41, 27] } else { [4, 3, 2] };
        let count = dims.iter().product::<usize>();
        let bits = |i: usize| (i as u32).wrapping_mul(2_654_435_761) >> 7;
        // No NaN, which equals nothing.
        let float = |i| match i % 50 {
            0 => f32::INFINITY,
            1 => -0.0,
            2 => f32::MIN_POSITIVE / 8.0,
            _ => bits(i) as f32 * 1.000_001,
        };
        [
            Voxels::U8((0..count).map(|i| bits(i) as u8).collect()),
            Voxels::U16((0..count).map(|i| bits(i) as u16).collect()),
            Voxels::I16((0..count).map(|i| bits(i) as i16).collect()),
            Voxels::F32((0..count).map(float).collect()),
        ]
        .into_iter()
        .map(|voxels| Volume::new(dims, voxels, frame).unwrap())
        .collect()
    }

    /// That a frame came back: its origin as it was, the rest as rounding leaves it.
    pub(crate) fn close(found: GridFrame, frame: GridFrame) -> Result<(), TestCaseError> {
        prop_assert_eq!(found.origin, frame.origin);
        // A product, a root of a sum of three squares and a quotient: each number is within 4 units of 2⁻⁵³; the
        // direction itself has unit columns to as much.
        let close =
            |a: DVec3, b: DVec3| (a - b).abs().max_element() <= 12.0 * f64::EPSILON * b.abs().max_element();
        prop_assert!(close(found.spacing / frame.spacing, DVec3::ONE));
        for axis in 0..3 {
            prop_assert!(close(found.direction.col(axis), frame.direction.col(axis)));
        }
        Ok(())
    }

    /// Frames that turn and mirror.
    pub(crate) fn frame() -> impl Strategy<Value = GridFrame> {
        let number = || -1e3..1e3_f64;
        let vector = move || prop::array::uniform3(number()).prop_map(DVec3::from_array);
        (vector(), prop::array::uniform3(1e-4..1e4_f64), prop::array::uniform4(-1.0..1.0_f64), any::<bool>())
            .prop_map(|(origin, spacing, q, mirrored)| {
                let rotation = DQuat::from_array(q);
                let rotation = if rotation.length() > 0.1 { rotation.normalize() } else { DQuat::IDENTITY };
                let turned = DMat3::from_quat(rotation);
                let direction = if mirrored {
                    DMat3::from_cols(-turned.x_axis, turned.y_axis, turned.z_axis)
                } else {
                    turned
                };
                GridFrame { spacing: DVec3::from_array(spacing), origin, direction, space: None }
            })
    }
}
