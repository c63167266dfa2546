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
    /// and what is near in the picture is near in memory. Arrays of a wrong length and centres that are not finite
    /// are left for [`crate::Cloud::new`] to refuse.
    #[must_use]
    pub fn in_morton_order(self) -> Self {
        let order = morton_order(&self.centers);
        let sorted = order.windows(2).all(|pair| pair[0] < pair[1]);
        if sorted || !self.has_even_lengths() {
            return self;
        }
        Self {
            centers: permuted(&self.centers, &order),
            shapes: match self.shapes {
                Shapes::Shared(factor) => Shapes::Shared(factor),
                Shapes::Each(factors) => Shapes::Each(permuted(&factors, &order)),
            },
            strength: match self.strength {
                Strength::Extinction { masses } => Strength::Extinction { masses: permuted(&masses, &order) },
                Strength::Opacity { peaks, filter } => {
                    Strength::Opacity { peaks: permuted(&peaks, &order), filter }
                }
                Strength::Surface(mut surface) => {
                    surface.areas = permuted(&surface.areas, &order);
                    surface.opacities = surface.opacities.map(|opacities| permuted(&opacities, &order));
                    Strength::Surface(surface)
                }
            },
            colors: permuted(&self.colors, &order),
            harmonics: self.harmonics.map(|harmonics| {
                let per_splat = harmonics.per_splat();
                let of_splat = |i: &u32| &harmonics.coefficients[*i as usize * per_splat..][..per_splat];
                let coefficients = order.iter().flat_map(of_splat).copied().collect();
                Harmonics { degree: harmonics.degree, coefficients }
            }),
            normals: self.normals.map(|normals| permuted(&normals, &order)),
            material: self.material,
        }
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

fn permuted<T: Copy + Send + Sync>(values: &[T], order: &[u32]) -> Vec<T> {
    order.par_iter().map(|i| values[*i as usize]).collect()
}

/// Indices of the points along the curve.
fn morton_order(points: &[Vec3]) -> Vec<u32> {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for p in points {
        (low, high) = (low.min(*p), high.max(*p));
    }
    // A cube keeps cells cubic; a point without extent has one cell.
    let scale = f64::from((1_u32 << BITS) - 1) / f64::from((high - low).max_element()).max(1e-30);
    let key = |p: &Vec3| {
        let cell = ((*p - low).as_dvec3() * scale).to_array();
        cell.iter().enumerate().fold(0, |key, (axis, x)| key | spread(*x as u64) << axis)
    };
    let mut keys: Vec<(u64, u32)> = points.par_iter().enumerate().map(|(i, p)| (key(p), i as u32)).collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|(_, index)| index).collect()
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
}
