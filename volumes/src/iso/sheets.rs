//! How many sheets of a surface go through a cell, and which corners lie inside each.
//!
//! Bit a of a corner's number says upper along axis a; bit c of a mask says that corner c is inside.

use std::sync::LazyLock;

/// The corners of an edge: lower, upper, by axis.
const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];

/// The corners of each face, counter-clockwise seen from outside the cell; lower and upper face by axis.
const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// The mask of the corners on each face, by 2·axis + upper.
pub(super) const FACE_CORNERS: [u8; 6] = {
    let mut masks = [0; 6];
    let mut face = 0;
    while face < 24 {
        masks[face / 4] |= 1 << FACES[face / 4][face % 4];
        face += 1;
    }
    masks
};

/// The sheets for every mask of inside corners, each as the mask of corners inside *it*; 0 for none.
///
/// On each face a run of neighbouring inside corners is cut off by one segment. On a face whose inside corners
/// are diagonal that is one segment for each, so they are parted there, from both sides alike: polygons of
/// neighbouring cells always meet, and a cell has as many polygons as the surface has sheets in it.
/// (Where the interpolant joins such corners instead the polygons differ from it by less than a cell.)
///
/// Segments join to loops, each of which parts the cell's corners in two. An edge is crossed by a loop if and only if its
/// ends are on different sides, so the corners inside a loop say all of it, and a cell of several sheets is several cells of one.
pub(super) static SHEETS: LazyLock<[[u8; 4]; 256]> = LazyLock::new(|| std::array::from_fn(sheets_of));

fn sheets_of(mask: usize) -> [u8; 4] {
    let inside = |corner: usize| mask >> corner & 1 == 1;
    let edge_between =
        |a: usize, b: usize| EDGES.iter().position(|&e| e == (a.min(b), a.max(b))).unwrap_or(0);
    // Every crossed edge is entered on one of its faces and left on the other, so `next` is a permutation.
    let mut next = [None; 12];
    for face in FACES {
        for entry in 0..4 {
            if inside(face[entry]) || !inside(face[(entry + 1) % 4]) {
                continue;
            }
            let mut last = entry + 1;
            while inside(face[(last + 1) % 4]) {
                last += 1;
            }
            let entered = edge_between(face[entry], face[(entry + 1) % 4]);
            next[entered] = Some(edge_between(face[last % 4], face[(last + 1) % 4]));
        }
    }
    let mut sheets = [0; 4];
    let mut count = 0;
    for start in 0..12 {
        let (mut edge, mut crossed) = (start, 0_u16);
        while let Some(following) = next[edge].take() {
            crossed |= 1 << edge;
            edge = following;
        }
        if crossed != 0 && count < 4 {
            sheets[count] = inside_of(mask, crossed);
            count += 1;
        }
    }
    sheets
}

/// The corners on the inner side of a loop: those on its edges are as they are, others as what they hang together with.
fn inside_of(mask: usize, crossed: u16) -> u8 {
    let is_crossed = |edge: usize| crossed >> edge & 1 == 1;
    let mut known = 0;
    for (edge, (a, b)) in EDGES.into_iter().enumerate() {
        if is_crossed(edge) {
            known |= 1 << a | 1 << b;
        }
    }
    let mut sheet = known & mask;
    while known != 0xff {
        for (edge, (a, b)) in EDGES.into_iter().enumerate() {
            for (from, to) in [(a, b), (b, a)] {
                if !is_crossed(edge) && known >> from & 1 == 1 && known >> to & 1 == 0 {
                    known |= 1 << to;
                    sheet |= (sheet >> from & 1) << to;
                }
            }
        }
    }
    sheet as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn every_crossed_edge_is_in_one_sheet() {
        for (mask, sheets) in SHEETS.iter().enumerate() {
            for (a, b) in EDGES {
                let crossed = |mask: usize| (mask >> a ^ mask >> b) & 1;
                let found: usize = sheets.iter().map(|&sheet| crossed(usize::from(sheet))).sum();
                assert_eq!(found, crossed(mask), "mask {mask:08b}, edge {a}{b}");
            }
        }
    }

    /// Corners parted by every face alone: the four that touch at no edge are four sheets.
    #[test]
    fn known_cases() {
        let sorted = |mask: u8| {
            let mut sheets: Vec<u8> = SHEETS[usize::from(mask)].iter().copied().filter(|&s| s != 0).collect();
            sheets.sort_unstable();
            sheets
        };
        assert!(sorted(0).is_empty() && sorted(0xff).is_empty());
        assert_eq!(sorted(0b0000_0001), [0b0000_0001]);
        assert_eq!(sorted(0b1000_0001), [0b0000_0001, 0b1000_0000]);
        // Two corners outside, at opposite ends: two sheets around them.
        assert_eq!(sorted(0b0111_1110), [0b0111_1111, 0b1111_1110]);
        assert_eq!(sorted(0b0110_1001), [0b0000_0001, 0b0000_1000, 0b0010_0000, 0b0100_0000]);
        // Diagonal on a face: parted.
        assert_eq!(sorted(0b0000_1001), [0b0000_0001, 0b0000_1000]);
    }

    #[test]
    fn faces_are_counter_clockwise_from_outside() {
        let position =
            |corner: usize| Vec3::new((corner & 1) as f32, (corner >> 1 & 1) as f32, (corner >> 2) as f32);
        for (face, corners) in FACES.into_iter().enumerate() {
            let [a, b, c, _] = corners.map(position);
            let mut outwards = Vec3::ZERO;
            outwards[face / 2] = if face % 2 == 1 { 1.0 } else { -1.0 };
            assert_eq!((b - a).cross(c - b), outwards, "face {face}");
        }
    }
}
