//! Primitives of points with KHR_gaussian_splatting.

use super::accessor::{Accessors, Column, Integers};
use super::from_json;
use crate::file::File;
use crate::scalar::Scalar;
use crate::splats::{ROWS, Sink, Trained, Training, Turn, color, gather, half_axes, log_scale, of_half_axes};
use crate::{ImportError, Note, Opened, Place};
use ::gltf::json::mesh::{Mode, Primitive};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index, Mesh, Value};
use glam::{DAffine3, DMat3, DQuat, DVec3, DVec4};
use oblate_engine::color::linear_to_srgb;
use oblate_engine::{Blend, OpacityFilter};
use serde::Deserialize;
use std::collections::BTreeMap;

const NAME: &str = "KHR_gaussian_splatting";

/// What rounding can leave of a half-axis of length 0, in shares of the largest entry of a node's map times the longest σ.
///
/// The product of map, rotation and σ is off by at most 7u in the Frobenius norm, u being half of an epsilon, in shares of the map's norm
/// times the longest σ. Each of up to 18 turns of half-axes into each other rounds by at most 2√2 u of the factor's norm, which is up
/// to √3 of the same: together 95u. The map's norm is at most three times its largest entry: 143 epsilons. The rest is for maps that are
/// products of several nodes' maps.
const RESIDUE: f64 = 256.0 * f64::EPSILON;

/// A file's meshes with the names that its attributes have: the crate knows only those without extensions.
#[derive(Deserialize)]
struct Named {
    meshes: Vec<NamedMesh>,
}

#[derive(Deserialize)]
struct NamedMesh {
    primitives: Vec<NamedPrimitive>,
}

#[derive(Deserialize)]
struct NamedPrimitive {
    attributes: BTreeMap<String, Index<Accessor>>,
}

/// A primitive as a node uses it.
struct Part<'a> {
    first_row: usize,
    center: Column<'a>,
    rotation: Column<'a>,
    scale: Column<'a>,
    opacity: Column<'a>,
    color: Color<'a>,
    harmonics: Vec<Column<'a>>,
    blend: Blend,
    placement: Option<Placement>,
}

/// Where the colour without harmonics is from.
enum Color<'a> {
    Harmonic(Column<'a>),
    /// Linear, for programs that draw points.
    Fallback(Column<'a>),
}

/// A node's transform, where it is not the identity.
struct Placement {
    to_world: DAffine3,
    turn: Turn,
    /// How long a half-axis may be that is none, in shares of the longest σ.
    residue: f64,
}

/// The splats of the scene, if there are any.
pub(super) fn read(
    accessors: &Accessors<'_>,
    json: &[u8],
    placed: &[(Index<Mesh>, DAffine3)],
) -> Result<Option<Opened>, ImportError> {
    let (file, root) = (accessors.file, accessors.root);
    let primitives_of = |mesh: Index<Mesh>| root.get(mesh).map_or(&[][..], |mesh| &mesh.primitives);
    let has_splats = |mesh: &Mesh| mesh.primitives.iter().any(|primitive| extension(primitive).is_some());
    let have_splats: Vec<bool> = root.meshes.iter().map(has_splats).collect();
    if !placed.iter().any(|(mesh, _)| have_splats.get(mesh.value()) == Some(&true)) {
        return Ok(None);
    }
    let named: Named = from_json(file, json)?;
    let mut names = root.extensions_used.iter().chain(&root.extensions_required);
    let quantized = names.any(|name| name == "KHR_mesh_quantization");
    let mut reader = Reader { accessors, quantized, notes: Vec::new() };
    let (mut parts, mut count, mut others) = (Vec::new(), 0, 0);
    for (mesh, to_world) in placed {
        for (number, primitive) in primitives_of(*mesh).iter().enumerate() {
            let name = format!("mesh {}, primitive {number}", mesh.value());
            let place = || Place::Part(name.clone());
            let take = |bytes| accessors.buffers.budget().take(file, place, bytes);
            // Meshes that many nodes use may have many small parts.
            take((1, size_of::<Part<'_>>() + 15 * size_of::<Column<'_>>()))?;
            let Some(extension) = extension(primitive) else {
                others += 1;
                continue;
            };
            let attributes = named.meshes.get(mesh.value()).and_then(|mesh| mesh.primitives.get(number));
            let Some(NamedPrimitive { attributes }) = attributes else { continue };
            let source = Source { name: &name, primitive, extension, attributes };
            let part = reader.part(&source, count, to_world)?;
            count += part.center.count;
            // What is gathered of them, and that in another order.
            take((part.center.count, 128 + 24 * part.harmonics.len()))?;
            parts.push(part);
        }
    }
    if others > 0 {
        let what = format!("{others} primitives that are no splats: a file of splats is read as these alone");
        reader.notes.push(Note::LeftOut(what));
    }
    let blend = parts[0].blend;
    if parts.iter().any(|part| part.blend != blend) {
        let feature = "has splats of both colour spaces; those of one file must have the same";
        return Err(file.unsupported(Place::Whole, feature));
    }
    let harmonics = parts.iter().map(|part| part.harmonics.len()).max().unwrap_or(0);
    // 0, 3, 8 or 15.
    let degree = (harmonics + 1).isqrt() as u8 - 1;
    let training = Training { degree, filter: OpacityFilter::Classic, blend };
    let mut opened = gather(file, (count, ROWS), training, |range, sink| {
        let mut number = parts.partition_point(|part| part.first_row <= range.start) - 1;
        for row in range {
            while row - parts[number].first_row >= parts[number].center.count {
                number += 1;
            }
            parts[number].put(row - parts[number].first_row, sink);
        }
        Ok(())
    })?;
    opened.notes.extend(reader.notes);
    Ok(Some(opened))
}

fn extension(primitive: &Primitive) -> Option<&Value> {
    primitive.extensions.as_ref()?.others.get(NAME)
}

/// A primitive as the file has it.
struct Source<'s> {
    name: &'s str,
    primitive: &'s Primitive,
    extension: &'s Value,
    attributes: &'s BTreeMap<String, Index<Accessor>>,
}

struct Reader<'r, 'a> {
    accessors: &'r Accessors<'a>,
    /// Whether the file has KHR_mesh_quantization.
    quantized: bool,
    notes: Vec<Note>,
}

impl<'a> Reader<'_, 'a> {
    fn file(&self) -> &'a File {
        self.accessors.file
    }

    /// What is wrong with a primitive.
    fn malformed(&self, source: &Source<'_>, problem: impl Into<String>) -> ImportError {
        self.file().malformed(Place::Part(source.name.into()), problem)
    }

    /// What is said once, whichever primitive it is of.
    fn note(&mut self, note: Note) {
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    fn part(
        &mut self,
        source: &Source<'_>,
        first_row: usize,
        to_world: &DAffine3,
    ) -> Result<Part<'a>, ImportError> {
        if source.primitive.mode != Checked::Valid(Mode::Points) {
            return Err(self.malformed(source, "mode must be 0 (points) for splats"));
        }
        let blend = self.blend(source)?;
        self.note_other_words(source);
        let center = self.required(source, "POSITION", &[3], None)?;
        let count = Some(center.count);
        let rotation = self.required(source, "ROTATION", &[4], count)?;
        let scale = self.required(source, "SCALE", &[3], count)?;
        let opacity = self.required(source, "OPACITY", &[1], count)?;
        let color = self.color(source, count)?;
        let harmonics = self.harmonics(source, count)?;
        if blend == Blend::Linear && !harmonics.is_empty() {
            let feature = "has harmonics of degree 1 or more for linear colours (lin_rec709_display), which are not \
                           supported; save it with srgb_rec709_display, or without SH_DEGREE_1 and beyond";
            return Err(self.file().unsupported(Place::Part(source.name.into()), feature));
        }
        let placement = (*to_world != DAffine3::IDENTITY).then(|| Placement::new(to_world));
        Ok(Part { first_row, center, rotation, scale, opacity, color, harmonics, blend, placement })
    }

    fn blend(&self, source: &Source<'_>) -> Result<Blend, ImportError> {
        match source.extension.get("colorSpace").and_then(Value::as_str) {
            Some("srgb_rec709_display") => Ok(Blend::Display),
            Some("lin_rec709_display") => Ok(Blend::Linear),
            Some(other) => {
                let feature = format!(
                    "colorSpace {other:?} is not supported; srgb_rec709_display and lin_rec709_display are"
                );
                Err(self.file().unsupported(Place::Part(source.name.into()), feature))
            }
            None => {
                let problem = format!("{NAME} needs a colorSpace: srgb_rec709_display or lin_rec709_display");
                Err(self.malformed(source, problem))
            }
        }
    }

    /// Notes what is asked for and drawn otherwise.
    fn note_other_words(&mut self, source: &Source<'_>) {
        for (key, drawn) in
            [("kernel", "ellipse"), ("projection", "perspective"), ("sortingMethod", "cameraDistance")]
        {
            // All but the kernel may be left out, and mean this then.
            let said = source.extension.get(key).and_then(Value::as_str);
            if said.is_some_and(|said| said != drawn) || (said.is_none() && key == "kernel") {
                let said = said.map_or("none".to_owned(), |said| format!("{said:?}"));
                self.note(Note::Assumed(format!("{key} {drawn:?}, where the file says {said}")));
            }
        }
    }

    /// An attribute by its name in the extension, or glTF's own.
    fn find(
        &self,
        source: &Source<'_>,
        name: &str,
        widths: &[usize],
        count: Option<usize>,
    ) -> Result<Option<Column<'a>>, ImportError> {
        let own = source.attributes.get(&format!("{NAME}:{name}"));
        let Some(index) = own.or_else(|| source.attributes.get(name)) else { return Ok(None) };
        let integers = match name {
            "COLOR_0" => Integers::Normalized,
            _ => Integers::AsMarked,
        };
        let column = self.accessors.column(*index, widths, integers)?;
        let problem = match count.filter(|count| *count != column.count) {
            Some(count) => {
                Some(format!("{name} has {} elements, but there are {count} positions", column.count))
            }
            None => misfit(name, &column, self.quantized),
        };
        match problem {
            Some(problem) => {
                Err(self.file().malformed(Place::Part(format!("accessor {}", index.value())), problem))
            }
            None => Ok(Some(column)),
        }
    }

    fn required(
        &self,
        source: &Source<'_>,
        name: &str,
        widths: &[usize],
        count: Option<usize>,
    ) -> Result<Column<'a>, ImportError> {
        self.find(source, name, widths, count)?.ok_or_else(|| self.missing(source, name))
    }

    /// What is said of a primitive without an attribute.
    fn missing(&self, source: &Source<'_>, name: &str) -> ImportError {
        let inner = source.extension.get("extensions").and_then(Value::as_object);
        match inner.and_then(|extensions| extensions.keys().next()) {
            Some(packed) => {
                let feature =
                    format!("has its splats only as {packed}, which is not supported; save it without");
                self.file().unsupported(Place::Part(source.name.into()), feature)
            }
            None => self.malformed(source, format!("has no {name}, which {NAME} needs")),
        }
    }

    fn color(&mut self, source: &Source<'_>, count: Option<usize>) -> Result<Color<'a>, ImportError> {
        let name = "SH_DEGREE_0_COEF_0";
        if let Some(column) = self.find(source, name, &[3], count)? {
            return Ok(Color::Harmonic(column));
        }
        let fallback = self.find(source, "COLOR_0", &[3, 4], count)?;
        let column = fallback.ok_or_else(|| self.missing(source, name))?;
        self.note(Note::Assumed(format!("COLOR_0 for the colours of splats, which have no {name}")));
        Ok(Color::Fallback(column))
    }

    /// The harmonics of degree 1 and more, those of whole degrees.
    fn harmonics(&self, source: &Source<'_>, count: Option<usize>) -> Result<Vec<Column<'a>>, ImportError> {
        let mut columns = Vec::new();
        let mut ended = None;
        for degree in 1..=3 {
            for order in 0..=2 * degree {
                let name = format!("SH_DEGREE_{degree}_COEF_{order}");
                match (self.find(source, &name, &[3], count)?, &ended) {
                    (Some(column), None) => columns.push(column),
                    (Some(_), Some(missing)) => {
                        let problem = format!("has {name}, but no {missing}: degrees must be whole");
                        return Err(self.malformed(source, problem));
                    }
                    (None, None) if order > 0 => {
                        let problem =
                            format!("has SH_DEGREE_{degree}_COEF_0, but no {name}: degrees must be whole");
                        return Err(self.malformed(source, problem));
                    }
                    (None, None) => ended = Some(name),
                    (None, Some(_)) => {}
                }
            }
        }
        Ok(columns)
    }
}

/// What is wrong with the components of an attribute, if they are none that the extension has for it (for positions and colours: glTF
/// itself).
fn misfit(name: &str, column: &Column<'_>, quantized: bool) -> Option<String> {
    use Scalar::{F32, I8, I16, U8, U16};
    let (scalar, normalized) = (column.scalar, column.is_normalized());
    let (fits, expected) = match name {
        "POSITION" => (
            quantized && matches!(scalar, I8 | U8 | I16 | U16),
            "floats, or bytes or shorts where the file has KHR_mesh_quantization",
        ),
        "ROTATION" => {
            (normalized && matches!(scalar, I8 | I16), "floats, or normalized signed bytes or shorts")
        }
        "SCALE" => (matches!(scalar, U8 | U16), "floats, or unsigned bytes or shorts"),
        "OPACITY" | "COLOR_0" => {
            (normalized && matches!(scalar, U8 | U16), "floats, or normalized unsigned bytes or shorts")
        }
        _ => (false, "floats"),
    };
    let kind = match scalar {
        I8 => "signed bytes",
        U8 => "unsigned bytes",
        I16 => "signed shorts",
        U16 => "unsigned shorts",
        _ => "unsigned ints",
    };
    let how = if normalized { "normalized" } else { "unnormalized" };
    (scalar != F32 && !fits).then(|| format!("{name} has {how} {kind}; it must have {expected}"))
}

impl Part<'_> {
    fn put(&self, row: usize, sink: &mut Sink<'_>) {
        let number = |column: &Column<'_>, component: usize| column.value(row, component) as f32;
        let three = |column: &Column<'_>| [0, 1, 2].map(|component| number(column, component));
        let [x, y, z, w] = [0, 1, 2, 3].map(|component| number(&self.rotation, component));
        let mut record = Trained {
            center: three(&self.center),
            log_scales: three(&self.scale).map(log_scale),
            rotation: [w, x, y, z],
            opacity: number(&self.opacity, 0),
            color: self.color(row),
            ..Trained::default()
        };
        for (color, column) in record.harmonics.iter_mut().zip(&self.harmonics) {
            *color = three(column);
        }
        if let Some(placement) = &self.placement {
            placement.place(&mut record, three(&self.scale));
        }
        sink.put(&record);
    }

    /// Display-encoded, whatever the file has.
    fn color(&self, row: usize) -> [f32; 3] {
        match &self.color {
            Color::Harmonic(column) => {
                let found = color([0, 1, 2].map(|channel| column.value(row, channel) as f32));
                if self.blend == Blend::Linear { found.map(linear_to_srgb) } else { found }
            }
            Color::Fallback(column) => {
                [0, 1, 2].map(|channel| linear_to_srgb(column.value(row, channel) as f32))
            }
        }
    }
}

impl Placement {
    fn new(to_world: &DAffine3) -> Self {
        let linear = to_world.matrix3;
        let (turn, residue) = (Turn::new(nearest_orthogonal(linear)), RESIDUE * largest(linear));
        Self { to_world: *to_world, turn, residue }
    }

    /// Moves a record to the world. What is no splat is left as it is, to be rejected.
    fn place(&self, record: &mut Trained, sigmas: [f32; 3]) {
        let center = self.to_world.transform_point3(DVec3::from_array(record.center.map(f64::from)));
        record.center = center.as_vec3().to_array();
        let [w, x, y, z] = record.rotation.map(f64::from);
        let quaternion = DVec4::new(x, y, z, w);
        let sigmas = DVec3::from_array(sigmas.map(f64::from));
        if quaternion.is_finite()
            && quaternion != DVec4::ZERO
            && sigmas.is_finite()
            && sigmas.min_element() >= 0.0
        {
            let axes = DMat3::from_quat(DQuat::from_vec4(quaternion).normalize());
            let factor = self.to_world.matrix3 * axes * DMat3::from_diagonal(sigmas);
            let residue = self.residue * sigmas.max_element();
            (record.log_scales, record.rotation) = of_half_axes(flattened(half_axes(factor), residue));
        }
        self.turn.apply(&mut record.harmonics);
    }
}

/// The orthogonal matrix that is nearest to a linear map: Q of A = Q S.
///
/// Higham, *Computing the Polar Decomposition, with Applications*, 1986: Newton's iteration. Maps to a plane have two, of which the one
/// that doesn't mirror is taken. Maps to a line or a point have many; splats keep their directions' colours.
fn nearest_orthogonal(linear: DMat3) -> DMat3 {
    let axes = flattened(half_axes(linear), RESIDUE * largest(linear));
    let flat_axes =
        [axes.x_axis, axes.y_axis, axes.z_axis].iter().filter(|axis| **axis == DVec3::ZERO).count();
    let linear = match flat_axes {
        0 => linear,
        1 => completed(linear),
        _ => return DMat3::IDENTITY,
    };
    let scale = linear.determinant().abs().cbrt();
    let mut q = linear * scale.recip();
    // Doubles the digits each time; the scaled beginning is near unless the map is nearly flat.
    for _ in 0..64 {
        q = (q + q.inverse().transpose()) * 0.5;
    }
    if q.is_finite() { q } else { DMat3::IDENTITY }
}

/// A map to a plane as one with an inverse and the same nearest rotation: what it takes to nothing goes along the plane's normal.
fn completed(linear: DMat3) -> DMat3 {
    let (a, b, c) = (linear.x_axis, linear.y_axis, linear.z_axis);
    // Of U diag(s, t, 0) Vᵀ they are U diag(0, 0, s t) Vᵀ, of the sign that makes the sum's determinant positive.
    let cofactors = DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b));
    linear + cofactors * largest(cofactors).sqrt().recip()
}

/// Half-axes, of which those are 0 that are not longer than `residue`.
fn flattened(half_axes: DMat3, residue: f64) -> DMat3 {
    let kept = |axis: DVec3| if axis.length() <= residue { DVec3::ZERO } else { axis };
    DMat3::from_cols(kept(half_axes.x_axis), kept(half_axes.y_axis), kept(half_axes.z_axis))
}

/// The size of a matrix's largest entry.
fn largest(matrix: DMat3) -> f64 {
    matrix.to_cols_array().into_iter().fold(0.0, |most: f64, entry| most.max(entry.abs()))
}
