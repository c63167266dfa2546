//! Spaces that files name.

/// A space by what its axes x, y, z are, where a file says so: anatomical directions are those of the patient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// Right, anterior, superior: NIfTI's.
    Ras,
    /// Left, anterior, superior.
    Las,
    /// Left, posterior, superior: that of DICOM and ITK.
    Lps,
    /// A scanner's own.
    Scanner,
    /// Any that is right-handed.
    RightHanded,
    /// Any that is left-handed.
    LeftHanded,
}

impl Space {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Ras, Self::Las, Self::Lps, Self::Scanner, Self::RightHanded, Self::LeftHanded];

    /// Its name in NRRD's words, such as `right-anterior-superior`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ras => "right-anterior-superior",
            Self::Las => "left-anterior-superior",
            Self::Lps => "left-posterior-superior",
            Self::Scanner => "scanner-xyz",
            Self::RightHanded => "3D-right-handed",
            Self::LeftHanded => "3D-left-handed",
        }
    }
}
