//! The two colour spaces that pictures are blended in: linear Rec. 709 and its sRGB display encoding.
//!
//! Source: IEC 61966-2-1:1999 (sRGB). Values outside [0, 1] are mapped by the same curve, odd around 0.

/// Display-encodes a linear value.
pub fn linear_to_srgb(linear: f32) -> f32 {
    let magnitude = linear.abs();
    let encoded =
        if magnitude <= 0.003_130_8 { 12.92 * magnitude } else { 1.055 * magnitude.powf(1.0 / 2.4) - 0.055 };
    encoded.copysign(linear)
}

/// Decodes a display-encoded value to linear.
pub fn srgb_to_linear(encoded: f32) -> f32 {
    let magnitude = encoded.abs();
    let linear =
        if magnitude <= 0.040_45 { magnitude / 12.92 } else { ((magnitude + 0.055) / 1.055).powf(2.4) };
    linear.copysign(encoded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip() {
        for i in -10..=300 {
            let value = i as f32 / 100.0;
            let back = srgb_to_linear(linear_to_srgb(value));
            // The published constants join the two pieces to 1e-7; powf adds a few ulps.
            assert!((back - value).abs() <= 1e-5 * value.abs().max(0.1), "{value} came back as {back}");
        }
    }
}
