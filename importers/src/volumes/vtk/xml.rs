//! VTI, VTR and VTS: VTK's ImageData, RectilinearGrid and StructuredGrid in XML.
//!
//! Source: *VTK File Formats* (docs.vtk.org), XML formats. Arrays ascii, inline base64 or appended (raw or base64),
//! uncompressed or by `vtkZLibDataCompressor`, in both byte orders; other compressors and several pieces are
//! refused. An image's `Origin` is where index (0, 0, 0) lies, whatever the extent begins with; `Direction` is
//! written row by row, its columns are the directions of the axes.

use super::array::{Appended, Encoding, Stream};
use super::grid::{Coordinates, Places, PointGrid, triples};
use crate::file::{File, quoted};
use crate::inflate;
use crate::scalar::Scalar;
use crate::volumes::voxels::{Layout, Samples};
use crate::volumes::xml;
use crate::{Endian, ImportError, OpenOptions, Opened, Place};
use glam::{DMat3, DVec3};
use roxmltree::Node;
use std::borrow::Cow;

/// What all arrays of a file share.
struct Arrays<'a> {
    file: &'a File,
    endian: Endian,
    appended: Option<Appended<'a>>,
    /// Bytes that compressed arrays may unpack to.
    limit: u64,
}

/// Datasets that are volumes.
const KINDS: [&str; 3] = ["ImageData", "RectilinearGrid", "StructuredGrid"];

/// Reads a volume.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let (header, appended) = split(file)?;
    let document = xml::document(&header, file.bytes.len())
        .map_err(|(line, problem)| file.malformed(Place::Line(line), problem))?;
    let root = document.root_element();
    let kind = root.attribute("type").unwrap_or("nothing");
    if !root.has_tag_name("VTKFile") || !KINDS.contains(&kind) {
        let feature = format!("a VTK file of {kind}; {} are supported", KINDS.join(", "));
        return Err(file.unsupported(place(root), feature));
    }
    let dataset = child(file, root, kind)?;
    let piece = child(file, dataset, "Piece")?;
    if elements(dataset, "Piece").count() > 1 {
        return Err(file.unsupported(place(dataset), "several pieces are not supported; write one"));
    }
    let extent = extent(file, dataset, "WholeExtent")?;
    if self::extent(file, piece, "Extent")? != extent {
        let problem = "the piece's Extent must equal the WholeExtent";
        return Err(file.malformed(place(piece), problem));
    }
    let arrays = Arrays { file, endian: endian(file, root)?, appended, limit: options.max_memory };
    let grid = match kind {
        "ImageData" => image(file, dataset, extent)?,
        "RectilinearGrid" => arrays.rectilinear(piece, extent)?,
        _ => arrays.structured(piece, extent)?,
    };
    let (array, on_cells) = scalars(file, piece)?;
    let dims = grid.dims(on_cells).map_err(|problem| file.malformed(place(dataset), problem))?;
    let layout = Layout { dims, scalar: scalar(file, array)?, endian: arrays.endian };
    let voxels = layout.voxels(file, &arrays.samples(array, &layout)?)?;
    grid.volume((file, options), (&layout, voxels), on_cells)
}

fn place(node: Node<'_, '_>) -> Place {
    Place::Line(node.document().text_pos_at(node.range().start).row as usize)
}

fn elements<'a, 'i>(node: Node<'a, 'i>, name: &str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |child| child.has_tag_name(name))
}

fn child<'a, 'i>(file: &File, node: Node<'a, 'i>, name: &str) -> Result<Node<'a, 'i>, ImportError> {
    let missing = || file.malformed(place(node), format!("{} has no {name}", node.tag_name().name()));
    elements(node, name).next().ok_or_else(missing)
}

/// The XML without appended data, which may be no XML, and these.
fn split(file: &File) -> Result<(Cow<'_, str>, Option<Appended<'_>>), ImportError> {
    const TAG: &[u8] = b"<AppendedData";
    let text = |bytes| match str::from_utf8(bytes) {
        Ok(text) => Ok(text),
        Err(error) => Err(file.malformed(Place::Byte(error.valid_up_to()), "XML must be UTF-8 text")),
    };
    let Some(at) = file.bytes.windows(TAG.len()).position(|window| window == TAG) else {
        return Ok((Cow::Borrowed(text(&file.bytes)?), None));
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
    let header = text(&file.bytes[..at])?.to_owned() + "</VTKFile>";
    Ok((Cow::Owned(header), Some(Appended { encoding, data: &data[..end] })))
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
    array.ok_or_else(|| file.malformed(place(node), format!("{name}: {} must be {N} numbers", quoted(text))))
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

/// Points along x, y, z; an extent is in order and its numbers are below 2^40.
fn points(extent: Extent) -> [usize; 3] {
    std::array::from_fn(|axis| (extent[2 * axis + 1] - extent[2 * axis] + 1) as usize)
}

fn image(file: &File, image: Node<'_, '_>, extent: Extent) -> Result<PointGrid, ImportError> {
    let spacing = DVec3::from_array(numbers(file, image, "Spacing", Some([1.0; 3]))?);
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    // Written row by row.
    let direction = DMat3::from_cols_array(&numbers(file, image, "Direction", Some(identity))?).transpose();
    let index_origin = DVec3::from_array(numbers(file, image, "Origin", Some([0.0; 3]))?);
    let edges = direction * DMat3::from_diagonal(spacing);
    let first = DVec3::new(extent[0] as f64, extent[2] as f64, extent[4] as f64);
    Ok(PointGrid {
        points: points(extent),
        places: Places::Even { origin: index_origin + edges * first, edges },
    })
}

/// What is written in an array itself; its keys (`InformationKey`) and comments are none of its numbers.
fn text<'a>(array: Node<'a, '_>) -> Cow<'a, [u8]> {
    let mut texts = array.children().filter(Node::is_text).filter_map(|node| node.text());
    let first = texts.next().unwrap_or_default();
    match texts.next() {
        None => Cow::Borrowed(first.as_bytes()),
        Some(second) => Cow::Owned([first, second].into_iter().chain(texts).collect::<String>().into_bytes()),
    }
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

impl Arrays<'_> {
    fn rectilinear(&self, piece: Node<'_, '_>, extent: Extent) -> Result<PointGrid, ImportError> {
        let node = child(self.file, piece, "Coordinates")?;
        let arrays: Vec<_> = elements(node, "DataArray").collect();
        let Ok(arrays) = <[Node<'_, '_>; 3]>::try_from(arrays) else {
            let problem = "Coordinates must be three arrays: along x, y and z";
            return Err(self.file.malformed(place(node), problem));
        };
        let points = points(extent);
        let [x, y, z] = std::array::from_fn(|axis| self.coordinates(arrays[axis], points[axis]));
        PointGrid::rectilinear([x?, y?, z?]).map_err(|problem| self.file.unsupported(place(node), problem))
    }

    fn structured(&self, piece: Node<'_, '_>, extent: Extent) -> Result<PointGrid, ImportError> {
        let array = child(self.file, child(self.file, piece, "Points")?, "DataArray")?;
        if components(array) != "3" {
            let problem = format!("points of {} components; three are right", components(array));
            return Err(self.file.malformed(place(array), problem));
        }
        let [x, y, z] = points(extent);
        // An extent's numbers leave room for three times as many.
        let layout = Layout { dims: [3 * x, y, z], scalar: scalar(self.file, array)?, endian: self.endian };
        let numbers = layout.numbers(self.file, &self.samples(array, &layout)?)?;
        Ok(PointGrid { points: [x, y, z], places: Places::Each(triples(&numbers)) })
    }

    fn coordinates(&self, array: Node<'_, '_>, points: usize) -> Result<Coordinates, ImportError> {
        if components(array) != "1" {
            let problem = format!("coordinates of {} components; one is right", components(array));
            return Err(self.file.malformed(place(array), problem));
        }
        let scalar = scalar(self.file, array)?;
        let layout = Layout { dims: [points, 1, 1], scalar, endian: self.endian };
        let values = layout.numbers(self.file, &self.samples(array, &layout)?)?;
        Ok(Coordinates { values, rounding: scalar.rounding() })
    }

    /// An array's numbers.
    fn samples<'s>(&'s self, array: Node<'s, '_>, layout: &Layout) -> Result<Samples<'s>, ImportError> {
        let file = self.file;
        let stream = match array.attribute("format") {
            Some("ascii") | None => return Ok(Samples::Text(text(array))),
            Some("binary") => Stream::from_base64(&text(array)),
            Some("appended") => {
                let [offset] = numbers(file, array, "offset", None)?;
                let missing =
                    || file.malformed(place(array), "format is appended, but there is no AppendedData");
                self.appended.as_ref().ok_or_else(missing)?.stream(offset)
            }
            Some(other) => {
                let feature = format!("format {other:?}; ascii, binary and appended are supported");
                return Err(file.unsupported(place(array), feature));
            }
        };
        let expected = layout.bytes(file)?;
        let stream = stream.map_err(|problem| file.malformed(place(array), problem))?;
        let root = array.document().root_element();
        let header_type = match root.attribute("header_type") {
            Some("UInt32") | None => Scalar::U32,
            Some("UInt64") => Scalar::U64,
            Some(other) => {
                let problem = format!("header_type {other:?} must be UInt32 or UInt64");
                return Err(file.malformed(place(root), problem));
            }
        };
        let stream = stream.with_header(header_type, layout.endian);
        let bytes = match root.attribute("compressor") {
            None | Some("") => stream.uncompressed(expected),
            Some("vtkZLibDataCompressor") => {
                let blocks =
                    inflate::within(expected, self.limit).and_then(|()| stream.zlib_blocks(expected));
                blocks.map(Cow::Owned)
            }
            Some(other) => {
                let feature = format!("compressor {other:?}; vtkZLibDataCompressor or none are supported");
                return Err(file.unsupported(place(root), feature));
            }
        };
        bytes.map(Samples::Binary).map_err(|problem| file.malformed(place(array), problem))
    }
}
