//! The plane that a point's neighbours lie about, and the part of it that is the point's own.

use glam::{DMat3, DVec3, Vec2, Vec3};

/// Corners of the polygon that stands for a disc.
const DISC_CORNERS: usize = 16;

/// Up to this share of the largest variance the second is that of noise about a line. The 12 nearest points of a line spread
/// over 3.7 spacings along it, so of noise of up to 0.6 spacings; of 1000 random neighbourhoods in a plane all have more than 0.09.
const LINE: f64 = 0.03;

/// Of fewer neighbours, which may lie in a plane as long, only this is.
const LINE_OF_FEW: f64 = 1e-4;
const ENOUGH: usize = 12;

/// Beyond this share of the second variance the least is more than noise about a plane: of noise of 0.3 spacings nine tenths
/// have less, of points at random in space one in a hundred.
const SPACE: f64 = 0.15;

/// The directions in which the neighbourhood of a point spreads.
#[derive(Clone, Copy)]
pub(crate) enum Spread {
    /// In all, the least along this unit direction, of either sign.
    Space(Vec3),
    /// About a plane with this unit normal, of either sign.
    Plane(Vec3),
    /// Along a line with this unit direction.
    Line(Vec3),
    /// No two points apart.
    Point,
}

/// From the covariance of a point, which is the origin, and its neighbours: Hoppe, DeRose, Duchamp, McDonald,
/// Stuetzle, *Surface reconstruction from unorganized points*, 1992, section 3.1.
pub(crate) fn spread(neighbors: &[Vec3]) -> Spread {
    let count = neighbors.len() as f64 + 1.0;
    let mean = neighbors.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / count;
    let mut covariance = outer(mean);
    for neighbor in neighbors {
        covariance += outer(neighbor.as_dvec3() - mean);
    }
    let (variances, axes) = eigen(covariance);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| variances[a].total_cmp(&variances[b]));
    let [least, middle, most] = order;
    let line = if neighbors.len() < ENOUGH { LINE_OF_FEW } else { LINE };
    if variances[most] <= 0.0 {
        Spread::Point
    } else if variances[middle] <= line * variances[most] {
        Spread::Line(axes.col(most).as_vec3().normalize_or_zero())
    } else if variances[least] > SPACE * variances[middle] {
        Spread::Space(axes.col(least).as_vec3().normalize_or_zero())
    } else {
        Spread::Plane(axes.col(least).as_vec3().normalize_or_zero())
    }
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Eigenvalues of a symmetric matrix and a rotation whose columns are their vectors, by Jacobi's rotations (Golub,
/// Van Loan, *Matrix Computations*, section 8.5).
fn eigen(mut matrix: DMat3) -> (DVec3, DMat3) {
    let mut vectors = DMat3::IDENTITY;
    let size = matrix.to_cols_array().iter().fold(0.0_f64, |size, value| size.max(value.abs()));
    // Each round squares what is off the diagonal; six leave nothing of it.
    for _ in 0..6 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = matrix.col(q)[p];
            if off.abs() <= 1e-16 * size {
                continue;
            }
            // Finite: the other elements are at most 10¹⁶ times as large.
            let theta = (matrix.col(q)[q] - matrix.col(p)[p]) / (2.0 * off);
            let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let sine = tangent * cosine;
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = cosine;
            turn.col_mut(q)[q] = cosine;
            turn.col_mut(p)[q] = -sine;
            turn.col_mut(q)[p] = sine;
            matrix = turn.transpose() * matrix * turn;
            vectors *= turn;
        }
    }
    (DVec3::new(matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z), vectors)
}

/// Buffers for [`cell_area`].
#[derive(Default)]
pub(crate) struct Polygon {
    corners: Vec<Vec2>,
    clipped: Vec<Vec2>,
}

/// The area of a point's Voronoi cell in its tangent plane: what of the plane, within `radius`, is nearer to the point,
/// which is the origin, than to any of its neighbours, given from near to far.
///
/// Distances are those of space: points on the other side of a thin wall take nothing away, and where surfaces bend the
/// cells overlap no more than they do seen from where they meet. No point farther than 2 `radius` matters.
pub(crate) fn cell_area(normal: Vec3, radius: f32, neighbors: &[Vec3], polygon: &mut Polygon) -> f32 {
    let (e1, e2) = normal.any_orthonormal_pair();
    let Polygon { corners, clipped } = polygon;
    corners.clear();
    // A polygon of the disc's area.
    let step = std::f32::consts::TAU / DISC_CORNERS as f32;
    let circumradius = radius * (step / step.sin()).sqrt();
    corners.extend((0..DISC_CORNERS).map(|i| circumradius * Vec2::from_angle(i as f32 * step)));
    let mut farthest = circumradius;
    for &neighbor in neighbors {
        let squared = neighbor.length_squared();
        if squared >= 4.0 * farthest * farthest {
            break;
        }
        // Nearer to the origin: x·q ≤ |q|²/2.
        let toward = Vec2::new(neighbor.dot(e1), neighbor.dot(e2));
        let side = |x: Vec2| x.dot(toward) - squared / 2.0;
        clipped.clear();
        let mut before = corners.last().copied().unwrap_or_default();
        farthest = 0.0;
        for &corner in corners.iter() {
            let sides = [side(before), side(corner)];
            if (sides[0] <= 0.0) != (sides[1] <= 0.0) {
                clipped.push(before + (corner - before) * (sides[0] / (sides[0] - sides[1])));
            }
            if sides[1] <= 0.0 {
                clipped.push(corner);
            }
            before = corner;
        }
        std::mem::swap(corners, clipped);
        farthest = corners.iter().map(|corner| corner.length()).fold(farthest, f32::max);
    }
    let next = corners.iter().cycle().skip(1);
    corners.iter().zip(next).map(|(a, b)| a.perp_dot(*b)).sum::<f32>() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(neighbors: &[Vec3]) -> f32 {
        cell_area(Vec3::Z, 1.0, neighbors, &mut Polygon::default())
    }

    #[test]
    fn cells_of_regular_neighbourhoods() {
        let around = |count: usize, distance: f32| {
            let step = std::f32::consts::TAU / count as f32;
            let place = move |i| (distance * Vec2::from_angle(0.1 + i as f32 * step)).extend(0.0);
            (0..count).map(place).collect::<Vec<Vec3>>()
        };
        // A regular n-gon about a circle of radius r has the area n r² tan(π/n).
        for (count, expected) in [(3, 0.2025 * 5.196_152), (4, 0.2025 * 4.0), (6, 0.2025 * 3.464_102)] {
            assert!((area(&around(count, 0.9)) - expected).abs() < 1e-5, "{count}");
        }
        assert!((area(&[]) - std::f32::consts::PI).abs() < 1e-5);
        assert_eq!(area(&around(5, 2.0 * 1.1)), area(&[]));
        // A line through the disc's middle and one at half its radius leave it less by known segments; the polygon of
        // its area, with 16 corners, is off by the area between them at most: 1.3 %.
        let half = area(&[Vec3::new(1.0, 0.0, 0.0)]) / std::f32::consts::PI;
        assert!((half - 0.804_5).abs() < 0.013, "{half}");
        // Above and below nothing is taken away.
        assert_eq!(area(&[Vec3::Z, -0.5 * Vec3::Z]), area(&[]));
        assert_eq!(area(&[Vec3::ZERO]), area(&[]));
    }

    #[test]
    fn lines_and_points_are_told_from_planes() {
        let along = Vec3::new(1.0, -2.0, 3.0).normalize();
        let line: Vec<Vec3> = (1..9).map(|i| along * (i * i) as f32).collect();
        assert!(matches!(spread(&line), Spread::Line(found) if found.dot(along).abs() > 1.0 - 1e-6));
        assert!(matches!(spread(&[]), Spread::Point));
        assert!(matches!(spread(&[Vec3::ZERO; 4]), Spread::Point));
    }

    proptest! {
        #[test]
        fn eigenvectors_are_those_of_the_matrix(values in prop::array::uniform6(-1e3_f64..1e3)) {
            let [a, b, c, d, e, f] = values;
            let matrix = DMat3::from_cols_array(&[a, b, c, b, d, e, c, e, f]);
            let (found, vectors) = eigen(matrix);
            let again = vectors * DMat3::from_diagonal(found) * vectors.transpose();
            // 18 rotations of rounding 1e-16 each, of numbers up to 3e3.
            prop_assert!(again.abs_diff_eq(matrix, 1e-10), "{again} {matrix}");
            prop_assert!((vectors.transpose() * vectors).abs_diff_eq(DMat3::IDENTITY, 1e-13));
        }

        #[test]
        fn planes_have_the_normal_that_they_were_made_with(
            normal in prop::array::uniform3(-1.0_f32..1.0),
            places in prop::collection::vec((-1.0_f32..1.0, -1.0_f32..1.0), 4..20),
        ) {
            let Some(normal) = Vec3::from(normal).try_normalize() else { return Ok(()) };
            let (u, v) = normal.any_orthonormal_pair();
            let points: Vec<Vec3> = places.iter().map(|(a, b)| u * *a + v * *b).collect();
            if let Spread::Plane(found) = spread(&points) {
                // Rounding off the plane is 2e-7 of the largest distance from the origin, which is a point too, and so
                // at most 5 standard deviations of the 20 points; across them they spread a hundredth as much at least.
                prop_assert!(found.cross(normal).length() < 2e-4, "{found} {normal}");
            }
        }
    }
}
