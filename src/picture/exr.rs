//! OpenEXR. Depths are z along the view axis.
//!
//! | channels | |
//! |---|---|
//! | R, G, B, A | linear Rec. 709, premultiplied |
//! | Z | of the first surface; infinity where there is none |
//! | expected.Z | mean of what is seen, weighted by its contribution, without the background; infinity where nothing is |
//! | median.Z | where half of the light is left; infinity where more than half passes |
//! | N.X, N.Y, N.Z | world normal of the first surface; zero where there is none |
//! | id | unsigned integers: the front-most surfel's number in the scene; 4294967295 where there is none |
//!
//! Depths other than the surface's are layers of their own with a `Z` in them, which is how the format names them.

use super::{Picture, Unit};
use crate::output::WriteSeek;
use ::exr::prelude::*;
use anyhow::{Context, Result, ensure};
use oblate::engine::Frame;
use std::io::Cursor;

pub(super) fn write(frame: &Frame, file: &mut dyn WriteSeek) -> Result<()> {
    let channel = |name: &str, values: Vec<f32>| AnyChannel::new(name, FlatSamples::F32(values));
    let color = |i: usize| frame.color.iter().map(|c| c[i]).collect();
    let normal = |i: usize| frame.normal.iter().map(|n| n[i]).collect();
    let channels = [
        channel("R", color(0)),
        channel("G", color(1)),
        channel("B", color(2)),
        channel("A", color(3)),
        channel("Z", frame.depth.clone()),
        channel("expected.Z", frame.expected_depth.clone()),
        channel("median.Z", frame.median_depth.clone()),
        channel("N.X", normal(0)),
        channel("N.Y", normal(1)),
        channel("N.Z", normal(2)),
        AnyChannel::new("id", FlatSamples::U32(frame.id.clone())),
    ];
    let attributes =
        LayerAttributes { software_name: Some(Text::from("oblate")), ..LayerAttributes::default() };
    let layer = Layer::new(
        (frame.width, frame.height),
        attributes,
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels.into_iter().collect()),
    );
    Image::from_layer(layer).write().to_buffered(file)?;
    Ok(())
}

pub(super) fn read_picture(bytes: &[u8]) -> Result<Picture> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))?;
    let layer = image.layer_data;
    let (data, shown) = (layer.absolute_bounds(), image.attributes.display_window);
    let window = |w: IntegerBounds| format!("{}×{} at {},{}", w.size.0, w.size.1, w.position.0, w.position.1);
    ensure!(
        data == shown,
        "its data are {} of a picture of {} (pixels); only whole pictures are read",
        window(data),
        window(shown)
    );
    let named = |name: &str| -> Option<Vec<f32>> {
        let channel = layer.channel_data.list.iter().find(|c| c.name == *name)?;
        Some(channel.sample_data.values_as_f32().collect())
    };
    let color =
        |name: &str| named(name).with_context(|| format!("no channel `{name}`; R, G and B are compared"));
    let (r, g, b) = (color("R")?, color("G")?, color("B")?);
    let a = named("A").unwrap_or_else(|| vec![1.0; r.len()]);
    let values = r.into_iter().zip(g).zip(b).zip(a).map(|(((r, g), b), a)| [r, g, b, a]).collect();
    Ok(Picture { width: layer.size.width(), height: layer.size.height(), values, unit: Unit::Linear })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_pictures_are_refused() {
        let read = |shown: IntegerBounds| {
            let channel = |name: &str| AnyChannel::new(name, FlatSamples::F32(vec![0.5; 6]));
            let channels = AnyChannels::sort(["R", "G", "B"].map(channel).into_iter().collect());
            let attributes = LayerAttributes { layer_position: Vec2(5, 3), ..LayerAttributes::default() };
            let layer = Layer::new((3, 2), attributes, Encoding::SMALL_LOSSLESS, channels);
            let mut file = Cursor::new(Vec::new());
            let mut image = Image::from_layer(layer);
            image.attributes.display_window = shown;
            image.write().to_buffered(&mut file).unwrap();
            read_picture(file.get_ref())
        };
        let whole = read(IntegerBounds::new((5, 3), (3, 2))).unwrap();
        assert_eq!((whole.width, whole.height, whole.values), (3, 2, vec![[0.5, 0.5, 0.5, 1.0]; 6]));
        for (shown, says) in [
            (IntegerBounds::from_dimensions((60, 50)), "3×2 at 5,3 of a picture of 60×50 at 0,0"),
            (IntegerBounds::from_dimensions((3, 2)), "3×2 at 5,3 of a picture of 3×2 at 0,0"),
        ] {
            let message = read(shown).unwrap_err().to_string();
            assert!(message.contains(says) && message.contains("whole"), "{message}");
        }
    }
}
