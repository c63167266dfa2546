//! Splats as writers of trained formats take them: one record after another.

use super::ExportError;
use crate::splats::{Trained, trained};
use oblate_engine::{OpacityFilter, Shapes, Splats, Strength};

/// Splats with opacities, whose arrays have one length.
pub(crate) struct Records<'a> {
    splats: &'a Splats,
    pub(crate) filter: OpacityFilter,
    /// Coefficients of each channel.
    pub(crate) per_splat: usize,
}

impl<'a> Records<'a> {
    /// # Errors
    /// For splats with other strengths, and arrays that aren't of one length.
    pub(crate) fn new(splats: &'a Splats) -> Result<Self, ExportError> {
        let unsuited = |what: &str| Err(ExportError::Unsuited(what.into()));
        let Strength::Opacity { peaks, filter } = &splats.strength else {
            return unsuited("splats of this format have peak opacities; these have masses or areas instead");
        };
        let count = splats.centers.len();
        let shapes = match &splats.shapes {
            Shapes::Shared(_) => count,
            Shapes::Each(factors) => factors.len(),
        };
        let (per_splat, coefficients) = match &splats.harmonics {
            None => (0, 0),
            Some(harmonics) if (1..=3).contains(&harmonics.degree) => {
                (harmonics.per_splat(), harmonics.coefficients.len())
            }
            Some(_) => return unsuited("harmonics have a degree from 1 to 3"),
        };
        let lengths = [shapes, peaks.len(), splats.colors.len()];
        if lengths.iter().any(|length| *length != count) || coefficients != count * per_splat {
            return unsuited("the arrays of splats must have one length");
        }
        Ok(Self { splats, filter: *filter, per_splat })
    }

    pub(crate) fn count(&self) -> usize {
        self.splats.centers.len()
    }

    pub(crate) fn get(&self, index: usize) -> Trained {
        // Peaks are opacities: this was asked.
        trained(self.splats, index).unwrap_or_default()
    }
}
