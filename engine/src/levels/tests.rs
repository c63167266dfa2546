use super::*;
use crate::closed::Closed;
use crate::cloud::{Cloud, Harmonics, Material, OpacityFilter, Shapes, Splats, Strength, Surface};
use crate::color::linear_to_srgb;
use crate::columns::Kind;
use glam::{DMat3, DVec3};

/// A number in [0, 1) that looks random.
fn noise(i: usize, k: f64) -> f32 {
    let x = (i as f64 + 0.37) * k;
    (x - x.floor()) as f32
}

fn spot(i: usize) -> Vec3 {
    Vec3::new(noise(i, 0.754_877_67), noise(i, 0.569_840_29), noise(i, 0.437_016_02))
}

fn direction(i: usize) -> Vec3 {
    (spot(3 * i + 11) - 0.5).normalize_or(Vec3::X)
}

fn splats(count: usize, strength: impl Fn(Vec<f32>) -> Strength) -> Splats {
    Splats {
        centers: (0..count).map(spot).collect(),
        shapes: Shapes::Each(
            (0..count)
                .map(|i| crate::cloud::oblate_factor(direction(i), 0.01 + 0.02 * noise(i, 0.61), 3.0))
                .collect(),
        ),
        strength: strength((0..count).map(|i| 0.1 + 0.8 * noise(i, 0.317)).collect()),
        colors: (0..count).map(|i| spot(i + 99).to_array()).collect(),
        harmonics: Some(Harmonics {
            degree: 1,
            coefficients: (0..3 * count).map(|i| spot(i + 7).to_array()).collect(),
        }),
        normals: Some((0..count).map(direction).collect()),
        material: Material::default(),
    }
}

fn surface(closed: Closed) -> impl Fn(Vec<f32>) -> Strength {
    move |areas| {
        let opacities = Some(areas.iter().map(|a| 1.0 - a).collect());
        Strength::Surface(Surface {
            areas,
            opacities,
            depth_tolerance: 0.1,
            coverage_floor: 0.9,
            closed: closed.clone(),
        })
    }
}

fn clouds(count: usize) -> Vec<Cloud> {
    let all = [
        splats(count, |masses| Strength::Extinction { masses }),
        splats(count, |peaks| Strength::Opacity { peaks, filter: OpacityFilter::Compensated, least: 0.0 }),
        splats(count, surface(Closed::EVERYWHERE)),
        splats(count, surface(Closed::Sided)),
        splats(count, surface(Closed::Nowhere)),
    ];
    all.into_iter().map(|splats| Cloud::new(splats.in_morton_order()).unwrap().with_levels()).collect()
}

/// Sums over the splats of a level of 1, centre, second moments, colour, coefficients of harmonics and normal, by mass or area, or
/// by opacity times mean shadow.
fn sums(columns: &Columns) -> Vec<f64> {
    let mut sums = vec![0.0; 28];
    for index in 0..columns.len {
        let factor = columns.factor(index).as_dmat3();
        let covariance = factor * factor.transpose();
        let center = columns.center(index).as_dvec3();
        let shadow =
            if let Kind::Opacity { .. } = columns.kind { family::mean_shadow(covariance) } else { 1.0 };
        // Of surfaces, by opacity.
        let color = columns.color(index).map(|c| match columns.kind {
            Kind::Opacity { .. } => linear_to_srgb(c),
            Kind::Surface(_) => c * columns.opacity(index),
            _ => c,
        });
        let coefficients = columns.harmonics.as_ref().unwrap().row(index).flatten().map(f64::from);
        let mut strength = f64::from(columns.strength(index));
        let mut moments = covariance;
        if let Kind::Opacity { least, .. } = columns.kind {
            // ∫ o e^{-s} ds and ∫ s o e^{-s} ds, with s half the squared distance in σ, to where the opacity is the least.
            let least = f64::from(least);
            if least > 0.0 && strength > least {
                moments *= (strength - least * (1.0 + (strength / least).ln())) / (strength - least);
            }
            strength = (strength - least).max(0.0);
        }
        moments += family::outer(center, center);
        let values = std::iter::once(1.0).chain(center.to_array()).chain(moments.to_cols_array());
        let looks = color.map(f64::from).into_iter().chain(columns.normal(index).as_dvec3().to_array());
        let weight = strength * shadow;
        for (sum, value) in sums.iter_mut().zip(values.chain(looks).chain(coefficients)) {
            *sum += weight * value;
        }
    }
    sums
}

fn assert_kept(cloud: &Cloud, kept: impl Fn(usize) -> bool) {
    let levels = cloud.levels();
    let own = sums(&levels[0].columns);
    for level in &levels[1..] {
        for (number, (found, own_sum)) in sums(&level.columns).into_iter().zip(&own).enumerate() {
            // Numbers below 1 in sums of weights that are own[0], each rounded to 2^-24 a level, colours through powers, and
            // coefficients to 1.6e-5.
            let error = (found - own_sum).abs() / own[0];
            assert!(!kept(number) || error < 3e-5, "{number}: {found}, not {own_sum}");
        }
    }
}

#[test]
fn volumes_keep_mass_mean_covariance_and_looks() {
    let [volume, trained] = clouds(5000).try_into().map(|[a, b, ..]: [Cloud; 5]| [a, b]).unwrap();
    assert_eq!(volume.levels().iter().map(|level| level.columns.len).collect::<Vec<_>>(), [5000, 1250, 313]);
    // Normals are kept but for their signs.
    assert_kept(&volume, |number| !(16..19).contains(&number));
    // Opacities are at most 1: thin ones stay below. What they don't show where they end is shown by none.
    for end in [0.0, 1e-5, 2e-4] {
        let mut thin = trained.splats();
        if let Strength::Opacity { peaks, least, .. } = &mut thin.strength {
            peaks.iter_mut().for_each(|peak| *peak *= 1e-3);
            *least = end;
        }
        let thin = Cloud::new(thin).unwrap().with_levels();
        assert_kept(&thin, |number| !(16..19).contains(&number));
    }
}

#[test]
fn closed_surfaces_keep_their_areas_and_normals_and_flat_ones_all_else() {
    let surface = &clouds(5000)[2];
    assert_kept(surface, |_| true);
    // Vector areas, and the second moments of normals.
    let orientations = |columns: &Columns| -> (DVec3, DMat3) {
        let one = |i: usize| -> (DVec3, DMat3) {
            let Orientation { mean, spread } = match &columns.orientations {
                Some(orientations) => Orientation::of_numbers(orientations.row(i)),
                None => {
                    let factor = columns.factor(i).as_dmat3();
                    let mean = factor.x_axis.cross(factor.y_axis).normalize_or_zero();
                    Orientation { mean, spread: DMat3::ZERO }
                }
            };
            let area = f64::from(columns.strength(i));
            (area * mean, area * (spread + family::outer(mean, mean)))
        };
        (0..columns.len).map(one).fold(Default::default(), |(a, b), (c, d)| (a + c, b + d))
    };
    let area = sums(surface.columns())[0];
    let (vector, moments) = orientations(surface.columns());
    for level in surface.levels() {
        let (own, squares) = orientations(&level.columns);
        let error = (own - vector).length() + family::frobenius_squared(squares - moments).sqrt();
        assert!(error < 1e-5 * area, "{error} of {area}");
    }

    let mut flat = splats(5000, self::surface(Closed::EVERYWHERE));
    flat.centers.iter_mut().for_each(|center| center.z = 0.0);
    let disc = |i: usize| crate::cloud::oblate_factor(Vec3::Z, 0.01 + 0.01 * noise(i, 0.4), f32::INFINITY);
    flat.shapes = Shapes::Each((0..5000).map(disc).collect());
    let flat = Cloud::new(flat.in_morton_order()).unwrap().with_levels();
    assert_kept(&flat, |_| true);
    // The mean σ₁σ₂ of samples by area, which grains tell.
    let kernel = |columns: &Columns, i: usize| {
        let factor = columns.factor(i);
        let grain = columns.grains.as_ref().map_or(1.0, |grains| grains.row(i)[0]);
        f64::from(columns.strength(i) * grain * grain * factor.x_axis.cross(factor.y_axis).length())
    };
    let kernels = |columns: &Columns| (0..columns.len).map(|i| kernel(columns, i)).sum::<f64>();
    for level in flat.levels() {
        let error = kernels(&level.columns) / kernels(flat.columns()) - 1.0;
        assert!(error.abs() < 1e-5, "{error}");
        let thickness = (0..level.columns.len).map(|i| level.columns.factor(i).z_axis.length());
        assert!(thickness.fold(0.0, f32::max) < 1e-7);
    }
}

#[test]
fn needs_grow_upwards_and_are_finite() {
    for cloud in clouds(5000) {
        for pair in cloud.levels().windows(2) {
            for child in 0..pair[0].columns.len {
                let [own, above] = [pair[0].need(child), pair[1].need(child / CHILDREN)];
                assert!(own <= above && above.is_finite(), "{own} below {above}");
            }
            for (number, cluster) in pair[0].clusters.iter().enumerate() {
                let parents = cluster.splats.clone().map(|child| pair[1].need(child / CHILDREN));
                assert_eq!(range_of(parents), cluster.parents_need, "{number}");
            }
        }
    }
}

#[test]
fn any_number_of_splats_and_coincident_ones() {
    for count in [0, 1, 2, 1024, 1025, 4096, 4097, 16385] {
        for cloud in clouds(count) {
            let lens: Vec<usize> = cloud.levels().iter().map(|level| level.columns.len).collect();
            assert!(lens.windows(2).all(|pair| pair[1] == pair[0].div_ceil(CHILDREN)), "{lens:?}");
            assert!(lens[lens.len() - 1] <= CLUSTER_SIZE);
        }
    }
    let mut splats = splats(5000, |masses| Strength::Extinction { masses });
    splats.centers.fill(Vec3::new(3.0, -1.0, 2.0));
    let cloud = Cloud::new(splats).unwrap().with_levels();
    assert_kept(&cloud, |number| number < 13);
    // Nothing, far away and near, is nothing.
    let mut empty = self::splats(3000, |masses| Strength::Extinction { masses: vec![0.0; masses.len()] });
    empty.centers.iter_mut().for_each(|center| *center *= 1e30);
    let empty = Cloud::new(empty).unwrap().with_levels();
    for level in empty.levels() {
        assert!(
            (0..level.columns.len).all(|i| level.columns.center(i).is_finite() && level.need(i).is_finite())
        );
    }
}

#[test]
fn of_a_splat_and_those_above_it_one_is_drawn() {
    // As in `cull`: needs and filters that grow upwards.
    for cloud in clouds(5000) {
        let levels = cloud.levels();
        for filter in [0.0, 0.001, 0.01, 0.03, 0.1, 1.0, 1e30] {
            for own in 0..levels[0].columns.len {
                let drawn = (0..levels.len()).filter(|number| {
                    let index = own / CHILDREN.pow(*number as u32);
                    let above =
                        levels.get(number + 1).map_or(f32::INFINITY, |above| above.need(index / CHILDREN));
                    levels[*number].need(index) <= filter && above > filter
                });
                assert_eq!(drawn.count(), 1);
            }
        }
    }
}
