//! A hierarchy of boxes, and which of them the ray through a point of the picture may meet.

use glam::{DAffine3, DMat3, DVec2, DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// The line through a point of the picture, widened by the pixel's filter.
///
/// Its space is the camera's, sheared so that the line is the z axis: what lies on it has x = y = 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Needle {
    pub(super) world_to_needle: DAffine3,
    /// How far the filter reaches across: at each z, or a unit of z where rays meet in the eye.
    pub(super) filter_reach: DVec2,
    pub(super) perspective: bool,
    pub(super) near: f64,
}

impl Needle {
    /// Whether something in a box, given by its middle and half its extent, may be met; `to_needle` is from the box's space.
    fn meets(&self, to_needle: &DAffine3, middle: DVec3, half: DVec3) -> bool {
        let middle = to_needle.transform_point3(middle);
        let DMat3 { x_axis, y_axis, z_axis } = to_needle.matrix3;
        let half = x_axis.abs() * half.x + y_axis.abs() * half.y + z_axis.abs() * half.z;
        // The filter of a splat is as wide as its distance makes it; none in the box has a larger one.
        let farthest = if self.perspective { middle.z.abs() + half.z } else { 1.0 };
        let reach = half.truncate() + self.filter_reach * farthest;
        // Said of what it misses: numbers beyond all range are met.
        let misses = middle.truncate().abs().cmpgt(reach).any() || middle.z + half.z < self.near;
        !misses
    }
}

/// Boxes under boxes.
pub(super) struct BoxTree {
    pub(super) bvh: Bvh2,
    /// Boxes are kept where all of them lie within ±1, so that single precision holds any of them.
    unit_to_space: DAffine3,
}

impl BoxTree {
    /// The hierarchy of boxes, each given by its smallest and largest corner.
    pub(super) fn new(boxes: &[[DVec3; 2]]) -> Self {
        let [low, high] = bounds(boxes);
        let middle = (low + high) / 2.0;
        let extent = ((high - low) / 2.0).max_element();
        let scale = if extent > 0.0 && extent.is_finite() { extent } else { 1.0 };
        // Corners that overflow are those of the whole.
        let unit = |p: DVec3, whole: f64| {
            let p = (p - middle) / scale;
            p.to_array().map(|x| if x.is_nan() { whole } else { x.clamp(-1.0, 1.0) } as f32)
        };
        let aabb = |(index, [low, high]): (usize, &[DVec3; 2])| {
            let low = Vec3A::from(unit(*low, -1.0).map(f32::next_down));
            let high = Vec3A::from(unit(*high, 1.0).map(f32::next_up));
            // Points need room too, in which single precision tells them apart.
            let size = (high - low).max(Vec3A::splat(0.01));
            Aabb::new(low - size * spread(2 * index), high + size * spread(2 * index + 1))
        };
        let aabbs: Vec<Aabb> = boxes.iter().enumerate().map(aabb).collect();
        let indices = (0..aabbs.len() as u32).collect();
        let search = PlocSearchDistance::VeryLow;
        let bvh = PlocBuilder::new().build(search, &aabbs, indices, SortPrecision::U64, 0);
        let unit_to_space =
            DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(scale)), middle);
        Self { bvh, unit_to_space }
    }

    /// Calls back with the numbers of all boxes that the needle may meet, in no order; `space_to_needle` is from the boxes'
    /// space.
    pub(super) fn pierced(&self, needle: &Needle, space_to_needle: DAffine3, found: &mut dyn FnMut(usize)) {
        let to_needle = space_to_needle * self.unit_to_space;
        let mut open = Vec::with_capacity(64);
        open.extend((!self.bvh.nodes.is_empty()).then_some(0));
        while let Some(node) = open.pop() {
            let node = &self.bvh.nodes[node];
            let [low, high] = [node.aabb.min, node.aabb.max].map(|corner| corner.as_dvec3());
            if !needle.meets(&to_needle, (low + high) / 2.0, (high - low) / 2.0) {
                continue;
            }
            let first = node.first_index as usize;
            if node.prim_count == 0 {
                open.extend([first, first + 1]);
            } else {
                let primitives = &self.bvh.primitive_indices[first..first + node.prim_count as usize];
                primitives.iter().for_each(|primitive| found(*primitive as usize));
            }
        }
    }
}

/// The smallest box around boxes; the origin without any.
pub(super) fn bounds(boxes: &[[DVec3; 2]]) -> [DVec3; 2] {
    let around = |[low, high]: [DVec3; 2], own: &[DVec3; 2]| [low.min(own[0]), high.max(own[1])];
    boxes.iter().skip(1).fold(boxes.first().copied().unwrap_or_default(), around)
}

/// By how much of its size a box is enlarged on one side along each axis, up to 1 %: boxes that coincide, or lie in each other
/// one by one, make a chain instead of a tree, in quadratic time.
fn spread(number: usize) -> Vec3A {
    // The upper bits of a product with 2⁶⁴/φ (Knuth, *The Art of Computer Programming*, vol. 3, §6.4).
    let hash = (number as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let share = |shift: u32| (hash >> shift & 0xffff) as f32 / 65_536.0;
    Vec3A::new(share(48), share(32), share(16)) * 0.99e-2 + 1e-4
}
