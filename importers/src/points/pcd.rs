//! PCD, the point clouds of the Point Cloud Library: ascii, binary and binary_compressed.
//!
//! Source: *The PCD (Point Cloud Data) file format*, documentation of the Point Cloud Library, version 0.7.
//!
//! Read are the fields `x y z`, `rgb` or `rgba` (packed 0xRRGGBB in 32 bits, whether the type is F or U; alpha is not read), `intensity`,
//! `normal_x normal_y normal_z`, `radius`, and the place (not the turn) of `VIEWPOINT`. Other fields are skipped, whatever their type. Points of
//! organised clouds that have no place (NaN) are left out.

use super::{Gather, Has, Point, lzf};
use crate::Endian;
use crate::file::{File, quoted};
use crate::scalar::Scalar;
use crate::{ImportError, OpenOptions, Opened, Place, inflate};
use glam::{DVec3, Vec3};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Ascii,
    Binary,
    Compressed,
}

/// Bytes of a header line, at most: its words take more memory than it has bytes.
const LINE: usize = 1 << 16;

/// Values of a point, at most, in text.
const MOST_VALUES: usize = 1 << 16;

/// Some values of each point.
struct Field {
    name: String,
    scalar: Scalar,
    count: usize,
    /// Bytes of the fields before, and their values.
    offset: usize,
    values_before: usize,
}

/// What the header says.
struct Header {
    fields: Vec<Field>,
    points: usize,
    viewpoint: Option<DVec3>,
    encoding: Encoding,
    /// The byte and the line after the header.
    body: (usize, usize),
}

/// The fields that are read, by their place in [`Header::fields`].
struct Wanted<'a> {
    position: [&'a Field; 3],
    color: Option<&'a Field>,
    intensity: Option<&'a Field>,
    normal: Option<[&'a Field; 3]>,
    radius: Option<&'a Field>,
}

impl Header {
    fn parse(file: &File) -> Result<Self, ImportError> {
        let mut lists: [Option<Vec<&str>>; 4] = Default::default();
        let [mut width, mut height, mut points] = [None; 3];
        let mut viewpoint = None;
        let mut at = 0;
        for (index, line) in file.bytes.split_inclusive(|&b| b == b'\n').enumerate() {
            at += line.len();
            let malformed = |problem: String| file.malformed(Place::Line(index + 1), problem);
            let Some(text) = std::str::from_utf8(line).ok().filter(|text| text.len() <= LINE) else {
                return Err(malformed(format!("a line of the header must be text of at most {LINE} bytes")));
            };
            let mut words = text.split_whitespace();
            let Some(key) = words.next().filter(|key| !key.starts_with('#')) else { continue };
            let rest: Vec<&str> = words.collect();
            let number = |rest: &[&str]| match rest {
                [word] => word
                    .parse::<usize>()
                    .map(Some)
                    .map_err(|_| malformed(format!("{} is no number", quoted(word)))),
                _ => Err(malformed(format!("{key} has one number"))),
            };
            match key {
                "VERSION" => {}
                "FIELDS" | "COLUMNS" => lists[0] = Some(rest),
                "SIZE" => lists[1] = Some(rest),
                "TYPE" => lists[2] = Some(rest),
                "COUNT" => lists[3] = Some(rest),
                "WIDTH" => width = number(&rest)?,
                "HEIGHT" => height = number(&rest)?,
                "POINTS" => points = number(&rest)?,
                "VIEWPOINT" => {
                    let numbers: Option<Vec<f64>> = rest.iter().map(|word| word.parse().ok()).collect();
                    match numbers.as_deref() {
                        Some(&[x, y, z, ..]) if rest.len() == 7 => viewpoint = Some(DVec3::new(x, y, z)),
                        _ => {
                            return Err(malformed(
                                "VIEWPOINT has seven numbers, tx ty tz qw qx qy qz".into(),
                            ));
                        }
                    }
                }
                "DATA" => {
                    let encoding = match rest[..] {
                        ["ascii"] => Encoding::Ascii,
                        ["binary"] => Encoding::Binary,
                        ["binary_compressed"] => Encoding::Compressed,
                        _ => {
                            let feature =
                                format!("data {rest:?}; ascii, binary and binary_compressed are supported");
                            return Err(file.unsupported(Place::Line(index + 1), feature));
                        }
                    };
                    let fields = fields(lists).map_err(malformed)?;
                    let grid = width.zip(height).and_then(|(w, h): (usize, usize)| w.checked_mul(h));
                    let points = match (points, grid) {
                        (Some(points), Some(grid)) if points != grid => {
                            return Err(malformed(format!(
                                "{points} points, but width times height is {grid}"
                            )));
                        }
                        (points, grid) => points
                            .or(grid)
                            .ok_or_else(|| malformed("nothing says how many points there are".into()))?,
                    };
                    let viewpoint = viewpoint.filter(|viewpoint| viewpoint.is_finite());
                    return Ok(Self { fields, points, viewpoint, encoding, body: (at, index + 2) });
                }
                _ => return Err(malformed(format!("{} is not a word of a PCD header", quoted(key)))),
            }
        }
        Err(file.malformed(Place::Whole, "the header has no DATA line"))
    }

    fn row_size(&self) -> usize {
        self.fields.last().map_or(0, |last| last.offset + last.scalar.size() * last.count)
    }

    fn wanted(&self) -> Result<Wanted<'_>, &'static str> {
        let find = |name: &str| self.fields.iter().find(|field| field.name == name && field.count == 1);
        let three = |names: [&str; 3]| match names.map(find) {
            [Some(x), Some(y), Some(z)] => Some([x, y, z]),
            _ => None,
        };
        let color = find("rgb").or(find("rgba"));
        if color.is_some_and(|color| color.scalar.size() != 4) {
            return Err("rgb and rgba have 4 bytes");
        }
        Ok(Wanted {
            position: three(["x", "y", "z"]).ok_or("points need the fields x, y and z")?,
            color,
            intensity: find("intensity"),
            normal: three(["normal_x", "normal_y", "normal_z"]),
            radius: find("radius"),
        })
    }
}

fn fields([names, sizes, types, counts]: [Option<Vec<&str>>; 4]) -> Result<Vec<Field>, String> {
    let missing = |what| format!("the header has no {what} before DATA");
    let names = names.ok_or_else(|| missing("FIELDS"))?;
    let (sizes, types) = (sizes.ok_or_else(|| missing("SIZE"))?, types.ok_or_else(|| missing("TYPE"))?);
    let counts = counts.unwrap_or_else(|| vec!["1"; names.len()]);
    if [sizes.len(), types.len(), counts.len()] != [names.len(); 3] {
        return Err(format!(
            "{} fields with {} sizes, {} types and {} counts",
            names.len(),
            sizes.len(),
            types.len(),
            counts.len()
        ));
    }
    let (mut fields, mut offset, mut values_before) = (Vec::new(), 0_usize, 0_usize);
    for (index, name) in names.into_iter().enumerate() {
        let scalar = match (types[index], sizes[index]) {
            ("I", "1") => Scalar::I8,
            ("I", "2") => Scalar::I16,
            ("I", "4") => Scalar::I32,
            ("I", "8") => Scalar::I64,
            ("U", "1") => Scalar::U8,
            ("U", "2") => Scalar::U16,
            ("U", "4") => Scalar::U32,
            ("U", "8") => Scalar::U64,
            ("F", "4") => Scalar::F32,
            ("F", "8") => Scalar::F64,
            (kind, size) => {
                return Err(format!("field {name}: type {kind} of {size} bytes is none of PCD's"));
            }
        };
        let count: u32 = counts[index]
            .parse()
            .map_err(|_| format!("field {name}: count {:?} is no number", counts[index]))?;
        fields.push(Field { name: name.to_owned(), scalar, count: count as usize, offset, values_before });
        let size = scalar.size() * count as usize;
        (offset, values_before) = (offset.saturating_add(size), values_before + count as usize);
    }
    Ok(fields)
}

/// Reads a PCD file.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let header = Header::parse(file)?;
    let wanted = header.wanted().map_err(|problem| file.malformed(Place::Whole, problem))?;
    let has = Has {
        colors: wanted.color.is_some(),
        intensities: wanted.intensity.is_some(),
        normals: wanted.normal.is_some(),
        radii: wanted.radius.is_some(),
    };
    let body = &file.bytes[header.body.0..];
    let unpacked;
    let (bytes, least) = match header.encoding {
        // A digit and what separates it.
        Encoding::Ascii => (body, 2 * header.fields.iter().map(|field| field.count).sum::<usize>()),
        Encoding::Binary => (body, header.row_size()),
        Encoding::Compressed => {
            unpacked = decompressed(&header, body, options)
                .map_err(|problem| file.malformed(Place::Byte(header.body.0), problem))?;
            (&unpacked[..], header.row_size())
        }
    };
    // The last separator may be missing.
    if header.points.checked_mul(least).is_none_or(|needed| needed > bytes.len() + 1) {
        let (points, left) = (header.points, bytes.len());
        let problem = format!("{points} points need at least {least} bytes each, but only {left} are left");
        return Err(file.malformed(Place::Byte(header.body.0), problem));
    }
    let mut gather = Gather::new(header.points, has);
    match header.encoding {
        Encoding::Ascii => header.text(file, &wanted, &mut gather)?,
        binary => header.binary(bytes, binary, &wanted, &mut gather).map_err(|row| {
            file.malformed(Place::Byte(header.body.0), format!("the file ends in the middle of point {row}"))
        })?,
    }
    if let Some(viewpoint) = header.viewpoint {
        gather.set_viewpoint(viewpoint);
    }
    gather.decode_colors(Some(255.0));
    gather.finish(file)
}

/// Two sizes, then all values of a field, those of the next, and so on.
fn decompressed(header: &Header, body: &[u8], options: &OpenOptions) -> Result<Vec<u8>, String> {
    let (sizes, packed) =
        body.split_at_checked(8).ok_or("the file ends before the sizes of the compressed data")?;
    let mut words = sizes.as_chunks::<4>().0.iter().map(|&word| u32::from_le_bytes(word) as usize);
    let [compressed, size] = [words.next().unwrap_or_default(), words.next().unwrap_or_default()];
    if header.points.checked_mul(header.row_size()) != Some(size) {
        let (points, row) = (header.points, header.row_size());
        return Err(format!("the data unpack to {size} bytes, but {points} points have {row} bytes each"));
    }
    if size as u64 > options.max_memory {
        return Err(inflate::over_limit(options.max_memory));
    }
    let left = packed.len();
    let packed = packed.get(..compressed);
    let packed = packed.ok_or_else(|| format!("{compressed} compressed bytes, but only {left} are left"))?;
    lzf::unpack(packed, size)
}

/// Where a point's numbers come from: a field to its value, and a field's 32 bits.
type Values<'a> = (&'a dyn Fn(&Field) -> Option<f64>, &'a dyn Fn(&Field) -> Option<u32>);

impl Wanted<'_> {
    fn point(&self, (value, bits): Values<'_>) -> Option<Point> {
        let three = |fields: [&Field; 3]| Some([value(fields[0])?, value(fields[1])?, value(fields[2])?]);
        let mut point = Point { position: three(self.position)?.into(), ..Point::default() };
        if let Some(field) = self.color {
            let [blue, green, red, _] = bits(field)?.to_le_bytes().map(f32::from);
            point.color = [red, green, blue];
        }
        if let Some(field) = self.intensity {
            point.intensity = value(field)? as f32;
        }
        if let Some(fields) = self.normal {
            point.normal = Vec3::from(three(fields)?.map(|c| c as f32));
        }
        if let Some(field) = self.radius {
            point.radius = value(field)? as f32;
        }
        Some(point)
    }
}

impl Header {
    /// Puts points of which `bytes` has the values; fails at the point that isn't whole.
    fn binary(
        &self,
        bytes: &[u8],
        encoding: Encoding,
        wanted: &Wanted<'_>,
        gather: &mut Gather,
    ) -> Result<(), usize> {
        let row_size = self.row_size();
        for row in 0..self.points {
            let at = |field: &Field| {
                let from = match encoding {
                    Encoding::Compressed => {
                        self.points * field.offset + row * field.scalar.size() * field.count
                    }
                    _ => row * row_size + field.offset,
                };
                bytes.get(from..)
            };
            let value = |field: &Field| field.scalar.first(at(field)?, Endian::Little);
            let bits = |field: &Field| Some(u32::from_le_bytes(*at(field)?.first_chunk()?));
            gather.put(&wanted.point((&value, &bits)).ok_or(row)?);
        }
        Ok(())
    }

    fn text(&self, file: &File, wanted: &Wanted<'_>, gather: &mut Gather) -> Result<(), ImportError> {
        let per_row = self.fields.iter().map(|field| field.count).sum::<usize>();
        if per_row > MOST_VALUES {
            let feature = format!("{per_row} values of each point; at most {MOST_VALUES} are read from text");
            return Err(file.unsupported(Place::Whole, feature));
        }
        let lines = file.bytes[self.body.0..].split(|&b| b == b'\n').map(<[u8]>::trim_ascii).enumerate();
        let mut rows = lines.filter(|(_, line)| !line.is_empty());
        for row in 0..self.points {
            let Some((index, line)) = rows.next() else {
                let problem = format!("the file ends before point {row} of {}", self.points);
                return Err(file.malformed(Place::Whole, problem));
            };
            let place = Place::Line(self.body.1 + index);
            let split = || line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
            let words: Vec<&[u8]> = split().take(per_row + 1).collect();
            if words.len() != per_row {
                let problem = format!("{} values; each point has {per_row}", split().count());
                return Err(file.malformed(place, problem));
            }
            let word = |field: &Field| std::str::from_utf8(words[field.values_before]).ok();
            let value = |field: &Field| word(field)?.parse::<f64>().ok();
            let bits = |field: &Field| match field.scalar {
                Scalar::F32 => Some(word(field)?.parse::<f32>().ok()?.to_bits()),
                _ => word(field)?.parse::<i64>().ok().map(|value| value as u32),
            };
            let point = wanted.point((&value, &bits));
            gather.put(&point.ok_or_else(|| file.malformed(place, "a value is no number"))?);
        }
        match rows.next() {
            None => Ok(()),
            Some((index, _)) => {
                let problem = format!("there are more lines than {} points", self.points);
                Err(file.malformed(Place::Line(self.body.1 + index), problem))
            }
        }
    }
}
