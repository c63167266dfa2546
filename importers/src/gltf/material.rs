//! Base colours.

use super::buffers::{Buffers, resource};
use crate::file::File;
use crate::{ImportError, Place, texture};
use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::AlphaMode;
use ::gltf::json::texture::{Info, WrappingMode};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Material, Root, Texture as JsonTexture};
use glam::{Mat2, Vec2, Vec4};
use oblate_surfels::{BaseColor, Texture, Wrap};
use std::collections::HashMap;
use std::sync::Arc;

/// What alpha means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Alpha {
    Opaque,
    /// A texel is there if its alpha (0 to 255) is at least this.
    Mask(u32),
    Blend,
}

/// A material as a primitive needs it.
#[derive(Clone)]
pub(crate) struct Look {
    pub(crate) color: BaseColor,
    /// Which set of texture coordinates the texture is on, and how these are moved.
    pub(crate) tex_coords: Option<(u32, UvTransform)>,
    pub(crate) opaque: bool,
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
    textures: HashMap<(usize, Alpha), Arc<Texture>>,
}

impl<'a> Materials<'a> {
    pub(crate) fn new(file: &'a File, root: &'a Root) -> Self {
        Self { file, root, textures: HashMap::new() }
    }

    /// A material, or the default one.
    pub(crate) fn look(
        &mut self,
        index: Option<Index<Material>>,
        buffers: &Buffers<'_>,
    ) -> Result<Look, ImportError> {
        let Some(index) = index else {
            return Ok(Look { color: BaseColor::default(), tex_coords: None, opaque: true });
        };
        let place = || Place::Part(format!("material {}", index.value()));
        let missing = || self.file.malformed(place(), "is named, but not there");
        let material = self.root.get(index).ok_or_else(missing)?;
        let glossiness = material.extensions.as_ref().and_then(|e| e.pbr_specular_glossiness.as_ref());
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
        let alpha = match material.alpha_mode {
            Checked::Valid(AlphaMode::Opaque) => Alpha::Opaque,
            Checked::Valid(AlphaMode::Mask) => {
                let cutoff = material.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0);
                let texel_cutoff = (255.0 * cutoff / factor.w).ceil();
                // A factor of 0 passes a cut-off of 0 alone.
                Alpha::Mask(if texel_cutoff.is_nan() { 0 } else { texel_cutoff.clamp(0.0, 256.0) as u32 })
            }
            Checked::Valid(AlphaMode::Blend) => Alpha::Blend,
            Checked::Invalid => {
                return Err(self.file.malformed(place(), "alphaMode must be OPAQUE, MASK or BLEND"));
            }
        };
        match alpha {
            Alpha::Opaque => factor.w = 1.0,
            // Without a texture the factor alone is compared.
            Alpha::Mask(cutoff) => factor.w = if info.is_some() || cutoff <= 255 { 1.0 } else { 0.0 },
            Alpha::Blend => {}
        }
        let transform = |info: &Info| {
            let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
            let set = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
            (set, UvTransform::new(transform))
        };
        let tex_coords = info.as_ref().map(transform);
        let texture = match info {
            Some(info) => Some(self.texture(info.index, alpha, buffers)?),
            None => None,
        };
        Ok(Look { color: BaseColor { factor, texture }, tex_coords, opaque: alpha != Alpha::Blend })
    }

    fn texture(
        &mut self,
        index: Index<JsonTexture>,
        alpha: Alpha,
        buffers: &Buffers<'_>,
    ) -> Result<Arc<Texture>, ImportError> {
        if let Some(texture) = self.textures.get(&(index.value(), alpha)) {
            return Ok(Arc::clone(texture));
        }
        let place = || Place::Part(format!("texture {}", index.value()));
        let malformed = |problem: &str| self.file.malformed(place(), problem.to_owned());
        let texture = self.root.get(index).ok_or_else(|| malformed("is named, but not there"))?;
        let wrap = match texture.sampler {
            None => [Wrap::Repeat; 2],
            Some(sampler) => {
                let sampler = self.root.get(sampler).ok_or_else(|| malformed("its sampler is not there"))?;
                [wrap(sampler.wrap_s), wrap(sampler.wrap_t)]
            }
        };
        let image_place = || Place::Part(format!("image {}", texture.source.value()));
        let image = self.root.get(texture.source).ok_or_else(|| {
            malformed(
                "has no image source that is read; PNG and JPEG are supported, extensions' formats are not",
            )
        })?;
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
        for texel in &mut texture.texels {
            texel[3] = match alpha {
                Alpha::Opaque => 255,
                Alpha::Mask(cutoff) if u32::from(texel[3]) >= cutoff => 255,
                Alpha::Mask(_) => 0,
                Alpha::Blend => texel[3],
            };
        }
        let texture = Arc::new(texture);
        self.textures.insert((index.value(), alpha), Arc::clone(&texture));
        Ok(texture)
    }
}

fn wrap(mode: Checked<WrappingMode>) -> Wrap {
    match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => Wrap::Repeat,
    }
}
