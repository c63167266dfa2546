//! STL, binary and ascii.
//!
//! Source: 3D Systems, *StereoLithography Interface Specification*, 1989. Binary: 80 bytes of anything, the number of facets
//! (u32), then 50 bytes for each: normal, three corners (12 f32, all little-endian), 2 attribute bytes. Ascii: `solid`,
//! facets of `facet normal`, `outer loop`, three `vertex`, `endloop`, `endfacet`, and `endsolid`; several solids may follow
//! each other and are read as one. Binary files may begin with `solid` too: where the size is that of the facets
//! declared, the file is binary.
//!
//! Corners are counter-clockwise seen from outside; facets' normals are not read but to count those that say otherwise.
//! Colours in attribute bytes, which programs write in two contradicting ways, are noted and left out. Axes and unit
//! are the file's: the format names none. Each facet has corners of its own; samplers find shared ones by their place.

use super::geometry::{first_not_finite, mesh};
use crate::file::{File, quoted, unmarked};
use crate::scalar::numbers;
use crate::{Content, Endian, ImportError, Note, Opened, Place};
use glam::{DAffine3, Vec3};
use oblate_surfels::{BaseColor, Primitive};

/// Bytes before the facets of a binary file.
const HEADER: usize = 84;
/// Bytes of a facet in a binary file.
const FACET: usize = 50;

/// Whether `bytes` begin like an STL file: text that says so, or the size that a binary one declares.
pub(crate) fn is_stl(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(1024)];
    let has_facet = || head.windows(5).any(|word| word.eq_ignore_ascii_case(b"facet"));
    declared(bytes).is_some_and(|facets| facets > 0 && binary_size(facets) == Some(bytes.len()))
        || (is_text(bytes) && has_facet())
}

pub(crate) fn read(file: &File) -> Result<Opened, ImportError> {
    let exact = declared(&file.bytes).is_some_and(|facets| binary_size(facets) == Some(file.bytes.len()));
    let mut facets = Facets::default();
    let mut notes = Vec::new();
    if is_text(&file.bytes) && !exact {
        facets.read_text(file)?;
    } else {
        facets.read_binary(file, &mut notes)?;
    }
    if facets.against > 0 {
        let what = "facets whose normals point against the order of their corners";
        notes.push(Note::Assumed(format!("the order of corners, for {} {what}", facets.against)));
    }
    Ok(Opened::noting(Content::Mesh(mesh(file, vec![facets.primitive(file)?])?), notes))
}

fn is_text(bytes: &[u8]) -> bool {
    let text = unmarked(bytes).trim_ascii_start();
    let word = text.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    word && text.get(5).is_none_or(u8::is_ascii_whitespace) && !text[..text.len().min(1024)].contains(&0)
}

/// The number of facets that a binary file declares.
fn declared(bytes: &[u8]) -> Option<usize> {
    let number = bytes.get(HEADER - 4..HEADER)?.try_into().ok()?;
    usize::try_from(u32::from_le_bytes(number)).ok()
}

fn binary_size(facets: usize) -> Option<usize> {
    facets.checked_mul(FACET)?.checked_add(HEADER)
}

#[derive(Default)]
struct Facets {
    /// Three for each facet.
    corners: Vec<Vec3>,
    /// Facets whose normal points to the other side than their corners.
    against: usize,
}

impl Facets {
    fn put(&mut self, normal: Vec3, [a, b, c]: [Vec3; 3]) {
        self.corners.extend([a, b, c]);
        self.against += usize::from((b - a).cross(c - a).dot(normal) < 0.0);
    }

    fn read_binary(&mut self, file: &File, notes: &mut Vec<Note>) -> Result<(), ImportError> {
        let bytes = &file.bytes;
        let Some(count) = declared(bytes) else {
            let problem = format!("a binary STL begins with {HEADER} bytes, but there are {}", bytes.len());
            return Err(file.malformed(Place::Whole, problem));
        };
        let facets = binary_size(count).and_then(|size| bytes.get(HEADER..size));
        let Some(facets) = facets else {
            let there = (bytes.len() - HEADER) / FACET;
            let problem = format!("{count} facets are declared, but there are bytes for {there}");
            return Err(file.malformed(Place::Byte(HEADER - 4), problem));
        };
        self.corners.reserve_exact(3 * count);
        let mut colored = 0;
        for (index, facet) in facets.as_chunks::<FACET>().0.iter().enumerate() {
            let mut vectors = [[0.0; 3]; 4];
            for (to, from) in
                vectors.as_flattened_mut().iter_mut().zip(numbers(facet, Endian::Little, f32::from_le_bytes))
            {
                *to = from;
            }
            let [normal, corners @ ..] = vectors;
            if let Some(corner) = first_not_finite(&corners) {
                let problem =
                    format!("corner {corner} of facet {index} is {:?}; it must be finite", corners[corner]);
                return Err(file.malformed(Place::Byte(HEADER + index * FACET + 12 * (corner + 1)), problem));
            }
            self.put(Vec3::from_array(normal), corners.map(Vec3::from_array));
            colored += usize::from(facet[FACET - 2..] != [0, 0]);
        }
        if colored > 0 {
            notes.push(Note::LeftOut(format!("attribute bytes (colours, perhaps) of {colored} facets")));
        }
        let rest = bytes.len() - HEADER - facets.len();
        if rest > 0 {
            notes.push(Note::LeftOut(format!("{rest} bytes behind the {count} facets that are declared")));
        }
        Ok(())
    }

    fn read_text(&mut self, file: &File) -> Result<(), ImportError> {
        // The normal and the corners of a facet that has begun.
        let mut open: Option<(Vec3, Vec<Vec3>)> = None;
        let mut in_solid = false;
        for (line, text) in (1..).zip(file.text().split(|byte| *byte == b'\n')) {
            let malformed = |problem: String| file.malformed(Place::Line(line), problem);
            let text = String::from_utf8_lossy(text);
            let mut words = text.split_ascii_whitespace();
            let Some(word) = words.next() else { continue };
            match (word.to_ascii_lowercase().as_str(), &mut open) {
                ("solid", None) if !in_solid => in_solid = true,
                ("endsolid", None) if in_solid => in_solid = false,
                ("facet", None) if in_solid => {
                    // Programs write all kinds of numbers here where a facet has no area.
                    let normal: Vec<f32> =
                        words.skip(1).take(4).filter_map(|word| word.parse().ok()).collect();
                    let normal = <[f32; 3]>::try_from(normal).map_or(Vec3::ZERO, Vec3::from_array);
                    open = Some((normal, Vec::new()));
                }
                ("outer" | "endloop", Some(_)) => {}
                ("vertex", Some((_, corners))) => {
                    let numbers: Option<Vec<f32>> = words.take(4).map(|word| word.parse().ok()).collect();
                    let corner = numbers.and_then(|numbers| <[f32; 3]>::try_from(numbers).ok());
                    let corner = corner.map(Vec3::from_array).filter(|corner| corner.is_finite());
                    let Some(corner) = corner.filter(|_| corners.len() < 3) else {
                        let problem = format!(
                            "{}: a facet has three corners, each of three finite numbers",
                            quoted(text.trim())
                        );
                        return Err(malformed(problem));
                    };
                    corners.push(corner);
                }
                ("endfacet", Some((normal, corners))) => {
                    let Ok(corners) = <[Vec3; 3]>::try_from(std::mem::take(corners)) else {
                        return Err(malformed("a facet ends that has fewer than three corners".into()));
                    };
                    let normal = *normal;
                    self.put(normal, corners);
                    open = None;
                }
                (word, _) => {
                    let order = "solid, facet, outer loop, three vertex, endloop, endfacet, endsolid are in this order";
                    return Err(malformed(format!("{} is not expected here; {order}", quoted(word))));
                }
            }
        }
        if in_solid {
            return Err(file.malformed(Place::Whole, "the file ends before its endsolid"));
        }
        Ok(())
    }

    fn primitive(self, file: &File) -> Result<Primitive, ImportError> {
        let Ok(count) = u32::try_from(self.corners.len()) else {
            return Err(file.malformed(Place::Whole, "has more than 2^32 corners"));
        };
        Ok(Primitive {
            positions: self.corners,
            triangles: (0..count / 3).map(|facet| [0, 1, 2].map(|corner| 3 * facet + corner)).collect(),
            normals: None,
            tex_coords: None,
            colors: None,
            material: BaseColor::UNSPECIFIED,
            alpha_cutoff: None,
            unlit: false,
            double_sided: true,
            primitive_to_mesh: DAffine3::IDENTITY,
        })
    }
}
