//! Transfer functions: interpolation, conversion, text.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

use oblate_engine::color::srgb_to_linear;
use oblate_volumes::{
    ColorSpace, ControlPoint, GradientRamp, Optical, StrengthKind, TransferError, TransferFunction,
};
use proptest::prelude::*;

fn point(value: f32, color: [f32; 3], strength: f32) -> ControlPoint {
    ControlPoint { value, color, strength }
}

/// The function that pictures of the engine volume are compared under: opacity per unit length, sRGB.
fn engine_function() -> TransferFunction {
    let points = vec![
        point(0.0, [0.0, 0.0, 0.0], 0.0),
        point(8.0, [0.0, 0.0, 0.0], 0.0),
        point(20.0, [0.45, 0.5, 0.6], 0.006),
        point(60.0, [0.5, 0.5, 0.55], 0.01),
        point(80.0, [0.55, 0.45, 0.35], 0.02),
        point(140.0, [0.75, 0.65, 0.5], 0.05),
        point(180.0, [0.9, 0.85, 0.8], 0.08),
        point(220.0, [0.95, 0.4, 0.2], 0.6),
        point(255.0, [1.0, 0.5, 0.2], 0.8),
    ];
    TransferFunction::new(points, StrengthKind::OpacityPerUnit, ColorSpace::Srgb).unwrap()
}

/// 200 is half-way from 180 to 220: opacity 0.34, sRGB (0.925, 0.625, 0.5), and only then anything else.
#[test]
fn points_are_interpolated_before_they_are_converted() {
    let Optical { extinction, color } = engine_function().at(200.0);
    assert!((f64::from(extinction) + 0.66_f64.ln()).abs() < 1e-6);
    for (c, srgb) in color.into_iter().zip([0.925, 0.625, 0.5]) {
        assert!((c - srgb_to_linear(srgb)).abs() < 1e-6);
    }
    assert_eq!(engine_function().at(8.0).extinction, 0.0);
    assert!(engine_function().at(8.1).extinction > 0.0);
    // The ends hold.
    assert_eq!(engine_function().at(300.0), engine_function().at(255.0));
    assert_eq!(engine_function().at(-1.0), engine_function().at(0.0));
    assert_eq!(engine_function().at(f32::NAN), Optical::default());
}

#[test]
fn full_opacity_is_cut() {
    let points = vec![point(0.0, [1.0; 3], 1.0)];
    let opaque = TransferFunction::new(points, StrengthKind::OpacityPerUnit, ColorSpace::Linear).unwrap();
    // A millionth comes through: extinction ln 10⁶.
    assert!((opaque.at(0.0).extinction - 1e6_f32.ln()).abs() < 1e-3);
}

#[test]
fn steps_take_the_upper_point() {
    let points = vec![point(0.0, [0.0; 3], 1.0), point(5.0, [0.0; 3], 2.0), point(5.0, [1.0; 3], 7.0)];
    let step = TransferFunction::new(points, StrengthKind::Extinction, ColorSpace::Linear).unwrap();
    assert_eq!(step.at(5.0), Optical { extinction: 7.0, color: [1.0; 3] });
    assert!((step.at(4.999).extinction - 2.0).abs() < 1e-3);
}

#[test]
fn the_format_reads() {
    let text = "\
        # an engine\n\
        transfer 1\n\
        strength opacity_per_unit   # a word\n\
        color srgb\n\
        gradient 2 10.5\n\n\
        0    0 0 0   0\n\
        20   0.45 0.5 0.6  6e-3\n";
    let function: TransferFunction = text.parse().unwrap();
    assert_eq!(format!("\u{feff}{text}").parse(), Ok(function.clone()));
    assert_eq!(function.strength(), StrengthKind::OpacityPerUnit);
    assert_eq!(function.color_space(), ColorSpace::Srgb);
    assert_eq!(function.gradient(), Some(GradientRamp { low: 2.0, high: 10.5 }));
    assert_eq!(function.points()[1], point(20.0, [0.45, 0.5, 0.6], 0.006));
}

/// Each error names its line and what would be right.
#[test]
fn errors_say_where_and_what_would_be_right() {
    let head = "transfer 1\nstrength extinction\ncolor srgb\n";
    let cases = [
        (String::new(), 1, "begins with the line `transfer 1`"),
        ("0 0 0 0 0".into(), 1, "begins with the line `transfer 1`"),
        ("transfer 2\n".into(), 1, "this reads `transfer 1`"),
        ("transfer 1\n0 0 0 0 0\n".into(), 2, "`strength extinction` or `strength opacity_per_unit`"),
        ("transfer 1\nstrength extinction\n0 0 0 0 0\n".into(), 3, "`color srgb` or `color linear`"),
        ("transfer 1\nstrength thick\n".into(), 2, "it is `extinction` or `opacity_per_unit`"),
        ("transfer 1\ncolor cmyk\n".into(), 2, "it is `srgb` or `linear`"),
        ("transfer 1\ncolor srgb\n# again\ncolor srgb\n".into(), 4, "say it once"),
        ("transfer 1\nstrength extinction\n".into(), 3, "the colour space is not said"),
        (head.into(), 4, "needs a control point"),
        (format!("{head}0 0 0 0\n"), 4, "five numbers"),
        (format!("{head}0 0 zero 0 0\n"), 4, "`zero` is not a number"),
        (format!("{head}0 0 0 255 0\n"), 4, "colours are from 0 to 1"),
        (format!("{head}0 0 0 0 -1\n"), 4, "at least 0"),
        (format!("{head}0 0 0 0 inf\n"), 4, "finite"),
        (format!("{head}NaN 0 0 0 0\n"), 4, "finite"),
        (format!("{head}5 0 0 0 0\n4 0 0 0 0\n"), 5, "must not descend"),
        (format!("{head}5 0 0 0 0\n5 0 0 0 0\n5 0 0 0 0\n"), 6, "at most two points"),
        (format!("{head}0 0 0 0 0\nstrength extinction\n"), 5, "before the control points"),
        (format!("{head}gradient 3\n"), 4, "`gradient LOW HIGH`"),
        (format!("{head}gradient 3 3\n0 0 0 0 0\n"), 4, "end above its begin"),
        ("transfer 1\nstrength opacity_per_unit\ncolor srgb\n0 0 0 0 1.5\n".into(), 4, "from 0 to 1"),
    ];
    for (text, line, words) in cases {
        let error = text.parse::<TransferFunction>().unwrap_err();
        assert_eq!(error.line, line, "{text:?}: {error}");
        assert!(error.to_string().contains(words), "{text:?}: {error}");
    }
    let none = TransferFunction::new(vec![], StrengthKind::Extinction, ColorSpace::Linear);
    assert_eq!(none, Err(TransferError::NoPoints));
}

fn any_function() -> impl Strategy<Value = TransferFunction> {
    let rest = (prop::array::uniform3(0.0_f32..=1.0), 0.0_f32..=1.0);
    let points = prop::collection::btree_map(-1_000_000_i32..1_000_000, rest, 1..12);
    (points, any::<[bool; 2]>(), prop::option::of((0.0_f32..5.0, 0.1_f32..1e6))).prop_map(
        |(points, [opacity, srgb], ramp)| {
            let points =
                points.into_iter().map(|(v, (color, s))| point(v as f32 / 777.0, color, s)).collect();
            let kind = if opacity { StrengthKind::OpacityPerUnit } else { StrengthKind::Extinction };
            let space = if srgb { ColorSpace::Srgb } else { ColorSpace::Linear };
            let function = TransferFunction::new(points, kind, space).unwrap();
            match ramp {
                Some((low, more)) => function.with_gradient(GradientRamp { low, high: low + more }).unwrap(),
                None => function,
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn text_gives_the_same_function_back(function in any_function()) {
        prop_assert_eq!(function.to_string().parse::<TransferFunction>().unwrap(), function);
    }

    #[test]
    fn no_text_panics(text in "(transfer 1\n)?(strength extinction\n)?(color srgb\n)?([ -~\n]{0,60})") {
        let _ = text.parse::<TransferFunction>();
    }

    /// What a function says is finite, and within what its points say.
    #[test]
    fn values_are_within_their_points(function in any_function(), value in prop::num::f32::ANY) {
        let Optical { extinction, color } = function.at(value);
        prop_assert!((0.0..=1e6_f32.ln() + 1.0).contains(&extinction));
        prop_assert!(color.iter().all(|c| (0.0..=1.0 + 1e-6).contains(c)));
    }
}
