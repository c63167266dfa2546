//! VTI: VTK's ImageData in XML.
//!
//! Source: *VTK File Formats* (docs.vtk.org), XML formats. Samples ascii, inline base64 or appended (raw or
//! base64), uncompressed or by `vtkZLibDataCompressor`, in both byte orders. One piece. Of the point data
//! the active scalars are taken, else the first array of one component; without point data the cell data,
//! whose samples lie half a spacing further in. `Origin` is where index (0, 0, 0) lies, whatever the
//! extent begins with.

use crate::Endian;
use crate::file::File;
use crate::scalar::Scalar;
use crate::volumes::voxels::Layout;
use crate::volumes::vti_array::{Appended, Encoding, Stream};
use crate::{ImportError, OpenOptions, Place};
use glam::{DMat3, DVec3};
use oblate_volumes::{GridFrame, Volume};
use roxmltree::{Document, Node};

/// Reads a volume.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Volume, ImportError> {
    let (header, appended) = split(file)?;
    let document = Document::parse(&header).map_err(|error| {
        let line = error.pos().row as usize;
        file.malformed(Place::Line(line), format!("XML: {error}"))
    })?;
    let root = document.root_element();
    let kind = root.attribute("type").unwrap_or("nothing");
    if !root.has_tag_name("VTKFile") || kind != "ImageData" {
        let feature = format!("a VTK file of {kind}; ImageData is supported");
        return Err(file.unsupported(place(root), feature));
    }
    let image = child(file, root, "ImageData")?;
    let piece = child(file, image, "Piece")?;
    if elements(image, "Piece").count() > 1 {
        return Err(file.unsupported(place(image), "several pieces are not supported; write one"));
    }
    let extent = extent(file, image, "WholeExtent")?;
    if self::extent(file, piece, "Extent")? != extent {
        let problem = "the piece's Extent must equal the image's WholeExtent";
        return Err(file.malformed(place(piece), problem));
    }
    let (array, on_cells) = scalars(file, piece)?;
    let layout = Layout {
        dims: dims(file, image, extent, on_cells)?,
        scalar: scalar(file, array)?,
        endian: endian(file, root)?,
    };
    let frame = frame(file, image, extent, on_cells)?;
    let bytes = samples(file, array, &layout, appended.as_ref())?;
    layout.volume(file, &bytes, frame, options)
}

fn place(node: Node<'_, '_>) -> Place {
    Place::Line(node.document().text_pos_at(node.range().start).row as usize)
}

fn elements<'a, 'i>(node: Node<'a, 'i>, name: &'static str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |child| child.has_tag_name(name))
}

fn child<'a, 'i>(file: &File, node: Node<'a, 'i>, name: &'static str) -> Result<Node<'a, 'i>, ImportError> {
    let missing = || file.malformed(place(node), format!("{} has no {name}", node.tag_name().name()));
    elements(node, name).next().ok_or_else(missing)
}

/// The XML without appended data, which may be no XML, and these.
fn split(file: &File) -> Result<(String, Option<Appended<'_>>), ImportError> {
    const TAG: &[u8] = b"<AppendedData";
    let text = |bytes: &[u8]| match str::from_utf8(bytes) {
        Ok(text) => Ok(text.to_owned()),
        Err(error) => Err(file.malformed(Place::Byte(error.valid_up_to()), "XML must be UTF-8 text")),
    };
    let Some(at) = file.bytes.windows(TAG.len()).position(|window| window == TAG) else {
        return Ok((text(&file.bytes)?, None));
    };
    let malformed = |problem: &str| file.malformed(Place::Byte(at), problem.to_owned());
    let rest = &file.bytes[at..];
    let tag_end = rest.iter().position(|&b| b == b'>').ok_or_else(|| malformed("AppendedData has no end"))?;
    let start = rest[tag_end + 1..].iter().position(|&b| b == b'_').map(|i| tag_end + 2 + i);
    let start = start.ok_or_else(|| malformed("AppendedData must begin with an underscore"))?;
    let tag = text(&rest[TAG.len()..tag_end])?;
    let words: String = tag.chars().filter(|c| !c.is_whitespace()).collect::<String>().replace('\'', "\"");
    let encoding = match words.trim_end_matches('/') {
        "encoding=\"raw\"" => Encoding::Raw,
        "encoding=\"base64\"" => Encoding::Base64,
        _ => return Err(malformed("AppendedData must have the encoding raw or base64")),
    };
    let data = &rest[start..];
    // Base64 ends with the element; raw data may hold anything and are bounded by their own headers.
    let end = match encoding {
        Encoding::Base64 => data.iter().position(|&b| b == b'<').unwrap_or(data.len()),
        Encoding::Raw => data.len(),
    };
    Ok((text(&file.bytes[..at])? + "</VTKFile>", Some(Appended { encoding, data: &data[..end] })))
}

/// An attribute of `N` numbers, or `default` where it is not given.
fn numbers<const N: usize, T: std::str::FromStr + Copy>(
    file: &File,
    node: Node<'_, '_>,
    name: &str,
    default: Option<[T; N]>,
) -> Result<[T; N], ImportError> {
    let Some(text) = node.attribute(name) else {
        let missing = || file.malformed(place(node), format!("{name} is missing"));
        return default.ok_or_else(missing);
    };
    let parsed: Option<Vec<T>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    let array = parsed.and_then(|numbers| numbers.try_into().ok());
    array.ok_or_else(|| file.malformed(place(node), format!("{name}: {text:?} must be {N} numbers")))
}

/// First and last index of points along each axis.
type Extent = [i64; 6];

fn extent(file: &File, node: Node<'_, '_>, name: &str) -> Result<Extent, ImportError> {
    let extent: Extent = numbers(file, node, name, None)?;
    let in_order = |pair: &[i64; 2]| pair[0] <= pair[1] && pair[0].abs() < 1 << 40 && pair[1] < 1 << 40;
    if extent.as_chunks::<2>().0.iter().all(in_order) {
        Ok(extent)
    } else {
        let problem = format!("{name} must be the first and last index along each axis");
        Err(file.malformed(place(node), problem))
    }
}

fn dims(file: &File, node: Node<'_, '_>, extent: Extent, on_cells: bool) -> Result<[usize; 3], ImportError> {
    let mut dims = [0; 3];
    for (dim, [first, last]) in dims.iter_mut().zip(extent.as_chunks::<2>().0) {
        *dim = usize::try_from(last - first + i64::from(!on_cells)).unwrap_or(0);
    }
    if dims.contains(&0) {
        return Err(file.malformed(place(node), "an image with cell data must have cells along each axis"));
    }
    Ok(dims)
}

fn frame(file: &File, image: Node<'_, '_>, extent: Extent, on_cells: bool) -> Result<GridFrame, ImportError> {
    let spacing = DVec3::from_array(numbers(file, image, "Spacing", Some([1.0; 3]))?);
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    // Written row by row.
    let direction = DMat3::from_cols_array(&numbers(file, image, "Direction", Some(identity))?).transpose();
    let index_origin = DVec3::from_array(numbers(file, image, "Origin", Some([0.0; 3]))?);
    let first = DVec3::new(extent[0] as f64, extent[2] as f64, extent[4] as f64);
    let first = first + if on_cells { 0.5 } else { 0.0 };
    Ok(GridFrame { spacing, origin: index_origin + direction * (spacing * first), direction })
}

fn components<'a>(array: Node<'a, '_>) -> &'a str {
    array.attribute("NumberOfComponents").unwrap_or("1").trim()
}

/// The array to take, and whether its values belong to cells.
fn scalars<'a, 'i>(file: &File, piece: Node<'a, 'i>) -> Result<(Node<'a, 'i>, bool), ImportError> {
    let mut seen = Vec::new();
    for (section, on_cells) in [("PointData", false), ("CellData", true)] {
        for data in elements(piece, section) {
            let active = data.attribute("Scalars");
            let singles = || elements(data, "DataArray").filter(|array| components(*array) == "1");
            let named = singles().find(|array| active.is_some() && array.attribute("Name") == active);
            if let Some(array) = named.or_else(|| singles().next()) {
                return Ok((array, on_cells));
            }
            seen.extend(elements(data, "DataArray").map(|array| {
                format!("{:?} of {} components", array.attribute("Name").unwrap_or(""), components(array))
            }));
        }
    }
    let found = if seen.is_empty() { "no arrays".into() } else { seen.join(", ") };
    Err(file.malformed(place(piece), format!("no array of one component; there are {found}")))
}

fn scalar(file: &File, array: Node<'_, '_>) -> Result<Scalar, ImportError> {
    let name = array.attribute("type").unwrap_or("none");
    Ok(match name {
        "Int8" => Scalar::I8,
        "UInt8" => Scalar::U8,
        "Int16" => Scalar::I16,
        "UInt16" => Scalar::U16,
        "Int32" => Scalar::I32,
        "UInt32" => Scalar::U32,
        "Int64" => Scalar::I64,
        "UInt64" => Scalar::U64,
        "Float32" => Scalar::F32,
        "Float64" => Scalar::F64,
        _ => {
            return Err(
                file.unsupported(place(array), format!("type {name:?} is no number type that is read"))
            );
        }
    })
}

fn endian(file: &File, root: Node<'_, '_>) -> Result<Endian, ImportError> {
    match root.attribute("byte_order") {
        Some("LittleEndian") | None => Ok(Endian::Little),
        Some("BigEndian") => Ok(Endian::Big),
        Some(other) => {
            let problem = format!("byte_order {other:?} must be LittleEndian or BigEndian");
            Err(file.malformed(place(root), problem))
        }
    }
}

/// The array's bytes in the file's byte order.
fn samples(
    file: &File,
    array: Node<'_, '_>,
    layout: &Layout,
    appended: Option<&Appended<'_>>,
) -> Result<Vec<u8>, ImportError> {
    let text = || array.children().filter_map(|node| node.text()).collect::<String>();
    let stream = match array.attribute("format") {
        Some("ascii") | None => {
            let mut bytes = layout.bytes_from_text(file, text().as_bytes())?;
            if layout.endian == Endian::Big {
                bytes.chunks_mut(layout.scalar.size()).for_each(<[u8]>::reverse);
            }
            return Ok(bytes);
        }
        Some("binary") => Stream::from_base64(text().as_bytes()),
        Some("appended") => {
            let [offset] = numbers(file, array, "offset", None)?;
            let missing = || file.malformed(place(array), "format is appended, but there is no AppendedData");
            appended.ok_or_else(missing)?.stream(offset)
        }
        Some(other) => {
            let feature = format!("format {other:?}; ascii, binary and appended are supported");
            return Err(file.unsupported(place(array), feature));
        }
    };
    let root = array.document().root_element();
    let header_type = match root.attribute("header_type") {
        Some("UInt32") | None => Scalar::U32,
        Some("UInt64") => Scalar::U64,
        Some(other) => {
            let problem = format!("header_type {other:?} must be UInt32 or UInt64");
            return Err(file.malformed(place(root), problem));
        }
    };
    let expected = layout.bytes(file)?;
    let bytes = stream.and_then(|stream| {
        let mut stream = stream.with_header(header_type, layout.endian);
        match root.attribute("compressor") {
            None | Some("") => stream.uncompressed(expected),
            Some("vtkZLibDataCompressor") => stream.zlib_blocks(expected),
            Some(other) => Err(format!("compressor {other:?}; vtkZLibDataCompressor or none are supported")),
        }
    });
    bytes.map_err(|problem| file.malformed(place(array), problem))
}
