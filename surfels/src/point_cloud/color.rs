//! Colours of points.

use super::{PointCloud, PointColor, PointError, PointSettings};
use glam::Vec3;
use oblate_engine::color::srgb_to_linear;
use rayon::prelude::*;

/// Shares of the values that are below and above what colours tell apart: strays, like birds and mirrors.
const STRAYS: f64 = 0.01;

/// *viridis* at even steps, display-encoded: every fifth of its 256 colours (Smith, van der Walt, 2015; released to the public
/// domain), from which interpolated ones are 0.004 away at most.
const VIRIDIS: [u32; 52] = [
    0x440154, 0x46085c, 0x471063, 0x481769, 0x481d6f, 0x482475, 0x472a7a, 0x46307e, 0x453781, 0x433d84,
    0x414287, 0x3f4889, 0x3d4e8a, 0x3a538b, 0x38598c, 0x355e8d, 0x33638d, 0x31688e, 0x2e6d8e, 0x2c718e,
    0x2a768e, 0x297b8e, 0x27808e, 0x25848e, 0x23898e, 0x218e8d, 0x20928c, 0x1f978b, 0x1e9c89, 0x1fa188,
    0x21a585, 0x24aa83, 0x28ae80, 0x2eb37c, 0x35b779, 0x3dbc74, 0x46c06f, 0x50c46a, 0x5ac864, 0x65cb5e,
    0x70cf57, 0x7cd250, 0x89d548, 0x95d840, 0xa2da37, 0xb0dd2f, 0xbddf26, 0xcae11f, 0xd8e219, 0xe5e419,
    0xf1e51d, 0xfde725,
];

/// The intensities or heights that points are coloured by, and which of both they are; none where they have colours.
///
/// Heights are along [`PointSettings::up`], of unit length, from the zero of the frame of origin + position.
///
/// # Errors
/// As [`point_surfels`](crate::point_surfels), but for sizes.
pub fn point_values(
    points: &PointCloud,
    settings: &PointSettings,
) -> Result<Option<(PointColor, Vec<f64>)>, PointError> {
    points.check()?;
    settings.check()?;
    values(points, settings)
}

/// What the ends of colours stand for: the 1st and the 99th percentile of values, which may be those of several clouds;
/// none without values.
pub fn point_range(mut values: Vec<f64>) -> Option<[f64; 2]> {
    values.par_sort_unstable_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    Some([STRAYS, 1.0 - STRAYS].map(|share| values[(share * last as f64).round() as usize]))
}

/// Linear colours, one for each point.
pub(crate) fn colors(points: &PointCloud, settings: &PointSettings) -> Result<Vec<[f32; 3]>, PointError> {
    let Some((by, values)) = values(points, settings)? else {
        return points.colors.clone().ok_or(PointError::Color("colours"));
    };
    let range = settings.range.or_else(|| point_range(values.clone())).unwrap_or_default();
    Ok(match by {
        PointColor::Intensity => mapped(&values, range, |share| [share; 3]),
        _ => mapped(&values, range, viridis),
    })
}

fn values(
    points: &PointCloud,
    settings: &PointSettings,
) -> Result<Option<(PointColor, Vec<f64>)>, PointError> {
    let varied = |values: &Vec<f32>| values.iter().any(|value| *value != values[0]);
    let by = match settings.color {
        PointColor::Auto if points.colors.iter().flatten().any(|color| *color != [0.0; 3]) => PointColor::Rgb,
        PointColor::Auto if points.intensities.as_ref().is_some_and(varied) => PointColor::Intensity,
        PointColor::Auto => PointColor::Height,
        asked => asked,
    };
    let values = match by {
        PointColor::Rgb => return Ok(None),
        PointColor::Intensity => {
            let intensities = points.intensities.as_ref().ok_or(PointError::Color("intensities"))?;
            intensities.par_iter().map(|&intensity| f64::from(intensity)).collect()
        }
        PointColor::Height | PointColor::Auto => {
            let up = settings.up.as_dvec3().normalize();
            let base = points.origin.dot(up);
            points.positions.par_iter().map(|position| base + position.as_dvec3().dot(up)).collect()
        }
    };
    Ok(Some((by, values)))
}

/// Each value's colour by its place in the range, given display-encoded.
fn mapped(values: &[f64], [low, high]: [f64; 2], encoded: impl Fn(f32) -> [f32; 3] + Sync) -> Vec<[f32; 3]> {
    let share = |value: f64| {
        // All are one value: the middle.
        if high > low { ((value - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 }
    };
    values.par_iter().map(|&value| encoded(share(value) as f32).map(srgb_to_linear)).collect()
}

fn viridis(share: f32) -> [f32; 3] {
    let place = share * (VIRIDIS.len() - 1) as f32;
    let before = (place as usize).min(VIRIDIS.len() - 2);
    let color = |number: usize| {
        let [_, rgb @ ..] = VIRIDIS[number].to_be_bytes();
        Vec3::from(rgb.map(f32::from))
    };
    let [a, b] = [before, before + 1].map(color);
    (a.lerp(b, place - before as f32) / 255.0).to_array()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points() -> PointCloud {
        let positions = (0..101).map(|i| Vec3::new(0.0, 0.1 * i as f32, 5.0)).collect();
        PointCloud { positions, ..PointCloud::default() }
    }

    fn by(color: PointColor) -> PointSettings {
        PointSettings { color, up: Vec3::Y, ..PointSettings::default() }
    }

    #[test]
    fn intensities_are_grey_without_strays() {
        // The 1st and 99th percentile of 0, 1, …, 99, 10⁶ are 1 and 99.
        let intensities = (0..101).map(|i| if i == 100 { 1e6 } else { i as f32 }).collect();
        let points = PointCloud { intensities: Some(intensities), ..points() };
        let found = colors(&points, &by(PointColor::Intensity)).unwrap();
        assert_eq!((found[0], found[1], found[99], found[100]), ([0.0; 3], [0.0; 3], [1.0; 3], [1.0; 3]));
        // Halfway is display-encoded ½, which is 0.2140 in linear light.
        assert!((found[50][0] - 0.214_041).abs() < 1e-5, "{:?}", found[50]);
        assert_eq!(colors(&points, &by(PointColor::Auto)).unwrap(), found);
    }

    #[test]
    fn heights_go_through_viridis() {
        let found = colors(&points(), &by(PointColor::Height)).unwrap();
        let middle = viridis(0.5).map(srgb_to_linear);
        let near = |a: [f32; 3], b: [f32; 3]| Vec3::from(a).abs_diff_eq(Vec3::from(b), 1e-4);
        assert!(near(found[0], viridis(0.0).map(srgb_to_linear)));
        assert!(near(found[100], viridis(1.0).map(srgb_to_linear)));
        assert!(near(found[50], middle), "{:?}", found[50]);
        // No height differs from the others along x.
        let flat = PointSettings { up: Vec3::X, ..by(PointColor::Height) };
        assert!(near(colors(&points(), &flat).unwrap()[0], middle));
    }

    #[test]
    fn viridis_is_as_published() {
        // Of 256 colours.
        for (number, published) in [
            (0, [0.267_004, 0.004_874, 0.329_415]),
            (32, [0.278_826, 0.175_49, 0.483_397]),
            (64, [0.229_739, 0.322_361, 0.545_706]),
            (127, [0.128_729, 0.563_265, 0.551_229]),
            (160, [0.157_851, 0.683_765, 0.501_686]),
            (242, [0.866_013, 0.889_868, 0.095_953]),
            (255, [0.993_248, 0.906_157, 0.143_936]),
        ] {
            let found = viridis(number as f32 / 255.0);
            assert!(Vec3::from(found).abs_diff_eq(Vec3::from(published), 0.004), "{number}: {found:?}");
        }
    }

    #[test]
    fn several_clouds_share_a_range() {
        // Two halves of one cloud, each in a frame of its own.
        let whole = colors(&points(), &by(PointColor::Height)).unwrap();
        let half = |part: std::ops::Range<usize>| {
            let origin = points().positions[part.start];
            let positions = points().positions[part].iter().map(|p| *p - origin).collect();
            PointCloud { origin: origin.as_dvec3(), positions, ..PointCloud::default() }
        };
        let halves = [half(0..50), half(50..101)];
        let of = |half: &PointCloud| point_values(half, &by(PointColor::Height)).unwrap().unwrap().1;
        let range = point_range(halves.iter().flat_map(of).collect());
        let settings = PointSettings { range, ..by(PointColor::Height) };
        let parts = halves.iter().flat_map(|half| colors(half, &settings).unwrap());
        for (part, whole) in parts.zip(whole) {
            assert!(Vec3::from(part).abs_diff_eq(Vec3::from(whole), 1e-5));
        }
        assert_eq!(point_range(Vec::new()), None);
        let red = PointCloud { colors: Some(vec![[1.0, 0.0, 0.0]; 101]), ..points() };
        assert_eq!(point_values(&red, &by(PointColor::Auto)), Ok(None));
    }

    #[test]
    fn what_says_nothing_is_passed_over() {
        let height = colors(&points(), &by(PointColor::Auto)).unwrap();
        let blank =
            PointCloud { colors: Some(vec![[0.0; 3]; 101]), intensities: Some(vec![7.0; 101]), ..points() };
        assert_eq!(colors(&blank, &by(PointColor::Auto)).unwrap(), height);
        assert_eq!(colors(&blank, &by(PointColor::Rgb)).unwrap(), vec![[0.0; 3]; 101]);
        let red = PointCloud { colors: Some(vec![[1.0, 0.0, 0.0]; 101]), ..blank };
        assert_eq!(colors(&red, &by(PointColor::Auto)).unwrap(), vec![[1.0, 0.0, 0.0]; 101]);
        for (color, missing) in [(PointColor::Rgb, "colours"), (PointColor::Intensity, "intensities")] {
            assert_eq!(colors(&points(), &by(color)), Err(PointError::Color(missing)));
        }
    }
}
