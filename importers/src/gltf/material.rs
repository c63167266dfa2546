//! Base colours.

use super::buffers::{Buffers, resource};
use crate::file::File;
use crate::meshes::texture;
use crate::{ImportError, Place};
use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::AlphaMode;
use ::gltf::json::texture::{Info, MagFilter, WrappingMode};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Image, Index, Material, Root, Texture as JsonTexture};
use glam::{Mat2, Vec2, Vec4};
use oblate_surfels::{BaseColor, Filter, Texture, Wrap};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// A material as a primitive needs it.
#[derive(Clone)]
pub(crate) struct Look {
    pub(crate) color: BaseColor,
    /// Which set of texture coordinates the texture is on, and how these are moved.
    pub(crate) tex_coords: Option<(u32, UvTransform)>,
    /// Whether alpha means nothing, in vertex colours too.
    pub(crate) opaque: bool,
    /// See [`Primitive`](oblate_surfels::Primitive), as of the next one.
    pub(crate) alpha_cutoff: Option<f32>,
    pub(crate) unlit: bool,
    pub(crate) double_sided: bool,
}

/// Texture coordinates to those that are looked up (KHR_texture_transform).
#[derive(Clone, Copy)]
pub(crate) struct UvTransform {
    linear: Mat2,
    offset: Vec2,
}

impl UvTransform {
    fn new(transform: Option<&TextureTransform>) -> Self {
        let Some(transform) = transform else { return Self { linear: Mat2::IDENTITY, offset: Vec2::ZERO } };
        // T · R · S with R counter-clockwise where v grows downwards.
        let (sin, cos) = transform.rotation.0.sin_cos();
        let rotation = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
        let scale = Mat2::from_diagonal(Vec2::from_array(transform.scale.0));
        Self { linear: rotation * scale, offset: Vec2::from_array(transform.offset.0) }
    }

    pub(crate) fn apply(&self, uv: Vec2) -> Vec2 {
        self.linear * uv + self.offset
    }
}

/// Reads materials, each image once.
pub(crate) struct Materials<'a> {
    file: &'a File,
    root: &'a Root,
    /// By index and whether they are made opaque.
    textures: HashMap<(usize, bool), Arc<Texture>>,
    /// Those that were asked for and emit light, which is not read.
    pub(crate) emissive: HashSet<usize>,
}

impl<'a> Materials<'a> {
    pub(crate) fn new(file: &'a File, root: &'a Root) -> Self {
        Self { file, root, textures: HashMap::new(), emissive: HashSet::new() }
    }

    /// A material, or the default one.
    pub(crate) fn look(
        &mut self,
        index: Option<Index<Material>>,
        buffers: &Buffers<'_>,
    ) -> Result<Look, ImportError> {
        let Some(index) = index else {
            let color = BaseColor::default();
            return Ok(Look {
                color,
                tex_coords: None,
                opaque: true,
                alpha_cutoff: None,
                unlit: false,
                double_sided: false,
            });
        };
        let place = || Place::Part(format!("material {}", index.value()));
        let missing = || self.file.malformed(place(), "is named, but not there");
        let material = self.root.get(index).ok_or_else(missing)?;
        let extensions = material.extensions.as_ref();
        let unlit = extensions.is_some_and(|e| e.others.contains_key("KHR_materials_unlit"));
        // What a texture of it says is multiplied by this.
        if !unlit && material.emissive_factor.0 != [0.0; 3] {
            self.emissive.insert(index.value());
        }
        let glossiness = extensions.and_then(|e| e.pbr_specular_glossiness.as_ref());
        let metallic = &material.pbr_metallic_roughness;
        let (factor, info) = match glossiness {
            Some(glossiness) => (glossiness.diffuse_factor.0, &glossiness.diffuse_texture),
            None => (metallic.base_color_factor.0, &metallic.base_color_texture),
        };
        if !factor.iter().all(|c| (0.0..=1.0).contains(c)) {
            let problem = format!("base colour factor {factor:?} must lie in [0, 1]");
            return Err(self.file.malformed(place(), problem));
        }
        let mut factor = Vec4::from_array(factor);
        let Checked::Valid(mode) = material.alpha_mode else {
            return Err(self.file.malformed(place(), "alphaMode must be OPAQUE, MASK or BLEND"));
        };
        let opaque = mode == AlphaMode::Opaque;
        if opaque {
            factor.w = 1.0;
        }
        let cutoff = || material.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0);
        let alpha_cutoff = (mode == AlphaMode::Mask).then(cutoff);
        let transform = |info: &Info| {
            let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
            let set = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
            (set, UvTransform::new(transform))
        };
        let tex_coords = info.as_ref().map(transform);
        let texture = match info {
            Some(info) => Some(self.texture(info.index, opaque, buffers)?),
            None => None,
        };
        let color = BaseColor { factor, texture };
        Ok(Look { color, tex_coords, opaque, alpha_cutoff, unlit, double_sided: material.double_sided })
    }

    fn texture(
        &mut self,
        index: Index<JsonTexture>,
        opaque: bool,
        buffers: &Buffers<'_>,
    ) -> Result<Arc<Texture>, ImportError> {
        if let Some(texture) = self.textures.get(&(index.value(), opaque)) {
            return Ok(Arc::clone(texture));
        }
        let place = || Place::Part(format!("texture {}", index.value()));
        let malformed = |problem: &str| self.file.malformed(place(), problem.to_owned());
        let texture = self.root.get(index).ok_or_else(|| malformed("is named, but not there"))?;
        let (wrap, filter) = match texture.sampler {
            None => ([Wrap::Repeat; 2], Filter::Linear),
            Some(sampler) => {
                let sampler = self.root.get(sampler).ok_or_else(|| malformed("its sampler is not there"))?;
                ([wrap(sampler.wrap_s), wrap(sampler.wrap_t)], filter(sampler.mag_filter))
            }
        };
        let source = source(texture);
        let image_place = || Place::Part(format!("image {}", source.value()));
        let image = self.root.get(source).ok_or_else(|| self.no_source(texture, place()))?;
        let from_uri;
        let bytes = match (image.buffer_view, &image.uri) {
            (Some(view), _) => buffers.view(view)?.0,
            (None, Some(uri)) => {
                from_uri = resource(self.file, image_place(), uri)?;
                &from_uri
            }
            (None, None) => {
                return Err(self.file.malformed(image_place(), "has neither a bufferView nor a uri"));
            }
        };
        let mut texture =
            texture::decode(bytes, wrap).map_err(|problem| self.file.malformed(image_place(), problem))?;
        texture.filter = filter;
        buffers.budget().take(self.file, image_place, (texture.texels.len(), size_of::<[u8; 4]>()))?;
        if opaque {
            texture.texels.iter_mut().for_each(|texel| texel[3] = 255);
        }
        let texture = Arc::new(texture);
        self.textures.insert((index.value(), opaque), Arc::clone(&texture));
        Ok(texture)
    }

    /// What is said of a texture without an image that is read.
    fn no_source(&self, texture: &JsonTexture, place: Place) -> ImportError {
        let formats = "PNG, JPEG and WebP are supported";
        match texture.extensions.iter().flat_map(|extensions| extensions.others.keys()).next() {
            Some(name) => {
                let feature = format!(
                    "has an image only as the extension {name} has it, which is not supported; {formats}"
                );
                self.file.unsupported(place, feature)
            }
            None => self.file.malformed(place, format!("has no image source that is there; {formats}")),
        }
    }
}

/// A texture's image: what every program can read, or else WebP (EXT_texture_webp).
fn source(texture: &JsonTexture) -> Index<Image> {
    // What is not there has an index that nothing has.
    let webp = || texture.extensions.as_ref()?.others.get("EXT_texture_webp")?.get("source")?.as_u64();
    match u32::try_from(webp().unwrap_or(u64::MAX)) {
        Ok(webp) if texture.source.value() == u32::MAX as usize => Index::new(webp),
        _ => texture.source,
    }
}

fn wrap(mode: Checked<WrappingMode>) -> Wrap {
    match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => Wrap::Repeat,
    }
}

fn filter(magnified: Option<Checked<MagFilter>>) -> Filter {
    match magnified {
        Some(Checked::Valid(MagFilter::Nearest)) => Filter::Nearest,
        _ => Filter::Linear,
    }
}
