//! Morton order: neighbours in space become neighbours in memory.

use crate::cloud::{Harmonics, Shapes, Splats, Strength};
use glam::Vec3;
use rayon::prelude::*;

/// Bits of a Morton key along an axis.
const BITS: u32 = 16;

impl Splats {
    /// The same splats ordered along a Morton curve through the box of their centres, equal places as they were.
    ///
    /// Every picture of them is the same; it is drawn faster, since culling looks at consecutive splats together,
    /// and what is near in the picture is near in memory. Arrays of a wrong length, centres that are not finite and more
    /// splats than ids can name are left for [`crate::Cloud::new`] to refuse.
    ///
    /// Beside the arrays it takes 16 bytes for each splat.
    #[must_use]
    pub fn in_morton_order(mut self) -> Self {
        // Indices and the mark between cycles have 32 bits.
        if self.centers.len() >= END as usize || !self.has_even_lengths() {
            return self;
        }
        let order = morton_order(&self.centers);
        if order.is_sorted() {
            return self;
        }
        let cycles = &cycles(order);
        let Self { centers, shapes, strength, colors, harmonics, normals, material: _ } = &mut self;
        rayon::scope(|scope| {
            if let Some(Harmonics { degree, coefficients }) = harmonics {
                scope.spawn(|_| match degree {
                    1 => permute(coefficients.as_chunks_mut::<{ Harmonics::count(1) }>().0, cycles),
                    2 => permute(coefficients.as_chunks_mut::<{ Harmonics::count(2) }>().0, cycles),
                    _ => permute(coefficients.as_chunks_mut::<{ Harmonics::count(3) }>().0, cycles),
                });
            }
            if let Shapes::Each(factors) = shapes {
                scope.spawn(|_| permute(factors, cycles));
            }
            scope.spawn(|_| permute(centers, cycles));
            scope.spawn(|_| permute(colors, cycles));
            scope.spawn(|_| match strength {
                Strength::Extinction { masses: values } | Strength::Opacity { peaks: values, .. } => {
                    permute(values, cycles);
                }
                Strength::Surface(surface) => {
                    permute(&mut surface.areas, cycles);
                    surface.opacities.iter_mut().for_each(|opacities| permute(opacities, cycles));
                }
            });
            scope.spawn(|_| normals.iter_mut().for_each(|normals| permute(normals, cycles)));
        });
        self
    }

    fn has_even_lengths(&self) -> bool {
        let count = self.centers.len();
        let shapes = match &self.shapes {
            Shapes::Shared(_) => count,
            Shapes::Each(factors) => factors.len(),
        };
        let [strengths, opacities] = match &self.strength {
            Strength::Extinction { masses: values } | Strength::Opacity { peaks: values, .. } => {
                [values.len(), count]
            }
            Strength::Surface(surface) => {
                [surface.areas.len(), surface.opacities.as_ref().map_or(count, Vec::len)]
            }
        };
        let normals = self.normals.as_ref().map_or(count, Vec::len);
        let harmonics = self.harmonics.as_ref().is_none_or(|harmonics| {
            harmonics.degree <= 3 && harmonics.coefficients.len() == count * harmonics.per_splat()
        });
        harmonics && [shapes, strengths, opacities, self.colors.len(), normals].iter().all(|n| *n == count)
    }
}

/// Behind each cycle; no splat has this index.
const END: u32 = u32::MAX;

/// What takes whose place, as cycles: each index is followed by that of the value that comes to it, the last by the first.
///
/// Going through them in turn takes no second array, and the next places are known long before they are reached.
fn cycles(mut order: Vec<u32>) -> Vec<u32> {
    let mut cycles = Vec::with_capacity(order.len() + 1);
    for first in 0..order.len() {
        let mut at = first;
        while order[at] != at as u32 {
            cycles.push(at as u32);
            // A place that is in a cycle stays from now on.
            at = std::mem::replace(&mut order[at], at as u32) as usize;
        }
        if cycles.last().is_some_and(|last| *last != END) {
            cycles.push(END);
        }
    }
    cycles
}

/// Moves values along the cycles.
fn permute<T: Copy>(values: &mut [T], cycles: &[u32]) {
    for cycle in cycles.split(|index| *index == END) {
        let Some((first, last)) = cycle.first().zip(cycle.last()) else { continue };
        let begun = values[*first as usize];
        for pair in cycle.windows(2) {
            values[pair[0] as usize] = values[pair[1] as usize];
        }
        values[*last as usize] = begun;
    }
}

/// Indices of the points along the curve.
fn morton_order(points: &[Vec3]) -> Vec<u32> {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for p in points {
        (low, high) = (low.min(*p), high.max(*p));
    }
    // A cube keeps cells cubic; a point without extent has one cell.
    let scale = f64::from((1_u32 << BITS) - 1) / f64::from((high - low).max_element()).max(1e-30);
    // The key and what breaks its ties: 32-bit words, for the memory.
    let key = |(index, p): (usize, &Vec3)| {
        let cell = ((*p - low).as_dvec3() * scale).to_array();
        let key = cell.iter().enumerate().fold(0, |key, (axis, x)| key | spread(*x as u64) << axis);
        [(key >> 32) as u32, key as u32, index as u32]
    };
    let mut keys: Vec<[u32; 3]> = points.par_iter().enumerate().map(key).collect();
    keys.par_sort_unstable_by_key(|[high, low, index]| {
        u128::from(*high) << 64 | u128::from(*low) << 32 | u128::from(*index)
    });
    keys.into_par_iter().map(|[.., index]| index).collect()
}

/// Puts two zero bits between the low 21 bits.
fn spread(x: u64) -> u64 {
    let x = x & 0x1f_ffff;
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed::Closed;
    use crate::cloud::{Material, OpacityFilter, Surface};
    use glam::Mat3;

    #[test]
    fn bits_are_spread() {
        for bit in 0..21 {
            assert_eq!(spread(1 << bit), 1 << (3 * bit));
        }
    }

    #[test]
    fn the_curve_visits_octants_in_turn() {
        let corners: Vec<Vec3> =
            (0..8).rev().map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)).collect();
        assert_eq!(morton_order(&corners), [7, 6, 5, 4, 3, 2, 1, 0]);
        assert_eq!(morton_order(&[Vec3::ONE; 3]), [0, 1, 2]);
        assert!(morton_order(&[]).is_empty());
    }

    #[test]
    fn cycles_are_followed() {
        assert!(cycles(vec![0, 1, 2]).is_empty());
        assert_eq!(cycles(vec![1, 0, 2, 5, 3, 4]), [0, 1, END, 3, 5, 4, END]);
        let mut values = [10, 11, 12, 13, 14, 15];
        permute(&mut values, &cycles(vec![1, 0, 2, 5, 3, 4]));
        assert_eq!(values, [11, 10, 12, 15, 13, 14]);
    }

    #[test]
    fn all_arrays_are_put_in_order() {
        let count = 12_295;
        let number = |i: usize| (i * 7919 % count) as f32;
        let vector = |i: usize| Vec3::new(number(i), 0.0, 0.0);
        for degree in 0..=3 {
            let per_splat = Harmonics::count(degree);
            let surface = Surface {
                areas: (0..count).map(number).collect(),
                opacities: Some((0..count).map(number).collect()),
                depth_tolerance: 1.0,
                coverage_floor: 0.5,
                closed: Closed::Nowhere,
            };
            let strengths = [
                Strength::Surface(surface),
                Strength::Extinction { masses: (0..count).map(number).collect() },
                Strength::Opacity {
                    peaks: (0..count).map(number).collect(),
                    filter: OpacityFilter::Classic,
                    least: 0.0,
                },
            ];
            for strength in strengths {
                let harmonic = |i: usize| [number(i / per_splat), (i % per_splat) as f32, 1.0];
                let splats = Splats {
                    centers: (0..count).map(vector).collect(),
                    shapes: Shapes::Each(
                        (0..count).map(|i| Mat3::from_diagonal(vector(i) + Vec3::Y)).collect(),
                    ),
                    strength,
                    colors: (0..count).map(|i| [number(i); 3]).collect(),
                    harmonics: (degree > 0).then(|| Harmonics {
                        degree,
                        coefficients: (0..count * per_splat).map(harmonic).collect(),
                    }),
                    normals: Some((0..count).map(vector).collect()),
                    material: Material::UNLIT,
                }
                .in_morton_order();
                // Along a line the curve is the line.
                for (i, x) in (0..count).map(|i| (i, i as f32)) {
                    assert_eq!(splats.centers[i], Vec3::new(x, 0.0, 0.0));
                    assert_eq!(splats.shapes.factor(i), Mat3::from_diagonal(Vec3::new(x, 1.0, 0.0)));
                    assert_eq!((splats.colors[i], splats.normals.as_ref().unwrap()[i].x), ([x; 3], x));
                    let strength = match &splats.strength {
                        Strength::Extinction { masses: values } | Strength::Opacity { peaks: values, .. } => {
                            values[i]
                        }
                        Strength::Surface(Surface { areas, opacities, .. }) => {
                            assert_eq!(opacities.as_ref().unwrap()[i], x);
                            areas[i]
                        }
                    };
                    assert_eq!(strength, x);
                    let coefficients =
                        splats.harmonics.iter().flat_map(|h| &h.coefficients[i * per_splat..][..per_splat]);
                    for (number, coefficient) in coefficients.enumerate() {
                        assert_eq!(*coefficient, [x, number as f32, 1.0]);
                    }
                }
            }
        }
    }
}
