//! Scenes that the program makes itself, to measure ways of drawing on.

pub mod gaussians;
mod made;
pub mod random;
mod warped;

pub use made::{HEAD_TRANSFER, head_volume};

use oblate_engine::{Camera, CameraError, CloudError, Frame, RenderSettings, Scene};
use oblate_surfels::{DepthError, SampleError};
use oblate_volumes::{IsoError, TransferTextError, VolumeError};
use thiserror::Error;

/// What is drawn and measured.
pub struct Subject {
    /// One word or a few.
    pub name: String,
    /// What it shows and what is hard about it: a sentence or two.
    pub about: String,
    /// The splats and lights.
    pub scene: Scene,
    /// The whole picture.
    pub camera: Camera,
    /// How it is drawn when nothing is said.
    pub settings: RenderSettings,
    /// What it stands for, where that is known better than any reference draws it.
    pub known: Option<Known>,
    /// What other programs drew of it.
    pub peers: Vec<Peer>,
}

/// What another program drew, and how long it took.
#[derive(Clone, Debug)]
pub struct Peer {
    /// The program and its version.
    pub name: String,
    /// Median time of a picture in milliseconds.
    pub median_ms: f64,
    /// The quickest and the slowest.
    pub spread_ms: [f64; 2],
    /// The whole picture, display-encoded and opaque.
    pub display: Vec<[f32; 3]>,
}

/// A picture that is right, and other ways to it than splats.
pub struct Known {
    /// What the picture is of: a few words.
    pub name: String,
    /// The whole picture.
    pub frame: Frame,
    /// Pixels of it that count.
    pub counts: Vec<bool>,
    /// What draws the picture from what the splats were made of.
    pub others: Vec<Other>,
    /// Makes the splats anew, where that is part of drawing.
    pub remake: Option<Remake>,
}

/// Makes splats.
pub type Remake = Box<dyn Fn() -> Scene + Send + Sync>;

/// What others do.
pub struct Other {
    /// A few words.
    pub name: String,
    /// Draws the whole picture.
    pub draw: Box<dyn Fn() -> Frame + Send + Sync>,
}

/// How large scenes and pictures are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Hundreds of thousands of splats, 512².
    Full,
    /// Tens of thousands, 128².
    Quick,
}

impl Scale {
    /// Pixels along a side of a picture.
    pub fn side(self) -> u32 {
        match self {
            Self::Full => 512,
            Self::Quick => 128,
        }
    }

    /// One of two numbers.
    fn pick<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }
}

/// A scene that the program makes.
#[derive(Clone, Copy)]
pub struct BuiltIn {
    /// One word.
    pub name: &'static str,
    /// Makes it.
    pub make: fn(Scale) -> Result<Subject, SubjectError>,
}

/// All of them.
pub const BUILT_IN: [BuiltIn; 8] = [
    BuiltIn { name: "head", make: made::head },
    BuiltIn { name: "clouds", make: made::clouds },
    BuiltIn { name: "surface", make: made::surface },
    BuiltIn { name: "mixed", make: made::mixed },
    BuiltIn { name: "trained", make: made::trained },
    BuiltIn { name: "staged", make: made::staged },
    BuiltIn { name: "far", make: made::far },
    BuiltIn { name: "warp", make: warped::warp },
];

/// Why a scene can't be made: never, unless numbers in this crate are wrong.
#[derive(Debug, Error)]
#[error(transparent)]
#[allow(missing_docs, reason = "each is the error that it is named after")]
pub enum SubjectError {
    Camera(#[from] CameraError),
    Cloud(#[from] CloudError),
    Depth(#[from] DepthError),
    Iso(#[from] IsoError),
    Sample(#[from] SampleError),
    Transfer(#[from] TransferTextError),
    Volume(#[from] VolumeError),
}
