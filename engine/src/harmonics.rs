//! Real spherical harmonics of degree 1 to 3.
//!
//! Sloan, *Stupid Spherical Harmonics Tricks*, 2008, appendix A2, with the signs of Kerbl, Kopanas, Leimkühler,
//! Drettakis, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, 2023.

/// Functions without the constant one.
pub(crate) const COUNT: usize = 15;

/// The functions of degree 1 to 3 for a unit vector, by degree and then order. `N` is a number or several.
#[inline(always)]
pub(crate) fn basis<N>(x: N, y: N, z: N) -> [N; COUNT]
where
    N: Copy + std::ops::Mul<Output = N> + std::ops::Mul<f32, Output = N> + std::ops::Sub<Output = N>,
{
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let (xy, yz, xz) = (x * y, y * z, x * z);
    let difference = xx - yy;
    // Squares sum to 1; the functions are those of the unit sphere.
    let quad = zz * 4.0 - xx - yy;
    [
        y * -0.488_602_5,
        z * 0.488_602_5,
        x * -0.488_602_5,
        xy * 1.092_548_4,
        yz * -1.092_548_4,
        (zz * 2.0 - xx - yy) * 0.315_391_57,
        xz * -1.092_548_4,
        difference * 0.546_274_2,
        y * (xx * 3.0 - yy) * -0.590_043_6,
        xy * z * 2.890_611_4,
        y * quad * -0.457_045_8,
        z * (zz * 2.0 - xx * 3.0 - yy * 3.0) * 0.373_176_34,
        x * quad * -0.457_045_8,
        z * difference * 1.445_305_7,
        x * (xx - yy * 3.0) * -0.590_043_6,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_orthonormal() {
        // Midpoints: azimuths up to 6 + 6 turns are exact, heights of degree 12 right to 4e-4.
        let mut products = [[0.0_f64; COUNT]; COUNT];
        let (rows, columns) = (200, 16);
        for i in 0..rows {
            let z = (i as f64 + 0.5) / f64::from(rows) * 2.0 - 1.0;
            for j in 0..columns {
                let angle = (j as f64 + 0.5) / f64::from(columns) * std::f64::consts::TAU;
                let across = (1.0 - z * z).sqrt();
                let values = basis((across * angle.cos()) as f32, (across * angle.sin()) as f32, z as f32)
                    .map(f64::from);
                let share = 4.0 * std::f64::consts::PI / f64::from(rows * columns);
                for a in 0..COUNT {
                    for b in 0..COUNT {
                        products[a][b] += values[a] * values[b] * share;
                    }
                }
            }
        }
        for (a, row) in products.iter().enumerate() {
            for (b, product) in row.iter().enumerate() {
                let expected = f64::from(u8::from(a == b));
                assert!((product - expected).abs() < 1e-3, "{a}, {b}: {product}");
            }
        }
    }
}
