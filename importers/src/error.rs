//! Why a file does not open.

use oblate_volumes::{IrregularError, VolumeError};
use std::fmt;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why a file does not open.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A file names another that cannot be read.
    #[error("{}{place}: names {}, which cannot be read: {source}", path.display(), named.display())]
    Named {
        /// The naming file.
        path: PathBuf,
        /// Where in it.
        place: Place,
        /// The named file.
        named: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The bytes are of no known format and nothing says how raw samples would lie in them.
    #[error(
        "{}: not recognised as {}; to read it as raw voxels, {missing} \
         (a name like head_256x256x113_uint16be.raw.gz says the same)", path.display(), crate::format::names()
    )]
    Unknown {
        /// The file.
        path: PathBuf,
        /// What must be given for raw voxels.
        missing: String,
    },
    /// The file breaks its format's rules.
    #[error("{}{place}: {problem}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where in it.
        place: Place,
        /// What is wrong and what would be right.
        problem: String,
    },
    /// The file is well-formed as far as read, but needs what is not supported.
    #[error("{}{place}: {feature}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Where in it.
        place: Place,
        /// What it needs and what is supported.
        feature: String,
    },
    /// The numbers do not make a volume.
    #[error("{}: {source}", path.display())]
    Volume {
        /// The file.
        path: PathBuf,
        /// Which numbers.
        source: VolumeError,
    },
    /// The numbers do not make a volume of irregular samples.
    #[error("{}: {source}", path.display())]
    Irregular {
        /// The file.
        path: PathBuf,
        /// Which numbers.
        source: IrregularError,
    },
}

/// Where in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// The whole of it.
    Whole,
    /// A line, the first being 1.
    Line(usize),
    /// A byte, the first being 0.
    Byte(usize),
    /// A part by its name in the format's own words, such as `accessor 3`.
    Part(String),
}

impl fmt::Display for Place {
    /// What follows the file's path in a message.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => Ok(()),
            Self::Line(line) => write!(f, ", line {line}"),
            Self::Byte(byte) => write!(f, ", byte {byte}"),
            Self::Part(part) => write!(f, ", {part}"),
        }
    }
}
