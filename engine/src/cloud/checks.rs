//! What the numbers of splats have to be.

use super::{CloudError, Harmonics, Material, Shapes, Splats, Strength};
use glam::Mat3;
use rayon::prelude::*;
use std::fmt::Debug;

/// Values that a thread checks at a time.
const CHECKED_TOGETHER: usize = 4096;

/// Refuses splats whose arrays differ in length or hold what no splat has.
pub(super) fn validate(splats: &Splats) -> Result<(), CloudError> {
    let expected = splats.centers.len();
    check_names(expected)?;
    let length = |array: &'static str, found: usize| {
        if found == expected { Ok(()) } else { Err(CloudError::Length { array, found, expected }) }
    };
    let range = |what: &'static str, values: &[f32], high: f32, expected: &'static str| {
        length(what, values.len())?;
        match first_wrong(values, |v| *v >= 0.0 && *v <= high) {
            None => Ok(()),
            Some(index) => Err(wrong(index, what, values[index].to_string(), expected)),
        }
    };

    finite("centre", &splats.centers, 1, |center| center.is_finite())?;
    match &splats.shapes {
        Shapes::Shared(factor) => finite("shape", &[*factor], 1, Mat3::is_finite)?,
        Shapes::Each(factors) => {
            length("shapes", factors.len())?;
            finite("shape", factors, 1, Mat3::is_finite)?;
        }
    }
    check_material(splats.material)?;
    length("colors", splats.colors.len())?;
    let finite_color = |color: &[f32; 3]| color.iter().all(|c| c.is_finite());
    finite("colour", &splats.colors, 1, finite_color)?;
    if let Some(harmonics) = &splats.harmonics {
        let Harmonics { degree, coefficients } = harmonics;
        if !(1..=3).contains(degree) {
            let expected = "harmonics have a degree from 1 to 3";
            return Err(wrong(0, "degree", degree.to_string(), expected));
        }
        let per_splat = harmonics.per_splat();
        if coefficients.len() != expected * per_splat {
            let (array, found) = ("harmonics", coefficients.len());
            return Err(CloudError::Length { array, found, expected: expected * per_splat });
        }
        finite("coefficient of harmonics", coefficients, per_splat, finite_color)?;
    }
    if let Some(normals) = &splats.normals {
        length("normals", normals.len())?;
        finite("normal", normals, 1, |normal| normal.is_finite())?;
    }
    match &splats.strength {
        Strength::Extinction { masses } => {
            range("masses", masses, f32::MAX, "a mass is finite and at least 0")
        }
        Strength::Opacity { peaks, filter: _, least } => {
            range("peaks", peaks, 1.0, OPACITY)?;
            let is_right = (0.0..=1.0).contains(least);
            is_right.then_some(()).ok_or_else(|| wrong(0, "least opacity", least.to_string(), OPACITY))
        }
        Strength::Surface(surface) => {
            range("areas", &surface.areas, f32::MAX, "an area is finite and at least 0")?;
            if let Some(opacities) = &surface.opacities {
                range("opacities", opacities, 1.0, OPACITY)?;
            }
            surface.closed.check()?;
            check_surface(surface.depth_tolerance, surface.coverage_floor)
        }
    }
}

/// A number of a splat that isn't as it should be.
pub(crate) fn wrong(index: usize, what: &'static str, value: String, expected: &'static str) -> CloudError {
    CloudError::Value { index, what, value, expected }
}

/// Refuses more splats than there are names.
pub(crate) fn check_names(count: usize) -> Result<(), CloudError> {
    if count >= u32::MAX as usize { Err(CloudError::Count(count)) } else { Ok(()) }
}

pub(crate) fn check_material(material: Material) -> Result<(), CloudError> {
    let Material { emission, ambient, diffuse, specular, exponent } = material;
    for (what, value) in [
        ("emission", emission),
        ("ambient", ambient),
        ("diffuse", diffuse),
        ("specular", specular),
        ("exponent", exponent),
    ] {
        if !(value >= 0.0 && value.is_finite()) {
            let expected = "a coefficient of the material is finite and at least 0";
            return Err(wrong(0, what, value.to_string(), expected));
        }
    }
    Ok(())
}

/// What an opacity should be.
const OPACITY: &str = "an opacity is from 0 to 1";

pub(crate) fn check_surface(depth_tolerance: f32, coverage_floor: f32) -> Result<(), CloudError> {
    if !(depth_tolerance >= 0.0 && depth_tolerance.is_finite()) {
        let expected = "it must be finite and at least 0";
        return Err(wrong(0, "depth tolerance", depth_tolerance.to_string(), expected));
    }
    if !(coverage_floor > 0.0 && coverage_floor <= 1.0) {
        let expected = "it must be above 0 and at most 1";
        return Err(wrong(0, "coverage floor", coverage_floor.to_string(), expected));
    }
    Ok(())
}

/// Refuses the first of the values, `per_splat` for each splat, that is not finite.
fn finite<T: Debug + Sync>(
    what: &'static str,
    values: &[T],
    per_splat: usize,
    is_finite: impl Fn(&T) -> bool + Sync,
) -> Result<(), CloudError> {
    match first_wrong(values, is_finite) {
        None => Ok(()),
        Some(place) => {
            Err(wrong(place / per_splat, what, format!("{:?}", values[place]), "it must be finite"))
        }
    }
}

/// Where the first value is that is not right.
fn first_wrong<T: Sync>(values: &[T], right: impl Fn(&T) -> bool + Sync) -> Option<usize> {
    let search = |(number, values): (usize, &[T])| {
        // Looking at all of them needs no branch; almost always that is enough.
        let all = values.iter().fold(true, |all, value| all & right(value));
        if all { None } else { Some(number * CHECKED_TOGETHER + values.iter().position(|v| !right(v))?) }
    };
    values.par_chunks(CHECKED_TOGETHER).enumerate().find_map_first(search)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Cloud;
    use glam::Vec3;

    #[test]
    fn the_first_wrong_number_is_reported() {
        let count = 3 * CHECKED_TOGETHER + 5;
        let splats = |wrong: &[usize]| {
            let mut masses = vec![1.0; count];
            for index in wrong {
                masses[*index] = -1.0;
            }
            Splats {
                centers: vec![Vec3::ZERO; count],
                shapes: Shapes::Shared(Mat3::IDENTITY),
                strength: Strength::Extinction { masses },
                colors: vec![[0.5; 3]; count],
                harmonics: None,
                normals: None,
                material: Material::default(),
            }
        };
        let cases: [&[usize]; 3] = [&[count - 1], &[count - 2, CHECKED_TOGETHER], &[7, 8, count - 1]];
        for (wrong, first) in cases.into_iter().zip([count - 1, CHECKED_TOGETHER, 7]) {
            let (what, value) = ("masses", "-1".to_owned());
            let expected = "a mass is finite and at least 0";
            assert_eq!(
                Cloud::new(splats(wrong)),
                Err(CloudError::Value { index: first, what, value, expected })
            );
        }
        let coefficients = vec![[0.0, f32::NAN, 0.0]; 3 * count];
        let harmonics = Some(Harmonics { degree: 1, coefficients });
        let error = Cloud::new(Splats { harmonics, ..splats(&[]) });
        assert!(matches!(error, Err(CloudError::Value { index: 0, .. })), "{error:?}");
        let mut centers = vec![Vec3::ZERO; count];
        centers[count - 3].y = f32::INFINITY;
        let error = Cloud::new(Splats { centers, ..splats(&[0]) });
        assert!(matches!(error, Err(CloudError::Value { what: "centre", .. })), "{error:?}");
    }
}
