//! Splats as oblate itself writes them: any strength, with every number as it was.
//!
//! A PLY of one element `vertex`, known by its comment `oblate surfels 1 KEY VALUE …`. Properties, in any order:
//! - `x y z`: the centre.
//! - `u_x u_y u_z`, `v_x v_y v_z`, `w_x w_y w_z`: the columns of the factor, which are half-axes; w is zero for flat
//!   surfels.
//! - `linear_red linear_green linear_blue`: the colour, linear Rec. 709.
//! - `nx ny nz`: the unit normal for shading, or zero. With `normals shape` splats have none of their own, and what the
//!   file holds is that of the shape, for other programs.
//! - `area` and where surfaces are translucent `opacity`; or `mass`; or `peak`: what the comment's `strength` asks for.
//! - `h0_red h0_green h0_blue h1_red …`: none, 3, 8 or 15 harmonics by which the colour depends on the view.
//! - `red green blue` (sRGB-encoded bytes) and `radius` (the longest half-axis) are for other programs, which take the
//!   file for a cloud of points with normals, colours and radii.
//!
//! The comment's keys are those of [`Description`], all of which must be there.

use super::body::{Body, Column};
use super::header::{Element, Header, Kind};
use crate::file::File;
use crate::{Content, ImportError, Opened, Place};
use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{
    Blend, Closed, HalfSpace, Harmonics, Material, OpacityFilter, Shapes, Splats, Strength, Surface,
};
use std::collections::HashMap;
use std::fmt;

/// What the comment begins with.
const MARK: &str = "oblate surfels";

pub(crate) const CENTER: [&str; 3] = ["x", "y", "z"];
pub(crate) const NORMAL: [&str; 3] = ["nx", "ny", "nz"];
pub(crate) const FACTOR: [&str; 9] = ["u_x", "u_y", "u_z", "v_x", "v_y", "v_z", "w_x", "w_y", "w_z"];
pub(crate) const COLOR: [&str; 3] = ["linear_red", "linear_green", "linear_blue"];

/// The names of harmonic `number`, for each channel.
pub(crate) fn harmonic(number: usize) -> [String; 3] {
    ["red", "green", "blue"].map(|channel| format!("h{number}_{channel}"))
}

/// What is said once for all splats, in the comment.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Description {
    pub(crate) strength: Kernel,
    /// `shapes`: whether all splats have one factor (`shared`) or each has its own (`each`).
    pub(crate) shared: bool,
    /// `normals`: whether splats have normals of their own (`own`) or none but their shape's (`shape`).
    pub(crate) normals: bool,
    /// `blend`: the space in which colours mix, `linear` or `display`.
    pub(crate) blend: Blend,
    /// `emission`, `ambient`, `diffuse`, `specular`, `exponent`.
    pub(crate) material: Material,
    /// `origin`: what centres are relative to, three numbers; not there where that is nothing.
    pub(crate) origin: DVec3,
}

/// What an opacity should be.
const SHARE: &str = "an opacity is from 0 to 1";

/// `strength`, with what belongs to it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Kernel {
    /// `surface`, with `depth_tolerance`, `coverage_floor`, `closed` (0 or 1), and where it is closed within half-spaces alone, `within`:
    /// four numbers each, the normal's and the offset; or `sides`: 1 where its backs are not shown to anybody, 2 where it isn't closed but neighbours
    /// face the same way.
    Surface { depth_tolerance: f32, coverage_floor: f32, closed: Closed },
    /// `extinction`.
    Extinction,
    /// `opacity`, with `filter`: `classic` or `compensated`; and `least`, where it isn't 0.
    Opacity { filter: OpacityFilter, least: f32 },
}

impl Kernel {
    /// The property with each splat's strength.
    pub(crate) fn property(&self) -> &'static str {
        match self {
            Self::Surface { .. } => "area",
            Self::Extinction => "mass",
            Self::Opacity { .. } => "peak",
        }
    }
}

/// The comment, without its word `comment`.
impl fmt::Display for Description {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{MARK} 1 strength ")?;
        match &self.strength {
            Kernel::Surface { depth_tolerance, coverage_floor, closed } => {
                write!(f, "surface depth_tolerance {depth_tolerance:?} coverage_floor {coverage_floor:?}")?;
                write_closed(f, closed)?;
            }
            Kernel::Extinction => write!(f, "extinction")?,
            Kernel::Opacity { filter, least } => {
                let filter = match filter {
                    OpacityFilter::Classic => "classic",
                    OpacityFilter::Compensated => "compensated",
                };
                write!(f, "opacity filter {filter}")?;
                if *least != 0.0 {
                    write!(f, " least {least:?}")?;
                }
            }
        }
        let Material { emission, ambient, diffuse, specular, exponent } = self.material;
        write!(
            f,
            " shapes {} normals {} blend {} emission {emission:?} ambient {ambient:?} diffuse {diffuse:?} \
             specular {specular:?} exponent {exponent:?}",
            if self.shared { "shared" } else { "each" },
            if self.normals { "own" } else { "shape" },
            if self.blend == Blend::Linear { "linear" } else { "display" },
        )?;
        if self.origin != DVec3::ZERO {
            let DVec3 { x, y, z } = self.origin;
            write!(f, " origin {x:?},{y:?},{z:?}")?;
        }
        Ok(())
    }
}

fn write_closed(f: &mut fmt::Formatter<'_>, closed: &Closed) -> fmt::Result {
    let planes = match closed {
        Closed::Nowhere => return write!(f, " closed 0"),
        Closed::Sided => return write!(f, " closed 0 sides 2"),
        Closed::OneSided => return write!(f, " closed 1 sides 1"),
        Closed::Within(planes) => planes,
    };
    write!(f, " closed 1")?;
    for (number, HalfSpace { normal, offset }) in planes.iter().enumerate() {
        let DVec3 { x, y, z } = normal;
        write!(f, "{}{x:?},{y:?},{z:?},{offset:?}", if number == 0 { " within " } else { "," })?;
    }
    Ok(())
}

/// Keys and values of a comment that have not been asked for yet.
struct Words<'a>(HashMap<&'a str, &'a str>);

impl Words<'_> {
    fn one_of<T: Clone>(&mut self, key: &str, values: &[(&str, T)]) -> Result<T, String> {
        let found = self.0.remove(key).ok_or_else(|| format!("{key:?} is missing"))?;
        let value = values.iter().find(|(name, _)| *name == found);
        value.map(|(_, value)| value.clone()).ok_or_else(|| {
            let names: Vec<&str> = values.iter().map(|(name, _)| *name).collect();
            format!("{key} is {found:?}; it is {}", names.join(" or "))
        })
    }

    fn number(&mut self, key: &str, right: impl Fn(f32) -> bool, expected: &str) -> Result<f32, String> {
        let found = self.0.remove(key).ok_or_else(|| format!("{key:?} is missing"))?;
        let number = found.parse().ok().filter(|number: &f32| number.is_finite() && right(*number));
        number.ok_or_else(|| format!("{key} is {found:?}; {expected}"))
    }

    fn closed(&mut self) -> Result<Closed, String> {
        let is_closed = self.one_of("closed", &[("0", false), ("1", true)])?;
        if self.0.contains_key("sides") {
            let (own, closed) =
                self.one_of("sides", &[("1", (true, Closed::OneSided)), ("2", (false, Closed::Sided))])?;
            return if own == is_closed {
                Ok(closed)
            } else {
                Err("sides 1 is for closed 1, 2 for closed 0".into())
            };
        }
        if !is_closed {
            return Ok(Closed::Nowhere);
        }
        let Some(list) = self.0.remove("within") else { return Ok(Closed::EVERYWHERE) };
        let wrong = || {
            format!("within is {list:?}; it is four numbers for each half-space, the first three not all 0")
        };
        let numbers: Option<Vec<f64>> = list.split(',').map(|number| number.parse().ok()).collect();
        let numbers = numbers.filter(|numbers| numbers.iter().all(|number: &f64| number.is_finite()));
        let numbers = numbers.ok_or_else(wrong)?;
        let (planes, rest) = numbers.as_chunks();
        let plane = |&[x, y, z, offset]: &[f64; 4]| HalfSpace { normal: DVec3::new(x, y, z), offset };
        let planes: Vec<HalfSpace> = planes.iter().map(plane).collect();
        if !rest.is_empty() || planes.iter().any(|plane| plane.normal == DVec3::ZERO) {
            return Err(wrong());
        }
        Ok(Closed::Within(planes))
    }
}

impl Words<'_> {
    fn origin(&mut self) -> Result<DVec3, String> {
        let Some(list) = self.0.remove("origin") else { return Ok(DVec3::ZERO) };
        let numbers: Option<Vec<f64>> = list.split(',').map(|number| number.parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[x, y, z]) if x.is_finite() && y.is_finite() && z.is_finite() => Ok(DVec3::new(x, y, z)),
            _ => Err(format!("origin is {list:?}; it is three finite numbers")),
        }
    }
}

impl Description {
    /// What words after the version say.
    fn parse(text: &str) -> Result<Self, String> {
        let list: Vec<&str> = text.split_whitespace().collect();
        let (pairs, rest) = list.as_chunks::<2>();
        let mut words = Words(pairs.iter().map(|[key, value]| (*key, *value)).collect());
        if !rest.is_empty() || words.0.len() != pairs.len() {
            return Err("keys and values must alternate, each key once".into());
        }
        let not_negative = |number: f32| number >= 0.0;
        const NOT_NEGATIVE: &str = "it must be finite and at least 0";
        let strength = match words.one_of("strength", &[("surface", 0), ("extinction", 1), ("opacity", 2)])? {
            0 => Kernel::Surface {
                depth_tolerance: words.number("depth_tolerance", not_negative, NOT_NEGATIVE)?,
                coverage_floor: words.number(
                    "coverage_floor",
                    |floor| floor > 0.0 && floor <= 1.0,
                    "it must be above 0 and at most 1",
                )?,
                closed: words.closed()?,
            },
            1 => Kernel::Extinction,
            _ => Kernel::Opacity {
                filter: words.one_of(
                    "filter",
                    &[("classic", OpacityFilter::Classic), ("compensated", OpacityFilter::Compensated)],
                )?,
                least: if words.0.contains_key("least") {
                    words.number("least", |least| (0.0..=1.0).contains(&least), SHARE)?
                } else {
                    0.0
                },
            },
        };
        let description = Self {
            strength,
            shared: words.one_of("shapes", &[("each", false), ("shared", true)])?,
            normals: words.one_of("normals", &[("shape", false), ("own", true)])?,
            blend: words.one_of("blend", &[("linear", Blend::Linear), ("display", Blend::Display)])?,
            material: Material {
                emission: words.number("emission", not_negative, NOT_NEGATIVE)?,
                ambient: words.number("ambient", not_negative, NOT_NEGATIVE)?,
                diffuse: words.number("diffuse", not_negative, NOT_NEGATIVE)?,
                specular: words.number("specular", not_negative, NOT_NEGATIVE)?,
                exponent: words.number("exponent", not_negative, NOT_NEGATIVE)?,
            },
            origin: words.origin()?,
        };
        match words.0.keys().min() {
            None => Ok(description),
            Some(key) => Err(format!("{key:?} is no key of this comment")),
        }
    }
}

/// Whether a comment says that the file is of this kind.
pub(super) fn is_ours(header: &Header) -> bool {
    header.comments.iter().any(|(_, comment)| comment.starts_with(MARK))
}

/// Reads the splats, in the order of the file.
pub(super) fn read(file: &File, header: &Header) -> Result<Opened, ImportError> {
    let mut ours = header.comments.iter().filter(|(_, comment)| comment.starts_with(MARK));
    let missing = || file.malformed(Place::Whole, format!("no comment begins with {MARK:?}"));
    let (line, comment) = ours.next().ok_or_else(missing)?;
    if let Some((second, _)) = ours.next() {
        let problem = format!("a second comment that begins with {MARK:?}");
        return Err(file.malformed(Place::Line(*second), problem));
    }
    let (version, text) = comment[MARK.len()..].trim().split_once(' ').unwrap_or_default();
    if version != "1" {
        let feature = format!("surfels of version {version:?}; version 1 is supported");
        return Err(file.unsupported(Place::Line(*line), feature));
    }
    let description = Description::parse(text)
        .map_err(|problem| file.malformed(Place::Line(*line), format!("{MARK}: {problem}")))?;
    let mut body = Body::new(file, header);
    for element in &header.elements {
        if element.name == "vertex" {
            return Columns::read(file, &mut body, element)?.splats(element, description);
        }
        drop(body.gather::<f32>(element, &[])?);
    }
    Err(file.malformed(Place::Whole, "surfels need an element \"vertex\""))
}

/// The columns of a file that have not been taken yet.
struct Columns<'a> {
    file: &'a File,
    rows: usize,
    by_name: HashMap<String, Vec<f32>>,
}

impl<'a> Columns<'a> {
    fn read(file: &'a File, body: &mut Body<'_>, element: &Element) -> Result<Self, ImportError> {
        if element.rows == 0 {
            return Err(file.malformed(Place::Whole, "there are no surfels in it, at least one is needed"));
        }
        let is_number = |kind| matches!(kind, Kind::Scalar(_));
        let for_others = ["red", "green", "blue", "radius"];
        let names: Vec<&str> = (element.properties.iter())
            .filter(|property| is_number(property.kind) && !for_others.contains(&property.name.as_str()))
            .map(|property| property.name.as_str())
            .collect();
        let columns = body.gather::<f32>(element, &names)?;
        let values = |column: Option<Column<f32>>| column.map(|column| column.values).unwrap_or_default();
        let by_name =
            names.iter().map(|name| (*name).to_owned()).zip(columns.into_iter().map(values)).collect();
        Ok(Self { file, rows: element.rows, by_name })
    }

    /// A column whose values are all finite and `right`.
    fn take(
        &mut self,
        name: &str,
        right: impl Fn(f32) -> bool,
        expected: &str,
    ) -> Result<Vec<f32>, ImportError> {
        let Some(values) = self.by_name.remove(name) else {
            let problem = format!("vertices have no property {name}, which is a number of every surfel");
            return Err(self.file.malformed(Place::Whole, problem));
        };
        match values.iter().position(|value| !(value.is_finite() && right(*value))) {
            None => Ok(values),
            Some(row) => {
                let problem = format!("{name} is {}; {expected}", values[row]);
                Err(self.file.malformed(Place::Part(format!("vertex {row}")), problem))
            }
        }
    }

    /// `N` columns of finite numbers side by side.
    fn rows<const N: usize>(&mut self, names: [&str; N]) -> Result<Vec<[f32; N]>, ImportError> {
        let mut rows = vec![[0.0; N]; self.rows];
        for (place, name) in names.into_iter().enumerate() {
            let column = self.take(name, |_| true, "it must be finite")?;
            for (row, value) in rows.iter_mut().zip(column) {
                row[place] = value;
            }
        }
        Ok(rows)
    }

    fn vectors(&mut self, names: [&str; 3]) -> Result<Vec<Vec3>, ImportError> {
        Ok(self.rows(names)?.into_iter().map(Vec3::from_array).collect())
    }

    fn splats(mut self, element: &Element, description: Description) -> Result<Opened, ImportError> {
        let centers = self.vectors(CENTER)?;
        let factors: Vec<Mat3> = self.rows(FACTOR)?.iter().map(Mat3::from_cols_array).collect();
        let shapes = match (description.shared, factors[0]) {
            (false, _) => Shapes::Each(factors),
            (true, first) => match factors.iter().position(|factor| *factor != first) {
                None => Shapes::Shared(first),
                Some(row) => {
                    let problem = "its half-axes are not vertex 0's, but shapes are shared";
                    return Err(self.file.malformed(Place::Part(format!("vertex {row}")), problem));
                }
            },
        };
        let not_negative = |value: f32| value >= 0.0;
        let strengths = |columns: &mut Self, right: &dyn Fn(f32) -> bool, expected| {
            columns.take(description.strength.property(), right, expected)
        };
        let share = |value: f32| (0.0..=1.0).contains(&value);
        const NOT_NEGATIVE: &str = "it must be finite and at least 0";
        let strength = match description.strength.clone() {
            Kernel::Surface { depth_tolerance, coverage_floor, closed } => {
                let areas = strengths(&mut self, &not_negative, NOT_NEGATIVE)?;
                let translucent = element.kind("opacity").is_some();
                let opacities = translucent.then(|| self.take("opacity", share, SHARE)).transpose()?;
                Strength::Surface(Surface { areas, opacities, depth_tolerance, coverage_floor, closed })
            }
            Kernel::Extinction => {
                Strength::Extinction { masses: strengths(&mut self, &not_negative, NOT_NEGATIVE)? }
            }
            Kernel::Opacity { filter, least } => {
                Strength::Opacity { peaks: strengths(&mut self, &share, SHARE)?, filter, least }
            }
        };
        let normals = description.normals.then(|| self.vectors(NORMAL)).transpose()?;
        let splats = Splats {
            centers,
            shapes,
            strength,
            colors: self.rows(COLOR)?,
            harmonics: self.harmonics(element)?,
            normals,
            material: description.material,
        };
        Ok(Content::Splats { splats, blend: description.blend, origin: description.origin }.into())
    }

    fn harmonics(&mut self, element: &Element) -> Result<Option<Harmonics>, ImportError> {
        let per_splat = (0..).take_while(|number| element.kind(&harmonic(*number)[0]).is_some()).count();
        let Some(degree) = [0, 3, 8, 15].iter().position(|count| *count == per_splat) else {
            let problem = format!("vertices have {per_splat} harmonics; they have none, 3, 8 or 15");
            return Err(self.file.malformed(Place::Whole, problem));
        };
        let mut coefficients = vec![[0.0; 3]; self.rows * per_splat];
        for number in 0..per_splat {
            let names = harmonic(number);
            let colors = self.rows(names.each_ref().map(String::as_str))?;
            for (row, color) in colors.into_iter().enumerate() {
                coefficients[row * per_splat + number] = color;
            }
        }
        Ok((degree > 0).then_some(Harmonics { degree: degree as u8, coefficients }))
    }
}
