//! Volumes to clouds of splats, as a look asks for.

use crate::description::Look;
use crate::finish::Paint;
use crate::notation::Rgba;
use crate::transfer;
use anyhow::{Result, ensure};
use oblate::engine::Cloud;
use oblate::volumes::{
    Arrangement, IrregularExtractor, IrregularVolume, IsoExtractor, IsoSettings, KernelSettings, Partition,
    Volume, to_kernels,
};

/// Samples on a regular grid or elsewhere.
#[derive(Clone, Copy)]
pub(crate) enum Field<'a> {
    Regular(&'a Volume),
    Irregular(&'a IrregularVolume),
}

impl Field<'_> {
    /// The values; of irregular samples in index space.
    pub(crate) fn values(&self) -> &Volume {
        match self {
            Self::Regular(volume) => volume,
            Self::Irregular(volume) => volume.samples(),
        }
    }
}

/// Iso-surfaces, then the inside: what was asked for, or the inside where nothing was.
pub(crate) fn volume_clouds(field: Field<'_>, look: &Look, paint: Option<&Paint>) -> Result<Vec<Cloud>> {
    let values = look.iso.as_deref().unwrap_or_default();
    let inside = look.transfer.is_some() || values.is_empty();
    for (what, asked) in [("flatten", look.flatten.is_some()), ("refine", look.refine.is_some())] {
        ensure!(!asked || inside, "{what} is for the inside of a volume; ask for it by transfer");
        ensure!(!asked || matches!(field, Field::Regular(_)), "{what} is for regular grids; this one is not");
    }
    let mut clouds = surfaces(field, values, look.iso_color.as_deref().unwrap_or_default())?;
    if inside {
        clouds.push(kernels(field, look)?);
    }
    match paint {
        Some(paint) => clouds.iter().map(|cloud| paint.apply(cloud)).collect(),
        None => Ok(clouds),
    }
}

/// The surfaces at some values, in one colour or in one for each.
fn surfaces(field: Field<'_>, values: &[f32], colors: &[Rgba]) -> Result<Vec<Cloud>> {
    ensure!(colors.is_empty() || !values.is_empty(), "iso-color is for iso-surfaces; give values by iso");
    ensure!(
        colors.len() <= 1 || colors.len() == values.len(),
        "iso-color has {} colours for {} values of iso; give one, or one for each",
        colors.len(),
        values.len()
    );
    let settings = |number: usize| match colors.get(number).or(colors.first()) {
        Some(Rgba([r, g, b, opacity])) => {
            IsoSettings { color: [*r, *g, *b], opacity: *opacity, ..IsoSettings::default() }
        }
        None => IsoSettings::default(),
    };
    let interpolation = IsoSettings::default().interpolation;
    let numbered = values.iter().enumerate();
    Ok(match field {
        _ if values.is_empty() => Vec::new(),
        Field::Regular(volume) => {
            let extractor = IsoExtractor::new(volume);
            numbered
                .map(|(number, iso)| extractor.extract(*iso, interpolation)?.cloud(&settings(number)))
                .collect::<Result<_, _>>()?
        }
        Field::Irregular(volume) => {
            ensure!(
                volume.arrangement() == Arrangement::Curvilinear,
                "scattered samples have no cells, and so no surfaces; --transfer draws them"
            );
            let extractor = IrregularExtractor::new(volume, interpolation)?;
            numbered
                .map(|(number, iso)| extractor.extract(*iso)?.cloud(&settings(number)))
                .collect::<Result<_, _>>()?
        }
    })
}

/// The inside under a look's transfer function.
fn kernels(field: Field<'_>, look: &Look) -> Result<Cloud> {
    let function = transfer::resolve(look.transfer.as_ref(), field.values())?;
    let settings = KernelSettings { flattening: look.flatten.map(|press| press.0), ..Default::default() };
    Ok(match (field, look.refine) {
        (Field::Irregular(volume), _) => Partition::new(volume).kernels(&function, settings.material)?,
        (Field::Regular(volume), None | Some(1)) => to_kernels(volume, &function, &settings)?,
        (Field::Regular(volume), Some(times)) => to_kernels(&volume.refined(times)?, &function, &settings)?,
    })
}
