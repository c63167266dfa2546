//! What the rasterizer keeps of a splat: single precision, one size for all.

use super::ewa::Footprint;
use bytemuck::NoUninit;
use glam::DVec2;

/// How a record's amplitude becomes a fragment or a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, NoUninit)]
#[repr(u8)]
pub enum Kind {
    /// Optical depth.
    Extinction,
    /// Opacity of a fragment.
    Opacity,
    /// Coverage of a surface sample.
    Surface,
}

/// The form of a record's footprint, from the cheapest on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, NoUninit)]
#[repr(u8)]
pub enum Form {
    /// Round and at one distance: see [`Footprint::round`].
    Point,
    /// The perspective denominator dropped.
    Affine,
    /// Exact perspective; where rays are parallel the affine form is exact.
    Exact,
}

impl Form {
    /// All forms, each at its number.
    pub const ALL: [Self; 3] = [Self::Point, Self::Affine, Self::Exact];

    /// What debugging views show it in: red, green, blue.
    pub(crate) fn color(self) -> [f32; 3] {
        std::array::from_fn(|channel| if channel == self as usize { 1.0 } else { 0.0 })
    }
}

/// What a record is besides its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, NoUninit)]
#[repr(C)]
pub struct Tag {
    /// The splat's cloud in the scene.
    pub cloud: u16,
    /// What the amplitude becomes.
    pub kind: Kind,
    /// The form of the footprint.
    pub form: Form,
}

/// A projected splat: one cache line. Offsets u are in pixels from `mean`; see [`Footprint`] for the formulas.
#[derive(Clone, Copy, Debug, NoUninit)]
#[repr(C, align(64))]
pub struct Record {
    /// The projected centre in pixels.
    pub mean: [f32; 2],
    /// z of the centre.
    pub depth: f32,
    /// Amplitude at the centre: optical depth (over |v| in the exact form), opacity, or coverage.
    pub amplitude: f32,
    /// (a, b, c) of q(u) = (a u_x + b u_y)² + (c u_y)².
    pub conic_root: [f32; 3],
    /// Spread in z along the ray through the centre.
    pub sigma_z: f32,
    /// dz/du at the centre, in world units a pixel.
    pub depth_slope: [f32; 2],
    /// Of a surface sample the change of its amplitude a pixel, as n·v changes along the picture: where its plane is follows from
    /// it. Of a volume kernel the first slab that it may touch, where there are slabs, and how many more; the fraction of that number says where an
    /// opacity ends, in 64ths of halvings; of an opacity in 4096 slabs or more that it ends with its rectangle.
    pub amplitude_slope_or_slabs: [f32; 2],
    /// Shaded colour of a volume kernel; base colour of a surface sample. In the blend space.
    pub color: [f32; 3],
    /// Cloud, kind and form.
    pub tag: Tag,
}

impl Record {
    /// Its numbers in the order of its fields; the last one has the bits of the tag.
    #[inline(always)]
    pub(crate) fn numbers(&self) -> &[f32; 16] {
        bytemuck::cast_ref(self)
    }
}

/// The pixels of a record: from `min` up to, not including, `max`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rect {
    /// First column and row.
    pub min: [u16; 2],
    /// One past the last column and row.
    pub max: [u16; 2],
}

impl Rect {
    /// No pixels: around it and another one lies the other one.
    pub(crate) const NONE: Self = Self { min: [u16::MAX; 2], max: [0; 2] };

    /// The least one with the pixels of two.
    pub(crate) fn around_both(&self, other: &Self) -> Self {
        Self {
            min: [0, 1].map(|axis| self.min[axis].min(other.min[axis])),
            max: [0, 1].map(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    /// The pixels of a picture whose centres lie within `half` of `center`; `None` if there are none.
    pub fn around(center: DVec2, half: DVec2, size: [u32; 2]) -> Option<Self> {
        // Single precision moves a pixel by less than this.
        const MARGIN: f64 = 0.01;
        let low = center - half - MARGIN - 0.5;
        let high = center + half + MARGIN - 0.5;
        let (mut min, mut max) = ([0; 2], [0; 2]);
        for axis in 0..2 {
            if low[axis].is_nan() || high[axis].is_nan() {
                return None;
            }
            let last = f64::from(size[axis]);
            let (from, to) = (low[axis].ceil().max(0.0), (high[axis].floor() + 1.0).min(last));
            if from >= to {
                return None;
            }
            min[axis] = from as u16;
            max[axis] = to as u16;
        }
        Some(Self { min, max })
    }
}

/// One pixel of a record.
#[derive(Clone, Copy, Debug)]
pub struct RecordHit {
    /// Squared Mahalanobis distance.
    pub r: f32,
    /// z of the densest point.
    pub z: f32,
    /// Spread in z.
    pub sigma_z: f32,
    /// 1/√den.
    pub scale: f32,
}

/// The unit of the fraction that says where an opacity ends, in halvings. Farther ends count as 63, where a Gaussian has fallen to 1e-19.
pub(crate) const MOST_END: f32 = 64.0;

/// Beside so many slabs there is no room for it: the fraction is [`NO_END`] then, where a Gaussian has fallen to 2e-10, so that the rectangle of its
/// end is where a kernel ends.
pub(super) const MOST_SLABS: f32 = 4096.0;
pub(super) const NO_END: f32 = 0.5;

impl Record {
    /// Nothing.
    pub(crate) const BLANK: Self = Self {
        mean: [0.0; 2],
        depth: 0.0,
        amplitude: 0.0,
        conic_root: [0.0; 3],
        sigma_z: 0.0,
        depth_slope: [0.0; 2],
        amplitude_slope_or_slabs: [0.0; 2],
        color: [0.0; 3],
        tag: Tag { cloud: 0, kind: Kind::Extinction, form: Form::Affine },
    };

    /// Rounds a footprint; amplitude, colour, cloud and kind are the caller's.
    pub fn geometry(footprint: &Footprint, form: Form) -> Self {
        Self {
            mean: [footprint.mean.x as f32, footprint.mean.y as f32],
            conic_root: footprint.conic_root.map(|x| x as f32),
            depth: footprint.depth as f32,
            depth_slope: [footprint.depth_slope.x as f32, footprint.depth_slope.y as f32],
            sigma_z: footprint.sigma_z as f32,
            amplitude: 0.0,
            amplitude_slope_or_slabs: [0.0; 2],
            color: [0.0; 3],
            tag: Tag { cloud: 0, kind: Kind::Extinction, form },
        }
    }

    /// Where an opacity ends, as the power of 1/2 that its Gaussian falls to.
    #[cfg(test)]
    pub(crate) fn end(&self) -> f32 {
        let [_, number] = self.amplitude_slope_or_slabs;
        number.fract() * MOST_END
    }

    /// The last slab that a volume kernel may touch, from its first one and how many follow; of one that is composited at its centre where that is among slabs.
    #[inline(always)]
    pub(crate) fn last_slab(&self) -> f32 {
        let [first, number] = self.amplitude_slope_or_slabs;
        first + number.trunc()
    }

    /// The footprint at offset (x, y) pixels from `mean`.
    #[inline(always)]
    pub fn hit(&self, x: f32, y: f32) -> RecordHit {
        let [a, b, c] = self.conic_root;
        let (along, across) = (a * x + b * y, c * y);
        let q = along * along + across * across;
        let rise = self.depth_slope[0] * x + self.depth_slope[1] * y;
        match self.tag.form {
            Form::Point | Form::Affine => {
                RecordHit { r: q, z: self.depth + rise, sigma_z: self.sigma_z, scale: 1.0 }
            }
            Form::Exact => {
                let t = 1.0 - rise / self.depth;
                let spread = self.sigma_z / self.depth;
                let den = t * t + spread * spread * q;
                let scale = 1.0 / den.sqrt();
                RecordHit { r: q / den, z: self.depth * t / den, sigma_z: self.sigma_z * scale, scale }
            }
        }
    }
}
