//! Irregular volumes to clouds of splats.

use crate::description::Look;
use crate::transfer;
use anyhow::{Result, ensure};
use oblate::engine::Cloud;
use oblate::volumes::{
    Arrangement, IrregularExtractor, IrregularVolume, IsoSettings, KernelSettings, Partition,
};

/// Iso-surfaces, then the inside: what was asked for, or the inside where nothing was.
pub(crate) fn irregular_clouds(volume: &IrregularVolume, look: &Look) -> Result<Vec<Cloud>> {
    ensure!(
        look.iso.is_none() || volume.arrangement() == Arrangement::Curvilinear,
        "scattered samples have no cells, and so no surfaces; --transfer draws them"
    );
    let mut clouds = Vec::new();
    let mut settings = IsoSettings::default();
    if let Some(color) = look.iso_color {
        let [r, g, b, _] = color.0;
        settings.color = [r, g, b];
    }
    let extractor = IrregularExtractor::new(volume, settings.interpolation)?;
    for iso in look.iso.iter().flatten() {
        clouds.push(extractor.extract(*iso)?.cloud(&settings)?);
    }
    if look.transfer.is_some() || clouds.is_empty() {
        let function = transfer::resolve(look.transfer.as_ref(), volume.samples())?;
        clouds.push(Partition::new(volume).kernels(&function, &KernelSettings::default())?);
    }
    Ok(clouds)
}
