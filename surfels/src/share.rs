//! What a surfel stands for: moments and looks of the pieces of surface that it owns.

use glam::{DMat3, DVec3, DVec4, Mat3, Vec3, Vec4};

/// Sums over pieces of surface, each with its area; lengths in sides of a cell, places from its middle.
#[derive(Clone, Copy, Default)]
pub(crate) struct Share {
    area: f64,
    first: DVec3,
    /// The columns of a matrix, whose default would be the identity.
    second: [DVec3; 3],
    facing: DVec3,
    normal: DVec3,
    color: DVec4,
}

/// A surfel; lengths in sides of a cell.
pub(crate) struct Surfel {
    pub(crate) center: DVec3,
    /// The factor of its covariance; what it faces is its outward normal.
    pub(crate) factor: Mat3,
    pub(crate) area: f32,
    /// For shading.
    pub(crate) normal: Vec3,
    /// Linear, premultiplied.
    pub(crate) color: Vec4,
}

impl Share {
    /// Adds the place and size of a triangle that faces `facing`; returns its area.
    pub(crate) fn add(&mut self, [a, b, c]: [DVec3; 3], facing: DVec3) -> f64 {
        let area = (b - a).cross(c - a).dot(facing) / 2.0;
        let sum = a + b + c;
        self.area += area;
        self.first += sum * (area / 3.0);
        // ∫ x xᵀ over a triangle is (aaᵀ + bbᵀ + ccᵀ + ssᵀ) area / 12, s being a + b + c.
        for corner in [a, b, c, sum] {
            let column = corner * (area / 12.0);
            self.second
                .iter_mut()
                .zip(corner.to_array())
                .for_each(|(second, along)| *second += column * along);
        }
        self.facing += facing * area;
        area
    }

    /// Adds what a piece of some area looks like: premultiplied colour and shading normal.
    pub(crate) fn add_look(&mut self, area: f64, (color, normal): (Vec4, Vec3)) {
        self.color += color.as_dvec4() * area;
        self.normal += normal.as_dvec3() * area;
    }

    /// The cosine between what it faces and a direction.
    pub(crate) fn cosine(&self, direction: DVec3) -> f64 {
        self.facing.normalize_or_zero().dot(direction)
    }

    /// Its surfel, of the covariance of what it owns and `blur` in each direction of its plane; nothing without area.
    pub(crate) fn surfel(&self, middle: DVec3, blur: f64) -> Option<Surfel> {
        let area = self.area as f32;
        if area.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            return None;
        }
        let center = self.first / self.area;
        let [x, y, z] = center.to_array().map(|along| center * along);
        let covariance = DMat3::from_cols_array_2d(&self.second.map(|v| (v / self.area).to_array()))
            - DMat3::from_cols(x, y, z);
        let facing = self.facing.try_normalize().unwrap_or(DVec3::Z);
        let (u, v) = facing.any_orthonormal_pair();
        let v = if u.cross(v).dot(facing) < 0.0 { -v } else { v };
        // The factor of the covariance in the plane, after Cholesky.
        let along = |a: DVec3, b: DVec3| a.dot(covariance * b);
        let uu = (along(u, u).max(0.0) + blur).sqrt();
        let uv = along(u, v) / uu;
        let vv = (along(v, v).max(0.0) + blur - uv * uv).max(blur).sqrt();
        Some(Surfel {
            center: middle + center,
            factor: Mat3::from_cols((u * uu + v * uv).as_vec3(), (v * vv).as_vec3(), Vec3::ZERO),
            area,
            normal: self.normal.try_normalize().unwrap_or(facing).as_vec3(),
            color: (self.color / self.area).as_vec4(),
        })
    }
}
