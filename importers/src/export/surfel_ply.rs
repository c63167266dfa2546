//! Splats of any strength as PLY, with every number as it is; the layout is told in [`crate::ply`]'s part for surfels.

use super::ExportError;
use crate::Note;
use crate::ply::surfels::{CENTER, COLOR, Description, FACTOR, Kernel, NORMAL, harmonic};
use glam::{DVec3, Vec3};
use oblate_engine::color::linear_to_srgb;
use oblate_engine::{Blend, Closed, Shapes, Splats, Strength};
use std::io::{Seek, SeekFrom, Write};

/// Splats that are made bytes of at a time.
const ROWS: usize = 4096;

/// Writes splats that are to be mixed in the space `blend`, relative to an origin, binary and little-endian.
pub(crate) fn write(
    splats: &Splats,
    (blend, origin): (Blend, DVec3),
    out: &mut dyn Write,
) -> Result<Vec<Note>, ExportError> {
    check(splats)?;
    let layout = Layout::of(splats, (blend, origin));
    layout.write_header(splats.centers.len(), [0; 2], out)?;
    write_rows(splats, out)?;
    Ok(Vec::new())
}

/// Surfels on their way into a PLY, part by part, as oblate reads them: for those that are never all in memory.
pub struct SurfelWriter<'a, W: Write + Seek + ?Sized> {
    out: &'a mut W,
    blend: Blend,
    origin: DVec3,
    written: Option<(Layout, usize)>,
}

impl<'a, W: Write + Seek + ?Sized> SurfelWriter<'a, W> {
    /// What is written goes to `out`, from its beginning on; the colours of all parts are to be mixed in the space `blend`, and their centres are
    /// relative to an origin in the world.
    pub fn new(out: &'a mut W, blend: Blend, origin: DVec3) -> Self {
        Self { out, blend, origin, written: None }
    }

    /// Appends splats. A surface of several parts is closed from where each of them is.
    ///
    /// # Errors
    /// When there are none or arrays differ in length, when they are of another kind than those before, or writing fails.
    pub fn write(&mut self, splats: &Splats) -> Result<(), ExportError> {
        check(splats)?;
        let mut layout = Layout::of(splats, (self.blend, self.origin));
        let count = match &self.written {
            None => {
                layout.write_header(0, ROOM, self.out)?;
                0
            }
            Some((before, count)) => {
                let closed = layout.closed().and(&before.closed());
                layout.set_closed(&closed);
                if layout != before.clone().with_closed(&closed) {
                    return Err(ExportError::Unsuited("the parts of a file are of one kind".into()));
                }
                *count
            }
        };
        write_rows(splats, self.out)?;
        self.written = Some((layout, count + splats.centers.len()));
        Ok(())
    }

    /// Says in the header how many there are; gives their number.
    ///
    /// # Errors
    /// When there are none, or writing fails.
    pub fn finish(self) -> Result<usize, ExportError> {
        let Some((layout, count)) = self.written else {
            return Err(ExportError::Unsuited("there are no splats to write".into()));
        };
        self.out.rewind()?;
        layout.write_header(count, ROOM, self.out)?;
        self.out.seek(SeekFrom::End(0))?;
        Ok(count)
    }
}

/// Digits of a count that is not yet known, and characters of a description that may get more: six half-spaces have at most 600.
const ROOM: [usize; 2] = [12, 1024];

/// What the numbers of a row are.
#[derive(Clone, Debug, PartialEq)]
struct Layout {
    description: Description,
    has_opacities: bool,
    per_splat: usize,
}

impl Layout {
    fn of(splats: &Splats, (blend, origin): (Blend, DVec3)) -> Self {
        let strength = match &splats.strength {
            Strength::Surface(surface) => Kernel::Surface {
                depth_tolerance: surface.depth_tolerance,
                coverage_floor: surface.coverage_floor,
                closed: surface.closed.clone(),
            },
            Strength::Extinction { .. } => Kernel::Extinction,
            Strength::Opacity { filter, least, .. } => Kernel::Opacity { filter: *filter, least: *least },
        };
        let description = Description {
            strength,
            shared: matches!(splats.shapes, Shapes::Shared(_)),
            normals: splats.normals.is_some(),
            blend,
            material: splats.material,
            origin,
        };
        let has_opacities =
            matches!(&splats.strength, Strength::Surface(surface) if surface.opacities.is_some());
        let per_splat = splats.harmonics.as_ref().map_or(0, |harmonics| harmonics.per_splat());
        Self { description, has_opacities, per_splat }
    }

    /// Of what is no surface everywhere.
    fn closed(&self) -> Closed {
        match &self.description.strength {
            Kernel::Surface { closed, .. } => closed.clone(),
            _ => Closed::EVERYWHERE,
        }
    }

    fn set_closed(&mut self, to: &Closed) {
        if let Kernel::Surface { closed, .. } = &mut self.description.strength {
            closed.clone_from(to);
        }
    }

    fn with_closed(mut self, closed: &Closed) -> Self {
        self.set_closed(closed);
        self
    }

    /// The header, with the count in so many digits at least, and the description in so many characters: those that have enough room
    /// are equally long.
    fn write_header(
        &self,
        count: usize,
        [digits, characters]: [usize; 2],
        out: &mut (impl Write + ?Sized),
    ) -> Result<(), ExportError> {
        let Self { description, has_opacities, per_splat } = self;
        let description_text = description.to_string();
        if characters > 0 && description_text.len() > characters {
            return Err(ExportError::Unsuited(
                "the header has no room for so many planes that the surface ends at".into(),
            ));
        }
        writeln!(out, "ply\nformat binary_little_endian 1.0\ncomment {description_text:characters$}")?;
        writeln!(out, "element vertex {count:0digits$}")?;
        for name in CENTER.into_iter().chain(NORMAL) {
            writeln!(out, "property float {name}")?;
        }
        writeln!(
            out,
            "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float radius"
        )?;
        let opacity = has_opacities.then_some("opacity");
        let strength = description.strength.property();
        for name in FACTOR.into_iter().chain(COLOR).chain([strength]).chain(opacity) {
            writeln!(out, "property float {name}")?;
        }
        for name in (0..*per_splat).flat_map(harmonic) {
            writeln!(out, "property float {name}")?;
        }
        writeln!(out, "end_header")?;
        Ok(())
    }
}

fn write_rows(splats: &Splats, out: &mut (impl Write + ?Sized)) -> Result<(), ExportError> {
    let per_splat = splats.harmonics.as_ref().map_or(0, |harmonics| harmonics.per_splat());
    let (amounts, opacities) = match &splats.strength {
        Strength::Surface(surface) => (&surface.areas, surface.opacities.as_ref()),
        Strength::Extinction { masses: amounts } | Strength::Opacity { peaks: amounts, .. } => {
            (amounts, None)
        }
    };
    let mut bytes = Vec::new();
    for first in (0..splats.centers.len()).step_by(ROWS) {
        bytes.clear();
        for index in first..(first + ROWS).min(splats.centers.len()) {
            let factor = splats.shapes.factor(index);
            let normal = match &splats.normals {
                Some(normals) => normals[index],
                None => factor.x_axis.cross(factor.y_axis).normalize_or_zero(),
            };
            let color = splats.colors[index];
            let radius = factor.to_cols_array_2d().map(|axis| Vec3::from(axis).length());
            push(&mut bytes, &splats.centers[index].to_array());
            push(&mut bytes, &normal.to_array());
            bytes.extend(color.map(|linear| (linear_to_srgb(linear) * 255.0).round() as u8));
            push(&mut bytes, &[radius.into_iter().fold(0.0, f32::max)]);
            push(&mut bytes, &factor.to_cols_array());
            push(&mut bytes, &color);
            push(&mut bytes, &[amounts[index]]);
            if let Some(opacities) = opacities {
                push(&mut bytes, &[opacities[index]]);
            }
            if let Some(harmonics) = &splats.harmonics {
                push(&mut bytes, harmonics.coefficients[index * per_splat..][..per_splat].as_flattened());
            }
        }
        out.write_all(&bytes)?;
    }
    Ok(())
}

fn push(bytes: &mut Vec<u8>, numbers: &[f32]) {
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}

/// That there are splats, and arrays of their number.
fn check(splats: &Splats) -> Result<(), ExportError> {
    let count = splats.centers.len();
    let each = |per_splat: usize, found: usize| found == count * per_splat;
    let strength = match &splats.strength {
        Strength::Surface(surface) => {
            each(1, surface.areas.len()) && surface.opacities.as_ref().is_none_or(|o| each(1, o.len()))
        }
        Strength::Extinction { masses: amounts } | Strength::Opacity { peaks: amounts, .. } => {
            each(1, amounts.len())
        }
    };
    let shapes = match &splats.shapes {
        Shapes::Shared(_) => true,
        Shapes::Each(factors) => each(1, factors.len()),
    };
    let harmonics = splats.harmonics.as_ref().is_none_or(|h| each(h.per_splat(), h.coefficients.len()));
    let normals = splats.normals.as_ref().is_none_or(|normals| each(1, normals.len()));
    if count == 0 {
        Err(ExportError::Unsuited("there are no splats to write".into()))
    } else if !(strength && shapes && harmonics && normals && each(1, splats.colors.len())) {
        Err(ExportError::Unsuited(format!("the arrays of the {count} splats differ in length")))
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Content, OpenOptions, Opened};
    use glam::{DVec3, Mat3};
    use oblate_engine::{HalfSpace, Harmonics, Material, OpacityFilter, Surface};
    use proptest::collection::vec;
    use proptest::prelude::*;

    fn there_and_back(splats: &Splats, (blend, origin): (Blend, DVec3)) -> Opened {
        let mut bytes = Vec::new();
        assert_eq!(write(splats, (blend, origin), &mut bytes).unwrap(), []);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        std::fs::write(&path, bytes).unwrap();
        crate::open(path, &OpenOptions::default()).unwrap()
    }

    fn number() -> impl Strategy<Value = f32> {
        any::<f32>().prop_filter("finite", |number| number.is_finite())
    }

    fn positive() -> impl Strategy<Value = f32> {
        number().prop_map(f32::abs)
    }

    fn vectors(count: usize) -> impl Strategy<Value = Vec<Vec3>> {
        vec(prop::array::uniform3(number()).prop_map(Vec3::from_array), count)
    }

    fn closed() -> impl Strategy<Value = Closed> {
        let number = || any::<f64>().prop_filter("finite", |number| number.is_finite());
        let plane = (prop::array::uniform3(number()), number())
            .prop_map(|(normal, offset)| HalfSpace { normal: DVec3::from_array(normal), offset })
            .prop_filter("a direction", |plane| plane.normal != DVec3::ZERO);
        prop_oneof![
            Just(Closed::Nowhere),
            Just(Closed::Sided),
            Just(Closed::OneSided),
            vec(plane, 0..=6).prop_map(Closed::Within)
        ]
    }

    fn strength(count: usize) -> BoxedStrategy<Strength> {
        let shares = || vec(0.0..=1.0_f32, count);
        let surface =
            (vec(positive(), count), prop::option::of(shares()), positive(), 0.0..1.0_f32, closed())
                .prop_map(|(areas, opacities, depth_tolerance, floor, closed)| {
                    let coverage_floor = 1.0 - floor;
                    Strength::Surface(Surface { areas, opacities, depth_tolerance, coverage_floor, closed })
                });
        let filter = prop_oneof![Just(OpacityFilter::Classic), Just(OpacityFilter::Compensated)];
        prop_oneof![
            surface,
            vec(positive(), count).prop_map(|masses| Strength::Extinction { masses }),
            (shares(), filter, 0.0..=1f32).prop_map(|(peaks, filter, least)| Strength::Opacity {
                peaks,
                filter,
                least
            }),
        ]
        .boxed()
    }

    fn splats() -> impl Strategy<Value = Splats> {
        (1..6_usize, 0..4_u8).prop_flat_map(|(count, degree)| {
            let per_splat = (usize::from(degree) + 1).pow(2) - 1;
            let colors = |count| vec(prop::array::uniform3(number()), count);
            let factor =
                || prop::array::uniform9(number()).prop_map(|columns| Mat3::from_cols_array(&columns));
            let shapes =
                prop_oneof![factor().prop_map(Shapes::Shared), vec(factor(), count).prop_map(Shapes::Each)];
            let material = prop::array::uniform5(positive()).prop_map(
                |[emission, ambient, diffuse, specular, exponent]| Material {
                    emission,
                    ambient,
                    diffuse,
                    specular,
                    exponent,
                },
            );
            let normals = prop::option::of(vectors(count));
            (
                vectors(count),
                shapes,
                strength(count),
                colors(count),
                colors(count * per_splat),
                normals,
                material,
            )
                .prop_map(
                    move |(centers, shapes, strength, colors, coefficients, normals, material)| Splats {
                        centers,
                        shapes,
                        strength,
                        colors,
                        harmonics: (degree > 0).then_some(Harmonics { degree, coefficients }),
                        normals,
                        material,
                    },
                )
        })
    }

    proptest! {
        #[test]
        fn splats_come_back_as_they_were(
            splats in splats(),
            display in any::<bool>(),
            origin in prop::option::of(prop::array::uniform3(-1e9..1e9)),
        ) {
            let blend = if display { Blend::Display } else { Blend::Linear };
            let origin = origin.map_or(DVec3::ZERO, DVec3::from_array);
            let opened = there_and_back(&splats, (blend, origin));
            // Debug text tells the two zeros apart, too.
            prop_assert_eq!(format!("{:?}", opened.content), format!("{:?}", Content::Splats { splats, blend, origin }));
            prop_assert_eq!(opened.notes, []);
        }
    }

    /// Discs on a row, from `first` to before `end`.
    fn discs([first, end]: [usize; 2], closed: &Closed) -> Splats {
        let count = end - first;
        Splats {
            centers: (first..end).map(|i| Vec3::new(i as f32, 2.0, -3.0)).collect(),
            shapes: Shapes::Each(vec![Mat3::from_cols(Vec3::X, Vec3::Y * 0.5, Vec3::ZERO); count]),
            strength: Strength::Surface(Surface {
                areas: (first..end).map(|i| i as f32).collect(),
                opacities: None,
                depth_tolerance: 0.5,
                coverage_floor: 0.75,
                closed: closed.clone(),
            }),
            colors: vec![[0.25, 0.5, 0.75]; count],
            harmonics: None,
            normals: Some(vec![Vec3::Z; count]),
            material: Material::default(),
        }
    }

    #[test]
    fn parts_are_read_as_one() {
        let planes = |count: usize| {
            // Numbers of as many digits as there are.
            let plane = |i: usize| HalfSpace {
                normal: DVec3::new(-1.0 / 3.0, 1e-300, 2.0),
                offset: i as f64 / -7e-7,
            };
            Closed::Within((0..count).map(plane).collect())
        };
        let all = Closed::EVERYWHERE;
        for [middle, last, whole] in [
            [all.clone(), all.clone(), all.clone()],
            // A surface with one open part is open.
            [Closed::Sided, all.clone(), Closed::Sided],
            [planes(2), planes(6), planes(6)],
            [planes(6), Closed::Sided, Closed::Sided],
        ] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.ply");
            let mut file = std::fs::File::create(&path).unwrap();
            let mut writer = SurfelWriter::new(&mut file, Blend::Linear, DVec3::ZERO);
            let end = ROWS + 20;
            for (part, closed) in [([0, 7], &all), ([7, 12], &middle), ([12, end], &last)] {
                writer.write(&discs(part, closed)).unwrap();
            }
            assert_eq!(writer.finish().unwrap(), end);
            let opened = crate::open(&path, &OpenOptions::default()).unwrap();
            assert_eq!(
                opened.content,
                Content::Splats {
                    splats: discs([0, end], &whole),
                    blend: Blend::Linear,
                    origin: DVec3::ZERO
                }
            );
        }
    }

    #[test]
    fn parts_that_do_not_fit_are_refused() {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let mut writer = SurfelWriter::new(&mut bytes, Blend::Linear, DVec3::ZERO);
        writer.write(&discs([0, 3], &Closed::EVERYWHERE)).unwrap();
        let unlit = Splats { material: Material::UNLIT, ..discs([3, 4], &Closed::EVERYWHERE) };
        for other in [unlit, Splats { normals: None, ..discs([3, 4], &Closed::EVERYWHERE) }] {
            assert!(writer.write(&other).unwrap_err().to_string().contains("one kind"));
        }
        assert!(
            writer.write(&discs([3, 3], &Closed::EVERYWHERE)).unwrap_err().to_string().contains("no splats")
        );
        assert_eq!(writer.finish().unwrap(), 3);
        let empty = SurfelWriter::new(&mut bytes, Blend::Linear, DVec3::ZERO).finish();
        assert!(empty.unwrap_err().to_string().contains("no splats"));
    }

    #[test]
    fn what_other_programs_read() {
        let splats = Splats {
            centers: vec![Vec3::new(1.0, 2.0, 3.0)],
            shapes: Shapes::Each(vec![Mat3::from_cols(Vec3::Y * 2.0, Vec3::Z * 0.5, Vec3::ZERO)]),
            strength: Strength::Extinction { masses: vec![1.0] },
            colors: vec![[0.0, 1.0, 0.214_041_14]],
            harmonics: None,
            normals: None,
            material: Material::default(),
        };
        let mut bytes = Vec::new();
        write(&splats, (Blend::Linear, DVec3::ZERO), &mut bytes).unwrap();
        let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        let floats = |at: usize, count: usize| -> Vec<f32> {
            bytes[end + at..][..count * 4].as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
        };
        assert_eq!(floats(0, 6), [1.0, 2.0, 3.0, 1.0, 0.0, 0.0], "centre and normal");
        // Linear 0.214 is the middle of sRGB: IEC 61966-2-1.
        assert_eq!(&bytes[end + 24..end + 27], [0, 255, 128]);
        assert_eq!(floats(27, 1), [2.0], "radius");
        assert_eq!(bytes.len(), end + 27 + 4 * (1 + 9 + 3 + 1));
    }

    #[test]
    fn nothing_and_uneven_arrays_are_refused() {
        let none = Splats {
            centers: Vec::new(),
            shapes: Shapes::Shared(Mat3::IDENTITY),
            strength: Strength::Extinction { masses: Vec::new() },
            colors: Vec::new(),
            harmonics: None,
            normals: None,
            material: Material::default(),
        };
        let message = |splats: &Splats| {
            write(splats, (Blend::Linear, DVec3::ZERO), &mut Vec::new()).unwrap_err().to_string()
        };
        assert!(message(&none).contains("no splats"));
        assert!(message(&Splats { centers: vec![Vec3::ZERO], ..none }).contains("differ in length"));
    }
}
