//! Splats as writers of trained formats take them: one record after another.

use super::ExportError;
use crate::Note;
use crate::splats::{LARGEST_LOG_SCALE, Trained, trained};
use oblate_engine::{Blend, Material, OpacityFilter, Shapes, Splats, Strength};

/// Splats with opacities, whose arrays have one length.
pub(crate) struct Records<'a> {
    splats: &'a Splats,
    pub(crate) filter: OpacityFilter,
    /// Whether opacities end as trained ones do, which is what readers take for granted.
    ends: bool,
    /// Coefficients of each channel.
    pub(crate) per_splat: usize,
}

impl<'a> Records<'a> {
    /// # Errors
    /// For splats with other strengths, no splats at all, and arrays that aren't of one length.
    pub(crate) fn new(splats: &'a Splats) -> Result<Self, ExportError> {
        let unsuited = |what: &str| Err(ExportError::Unsuited(what.into()));
        let Strength::Opacity { peaks, filter, least } = &splats.strength else {
            return unsuited("splats of this format have peak opacities; these have masses or areas instead");
        };
        let count = splats.centers.len();
        if count == 0 {
            return unsuited("there are no splats to write");
        }
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
        Ok(Self { splats, filter: *filter, ends: *least == Strength::LEAST_OF_TRAINED, per_splat })
    }

    pub(crate) fn count(&self) -> usize {
        self.splats.centers.len()
    }

    pub(crate) fn get(&self, index: usize) -> Trained {
        // Peaks are opacities: this was asked.
        trained(self.splats, index).unwrap_or_default()
    }
}

/// What a format has words for, beside the numbers of trained splats.
pub(crate) struct Words {
    /// That opacities were trained with compensation.
    pub(crate) compensated: bool,
    /// That colours mix in linear light.
    pub(crate) linear: bool,
}

impl Records<'_> {
    /// What a format has no words for.
    pub(crate) fn left_out(&self, blend: Blend, words: &Words) -> Vec<Note> {
        let compensated = self.filter == OpacityFilter::Compensated;
        let all = [
            (
                compensated && !words.compensated,
                "that opacities were trained with compensation for the pixel's filter, which the format cannot say",
            ),
            (
                blend == Blend::Linear && !words.linear,
                "that colours mix in linear light: readers of this format mix them display-encoded",
            ),
            (!self.ends, "where opacities end: readers of this format leave out what is below 1/255"),
            (self.splats.normals.is_some(), "normals"),
            (self.splats.material != Material::UNLIT, "how the splats answer light"),
        ];
        all.into_iter().filter(|(is, _)| *is).map(|(_, what)| Note::LeftOut(what.into())).collect()
    }
}

/// Puts lengths into the range that readers take; whether any was beyond it.
pub(crate) fn bound(trained: &mut Trained) -> bool {
    let before = trained.log_scales;
    let bounded = |s: f32| if s.is_finite() { s.clamp(-LARGEST_LOG_SCALE, LARGEST_LOG_SCALE) } else { s };
    trained.log_scales = before.map(bounded);
    trained.log_scales != before
}

/// What is to be said of `count` splats that were out of this range.
pub(crate) fn bounded(count: usize) -> Option<Note> {
    let said = || Note::Rounded(format!("{count} splats with lengths beyond e^±40, cut off there"));
    (count > 0).then(said)
}
