//! NRRD: "nearly raw raster data", attached (`.nrrd`) and detached (`.nhdr`).
//!
//! Source: Kindlmann, *Definition of NRRD File Format*, teem.sourceforge.net/nrrd/format.html (NRRD0005).
//! Encodings raw, gzip and ascii; three axes, or four of which one has a single sample. `space directions`
//! and `space origin` are taken as they stand, in the file's own space: a left-posterior-superior file
//! keeps its axes, and the frame its name. Without them `spacings` and `axis mins` count. An unknown spacing (NaN) is 1; a negative one turns
//! its axis.

use crate::Endian;
use crate::file::{File, quoted};
use crate::inflate;
use crate::scalar::Scalar;
use crate::volumes::frame;
use crate::volumes::voxels::{Layout, Samples};
use crate::{ImportError, OpenOptions, Place};
use glam::{DMat3, DVec3};
use oblate_volumes::{GridFrame, Space, Volume, Voxels};
use std::borrow::Cow;
use std::collections::HashMap;

/// Bytes of a header, at most: what is kept of it takes more memory than it has bytes.
const HEADER: usize = 1 << 20;

/// The fields of a header by name (without spaces, lower case), each with its line.
struct Header {
    fields: HashMap<String, (usize, String)>,
    /// Where attached data begin; `None` when no empty line ends the header.
    body: Option<usize>,
}

/// Reads a volume.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Volume, ImportError> {
    let header = Header::parse(file)?;
    let axes = spatial_axes(file, &header)?;
    let sizes: Vec<usize> = header.list(file, "sizes")?;
    let dims = axes.map(|axis| sizes[axis]);
    let layout = Layout { dims, scalar: scalar(file, &header)?, endian: endian(file, &header)? };
    let frame = GridFrame { space: space(&header), ..grid_frame(file, &header, axes, dims)? };
    let voxels = voxels(file, &header, &layout, options.max_memory)?;
    layout.placed(file, voxels, frame, options)
}

impl Header {
    fn parse(file: &File) -> Result<Self, ImportError> {
        if !file.bytes.starts_with(b"NRRD0") {
            return Err(file.malformed(Place::Line(1), "a NRRD begins with NRRD0001 to NRRD0005"));
        }
        let mut header = Self { fields: HashMap::new(), body: None };
        let mut at = 0;
        for (index, line) in file.bytes.split_inclusive(|&b| b == b'\n').enumerate() {
            at += line.len();
            if at > HEADER {
                let problem = format!("the header has more than {HEADER} bytes");
                return Err(file.malformed(Place::Line(index + 1), problem));
            }
            let line = line.trim_ascii_end();
            if line.is_empty() {
                header.body = Some(at);
                break;
            }
            let number = index + 1;
            let Ok(text) = str::from_utf8(line) else {
                if line.starts_with(b"#") {
                    continue;
                }
                return Err(file.malformed(Place::Line(number), "a header line must be text"));
            };
            let colon = text.find(": ").or_else(|| text.strip_suffix(':').map(str::len));
            match colon {
                _ if index == 0 || text.starts_with('#') => {}
                _ if text.find(":=").is_some_and(|key| colon.is_none_or(|colon| key < colon)) => {}
                Some(colon) => {
                    let name: String = text[..colon].split_whitespace().collect();
                    let value = text[colon + 1..].trim().to_owned();
                    let ends = name.eq_ignore_ascii_case("datafile") && is_list(&value);
                    header.fields.insert(name.to_ascii_lowercase(), (number, value));
                    // Names of files follow, and nothing else.
                    if ends {
                        break;
                    }
                }
                None => {
                    let problem = format!("{} is neither \"field: value\" nor \"key:=value\"", quoted(text));
                    return Err(file.malformed(Place::Line(number), problem));
                }
            }
        }
        Ok(header)
    }

    /// A field's line and value, by any of its names.
    fn get(&self, names: &[&str]) -> Option<(Place, &str)> {
        let (line, value) = names.iter().find_map(|name| self.fields.get(*name))?;
        Some((Place::Line(*line), value))
    }

    fn required(&self, file: &File, name: &str) -> Result<(Place, &str), ImportError> {
        self.get(&[name]).ok_or_else(|| file.malformed(Place::Whole, format!("the header lacks {name:?}")))
    }

    /// A required field's words as numbers.
    fn list<T: std::str::FromStr>(&self, file: &File, name: &str) -> Result<Vec<T>, ImportError> {
        let (place, value) = self.required(file, name)?;
        let numbers = value.split_whitespace().map(|word| word.parse().ok()).collect::<Option<_>>();
        numbers.ok_or_else(|| file.malformed(place, format!("{name}: {} must be numbers", quoted(value))))
    }

    /// One number for each of `count` axes, if the field is there.
    fn per_axis(&self, file: &File, name: &str, count: usize) -> Result<Option<Vec<f64>>, ImportError> {
        let Some((place, _)) = self.get(&[name]) else { return Ok(None) };
        let numbers = self.list(file, name)?;
        if numbers.len() != count {
            return Err(file.malformed(place, format!("{name} must have a number for each of {count} axes")));
        }
        Ok(Some(numbers))
    }
}

/// The three axes of the grid.
fn spatial_axes(file: &File, header: &Header) -> Result<[usize; 3], ImportError> {
    let (place, dimension) = header.required(file, "dimension")?;
    let sizes: Vec<usize> = header.list(file, "sizes")?;
    if dimension.parse() != Ok(sizes.len()) {
        let problem = format!("dimension is {dimension}, but sizes has {} numbers", sizes.len());
        return Err(file.malformed(place, problem));
    }
    let (kinds_place, kinds) = header.get(&["kinds"]).unwrap_or((Place::Whole, ""));
    let kinds: Vec<String> = kinds.split_whitespace().map(str::to_ascii_lowercase).collect();
    let is_spatial = |axis: usize| {
        kinds.get(axis).is_none_or(|kind| matches!(kind.as_str(), "domain" | "space" | "none" | "???"))
    };
    // A single sample along an axis that is no place at best, along any axis at worst, leaves a grid.
    let extra = if sizes.len() == 4 {
        let single = || (0..4).filter(|&axis| sizes[axis] == 1);
        single().find(|&axis| !is_spatial(axis)).or_else(|| single().next())
    } else {
        None
    };
    let axes: Vec<usize> = (0..sizes.len()).filter(|&axis| Some(axis) != extra).collect();
    let Ok(axes) = <[usize; 3]>::try_from(axes) else {
        let feature = format!("sizes {sizes:?}: three axes are supported, or four of which one has size 1");
        return Err(file.unsupported(place, feature));
    };
    match axes.iter().find(|&&axis| !is_spatial(axis)) {
        Some(&axis) => {
            let feature =
                format!("axis {axis} is of kind {:?}; three spatial axes are supported", kinds[axis]);
            Err(file.unsupported(kinds_place, feature))
        }
        None => Ok(axes),
    }
}

fn scalar(file: &File, header: &Header) -> Result<Scalar, ImportError> {
    let (place, name) = header.required(file, "type")?;
    Ok(match name.to_ascii_lowercase().as_str() {
        "signed char" | "int8" | "int8_t" => Scalar::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Scalar::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Scalar::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Scalar::U16,
        "int" | "signed int" | "int32" | "int32_t" => Scalar::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Scalar::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Scalar::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Scalar::U64,
        "float" => Scalar::F32,
        "double" => Scalar::F64,
        _ => {
            return Err(file.unsupported(
                place,
                format!("type {} is no number type of NRRD that is read", quoted(name)),
            ));
        }
    })
}

/// The byte order, which multi-byte samples must state unless they are text.
fn endian(file: &File, header: &Header) -> Result<Endian, ImportError> {
    match header.get(&["endian"]) {
        Some((place, value)) => {
            value.parse().map_err(|error| file.malformed(place, format!("endian: {error}")))
        }
        None if scalar(file, header)?.size() == 1 || is_text(header) => Ok(Endian::Little),
        None => Err(file.malformed(Place::Whole, "the header lacks \"endian\" (little or big)")),
    }
}

fn is_text(header: &Header) -> bool {
    matches!(header.get(&["encoding"]), Some((_, "ascii" | "text" | "txt")))
}

/// Vectors such as `(1,0,0) none (0,0.5,0)`.
fn vectors(file: &File, place: Place, text: &str) -> Result<Vec<Option<DVec3>>, ImportError> {
    let mut found = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        let parsed = if let Some(after) = rest.strip_prefix("none") {
            Some((None, after))
        } else {
            rest.strip_prefix('(').and_then(|inside| inside.split_once(')')).and_then(|(inside, after)| {
                let numbers: Option<Vec<f64>> = inside.split(',').map(|n| n.trim().parse().ok()).collect();
                Some((Some(DVec3::from_array(numbers?.try_into().ok()?)), after))
            })
        };
        let Some((vector, after)) = parsed else {
            let problem =
                format!("{} must be vectors of three numbers such as (1,0,0), or none", quoted(text));
            return Err(file.malformed(place, problem));
        };
        found.push(vector);
        rest = after.trim_start();
    }
    Ok(found)
}

/// The space that the file names; what is no name of one says nothing.
fn space(header: &Header) -> Option<Space> {
    let (_, name) = header.get(&["space"])?;
    match name.to_ascii_uppercase().as_str() {
        "RAS" => Some(Space::Ras),
        "LAS" => Some(Space::Las),
        "LPS" => Some(Space::Lps),
        "3DR" => Some(Space::RightHanded),
        "3DL" => Some(Space::LeftHanded),
        _ => Space::ALL.into_iter().find(|space| space.name().eq_ignore_ascii_case(name)),
    }
}

fn grid_frame(
    file: &File,
    header: &Header,
    axes: [usize; 3],
    dims: [usize; 3],
) -> Result<GridFrame, ImportError> {
    let (_, dimension) = header.required(file, "dimension")?;
    let count = if dimension == "4" { 4 } else { 3 };
    let mut origin = DVec3::ZERO;
    if let Some((place, text)) = header.get(&["spaceorigin"]) {
        match vectors(file, place.clone(), text)?.as_slice() {
            [Some(given)] => origin = *given,
            _ => return Err(file.malformed(place, "space origin must be one vector such as (0,0,0)")),
        }
    }
    if let Some((place, text)) = header.get(&["spacedirections"]) {
        let vectors = vectors(file, place.clone(), text)?;
        let Some([x, y, z]) = pick(&vectors, axes, count) else {
            let problem = "space directions must give a vector of three numbers for each spatial axis";
            return Err(file.malformed(place, problem));
        };
        return Ok(frame::of_edges(origin, DMat3::from_cols(x, y, z)));
    }
    let cell_centred = matches!(header.get(&["centers", "centerings"]), Some((_, c)) if c.contains("cell"));
    let mins = header.per_axis(file, "axismins", count)?;
    let maxs = header.per_axis(file, "axismaxs", count)?;
    let spacings = header.per_axis(file, "spacings", count)?;
    let mut spacing = DVec3::ONE;
    for (i, &axis) in axes.iter().enumerate() {
        let min = mins.as_ref().map(|m| m[axis]).filter(|m| !m.is_nan());
        let max = maxs.as_ref().map(|m| m[axis]).filter(|m| !m.is_nan());
        let intervals = if cell_centred { dims[i] } else { dims[i].saturating_sub(1) };
        let from_range =
            min.zip(max).filter(|_| intervals > 0).map(|(min, max)| (max - min) / intervals as f64);
        let given = spacings.as_ref().map(|s| s[axis]).filter(|s| !s.is_nan());
        spacing[i] = given.or(from_range).unwrap_or(1.0);
        if let Some(min) = min {
            // A cell's range begins half a sample before its centre.
            origin[i] = min + if cell_centred { 0.5 * spacing[i] } else { 0.0 };
        }
    }
    Ok(frame::of_edges(origin, DMat3::from_diagonal(spacing)))
}

/// The vectors of three axes out of those of all.
fn pick(vectors: &[Option<DVec3>], axes: [usize; 3], count: usize) -> Option<[DVec3; 3]> {
    let [x, y, z] = axes.map(|axis| vectors.get(axis).copied().flatten());
    if vectors.len() == count { Some([x?, y?, z?]) } else { None }
}

/// Whether files are listed below in place of a name.
fn is_list(name: &str) -> bool {
    name.split_whitespace().next() == Some("LIST")
}

/// The samples, from this file or the one that it names.
fn voxels(file: &File, header: &Header, layout: &Layout, limit: u64) -> Result<Voxels, ImportError> {
    let expected = layout.bytes(file)?;
    let detached = match header.get(&["datafile"]) {
        Some((place, name)) if is_list(name) || name.contains('%') => {
            let feature = "samples in several files are not supported; join them into one";
            return Err(file.unsupported(place, feature));
        }
        Some((place, name)) => Some(file.read_named(place, name)?),
        None => None,
    };
    let source = detached.as_ref().unwrap_or(file);
    let body = match (&detached, header.body) {
        (Some(data), _) => &data.bytes[..],
        (None, Some(at)) => &file.bytes[at..],
        (None, None) => return Err(file.malformed(Place::Whole, "no empty line ends the header")),
    };
    let (place, encoding) = header.required(file, "encoding")?;
    let body = skip_lines(file, header, body)?;
    let samples = match encoding.to_ascii_lowercase().as_str() {
        "raw" => {
            let body = skip_bytes(file, header, Cow::Borrowed(body), expected)?;
            if body.len() != expected {
                let problem = format!("{} bytes of samples; sizes and type need {expected}", body.len());
                return Err(source.malformed(Place::Whole, problem));
            }
            Samples::Binary(body)
        }
        "gzip" | "gz" => {
            // Bytes are skipped after decompression.
            let skipped = skipped_bytes(file, header)?.filter(|&skip| skip > 0).unwrap_or(0) as usize;
            let total = expected.saturating_add(skipped);
            let bytes = inflate::within(total, limit).and_then(|()| inflate::gunzip(body, total));
            let bytes = bytes.map_err(|problem| source.malformed(Place::Whole, problem))?;
            Samples::Binary(skip_bytes(file, header, Cow::Owned(bytes), expected)?)
        }
        "ascii" | "text" | "txt" => Samples::Text(skip_bytes(file, header, Cow::Borrowed(body), expected)?),
        _ => {
            let feature = format!("encoding {}; raw, gzip and ascii are supported", quoted(encoding));
            return Err(file.unsupported(place, feature));
        }
    };
    layout.voxels(source, &samples)
}

fn skip_lines<'a>(file: &File, header: &Header, mut body: &'a [u8]) -> Result<&'a [u8], ImportError> {
    let Some((place, text)) = header.get(&["lineskip"]) else { return Ok(body) };
    let Ok(count) = text.parse::<usize>() else {
        return Err(file.malformed(place, "line skip must be a number of lines"));
    };
    for _ in 0..count {
        let Some(end) = body.iter().position(|&b| b == b'\n') else {
            return Err(file.malformed(place, format!("there are no {count} lines to skip")));
        };
        body = &body[end + 1..];
    }
    Ok(body)
}

fn skipped_bytes(file: &File, header: &Header) -> Result<Option<i64>, ImportError> {
    let Some((place, text)) = header.get(&["byteskip"]) else { return Ok(None) };
    match text.parse::<i64>() {
        Ok(count) if count >= -1 => Ok(Some(count)),
        _ => Err(file.malformed(place, "byte skip must be a number of bytes, or -1 for the last ones")),
    }
}

fn skip_bytes<'a>(
    file: &File,
    header: &Header,
    body: Cow<'a, [u8]>,
    expected: usize,
) -> Result<Cow<'a, [u8]>, ImportError> {
    let skip = match skipped_bytes(file, header)? {
        None => return Ok(body),
        Some(-1) => body.len().checked_sub(expected),
        Some(count) => usize::try_from(count).ok().filter(|&count| count <= body.len()),
    };
    match (skip, body) {
        (None, _) => Err(file.malformed(Place::Whole, "byte skip leaves too few bytes of samples")),
        (Some(skip), Cow::Borrowed(bytes)) => Ok(Cow::Borrowed(&bytes[skip..])),
        (Some(skip), Cow::Owned(mut bytes)) => Ok(Cow::Owned(bytes.split_off(skip))),
    }
}
