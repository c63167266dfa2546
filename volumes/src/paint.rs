//! Clouds coloured by a volume.

use glam::DVec3;
use rayon::prelude::*;

use oblate_engine::{Cloud, CloudError};

use crate::transfer::TransferFunction;
use crate::volume::Volume;

/// The cloud in the colours that `transfer` gives the field's values at the splats' centres, as a surface shows a second
/// quantity; splats outside of the field, or beside values that are not finite, keep their own. Extinction in `transfer` is of no
/// matter. Levels of detail are to be made again.
///
/// # Errors
/// Never for a cloud's own splats; those of [`Cloud::new`].
pub fn painted(cloud: &Cloud, field: &Volume, transfer: &TransferFunction) -> Result<Cloud, CloudError> {
    let to_index = field.index_to_world().inverse() * cloud.cloud_to_world();
    let mut splats = cloud.splats();
    let centers = splats.centers.par_iter();
    splats.colors.par_iter_mut().zip(centers).for_each(|(color, center)| {
        let index: DVec3 = to_index.transform_point3(center.as_dvec3());
        if let Some(value) = field.sample(index) {
            *color = transfer.color(value);
        }
    });
    Ok(Cloud::new(splats)?.transformed(cloud.cloud_to_world()))
}
