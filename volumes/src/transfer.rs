//! Transfer functions: what a value looks like.

use oblate_engine::color::srgb_to_linear;
use thiserror::Error;

/// The largest opacity per unit that is taken as it stands: beyond it extinction would be infinite. It lets
/// a millionth of the light through each unit.
pub const MAX_OPACITY: f64 = 1.0 - 1e-6;

/// What the strengths of a transfer function's control points are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StrengthKind {
    /// Extinction per world unit of length, at least 0.
    Extinction,
    /// The opacity of one world unit of length, from 0 to 1: extinction = −ln(1 − opacity), with opacity
    /// cut at [`MAX_OPACITY`].
    OpacityPerUnit,
}

/// The space in which the colours of control points are given and interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorSpace {
    /// sRGB display values.
    Srgb,
    /// Linear Rec. 709.
    Linear,
}

/// A point that a transfer function passes through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlPoint {
    /// The volume's value.
    pub value: f32,
    /// Red, green, blue from 0 to 1 in the function's colour space, not premultiplied.
    pub color: [f32; 3],
    /// Strength of the function's kind.
    pub strength: f32,
}

/// A linear ramp by which extinction is multiplied: 0 up to the gradient magnitude `low`, 1 from `high` on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GradientRamp {
    /// Where extinction begins, in value per world unit; at least 0.
    pub low: f32,
    /// Where it is whole; above `low`.
    pub high: f32,
}

impl GradientRamp {
    /// The ramp, if it begins at 0 or above and ends, finite, above its begin.
    pub(crate) fn checked(self) -> Result<Self, TransferError> {
        let Self { low, high } = self;
        let rises = low >= 0.0 && high > low && high.is_finite();
        if rises { Ok(self) } else { Err(TransferError::Gradient { low, high }) }
    }

    /// The factor at a gradient magnitude in value per world unit.
    pub fn factor(&self, magnitude: f32) -> f32 {
        ((magnitude - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }
}

/// What a transfer function says of a value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Optical {
    /// Extinction per world unit of length.
    pub extinction: f32,
    /// Linear Rec. 709, not premultiplied.
    pub color: [f32; 3],
}

/// A piecewise linear transfer function.
///
/// Control points are interpolated first, as they stand (colours not premultiplied, in the function's own colour space, strengths in
/// their own kind), and converted then. The first and last point hold
/// beyond their values. Two points may share a value: a step, whose upper point counts from there on.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    points: Vec<ControlPoint>,
    strength: StrengthKind,
    color_space: ColorSpace,
    gradient: Option<GradientRamp>,
}

/// Why numbers do not make a transfer function.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TransferError {
    /// There is nothing to interpolate.
    #[error("a transfer function needs a control point: value, red, green, blue, strength")]
    NoPoints,
    /// A number is outside its range.
    #[error("control point {index}: {what} is {value}; {expected}")]
    Point {
        /// The control point, from 0.
        index: usize,
        /// Which number.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What would be right.
        expected: &'static str,
    },
    /// The ramp rises nowhere.
    #[error("gradient ramp from {low} to {high}; it must begin at 0 or above and end above its begin")]
    Gradient {
        /// Its begin.
        low: f32,
        /// Its end.
        high: f32,
    },
}

impl TransferFunction {
    /// A function through `points`, in order of their values.
    ///
    /// # Errors
    /// When there is no point, a number is not finite or outside its documented range, values descend, or
    /// more than two points share one.
    pub fn new(
        points: Vec<ControlPoint>,
        strength: StrengthKind,
        color_space: ColorSpace,
    ) -> Result<Self, TransferError> {
        if points.is_empty() {
            return Err(TransferError::NoPoints);
        }
        for index in 0..points.len() {
            check_point(&points, index, strength)?;
        }
        Ok(Self { points, strength, color_space, gradient: None })
    }

    /// The same function with its extinction multiplied by a ramp in the gradient's magnitude (Levoy,
    /// *Display of Surfaces from Volume Data*, 1988: uniform regions vanish, their borders stay).
    ///
    /// # Errors
    /// When the ramp is not from 0 or above to something above its begin.
    pub fn with_gradient(self, ramp: GradientRamp) -> Result<Self, TransferError> {
        Ok(Self { gradient: Some(ramp.checked()?), ..self })
    }

    /// The control points, in order.
    pub fn points(&self) -> &[ControlPoint] {
        &self.points
    }

    /// What their strengths are.
    pub fn strength(&self) -> StrengthKind {
        self.strength
    }

    /// The space of their colours.
    pub fn color_space(&self) -> ColorSpace {
        self.color_space
    }

    /// The ramp in gradient magnitude, if there is one.
    pub fn gradient(&self) -> Option<GradientRamp> {
        self.gradient
    }

    /// Extinction and linear colour of `value`, without the gradient's factor. A value that is not finite
    /// has no extinction.
    pub fn at(&self, value: f32) -> Optical {
        if !value.is_finite() {
            return Optical::default();
        }
        Optical { extinction: self.extinction(value), color: self.color(value) }
    }

    /// The extinction alone of [`Self::at`].
    pub(crate) fn extinction(&self, value: f32) -> f32 {
        if !value.is_finite() {
            return 0.0;
        }
        let (low, high, share) = self.segment(value);
        let strength = mix(low.strength, high.strength, share);
        let extinction = match self.strength {
            StrengthKind::Extinction => strength,
            StrengthKind::OpacityPerUnit => -(-strength.min(MAX_OPACITY)).ln_1p(),
        };
        extinction as f32
    }

    /// The colour alone of [`Self::at`], for a finite value.
    pub(crate) fn color(&self, value: f32) -> [f32; 3] {
        let (low, high, share) = self.segment(value);
        [0, 1, 2].map(|channel| {
            let mixed = mix(low.color[channel], high.color[channel], share) as f32;
            match self.color_space {
                ColorSpace::Srgb => srgb_to_linear(mixed),
                ColorSpace::Linear => mixed,
            }
        })
    }

    /// Whether a value from `low` to `high` may have extinction: between control points it is not above both
    /// ends.
    pub(crate) fn shows_within(&self, [low, high]: [f32; 2]) -> bool {
        let within = |point: &ControlPoint| low <= point.value && point.value <= high;
        self.points.iter().any(|point| within(point) && point.strength > 0.0)
            || self.extinction(low) > 0.0
            || self.extinction(high) > 0.0
    }

    /// The control points at both sides of `value`, and its share of the way from the lower to the upper.
    fn segment(&self, value: f32) -> (&ControlPoint, &ControlPoint, f64) {
        let above = self.points.partition_point(|point| point.value <= value);
        let low = &self.points[above.saturating_sub(1)];
        let high = &self.points[above.min(self.points.len() - 1)];
        let span = f64::from(high.value) - f64::from(low.value);
        let share = if span > 0.0 { (f64::from(value) - f64::from(low.value)) / span } else { 0.0 };
        (low, high, share)
    }
}

fn mix(a: f32, b: f32, share: f64) -> f64 {
    f64::from(a) + share * (f64::from(b) - f64::from(a))
}

/// Checks control point `index` and its order after those before it.
pub(crate) fn check_point(
    points: &[ControlPoint],
    index: usize,
    strength: StrengthKind,
) -> Result<(), TransferError> {
    let point = &points[index];
    let check = |what, value: f32, right: bool, expected| {
        if right { Ok(()) } else { Err(TransferError::Point { index, what, value, expected }) }
    };
    check("the value", point.value, point.value.is_finite(), "it must be finite")?;
    for (what, c) in ["red", "green", "blue"].into_iter().zip(point.color) {
        check(what, c, (0.0..=1.0).contains(&c), "colours are from 0 to 1")?;
    }
    let s = point.strength;
    match strength {
        StrengthKind::Extinction => {
            check("the extinction", s, s >= 0.0 && s.is_finite(), "it must be finite and at least 0")?;
        }
        StrengthKind::OpacityPerUnit => {
            check("the opacity per unit", s, (0.0..=1.0).contains(&s), "opacities are from 0 to 1")?;
        }
    }
    if let Some(before) = index.checked_sub(1) {
        let rising = points[before].value <= point.value;
        check("the value", point.value, rising, "values must not descend from point to point")?;
    }
    if let Some(before) = index.checked_sub(2) {
        let third = points[before].value == point.value;
        check("the value", point.value, !third, "at most two points may share a value, as a step")?;
    }
    Ok(())
}
