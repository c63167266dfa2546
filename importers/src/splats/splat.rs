//! `.splat`: trained splats without a header, 32 bytes each, little-endian.
//!
//! | bytes | what |
//! |---|---|
//! | 0–11 | centre, three floats; the axes stay the file's |
//! | 12–23 | σ along the half-axes, three floats; 0 is flat |
//! | 24–26 | red, green, blue, display-encoded, 255 is 1 |
//! | 27 | peak opacity, 255 is 1 |
//! | 28–31 | the half-axes' rotation, a quaternion w x y z, each as 128 + 128 times it |
//!
//! There is nothing to tell it by but the name's ending. Files without splats, or whose size is no multiple of 32, are refused;
//! rows that are no splats are left out: see [`crate::splats`]. Opacities count as trained
//! [without compensation](oblate_engine::OpacityFilter::Classic): the format cannot say otherwise. It has no harmonics.
//!
//! Source: the converter and viewer *splat* by Kevin Kwok, 2023, which brought the format into use.

use super::{ROWS, Trained, Training, gather, log_scale};
use crate::scalar::numbers;
use crate::source::Source;
use crate::{Endian, ImportError, Opened, Place};
use oblate_engine::{Blend, OpacityFilter};

/// Bytes of a splat.
pub(crate) const SIZE: usize = 32;

/// Reads splats.
pub(crate) fn read(source: &Source) -> Result<Opened, ImportError> {
    if source.size % SIZE != 0 {
        let problem = format!("{} bytes; a .splat has 32 for each splat", source.size);
        return Err(source.head.malformed(Place::Whole, problem));
    }
    let training = Training { degree: 0, filter: OpacityFilter::Classic, blend: Blend::Display };
    let opened = gather(&source.head, (source.size / SIZE, ROWS), training, |rows, sink| {
        let bytes = source.bytes(rows.start * SIZE, rows.len() * SIZE)?;
        bytes.as_chunks().0.iter().for_each(|row| {
            sink.put(&trained(row));
        });
        Ok(())
    });
    source.finish();
    opened
}

fn trained(row: &[u8; SIZE]) -> Trained {
    let mut floats = numbers(&row[..24], Endian::Little, f32::from_le_bytes);
    let [x, y, z, a, b, c] = std::array::from_fn(|_| floats.next().unwrap_or(f32::NAN));
    let &[.., red, green, blue, opacity, q0, q1, q2, q3] = row;
    Trained {
        center: [x, y, z],
        log_scales: [a, b, c].map(log_scale),
        rotation: [q0, q1, q2, q3].map(|byte| (f32::from(byte) - 128.0) / 128.0),
        opacity: f32::from(opacity) / 255.0,
        color: [red, green, blue].map(|byte| f32::from(byte) / 255.0),
        ..Trained::default()
    }
}
