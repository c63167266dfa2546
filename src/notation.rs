//! How values are written at the command line: `640x480`, `1,-2,3`, `#20202080`.

use oblate::engine::color::srgb_to_linear;
use oblate::importers::parse_dims;
use oblate::volumes::Flattening;
use serde::Deserialize;
use std::str::FromStr;

/// A colour written as sRGB display values in hexadecimal, `RRGGBB` or `RRGGBBAA`; held linear and not
/// premultiplied.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "String")]
pub(crate) struct Rgba(pub(crate) [f32; 4]);

impl FromStr for Rgba {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not a colour; write RRGGBB or RRGGBBAA, such as 202020");
        let digits = text.strip_prefix('#').unwrap_or(text);
        if !(matches!(digits.len(), 6 | 8) && digits.bytes().all(|b| b.is_ascii_hexdigit())) {
            return Err(wrong());
        }
        let packed = u32::from_str_radix(digits, 16).map_err(|_| wrong())?;
        let rgba = if digits.len() == 6 { packed << 8 | 0xff } else { packed };
        Ok(Self::from_bytes(rgba.to_be_bytes()))
    }
}

impl Rgba {
    /// sRGB display values and alpha as bytes.
    pub(crate) fn from_bytes(rgba: [u8; 4]) -> Self {
        let [r, g, b, a] = rgba.map(|byte| f32::from(byte) / 255.0);
        Self([srgb_to_linear(r), srgb_to_linear(g), srgb_to_linear(b), a])
    }
}

impl TryFrom<String> for Rgba {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

/// An error of a channel, where white is 1: `2/255` or `0.01`; a number or a text in scene files.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "Number")]
pub(crate) struct Tolerance(pub(crate) f64);

#[derive(Deserialize)]
#[serde(untagged, expecting = "write it as \"2/255\" or 0.01")]
enum Number {
    Plain(f64),
    Whole(i64),
    Text(String),
}

impl FromStr for Tolerance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is no error of a channel; write it as 2/255 or 0.01");
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong());
        match text.split_once('/') {
            Some((above, below)) => Ok(Self(number(above)? / number(below)?)),
            None => number(text).map(Self),
        }
    }
}

impl TryFrom<Number> for Tolerance {
    type Error = String;

    fn try_from(number: Number) -> Result<Self, String> {
        match number {
            Number::Plain(value) => Ok(Self(value)),
            Number::Whole(value) => Ok(Self(value as f64)),
            Number::Text(text) => text.parse(),
        }
    }
}

/// `1/5000` or `0.001`, finite and above 0.
pub(crate) fn fraction(text: &str) -> Result<f64, String> {
    let wrong = || format!("`{text}` is no number above 0; write it as 1/5000 or 0.0002");
    let Tolerance(number) = text.parse().map_err(|_| wrong())?;
    if number > 0.0 && number.is_finite() { Ok(number) } else { Err(wrong()) }
}

/// Numbers between separators, as many as fit the array.
fn separated<T: FromStr + Copy, const N: usize>(text: &str, by: char, like: &str) -> Result<[T; N], String> {
    let wrong = || format!("`{text}` is not {N} numbers; write them like {like}");
    let numbers: Result<Vec<T>, _> = text.split(by).map(|part| part.trim().parse()).collect();
    numbers.map_err(|_| wrong())?.try_into().map_err(|_| wrong())
}

/// `640x480`.
pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    separated(text, 'x', "640x480")
}

/// `256x256x128`, or `256x256` for slices.
pub(crate) fn dims(text: &str) -> Result<[usize; 3], String> {
    parse_dims(text).map_err(|error| error.to_string())
}

/// `1,-2,3.5`, each finite.
pub(crate) fn triple(text: &str) -> Result<[f64; 3], String> {
    let numbers: [f64; 3] = separated(text, ',', "1,-2,3.5")?;
    if numbers.iter().all(|n| n.is_finite()) { Ok(numbers) } else { Err(format!("`{text}` is not finite")) }
}

/// `320,240.5`, each finite.
pub(crate) fn pair(text: &str) -> Result<[f64; 2], String> {
    let numbers: [f64; 2] = separated(text, ',', "320,240.5")?;
    if numbers.iter().all(|n| n.is_finite()) { Ok(numbers) } else { Err(format!("`{text}` is not finite")) }
}

/// `0,0,0,10,20,30`: two corners, each number finite and the second corner's above the first's.
pub(crate) fn corners(text: &str) -> Result<Corners, String> {
    let [a, b, c, d, e, f]: [f64; 6] = separated(text, ',', "0,0,0,10,20,30")?;
    Corners::try_from([a, b, c, d, e, f])
}

/// The lower and the upper corner of a box.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "[f64; 6]")]
pub(crate) struct Corners(pub(crate) [[f64; 3]; 2]);

impl TryFrom<[f64; 6]> for Corners {
    type Error = String;

    fn try_from([a, b, c, d, e, f]: [f64; 6]) -> Result<Self, String> {
        let (low, high) = ([a, b, c], [d, e, f]);
        let right = low.iter().zip(&high).all(|(low, high)| low < high && (high - low).is_finite());
        if right {
            return Ok(Self([low, high]));
        }
        Err(format!(
            "`{}` is no box; give the lower corner, then the upper one",
            comma_list(&[a, b, c, d, e, f])
        ))
    }
}

/// `0,0,1,20`: the half of space in which 0·x + 0·y + 1·z ≥ 20.
pub(crate) fn plane(text: &str) -> Result<Plane, String> {
    let numbers: [f64; 4] = separated(text, ',', "0,0,1,20")?;
    Plane::try_from(numbers)
}

/// A direction that is not zero, and how far along it what stays begins.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "[f64; 4]")]
pub(crate) struct Plane(pub(crate) [f64; 4]);

impl TryFrom<[f64; 4]> for Plane {
    type Error = String;

    fn try_from(numbers: [f64; 4]) -> Result<Self, String> {
        let finite = numbers.iter().all(|n| n.is_finite());
        if finite && numbers[..3] != [0.0; 3] {
            return Ok(Self(numbers));
        }
        let text = comma_list(&numbers);
        Err(format!(
            "`{text}` is no plane; give a direction X,Y,Z that is not zero, and where along it what stays begins"
        ))
    }
}

/// `100`, `100,5` or `100,5,8`: a value, the least gradient there, the ratio of radius and thickness.
pub(crate) fn flattening(text: &str) -> Result<Press, String> {
    let wrong = |_| {
        format!(
            "`{text}` is not one to three numbers; write a value, or value,gradient, or value,gradient,ratio"
        )
    };
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    Press::try_from(numbers.map_err(wrong)?)
}

/// What of a volume's samples becomes flat.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "Vec<f32>")]
pub(crate) struct Press(pub(crate) Flattening);

impl TryFrom<Vec<f32>> for Press {
    type Error = String;

    fn try_from(numbers: Vec<f32>) -> Result<Self, String> {
        let (value, least_gradient, ratio) = match numbers[..] {
            [value] => (value, 0.0, f32::INFINITY),
            [value, gradient] => (value, gradient, f32::INFINITY),
            [value, gradient, ratio] => (value, gradient, ratio),
            _ => {
                return Err(format!(
                    "{} numbers; a value, then a gradient, then a ratio are expected",
                    numbers.len()
                ));
            }
        };
        if !(value.is_finite() && least_gradient >= 0.0 && least_gradient.is_finite() && ratio >= 1.0) {
            return Err("the value must be finite, the gradient at least 0, the ratio at least 1".into());
        }
        Ok(Self(Flattening { value, least_gradient, ratio }))
    }
}

/// `0.5` or `0.5,10`: a distance, and an angle in degrees, 10 where none is given; the angle in radians.
pub(crate) fn distance_and_angle(text: &str) -> Result<[f64; 2], String> {
    let wrong = || format!("`{text}` is no distance, at least 0, or distance,degrees such as 0.5,10");
    let (distance, degrees) = text.split_once(',').unwrap_or((text, "10"));
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|n| *n >= 0.0 && n.is_finite());
    let (distance, degrees) = (number(distance).ok_or_else(wrong)?, number(degrees).ok_or_else(wrong)?);
    Ok([distance, degrees.to_radians()])
}

/// `123`, `512M` (mebibytes), `16G` (gibibytes).
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let wrong = || format!("`{text}` is no number of bytes above 0; write it as 512M or 16G");
    let (digits, shift) = match text.as_bytes().last().map(u8::to_ascii_uppercase) {
        Some(b'K') => (&text[..text.len() - 1], 10),
        Some(b'M') => (&text[..text.len() - 1], 20),
        Some(b'G') => (&text[..text.len() - 1], 30),
        _ => (text, 0),
    };
    let count: u64 = digits.parse().map_err(|_| wrong())?;
    count.checked_mul(1 << shift).filter(|bytes| *bytes > 0).ok_or_else(wrong)
}

/// `on` or `off`.
pub(crate) fn switch(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err(format!("`{text}` is neither `on` nor `off`")),
    }
}

/// Numbers with a comma between them, in a form that [`triple`] reads back.
pub(crate) fn comma_list(numbers: &[f64]) -> String {
    // Adding 0 turns -0 into 0.
    numbers.iter().map(|n| (n + 0.0).to_string()).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours() {
        assert_eq!("#ff000080".parse::<Rgba>().unwrap().0, [1.0, 0.0, 0.0, 128.0 / 255.0]);
        assert_eq!("0000ff".parse::<Rgba>().unwrap().0, [0.0, 0.0, 1.0, 1.0]);
        // sRGB 0x80 = 0.50196 is ((0.50196 + 0.055) / 1.055)^2.4 = 0.21586 linear.
        assert!(("808080".parse::<Rgba>().unwrap().0[0] - 0.215_86).abs() < 1e-5);
        for wrong in ["", "20", "20202", "gggggg", "+12345", "#20202080ff", "äöü"] {
            assert!(wrong.parse::<Rgba>().is_err(), "{wrong} passed");
        }
    }

    #[test]
    fn lists() {
        assert_eq!(triple("1,-2,3.5"), Ok([1.0, -2.0, 3.5]));
        assert_eq!(triple(" 1, -2 ,3e2"), Ok([1.0, -2.0, 300.0]));
        assert_eq!(size("640x480"), Ok([640, 480]));
        assert_eq!(dims("3x4x5"), Ok([3, 4, 5]));
        for wrong in ["1,2", "1,2,3,4", "a,b,c", "", "nan,0,0", "inf,0,0"] {
            assert!(triple(wrong).is_err(), "{wrong} passed");
        }
        assert!(size("-1x2").is_err());
        assert_eq!(comma_list(&[1.0, -0.0, -2.5]), "1,0,-2.5");
    }

    #[test]
    fn boxes_and_planes() {
        assert_eq!(corners("0,-1,2, 3,4,5"), Ok(Corners([[0.0, -1.0, 2.0], [3.0, 4.0, 5.0]])));
        for wrong in ["0,0,0,1,1", "0,0,0,1,1,0", "0,0,0,1,1,inf", "0,0,nan,1,1,1", "a,0,0,1,1,1"] {
            assert!(corners(wrong).is_err(), "{wrong} passed");
        }
        assert_eq!(plane("0,0,-2,5.5"), Ok(Plane([0.0, 0.0, -2.0, 5.5])));
        for wrong in ["0,0,0,1", "0,0,1", "0,0,1,inf", "nan,0,1,1"] {
            assert!(plane(wrong).is_err(), "{wrong} passed");
        }
    }

    #[test]
    fn flattenings_and_deviations() {
        let press = |value, least_gradient, ratio| Ok(Press(Flattening { value, least_gradient, ratio }));
        assert_eq!(flattening("100"), press(100.0, 0.0, f32::INFINITY));
        assert_eq!(flattening("-1.5, 3"), press(-1.5, 3.0, f32::INFINITY));
        assert_eq!(flattening("7,0,4"), press(7.0, 0.0, 4.0));
        for wrong in ["", "x", "1,-1", "1,0,0.5", "1,0,nan", "inf", "1,2,3,4"] {
            assert!(flattening(wrong).is_err(), "{wrong} passed");
        }
        assert_eq!(distance_and_angle("0.5,90"), Ok([0.5, std::f64::consts::FRAC_PI_2]));
        assert_eq!(distance_and_angle("0.5"), distance_and_angle("0.5,10"));
        for wrong in ["", "-1", "1,-1", "1,2,3", "inf", "nan,1"] {
            assert!(distance_and_angle(wrong).is_err(), "{wrong} passed");
        }
    }

    #[test]
    fn tolerances() {
        assert_eq!("2/255".parse(), Ok(Tolerance(2.0 / 255.0)));
        assert_eq!(" 0.01 ".parse(), Ok(Tolerance(0.01)));
        for wrong in ["", "2/", "/255", "1/2/3", "x"] {
            assert!(wrong.parse::<Tolerance>().is_err(), "{wrong} passed");
        }
        // What is no number is refused where ranges are.
        assert!("0/0".parse::<Tolerance>().unwrap().0.is_nan());
    }

    #[test]
    fn sizes() {
        assert_eq!([bytes("123"), bytes("2k"), bytes("512M")], [Ok(123), Ok(2048), Ok(512 << 20)]);
        for wrong in ["", "G", "-1", "0", "1T", "1.5G", "99999999999G"] {
            assert!(bytes(wrong).is_err(), "{wrong} passed");
        }
    }
}
